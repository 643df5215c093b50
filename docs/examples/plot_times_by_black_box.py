"""
Time allocation with and without gradients
==========================================

This example computes the optimal durations of the segments of a trajectory in two ways: with the
trajectory model, which provides gradients, and with a black box, which provides values only. The
results confirm each other.
"""

# %%
# With gradients
# --------------
# The trajectory has four waypoints in ten seconds. The two intermediate times are free.

import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation, MinimumSnap, TimeAllocation

points = np.array([[0.0, 0.0], [1.0, 2.0], [4.0, 2.0], [5.0, 0.0]])
free = TimeAllocation(points, total_time=10.0, name="with its structure")
known = ct.solve(free)
print(known)
print("times:", np.round(known.plan.times, 4))

# %%
# Without gradients
# -----------------
# The black box is a function of two fractions of the total time. Each evaluation solves and
# verifies a minimum-snap problem exactly.


def snap(shares):
    first, second = shares
    times = 10.0 * np.array([0.0, first, first + (1 - first) * second, 1.0])
    return ct.solve(MinimumSnap(points, times)).primal_bound


box = BlackBoxMinimisation(snap, [[0.05, 0.95], [0.05, 0.95]], budget=300, name="as a black box")
found = ct.solve(box, "differential-evolution", seed=1)
print(found)

# %%
# Both find the same minimum, up to the accuracy of 300 evaluations:

apart = found.primal_bound / known.primal_bound - 1
print(f"{apart:.1e} above, after {found.statistics.get('evaluations')} values")
assert -1e-6 < apart < 1e-2

# %%
# Several searches, several seeds
# -------------------------------
# Randomised backends run with several seeds. The comparison reports medians, quartiles and success
# rates.

result = ct.compare(
    box, ["differential-evolution", "cma-es", "direct"], seed=0, repeats=3, time_limit=30
)
print(result)

# %%
# Draw the trajectory with the optimal times:

picture = ct.plot(free, known, title="Four waypoints in ten seconds, times chosen")

# %%
# Next steps: add a velocity limit, which is a field of the model but needs a penalty in the black
# box; or see :doc:`plot_black_box`, with a path among obstacles.
