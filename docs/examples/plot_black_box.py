"""
A black box, and a robot in one
===============================

A function that is only known by its values is minimised within bounds, in a given number of evaluations. This example
declares one of one's own, compares searches at equal evaluations, shows what a moved optimum tells of a
search, and ends with a robot's path, for which there is something better.
"""

# %%
# One's own function
# ------------------
# Anything that Python can call is a black box. This one has two valleys, ripples, and a region without a value.

import math

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation, GridMap, GridPath
from crosstrack.models.black_box import as_grid_plan, path_problem


def drag(x):
    """Return a value, or NaN where there is no such thing."""
    width, slope = x
    if width * slope > 4:
        return math.nan
    return (width - 3 * math.sin(slope)) ** 2 + 0.1 * math.cos(9 * slope) + 0.05 * slope**2


model = BlackBoxMinimisation(drag, bounds=[[0, 5], [-2, 2]], budget=2000, name="drag")
print(model)
print(ct.diagnose(model))

# %%
# A search sees the bounds and gets values; it runs in a process of its own, and the values are counted where the
# function is.

best = ct.solve(model, seed=1)
print(best.summary())
landscape = ct.plot(model, best)

# %%
# Several searches, at equal evaluations
# --------------------------------------
# Each runs from three seeds. No value proves that there is no less elsewhere, so the verdict is inconclusive, however well
# they agree.

comparison = ct.compare(
    [model], ["differential-evolution", "iafsa", "random-search"], seed=1, repeats=3
)
print(comparison)
assert comparison.outcome == "INCONCLUSIVE"

# %%
# A moved optimum
# ---------------
# The improved swarm of the paper multiplies each position by a factor below 1. That pulls to the origin, where
# many test functions have their minimum. Move the optimum, and what looked like a strong search is gone. The hybrid swarm that
# the paper compares with has no such pull.


def result_of(instance, backend):
    """Return the best value of a swarm."""
    return ct.solve(ct.load(instance), backend, seed=1, evaluations=5000).primal_bound


for backend in ("iafsa", "haafsa"):
    plain, moved = (
        result_of(f"black-box/sum-squares-10{name}", backend) for name in ("", "-shifted")
    )
    print(f"{backend}: {plain:.3g} at the origin, {moved:.3g} elsewhere")

# %%
# A robot's path
# --------------
# The coordinates of four waypoints are eight variables. The value is the length of the path, and more where it
# leads through what is blocked. That bends sharply at the border of an obstacle, where searches that follow slopes, as the
# default does, may end slightly inside it; this one does not follow them.

grid = GridMap(
    [
        "....................",
        "....######..........",
        "....######...####...",
        ".............####...",
        "..####.......####...",
        "..####...###........",
        ".........###........",
        "....................",
    ]
)
asked = GridPath(grid, start=(7, 0), goals=(0, 19), connectivity="any", name="hall")
robot = path_problem(asked, waypoints=4, budget=10_000)
path = ct.solve(robot, "differential-evolution", seed=1)
drawn = ct.plot(robot, path)

# %%
# The model of the map checks that path, and finds the shortest one of all, with a proof and in a moment. So waypoints
# are a test of searches, and not a way to plan paths.

checked = asked.verify(as_grid_plan(robot, path.plan))
shortest = ct.solve(asked)
print(f"waypoints: {checked.objective:.4f} m, free: {checked.ok}")
print(f"exact:     {shortest.primal_bound:.4f} m, gap {shortest.gap:.1%}")
assert path.primal_bound >= shortest.primal_bound - 1e-9
