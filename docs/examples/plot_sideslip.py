"""
Estimate the sideslip angle of a vehicle
========================================

The sideslip angle is the angle between a car's heading and its direction of motion. Standard
sensors do not measure it. This example estimates it on a double lane change with a vehicle model,
with a regression learned from other drives, and with both. It then repeats the estimation with
wrong vehicle parameters.
"""

# %%
# A drive
# -------
# The instance is simulated: a driver steers through a double lane change at 80 km/h, and yaw rate
# and lateral acceleration are measured with noise. The training data contains drives of fifteen
# other drivers with known angle.

import dataclasses

import numpy as np

import crosstrack as ct

model = ct.load("sideslip/lane-change")
print(model)
print(ct.diagnose(model))

# %%
# A Kalman filter uses the vehicle model and no training data. The true angle is hidden from it. The
# verification computes the error of the estimate and how often it is within two of the filter's
# standard deviations.

filtered = ct.solve(model, "kalman-filter")
print(filtered.summary())
print(f"within 2 deviations: {model.coverage(filtered):.1%}")

# %%
# The paper's network, a kernel regression, uses the training data and no vehicle model. The paper
# estimates the angle from its five preceding samples, without speed and steering angle.

learned = ct.solve(model, "grnn", backend_options={"ahead": 1, "inputs": False})
picture = ct.plot(model, filtered, others={"grnn": learned})

# %%
# Wrong vehicle parameters
# ------------------------
# In this instance of the same drive, the estimators use a car that is 30 % heavier, with tyres that
# are 30 % softer. The measured lateral acceleration is inconsistent with this model. Learned
# estimators are not affected. The filter detects the inconsistency: its standard deviations grow
# with its error.

wrong = ct.load("sideslip/lane-change-mismatch")
print(ct.diagnose(wrong).findings[0].text)
misled = ct.solve(wrong, "kalman-filter")
print(misled.message)
both = ct.solve(wrong, "kalman-grnn")
contrast = ct.plot(wrong, misled, others={"kalman-grnn": both})

# %%
# No backend can prove the angle, so estimators with different information are compared with one
# another. If they agree within 0.1° on average, the verdict is ``AGREED``. Otherwise at least one
# is wrong, and the verdict does not decide which.

names = ["rts-smoother", "kalman-filter", "grnn", "linear-regression"]
agreed, torn = ct.compare([model], names), ct.compare([wrong], names)
print(agreed)
print(torn)
assert (agreed.outcome, torn.outcome) == ("AGREED", "INCONCLUSIVE")

# %%
# Sensitivity to the mass
# -----------------------
# Only the mass in the model is varied. The baseline is a linear regression on the training data.

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
