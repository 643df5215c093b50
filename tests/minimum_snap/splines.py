"""Trajectory problems on plain arrays, and what they cost by other means than the package's."""

import math

import mpmath
import numpy as np
import scipy.linalg

from crosstrack.solvers.minimum_snap.hermite import scaled_jets, table_of


def only(order):
    """Weights of the highest order alone."""
    return np.eye(order)[-1]


def through_waypoints(order, count, ratio=4.0, axes=3, seed=0, kind="any"):
    """Durations, values and pattern: positions fixed, ends fixed, all else free (NaN)."""
    rng = np.random.default_rng(seed)
    if kind == "alternating":
        durations = np.where(np.arange(count) % 2, ratio, 1.0)
    else:
        durations = np.exp(rng.uniform(0.0, math.log(ratio), count))
    values = np.full((axes, count + 1, order), np.nan)
    values[:, :, 0] = np.cumsum(rng.normal(size=(axes, count + 1)), axis=1)
    values[:, [0, -1], 1:] = rng.normal(size=(axes, 2, order - 1))
    return durations, values, ~np.isnan(values)


def random_problem(rng, most_order=5, most_segments=6):
    """Any pattern, weights and continuity: what :func:`solve_hermite` takes."""
    order = int(rng.integers(1, most_order + 1))
    count, axes = int(rng.integers(1, most_segments + 1)), int(rng.integers(1, 4))
    continuity = int(rng.integers(max(0, order - 3), order))
    fixed = rng.random((axes, count + 1, order)) < rng.choice([0.2, 0.5, 0.8])
    if rng.random() < 0.5:
        fixed[:] = fixed[:1]
    if rng.random() < 0.7:
        fixed[:, :, 0] = True
    values = np.where(fixed, rng.normal(size=fixed.shape), np.nan)
    weights = only(order) * rng.uniform(0.5, 2.0)
    if rng.random() < 0.4:
        weights += rng.uniform(0.0, 1.0, order) * (rng.random(order) < 0.5)
    durations = np.exp(rng.uniform(0.0, math.log(4.0), count))
    return durations, values, fixed, weights, continuity


def unit_hessian(order):
    """Hessian of ∫ (x^(r))² ds by the derivatives at 0 and 1, from monomials, in mpmath."""
    size = 2 * order
    ends = mpmath.zeros(size)
    cost = mpmath.zeros(size)
    for p in range(size):
        for j in range(order):
            ends[j, p] = math.factorial(j) if p == j else 0
            ends[order + j, p] = math.perm(p, j)
        for q in range(size):
            if p >= order and q >= order:
                cost[p, q] = mpmath.mpf(math.perm(p, order) * math.perm(q, order)) / (
                    p + q - 2 * order + 1
                )
    powers = ends**-1
    return (powers.T * cost * powers).tolist()


def reference(durations, values, order, fixed=None):
    """Return J in 50 digits for one axis: block elimination, fixed entries as rows of identity.

    Derived from monomials; nothing of the package is used.
    """
    with mpmath.workdps(50):
        unit = unit_hessian(order)
        one, zero = mpmath.mpf(1), mpmath.mpf(0)
        if fixed is None:
            fixed = ~np.isnan(values)
        places = range(order)
        carried = [[zero] * order for _ in places]
        load = [zero] * order
        total = zero
        long = [d if isinstance(d, mpmath.mpf) else mpmath.mpf(float(d)) for d in durations]
        given = [[mpmath.mpf(float(v)) if f else zero for v, f in zip(vs, fs, strict=True)]
                 for vs, fs in zip(values, fixed, strict=True)]  # fmt: skip
        for k in range(len(long) + 1):
            block, right = carried, load
            coupling = [[zero] * order for _ in places]
            carried, load = [[zero] * order for _ in places], [zero] * order
            if k < len(long):
                power = [long[k] ** n for n in range(1 - 2 * order, 1)]
                held = [*given[k], *given[k + 1]]
                free = [*~fixed[k], *~fixed[k + 1]]
                for p in range(2 * order):
                    for q in range(2 * order):
                        i, j = p % order, q % order
                        entry = unit[p][q] * power[i + j]
                        total += held[p] * entry * held[q]
                        if not free[p]:
                            continue
                        if p < order:
                            right[i] -= entry * held[q]
                        else:
                            load[i] -= entry * held[q]
                        if free[q] and p < order:
                            (block if q < order else coupling)[i][j] += entry
                        elif free[q] and q >= order:
                            carried[i][j] += entry
            for i in places:
                if fixed[k, i]:
                    block[i][i] = one
            # Gauss-Jordan on [block | coupling, right].
            table = [[*block[i], *coupling[i], right[i]] for i in places]
            for p in places:
                pivot = table[p][p]
                table[p] = [v / pivot for v in table[p]]
                for i in places:
                    if i != p and table[i][p]:
                        share = table[i][p]
                        table[i] = [v - share * w for v, w in zip(table[i], table[p], strict=True)]
            total -= sum(right[i] * table[i][-1] for i in places)
            for i in places:
                for j in places:
                    carried[i][j] -= sum(coupling[p][i] * table[p][order + j] for p in places)
                load[i] -= sum(coupling[p][i] * table[p][-1] for p in places)
        return total


