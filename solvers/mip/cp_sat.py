"""OR-Tools' CP-SAT, for programs with bounded integer columns and integer coefficients."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.programs.linear import MixedIntegerProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import Clock, Ended, Ending, forward_stop, loosened_cutoff, stop_reason
from ..programs.highs_library import ORTOOLS_MARKS
from .base import CALLED_BACK, Incumbents, ProgramBackend

__all__ = ["CpSat"]

#: Limit on sums, which must not overflow the 64-bit arithmetic of CP-SAT.
LARGEST = 2**61
#: Relative distance from an integer within which a scaled bound is that integer.
ROUNDING = 1e-9


class CpSat(ProgramBackend):
    """Backend for CP-SAT: exact integer arithmetic, clause learning, parallel searches.

    All columns must be integer and bounded. Rows and costs must become integer by scaling with a
    power of ten or another integer. A coefficient is read as the decimal number that prints it, so 0.1
    is one tenth.
    """

    name = "cp-sat"
    features = CALLED_BACK | {Feature.THREADS}
    requires = ("ortools",)
    extra = "ortools"
    # See Highs: ortools and highspy exclude one another.
    conflict_group = "highs"
    natives = ORTOOLS_MARKS
    summary = "OR-Tools CP-SAT: exact, for all-integer programs"

    def refuses(self, problem: MixedIntegerProgram) -> str:
        """Return a message with a continuous column, empty if all columns are integer."""
        fractional = np.flatnonzero(~problem.integral)
        if not fractional.size:
            return ""
        name = problem.column_name(int(fractional[0]))
        return f"backend 'cp-sat' accepts integer columns only: {name} is continuous"

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with CP-SAT."""
        reason = self.refuses(program)
        if reason:
            raise UnsupportedFormulation(reason)
        integral = _to_integers(program)
        empty = np.flatnonzero(integral.lower > integral.upper)
        if empty.size:
            name = program.column_name(int(empty[0]))
            message = f"{name}: no integer is within the bounds"
            return Ending(Ended.INFEASIBLE, message=message, absolute=True)
        from ortools.sat.python import cp_model

        model, columns = _model(cp_model, integral, request)
        solver = cp_model.CpSolver()
        _configure(solver, request)
        incumbents = Incumbents(program, request)

        class Listener(cp_model.CpSolverSolutionCallback):
            def on_solution_callback(self) -> None:
                incumbents.report(np.array([self.value(column) for column in columns], float))

        def prove(bound: float) -> None:
            incumbents.prove(bound / integral.scale)

        solver.best_bound_callback = prove
        clock.lap("build")
        left = clock.left()
        if left is not None:
            solver.parameters.max_time_in_seconds = left
        with forward_stop(request.control, solver.stop_search):
            status = solver.solve(model, Listener())
        clock.lap("solve")
        return _ending(cp_model, solver, status, columns, integral, model, request)


@dataclass(frozen=True)
class _Integral:
    """Program with integer coefficients: the objective is ``(cost @ x + offset) / scale``."""

    cost: list[int]
    offset: float
    scale: int
    rows: list[tuple[list[int], list[int], int, int]]
    lower: np.ndarray[Any, np.dtype[np.int64]]
    upper: np.ndarray[Any, np.dtype[np.int64]]


