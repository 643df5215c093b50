"""Least-derivative splines in 100 digits, by elimination of the derivatives at the knots.

Derived from powers of s; nothing of the package is used.
"""

import math
from functools import cache

import mpmath

DIGITS = 100


@cache
def unit_tables(order):
    """Return the powers of s from the derivatives at 0 and 1, and the cost of powers by order j."""
    with mpmath.workdps(DIGITS):
        size = 2 * order
        ends = mpmath.zeros(size)
        for p in range(size):
            for j in range(order):
                ends[j, p] = math.factorial(j) if p == j else 0
                ends[order + j, p] = math.perm(p, j)
        costs = []
        for j in range(1, order + 1):
            cost = mpmath.zeros(size)
            for p in range(j, size):
                for q in range(j, size):
                    cost[p, q] = mpmath.mpf(math.perm(p, j) * math.perm(q, j)) / (p + q - 2 * j + 1)
            costs.append(cost)
        powers = ends**-1
        return powers, [(powers.T * cost * powers).tolist() for cost in costs]


def exact_spline(durations, values, fixed, weights, continuity=None):
    """Return J and the powers of s of one axis, (M, 2r), as numbers of 100 digits.

    Parameters are those of ``solve_hermite`` for one axis. None where the optimum is not unique.
    """
    order, count = len(weights), len(durations)
    shared = order if continuity is None else continuity + 1
    with mpmath.workdps(DIGITS):
        zero = mpmath.mpf(0)
        powers, units = unit_tables(order)
        long = [d if isinstance(d, mpmath.mpf) else mpmath.mpf(float(d)) for d in durations]
        # What is unknown at a knot; above `shared`, apart for the segment before (1) and after (0).
        unknown = [
            [(i, side) for i in range(order) if not fixed[k][i]
             for side in ((0, 1) if i >= shared and 0 < k < count else (0,))]
            for k in range(count + 1)
        ]  # fmt: skip
        place = [{key: at for at, key in enumerate(keys)} for keys in unknown]

        def locate(k, p):
            """Return knot and place of the local derivative p of segment k, None where fixed."""
            knot, i = k + p // order, p % order
            key = (i, 1) if i >= shared and p >= order and knot < count else (i, 0)
            return knot, place[knot].get(key)

        def given(k, p):
            return mpmath.mpf(float(values[k + p // order][p % order]))

        block = [[zero] * len(unknown[0]) for _ in unknown[0]]
        load = [zero] * len(unknown[0])
        swept = []
        for k in range(count + 1):
            here = len(unknown[k])
            after = len(unknown[k + 1]) if k < count else 0
            coupling = [[zero] * after for _ in range(here)]
            carried, moved = [[zero] * after for _ in range(after)], [zero] * after
            if k < count:
                scales = [w * long[k] ** (1 - 2 * j) for j, w in enumerate(map(float, weights), 1)]
                lengths = [long[k] ** i for i in range(order)]
                spots = [locate(k, p) for p in range(2 * order)]
                for p in range(2 * order):
                    at, row = spots[p]
                    if row is None:
                        continue
                    for q in range(2 * order):
                        entry = sum((s * unit[p][q] for s, unit in zip(scales, units, strict=True)
                                     if s), zero) * lengths[p % order] * lengths[q % order]  # fmt: skip
                        there, column = spots[q]
                        if column is None:
                            (load if at == k else moved)[row] -= entry * given(k, q)
                        elif at == k:
                            (block if there == k else coupling)[row][column] += entry
                        elif there == k + 1:
                            carried[row][column] += entry
            table = [[*block[i], *coupling[i], load[i]] for i in range(here)]
            for p in range(here):
                pivot = table[p][p]
                if not pivot > block[p][p] * mpmath.mpf(10) ** (10 - DIGITS):
                    return None
                table[p] = [v / pivot for v in table[p]]
                for i in range(here):
                    if i != p and table[i][p]:
                        share = table[i][p]
                        table[i] = [v - share * w for v, w in zip(table[i], table[p], strict=True)]
            swept.append([row[here:] for row in table])
            for i in range(after):
                for j in range(after):
                    carried[i][j] -= sum((coupling[p][i] * table[p][here + j] for p in range(here)),
                                         zero)  # fmt: skip
                moved[i] -= sum((coupling[p][i] * table[p][-1] for p in range(here)), zero)
            block, load = carried, moved
        found, later = [], []
        for rows in reversed(swept):
            later = [
                row[-1] - sum((a * b for a, b in zip(row, later, strict=False)), zero)
                for row in rows
            ]
            found.append(later)
        found.reverse()
        total, coefficients = zero, []
        for k in range(count):
            jet = []
            for p in range(2 * order):
                knot, at = locate(k, p)
                value = given(k, p) if at is None else found[knot][at]
                jet.append(value * long[k] ** (p % order))
            for j, w in enumerate(map(float, weights), 1):
                if w:
                    unit = units[j - 1]
                    total += w * long[k] ** (1 - 2 * j) * sum(
                        jet[p] * unit[p][q] * jet[q] for p in range(2 * order) for q in range(2 * order)
                    )  # fmt: skip
            coefficients.append(list(powers * mpmath.matrix(jet)))
        return total, coefficients
