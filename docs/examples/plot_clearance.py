"""
A path with a clearance
=======================

A path from (0, 0) to (10, 0) has two waypoints. It must keep a clearance of 0.3 m to three round
obstacles. The length is the objective, and the lack of clearance is a constraint.
"""

import matplotlib.pyplot as plt
import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation

OBSTACLES = np.array([[3.0, 0.2, 1.0], [6.0, -0.8, 1.2], [7.0, 2.2, 0.8]])  # x, y, radius in m
CLEARANCE = 0.3


def line_of(x):
    """Return the points of the path."""
    return np.array([[0, 0], x[:2], x[2:], [10, 0]])


def clearance_of(line):
    """Return the distance of a path to the nearest obstacle."""
    begin, side = line[:-1, None], np.diff(line, axis=0)[:, None]
    towards = OBSTACLES[:, :2] - begin
    share = (towards * side).sum(2) / np.maximum((side**2).sum(2), 1e-12)
    nearest = begin + np.clip(share, 0, 1)[..., None] * side
    return float((np.linalg.norm(nearest - OBSTACLES[:, :2], axis=2) - OBSTACLES[:, 2]).min())


def path(x):
    """Return the length in m and the lack of clearance in m."""
    line = line_of(x)
    return [np.linalg.norm(np.diff(line, axis=0), axis=1).sum(), CLEARANCE - clearance_of(line)]


problem = BlackBoxMinimisation(
    path,
    bounds=[[0, 10], [-4, 4], [0, 10], [-4, 4]],
    inequalities=1,
    budget=6000,
    name="path",
)
shortest = ct.solve(problem, "cma-es", seed=1)
print(shortest.summary())
assert shortest.verification.ok

# %%
# Evaluations prove no bound, so a comparison of two searches names the better plan and stays inconclusive.

print(ct.compare([problem], ["cma-es", "differential-evolution"], seed=1, evaluations=2000))

# %%
# The obstacles, with the clearance around them, and the path.

scene, axes = plt.subplots(layout="constrained")
for x, y, radius in OBSTACLES:
    axes.add_patch(plt.Circle((x, y), radius, color="grey"))
    axes.add_patch(plt.Circle((x, y), radius + CLEARANCE, fill=False, ls="--", color="red"))
axes.plot(*line_of(np.array(shortest.plan.x)).T, marker="o")
axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")

# %%
# Length and clearance are two objectives as well. The front shows the price of each decimetre. It needs the extra
# ``blackbox``. The reference contains values that are just not acceptable.

trade = BlackBoxMinimisation(
    lambda x: [path(x)[0], -clearance_of(line_of(x)), -clearance_of(line_of(x))],
    bounds=problem.bounds,
    objectives=2,
    inequalities=1,
    reference=[13.0, 0.0],
    budget=6000,
    name="length against clearance",
)
front = ct.solve(trade, "nsga-ii", seed=1)
print(front.summary())
trade_off = ct.plot(trade, front)
