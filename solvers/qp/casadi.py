"""Quadratic solvers of CasADi's ``conic``, one plugin per solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import BackendBroken, UnsupportedFormulation, WorkerFailure
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, limit_reached, solver_tolerance, stop_reason
from ..programs.casadi_plugins import (
    HIGHS_MARK,
    ended_by_words,
    last_line,
    load_plugin,
    status_of,
    vector,
)
from .base import COMMON, QuadraticBackend
from .forms import independent_rows
from .settings import POLISH, too_large

__all__ = ["CasadiConic", "plugins"]


@dataclass(frozen=True)
class _Plugin:
    """Translation of a request to the options of a plugin.

    `own` returns the options from the program, the tolerance, the iterations per call and the seconds left.
    `dense`: it makes dense copies. `independent`: it fails on linearly dependent equality rows. `piece`:
    iterations per call, for plugins without a time limit that can continue, else 0. `most`: default limit.
    """

    own: Callable[[QuadraticProgram, float, int, float | None], dict[str, Any]]
    dense: bool = False
    independent: bool = False
    piece: int = 0
    most: int = 1000


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _quiet(program: QuadraticProgram, tol: float, most: int, left: float | None) -> dict[str, Any]:
    return {
        "print_iter": False,
        "print_header": False,
        "print_info": False,
        "constr_viol_tol": tol,
        "dual_inf_tol": tol,
        "max_iter": most,
    }


def _daqp(program: QuadraticProgram, tol: float, most: int, left: float | None) -> dict[str, Any]:
    values = np.linalg.eigvalsh(program.hessian.toarray())
    # The plugin fails on semidefinite Hessians without proximal steps.
    proximal = {} if values[0] > 1e-9 * values[-1] else {"eps_prox": 1e-6}
    return {"daqp": {"primal_tol": tol, "dual_tol": tol, "iter_limit": most, **proximal}}


#: Options that switch on the logs of the plugins.
_LOUD: Mapping[str, Any] = {
    "print_iter": True,
    "print_header": True,
    "print_info": True,
    "output_flag": True,
    "verbose": True,
    "printLevel": "medium",
}


def _loud(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a plugin with its log switched on."""
    return {
        name: _loud(value) if isinstance(value, dict) else _LOUD.get(name, value)
        for name, value in options.items()
    }


#: HPIPM's tolerances: gradient, equalities, inequalities, complementarity.
_RESIDUALS = ("res_g_max", "res_b_max", "res_d_max", "res_m_max")

_PLUGINS: Mapping[str, _Plugin] = {
    "qrqp": _Plugin(_quiet, independent=True, piece=5, most=2000),
    "qpoases": _Plugin(
        lambda program, tol, most, left: _given(
            printLevel="none",
            nWSR=most,
            CPUtime=left,
            terminationTolerance=max(tol * 1e-3, 1e-14),
        ),
        dense=True,
        most=100_000,
    ),
    "daqp": _Plugin(_daqp, dense=True, independent=True, most=100_000),
    "highs": _Plugin(
        lambda program, tol, most, left: {
            "highs": _given(
                output_flag=False,
                primal_feasibility_tolerance=max(tol, 1e-10),
                dual_feasibility_tolerance=max(tol, 1e-10),
                qp_iteration_limit=most,
                time_limit=left,
            )
        },
        most=10_000_000,
    ),
    "osqp": _Plugin(
        lambda program, tol, most, left: {
            "osqp": {"verbose": False, "eps_abs": tol, "eps_rel": tol, "max_iter": most}
        },
        piece=4000,
        most=200_000,
    ),
    "proxqp": _Plugin(
        lambda program, tol, most, left: {
            "proxqp": {"eps_abs": tol, "eps_rel": 0.0, "verbose": False, "max_iter": most}
        },
        most=2000,
    ),
    "piqp": _Plugin(
        lambda program, tol, most, left: {
            "piqp": {"eps_abs": tol, "eps_rel": tol, "max_iter": most}
        },
    ),
    "hpipm": _Plugin(
        # One stage with all columns as its state, without the structure that HPIPM exploits.
        lambda program, tol, most, left: {
            "N": 0,
            "nx": [program.size],
            "nu": [0],
            "ng": [program.row_count],
            "hpipm": {"iter_max": most, **dict.fromkeys(_RESIDUALS, tol)},
        },
        dense=True,
        most=200,
    ),
    "clarabel": _Plugin(lambda program, tol, most, left: {}),
}


