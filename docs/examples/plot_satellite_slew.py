"""
A 45° slew that never meets a singularity
=========================================

A satellite with four control moment gyros turns by 45° about its roll axis, from rest to rest, in the
least time. On the way the gyros may not get near a singularity, where they give no torque in some
direction. This example solves the paper's problem, draws the paper's pictures, sets the steering laws
of the field beside it, and flies the plan with the paper's controller, disturbed.
"""

# %%
# The problem
# -----------
# Eleven states: the quaternion, the body rates and the gimbal angles. The controls are the gimbal
# rates. The limits of rate and torque bound the norms. The paper prints neither the momentum of the wheels
# nor the weight of the gimbal rates; with those of this instance its final time results.

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import crosstrack as ct
from crosstrack.instances import entries
from crosstrack.models import track
from crosstrack.models.satellite_slew.gyros import singularity_measure
from crosstrack.models.satellite_slew.plot import (
    PAPER_QUATERNION_ERROR,
    PAPER_RATE_ERROR,
    animate_slew,
)

model = ct.load("satellite-slew/paper")
print(model)
print(
    "limits:",
    model.rate_limit,
    "rad/s,",
    model.gimbal_rate_limit,
    "rad/s,",
    model.torque_limit,
    "N m",
)
print("ends at q =", model.final_attitude.round(5).tolist())

# %%
# The answer
# ----------
# The tolerance of this page is 1e-4, so that it is built in seconds. The mesh is refined until the
# verification, which integrates the gimbal rates anew and looks between the nodes, is satisfied.

TOLERANCE = 1e-4
best = ct.solve(model, formulation="gauss", tolerance=TOLERANCE)
print(best)
print(best.verification)

# %%
# Beside the paper's figures:

published = next(entry.published for entry in entries() if entry.name == "satellite-slew/paper")
print(f"final time:        paper {published['final_time']} s, here {best.plan.end:.3f} s")
print(
    f"seconds computing: paper {published['computing_seconds']:.0f}, here {best.seconds['total']:.1f}"
)
assert abs(best.plan.end - published["final_time"]) < 0.02

# %%
# The paper's pictures. The norm of the body rates, the gimbal rates and the norm of the torque run along
# their limits, and the singularity measure touches its own.

figure = ct.plot(model, best, tolerance=TOLERANCE)

# %%
# The quickest turn is no turn about one axis: the roll axis leaves its place and comes back to it.
# ``animate_slew`` shows it in motion, from a place that turns around it.

axes = ct.plot(model, best, view="axis", tolerance=TOLERANCE)
with TemporaryDirectory() as folder:
    file = Path(folder) / "slew.gif"
    animate_slew(model, best, frames=12, size=(3.2, 3.0)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")

# %%
# Beside the steering laws
# ------------------------
# Without optimal control, a satellite turns about one axis, and a *steering law* makes gimbal rates of
# the torque that this asks for. These backends look for the fastest such turn that keeps all limits.
# What they find is verified like any other plan. Another transcription, Radau's instead of Gauss's, is
# there as a cross-check.

comparison = ct.compare(
    [model],
    ["ipopt:radau", "slew-pseudo-inverse", "slew-singularity-robust"],
    tolerance=TOLERANCE,
    time_limit=60,
)
print(comparison)
for solution in comparison.verdicts[0].solutions:
    plan = solution.plan
    least = singularity_measure(plan["delta"](plan.grid(2001)), model.beta).min()
    print(f"{solution.backend:24} {plan.end:7.3f} s, least measure of singularity {least:.3f}")

# %%
# No backend proves a global bound here, so the verdict stays inconclusive. The laws take much longer.
# The other transcription may have stopped elsewhere: a solver that reports success is at *a* local
# optimum, and this problem has several. ``starts=`` draws more starts by seed, and keeps them all.

law = comparison.verdicts[0].solutions[1]
assert law.plan.end > 1.2 * best.plan.end
steered = ct.plot(model, law, tolerance=TOLERANCE)

several = ct.solve(model, formulation="radau", tolerance=TOLERANCE, starts=2, seed=1)
for start in several.starts:
    print(f"{start.termination}: J = {start.primal_bound:.6f} s")
print(
    f"relative difference of the two transcriptions: {several.primal_bound / best.primal_bound - 1:+.1e}"
)

# %%
# Tracking
# --------
# A controller with the torque of the paper's eq. 32 flies the plan, fifty times a second, under a
# disturbance that it does not know. At the limits of the actuators little is left for corrections. A
# sample is *saturated* if a limit cut the command. ``law="paper"`` has the printed gain, and knows the
# disturbance.

push = (-0.1, -0.1, -0.1)
at_the_limits = track(model, best, disturbance=push, after=2.0)
print(at_the_limits)
tight = ct.plot(model, best, tracking=at_the_limits, tolerance=TOLERANCE)

# %%
# So plan with a reserve. It costs little time,

careful = replace(model, margin=0.1)
reserved = ct.solve(careful, formulation="gauss", tolerance=TOLERANCE)
print(reserved)
print(f"10 % in reserve cost {reserved.plan.end / best.plan.end - 1:.1%} of time")

# %%
# and the errors stay where the paper has them. Small errors are no verdict, though: the flight is
# verified as well, and its last words name the limit that breaks first. This torque has led the gimbals
# nearer to a singularity than the plan went.

flight = track(careful, reserved, disturbance=push, after=2.0)
print(flight)
print(flight.verification)
assert flight.breach is not None
assert flight.breach.name == "singularity measure"
assert flight.max_quaternion_error < PAPER_QUATERNION_ERROR
assert flight.max_rate_error < PAPER_RATE_ERROR
tracked = ct.plot(careful, reserved, tracking=flight, tolerance=TOLERANCE)

# %%
# A plan that keeps farther away from singularities, for a satellite that may go as near as before, leaves
# room for that.

wary = ct.solve(replace(careful, singularity_limit=0.4), formulation="gauss", tolerance=TOLERANCE)
print(f"keeping away costs {wary.plan.end / reserved.plan.end - 1:.1%} of time")
sure = track(careful, wary, disturbance=push, after=2.0)
print(sure)
assert sure.ok

# %%
# How much this covers is a matter of trying. A disturbance may be a function of time, and the true
# inertia may differ from the model's, by a share or by a matrix:

for error in (-0.02, 0.0, 0.02):
    flown = track(
        careful, wary, disturbance=lambda t: 0.1 * np.sin([t, 2 * t, 3 * t]),
        inertia_error=error,
    )  # fmt: skip
    print(f"inertia {error:+.0%}: {flown}")
