"""
Navigation on an unknown map
============================

A vehicle must reach a target on an unknown map. A UAV above it observes the surrounding cells, and
a policy decides each step. This example declares a trap, compares policies with and without memory
with the shortest path on the true map, and implements a new policy.
"""

# %%
# Declare a trap
# --------------
# Obstacles are ``@``. The vehicle starts at ``S``, and the straight path to ``T`` leads into a
# pocket that is deeper than the view of 5 × 5 cells. The true map is hidden from policies. They
# receive the size of the map, the position of the target and the observations of the UAV.

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
# D* Lite treats unobserved cells as free, follows the shortest path on the known map, and repairs
# the path when an obstacle comes into view. It enters the pocket, observes that it is closed, and
# leaves it. Unobserved cells are tinted.

remembering = ct.solve(trap, "d-star-lite")
print(remembering.summary())
picture = ct.plot(trap, remembering)

# %%
# Why memory helps
# ----------------
# ``current-view`` uses the same rule on the current view only, and ``baseline-1`` is the paper's
# first baseline, which moves to the visible cell nearest to the target. In the pocket,
# ``current-view`` oscillates: when one end of the wall leaves the view, it is treated as free
# again. ``baseline-1`` stays at the cell nearest to the target.

forgetting = ct.solve(trap, "current-view")
nearest = ct.solve(trap, "baseline-1")
for found in (remembering, forgetting, nearest):
    print(f"{found.backend}: {found.plan}")
contrast = ct.plot(trap, forgetting, moments=[8, 9, 10, 11, 12, 150])

# %%
# No policy can know in advance that the pocket is closed. The backend ``oracle`` reads the true map
# and returns the shortest path, which is a bound for every policy. The verdict states the distance
# of each policy to it.

best = ct.solve(trap, "oracle")
together = ct.plot(
    trap, remembering, others={"oracle": best, "current-view": forgetting}, moments=0
)
print(ct.compare([trap], ["d-star-lite", "current-view", "baseline-1", "oracle"]))

# %%
# Implement a policy
# ------------------
# A policy is a class with one method. It receives the views of the active scenes and returns one
# action per scene: 0 to 3 for up, down, left and right. This policy stores no walls, but an
# estimate of the distance from every cell to the target, which is at least one step more than the
# smallest estimate of its neighbours. This is enough to leave any trap (R. E. Korf, Real-time
# heuristic search, 1990).


class Values:
    """Policy that moves to the neighbour with the smallest estimate and updates the estimate."""

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
    """Backend that applies the policy."""

    name = "learning-real-time"
    summary = "learning real-time A*"

    def policy(self, problem, scenes, request):
        """Return the policy for one scene."""
        return Values(problem, int(scenes[0]))


own = ct.solve(trap, LearningRealTime())
print(own.plan)

# %%
# It needs more steps than D* Lite, which remembers all observed cells. The verification replays its
# steps on the true map.

film = animate_run(trap, own, frames=8, size=(4.2, 4.0))
film.save("run.gif", writer="pillow", dpi=60)

# %%
# Evaluate on many scenes
# -----------------------
# The catalogue contains sets of random scenes, and the objective is the mean over scenes. The lower
# panel shows the number of targets reached within a given number of steps.

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
# If the target is unreachable, a policy with memory can claim this as soon as the known obstacles
# enclose all reachable cells. The claim is verified, and ``diagnose`` names the enclosing
# obstacles.

closed = ct.load("unknown-grid/no-way")
print(ct.solve(closed, "d-star-lite").plan)
print(ct.diagnose(closed))
