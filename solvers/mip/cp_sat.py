"""OR-Tools' CP-SAT, for programs of bounded whole columns and whole coefficients."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.programs.linear import MixedIntegerProgram
from ..attempts import Clock, Ended, Ending, forward_stop, loosened_cutoff, stop_reason
from ..backend import Feature, Limit, Option, Request
from .base import CALLED_BACK, Incumbents, ProgramBackend

__all__ = ["CpSat"]

#: Sums must stay within what CP-SAT's 64-bit arithmetic holds without overflow.
LARGEST = 2**61
#: A scaled bound this close to a whole number, relatively, is that number written with rounding.
ROUNDING = 1e-9


class CpSat(ProgramBackend):
    """CP-SAT, called directly: exact integer arithmetic, clause learning, many searches at once.

    Only programs whose columns are all whole and bounded are taken, with rows and costs that some
    power of ten (or another whole factor) makes whole; a coefficient counts as the decimal number
    that it is written as, so 0.1 is a tenth.
    """

    name = "cp-sat"
    features = CALLED_BACK | {Feature.THREADS}
    requires = ("ortools",)
    extra = "ortools"
    # See Highs: ortools and highspy exclude one another.
    conflict_group = "highs"
    natives = ("ortools.math_opt.core.python.solver", "ortools.sat.python.cp_model_helper")
    options: ClassVar[Mapping[str, Option]] = {
        "linearization_level": Option(1, "How much linear relaxation is used.", int, (0, 1, 2))
    }
    summary = "OR-Tools CP-SAT: exact, for all-integer programs"

    def refuses(self, problem: MixedIntegerProgram) -> str:
        """Name a continuous column, where there is one."""
        fractional = np.flatnonzero(~problem.integral)
        if not fractional.size:
            return ""
        name = problem.column_name(int(fractional[0]))
        return f"backend 'cp-sat' takes whole columns only: {name} is continuous"

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve with CP-SAT."""
        reason = self.refuses(program)
        if reason:
            raise UnsupportedFormulation(reason)
        whole = _whole(program)
        empty = np.flatnonzero(whole.lower > whole.upper)
        if empty.size:
            name = program.column_name(int(empty[0]))
            message = f"{name}: no whole number lies within the bounds"
            return Ending(Ended.INFEASIBLE, message=message, absolute=True)
        from ortools.sat.python import cp_model

        model, columns = _model(cp_model, whole, request)
        solver = cp_model.CpSolver()
        _configure(solver, request)
        incumbents = Incumbents(program, request)

        class Listener(cp_model.CpSolverSolutionCallback):
            def on_solution_callback(self) -> None:
                incumbents.report(np.array([self.value(column) for column in columns], float))

        def prove(bound: float) -> None:
            incumbents.prove(bound / whole.scale)

        solver.best_bound_callback = prove
        clock.lap("build")
        left = clock.left()
        if left is not None:
            solver.parameters.max_time_in_seconds = left
        with forward_stop(request.control, solver.stop_search):
            status = solver.solve(model, Listener())
        clock.lap("solve")
        return _ending(cp_model, solver, status, columns, whole, model, request)


@dataclass(frozen=True)
class _Whole:
    """The program in whole numbers: the objective is ``(cost @ x + offset) / scale``."""

    cost: list[int]
    offset: float
    scale: int
    rows: list[tuple[list[int], list[int], int, int]]
    lower: np.ndarray[Any, np.dtype[np.int64]]
    upper: np.ndarray[Any, np.dtype[np.int64]]


def _whole(program: MixedIntegerProgram) -> _Whole:
    """Return `program`, whose columns are whole, in whole numbers; else ``UnsupportedFormulation``."""
    size = np.maximum(np.abs(program.column_lower), np.abs(program.column_upper))
    unbounded = np.flatnonzero(size >= 2**53)
    if unbounded.size:
        at = int(unbounded[0])
        raise UnsupportedFormulation(
            f"backend 'cp-sat' needs bounds on every column: {program.column_name(at)} lies in "
            f"[{program.column_lower[at]:g}, {program.column_upper[at]:g}]"
        )
    reach = [int(value) for value in np.ceil(size)]
    cost, scale = _scaled(program.cost.tolist(), reach, "the objective")
    matrix = program.matrix
    start, index, value = matrix.indptr.tolist(), matrix.indices.tolist(), matrix.data.tolist()
    rows = []
    for row, (low, high) in enumerate(
        zip(program.row_lower.tolist(), program.row_upper.tolist(), strict=True)
    ):
        part = slice(start[row], start[row + 1])
        factors, by = _scaled(
            value[part], [reach[c] for c in index[part]], lambda row=row: program.row_name(row)
        )
        most = sum(abs(f) * reach[c] for f, c in zip(factors, index[part], strict=True))
        rows.append((index[part], factors, _up(low, by, -most), -_up(-high, by, -most)))
    return _Whole(
        cost,
        program.offset * scale,
        scale,
        rows,
        np.ceil(program.column_lower - ROUNDING).astype(np.int64),
        np.floor(program.column_upper + ROUNDING).astype(np.int64),
    )


