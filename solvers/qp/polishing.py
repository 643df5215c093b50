"""Polishing of an approximate optimum: guess the active set, and solve its equations.

Interior-point and first-order methods end close to an optimum. If the point shows which rows and
bounds bind, the optimum solves one symmetric linear system (the "polish" of Stellato et al., "OSQP: an
operator splitting solver for quadratic programs", 2020, section 4). A wrong guess is corrected as in
the primal-dual active-set method of Hintermüller, Ito and Kunisch (2002). The result is kept only if
its recomputed residuals are smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.base import row_maxima
from ...models.programs.linear import QuadraticProgram
from .quality import Quality, measured

__all__ = ["polished"]

Vector = NDArray[np.float64]
#: Active set: -1 at the lower bound, 1 at the upper, 0 at neither, for rows and then columns. Equality
#: rows and fixed columns are always active, with 1.
Signs = NDArray[np.int8]

#: Merit below which no further guess is made.
ENOUGH = 1e-9
#: Largest distance from a bound, relative to the point, at which the bound is active.
TOUCHED = 1e-7
#: Largest number of linear systems, each with a corrected guess.
ROUNDS = 12
#: Largest number of refinement steps per system.
STEPS = 12
#: Regularisation of the equilibrated system, which refinement removes.
REGULARISATION = 1e-8
#: Number of entries above which factorising the system may take longer than the solver did.
LARGEST = 5_000_000
#: Number of entries above which an optimum that is accurate by a wide margin is not polished. With 130,000
#: entries, polishing took as long as the solver.
LARGE = 100_000
#: That margin: the largest violation, and the largest gap relative to the terms of the objective.
ACCURATE = 1e-8


def polished(
    program: QuadraticProgram, start: Quality, over: Callable[[], bool] = lambda: False
) -> Quality:
    """Return the better of `start` and the optimum of the active set at `start`.

    `over` returns True if the time is up, and is called between two systems.
    """
    entries = 2 * program.matrix.nnz + program.hessian.nnz
    accurate = max(start.violation, start.apart / max(1e-3, start.terms)) <= ACCURATE
    if entries > LARGEST or (entries > LARGE and accurate):
        return start
    best, seen = start, set[bytes]()
    # Active-set methods that fail leave a good point with wrong multipliers. Then the distances
    # to the bounds are the better guess.
    for first in (_guess, _touched):
        guess = first(program, start)
        for _ in range(ROUNDS):
            key = guess.tobytes()
            if best.clean or key in seen or over():
                break
            seen.add(key)
            solution = _solve(program, guess, best)
            quality = None if solution is None else measured(program, *solution)
            if solution is None or quality is None:
                break
            if quality.merit < best.merit:
                best = replace(quality, polished=True)
            guess = _corrected(program, guess, *solution)
        if best.merit <= ENOUGH:
            break
    return best


@dataclass(frozen=True, eq=False)
class _Stack:
    """Rows and then columns at a point: values, bounds, and multipliers."""

    value: Vector
    low: Vector
    high: Vector
    pull: Vector

    @classmethod
    def of(cls, program: QuadraticProgram, x: Vector, y: Vector) -> _Stack:
        return cls(
            np.concatenate([program.matrix @ x, x]),
            np.concatenate([program.row_lower, program.column_lower]),
            np.concatenate([program.row_upper, program.column_upper]),
            np.concatenate([y, program.reduced_costs(x, y)]),
        )


def _units(program: QuadraticProgram, at: Quality) -> tuple[Vector, float]:
    """Return the largest coefficient of each row, 1 for each column, and the size of the point."""
    unit = np.ones(program.row_count + program.size)
    unit[: program.row_count] = np.maximum(row_maxima(program.matrix), 1e-300)
    return unit, max(1.0, float(np.abs(at.point).max(initial=0.0)))


def _guess(program: QuadraticProgram, at: Quality) -> Signs:
    """Return the active set of bounds whose multiplier outweighs the distance to them.

    Both are measured in the units of the row and of the whole, because a row may have any scale.
    """
    unit, reach = _units(program, at)
    force = max(
        1e-300,
        float(np.abs(program.cost).max(initial=0.0)),
        float(np.abs(program.hessian @ at.point).max(initial=0.0)),
    )
    stack = _Stack.of(program, at.point, at.duals)
    pull, size = stack.pull * unit / force, unit * reach
    signs = np.zeros(pull.size, np.int8)
    signs[pull > np.maximum((stack.value - stack.low) / size, 0.0)] = -1
    signs[-pull > np.maximum((stack.high - stack.value) / size, 0.0)] = 1
    signs[stack.low == stack.high] = 1
    return signs


def _touched(program: QuadraticProgram, at: Quality) -> Signs:
    """Return the active set of bounds that the point touches, regardless of the multipliers."""
    unit, reach = _units(program, at)
    stack = _Stack.of(program, at.point, at.duals)
    signs = np.zeros(unit.size, np.int8)
    signs[stack.value - stack.low <= TOUCHED * reach * unit] = -1
    signs[stack.high - stack.value <= TOUCHED * reach * unit] = 1
    return signs


def _corrected(program: QuadraticProgram, signs: Signs, x: Vector, y: Vector) -> Signs:
    """Return the guess plus violated bounds, without bounds whose multiplier has the wrong sign."""
    stack = _Stack.of(program, x, y)
    sizes = [abs(program.matrix) @ np.abs(x), np.full(x.size, np.abs(x).max(initial=0.0))]
    slack = 1e-12 * np.maximum(1.0, np.concatenate(sizes))
    new = signs.copy()
    new[(signs < 0) & (stack.pull < 0)] = 0
    new[(signs > 0) & (stack.pull > 0)] = 0
    new[(signs == 0) & (stack.value < stack.low - slack)] = -1
    new[(signs == 0) & (stack.value > stack.high + slack)] = 1
    new[stack.low == stack.high] = 1
    return new


def _solve(program: QuadraticProgram, signs: Signs, start: Quality) -> tuple[Vector, Vector] | None:
    """Return the point and multipliers that solve the equations of `signs`, nearest to `start`."""
    of_rows, of_columns = np.split(signs, [program.row_count])
    free, rows = np.flatnonzero(of_columns == 0), np.flatnonzero(of_rows)
    x, y = start.point.copy(), np.zeros(program.row_count)
    x[of_columns < 0] = program.column_lower[of_columns < 0]
    x[of_columns > 0] = program.column_upper[of_columns > 0]
    y[rows] = start.duals[rows]
    size = free.size + rows.size
    if not size:
        return x, y
    right = np.where(of_rows < 0, program.row_lower, program.row_upper)[rows]
    hessian, matrix = program.hessian[free], program.matrix[rows]
    inner = sp.csr_array(matrix[:, free])
    system = sp.csc_array(
        sp.block_array([[hessian[:, free], inner.T], [inner, None]])
        if rows.size
        else hessian[:, free]
    )
    # The unknowns are steps (x, -y) from the current point. Then a singular system has its nearest
    # solution, and rounding of large known parts does no harm.
    scale = _equilibrated(system)
    sides = np.concatenate([np.full(free.size, 1.0), np.full(rows.size, -1.0)])
    regular = sp.csc_array(
        sp.diags_array(scale) @ system @ sp.diags_array(scale)
        + sp.diags_array(REGULARISATION * sides)
    )
    from scipy.sparse.linalg import splu

    try:
        # A quasidefinite matrix needs little pivoting, so that the order can follow the sparsity.
        factors = splu(
            regular,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    best, smallest = None, np.inf
    for _ in range(STEPS):
        residual = np.concatenate(
            [
                matrix.T[free] @ y[rows] - hessian @ x - program.cost[free],
                right - matrix @ x,
            ]
        )
        scaled = residual * scale
        worst = float(np.abs(scaled).max())
        if not worst < smallest * 0.9:
            if worst < smallest:
                best = x.copy(), y.copy()
            break
        best, smallest = (x.copy(), y.copy()), worst
        if worst == 0.0:
            break
        step = scale * factors.solve(scaled)
        x[free] += step[: free.size]
        y[rows] -= step[free.size :]
    return best


def _equilibrated(system: sp.csc_array) -> Vector:
    """Return the symmetric scaling of rows and columns that makes their largest entries about 1."""
    scaled, scale = sp.csr_array(system), np.ones(system.shape[0])
    magnitude, row = np.abs(scaled.data), np.repeat(np.arange(scale.size), np.diff(scaled.indptr))
    for _ in range(6):
        scaled.data = magnitude * scale[row] * scale[scaled.indices]
        largest = row_maxima(scaled)
        scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
    return scale
