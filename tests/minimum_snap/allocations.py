"""Waypoints and limits that the tests of time allocation share, and J by SciPy alone."""

import numpy as np
from scipy.interpolate import make_interp_spline

POINTS = [[0, 0], [1, 2], [3, 2], [4, 0]]
LIMITS = {"velocity_limit": 1.5, "acceleration_limit": 3.0}


def walk(knots, dimensions=3, seed=1):
    """Waypoints of a random walk."""
    steps = np.random.default_rng(seed).uniform(-2, 2, (knots, dimensions))
    return np.cumsum(steps, axis=0)


def spline_cost(model, durations):
    """J by SciPy alone: the spline of degree 2r-1 and quadrature that is exact for it."""
    r, times = model.order, np.concatenate([[0.0], np.cumsum(durations)])
    rest = [(j, np.zeros(model.dimensions)) for j in range(1, r)]
    found = make_interp_spline(times, model.waypoints, k=2 * r - 1, bc_type=(rest, rest))
    nodes, weights = np.polynomial.legendre.leggauss(r)
    total = 0.0
    for begin, long in zip(times, durations, strict=False):
        values = found(begin + long * (nodes + 1) / 2, nu=r)
        total += 0.5 * long * float(weights @ (values**2).sum(axis=1))
    return total
