"""
Links of a gripper
==================

The links of a gripper with two fingers, a problem of Osyczka: seven variables, and seven
inequalities on the opening and on the geometry. The objective is the difference between the largest and
the smallest gripping force over the stroke of the actuator.
"""

import matplotlib.pyplot as plt
import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction

STROKE = np.linspace(0, 100, 101)


def forces(x):
    """Return gripping force and opening over the stroke, shape (m, 101), of designs (a, b, c, e, f, l, delta)."""
    a, b, c, e, f, length, delta = x.T[:, :, None]
    with np.errstate(all="ignore"):  # links that do not meet give NaN: no value
        g, phi = np.hypot(e, length - STROKE), np.arctan2(e, length - STROKE)
        alpha = np.arccos((a**2 + g**2 - b**2) / (2 * a * g)) + phi
        beta = np.arccos((b**2 + g**2 - a**2) / (2 * b * g)) - phi
        force = 100 * b * np.sin(alpha + beta) / (2 * c * np.cos(alpha))
    return force, 2 * (e + f + c * np.sin(beta + delta))


def gripper(x):
    """Return the difference of forces and the constraints of designs."""
    force, opening = forces(x)
    a, b, _, e, _, length, _ = x.T
    least, most = opening[:, -1], opening[:, 0]
    return np.column_stack(
        [
            force.max(1) - force.min(1),
            least - 50,
            -least,
            100 - most,
            most - 150,
            length**2 + e**2 - (a + b) ** 2,
            b**2 - (a - e) ** 2 - (length - 100) ** 2,
            100 - length,
        ]
    )


problem = BlackBoxMinimisation(
    PythonFunction(gripper, vectorized=True),
    bounds=[[10, 150], [10, 150], [100, 200], [0, 50], [10, 150], [100, 300], [1, 3.14]],
    inequalities=7,
    budget=10_000,
    name="gripper",
)
design = ct.solve(problem, "cma-es", seed=1)
print(design.summary())
assert design.verification.ok
sections = ct.plot(problem, design)

# %%
# Evaluations prove no bound, so a comparison of two searches names the better plan and stays inconclusive.

print(ct.compare([problem], ["cma-es", "differential-evolution"], seed=1, evaluations=2000))

# %%
# The force of the design is nearly constant over the stroke, while its fingers open as required.

force, opening = forces(np.array([design.plan.x]))
curves, (above, below) = plt.subplots(2, 1, sharex=True, layout="constrained")
above.plot(STROKE, force[0])
above.set_ylabel("gripping force (N)")
below.plot(STROKE, opening[0])
below.set(xlabel="stroke of the actuator (mm)", ylabel="opening (mm)")
