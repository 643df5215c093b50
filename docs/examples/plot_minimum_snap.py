"""
From waypoints to a vehicle
===========================

This example plans a trajectory of a small quadrotor through seven waypoints. It computes times and
the smoothest trajectory, adds limits and a corridor, diagnoses infeasible limits, compares three
solvers, and writes the trajectory as a file for a Crazyflie. Finally it reads the file back and
verifies it.
"""

# %%
# Waypoints and initial times
# ---------------------------
# The waypoints form a round trip, with x, y and z in metres. The *distance rule* assigns each
# segment the time for a constant mean speed, plus time to start and to stop.

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
# plan is callable: ``plan(t)`` is the position, ``plan(t, derivative)`` any derivative.

path = first.plan
print("at 2.5 s:     ", path(2.5).round(3), "m")
print("velocity:     ", path(2.5, 1).round(3), "m/s")
extremes = path.extremes(1)
fastest = max(extremes.largest.max(), -extremes.least.min())
print(f"fastest along one axis: {fastest:.3f} m/s")

# %%
# The verification recomputes the waypoints, rest at the ends and continuity from the polynomials.

print(first.verification)

# %%
# Optimal times
# -------------
# The cost depends strongly on the times. With :class:`~crosstrack.models.TimeAllocation` they are
# variables. Here the total time is fixed, and its distribution is optimised.

allocation = TimeAllocation(waypoints, total_time=float(times[-1]), name="times by descent")
better = ct.solve(allocation)
print(better)
print("durations by distance:", guess.durations.round(2).tolist())
print("durations found:      ", better.plan.durations.round(2).tolist())
print(f"cost: {better.primal_bound / first.primal_bound:.1%} of what the first guess costs")
assert better.primal_bound < first.primal_bound

# %%
# If the total time is also free, each second has a price. The optimum satisfies the identity
# ``price * total = 7 * cost``, which the solver does not use, so the identity is an independent
# check.

priced = TimeAllocation(waypoints, time_weight=5.0, name="5 a second")
chosen = ct.solve(priced)
print(chosen)
print(f"{chosen.plan.duration:.3f} s in all")
print(f"the identity holds to {priced.identity_residual(chosen.plan):.1e}")

# %%
# The problem is not convex, and the solution is a local optimum. In the rest of the example the
# times are fixed, rounded to the millisecond.

model = MinimumSnap(waypoints, chosen.plan.times.round(3), name="round trip")
free = ct.solve(model)
figure = ct.plot(model, free.plan)

# %%
# Limits and a corridor
# ---------------------
# The corridor is a box around each segment with a margin of 3 cm. Velocity and acceleration are
# limited in every component. The limits hold at every instant, not only at samples.

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
# Infeasible limits
# -----------------
# At 1 m/s, one segment is too long for its time. The search proves infeasibility, and the diagnosis
# names the segment, the axis and the bound.

hasty = replace(narrow, velocity_limit=1.0, name="round trip, too fast")
print(ct.solve(hasty))
print(ct.diagnose(hasty))

# %%
# Compare three solvers
# ---------------------
# The comparison includes the native interior-point method and two general QP solvers, each in its
# own process. They share neither code nor a formulation. The corridor is enforced at instants,
# which are added until all violations are at rounding level, as the verdict requires.

comparison = ct.compare(
    [narrow],
    ["interior-point", "clarabel:legendre", "piqp:monomial"],
    time_limit=30,
)
print(comparison)
assert comparison.outcome == "AGREED"

# %%
# Export to a Crazyflie
# ---------------------
# A Crazyflie follows polynomials of degree 7 in seconds, with one line per segment. Its firmware
# stores 4-byte floats, so the pieces no longer join exactly; the report states the error.

folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "round-trip.csv"
report = write_poly7(best.plan, file, yaw=0.0)
print(str(report).replace(str(file), file.name))
print(file.read_text().splitlines()[0][:60], "…")
print(file.read_text().splitlines()[1][:60], "…")

# %%
# The commands ``crosstrack solve … --output plan.json`` and ``crosstrack export`` do the same.
#
# The file can be read back and verified as a plan. It has a fourth axis, yaw, which the model does
# not contain. Seven digits are not enough for the usual tolerance of 1e-6, so this check uses 1e-5.
# The effect of rounding is shown as *within tolerance*.

flown = read_poly7(file)
position = Trajectory(flown.times, flown.coefficients[:, :, :3])
again = ct.verify(narrow, position, tolerance=1e-5)
print(again)
assert again.ok
folder.cleanup()

# %%
# The memory of the firmware has room for 31 pieces. A longer path is written with a warning in the
# report, because other ways to load it exist. ``strict=True`` raises an error instead.

long = ct.solve(random_walk(40, seed=1)).plan
with tempfile.TemporaryDirectory() as other:
    try:
        write_poly7(long, Path(other) / "long.csv", strict=True)
    except ct.CrosstrackError as error:
        print(error)
    roomy = write_poly7(long, Path(other) / "long.csv")
print("pieces:", roomy.pieces, "fits:", roomy.fits)