def cost_in_digits(durations, coefficients, order):
    """Return J of the polynomials as they are written down, one axis, in 50 digits."""
    with mpmath.workdps(50):
        total = mpmath.mpf(0)
        powers = range(order, 2 * order)
        for long, own in zip(durations, coefficients, strict=True):
            exact = [mpmath.mpf(float(c)) for c in own]
            part = mpmath.mpf(0)
            for p in powers:
                for q in powers:
                    factor = mpmath.mpf(math.perm(p, order) * math.perm(q, order))
                    part += exact[p] * exact[q] * factor / (p + q - 2 * order + 1)
            total += part * mpmath.mpf(float(long)) ** (1 - 2 * order)
        return total


def brute_force(durations, values, fixed, weights, continuity):
    """Return J of one axis and how many directions are left open, by monomials and quadrature."""
    order, count = len(weights), len(durations)
    size = 2 * order
    nodes, shares = np.polynomial.legendre.leggauss(size)
    nodes, shares = (nodes + 1) / 2, shares / 2

    def derivative(at, j):
        return np.array([[math.perm(p, j) * s ** (p - j) if p >= j else 0.0 for p in range(size)]
                         for s in np.atleast_1d(at)])  # fmt: skip

    cost, rules, right = [], [], []
    for k, long in enumerate(durations):
        for j, weight in enumerate(weights, start=1):
            rows = np.zeros((size, count * size))
            scale = np.sqrt(weight * shares * long ** (1 - 2 * j))
            rows[:, k * size : (k + 1) * size] = scale[:, None] * derivative(nodes, j)
            cost.append(rows)
        for end in (0, 1):
            for j in range(order):
                row = np.zeros(count * size)
                row[k * size : (k + 1) * size] = derivative(end, j)[0] / long**j
                if fixed[k + end, j]:
                    rules.append(row)
                    right.append(values[k + end, j])
                elif end == 1 and k + 1 < count and j <= continuity:
                    row[(k + 1) * size : (k + 2) * size] = (
                        -derivative(0, j)[0] / durations[k + 1] ** j
                    )
                    rules.append(row)
                    right.append(0.0)
    cost = np.concatenate(cost)
    start, open_ = np.zeros(count * size), np.eye(count * size)
    if rules:
        rules = np.array(rules)
        start = np.linalg.lstsq(rules, np.array(right), rcond=None)[0]
        open_ = scipy.linalg.null_space(rules)
    reduced = cost @ open_
    if open_.shape[1] == 0:
        return float(np.sum((cost @ start) ** 2)), 0
    found, _, rank, _ = np.linalg.lstsq(reduced, -cost @ start, rcond=1e-10)
    return float(np.sum((cost @ start + reduced @ found) ** 2)), open_.shape[1] - rank


def worst_jumps(durations, coefficients, highest):
    """Jumps of every derivative at inner knots, relative to its largest value on that axis."""
    found = []
    powers = range(coefficients.shape[1])
    for j in range(highest + 1):
        values = []
        for s in np.linspace(0.0, 1.0, 9):
            row = np.array([math.perm(p, j) * s ** (p - j) if p >= j else 0.0 for p in powers])
            scale = durations[:, None] ** -float(j)
            values.append(np.einsum("p,kpa->ka", row, coefficients) * scale)
        jump = np.abs(values[-1][:-1] - values[0][1:]).max(axis=0, initial=0.0)
        found.append((jump / np.abs(values).max(axis=(0, 1))).max())
    return np.array(found)


def cost_of_jets(durations, jets, weights):
    """Return J of each axis for any derivatives at the knots, in floats."""
    table = table_of(weights)
    moments = scaled_jets(durations, jets) @ table.rows.T
    scale = table.factors * durations[:, None] ** (1.0 - 2.0 * table.orders)
    return np.einsum("kn,akn,akn->a", scale, moments, moments)
