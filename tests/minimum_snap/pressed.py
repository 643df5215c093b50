"""The exact path of one axis that is held at given instants of contact, and the forces, in decimals.

Nothing of the package is used but the model's data: the conditions of optimality in sixty digits, with
the cost of :mod:`hundred_digits`, are eliminated as one dense system.
"""

import itertools
import math
from decimal import Decimal, localcontext

import numpy as np
from minimum_snap.hundred_digits import _decimal, _unit, fixed_table


def solve(model, axis, contacts, digits=60):
    """Return coefficients, shape (segments, 2r), and the force of each contact.

    Contacts move with the path as Newton's method has it: at the instant s + ds with ds = slope / -bend.

    Parameters
    ----------
    contacts : list of (segment, s, derivative, value, side, bend)
        The derivative is `value` at the instant s of a segment; side 1 at an upper bound, else -1. Its
        curvature in s, times the side, is `bend` < 0; 0 where the contact stays.
    """
    with localcontext() as context:
        context.prec = digits
        r, knots = model.order, model.times.size
        cost, inverse = (
            np.array([[_decimal(x) for x in row] for row in table], object) for table in _unit(r)
        )
        times = [Decimal(float(t)) for t in model.times]
        long = [b - a for a, b in itertools.pairwise(times)]
        units = [np.array([T**j for j in range(r)] * 2, object) for T in long]
        size, count = knots * r, knots * r + len(contacts)
        matrix = np.full((count, count), Decimal(0), object)
        right = np.full(count, Decimal(0), object)
        for k, T in enumerate(long):
            place = slice(k * r, (k + 2) * r)
            matrix[place, place] += cost * np.outer(units[k], units[k]) / T ** (2 * r - 1)
        springs = []
        for q, (segment, s, derivative, value, side, bend) in enumerate(contacts):
            place = slice(segment * r, (segment + 2) * r)
            unit = units[segment] / long[segment] ** derivative
            row = side * (_powers(s, derivative, 2 * r) @ inverse) * unit
            matrix[size + q, place] = matrix[place, size + q] = row
            right[size + q] = side * Decimal(float(value))
            slope = _powers(s, derivative + 1, 2 * r) @ inverse * unit
            springs.append((place, np.outer(slope, slope), Decimal(float(bend))))
        fixed, given = fixed_table(model)
        known = np.flatnonzero(fixed[:, :, axis].ravel())
        free = np.setdiff1d(np.arange(count), known)
        solution = np.full(count, Decimal(0), object)
        solution[known] = [Decimal(float(v)) for v in given[:, :, axis].ravel()[known]]
        for _ in range(3):  # the springs follow from the forces
            held = matrix.copy()
            for force, (place, square, bend) in zip(solution[size:], springs, strict=True):
                held[place, place] += square * (force / -bend if bend else 0)
            rest = right - held[:, known] @ solution[known]
            solution[free] = _eliminated(held[np.ix_(free, free)], rest[free])
        jets = [solution[k * r : (k + 2) * r] for k in range(knots - 1)]
        powers = np.array([inverse @ (units[k] * jets[k]) for k in range(knots - 1)], object)
        return powers.astype(float), solution[size:].astype(float)


def _powers(s, derivative, size):
    s, row = Decimal(float(s)), np.full(size, Decimal(0), object)
    for p in range(derivative, size):
        row[p] = math.perm(p, derivative) * (s ** (p - derivative) if p > derivative else 1)
    return row


def _eliminated(matrix, right):
    work = np.column_stack([matrix, right])
    size = len(matrix)
    for k in range(size):
        pivot = k + int(np.argmax([abs(x) for x in work[k:, k]]))
        work[[k, pivot]] = work[[pivot, k]]
        for i in range(k + 1, size):
            if work[i, k]:
                work[i, k:] = work[i, k:] - work[i, k] / work[k, k] * work[k, k:]
    for k in reversed(range(size)):
        work[k, size] = (work[k, size] - work[k, k + 1 : size] @ work[k + 1 : size, size]) / work[
            k, k
        ]
    return work[:, size]
