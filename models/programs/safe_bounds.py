"""Lower bounds that hold in spite of all rounding errors, from multipliers in floating point.

The method is that of Neumaier and Shcherbina, "Safe bounds in linear and mixed-integer linear
programming" (Mathematical Programming 99, 2004), with the arithmetic of :mod:`.intervals`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .base import RowProgram
from .intervals import ROUNDOFF, SLACK, TINY, Interval, difference, smallest, sums, total
from .linear import MixedIntegerProgram, QuadraticProgram

__all__ = ["safe_bound"]

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Attempts to move reduced costs to the required side of 0, and those of a quick call.
ATTEMPTS, QUICK_ATTEMPTS = 3, 2
#: First distance of a reduced cost from 0, in units of its error bound, and the growth per attempt.
DISTANCE, GROWTH = 8.0, 32.0
#: Largest relative change of all multipliers.
NEAR = 1e-9
#: Loss by implied bounds above which reduced costs are moved, relative to the bound.
LOSS = 1e-10
#: Largest number of free columns whose multipliers are corrected with a dense inverse.
LARGEST_CORRECTION = 300
#: Largest number of operations of a dense factorisation: about 5 ms if quick, else 0.2 s.
QUICK, THOROUGH = 4e6, 2e8
#: Iterations of the least-squares solver for larger systems.
ITERATIONS = 50


def safe_bound(
    program: MixedIntegerProgram | QuadraticProgram,
    duals: Vector,
    point: Vector | None = None,
    *,
    quick: bool = False,
) -> float:
    """Return a lower bound on the objective that holds in spite of all rounding errors.

    The bound is that of the continuous relaxation. It is as good as the multipliers: those of an optimal solution
    give the optimum up to rounding, and any vector gives a valid bound. ``duals[i] >= 0`` belongs to the lower
    bound of row i, ``<= 0`` to the upper bound. The bound of a column that has no bound on the side of its
    reduced cost is taken from the rows. If that costs too much, the multipliers are moved until the reduced cost
    has the other sign. Columns without any bound need a reduced cost of exactly 0: the multipliers of as many
    rows are enclosed in intervals that contain such multipliers. `quick` solves larger systems by a few
    iterations instead of a dense factorisation. The result is -inf if a reduced cost cannot be shown to have the
    required sign, or if the arrays have another shape or are not finite.

    For a quadratic program the objective is first replaced by its tangent at `point`, by default 0, which is
    below the objective if the Hessian is positive semidefinite. If that is not proven, for example because the
    Hessian was rounded, the largest possible negative curvature is subtracted, which needs bounds of the columns.
    """
    y = np.array(duals, float)
    p = np.zeros(program.size) if point is None else np.asarray(point, float)
    if y.shape != (program.row_count,) or p.shape != (program.size,):
        return -math.inf
    if not (np.isfinite(y).all() and np.isfinite(p).all()):
        return -math.inf
    with np.errstate(all="ignore"):
        lagrangian = _Lagrangian.of(program, p, QUICK if quick else THOROUGH)
        return lagrangian.bound(program.signed(y))


@dataclass(frozen=True, eq=False)
class _Lagrangian:
    """Linear function below the objective, and the bounds that multipliers of the rows give for it.

    `cost` are intervals, and `constant` is a lower bound. The objective is above the linear function by at least
    ``curvature @ (x - point)**2 / 2``. `effort` is the largest number of operations of a dense factorisation.
    """

    program: RowProgram
    cost: Interval
    constant: float
    point: Vector
    curvature: Vector
    effort: float

    @classmethod
    def of(
        cls, program: MixedIntegerProgram | QuadraticProgram, p: Vector, effort: float
    ) -> _Lagrangian:
        """Return the tangent at `p`: the costs ``H p + c`` and the constant ``offset - p H p / 2``."""
        cost, flat = program.cost, np.zeros(program.size)
        if isinstance(program, MixedIntegerProgram) or not program.hessian.nnz:
            return cls(program, Interval(cost, cost), program.offset, p, flat, effort)
        hessian = program.hessian
        bent, error = sums(hessian, p)
        if (hessian != hessian.T).nnz:  # x H x contains the symmetric part only
            other, more = sums(hessian.T, p)
            bent = 0.5 * (bent + other)
            error = np.maximum(error, more) + ROUNDOFF * np.abs(bent) + TINY
        products = 0.5 * p * bent
        spread = 0.5 * float(np.abs(p) @ error) + 2 * ROUNDOFF * float(np.abs(products).sum())
        spread = SLACK * spread + p.size * TINY
        constant = total(np.concatenate([[program.offset, -spread], -products]))
        curvature = program._least_curvature
        return cls(program, difference(cost, -bent, error), constant, p, curvature, effort)

    def bound(self, y: Vector) -> float:
        """Return the best bound of `y` itself and of multipliers near `y`."""
        program = self.program
        limits = Interval(program.column_lower, program.column_upper)
        multipliers = Interval(y, y)
        reduced = _reduced(program, self.cost, multipliers)
        trial = self.value(multipliers, reduced, limits)
        weak = np.isneginf(trial.columns)
        if not weak.any():
            return trial.bound
        implied = _implied(program, limits, weak)
        trial = self.value(multipliers, reduced, implied)
        best = trial.bound
        if np.isneginf(trial.columns[self.curvature < 0]).any():
            return best
        for attempt in range(-1, QUICK_ATTEMPTS if self.effort == QUICK else ATTEMPTS):
            close = LOSS * max(1.0, abs(best))
            if math.isfinite(best) and self.loss(trial, weak) <= close:
                # Scaling the multipliers loses in the rows, too.
                if attempt != 0 or program.objective(self.point) - best <= close:
                    break
            moved = self.moved(y, weak, implied, attempt)
            if moved is None:
                continue
            free = np.flatnonzero(weak & ~np.isfinite(implied.low) & ~np.isfinite(implied.high))
            multipliers = Interval(moved, moved)
            if free.size:
                enclosed = _corrected(program, self.cost, moved, free, self.effort)
                if enclosed is None:
                    break
                multipliers = enclosed
            reduced = _reduced(program, self.cost, multipliers)
            reduced.low[free] = reduced.high[free] = 0.0
            trial = self.value(multipliers, reduced, implied)
            best = max(best, trial.bound)
            if attempt >= 0:
                weak |= np.isneginf(smallest(reduced, limits))
        return best

    def loss(self, value: _Value, columns: Mask) -> float:
        """Return how far the terms of `columns` are below those at the point."""
        terms = value.columns[columns]
        lost = np.abs(terms - value.reduced.high[columns] * self.point[columns]).sum()
        return float(np.where(np.isnan(lost), np.inf, lost))

    def value(self, multipliers: Interval, reduced: Interval, limits: Interval) -> _Value:
        """Return the bound of intervals of multipliers and reduced costs within bounds of columns."""
        program = self.program
        rows = smallest(multipliers, Interval(program.row_lower, program.row_upper))
        columns = smallest(reduced, limits)
        curved = self.curvature > 0
        if curved.any():
            # The minimum of r x + D (x - p)^2 / 2 is r p - r^2 / (2 D).
            part = Interval(reduced.low[curved], reduced.high[curved])
            at = self.point[curved]
            steepest = np.maximum(np.abs(part.low), np.abs(part.high))
            fall = 0.5 * SLACK * steepest * (steepest / self.curvature[curved]) + TINY
            lowest = np.nextafter(smallest(part, Interval(at, at)) - fall, -np.inf)
            columns[curved] = np.fmax(columns[curved], lowest)
        concave = self.curvature < 0
        if concave.any():
            at, low, high = self.point[concave], limits.low[concave], limits.high[concave]
            distance = SLACK * np.maximum(np.abs(low - at), np.abs(high - at))
            loss = 0.5 * SLACK * distance * (distance * -self.curvature[concave]) + TINY
            columns[concave] = np.nextafter(columns[concave] - loss, -np.inf)
        bound = total(np.concatenate([[self.constant], rows, columns]))
        return _Value(bound, reduced, columns)

    def moved(self, y: Vector, weak: Mask, implied: Interval, attempt: int) -> Vector | None:
        """Return multipliers whose reduced costs on the columns `weak` have the required signs.

        The attempt -1 takes a tenth of the time of the others, and is None if its simple changes do not suffice.
        """
        # The change solves a least-squares problem in units of the required distances from 0. Only
        # multipliers that are not 0, or belong to equality rows, change.
        from scipy.linalg import lstsq
        from scipy.sparse.linalg import lsqr

        program = self.program
        reduced = _reduced(program, self.cost, Interval(y, y))
        side = np.sign(1.0 * np.isfinite(program.column_lower) - np.isfinite(program.column_upper))
        closed = 1.0 * np.isfinite(implied.low) - np.isfinite(implied.high)
        side = np.where(side == 0, closed, side)[weak]
        middle = 0.5 * (reduced.low[weak] + reduced.high[weak])
        width = 0.5 * (reduced.high[weak] - reduced.low[weak])
        violation = np.where(side == 0, np.abs(middle), np.maximum(-side * middle, 0.0))
        # The error bound of a column with multipliers of 0 says nothing about its scale.
        usual = np.median(np.abs(y[y != 0])) if y.any() else 1.0
        floor = ROUNDOFF * (abs(program.matrix).T @ np.maximum(np.abs(y), usual))[weak]
        distance = DISTANCE * GROWTH ** max(attempt, 0) * np.maximum(width, floor)
        unit = np.maximum(distance, np.maximum(violation, TINY))
        # Reduced costs that are far enough from 0 keep their place.
        target = np.where(side == 0, 0.0, side * np.maximum(unit, side * middle))
        if attempt < 0:
            cost = 0.5 * (self.cost.low + self.cost.high)[weak]
            return _shifted(program, y, np.flatnonzero(weak), cost, cost - middle, side * unit)
        equal = program.row_lower == program.row_upper
        usable = np.flatnonzero(equal | (y != 0))
        block = program.matrix[usable][:, np.flatnonzero(weak)]
        weights = np.where(equal, 1.0, np.minimum(np.abs(y), 1.0))[usable]
        scaled = sp.csr_array(sp.diags_array(weights) @ block @ sp.diags_array(1.0 / unit)).T
        right = (middle - target) / unit
        result = y.copy()
        if not (usable.size and np.isfinite(right).all() and np.isfinite(scaled.data).all()):
            return result
        if min(scaled.shape) ** 2 * max(scaled.shape) <= self.effort:
            change = lstsq(scaled.toarray(), right, lapack_driver="gelsy")[0]
        else:
            change = lsqr(scaled, right, atol=0.0, btol=1e-4, conlim=0.0, iter_lim=ITERATIONS)[0]
        result[usable] += weights * change
        return program.signed(result) if np.isfinite(result).all() else y


class _Value(NamedTuple):
    """Bound of intervals of multipliers, with the reduced costs and the terms of the columns."""

    bound: float
    reduced: Interval
    columns: Vector


def _reduced(program: RowProgram, cost: Interval, multipliers: Interval) -> Interval:
    """Return intervals of the reduced costs ``cost - matrix.T @ multipliers``."""
    middle = 0.5 * (multipliers.low + multipliers.high)
    radius = np.maximum(multipliers.high - middle, middle - multipliers.low)
    value, error = sums(program.matrix.T, middle)
    if radius.any():
        error = error + SLACK * sum(sums(abs(program.matrix.T), radius))
    return difference(cost, value, error)


def _shifted(
    program: RowProgram,
    y: Vector,
    columns: NDArray[np.intp],
    cost: Vector,
    pull: Vector,
    target: Vector,
) -> Vector | None:
    """Return multipliers that move the reduced costs ``cost - pull`` of `columns` at least to `target`.

    Rows with one entry, as modelling tools state bounds, take the change of their column. If they do not suffice,
    all multipliers are scaled by a factor near 1 before. The result is None if that does not suffice either.
    """
    matrix = program.matrix
    rows = np.flatnonzero(np.diff(matrix.indptr) == 1)
    column, entry = matrix.indices[matrix.indptr[rows]], matrix.data[matrix.indptr[rows]]
    order = np.argsort(np.abs(y[rows] * entry), kind="stable")
    last = np.full(program.size, -1)
    last[column[order]] = order  # the largest multiplier of a column has the most room
    has_row = last[columns] >= 0
    row, entry = rows[last[columns[has_row]]], entry[last[columns[has_row]]]
    scale = 1.0
    for _ in range(2):
        change = target - (cost - scale * pull)
        change[(target != 0) & (change * target <= 0)] = 0.0
        result = scale * y
        result[row] -= change[has_row] / entry
        failed = change != 0
        failed[has_row] = (program.signed(result) != result)[row]
        if not failed.any():
            return result
        factors = -SLACK * change[failed] / pull[failed]
        if not np.abs(factors).max() <= NEAR:
            return None
        scale = 1.0 + float(factors[np.argmax(np.abs(factors))])
    return None


def _implied(program: RowProgram, limits: Interval, weak: Mask) -> Interval:
    """Return `limits` with infinite bounds replaced by those that the rows imply, rounded outwards."""
    # Every row bounds each of its columns, given the bounds of the others (Savelsbergh 1994, section 1.1).
    matrix = program.matrix
    row = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    low, high = limits.low.copy(), limits.high.copy()
    # Most columns need no bounds of others, so that the first pass is for the weak ones only.
    for columns in (weak, np.ones(weak.size, bool), weak):
        candidates = Interval(np.full(low.size, -np.inf), np.full(low.size, np.inf))
        for sign, upper in ((1.0, program.row_upper), (-1.0, -program.row_lower)):
            part = np.isfinite(upper)[row]
            triplets = row[part], matrix.indices[part], sign * matrix.data[part]
            _propagate(triplets, upper, Interval(low, high), columns, candidates)
        found = np.isinf(low) & np.isfinite(candidates.low)
        above = np.isinf(high) & np.isfinite(candidates.high)
        low = np.where(found, candidates.low, low)
        high = np.where(above, candidates.high, high)
        closed = np.isfinite(low) & np.isfinite(high)
        if closed[weak].all() or not (found.any() or above.any()):
            break
    return Interval(low, high)


def _propagate(
    entries: tuple[NDArray[Any], NDArray[Any], Vector], upper: Vector, limits: Interval,
    columns: Mask, candidates: Interval,
) -> None:  # fmt: skip
    """Tighten `candidates` of `columns` by rows ``coefficients @ x <= upper``, given by their entries."""
    row, column, coefficients = entries
    count = upper.size
    rising = coefficients > 0
    terms = coefficients * np.where(rising, limits.low[column], limits.high[column])
    finite = np.isfinite(terms)
    known = np.where(finite, terms, 0.0)
    unknown = np.bincount(row, ~finite, count)
    size = np.bincount(row, np.abs(known), count)
    length = np.bincount(row, minlength=count)
    error = (2.0 * length + 4.0) * ROUNDOFF * SLACK * size + (length + 1.0) * TINY
    # Lower bound on the sum of the other terms; they must all be known.
    use = np.flatnonzero(columns[column] & (unknown[row] - ~finite == 0))
    others = np.bincount(row, known, count)[row[use]] - known[use] - error[row[use]]
    others = np.nextafter(others, -np.inf)
    use, others = use[np.isfinite(others)], others[np.isfinite(others)]
    room = np.nextafter(upper[row[use]] - others, np.inf)
    ratio = room / coefficients[use]
    rises = rising[use]
    np.fmin.at(candidates.high, column[use[rises]], np.nextafter(ratio[rises], np.inf))
    np.fmax.at(candidates.low, column[use[~rises]], np.nextafter(ratio[~rises], -np.inf))


def _corrected(
    program: RowProgram, cost: Interval, y: Vector, free: NDArray[np.intp], effort: float
) -> Interval | None:
    """Return intervals with multipliers whose reduced costs on `free` are exactly 0, or None."""
    # As many rows as columns are chosen, by their multipliers and the size of their pivots. The correction of
    # their multipliers solves M d = r, which an approximate inverse R encloses: with the norm g of I - R M
    # below 1, M is regular and |d| <= |R| |r| + g / (1 - g) max(|R| |r|).
    from scipy.linalg import qr

    count = free.size
    equal = program.row_lower == program.row_upper
    columns = sp.csc_array(program.matrix[:, free])
    usable = np.zeros(program.row_count, bool)
    usable[columns.indices] = True
    rows = np.flatnonzero(usable & (equal | (y != 0)))
    if not count <= min(LARGEST_CORRECTION, rows.size) or rows.size * count**2 > effort:
        return None
    block = columns[rows].toarray()
    weights = np.where(equal[rows], 1.0, np.minimum(np.abs(y[rows]), 1.0))
    _, triangle, order = qr((block * weights[:, None]).T, mode="economic", pivoting=True)
    if abs(triangle[count - 1, count - 1]) <= 1e-12 * abs(triangle[0, 0]):
        return None
    rows = rows[order[:count]]
    system = block[order[:count]].T
    middle = y.copy()
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        return None
    for _ in range(2):  # one step of refinement
        low, high = _reduced(program, cost, Interval(middle, middle))
        middle[rows] += inverse @ (0.5 * (low[free] + high[free]))
    low, high = _reduced(program, cost, Interval(middle, middle))
    residual = np.maximum(np.abs(low[free]), np.abs(high[free]))
    # |I - R M| with its rounding errors, in the largest row sum.
    rounding = (count + 4) * 2 * ROUNDOFF * (np.abs(inverse) @ np.abs(system)) + count * TINY
    gap = SLACK * float((np.abs(np.eye(count) - inverse @ system) + rounding).sum(axis=1).max())
    if not gap < 0.5:
        return None
    first = SLACK * (np.abs(inverse) @ residual) + count * TINY
    radius = SLACK * (first + gap / (1.0 - gap) * first.max())
    low, high = middle.copy(), middle.copy()
    low[rows] = np.nextafter(middle[rows] - radius, -np.inf)
    high[rows] = np.nextafter(middle[rows] + radius, np.inf)
    return Interval(low, high)
