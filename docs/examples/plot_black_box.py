"""
Black-box optimisation
======================

A black-box problem minimises a function of bounded variables that can only be evaluated, with a
given number of evaluations. This example declares such a function, compares several methods at
equal evaluations, shows the effect of a shifted optimum, and plans a robot's path, a problem with a
better exact method.
"""

# %%
# Declare a function
# ------------------
# Any Python callable can be a black box. This one has two valleys, ripples, and a region without a
# value.

import math

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation, GridMap, GridPath
from crosstrack.models.black_box import as_grid_plan, path_problem


def drag(x):
    """Return the drag, or NaN outside the domain."""
    width, slope = x
    if width * slope > 4:
        return math.nan
    return (width - 3 * math.sin(slope)) ** 2 + 0.1 * math.cos(9 * slope) + 0.05 * slope**2


model = BlackBoxMinimisation(drag, bounds=[[0, 5], [-2, 2]], budget=2000, name="drag")
print(model)
print(ct.diagnose(model))

# %%
# The backend runs in its own process and receives only the bounds and the requested values. The
# process with the function counts the evaluations.

best = ct.solve(model, seed=1)
print(best.summary())
landscape = ct.plot(model, best)

# %%
# Compare methods at equal evaluations
# ------------------------------------
# Each method runs with three seeds. Function values cannot prove optimality, so the verdict is
# inconclusive even if the methods agree.

comparison = ct.compare(
    [model], ["differential-evolution", "iafsa", "random-search"], seed=1, repeats=3
)
print(comparison)
assert comparison.outcome == "INCONCLUSIVE"

# %%
# Shifted optimum
# ---------------
# The improved swarm of the paper multiplies each position by a factor below 1. This is a bias
# towards the origin, where many test functions have their minimum. After a shift of the optimum,
# the advantage disappears. The hybrid swarm that the paper compares with has no such bias.


def result_of(instance, backend):
    """Return the best value of a swarm."""
    return ct.solve(ct.load(instance), backend, seed=1, evaluations=5000).primal_bound


for backend in ("iafsa", "haafsa"):
    plain, moved = (
        result_of(f"black-box/sum-squares-10{name}", backend) for name in ("", "-shifted")
    )
    print(f"{backend}: {plain:.3g} at the origin, {moved:.3g} elsewhere")

# %%
# Path of a robot
# ---------------
# The coordinates of four waypoints are eight variables. The objective is the length of the path
# plus a penalty inside obstacles. The objective has a kink at the border of an obstacle.
# Gradient-following methods, such as the default, may therefore end slightly inside it.
# Differential evolution does not use gradients.

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
# The grid model verifies the path, and also finds the shortest path with a proof in a moment.
# Waypoints are therefore a test for black-box methods, not a way to plan paths.

checked = asked.verify(as_grid_plan(robot, path.plan))
shortest = ct.solve(asked)
print(f"waypoints: {checked.objective:.4f} m, free: {checked.ok}")
print(f"exact:     {shortest.primal_bound:.4f} m, gap {shortest.gap:.1%}")
assert path.primal_bound >= shortest.primal_bound - 1e-9
