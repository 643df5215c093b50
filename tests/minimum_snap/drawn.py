"""Trajectories at random, and SciPy's splines."""

import math

import numpy as np
from scipy.interpolate import make_interp_spline

from crosstrack.instances.minimum_snap import random_walk
from crosstrack.models.minimum_snap.trajectory import Trajectory

HEADER = ",".join(["duration", *(f"{a}^{k}" for a in ("x", "y", "z", "yaw") for k in range(8))])


def drawn(segments=5, degree=7, dimensions=3, seed=0, low=0.3, high=3.0):
    """A trajectory at random: not continuous, so that nothing is hidden."""
    rng = np.random.default_rng(seed)
    times = rng.normal() + np.concatenate([[0], np.cumsum(rng.uniform(low, high, segments))])
    return Trajectory(times, rng.normal(size=(segments, degree + 1, dimensions)))


def smooth(segments=5, dimensions=3, seed=0):
    """An optimum by SciPy's spline."""
    model = random_walk(segments, dimensions, seed)
    return model, spline(model.times, model.waypoints)


def spline(times, points, order=4, start=None, end=None):
    """SciPy's spline of degree 2r - 1 as a trajectory; at rest by default."""
    rest = [(j, np.zeros(points.shape[1])) for j in range(1, order)]
    ends = (rest if start is None else start, rest if end is None else end)
    found = make_interp_spline(times, points, k=2 * order - 1, bc_type=ends)
    rows = [found(times[:-1], nu=j) / math.factorial(j) for j in range(2 * order)]
    scale = np.diff(times)[:, None] ** np.arange(2.0 * order)
    return Trajectory(times, np.stack(rows, axis=1) * scale[:, :, None])
