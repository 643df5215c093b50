"""
From waypoints to a file that flies
===================================

Seven waypoints in a room, and a small quadrotor that shall fly through them. This example finds
times for them, then the smoothest trajectory through them, keeps it within limits and a corridor,
asks what is wrong with limits that cannot be kept, has three solvers check one another, and writes
the file that a Crazyflie flies. At the end that file is read back and checked like any other plan.
"""

# %%
# Waypoints, and a first guess at the times
# -----------------------------------------
# A round trip: x, y and z in metres. The *distance rule* flies every segment at one mean speed, with
# some time added to start and to stop.

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import crosstrack as ct
from crosstrack.instances import read_poly7, times_by_distance, write_poly7
from crosstrack.instances.minimum_snap import random_walk
from crosstrack.models import MinimumSnap, TimeAllocation, Trajectory

waypoints = np.array(
    [
        [0.0, 0.0, 0.4],
        [1.2, 0.3, 0.8],
        [2.0, 1.5, 1.2],
        [1.0, 2.4, 1.4],
        [-0.4, 2.0, 1.0],
        [-0.8, 0.8, 0.7],
        [0.0, 0.0, 0.4],
    ]
)
times = times_by_distance(waypoints, speed=0.8, ramp=0.5)
guess = MinimumSnap(waypoints, times, name="times by distance")
first = ct.solve(guess)
print("times:", times.tolist())
print(first)

# %%
# Without limits the problem is solved directly, in time proportional to the number of segments. The
# plan can be called: ``plan(t)`` is the position, ``plan(t, derivative)`` any derivative.

path = first.plan
print("at 2.5 s:     ", path(2.5).round(3), "m")
print("velocity:     ", path(2.5, 1).round(3), "m/s")
extremes = path.extremes(1)
fastest = max(extremes.largest.max(), -extremes.least.min())
print(f"fastest along one axis: {fastest:.3f} m/s")

# %%
# What was verified: waypoints, ends at rest, and continuity, each recomputed from the polynomials.

print(first.verification)

# %%
# Better times
# ------------
# The times decide most of the cost. With :class:`~crosstrack.models.TimeAllocation` they are part
# of the problem: here the total stays what it was, and only its shares are sought.

allocation = TimeAllocation(waypoints, total_time=float(times[-1]), name="times by descent")
better = ct.solve(allocation)
print(better)
print("durations by distance:", guess.durations.round(2).tolist())
print("durations found:      ", better.plan.durations.round(2).tolist())
print(f"cost: {better.primal_bound / first.primal_bound:.1%} of what the first guess costs")
assert better.primal_bound < first.primal_bound

# %%
# Where the total is free too, a second has a price. The optimum of such a problem obeys an identity
# that no solver was told, ``price * total = 7 * cost``, and so checks the answer from another side.

priced = TimeAllocation(waypoints, time_weight=5.0, name="5 a second")
chosen = ct.solve(priced)
print(chosen)
print(f"{chosen.plan.duration:.3f} s in all")
print(f"the identity holds to {priced.identity_residual(chosen.plan):.1e}")

# %%
# It is a local optimum: the problem is not convex, and the answer does not claim more. From here on
# the times are given, rounded to the millisecond.

model = MinimumSnap(waypoints, chosen.plan.times.round(3), name="round trip")
free = ct.solve(model)
figure = ct.plot(model, free.plan)

# %%
# Limits and a corridor
# ---------------------
# A box around each segment that leaves 3 cm to spare, and a largest velocity and acceleration for
# every component. They hold at every instant, not at samples.

lower = np.minimum(waypoints[:-1], waypoints[1:]) - 0.03
upper = np.maximum(waypoints[:-1], waypoints[1:]) + 0.03
narrow = replace(
    model,
    corridor_lower=lower,
    corridor_upper=upper,
    velocity_limit=1.1,
    acceleration_limit=1.5,
    name="round trip in a corridor",
)
print("the free plan in the corridor:", ct.verify(narrow, free.plan).summary())
best = ct.solve(narrow)
print(best)
print(f"keeping to it costs {best.primal_bound / free.primal_bound - 1:.1%} more")
limited = ct.plot(narrow, best.plan)

# %%
# Limits that cannot be kept
# --------------------------
# At 1 m/s, one of the segments is too long for its time. The search proves that there is no such
# trajectory, and the diagnosis names the segment, the axis and the bound.

hasty = replace(narrow, velocity_limit=1.0, name="round trip, too fast")
print(ct.solve(hasty))
print(ct.diagnose(hasty))

# %%
# Three solvers, one answer
# -------------------------
# Our own interior point and two general solvers of quadratic programs, each in a process of its
# own. They share neither code nor a formulation. A corridor is held at instants that are added
# until nothing sticks out by more than rounding, which is what a verdict wants to see.

comparison = ct.compare(
    [narrow],
    ["interior-point", "clarabel:legendre", "piqp:monomial"],
    time_limit=30,
)
print(comparison)
assert comparison.outcome == "AGREED"

# %%
# The file
# --------
# A Crazyflie flies polynomials of degree 7 in powers of seconds, one line a segment. Its firmware
# stores 4-byte floats, so the pieces no longer meet exactly: the report says by how much.

folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "round-trip.csv"
report = write_poly7(best.plan, file, yaw=0.0)
print(str(report).replace(str(file), file.name))
print(file.read_text().splitlines()[0][:60], "…")
print(file.read_text().splitlines()[1][:60], "…")

# %%
# From a shell, ``crosstrack solve … --output plan.json`` and ``crosstrack export`` do the same.
#
# Read it back and ask the model: what the firmware will fly is a plan like any other. It has a
# fourth axis, yaw, which the model knows nothing of. Seven digits are too few for the usual tolerance
# of 1e-6, so we ask for a hundredth of a millimetre: what rounding has done shows as *within
# tolerance*.

flown = read_poly7(file)
position = Trajectory(flown.times, flown.coefficients[:, :, :3])
again = ct.verify(narrow, position, tolerance=1e-5)
print(again)
assert again.ok
folder.cleanup()

# %%
# The firmware's memory holds 31 such pieces. A longer path is written all the same, with a warning
# in the report, for there are other ways to load it; ``strict=True`` refuses instead.

long = ct.solve(random_walk(40, seed=1)).plan
with tempfile.TemporaryDirectory() as other:
    try:
        write_poly7(long, Path(other) / "long.csv", strict=True)
    except ct.CrosstrackError as error:
        print(error)
    roomy = write_poly7(long, Path(other) / "long.csv")
print("pieces:", roomy.pieces, "fits:", roomy.fits)
