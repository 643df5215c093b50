"""Small models of minimum derivative, random ones, and their optima by brute force.

The brute force shares nothing with the package: Chebyshev polynomials on every segment, and a dense
null space.
"""

import math

import numpy as np
from hypothesis import HealthCheck, assume, settings, strategies as st
from numpy.polynomial import chebyshev, polynomial

from crosstrack.models import MinimumSnap
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.models.minimum_snap.trajectory import Trajectory

WAYPOINTS = [[0.0, 0], [1, 2], [3, 2]]
TIMES = [0.0, 1, 3]
INF, NAN = math.inf, math.nan
QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def make(cls=MinimumSnap, **changes):
    return cls(**{"waypoints": WAYPOINTS, "times": TIMES, **changes})


def of_order(order, **changes):
    return make(MinimumDerivative, order=order, **changes)


def chebyshev_rows(at, derivative, degree):
    """Return derivatives in s of T_0 … T_degree on [0, 1] at one point."""
    rows = []
    for number in range(degree + 1):
        inner = chebyshev.chebder(np.eye(degree + 1)[number], derivative) * 2.0**derivative
        rows.append(chebyshev.chebval(2 * at - 1, inner))
    return np.array(rows)


def brute_force(model):
    """Return the optimal trajectory of a model without corridor and limits, or None without one."""
    count, degree = model.segments, model.degree
    size = degree + 1
    long = np.diff(model.times)
    nodes, weights = np.polynomial.legendre.leggauss(degree + 1)
    cost = []
    for order, weight in enumerate(model.order_weights, start=1):
        for k in range(count):
            for node, share in zip((nodes + 1) / 2, weights / 2, strict=True):
                row = np.zeros(count * size)
                row[k * size : (k + 1) * size] = chebyshev_rows(node, order, degree)
                cost.append(row * math.sqrt(weight * share * long[k] ** (1 - 2 * order)))
    cost = np.array(cost)
    powers = np.zeros((count, size, model.dimensions))
    for axis in range(model.dimensions):
        rows, right = [], []

        def add(parts, value, rows=rows, right=right):
            row = np.zeros(count * size)
            for segment, side, order, sign in parts:
                block = slice(segment * size, (segment + 1) * size)
                row[block] += sign * chebyshev_rows(side, order, degree) * long[segment] ** -order
            norm = np.linalg.norm(row)
            rows.append(row / norm)
            right.append(value / norm)

        for knot in range(count + 1):
            for order in range(model.conditions.shape[1]):
                value = model.conditions[knot, order, axis]
                for segment, side in ((knot - 1, 1.0), (knot, 0.0)):
                    if np.isfinite(value) and 0 <= segment < count:
                        add([(segment, side, order, 1.0)], value)
            if 0 < knot < count:
                for order in range(model.continuity + 1):
                    add([(knot - 1, 1.0, order, 1.0), (knot, 0.0, order, -1.0)], 0.0)
        matrix, right = np.array(rows), np.array(right)
        found = null_space_optimum(cost, np.zeros(len(cost)), matrix, right)
        if found is None:
            return None
        for k in range(count):
            own = chebyshev.cheb2poly(found[k * size : (k + 1) * size])
            shifted = polynomial.Polynomial(own)(polynomial.Polynomial([-1.0, 2.0])).coef
            powers[k, : shifted.size, axis] = shifted
    return Trajectory(model.times, powers)


def null_space_optimum(cost, target, matrix, right):
    """Minimise |cost x - target|² with matrix x = right; None where the rows contradict."""
    if not len(matrix):
        return np.linalg.lstsq(cost, target, rcond=None)[0]
    u, values, v = np.linalg.svd(matrix)
    rank = int((values > 1e-10 * values[0]).sum())
    start = v[:rank].T @ ((u[:, :rank].T @ right) / values[:rank])
    if np.abs(matrix @ start - right).max() > 1e-9 * max(1.0, np.abs(right).max()):
        return None
    free = v[rank:].T
    step = np.linalg.lstsq(cost @ free, target - cost @ start, rcond=1e-13)[0]
    return start + free @ step


def solved_densely(program):
    """Return the optimal value of an equality-constrained quadratic program."""
    hessian, matrix = program.hessian.toarray(), program.matrix.toarray()
    assert np.array_equal(program.row_lower, program.row_upper)
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scale[np.diag(hessian) == 0] = 1.0
    values, vectors = np.linalg.eigh(hessian * scale[:, None] * scale)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    # |root y|²/2 + cost'y: the target is what makes the gradient at it the cost.
    target = np.linalg.lstsq(root.T, -program.cost * scale, rcond=1e-13)[0]
    point = scale * null_space_optimum(root, target, matrix * scale, program.row_lower)
    return program.objective(point)


@st.composite
def models(draw, *, most=2, inner=True):
    """Draw models without corridor and limits."""
    r = draw(st.integers(1, 4))
    count, axes = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    times = np.cumsum(
        np.concatenate([[generator.uniform(-2, 2)], generator.uniform(0.4, 2, count)])
    )
    waypoints = generator.normal(size=(count + 1, axes)) * 3
    degree = 2 * r - 1 + draw(st.integers(0, 3))
    options = {"degree": degree, "continuity": draw(st.integers(0, min(r - 1 + most, degree)))}
    if draw(st.booleans()):
        options["weights"] = np.append(generator.uniform(0, 2, r - 1), 1.5)
    if draw(st.booleans()):
        gone = generator.random((count + 1, axes)) < 0.3
        gone[[0, -1]] = False
        waypoints[gone] = FREE
    if inner and r > 1 and draw(st.booleans()):
        rows = np.full((count + 1, r - 1, axes), FREE)
        some = generator.random((count - 1, r - 1, axes)) < 0.3
        rows[1:-1][some] = generator.normal(size=int(some.sum()))
        options["derivatives"] = rows
    if draw(st.booleans()):
        ends = generator.normal(size=(2, r - 1, axes))
        ends[generator.random(ends.shape) < 0.3] = FREE
        options["start"], options["end"] = ends
    return MinimumDerivative(waypoints, times, order=r, **options)


def optimum_of(model):
    """Return the brute-force optimum of `model` if its rows allow one."""
    plan = brute_force(model)
    assume(plan is not None)
    return plan


def walk(count, *, seed=0, **options):
    """Return the paper's own problem: C², at rest in velocity and acceleration."""
    generator = np.random.default_rng(seed)
    points = np.cumsum(generator.normal(size=(count + 1, 1)), axis=0)
    rest = np.zeros((2, 1))
    return MinimumSnap(
        points, np.arange(count + 1.0), continuity=2, start=rest, end=rest, **options
    )


def bounded(**changes):
    free = brute_force(make())
    top = np.maximum(-free.extremes(1).least, free.extremes(1).largest).max()
    return make(
        velocity_limit=0.95 * top, corridor_upper=[3.05, 2.05], corridor_lower=-0.05, **changes
    )


def violated(model, plan):
    return {check.name for check in model.verify(plan).violated}


@st.composite
def trajectories(draw, most=9):
    count, axes = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    degree = draw(st.integers(0, most))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 10.0 ** draw(st.integers(-6, 6))
    coefficients = generator.normal(size=(count, degree + 1, axes)) * scale
    zeros = draw(st.integers(0, degree))
    if draw(st.booleans()):
        coefficients[:, degree + 1 - zeros :] = 0.0
    times = np.cumsum(10 ** generator.uniform(-1, 1, count + 1))
    return Trajectory(times, coefficients)
