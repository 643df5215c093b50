"""
The sideslip angle of a vehicle
===============================

No sensor of a car measures its sideslip angle, the angle between where it points and where it moves. This example estimates it
on a double lane change from what the car measures anyway: by a model of the vehicle, by what other drives
teach, and by both. Then the vehicle is believed wrong, and the roles are exchanged.
"""

# %%
# A drive
# -------
# The instance is simulated: a driver steers through a double lane change at 80 km/h, and yaw rate and lateral
# acceleration are measured with noise. Fifteen other drivers have driven it before, in a car whose angle was known.

import dataclasses

import numpy as np

import crosstrack as ct

model = ct.load("sideslip/lane-change")
print(model)
print(ct.diagnose(model))

# %%
# A Kalman filter knows the vehicle and no other drive. The truth is hidden from it; the verification
# measures how far the estimate is from it, and how often it lies within two of the deviations that the filter claims.

filtered = ct.solve(model, "kalman-filter")
print(filtered.summary())
print(f"within 2 deviations: {model.coverage(filtered):.1%}")

# %%
# The paper's network, a kernel regression, knows other drives and no vehicle. The paper estimates the angle from the five
# samples before it, and without speed and steering angle.

learned = ct.solve(model, "grnn", backend_options={"ahead": 1, "inputs": False})
picture = ct.plot(model, filtered, others={"grnn": learned})

# %%
# When the vehicle is believed wrong
# ----------------------------------
# The same drive, but estimators believe in a car that is 30 % heavier, on tyres that are 30 % softer. The filter
# uses a lateral acceleration that its car cannot explain. What learns does not notice. The filter notices, and says
# so: the deviations that it claims grow with its error.

wrong = ct.load("sideslip/lane-change-mismatch")
print(ct.diagnose(wrong).findings[0].text)
misled = ct.solve(wrong, "kalman-filter")
print(misled.message)
both = ct.solve(wrong, "kalman-grnn")
contrast = ct.plot(wrong, misled, others={"kalman-grnn": both})

# %%
# Nobody proves an angle. Estimators that know different things are compared with one another instead: where they agree
# within 0.1° on average the verdict is ``AGREED``, otherwise somebody is wrong, and which one remains open.

names = ["rts-smoother", "kalman-filter", "grnn", "linear-regression"]
agreed, torn = ct.compare([model], names), ct.compare([wrong], names)
print(agreed)
print(torn)
assert (agreed.outcome, torn.outcome) == ("AGREED", "INCONCLUSIVE")

# %%
# How wrong may the vehicle be?
# -----------------------------
# The believed mass is varied, and nothing else. The floor is a linear regression on the other drives.

floor = model.verify(ct.solve(model, "linear-regression").plan).objective
for factor in (1.0, 1.05, 1.1, 1.2, 1.4):
    car = dataclasses.replace(model.vehicle, mass=factor * model.vehicle.mass)
    asked = dataclasses.replace(model, vehicle=car)
    found = ct.solve(asked, "kalman-filter")
    share = asked.coverage(found)
    print(
        f"mass × {factor:4.2f}: error {found.primal_bound:.3f}°, claimed {np.degrees(np.median(found.plan.deviation)):.3f}°, "
        f"{share:.0%} within 2 deviations"
    )
print(f"linear regression: {floor:.3f}°, whatever the mass")
