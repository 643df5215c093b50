"""
A way through what is not known
===============================

A vehicle is to reach a target on a map that nobody has. A UAV above it shows the cells around it, and a policy
decides step by step. This example draws a trap by hand, leads the vehicle by policies that remember and by
one that does not, compares them with the shortest way on the true map, and writes a policy of its own.
"""

# %%
# A trap
# ------
# Obstacles are ``@``. The vehicle starts at ``S``, and the straight way to ``T`` leads into a pocket that is deeper than
# the view of 5 × 5 cells. The true map is hidden from policies: what they know is the size of the map, where the target
# lies, and what the UAV has shown.

import numpy as np

import crosstrack as ct
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid.plan import STEPS
from crosstrack.models.unknown_grid.plot import animate_run
from crosstrack.models.unknown_grid.world import BLOCKED
from crosstrack.solvers.unknown_grid.native import NavigationBackend

trap = UnknownGridNavigation.drawn(
    [
        "..............",
        "...@@@@@@@@...",
        "..........@...",
        "..........@...",
        "S.........@..T",
        "..........@...",
        "...@@@@@@@@...",
        "..............",
    ],
    view=(5, 5),
    steps=150,
    uav="follow",
    name="trap",
)
print(trap)
print(ct.diagnose(trap))

# %%
# D* Lite takes what it has not seen as free, goes the shortest way on what it knows, and repairs that way when an obstacle
# comes into view. It enters the pocket, sees that it is closed, and leaves it. What the UAV has not shown is tinted.

remembering = ct.solve(trap, "d-star-lite")
print(remembering.summary())
picture = ct.plot(trap, remembering)

# %%
# Why memory helps
# ----------------
# The same rule with the current view alone, and the paper's first baseline, which goes to the visible cell nearest the
# target. In the pocket the first walks to and fro: as soon as one end of the wall is out of sight, it seems open again. The
# second stays where it is nearest the target.

forgetting = ct.solve(trap, "current-view")
nearest = ct.solve(trap, "baseline-1")
for found in (remembering, forgetting, nearest):
    print(f"{found.backend}: {found.plan}")
contrast = ct.plot(trap, forgetting, moments=[8, 9, 10, 11, 12, 150])

# %%
# Nobody can know beforehand that the pocket is closed. The backend ``oracle`` sees the true map and tells what the
# shortest way would have been. That bounds every policy, and the verdict says how far above it each one ends.

best = ct.solve(trap, "oracle")
together = ct.plot(
    trap, remembering, others={"oracle": best, "current-view": forgetting}, moments=0
)
print(ct.compare([trap], ["d-star-lite", "current-view", "baseline-1", "oracle"]))

# %%
# A policy of your own
# --------------------
# A policy is a class with one method: it is shown the views of the scenes that still go on, and answers with an action
# for each, 0 to 3 for up, down, left and right. This one remembers no walls, but how far every cell seems to be from
# the target: at least one step more than the nearest of its neighbours. That is enough to get out of any trap
# (R. E. Korf, Real-time heuristic search, 1990).


class Values:
    """Go to the neighbour that seems nearest, and correct what was believed of the cell that is left."""

    def __init__(self, problem, scene):
        cells = np.moveaxis(np.indices(problem.shape), 0, -1)
        self.left = np.abs(cells - problem.targets[scene]).sum(axis=-1)

    def decide(self, looks):
        here, middle = looks.positions[0], np.array(looks.view[0].shape) // 2
        free = [a for a in range(4) if looks.view[0][tuple(middle + STEPS[a])] != BLOCKED]
        action = min(free, key=lambda a: self.left[tuple(here + STEPS[a])])
        self.left[tuple(here)] = 1 + self.left[tuple(here + STEPS[action])]
        return np.array([action])


class LearningRealTime(NavigationBackend):
    """The backend that leads the vehicle by it."""

    name = "learning-real-time"
    summary = "learning real-time A*"

    def policy(self, problem, scenes, request):
        """Return what decides in one scene."""
        return Values(problem, int(scenes[0]))


own = ct.solve(trap, LearningRealTime())
print(own.plan)

# %%
# It takes longer than D* Lite, which remembers what it saw farther away. Its run is checked like all others: what it claims
# is walked again on the true map.

film = animate_run(trap, own, frames=8, size=(4.2, 4.0))
film.save("run.gif", writer="pillow", dpi=60)

# %%
# Many scenes
# -----------
# One scene says little. The catalogue has scenes that are drawn by laws, and the mean over scenes is the objective. The lower
# panel tells in how many of them the target was reached within how many steps.

scenes = ct.load("unknown-grid/u-traps")
runs = {name: ct.solve(scenes, name) for name in ("d-star-lite", "current-view", "baseline-1")}
for name, found in runs.items():
    score = scenes.score(found)
    print(
        f"{name}: {score.reached} of {score.scenes} reached, {score.collisions} collisions, {score.ratio:.3f} times "
        "the steps of the shortest ways"
    )
others = {name: found for name, found in runs.items() if name != "d-star-lite"}
panel = ct.plot(scenes, runs["d-star-lite"], scene=3, others=others)

# %%
# Where there is no way, a policy that remembers can say so: once all that can be reached is known to be
# enclosed. The claim is checked, and ``diagnose`` names what encloses the target.

closed = ct.load("unknown-grid/no-way")
print(ct.solve(closed, "d-star-lite").plan)
print(ct.diagnose(closed))