class CasadiConic(QuadraticBackend):
    """Backend for the plugins of CasADi's ``conic``.

    The plugins that load depend on the wheel, because a plugin may need a library that is missing. A
    plugin that does not load raises :class:`BackendBroken` with CasADi's message. :func:`plugins`
    tests all of them.
    """

    name = "casadi"
    features = COMMON | {Feature.LOG}
    requires = ("casadi",)
    # CasADi's HiGHS conflicts with those of highspy and ortools in one process. The other plugins
    # do not, so the mark is a separate module.
    conflict_group = "highs"
    natives = (HIGHS_MARK,)
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "plugin": Option("qrqp", "Name of the solver in CasADi.", str, tuple(_PLUGINS)),
        "max_iter": Option(None, "Limit on iterations. Default: that of the plugin.", int, lower=1),
    }
    deterministic = True
    summary = "CasADi's conic solvers: qrqp, qpOASES, OSQP, ProxQP, PIQP … by option"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with the selected plugin."""
        import casadi

        from ...models.programs.triplets import dm

        name = str(request.options["plugin"])
        plugin = _PLUGINS[name]
        _load(name)
        reason = too_large(f"backend 'casadi': plugin {name!r}", program) if plugin.dense else ""
        if reason:
            raise UnsupportedFormulation(reason)
        posed, rows = independent_rows(program) if plugin.independent else (program, None)
        iteration_limit = int(request.options["max_iter"] or plugin.most)
        tolerance = solver_tolerance(request, 1e-11, 1e-8, share=1e-2)
        options = plugin.own(
            posed, tolerance, min(plugin.piece or iteration_limit, iteration_limit), clock.left()
        )
        if request.verbose:
            options = _loud(options)
        hessian, matrix = dm(posed.hessian), dm(posed.matrix)
        call: Any = casadi
        try:
            solver = call.conic(
                "solver",
                name,
                {"h": hessian.sparsity(), "a": matrix.sparsity()},
                {"error_on_fail": False, **options},
            )
        except RuntimeError as error:
            raise BackendBroken(
                f"backend 'casadi': plugin {name!r} does not start: {last_line(error)}"
            ) from error
        data = {
            "h": hessian,
            "g": posed.cost,
            "a": matrix,
            "lba": posed.row_lower,
            "uba": posed.row_upper,
            "lbx": posed.column_lower,
            "ubx": posed.column_upper,
        }
        clock.lap("build")
        message, done, late = "", 0, False
        try:
            while True:
                result = solver(**data)
                stats = solver.stats()
                done += plugin.piece
                if (
                    not plugin.piece
                    or done >= iteration_limit
                    or _ended(stats)[1] is not Limit.ITERATIONS
                ):
                    break
                late = limit_reached(request, clock) is not None
                if late:
                    break
                data.update(x0=result["x"], lam_x0=result["lam_x"], lam_a0=result["lam_a"])
        except RuntimeError as error:
            clock.lap("solve")
            return Ending(Ended.FAILED, message=f"CasADi {name}: {last_line(error)}")
        clock.lap("solve")
        point, duals = vector(result["x"]), -vector(result["lam_a"])
        if rows is not None:
            full = np.zeros(program.row_count)
            full[rows] = duals
            duals = full
        ended, limit = _ended(stats)
        if late:
            limit = stop_reason(request.control, Limit.TIME)
        if ended is not Ended.PROVEN:
            message = f"CasADi {name}: {status_of(stats)}"
        counts: dict[str, float | int | str] = {"plugin": name}
        if 0 < int(stats.get("iter_count", -1)) < 10**6:
            counts["iterations"] = int(stats["iter_count"]) + max(done - plugin.piece, 0)
        usable = bool(np.isfinite(point).all() and np.isfinite(duals).all())
        return Ending(
            ended,
            point if usable else None,
            duals=duals if usable else None,
            limit=limit,
            statistics=counts,
            message=message,
        )


def plugins() -> dict[str, str]:
    """Return the reason why each plugin does not load, empty if it does.

    Each plugin is tried in a worker process, because it may crash or conflict with others.
    """
    from ..processes.isolation import Worker

    reasons: dict[str, str] = {}
    for name in _PLUGINS:
        with Worker() as worker:
            try:
                reasons[name] = str(worker.call(_why_not, name, deadline=60.0))
            except WorkerFailure as error:
                reasons[name] = str(error)
    return reasons


def _why_not(name: str) -> str:
    try:
        _load(name)
    except BackendBroken as error:
        return str(error)
    return ""


def _load(name: str) -> None:
    load_plugin("casadi", "conic", name, brings_highs=name == "highs")


def _ended(stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
    if status_of(stats) == "-1" and not stats.get("success"):
        return Ended.INFEASIBLE, None
    return ended_by_words(stats)
