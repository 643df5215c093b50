"""Optimal control problems built once on a fixed mesh and solved repeatedly for other data.

:func:`crosstrack.solve` draws starts, refines, verifies and names its results, which takes many times the
time of the solver for small problems. Here it is done once or on request. A step is one call of CasADi's
``nlpsol``, or of an interior-point method that uses the structure of the intervals.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...lazy import moved
from ...models.fields import Flag, Optional, Real, show
from ...models.model import Model
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.optimal_control.transcription.base import Transcription
from ..contract.backend import Request
from ..contract.limits import Limits, limits_of
from ..contract.registry import find_backend
from ..nlp.base import AWAY
from ..nlp.casadi_nlp import CasadiNlp
from ..nlp.ipopt import PUSHES
from ..programs.attempts import Ended, solver_tolerance
from ..programs.casadi_plugins import last_line, status_of, vector
from .generated import write_step
from .parametric import Parametric, Point
from .stages import NotStaged
from .step import Step
from .structured import StructuredSolver

__all__ = ["PreparedSolver", "Step", "prepare_control"]
if not TYPE_CHECKING:
    __getattr__ = moved(__name__, {"..run.preparation": "prepare"})

Floats = NDArray[np.float64]

#: Ipopt's barrier parameter at a warm start, and the distance of a warm start from its bounds.
NEAR = 1e-8
#: Beginning of the message for other models.
TAKEN = "prepare takes optimal control problems, flights, grid maps and sideslip models"
SADDLE = "yet not a minimum: the objective falls along a direction of negative curvature"
#: Largest difference of objectives of the same point, relative, and absolute in the objective's scale.
SAME = 1e-6, 1e-9
_WARM_IPOPT = {
    "warm_start_init_point": "yes",
    "mu_strategy": "monotone",
    "mu_init": NEAR,
    "warm_start_mult_bound_push": NEAR,
    **{f"warm_start_{name}": NEAR for name in PUSHES},
}


class PreparedSolver:
    """Problem on a fixed mesh that is solved for other data by a call; created by :func:`crosstrack.prepare`.

    Parameters
    ----------
    formulation : Transcription
        Problem on its mesh.
    backend : CasadiNlp
        Backend whose plugin solves it.
    request : Request
        Tolerance and options of the backend.
    structured : bool, optional
        Use of the structured method, see :func:`crosstrack.prepare`.

    Attributes
    ----------
    posed : Parametric
        Program in its free columns.
    solver : casadi.Function
        CasADi's ``nlpsol`` in the scaled free columns, with the data as p.
    structured : StructuredSolver or None
        Method of warm steps; None if it is not used, for the reason `unstructured`.
    """

    def __init__(
        self, formulation: Transcription, backend: CasadiNlp, request: Request,
        structured: bool | None = None,
    ) -> None:  # fmt: skip
        self.backend, self.request = backend, request
        self.posed = Parametric(formulation)
        backend.load(request)
        self._last: Step | None = None
        kinds = backend.given.items()
        self._derivatives = {name: self.posed.derivative(kind) for name, kind in kinds}
        self.solver = self._make_solver({})
        self._warm = self._make_solver(_WARM_IPOPT) if backend.plugin == "ipopt" else self.solver
        self.structured: StructuredSolver | None = None
        self.unstructured = (
            "not wanted" if structured is False else f"not used with {backend.name!r}"
        )
        if structured or (structured is None and backend.plugin == "ipopt"):
            try:
                tolerance = solver_tolerance(request, 1e-12, 1e-8, share=1e-1)
                known = {kind: self._derivatives[name] for name, kind in kinds}.get("hessian")
                self.structured = StructuredSolver(self.posed, tolerance, known)
                self.unstructured = ""
            except NotStaged as reason:
                self.unstructured = str(reason)
                if structured:
                    raise UnsupportedOption(
                        f"structured=True is not possible: {reason}; None uses the backend for such programs"
                    ) from None

    def __repr__(self) -> str:
        posed = self.posed
        data = ", ".join(f"{name} ({item.size})" for name, item in posed.data.items()) or "none"
        return (
            f"<PreparedSolver {posed.model.name!r}: {self.backend.name} on {posed.formulation.name}, "
            f"{posed.free.size} columns, {posed.rows.size} rows, data: {data}>"
        )

    @property
    def data(self) -> dict[str, Floats]:
        """Values of the data that a call uses by default."""
        return self.posed.named(self.posed.declared)

    def __call__(self, /, *, warm: Any = False, **data: Any) -> Step:
        """Solve the problem for the given data.

        Parameters
        ----------
        warm : bool, Step, ControlPlan, Solution or mapping
            True starts from the last successful step, or from the guess if there was none. A step of
            this solver, or the states and controls of a plan or of samples, can be given instead. A
            search that fails is repeated from the guess. By default the search starts from the guess.
        **data : array_like
            Values of data by name; others have their declared values.

        Returns
        -------
        Step
            The result, which may have failed.

        Raises
        ------
        InvalidData
            A name is not data of the problem, a value has another size or is not finite, or `warm` is
            not a step of this solver.
        """
        begin = time.perf_counter()
        p = self.posed.values(data)
        given, multipliers = self.posed.begin(self._last if warm is True else warm)
        attempts: list[Any] = [(self._solve_once, given, multipliers)]
        if self.structured is not None and multipliers is not None:
            attempts.insert(0, (self.structured.solve, given, multipliers))
        if given is not self.posed.guess:
            attempts.append((self._solve_once, self.posed.guess, None))
        iterations, saddle = 0, False
        for solve, start, multipliers in attempts:
            result = self._judged(p, solve(p, start, multipliers))
            iterations += result["iterations"]
            if not result["ok"]:
                continue
            away = None
            if result["method"] != "structured":
                away = self._descent(p, result, multipliers is None)
            if away is None:
                break
            result.update(ok=False, status=f"{result['status']}, {SADDLE}")
            if not saddle:
                sides = (result["z"] + side * away for side in (AWAY, -AWAY))
                attempts += [(self._solve_once, side, None) for side in sides]
            saddle = True
        step = Step(
            self.posed,
            p,
            **{**result, "iterations": iterations},
            seconds=time.perf_counter() - begin,
            warm=start is given and given is not self.posed.guess,
        )
        if step.ok:
            self._last = step
        return step

    def _solve_once(
        self, p: Floats, start: Floats, multipliers: tuple[Floats, Floats] | None
    ) -> dict[str, Any]:
        """Run the solver once and return its result in the form of the structured method."""
        solver = self.solver if multipliers is None else self._warm
        start_multipliers = {} if multipliers is None else dict(
            zip(("lam_x0", "lam_g0"), multipliers, strict=True)
        )  # fmt: skip
        status, success, count = "", False, 0
        try:
            solution = solver(x0=start, p=p, **self.posed.bounds, **start_multipliers)
        except RuntimeError as error:
            status, nan = last_line(error), np.full(start.size, np.nan)
            rows = np.full(self.posed.rows.size, np.nan)
            solution = {"x": nan, "lam_x": nan, "lam_g": rows}
        else:
            stats = solver.stats()
            status = status_of(stats)
            success = self.backend.ended(stats)[0] is Ended.PROVEN
            count = max(int(stats.get("iter_count", 0)), 0)
        z = vector(solution["x"])
        f, g = self.posed.value(z, p)
        multipliers = vector(solution["lam_x"]), vector(solution["lam_g"])
        return {
            "status": status, "iterations": count, "z": z, "multipliers": multipliers,
            "method": self.backend.name, "success": success, "f": float(f), "g": vector(g),
        }  # fmt: skip

    def _judged(self, p: Floats, result: dict[str, Any]) -> dict[str, Any]:
        """Replace ``success`` and the scaled objective ``f`` and rows ``g`` by the fields of a step."""
        success, f, g = (result.pop(name) for name in ("success", "f", "g"))
        result["violation"] = self.posed.breach(g, p)
        result["ok"] = success and result["violation"] <= self.request.tolerance
        if success and not result["ok"]:
            result["status"] += f", yet a row is off by {result['violation']:.1e}"
        result["objective"] = f * self.posed.program.objective_scale
        return result

    def _descent(self, p: Floats, result: Mapping[str, Any], cold: bool) -> Floats | None:
        """Return a direction of z along which the objective of a result falls; None if none is found.

        Ipopt also stops at saddle points and maxima. Without the structure, only searches without
        multipliers are tested, because the test costs as much as a warm search.
        """
        point = Point(self.posed, p, result["z"], result["multipliers"])
        if self.structured is not None:
            other = self._judged(p, self.structured.solve(p, point.z, point.multipliers))
            allowed = max(
                SAME[0] * abs(result["objective"]), SAME[1] * self.posed.program.objective_scale
            )
            if other["ok"] and abs(other["objective"] - result["objective"]) <= allowed:
                return None
        elif not cold:
            return None
        return point.descent()

    def generate(self, path: str | os.PathLike[str]) -> Path:
        """Write the step as self-contained C code, with a function named after the file.

        The function takes the data by name and the start ``z``, ``lam_x`` and ``lam_g``. It returns
        ``u``, the first controls, ``objective``, ``violation`` and the start of the next step. A second
        function, whose name ends in ``_start``, returns the guess. Only backend ``"sqpmethod"`` with
        ``"qrqp"`` is supported.

        Parameters
        ----------
        path : path-like
            File to write, which ends in ``.c``.

        Raises
        ------
        UnsupportedOption
            The backend is another one.
        UnsupportedFormulation
            A function has no C code.
        InvalidData
            The file cannot be written.
        """
        options = self.request.options
        if self.backend.plugin != "sqpmethod" or options["qp"] != "qrqp":
            raise UnsupportedOption(
                "self-contained C code needs backend 'sqpmethod' with its option qp='qrqp', "
                f"got {self.backend.name!r}"
            )
        return write_step(self.posed, self.solver, path)

    # -- solvers ---------------------------------------------------------------------------------

    def _make_solver(self, more: Mapping[str, Any]) -> Any:
        """Return ``nlpsol`` with the options of the backend and `more` options of the plugin."""
        backend, posed = self.backend, self.posed
        options = {**self._derivatives, **backend.settings(posed.program, self.request)}
        limit = self.request.time_limit
        if limit is not None:
            more = {**more, backend.limit_option: limit}
        # Some plugins have options in addition to CasADi's.
        options.get(backend.plugin, options).update(more)
        return backend.create("step", posed.problem(), options)


def prepare_control(
    original: Model[Any],
    backend: str = "ipopt",
    *,
    formulation: str | None = None,
    mesh: Any = None,
    tolerance: float | None = None,
    time_limit: float | None = None,
    limits: Limits | None = None,
    backend_options: Mapping[str, Any] | None = None,
    structured: bool | None = None,
    **options: Any,
) -> PreparedSolver:
    """Prepare an optimal control problem, or a model that lowers to one; see :func:`crosstrack.prepare`."""
    model = original
    while not isinstance(model, OptimalControlProblem):
        lowered = model.lower()
        if lowered is None:
            raise UnsupportedFormulation(f"{TAKEN}, got model {original.kind!r}")
        model = lowered
    chosen_backend = find_backend(backend)
    if not isinstance(chosen_backend, CasadiNlp):
        raise UnsupportedOption(
            f"prepare takes backends over CasADi's nlpsol, such as 'ipopt' and 'sqpmethod', "
            f"got {show(backend)}"
        )
    chosen_backend.require()
    record = limits_of("prepare", limits, {})
    record.require_only("prepare", ("time_limit", "tolerance"))
    tolerance = record.verification_tolerance if tolerance is None else tolerance
    time_limit = record.time_limit if time_limit is None else time_limit
    tolerance = Real(0.0, 1.0, strict=True).coerce("tolerance", tolerance, {})
    plan = getattr(mesh, "plan", mesh)
    if isinstance(plan, ControlPlan):
        mesh = None
    if mesh is not None:
        options["mesh"] = mesh
    if options.pop("refine", False):
        raise UnsupportedOption("prepare keeps to its mesh: option 'refine' can only be false")
    written = model.formulate(formulation, refine=False, **options)
    if isinstance(plan, ControlPlan):
        written = written.fitted(plan).guessed(plan)
    checked_options = chosen_backend.checked_options(dict(backend_options or {}))
    limit = Optional(Real(0.0, strict=True)).coerce("time_limit", time_limit, {})
    if limit is not None and not chosen_backend.limit_option:
        raise UnsupportedOption(f"backend {chosen_backend.name!r} knows no time_limit")
    request = Request(
        tolerance=tolerance * written.precision, time_limit=limit, options=checked_options
    )
    structured = Optional(Flag()).coerce("structured", structured, {})
    return PreparedSolver(written, chosen_backend, request, structured)
