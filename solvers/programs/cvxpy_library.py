"""CVXPY: tools shared by its runs on mixed-integer, quadratic and conic programs."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ...models.programs.base import RowProgram
from ...models.programs.export_conic import cvxpy_cone_duals
from ..contract.backend import Limit
from .attempts import Clock, Ended

__all__ = ["EXCLUDED", "Solved", "chosen", "found", "solve_by_cvxpy"]

_ORTOOLS = "CVXPY loads highspy, with which OR-Tools cannot be imported"
#: Solvers of CVXPY that are not offered, by kind of program, with the reason. Those under ``"any"``
#: are excluded for every kind.
EXCLUDED: Mapping[str, Mapping[str, str]] = {
    "any": {
        "GLOP": _ORTOOLS,
        "PDLP": _ORTOOLS,
        "GUROBI": "CVXPY lets it print its licence on the standard output",
        "ECOS_BB": "CVXPY warns of its wrong results and calls it only on request",
    },
    "mixed-integer": {"SCIPY": "CVXPY reports its 'infeasible or unbounded' as a failure"},
    "quadratic": {
        "PROXQP": "through CVXPY it called a feasible linear program infeasible",
        "SCIP": "CVXPY poses a cone and returns no multipliers, without which nothing is proven",
    },
    "integer quadratic": {},
    "conic": {"ECOS": "it has no semidefinite cones; the backend 'ecos' handles the others"},
}
#: Endings that the statuses of CVXPY mean, apart from limits.
_ENDED = {
    "optimal": Ended.PROVEN,
    "infeasible": Ended.INFEASIBLE,
    "unbounded": Ended.UNBOUNDED,
    "infeasible_or_unbounded": Ended.UNCLEAR,
}
#: Default solver for each kind of program.
_DEFAULT = {
    "mixed-integer": "HIGHS", "quadratic": "CLARABEL", "integer quadratic": "SCIP", "conic": "CLARABEL"
}  # fmt: skip


def found(kind: str) -> tuple[str, ...]:
    """Return the solvers installed for CVXPY, except :data:`EXCLUDED`, that accept programs of `kind`."""
    # The import of CVXPY tries to import all its solvers.
    from cvxpy.constraints.exponential import ExpCone
    from cvxpy.constraints.second_order import SOC
    from cvxpy.reductions.solvers import defines

    solvers: Any = defines.SOLVER_MAP_CONIC
    cones = {name: set(solver.SUPPORTED_CONSTRAINTS) for name, solver in solvers.items()}
    names = defines.INSTALLED_MI_SOLVERS
    if kind == "integer quadratic":
        names = [name for name in names if name in defines.MI_SOCP_SOLVERS]
    if kind == "conic":
        names = [
            name for name in defines.INSTALLED_SOLVERS if {SOC, ExpCone} <= cones.get(name, set())
        ]
    if kind == "quadratic":
        names = [
            name
            for name in defines.INSTALLED_SOLVERS
            if name in defines.SOLVER_MAP_QP
            or SOC in cones.get(name, ())
            or (name in cones and solvers[name].supports_quad_obj())
        ]
    excluded = {**EXCLUDED["any"], **EXCLUDED[kind]}
    return tuple(name for name in names if name not in excluded)


def chosen(program: RowProgram, asked: str | None) -> str:
    """Return the name of the solver in CVXPY for `program`, by default that of its kind.

    Raise ``UnsupportedOption`` if the solver is not installed or does not accept the program.
    """
    kind = program.kind.removesuffix("-program")
    if kind == "quadratic" and getattr(program, "integral", None) is not None:
        kind = "integer quadratic"
    name = asked or _DEFAULT[kind]
    names = found(kind)
    if name not in names:
        why = EXCLUDED["any"].get(name, EXCLUDED[kind].get(name, ""))
        raise UnsupportedOption(
            f"backend 'cvxpy': solver={name!r} accepts no {kind} program"
            f"{' here: ' if why else ''}{why}; those that do: {', '.join(names)}"
        )
    return name


@dataclass(frozen=True, eq=False)
class Solved:
    """Result of solving a ``cvxpy.Problem`` with its problem and variable.

    `error` is the message of the exception that CVXPY raised, empty if none. `late` is true if the time limit was
    reached.
    """

    program: RowProgram
    problem: Any
    columns: Any
    error: str
    late: bool

    @property
    def extra(self) -> Any:
        """Statistics of the solver; None if CVXPY has none."""
        return getattr(self.problem.solver_stats, "extra_stats", None)

    def end(self) -> tuple[Ended, Limit | None]:
        """Return the ending and its limit. A solution that CVXPY calls inaccurate is ``STOPPED``."""
        if self.error and not self.late:
            return Ended.FAILED, None
        status = str(self.problem.status)
        if status in _ENDED:
            return _ENDED[status], None
        # A failing solver raises an exception; only the clock shows whether a limit was reached.
        if self.late:
            return Ended.STOPPED, Limit.TIME
        is_limited = status in ("user_limit", "optimal_inaccurate")
        return (Ended.STOPPED, Limit.ITERATIONS) if is_limited else (Ended.FAILED, None)

    def point(self, ended: Ended) -> NDArray[np.float64] | None:
        """Return the column values, shape (columns,); None if the ending does not define any."""
        if self.columns.value is None or ended not in (Ended.PROVEN, Ended.STOPPED):
            return None
        return np.array(self.columns.value, float)

    def row_duals(self) -> NDArray[np.float64]:
        """Return the multipliers of rows and cones, in the order of the constraints of ``to_cvxpy``.

        The dual value of an inequality in CVXPY is non-negative. That of an equality has the sign of
        the Lagrangian ``f + y (a x - b)``.
        """
        duals = np.zeros(self.program.row_count)
        constraints = iter(self.problem.constraints)
        for sense, which, _ in self.program.sides():
            value = next(constraints).dual_value
            if value is not None:
                sign = 1.0 if sense == ">" else -1.0
                duals[which] += sign * np.asarray(value, float).reshape(-1)
        cones = cvxpy_cone_duals(self.problem, getattr(self.program, "cones", ()))
        return np.concatenate([duals, cones])


def solve_by_cvxpy(
    program: Any,
    solver: str,
    options: Mapping[str, Any],
    time_name: str,
    clock: Clock,
    verbose: bool,
) -> Solved:
    """Solve a program with ``to_cvxpy`` by a solver of CVXPY; `clock` counts ``"build"`` and ``"solve"``.

    `time_name` is the solver's option for the time limit. If empty, the solver is stopped with its process.
    """
    import cvxpy

    problem, columns = program.to_cvxpy()
    # Canonicalise here, so that the time limit includes it; solve() reuses the cached result.
    problem.get_problem_data(solver)
    clock.lap("build")
    left, error = clock.left(), ""
    given = dict(options)
    if left is not None and time_name:
        given[time_name] = max(left, 1e-3)
    if solver == "SCIP":
        given = {"scip_params": {"misc/catchctrlc": False, **given}}
    try:
        with warnings.catch_warnings():
            # CVXPY warns that a limit makes a solution inaccurate; the limit is reported here.
            warnings.simplefilter("ignore")
            problem.solve(solver=solver, verbose=verbose, **given)
    except cvxpy.SolverError as refused:
        error = str(refused)
    clock.lap("solve")
    return Solved(program, problem, columns, error, left is not None and clock.left() == 0.0)
