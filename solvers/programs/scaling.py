"""Scaling of linear and quadratic programs whose data differ from 1 by orders of magnitude.

The tolerances of solvers are absolute. They ignore thresholds of 1e-9, and claimed programs with data
of 1e9 infeasible. Rows, continuous columns and the objective are scaled by powers of two, which are
exact, with one factor per block. Magnitudes within :data:`PLAIN` are not scaled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.base import row_maxima
from ...models.programs.blocks import Block
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ...models.verification import ROUNDING
from ..contract.backend import Answer, Request

__all__ = ["PLAIN", "Scaling", "common"]

Vector = NDArray[np.float64]

#: Range of magnitudes that solvers handle without scaling.
PLAIN = (1e-1, 1e8)


@dataclass(frozen=True)
class Scaling:
    """A program in scaled units, and the factors of the scaling, powers of two.

    `program` has the variables ``x / columns``, its rows times `rows` and its objective divided by `unit`.
    """

    program: MixedIntegerProgram | QuadraticProgram
    columns: Vector
    rows: Vector
    unit: float

    @classmethod
    def of(cls, program: MixedIntegerProgram | QuadraticProgram) -> Scaling | None:
        """Return the scaling of `program`; None if its data need none, or range beyond that of floats."""
        integral = program.integer_columns
        entries = abs(program.matrix)
        bounds = _largest(program.row_lower, program.row_upper)
        # Magnitude of the right-hand side for the continuous columns of each row.
        constants = bounds
        if integral.any() and entries.nnz:
            whole = entries @ sp.diags_array(integral.astype(float))
            constants = np.maximum(bounds, row_maxima(whole))
        # Bounds that are only rounding errors of 0 have no magnitude.
        constants[constants <= ROUNDING * constants.max(initial=0.0)] = 0.0
        row = np.repeat(np.arange(program.row_count), np.diff(entries.indptr))
        is_scaled = constants[row] > 0
        bounds_of_columns = _largest(program.column_lower, program.column_upper)
        sizes = constants[row[is_scaled]] / entries.data[is_scaled]
        magnitudes = np.concatenate([sizes, bounds_of_columns[bounds_of_columns > 0]])
        place = np.concatenate([entries.indices[is_scaled], np.flatnonzero(bounds_of_columns)])
        columns = np.ones(program.size)
        for block in program._columns:
            here = (place >= block.start) & (place < block.start + block.size)
            if not integral[block.slice].any() and here.any():
                columns[block.slice] = common(float(np.median(magnitudes[here])))
        plain = (columns == 1.0).all()
        sized = entries if plain else entries @ sp.diags_array(columns)
        largest = row_maxima(sized)
        rows = _by_block(program._rows, 1.0 / np.where(largest > 0, largest, 1.0), largest > 0)
        costs = np.abs(program.cost) * columns
        hessian = getattr(program, "hessian", None)
        if hessian is not None:
            if not plain:
                hessian = sp.diags_array(columns) @ hessian @ sp.diags_array(columns)
            costs = np.maximum(costs, np.abs(hessian.diagonal()))
        unit = common(float(costs.max(initial=0.0)) or 1.0)
        if plain and (rows == 1.0).all() and unit == 1.0:
            return None
        changed: dict[str, Any] = {} if hessian is None else {"hessian": hessian / unit}
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            changed |= {
                "cost": program.cost * columns / unit,
                "offset": program.offset / unit,
                "matrix": sp.diags_array(rows) @ program.matrix @ sp.diags_array(columns),
                "row_lower": program.row_lower * rows,
                "row_upper": program.row_upper * rows,
                "column_lower": program.column_lower / columns,
                "column_upper": program.column_upper / columns,
            }
        if not all(_is_intact(getattr(program, name), value) for name, value in changed.items()):
            return None
        return cls(replace(program, **changed), columns, rows, unit)

    @classmethod
    def of_objective(cls, program: Any) -> Scaling | None:
        """Return the scaling of the objective of a conic program; None if it needs none."""
        # Objectives have the size of their constant if the quadratic part can change them by as much. A
        # constant alone, or nearly linear columns, would hide or enlarge the part of the columns.
        curvature = program.hessian.diagonal()
        curved, cost = curvature > 0, np.abs(program.cost)
        # No step of more than 1 counts: the minimum of a column of little curvature is far away.
        step = np.minimum(cost[curved] / curvature[curved], 1.0)
        change = (cost[curved] * step).max(initial=0.0)
        units = [common(abs(float(size)) or 1.0) for size in (program.offset, change)]
        if curved.any() and not (program.offset or cost.any()):
            # The constraints alone keep the optimum from 0. The smallest curvature limits a unit above 1,
            # which would hide columns of little curvature.
            sizes = curvature[curved]
            units = [_power_of_two(float(sizes.min())), _power_of_two(float(sizes.max()))]
        unit = min(units) if min(units) > 1.0 else min(1.0, max(units))
        if unit == 1.0:
            return None
        scaled = replace(
            program, cost=program.cost / unit, hessian=program.hessian / unit,
            offset=program.offset / unit,
        )  # fmt: skip
        return cls(scaled, np.ones(1), np.ones(1), unit)

    def answered(self, request: Request, run: Callable[[Any, Request], Answer]) -> Answer:
        """Run a backend on the scaled program and return its answer in the given units.

        The control of `request` receives incumbents and bounds in given units.
        """

        def report(objective: float, point: Any) -> None:
            request.control.incumbent(objective * self.unit, np.asarray(point) * self.columns)

        def proven(bound: float) -> None:
            request.control.prove(bound * self.unit)

        warm, cutoff = request.warm_start, request.cutoff
        with request.control.stage(request.time_limit, report, proven) as control:
            scaled = replace(
                request,
                control=control,
                warm_start=None if warm is None else np.asarray(warm, float) / self.columns,
                cutoff=None if cutoff is None else cutoff / self.unit,
            )
            return self.answer(run(self.program, scaled))

    def answer(self, answer: Answer) -> Answer:
        """Return `answer` in the given units."""
        primal, dual, duals = answer.primal_bound, answer.dual_bound, answer.duals
        return replace(
            answer,
            point=None if answer.point is None else answer.point * self.columns,
            primal_bound=None if primal is None else primal * self.unit,
            dual_bound=None if dual is None else dual * self.unit,
            duals=None if duals is None else duals * self.rows * self.unit,
        )


def _largest(lower: Vector, upper: Vector) -> Vector:
    """Return the larger magnitude of two bounds, 0 for infinite ones."""
    bounds = np.abs([lower, upper])
    largest: Vector = np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0)
    return largest


def _is_intact(before: Any, after: Any) -> bool:
    """Return True if no number of the data became infinite or 0."""
    if sp.issparse(before):
        return after.count_nonzero() == before.nnz and bool(np.isfinite(after.data).all())
    same = (np.isfinite(before) == np.isfinite(after)) & ((before == 0) == (after == 0))
    return bool(np.all(same))


def _by_block(blocks: Iterable[Block], factors: Vector, counts: NDArray[np.bool_]) -> Vector:
    """Return one power of two per block: the median of the given factors, over the selected rows."""
    powers = np.ones(factors.size)
    for block in blocks:
        chosen = factors[block.slice][counts[block.slice]]
        if chosen.size:
            powers[block.slice] = 1.0 / common(1.0 / float(np.median(chosen)))
    return powers


def common(magnitude: float) -> float:
    """Return 1 for a magnitude within :data:`PLAIN`, else the nearest power of two."""
    if PLAIN[0] <= magnitude <= PLAIN[1]:
        return 1.0
    return _power_of_two(magnitude)


def _power_of_two(magnitude: float) -> float:
    """Return the power of two nearest to a positive magnitude."""
    return float(2.0 ** np.clip(np.round(np.log2(magnitude)), -1000, 1000))
