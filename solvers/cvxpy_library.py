"""CVXPY: what its runs on mixed-integer and on quadratic programs share."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UnsupportedOption
from ..models.programs.base import RowProgram
from ..models.programs.export_conic import cvxpy_cone_duals
from .attempts import Clock, Ended
from .backend import Limit

__all__ = ["EXCLUDED", "Solved", "chosen", "found", "solve_by_cvxpy"]

_ORTOOLS = "CVXPY loads highspy, beside which OR-Tools cannot be imported"
#: Solvers that are not to be had through CVXPY, with the reason, by kind of program; those under
#: ``"any"`` for no kind.
EXCLUDED: Mapping[str, Mapping[str, str]] = {
    "any": {
        "GLOP": _ORTOOLS,
        "PDLP": _ORTOOLS,
        "GUROBI": "CVXPY lets it print its licence on the standard output",
        "ECOS_BB": "CVXPY warns of its wrong results, and does not call it unless told to",
    },
    "mixed-integer": {"SCIPY": "CVXPY reports its 'infeasible or unbounded' as a failure"},
    "quadratic": {
        "PROXQP": "by way of CVXPY it was seen to call a feasible linear program infeasible",
        "SCIP": "CVXPY poses a cone and passes no multipliers on, without which nothing is proven",
    },
    "conic": {"ECOS": "it takes no semidefinite cones; the backend 'ecos' takes the others"},
}
#: The solver of each kind of program, unless another is asked for.
_DEFAULT = {"mixed-integer": "HIGHS", "quadratic": "CLARABEL", "conic": "CLARABEL"}


def found(kind: str) -> tuple[str, ...]:
    """Return the solvers that CVXPY finds installed and that take programs of `kind`.

    Those of :data:`EXCLUDED` are left out; of conic programs, those that do not take all cones. CVXPY is imported, and tries to import all its solvers.
    """
    from cvxpy.constraints.exponential import ExpCone
    from cvxpy.constraints.second_order import SOC
    from cvxpy.reductions.solvers import defines

    cone: Any = SOC
    able = defines.INSTALLED_MI_SOLVERS
    if kind == "conic":
        wanted = {SOC, ExpCone}
        able = [
            name
            for name in defines.INSTALLED_SOLVERS
            if name in defines.SOLVER_MAP_CONIC
            and wanted <= set(defines.SOLVER_MAP_CONIC[name].SUPPORTED_CONSTRAINTS)
        ]
    if kind == "quadratic":
        cones, plain = defines.SOLVER_MAP_CONIC, defines.SOLVER_MAP_QP
        able = [
            name
            for name in defines.INSTALLED_SOLVERS
            if name in plain
            or (name in cones and cones[name].supports_quad_obj())
            or (name in cones and cone in cones[name].SUPPORTED_CONSTRAINTS)
        ]
    without = {**EXCLUDED["any"], **EXCLUDED[kind]}
    return tuple(name for name in able if name not in without)


def chosen(program: RowProgram, asked: str | None) -> str:
    """Return the solver `asked` for, or the default; ``UnsupportedOption`` where there is none such."""
    kind = program.kind.removesuffix("-program")
    name = asked or _DEFAULT[kind]
    able = found(kind)
    if name not in able:
        why = EXCLUDED["any"].get(name, EXCLUDED[kind].get(name, ""))
        raise UnsupportedOption(
            f"backend 'cvxpy': solver={name!r} takes no {kind} program"
            f"{' here: ' if why else ''}{why}; those that do: {', '.join(able)}"
        )
    return name


@dataclass(frozen=True, eq=False)
class Solved:
    """A ``cvxpy.Problem`` that has been solved.

    Parameters
    ----------
    program : RowProgram
        What was posed.
    problem, columns : object
        CVXPY's problem and variable.
    error : str
        What CVXPY raised, in words.
    late : bool
        Whether the time was up.
    """

    program: RowProgram
    problem: Any
    columns: Any
    error: str
    late: bool

    @property
    def extra(self) -> Any:
        """The solver's own statistics, None where CVXPY keeps none."""
        return getattr(self.problem.solver_stats, "extra_stats", None)

    def end(self) -> tuple[Ended, Limit | None]:
        """Return how the run ended; what is called inaccurate counts as stopped."""
        limit = Limit.TIME if self.late else Limit.ITERATIONS
        if self.error and not self.late:
            return Ended.FAILED, None
        match str(self.problem.status):
            case "optimal":
                return Ended.PROVEN, None
            case "infeasible":
                return Ended.INFEASIBLE, None
            case "unbounded":
                return Ended.UNBOUNDED, None
            case "infeasible_or_unbounded":
                return Ended.UNCLEAR, None
            case "user_limit" | "optimal_inaccurate":
                return Ended.STOPPED, limit
        # A solver's failure raises, and leaves nothing but the clock to tell a limit.
        return (Ended.STOPPED, limit) if self.late else (Ended.FAILED, None)

    def point(self, ended: Ended) -> NDArray[np.float64] | None:
        """Return the values of the columns, None where there are none or they mean nothing."""
        if self.columns.value is None or ended not in (Ended.PROVEN, Ended.STOPPED):
            return None
        return np.array(self.columns.value, float)

    def row_duals(self) -> NDArray[np.float64]:
        """Return the multipliers of rows and cones, from the constraints in the order of ``to_cvxpy``.

        CVXPY gives an inequality a dual that is never negative, and an equality the sign of its
        Lagrangian, ``f + y (a x - b)``.
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
    """Solve `program` with `solver`, whose name for the time limit is `time_name`, empty for none.

    A solver that knows none is stopped with its process.
    """
    import cvxpy

    problem, columns = program.to_cvxpy()
    # Canonicalised here, so that the time limit counts it; solve() finds the result cached.
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
