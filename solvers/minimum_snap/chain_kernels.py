"""Compiled linear algebra on a chain of segments: products and a square-root factorisation.

The Newton system is ``J'J dy = b``, where J contains the cost rows and the weighted bound rows. It
is factorised knot by knot with Householder reflections (a square-root information filter). J'J is
never formed: for the slow modes of a long path its condition number exceeds double precision, and
that of J is its square root.

Local coordinates of a segment are ``[knot before (n) | knot after (n) | interior (i)]``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = [
    "advance",
    "bound_gradient",
    "factorise",
    "hold_still",
    "largest_of",
    "multiply",
    "newton_step",
    "row_values",
    "solve_factors",
    "times",
    "transposed",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@kernel(interpretable=True, in_place=True)
def row_values(rows: Floats, start: Ints, knots: Floats, inner: Floats) -> Floats:
    """Return the values of the bound rows. Segment k has rows ``start[k]`` to ``start[k+1]``."""
    n = knots.shape[1]
    width = rows.shape[1]
    value = np.zeros(rows.shape[0])
    for k in range(start.size - 1):
        for q in range(start[k], start[k + 1]):
            total = 0.0
            for j in range(n):
                total += rows[q, j] * knots[k, j] + rows[q, n + j] * knots[k + 1, j]
            for j in range(width - 2 * n):
                total += rows[q, 2 * n + j] * inner[k, j]
            value[q] = total
    return value


@kernel(interpretable=True, in_place=True)
def bound_gradient(rows: Floats, start: Ints, value: Floats, knots: Floats, inner: Floats) -> None:
    """Add ``G' value`` to the gradients `knots` and `inner`."""
    n = knots.shape[1]
    width = rows.shape[1]
    for k in range(start.size - 1):
        for q in range(start[k], start[k + 1]):
            v = value[q]
            if v != 0.0:
                for j in range(n):
                    knots[k, j] += rows[q, j] * v
                    knots[k + 1, j] += rows[q, n + j] * v
                for j in range(width - 2 * n):
                    inner[k, j] += rows[q, 2 * n + j] * v


@kernel
def _flatten(rows: Floats) -> tuple[Floats, Ints]:
    """Return dense rows of every segment, shape (segments, c, width), as bound rows."""
    count, c, width = rows.shape
    return rows.reshape(count * c, width), np.arange(count + 1) * c


@kernel(interpretable=True, in_place=True)
def multiply(rows: Floats, knots: Floats, inner: Floats) -> Floats:
    """Return ``rows[k] @ local[k]`` for dense rows of every segment, shape (segments, c)."""
    flat, start = _flatten(rows)
    return row_values(flat, start, knots, inner).reshape(rows.shape[0], rows.shape[1])


@kernel(interpretable=True, in_place=True)
def transposed(rows: Floats, value: Floats, knots: Floats, inner: Floats) -> None:
    """Add ``rows[k]' @ value[k]`` to the gradients `knots` and `inner`."""
    flat, start = _flatten(rows)
    bound_gradient(flat, start, value.reshape(value.size), knots, inner)


@kernel
def _reflect(work: Floats, rows: int, first: int, pivots: int, width: int, where: Ints) -> int:
    """Triangularise columns ``first … first + pivots - 1`` of ``work[:, :rows]``.

    `work` stores each column as a row, so that the inner loops access contiguous memory.
    ``where[j]`` receives the pivot row of column ``first + j``, or -1 if the column is zero. Return
    the number of pivot rows.
    """
    taken = 0
    for j in range(pivots):
        column = first + j
        where[j] = -1
        if taken >= rows:
            continue
        norm = 0.0
        for i in range(taken + 1, rows):
            norm += work[column, i] * work[column, i]
        head = work[column, taken]
        if norm == 0.0 and head == 0.0:
            continue
        where[j] = taken
        if norm > 0.0:
            alpha = np.sqrt(head * head + norm)
            if head > 0:
                alpha = -alpha
            pivot = head - alpha
            # H = I - v v' / (alpha (alpha - head)), v = (head - alpha, the rest of the column).
            factor = 1.0 / (alpha * (alpha - head))
            for other in range(column + 1, width):
                dot = pivot * work[other, taken]
                for i in range(taken + 1, rows):
                    dot += work[column, i] * work[other, i]
                dot *= factor
                work[other, taken] -= dot * pivot
                for i in range(taken + 1, rows):
                    work[other, i] -= dot * work[column, i]
            work[column, taken] = alpha
            for i in range(taken + 1, rows):
                work[column, i] = 0.0
        taken += 1
    return taken


