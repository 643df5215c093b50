"""Allocation of times by other means: Nelder and Mead on log T, over SciPy's spline or a program.

Neither start nor inner problem nor search shares code with ``time-gradient``.
"""

import math

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize

from crosstrack.models import Trajectory
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend


def spline(model, durations):
    """The best trajectory through known waypoints, from rest to rest, without bounds."""
    r, times = model.order, np.concatenate([[0.0], np.cumsum(durations)])
    rest = [(j, np.zeros(model.dimensions)) for j in range(1, r)]
    found = make_interp_spline(times, model.waypoints, k=2 * r - 1, bc_type=(rest, rest))
    long = np.diff(times)
    powers = [
        found(times[:-1], nu=j) * (long**j / math.factorial(j))[:, None] for j in range(2 * r)
    ]
    return Trajectory(times, np.stack(powers, axis=1))


def programmed(model, durations):
    """The best trajectory by a solver of quadratic programs; None without a solution."""
    at = model.at(np.concatenate([[0.0], np.cumsum(durations)]))
    written, backend = at.formulate("legendre"), find_backend("daqp")
    while written is not None:
        answer = backend.run(written.program, Request())
        if answer.termination != "optimal":
            return None
        found, written = written, written.refined(answer.point, 1e-6)
    return found.decode(answer.point)


def best_times(model, inner, *, accuracy=1e-9, restarts=8):
    """The least objective and its durations: simplexes, each from the best point of the one before."""
    total = model.total_time

    def durations(x):
        share = np.exp(x if total is None else np.append(x, 0.0))
        return share if total is None else share * (total / share.sum())

    def value(x):
        plan = inner(model, durations(x))
        return 1e100 if plan is None else model.objective(plan)

    length = np.linalg.norm(np.diff(model.waypoints, axis=0), axis=1)
    if total is None:
        x = min((np.log(length * f) for f in 2.0 ** np.arange(-4, 9)), key=value)
    else:
        x = np.log(length[:-1] / length[-1])
    least, spread = np.inf, 0.3
    for _ in range(restarts + 1):
        corners = np.vstack([x, x + spread * np.eye(x.size)])
        found = minimize(
            value, x, method="Nelder-Mead",
            options={
                "initial_simplex": corners, "xatol": 1e-6, "fatol": accuracy * min(least, value(x))
            },
        )  # fmt: skip
        x, gained, least = found.x, least - found.fun, found.fun
        spread = max(0.5 * spread, 0.02)
        if gained <= 10 * accuracy * least:
            break
    return least, durations(x)
