"""Making an approximate optimum exact: guess what binds, and solve the equations that then hold.

Interior points and first-order methods end close to an optimum. Close enough to tell which rows
and bounds bind, and then the optimum solves one symmetric linear system (the idea of the "polish" of
Stellato et al., "OSQP: an operator splitting solver for quadratic programs", 2020, section 4). A
wrong guess is mended as in the primal-dual active-set method of Hintermüller, Ito and Kunisch (2002).
Nothing is believed: the answer is kept only where its recomputed residuals are better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.linear import QuadraticProgram
from .quality import Quality, measured

__all__ = ["polished"]

Vector = NDArray[np.float64]
Signs = NDArray[np.int8]

#: Merit at which a second guess is not worth its time.
ENOUGH = 1e-9
#: Distance from a bound, relative to the point, that counts as touching it.
TOUCHED = 1e-7
#: Systems solved at most, each with a mended guess.
ROUNDS = 12
#: Steps of refinement at most for one system.
STEPS = 12
#: Regularisation of the equilibrated system, which refinement takes out again.
REGULARISATION = 1e-8
#: Entries of the system, above which its factors may need more time than the solver did.
LARGEST = 5_000_000


def _never() -> bool:
    return False


def polished(
    program: QuadraticProgram, start: Quality, over: Callable[[], bool] = _never
) -> Quality:
    """Return what is better: `start`, or the optimum of what seems to bind there.

    Parameters
    ----------
    program : QuadraticProgram
        What is asked.
    start : Quality
        An approximate optimum.
    over : callable, optional
        Asked between two systems whether time is up.
    """
    if 2 * program.matrix.nnz + program.hessian.nnz > LARGEST:
        return start
    best, seen = start, set[bytes]()
    # Active-set methods that fail leave a good point with bad multipliers: then what is touched
    # says more.
    for first in (_Binding.guess, _Binding.touched):
        guess = first(program, start)
        for _ in range(ROUNDS):
            key = guess.key()
            if best.clean or key in seen or over():
                break
            seen.add(key)
            found = _solve(program, guess, best)
            quality = None if found is None else measured(program, *found)
            if found is None or quality is None:
                break
            if quality.merit < best.merit:
                best = replace(quality, polished=True)
            guess = guess.mended(program, *found)
        if best.merit <= ENOUGH:
            break
    return best


@dataclass(frozen=True, eq=False)
class _Binding:
    """Which rows and columns bind: -1 at the lower bound, 1 at the upper, 0 at neither.

    Equal rows and fixed columns always bind, at 1.
    """

    rows: Signs
    columns: Signs

    def key(self) -> bytes:
        return self.rows.tobytes() + self.columns.tobytes()

    @classmethod
    def guess(cls, program: QuadraticProgram, at: Quality) -> _Binding:
        """Return what binds where a multiplier outweighs the distance to its bound.

        Both are measured in the units of their row and of the whole, for a row may be scaled at will.
        """
        x, y = at.point, at.duals
        magnitude = abs(program.matrix)
        row = np.maximum(magnitude.max(axis=1).toarray().ravel(), 1e-300) if y.size else y
        reach = max(1.0, float(np.abs(x).max(initial=0.0)))
        force = max(
            1e-300,
            float(np.abs(program.cost).max(initial=0.0)),
            float(np.abs(program.hessian @ x).max(initial=0.0)),
        )
        value = program.matrix @ x
        return cls(
            _binding(
                (value - program.row_lower) / (row * reach),
                (program.row_upper - value) / (row * reach),
                y * row / force,
                program.row_lower == program.row_upper,
            ),
            _binding(
                (x - program.column_lower) / reach,
                (program.column_upper - x) / reach,
                program.reduced_costs(x, y) / force,
                program.column_lower == program.column_upper,
            ),
        )

    @classmethod
    def touched(cls, program: QuadraticProgram, at: Quality) -> _Binding:
        """Return what the point touches, whatever the multipliers say."""
        x = at.point
        reach = TOUCHED * max(1.0, float(np.abs(x).max(initial=0.0)))
        row = reach * abs(program.matrix).max(axis=1).toarray().ravel() if at.duals.size else 0.0
        value = program.matrix @ x
        rows = np.zeros(at.duals.size, np.int8)
        rows[value - program.row_lower <= row] = -1
        rows[program.row_upper - value <= row] = 1
        columns = np.zeros(x.size, np.int8)
        columns[x - program.column_lower <= reach] = -1
        columns[program.column_upper - x <= reach] = 1
        return cls(rows, columns)

    def mended(self, program: QuadraticProgram, x: Vector, y: Vector) -> _Binding:
        """Return the guess with what is violated, without what pulls the wrong way."""
        value, reduced = program.matrix @ x, program.reduced_costs(x, y)
        scale = 1e-12 * max(1.0, float(np.abs(x).max(initial=0.0)))
        return _Binding(
            _mended(
                self.rows,
                value,
                program.row_lower,
                program.row_upper,
                y,
                1e-12 * np.maximum(1.0, abs(program.matrix) @ np.abs(x)),
            ),
            _mended(
                self.columns,
                x,
                program.column_lower,
                program.column_upper,
                reduced,
                np.full(x.size, scale),
            ),
        )


def _binding(below: Vector, above: Vector, pull: Vector, equal: NDArray[np.bool_]) -> Signs:
    signs = np.zeros(pull.size, np.int8)
    signs[pull > np.maximum(below, 0.0)] = -1
    signs[-pull > np.maximum(above, 0.0)] = 1
    signs[equal] = 1
    return signs


def _mended(
    signs: Signs, value: Vector, low: Vector, high: Vector, pull: Vector, slack: Vector
) -> Signs:
    new = signs.copy()
    new[(signs < 0) & (pull < 0)] = 0
    new[(signs > 0) & (pull > 0)] = 0
    new[(signs == 0) & (value < low - slack)] = -1
    new[(signs == 0) & (value > high + slack)] = 1
    new[low == high] = 1
    return new


def _solve(
    program: QuadraticProgram, binding: _Binding, start: Quality
) -> tuple[Vector, Vector] | None:
    """Return the point and multipliers at which `binding` binds, the nearest to `start`."""
    free = np.flatnonzero(binding.columns == 0)
    rows = np.flatnonzero(binding.rows)
    x, y = start.point.copy(), np.zeros(program.row_count)
    held = binding.columns
    x[held < 0] = program.column_lower[held < 0]
    x[held > 0] = program.column_upper[held > 0]
    y[rows] = start.duals[rows]
    size = free.size + rows.size
    if not size:
        return x, y
    right = np.where(binding.rows < 0, program.row_lower, program.row_upper)[rows]
    hessian, matrix = program.hessian[free], program.matrix[rows]
    inner = sp.csr_array(matrix[:, free])
    system = sp.csc_array(
        sp.block_array([[hessian[:, free], inner.T], [inner, None]])
        if rows.size
        else hessian[:, free]
    )
    # What is solved for are steps, (x, -y), from where we stand: a singular system then takes
    # the nearest of its solutions, and rounding in large known parts does no harm.
    scale = _equilibrated(system)
    signs = np.concatenate([np.full(free.size, 1.0), np.full(rows.size, -1.0)])
    regular = sp.csc_array(
        sp.diags_array(scale) @ system @ sp.diags_array(scale)
        + sp.diags_array(REGULARISATION * signs)
    )
    from scipy.sparse.linalg import splu

    try:
        # A quasidefinite matrix needs no pivoting but for size, so that order may follow sparsity.
        factors = splu(
            regular,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    best, least = None, np.inf
    for _ in range(STEPS):
        residual = np.concatenate(
            [
                matrix.T[free] @ y[rows] - hessian @ x - program.cost[free],
                right - matrix @ x,
            ]
        )
        scaled = residual * scale
        worst = float(np.abs(scaled).max())
        if not worst < least * 0.9:
            if worst < least:
                best = x.copy(), y.copy()
            break
        best, least = (x.copy(), y.copy()), worst
        if worst == 0.0:
            break
        step = scale * factors.solve(scaled)
        x[free] += step[: free.size]
        y[rows] -= step[free.size :]
    return best


def _equilibrated(system: sp.csc_array) -> Vector:
    """Return the scaling of rows and columns alike that makes their largest entries about 1."""
    magnitude = abs(sp.csr_array(system))
    scale: Vector = np.ones(system.shape[0])
    for _ in range(6):
        scaled = magnitude.multiply(scale[:, None]).multiply(scale[None, :])
        largest = sp.csr_array(scaled).max(axis=1).toarray().ravel()
        scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
    return scale