@kernel(interpretable=True, in_place=True)
def factorise(
    cost: Floats,
    rows: Floats,
    start: Ints,
    weight: Floats,
    fixed: Flags,
    factors: Floats,
    last: Floats,
) -> None:
    """Triangularise the cost rows and the bound rows times `weight` of all segments.

    `factors`, shape (segments, interior + n, interior + 2 n), receives the triangular rows, whose
    columns are interior, previous knot, next knot. `last`, shape (n, n), receives the triangle of
    the last knot.
    """
    count, c, width = cost.shape
    n = fixed.shape[1]
    inner = width - 2 * n
    eliminated = inner + n
    most = 0
    for k in range(count):
        most = max(most, start[k + 1] - start[k])
    work = np.zeros((width, 2 * n + c + most + eliminated))
    carry = np.zeros((n, n))
    where = np.zeros(max(eliminated, n), np.int64)
    for k in range(count):
        held = start[k + 1] - start[k]
        total = n + c + held
        for column in range(width):
            # Index of this column in the cost and bound rows, and its knot.
            if column < inner:
                place, frozen = 2 * n + column, False
            elif column < eliminated:
                place, frozen = column - inner, fixed[k, column - inner]
            else:
                place, frozen = column - inner, fixed[k + 1, column - eliminated]
            if frozen:
                for i in range(total):
                    work[column, i] = 0.0
                continue
            # Sorting large rows first keeps Householder reflections row-wise accurate.
            for q in range(held):
                work[column, q] = weight[start[k] + q] * rows[start[k] + q, place]
            for i in range(c):
                work[column, held + i] = cost[k, i, place]
            for i in range(n):
                value = 0.0
                if inner <= column < eliminated:
                    value = carry[i, column - inner]
                work[column, held + c + i] = value
        taken = _reflect(work, total, 0, eliminated, width, where)
        for i in range(eliminated):
            row = where[i]
            for column in range(width):
                factors[k, i, column] = work[column, row] if row >= 0 and column >= i else 0.0
        # The remaining rows involve only the next knot, so n rows are enough.
        rest = total - taken
        for column in range(eliminated, width):
            for i in range(rest):
                work[column, i] = work[column, i + taken]
        _reflect(work, rest, eliminated, n, width, where)
        for i in range(n):
            row = where[i]
            for column in range(n):
                value = 0.0
                if row >= 0 and i <= column:
                    value = work[eliminated + column, row]
                carry[i, column] = value
    for i in range(n):
        for j in range(n):
            last[i, j] = carry[i, j]


@kernel(interpretable=True, in_place=True)
def solve_factors(
    factors: Floats, last: Floats, fixed: Flags, knots: Floats, inner: Floats
) -> None:
    """Solve ``R'R x = b`` in place: `knots` and `inner` contain b and receive x."""
    count, eliminated, _ = factors.shape
    n = fixed.shape[1]
    own = eliminated - n
    tiny = 1e-150
    w = np.zeros((count, eliminated))
    for k in range(count):
        for i in range(eliminated):
            value = inner[k, i] if i < own else knots[k, i - own]
            for j in range(i):
                value -= factors[k, j, i] * w[k, j]
            pivot = factors[k, i, i]
            w[k, i] = value / pivot if abs(pivot) > tiny else 0.0
        for j in range(n):
            value = knots[k + 1, j]
            for i in range(eliminated):
                value -= factors[k, i, eliminated + j] * w[k, i]
            knots[k + 1, j] = value
    for i in range(n):
        value = knots[count, i]
        for j in range(i):
            value -= last[j, i] * knots[count, j]
        knots[count, i] = value / last[i, i] if abs(last[i, i]) > tiny else 0.0
    for i in range(n - 1, -1, -1):
        value = knots[count, i]
        for j in range(i + 1, n):
            value -= last[i, j] * knots[count, j]
        knots[count, i] = value / last[i, i] if abs(last[i, i]) > tiny else 0.0
    for k in range(count - 1, -1, -1):
        for i in range(eliminated - 1, -1, -1):
            value = w[k, i]
            for j in range(i + 1, eliminated):
                value -= factors[k, i, j] * w[k, j]
            for j in range(n):
                value -= factors[k, i, eliminated + j] * knots[k + 1, j]
            pivot = factors[k, i, i]
            w[k, i] = value / pivot if abs(pivot) > tiny else 0.0
            if i < own:
                inner[k, i] = w[k, i]
            else:
                knots[k, i - own] = w[k, i]


# Array expressions take several times longer to compile than these loops.


@kernel
def times(factor: float, array: Floats) -> Floats:
    """Return ``factor * array`` for an array of two dimensions."""
    result = np.empty(array.shape)
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            result[i, j] = factor * array[i, j]
    return result


@kernel
def advance(array: Floats, factor: float, step: Floats) -> None:
    """Add ``factor * step`` to an array of two dimensions."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] += factor * step[i, j]


@kernel
def largest_of(array: Floats) -> float:
    """Return the largest absolute value in a two-dimensional array, or 0 if it is empty."""
    largest = 0.0
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            # NaN is returned as the largest value.
            if abs(array[i, j]) > largest or np.isnan(array[i, j]):
                largest = abs(array[i, j])
    return largest


@kernel
def hold_still(fixed: Flags, knots: Floats) -> None:
    """Set the entries of fixed coordinates to 0."""
    for k in range(fixed.shape[0]):
        for j in range(fixed.shape[1]):
            if fixed[k, j]:
                knots[k, j] = 0.0


@kernel
def newton_step(
    cost: Floats,
    rows: Floats,
    start: Ints,
    weight: Floats,
    fixed: Flags,
    factors: Floats,
    last: Floats,
    b_knots: Floats,
    b_inner: Floats,
) -> tuple[Floats, Floats]:
    """Solve ``(C'C + G'W²G) x = b`` with the factors and one step of refinement with the rows."""
    x_knots, x_inner = times(1.0, b_knots), times(1.0, b_inner)
    solve_factors(factors, last, fixed, x_knots, x_inner)
    r_knots, r_inner = times(1.0, b_knots), times(1.0, b_inner)
    transposed(cost, times(-1.0, multiply(cost, x_knots, x_inner)), r_knots, r_inner)
    value = row_values(rows, start, x_knots, x_inner)
    for q in range(value.size):
        value[q] *= -weight[q] * weight[q]
    bound_gradient(rows, start, value, r_knots, r_inner)
    hold_still(fixed, r_knots)
    solve_factors(factors, last, fixed, r_knots, r_inner)
    advance(x_knots, 1.0, r_knots)
    advance(x_inner, 1.0, r_inner)
    return x_knots, x_inner