def _scaled(values: list[float], reach: Iterable[int], what: Any) -> tuple[list[int], int]:
    """Return `values` times the least factor that makes them whole, and the factor."""
    if all(value.is_integer() for value in values):
        whole, by = [int(value) for value in values], 1
    else:
        exact = [Fraction(repr(value)) for value in values]
        by = math.lcm(*(value.denominator for value in exact))
        whole = [int(value * by) for value in exact]
    most = sum(abs(value) * size for value, size in zip(whole, reach, strict=True))
    if max(most, by) >= LARGEST:
        raise UnsupportedFormulation(
            "backend 'cp-sat' takes coefficients that scale to whole 64-bit numbers: "
            f"those of {what() if callable(what) else what} do not"
        )
    return whole, by


def _up(bound: float, by: int, least: int) -> int:
    """Return the least whole number that a scaled lower bound admits, not below `least` - 1.

    With the signs of bound, least and result turned, the greatest that an upper one admits.
    """
    if bound == -math.inf:
        return least - 1
    exact = Fraction(repr(bound)) * by
    return max(math.ceil(exact - _rounding(exact)), least - 1)


def _rounding(value: Fraction) -> Fraction:
    return Fraction(ROUNDING) * max(Fraction(1), abs(value))


def _model(cp_model: Any, whole: _Whole, request: Request) -> tuple[Any, list[Any]]:
    model = cp_model.CpModel()
    columns = [
        model.new_int_var(low, high, "")
        for low, high in zip(whole.lower.tolist(), whole.upper.tolist(), strict=True)
    ]

    def total(index: Iterable[int], factors: Iterable[int]) -> Any:
        return cp_model.LinearExpr.weighted_sum([columns[c] for c in index], list(factors))

    for index, factors, low, high in whole.rows:
        if low > high:
            # The row leaves no whole value; no column can be blamed, so a false row says it.
            model.add_bool_or([])
        elif index:
            model.add_linear_constraint(total(index, factors), low, high)
    used = [c for c, factor in enumerate(whole.cost) if factor]
    objective = total(used, [whole.cost[c] for c in used])
    if used:
        model.minimize(objective)
        model.proto.objective.offset = whole.offset
    if request.cutoff is not None and used:
        most = math.floor(loosened_cutoff(request.cutoff) * whole.scale - whole.offset)
        least = -LARGEST
        model.add_linear_constraint(objective, least, max(most, least))
    if request.warm_start is not None:
        values = np.round(np.asarray(request.warm_start, float)).astype(np.int64).tolist()
        for column, value in zip(columns, values, strict=True):
            model.add_hint(column, value)
    return model, columns


def _configure(solver: Any, request: Request) -> None:
    parameters = solver.parameters
    # Counted in whole units, so the bound that CP-SAT puts under the gap's denominator is no loss.
    parameters.relative_gap_limit = request.gap
    parameters.absolute_gap_limit = 0.0
    parameters.catch_sigint_signal = False
    parameters.log_search_progress = request.verbose
    parameters.linearization_level = request.options["linearization_level"]
    if request.seed is not None:
        parameters.random_seed = request.seed % (2**31)
    if request.threads is not None:
        parameters.num_workers = request.threads


def _ending(
    cp_model: Any,
    solver: Any,
    status: Any,
    columns: list[Any],
    whole: _Whole,
    model: Any,
    request: Request,
) -> Ending:
    ended = {
        cp_model.OPTIMAL: Ended.PROVEN,
        cp_model.FEASIBLE: Ended.STOPPED,
        cp_model.INFEASIBLE: Ended.INFEASIBLE,
        cp_model.UNKNOWN: Ended.STOPPED,
    }.get(status, Ended.FAILED)
    point = None
    if status in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        point = np.array([solver.value(column) for column in columns], float)
    message = ""
    if ended is Ended.FAILED:
        message = f"CP-SAT: {solver.status_name(status)} {model.validate()}".rstrip()
    bound = whole.offset / whole.scale
    if any(whole.cost):
        bound = solver.best_objective_bound / whole.scale
    return Ending(
        ended,
        point,
        bound if ended in (Ended.PROVEN, Ended.STOPPED) else None,
        limit=stop_reason(request.control, Limit.TIME) if ended is Ended.STOPPED else None,
        statistics={"branches": int(solver.num_branches), "conflicts": int(solver.num_conflicts)},
        message=message,
    )
