"""An optimal control problem built once on a fixed mesh, and solved again and again for other data.

What :func:`crosstrack.solve` does around a solver (drawing starts, refining, verifying, naming) costs
many times the solve of a small problem. Here it is done once or on demand: a step is a call of CasADi's
``nlpsol``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import (
    BackendBroken,
    InvalidData,
    NoDerivative,
    UnsupportedFormulation,
    UnsupportedOption,
)
from ...models.fields import Optional, Real, show
from ...models.model import as_model
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.optimal_control.transcription.base import Transcription
from ...models.verification import TOLERANCE, Verification
from ..attempts import Ended
from ..backend import Request
from ..casadi_plugins import last_line, status_of, vector
from ..nlp.casadi_nlp import CasadiNlp
from ..registry import find_backend
from .generated import write_step
from .parametric import Parametric, Point
from .sensitivity import Sensitivity, differentiate

__all__ = ["PreparedSolver", "Step", "prepare"]

Floats = NDArray[np.float64]

#: Ipopt's barrier parameter at a warm start, and how far a warm start is moved off its bounds.
NEAR = 1e-8
_WARM_IPOPT = {
    "warm_start_init_point": "yes",
    "mu_strategy": "monotone",
    "mu_init": NEAR,
    **dict.fromkeys(
        (
            "warm_start_bound_push",
            "warm_start_bound_frac",
            "warm_start_slack_bound_push",
            "warm_start_slack_bound_frac",
            "warm_start_mult_bound_push",
        ),
        NEAR,
    ),
}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Step(Point):
    """How one solve of a :class:`PreparedSolver` ended; what costs time is computed when asked for.

    Attributes
    ----------
    ok : bool
        Whether the solver calls its point a local optimum, and the rows hold there.
    status : str
        The solver's own word.
    objective : float
        Objective of the program at the point.
    seconds : float
        Wall time of the step.
    iterations : int
        Of the solver, a second attempt included.
    violation : float
        Largest violation of a scaled row of the program.
    warm : bool
        Whether the point was reached from an earlier step; a start that fails is tried again cold.
    """

    ok: bool
    status: str
    objective: float
    seconds: float
    iterations: int
    violation: float
    warm: bool

    def __repr__(self) -> str:
        return (
            f"<Step {'ok' if self.ok else 'failed'}: {self.status}, objective {self.objective:.10g}, "
            f"{self.iterations} iterations, {self.seconds:.3g} s>"
        )

    def sensitivity(self, name: str) -> Sensitivity:
        """Return the derivatives of the solution with respect to the data `name`.

        Raises
        ------
        InvalidData
            The problem has no such data.
        NoDerivative
            The step failed, or its solution is not a differentiable function of the data: constraints
            that hold without a multiplier, that depend on one another, or no curvature.
        """
        if not self.ok:
            raise NoDerivative(f"the step failed: {self.status}")
        return differentiate(self, name)

    def verification(self, tolerance: float = TOLERANCE) -> Verification:
        """Return the independent verification of the plan, as :func:`crosstrack.verify` makes it."""
        return self.problem.verify(self.plan, tolerance=tolerance)


class PreparedSolver:
    """A problem on a fixed mesh that is solved at other data by a call; made by :func:`prepare`.

    Parameters
    ----------
    formulation : Transcription
        The problem on its mesh.
    backend : CasadiNlp
        Whose plugin solves it.
    request : Request
        The tolerance and the backend's options.

    Attributes
    ----------
    posed : Parametric
        The program in its free columns.
    """

    def __init__(self, formulation: Transcription, backend: CasadiNlp, request: Request) -> None:
        self.backend, self.request = backend, request
        self.posed = Parametric(formulation)
        backend.load(request)
        self._last: Step | None = None
        #: CasADi's ``nlpsol`` in the free columns, scaled, with the data as p; and for warm starts.
        self.solver = self._made({})
        self._warm = self._made(_WARM_IPOPT) if backend.plugin == "ipopt" else self.solver

    def __repr__(self) -> str:
        own = self.posed
        data = ", ".join(f"{name} ({one.size})" for name, one in own.data.items()) or "none"
        return (
            f"<PreparedSolver {own.model.name!r}: {self.backend.name} on {own.formulation.name}, "
            f"{own.free.size} columns, {own.rows.size} rows, data: {data}>"
        )

    @property
    def data(self) -> dict[str, Floats]:
        """The data that count where a call gives none."""
        return self.posed.named(self.posed.declared)

    def __call__(self, *, warm: bool | Step | ControlPlan = False, **data: Any) -> Step:
        """Solve at `data`.

        Parameters
        ----------
        warm : bool, Step or ControlPlan
            Start from the last step that succeeded (from the guess where there is none), from
            another step of this solver, or from the states and controls of a plan. A solver that
            fails from there starts again from the guess. By default the search starts from the guess.
        **data : array_like
            Values of data by name; what is not named has its declared value.

        Raises
        ------
        InvalidData
            A name is no data of the problem, or a value has another size or is not finite.
        """
        begin = time.perf_counter()
        p = self.posed.values(data)
        start, multipliers = self._start(warm)
        found = self._solved(p, start, multipliers)
        spent = found["iterations"]
        again = not found["ok"] and start is not self.posed.guess
        if again:
            found = self._solved(p, self.posed.guess, None)
        step = Step(
            self.posed, p, **{**found, "iterations": found["iterations"] + again * spent},
            seconds=time.perf_counter() - begin, warm=start is not self.posed.guess and not again,
        )  # fmt: skip
        if step.ok:
            self._last = step
        return step

    def _start(self, warm: Any) -> tuple[Floats, tuple[Floats, Floats] | None]:
        """Return z to start from, and multipliers where they are known."""
        if warm is True:
            warm = self._last
        if warm is None or warm is False:
            return self.posed.guess, None
        if isinstance(warm, Step):
            if warm.posed is not self.posed:
                raise InvalidData("warm must be a step of this solver, got another's", field="warm")
            return warm.z, warm.multipliers
        if not isinstance(warm, ControlPlan):
            raise InvalidData(
                f"warm must be true or false, a step or a plan, got {show(warm)}", field="warm"
            )
        known = {**warm.parameters, **self.data}
        whole = ControlPlan(warm.phases, known)
        return self.posed.start(self.posed.formulation.encode(whole)), None

    def _solved(
        self, p: Floats, start: Floats, multipliers: tuple[Floats, Floats] | None
    ) -> dict[str, Any]:
        """Let the solver search once."""
        solver = self.solver if multipliers is None else self._warm
        first = {} if multipliers is None else dict(
            zip(("lam_x0", "lam_g0"), multipliers, strict=True)
        )  # fmt: skip
        status, success, count = "", False, 0
        try:
            found = solver(x0=start, p=p, **self.posed.bounds, **first)
        except RuntimeError as error:
            status, nan = last_line(error), np.full(start.size, np.nan)
            rows = np.full(self.posed.rows.size, np.nan)
            found = {"x": nan, "lam_x": nan, "lam_g": rows}
        else:
            stats = solver.stats()
            status = status_of(stats)
            success = self.backend.ended(stats)[0] is Ended.PROVEN
            count = max(int(stats.get("iter_count", 0)), 0)
        z = vector(found["x"])
        f, g = self.posed.value(z, p)
        violation = self.posed.breach(vector(g), p)
        ok = success and violation <= self.request.tolerance
        if success and not ok:
            status += f", yet a row is off by {violation:.1e}"
        return {
            "ok": ok,
            "status": status,
            "objective": float(f) * self.posed.program.objective_scale,
            "iterations": count,
            "violation": violation,
            "z": z,
            "multipliers": (vector(found["lam_x"]), vector(found["lam_g"])),
        }

    def generate(self, path: str | os.PathLike[str]) -> Path:
        """Write the step as C code that needs no library, a function named as the file is.

        It takes the data by name, then ``z``, ``lam_x`` and ``lam_g`` to start from, and returns ``u``,
        the first controls, ``objective``, ``violation`` and what the next step starts from; the file's
        second function, whose name ends in ``_start``, returns the guess. Only for the backend
        ``"sqpmethod"`` on ``"qrqp"``.

        Raises
        ------
        UnsupportedOption, UnsupportedFormulation, InvalidData
            Another backend; a function without C code; a file that cannot be written.
        """
        options = self.request.options
        if self.backend.plugin != "sqpmethod" or options["qp"] != "qrqp":
            raise UnsupportedOption(
                "C code that needs no library is to be had of backend 'sqpmethod' with its option "
                f"qp='qrqp', got {self.backend.name!r}"
            )
        return write_step(self.posed, self.solver, path)

    # -- solvers ---------------------------------------------------------------------------------

    def _made(self, more: Mapping[str, Any]) -> Any:
        """Return ``nlpsol`` with the options of the backend and `more` of the plugin's own."""
        import casadi

        backend, posed = self.backend, self.posed
        options: dict[str, Any] = {
            "error_on_fail": False,
            "print_time": False,
            "show_eval_warnings": False,
            **{name: getattr(posed, one) for name, one in backend.given.items()},
            **backend.settings(posed.program, self.request),
        }
        limit = self.request.time_limit
        if limit is not None:
            more = {**more, backend.limit_option: limit}
        # Some plugins take options of their own beside CasADi's.
        options.get(backend.plugin, options).update(more)
        call: Any = casadi
        try:
            return call.nlpsol("step", backend.plugin, posed.problem(), options)
        except RuntimeError as error:
            raise BackendBroken(
                f"backend {backend.name!r}: plugin {backend.plugin!r} does not start: "
                f"{last_line(error)}"
            ) from error


