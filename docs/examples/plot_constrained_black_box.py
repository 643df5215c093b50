"""
Black boxes with constraints
============================

Three design problems of robotics as black boxes: the gains of a controller with a limit on the
overshoot, a path with a clearance, and the links of a gripper. The function returns the objective
and the constraints, and a plan must hold each constraint exactly.
"""

# %%
# Gains of a controller
# ---------------------
# A joint with inertia and friction turns by one radian. The controller has a proportional and a
# derivative gain, and the motor has a limited torque and a delay of 20 ms. The objective is the integral of time
# times the absolute error (ITAE). The overshoot must be at most 2 %, and the torque must not exceed
# its limit for longer than 50 ms. The simulation takes many gains at once.

import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction

STEP, LIMIT, DELAY = 0.005, 8.0, 4


def simulate(gains):
    """Return angles and requested torques over 2 s, shapes (steps, m), for gains of shape (m, 2)."""
    angle, speed = np.zeros((2, len(gains)))
    angles, torques = [], [np.zeros(len(gains))] * DELAY
    for _ in range(int(2 / STEP)):
        torques.append(gains[:, 0] * (1 - angle) - gains[:, 1] * speed)
        torque = np.clip(torques[-1 - DELAY], -LIMIT, LIMIT)
        speed = speed + STEP * (torque - 0.4 * speed) / 0.15
        angle = angle + STEP * speed
        angles.append(angle)
    return np.array(angles), np.array(torques[DELAY:])


def tracking(gains):
    """Return the ITAE in rad s², the overshoot above 2 %, and the time of saturation above 50 ms."""
    angles, torques = simulate(gains)
    times = STEP * np.arange(1, len(angles) + 1)
    error = (np.abs(1 - angles) * times[:, None]).sum(0) * STEP
    saturated = STEP * (np.abs(torques) > LIMIT).sum(0)
    return np.column_stack([error, angles.max(0) - 1.02, saturated - 0.05])


controller = BlackBoxMinimisation(
    PythonFunction(tracking, vectorized=True),
    bounds=[[0.5, 30], [0, 3]],
    inequalities=2,
    budget=2000,
    name="gains",
)
tuned = ct.solve(controller, "differential-evolution", seed=1)
print(tuned.summary())
assert tuned.verification.ok

# %%
# The veil with the red border covers gains that violate a constraint.

landscape = ct.plot(controller, tuned, points=61)

# %%
# A path with a clearance
# -----------------------
# A path from (0, 0) to (10, 0) has two waypoints. It must keep a clearance of 0.3 m to three round
# obstacles.

OBSTACLES = np.array([[3.0, 0.2, 1.0], [6.0, -0.8, 1.2], [7.0, 2.2, 0.8]])  # x, y, radius in m


def line_of(x):
    """Return the points of the path."""
    return np.array([[0, 0], x[:2], x[2:], [10, 0]])


def clearance_of(line):
    """Return the distance of a path to the nearest obstacle."""
    begin, side = line[:-1, None], np.diff(line, axis=0)[:, None]
    towards = OBSTACLES[:, :2] - begin
    share = (towards * side).sum(2) / np.maximum((side**2).sum(2), 1e-12)
    nearest = begin + np.clip(share, 0, 1)[..., None] * side
    return float((np.linalg.norm(nearest - OBSTACLES[:, :2], axis=2) - OBSTACLES[:, 2]).min())


def path(x):
    """Return the length in m and the lack of clearance in m."""
    line = line_of(x)
    return [np.linalg.norm(np.diff(line, axis=0), axis=1).sum(), 0.3 - clearance_of(line)]


route = BlackBoxMinimisation(
    path,
    bounds=[[0, 10], [-4, 4], [0, 10], [-4, 4]],
    inequalities=1,
    budget=6000,
    name="path",
)
shortest = ct.solve(route, "cma-es", seed=1)
print(shortest.summary())
sections_of_the_path = ct.plot(route, shortest)

# %%
# Length and clearance are two objectives as well. The front shows the price of each decimetre. It needs the extra
# ``blackbox``. The reference contains values that are just not acceptable.

trade = BlackBoxMinimisation(
    lambda x: [path(x)[0], -clearance_of(line_of(x)), -clearance_of(line_of(x))],
    bounds=route.bounds,
    objectives=2,
    inequalities=1,
    reference=[13.0, 0.0],
    budget=6000,
    name="length against clearance",
)
front = ct.solve(trade, "nsga-ii", seed=1)
print(front.summary())
trade_off = ct.plot(trade, front)

# %%
# A gripper
# ---------
# The links of a gripper with two fingers, a problem of Osyczka: seven variables, and seven
# inequalities on the opening and on the geometry. The objective is the difference between the largest and
# the smallest gripping force over the stroke of the actuator.

STROKE = np.linspace(0, 100, 101)


def gripper(x):
    """Return the difference of forces and the constraints of designs (a, b, c, e, f, l, delta)."""
    a, b, c, e, f, length, delta = x.T[:, :, None]
    with np.errstate(all="ignore"):  # links that do not meet give NaN: no value
        g, phi = np.hypot(e, length - STROKE), np.arctan2(e, length - STROKE)
        alpha = np.arccos((a**2 + g**2 - b**2) / (2 * a * g)) + phi
        beta = np.arccos((b**2 + g**2 - a**2) / (2 * b * g)) - phi
        force = 100 * b * np.sin(alpha + beta) / (2 * c * np.cos(alpha))
    opening = 2 * (e + f + c * np.sin(beta + delta))
    a, b, c, e, f, length, delta = x.T
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


links = BlackBoxMinimisation(
    PythonFunction(gripper, vectorized=True),
    bounds=[[10, 150], [10, 150], [100, 200], [0, 50], [10, 150], [100, 300], [1, 3.14]],
    inequalities=7,
    budget=10_000,
    name="gripper",
)
design = ct.solve(links, "cma-es", seed=1)
print(design.summary())
assert design.verification.ok
sections = ct.plot(links, design)
