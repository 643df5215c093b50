"""The exact optimum of a trajectory without bounds: elimination of the knots in decimals.

Nothing of the package is used but the model's data. A segment's cost is ∫ (x^(r))² over the unit
interval in whole numbers, by the inverse of the matrix that takes coefficients to the derivatives
at both ends. Free derivatives are eliminated knot by knot, without square roots.
"""

import math
from decimal import Decimal, getcontext, localcontext
from fractions import Fraction
from functools import cache

import numpy as np

DIGITS = 100


@cache
def _unit(order):
    """Cost of one segment by the derivatives at 0 and 1, and coefficients by the same; fractions."""
    size = 2 * order
    ends = [[Fraction(0)] * size for _ in range(size)]
    for j in range(order):
        ends[j][j] = Fraction(math.factorial(j))
        for p in range(j, size):
            ends[order + j][p] = Fraction(math.perm(p, j))
    inverse = _inverted(ends)
    power = [
        [
            Fraction(math.perm(p, order) * math.perm(q, order), p + q - 2 * order + 1)
            if min(p, q) >= order
            else Fraction(0)
            for q in range(size)
        ]
        for p in range(size)
    ]
    half = _product(power, inverse)
    cost = _product([list(row) for row in zip(*inverse, strict=True)], half)
    return cost, inverse


def _product(a, b):
    columns = list(zip(*b, strict=True))
    return [
        [sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a
    ]


def _inverted(rows):
    size = len(rows)
    work = [list(row) + [Fraction(int(i == k)) for i in range(size)] for k, row in enumerate(rows)]
    for k in range(size):
        pivot = next(i for i in range(k, size) if work[i][k])
        work[k], work[pivot] = work[pivot], work[k]
        work[k] = [value / work[k][k] for value in work[k]]
        for i in range(size):
            if i != k and work[i][k]:
                factor = work[i][k]
                work[i] = [x - factor * y for x, y in zip(work[i], work[k], strict=True)]
    return [row[size:] for row in work]


def _decimal(fraction):
    return Decimal(fraction.numerator) / Decimal(fraction.denominator)


def solve(model, digits=DIGITS):
    """Return the optimum, the coefficients of all segments, and whether it is unique.

    Returns
    -------
    tuple
        J as a Decimal; Decimals of shape (segments, 2 r, axes): powers of s from 0 to 1; a bool.
    """
    with localcontext() as context:
        context.prec = digits
        r, axes = model.order, model.waypoints.shape[1]
        times = [Decimal(float(t)) for t in model.times]
        fixed, value = fixed_table(model)
        total, unique = Decimal(0), True
        coefficients = np.empty((len(times) - 1, 2 * r, axes), object)
        for axis in range(axes):
            cost, jets, alone = _axis(times, fixed[:, :, axis], value[:, :, axis], r)
            total, unique = total + cost, unique and alone
            inverse = np.array([[_decimal(x) for x in row] for row in _unit(r)[1]], object)
            for k in range(len(times) - 1):
                long = times[k + 1] - times[k]
                units = [long**j for j in range(r)]
                local = [jets[k][j] * units[j] for j in range(r)]
                local += [jets[k + 1][j] * units[j] for j in range(r)]
                coefficients[k, :, axis] = inverse @ np.array(local, object)
        return total, coefficients, unique


def fixed_table(model):
    """Return which derivatives 0 … r-1 are fixed at the knots, and to what: from the raw fields."""
    knots, axes = model.waypoints.shape
    r = model.order
    table = np.full((knots, r, axes), np.inf)
    table[:, 0] = model.waypoints
    if model.derivatives is not None:
        rows = min(r - 1, model.derivatives.shape[1])
        table[:, 1 : 1 + rows] = model.derivatives[:, :rows]
    for knot, given in ((0, model.start), (-1, model.end)):
        for j, row in enumerate(given[: r - 1]):
            table[knot, 1 + j] = np.where(np.isfinite(row), row, table[knot, 1 + j])
    return np.isfinite(table), table


def _axis(times, fixed, value, r):
    unit = np.array([[_decimal(x) for x in row] for row in _unit(r)[0]], object)
    knots = len(times)
    scaled = []
    for k in range(knots - 1):
        long = times[k + 1] - times[k]
        units = np.array([long**j for j in range(r)] * 2, object)
        scaled.append(unit * units[:, None] * units[None, :] / long ** (2 * r - 1))
    free = [np.flatnonzero(~fixed[k]) for k in range(knots)]
    known = [
        np.array(
            [
                Decimal(float(v)) if f else Decimal(0)
                for f, v in zip(fixed[k], value[k], strict=True)
            ],
            object,
        )
        for k in range(knots)
    ]
    own = [np.full((r, r), Decimal(0), object) for _ in range(knots)]
    right = [np.full(r, Decimal(0), object) for _ in range(knots)]
    for k, matrix in enumerate(scaled):
        own[k] = own[k] + matrix[:r, :r]
        own[k + 1] = own[k + 1] + matrix[r:, r:]
        right[k] = right[k] - matrix[:r, :r] @ known[k] - matrix[:r, r:] @ known[k + 1]
        right[k + 1] = right[k + 1] - matrix[r:, :r] @ known[k] - matrix[r:, r:] @ known[k + 1]
    # Forward: free entries of a knot in terms of those of the next knot.
    back, unique = [], True
    matrix = own[0][np.ix_(free[0], free[0])]
    load = right[0][free[0]]
    for k in range(knots):
        after = free[k + 1] if k + 1 < knots else np.empty(0, int)
        if k + 1 < knots:
            beside = scaled[k][:r, r:][np.ix_(free[k], after)]
        else:
            beside = np.empty((len(free[k]), 0), object)
        sizes = np.array([own[k][i, i] for i in free[k]], object)
        solution, alone = _eliminated(matrix, np.column_stack([load[:, None], beside]), sizes)
        unique = unique and alone
        back.append((solution[:, 0], solution[:, 1:]))
        if k + 1 < knots:
            matrix = own[k + 1][np.ix_(after, after)]
            load = right[k + 1][after]
            if len(free[k]):
                matrix = matrix - beside.T @ solution[:, 1:]
                load = load - beside.T @ solution[:, 0]
    jets = [known[k].copy() for k in range(knots)]
    later = np.empty(0, object)
    for k in reversed(range(knots)):
        base, slope = back[k]
        own_free = base - slope @ later if later.size and base.size else base
        jets[k][free[k]] = own_free
        later = own_free
    total = Decimal(0)
    for k, matrix in enumerate(scaled):
        both = np.concatenate([jets[k], jets[k + 1]])
        total += both @ matrix @ both
    return total, jets, unique


def _eliminated(matrix, right, sizes):
    """Return x with matrix x = right for a symmetric matrix, and whether x is unique.

    The matrix is positive semidefinite, and the system is solvable. Entries without a pivot are 0.
    """
    size = len(matrix)
    work = np.column_stack([matrix, right]) if size else np.empty((0, right.shape[1]), object)
    unique = True
    for k in range(size):
        if not work[k, k] > sizes[k] * Decimal(10) ** (-getcontext().prec * 6 // 10):
            work[k], unique = work[k] * 0, False
            work[:, k] = work[:, k] * 0
            continue
        work[k] = work[k] / work[k, k]
        for i in range(size):
            if i != k and work[i, k]:
                work[i] = work[i] - work[i, k] * work[k]
    return work[:, size:], unique