def prepare(
    problem: Any,
    *,
    backend: str = "ipopt",
    formulation: str | None = None,
    mesh: Any = None,
    tolerance: float = TOLERANCE,
    time_limit: float | None = None,
    backend_options: Mapping[str, Any] | None = None,
    **options: Any,
) -> PreparedSolver:
    """Build an optimal control problem on a fixed mesh once, to solve it at other data by a call.

    For model-predictive control and for studies: the mesh is not refined, and plans are verified on
    demand only (``step.verification()``).

    Parameters
    ----------
    problem : OptimalControlProblem
        The problem, with data declared by ``ocp.data(…)``.
    backend : str
        A backend over CasADi: ``"ipopt"``, ``"sqpmethod"`` …; see :func:`crosstrack.backends`.
    formulation : str, optional
        Name of the transcription; the problem's default one.
    mesh : Solution, ControlPlan, Mesh or sequence of float, optional
        Where the phases are cut, as fractions from 0 to 1. A solution or plan gives its own mesh,
        such as a refined one, and the guess.
    tolerance : float
        Largest violation of a scaled row, and what the backend is asked for.
    time_limit : float, optional
        Seconds that a search may take at most, for backends that know a limit; a step that is tried
        again may take twice as long.
    backend_options : mapping, optional
        The backend's own options.
    **options
        Options of the transcription: `intervals`, `degree` …

    Returns
    -------
    PreparedSolver
        ``solver(x0=…, warm=True)`` returns a :class:`Step`.

    Raises
    ------
    UnsupportedFormulation
        The problem is no optimal control problem.
    UnknownName, UnsupportedOption, BackendMissing, BackendBroken, InvalidData
        Something asked for is not to be had.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import OptimalControlProblem
    >>> ocp = OptimalControlProblem("brake")
    >>> x0 = ocp.data("x0", 2, value=[1.0, 0.0])
    >>> phase = ocp.phase(time=(0, 2))
    >>> x, u = phase.state("x", 2, initial=x0), phase.control("u", lower=-3, upper=3)
    >>> phase.dynamics({x: [x[1], u]})
    >>> ocp.minimise(phase.integral(x[0] ** 2 + 0.1 * u**2))
    >>> solver = ct.prepare(ocp, intervals=5, degree=4)
    >>> first, second = solver(), solver(x0=[0.9, -0.1], warm=True)
    >>> first.ok, second.ok, second.objective < first.objective
    (True, True, True)
    """
    asked = model = as_model(problem)
    while not isinstance(model, OptimalControlProblem):
        lowered = model.lower()
        if lowered is None:
            raise UnsupportedFormulation(
                f"prepare takes optimal control problems, got model {asked.kind!r}"
            )
        model = lowered
    found = find_backend(backend)
    if not isinstance(found, CasadiNlp):
        raise UnsupportedOption(
            f"prepare takes backends over CasADi's nlpsol, such as 'ipopt' and 'sqpmethod', "
            f"got {show(backend)}"
        )
    found.require()
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
    own = found.checked_options(dict(backend_options or {}))
    limit = Optional(Real(0.0, strict=True)).coerce("time_limit", time_limit, {})
    if limit is not None and not found.limit_option:
        raise UnsupportedOption(f"backend {found.name!r} knows no time_limit")
    request = Request(tolerance=tolerance * written.precision, time_limit=limit, options=own)
    return PreparedSolver(written, found, request)
