"""
One question, two kinds of answer
=================================

How long should each part of a trajectory last? The model of the trajectory knows its gradient; a black box
knows values only. Both are asked the same question here, and the answers check one another.
"""

# %%
# With the structure
# ------------------
# Four waypoints in ten seconds: two times in between are free.

import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation, MinimumSnap, TimeAllocation

points = np.array([[0.0, 0.0], [1.0, 2.0], [4.0, 2.0], [5.0, 0.0]])
free = TimeAllocation(points, total_time=10.0, name="with its structure")
known = ct.solve(free)
print(known)
print("times:", np.round(known.plan.times, 4))

# %%
# Without it
# ----------
# A function of two numbers: the shares of the time. Each value solves a minimum-snap problem exactly, whose
# answer is verified like any other.


def snap(shares):
    first, second = shares
    times = 10.0 * np.array([0.0, first, first + (1 - first) * second, 1.0])
    return ct.solve(MinimumSnap(points, times)).primal_bound


box = BlackBoxMinimisation(snap, [[0.05, 0.95], [0.05, 0.95]], budget=300, name="as a black box")
found = ct.solve(box, "differential-evolution", seed=1)
print(found)

# %%
# The same least value, to what 300 values can tell:

apart = found.primal_bound / known.primal_bound - 1
print(f"{apart:.1e} above, after {found.statistics.get('evaluations')} values")
assert -1e-6 < apart < 1e-2

# %%
# Several searches, several seeds
# -------------------------------
# What draws is judged over seeds: medians, quartiles and successes.

result = ct.compare(
    box, ["differential-evolution", "cma-es", "direct"], seed=0, repeats=3, time_limit=30
)
print(result)

# %%
# The trajectory with the best times.

picture = ct.plot(free, known, title="Four waypoints in ten seconds, times chosen")

# %%
# What to try next: a limit of velocity, which the black box would have to learn as a penalty and the model
# has as a field; or :doc:`plot_black_box`, where the black box is a path among obstacles.