def _to_integers(program: MixedIntegerProgram) -> _Integral:
    """Return a program of integer columns with integer coefficients, or raise an error."""
    size = np.maximum(np.abs(program.column_lower), np.abs(program.column_upper))
    unbounded = np.flatnonzero(size >= 2**53)
    if unbounded.size:
        index_of_column = int(unbounded[0])
        raise UnsupportedFormulation(
            f"backend 'cp-sat' needs bounds on every column: {program.column_name(index_of_column)} lies in "
            f"[{program.column_lower[index_of_column]:g}, {program.column_upper[index_of_column]:g}]"
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
        factors, factor = _scaled(
            value[part], [reach[c] for c in index[part]], lambda row=row: program.row_name(row)
        )
        largest = sum(abs(f) * reach[c] for f, c in zip(factors, index[part], strict=True))
        rows.append(
            (index[part], factors, _up(low, factor, -largest), -_up(-high, factor, -largest))
        )
    return _Integral(
        cost,
        program.offset * scale,
        scale,
        rows,
        np.ceil(program.column_lower - ROUNDING).astype(np.int64),
        np.floor(program.column_upper + ROUNDING).astype(np.int64),
    )


def _scaled(values: list[float], reach: Iterable[int], what: Any) -> tuple[list[int], int]:
    """Return `values` multiplied by the smallest factor that makes them integer, and the factor."""
    if all(value.is_integer() for value in values):
        integers, factor = [int(value) for value in values], 1
    else:
        exact = [Fraction(repr(value)) for value in values]
        factor = math.lcm(*(value.denominator for value in exact))
        integers = [int(value * factor) for value in exact]
    largest = sum(abs(value) * size for value, size in zip(integers, reach, strict=True))
    if max(largest, factor) >= LARGEST:
        raise UnsupportedFormulation(
            "backend 'cp-sat' accepts coefficients that scale to 64-bit integers: "
            f"those of {what() if callable(what) else what} do not"
        )
    return integers, factor


def _up(bound: float, factor: int, least: int) -> int:
    """Return the smallest integer that a scaled lower bound admits, at least `least` - 1.

    With the signs of bound, `least` and result changed, this is the largest integer of an upper bound.
    """
    if bound == -math.inf:
        return least - 1
    exact = Fraction(repr(bound)) * factor
    return max(math.ceil(exact - _rounding(exact)), least - 1)


def _rounding(value: Fraction) -> Fraction:
    return Fraction(ROUNDING) * max(Fraction(1), abs(value))


def _model(cp_model: Any, integral: _Integral, request: Request) -> tuple[Any, list[Any]]:
    model = cp_model.CpModel()
    columns = [
        model.new_int_var(low, high, "")
        for low, high in zip(integral.lower.tolist(), integral.upper.tolist(), strict=True)
    ]

    def total(index: Iterable[int], factors: Iterable[int]) -> Any:
        return cp_model.LinearExpr.weighted_sum([columns[c] for c in index], list(factors))

    for index, factors, low, high in integral.rows:
        if low > high:
            # No integer satisfies the row, so a false clause makes the model infeasible.
            model.add_bool_or([])
        elif index:
            model.add_linear_constraint(total(index, factors), low, high)
    used = [c for c, factor in enumerate(integral.cost) if factor]
    objective = total(used, [integral.cost[c] for c in used])
    if used:
        model.minimize(objective)
        model.proto.objective.offset = integral.offset
    if request.cutoff is not None and used:
        largest = math.floor(loosened_cutoff(request.cutoff) * integral.scale - integral.offset)
        smallest = -LARGEST
        model.add_linear_constraint(objective, smallest, max(largest, smallest))
    if request.warm_start is not None:
        values = np.round(np.asarray(request.warm_start, float)).astype(np.int64).tolist()
        for column, value in zip(columns, values, strict=True):
            model.add_hint(column, value)
    return model, columns


def _configure(solver: Any, request: Request) -> None:
    parameters = solver.parameters
    # In scaled units, where the lower bound of 1 on the gap's denominator in CP-SAT has no effect.
    parameters.relative_gap_limit = request.gap
    parameters.absolute_gap_limit = 0.0
    parameters.catch_sigint_signal = False
    parameters.log_search_progress = request.verbose
    if request.seed is not None:
        parameters.random_seed = request.seed % (2**31)
    if request.threads is not None:
        parameters.num_workers = request.threads


def _ending(
    cp_model: Any,
    solver: Any,
    status: Any,
    columns: list[Any],
    integral: _Integral,
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
    bound = integral.offset / integral.scale
    if any(integral.cost):
        bound = solver.best_objective_bound / integral.scale
    return Ending(
        ended,
        point,
        bound if ended in (Ended.PROVEN, Ended.STOPPED) else None,
        limit=stop_reason(request.control, Limit.TIME) if ended is Ended.STOPPED else None,
        statistics={"branches": int(solver.num_branches), "conflicts": int(solver.num_conflicts)},
        message=message,
    )
