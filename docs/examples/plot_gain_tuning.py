"""
Gains of a controller
=====================

A joint with inertia and friction turns by one radian. The controller has a proportional and a
derivative gain, and the motor has a limited torque and a delay of 20 ms. The objective is the integral of time
times the absolute error (ITAE). The overshoot must be at most 2 %, and the torque must not exceed
its limit for longer than 50 ms. The simulation takes many gains at once.
"""

import matplotlib.pyplot as plt
import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction

STEP, LIMIT, DELAY = 0.005, 8.0, 4
TIMES = STEP * np.arange(1, 401)


def simulate(gains):
    """Return angles and requested torques over 2 s, shapes (steps, m), for gains of shape (m, 2)."""
    angle, speed = np.zeros((2, len(gains)))
    angles, torques = [], [np.zeros(len(gains))] * DELAY
    for _ in TIMES:
        torques.append(gains[:, 0] * (1 - angle) - gains[:, 1] * speed)
        torque = np.clip(torques[-1 - DELAY], -LIMIT, LIMIT)
        speed = speed + STEP * (torque - 0.4 * speed) / 0.15
        angle = angle + STEP * speed
        angles.append(angle)
    return np.array(angles), np.array(torques[DELAY:])


def tracking(gains):
    """Return the ITAE in rad s², the overshoot above 2 %, and the time of saturation above 50 ms."""
    angles, torques = simulate(gains)
    error = (np.abs(1 - angles) * TIMES[:, None]).sum(0) * STEP
    saturated = STEP * (np.abs(torques) > LIMIT).sum(0)
    return np.column_stack([error, angles.max(0) - 1.02, saturated - 0.05])


problem = BlackBoxMinimisation(
    PythonFunction(tracking, vectorized=True),
    bounds=[[0.5, 30], [0, 3]],
    inequalities=2,
    budget=200,
    name="gains",
)

# %%
# The inequalities must hold exactly. The default search divides 200 evaluations between local quadratic models, an
# evolution strategy and Gaussian processes of the objective and of each constraint.

tuned = ct.solve(problem, seed=1)
print(tuned.summary())
assert tuned.verification.ok

# %%
# Evaluations prove no bound, so a comparison of two searches names the better plan and stays inconclusive.

print(ct.compare([problem], ["cobyqa", "differential-evolution"], seed=1))

# %%
# The veil with the red border covers gains that violate a constraint.

landscape = ct.plot(problem, tuned, points=61)

# %%
# The response of the joint for the best gains, and for the centre of the bounds, which violates both constraints.

angles, torques = simulate(np.array([tuned.plan.x, [15.25, 1.5]]))
response, (above, below) = plt.subplots(2, 1, sharex=True, layout="constrained")
above.plot(TIMES, angles, label=["best", "centre of the bounds"])
above.axhline(1.02, color="red", lw=0.8)
above.set_ylabel("angle (rad)")
above.legend()
below.plot(TIMES, torques)
below.axhline(LIMIT, color="red", lw=0.8)
below.set(xlabel="time (s)", ylabel="requested torque (N m)", ylim=(-10, 20))
