"""Vehicles: their data, their quantities against simulations, and the proofs of their extremes."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.models import (
    DifferentialDrive,
    MinimumDerivative,
    MinimumSnap,
    Model,
    PointMass,
    Quadrotor,
    TimeAllocation,
    Trajectory,
)

QUADROTOR = Quadrotor(
    1.3, (6.0, 20.0), 0.7, 2.0, drag=0.3, speed=3.0, acceleration=5.0, yaw_rate=1.0
)
DRIVE = DifferentialDrive(1.0, 2.0, 0.4)


def smooth(seed: int, dimensions: int, segments: int = 3) -> Trajectory:
    """Return the minimum-snap path through random points in exact arithmetic of a small system."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(segments + 1, dimensions)), axis=0)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.8, 1.6, segments))])
    formulation = MinimumSnap(points, times).formulate("hermite")
    hessian, slope = formulation.parabola
    free = np.linalg.solve(hessian.toarray(), -slope)
    return formulation.decode(free / formulation.unit)


def rotations(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


# -- data --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", [QUADROTOR, DRIVE, PointMass(1.0), PointMass(2.0, 3.0)])
def test_a_model_with_a_vehicle_survives_json(vehicle):
    axes = vehicle.axes or 1
    model = MinimumSnap(np.arange(3.0)[:, None] * np.ones(axes), [0, 2, 4], vehicle=vehicle)
    again = Model.from_json(model.to_json())
    assert again == model and again.vehicle == vehicle and hash(again.vehicle) == hash(vehicle)
    assert type(vehicle).from_data(vehicle.data()) == vehicle
    assert MinimumSnap(model.waypoints, model.times, vehicle=vehicle.data()) == model
    assert model.digest != MinimumSnap(model.waypoints, model.times).digest


def test_data_without_a_vehicle_keep_their_form():
    model = MinimumSnap([[0.0], [1.0]], [0, 1])
    assert not {"vehicle", "yaw", "periodic"} & set(model.data())
    # Digests of the version before vehicles.
    assert model.digest[:16] == "aa1eab6c7108ed4f"
    assert TimeAllocation([[0.0], [1.0]], 2.0).digest[:16] == "5802d965ba57fcae"
    assert "yaw" not in smooth(0, 2).to_data()


@pytest.mark.parametrize(
    ("kind", "data", "word"),
    [
        (Quadrotor, {"mass": 1, "thrust": (10, 20)}, "hovering"),
        (Quadrotor, {"mass": 1, "thrust": (0, 9)}, "hovering"),
        (Quadrotor, {"mass": 1, "thrust": (-1, 20)}, "thrust"),
        (Quadrotor, {"mass": 0, "thrust": (0, 20)}, "mass"),
        (Quadrotor, {"mass": 1, "thrust": (0, np.nan)}, "thrust"),
        (Quadrotor, {"mass": 1, "thrust": (0, 20), "tilt": np.pi / 2}, "tilt"),
        (Quadrotor, {"mass": 1, "thrust": (0, 20), "drag": -1}, "drag"),
        (DifferentialDrive, {"wheel_speed": 1}, "track"),
        (DifferentialDrive, {"wheel_speed": 0, "track": 1}, "wheel_speed"),
        (PointMass, {"speed": -1}, "speed"),
        (PointMass, {"acceleration": True}, "acceleration"),
    ],
)
def test_rejects_invalid_vehicles(kind, data, word):
    with pytest.raises(InvalidData, match=word):
        kind(**data)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"vehicle": DRIVE}, "2 axes"),
        ({"vehicle": {"kind": "boat"}}, "kind"),
        ({"vehicle": 3}, "vehicle"),
        ({"vehicle": QUADROTOR, "start": [[9, 0, 0]]}, "start: the speed"),
        ({"vehicle": QUADROTOR, "start": [[0, 0, 0], [0, 0, -9.81]]}, "lowest thrust"),
        ({"vehicle": QUADROTOR, "end": [[0, 0, 0], [0, 0, 0], [90, 0, 0]]}, "end: the body rate"),
        ({"yaw": "north"}, "tangent"),
        ({"yaw": [None, None]}, "yaw"),
        ({"yaw": [0, 1, 2]}, "yaw"),
        ({"yaw": 1e9}, "yaw"),
        ({"periodic": True}, "periodic"),
        ({"periodic": 1}, "periodic"),
    ],
)
def test_rejects_states_and_yaws_that_contradict(fields, word):
    with pytest.raises(InvalidData, match=word):
        MinimumSnap([[0, 0, 0], [1, 2, 1]], [0, 2], **fields)


def test_time_allocation_has_the_same_fields():
    model = TimeAllocation([[0, 0, 0], [1, 2, 1]], 10, vehicle=QUADROTOR, yaw=0.5)
    assert model.at([0, 2]).vehicle == QUADROTOR and Model.from_json(model.to_json()) == model


# -- quantities --------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [None, 0.7, "tangent", "curve"])
def test_body_rates_are_those_of_the_attitude(yaw):
    plan = smooth(1, 3)
    if yaw == "curve":
        model = MinimumSnap(np.zeros((4, 3)), plan.times, yaw=[0.3, None, 3, -3])
        yaw = model.with_yaw(plan).yaw
    t = np.linspace(0.3, 0.6 * plan.times[-1], 100001)
    values = QUADROTOR.quantities(plan, t, yaw)
    frames, step = rotations(values["attitude"]), t[1] - t[0]
    turned = frames[1:-1].transpose(0, 2, 1) @ (frames[2:] - frames[:-2]) / (2 * step)
    rates = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    inner = np.abs(t[1:-1, None] - plan.times).min(axis=1) > 2 * step
    assert np.abs(rates - values["body_rates"][1:-1])[inner].max() < 1e-3
    assert np.allclose(np.linalg.norm(values["body_rates"], axis=1), values["body_rate"])
    # The thrust along the body's axis moves the mass (Newton's second law).
    push = values["thrust"][:, None] * frames[:, :, 2]
    drag = QUADROTOR.drag * plan(t, 1)
    assert np.allclose(push - drag - [0, 0, 1.3 * 9.81], 1.3 * plan(t, 2))
    assert np.allclose(np.cos(values["tilt"]), frames[:, 2, 2])


def test_wheels_drive_along_the_path():
    plan = smooth(2, 2)
    t = np.linspace(0, plan.times[-1], 20001)
    values = DRIVE.quantities(plan, t)
    left, right = values["wheel_speeds"].T
    heading = np.unwrap(values["heading"])
    step = t[1] - t[0]
    # Trapezoidal integration of the robot's motion from its wheels, from standstill to standstill.
    speed, turn = (left + right) / 2, (right - left) / DRIVE.track
    middle = (turn[1:] + turn[:-1]) / 2 * step
    assert np.abs(np.cumsum(middle) - (heading[1:] - heading[0])).max() < 1e-4
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    end = ((velocity[1:] + velocity[:-1]) / 2 * step).sum(axis=0)
    assert np.allclose(end, plan(t[-1]) - plan(0.0), atol=1e-6)
    slope = np.diff(values["wheel_speeds"], axis=0) / step
    middle = (values["wheel_accelerations"][1:] + values["wheel_accelerations"][:-1]) / 2
    knots = np.abs(t[1:, None] - plan.times).min(axis=1) < 2 * step
    assert np.abs(slope - middle)[~knots].max() < 1e-3 * np.abs(middle).max()


def test_the_rates_at_standstill_are_limits():
    # x = t^4, y = t^5: the direction at rest is x, and the path's turn rate tends to 5 / 4.
    plan = Trajectory([0.0, 1.0], [[[0, 0], [0, 0], [0, 0], [0, 0], [1, 0], [0, 1]]])
    values = DRIVE.quantities(plan, [0.0, 1e-4])
    assert values["turn_rate"] == pytest.approx([1.25, 1.25], abs=1e-3)
    assert values["heading"][0] == 0 and values["speed"][0] == 0


# -- extremes ----------------------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("vehicle", "dimensions", "yaw"),
    [
        (QUADROTOR, 3, None),
        (QUADROTOR, 3, "tangent"),
        (DRIVE, 2, None),
        (PointMass(1.0, 1.0), 1, None),
    ],
)
@pytest.mark.parametrize("scale", [pytest.param(1.0, marks=pytest.mark.slow), 1e-3, 1e6])
def test_extremes_are_those_of_dense_samples(vehicle, dimensions, yaw, scale):
    plan = smooth(3, dimensions)
    if isinstance(vehicle, PointMass) or scale == 1.0:
        plan = Trajectory(plan.times, plan.coefficients * scale)
    else:  # slower or faster
        plan = Trajectory(plan.times * min(scale, 1e3) ** 0.25, plan.coefficients)
    t = np.linspace(plan.times[0], plan.times[-1], 100001)
    values = vehicle.quantities(plan, t, yaw)
    samples = {
        "lowest thrust": -values.get("thrust", 0),
        "left wheel speed": np.abs(values["wheel_speeds"][:, 0]) if vehicle is DRIVE else None,
        "right wheel speed": np.abs(values["wheel_speeds"][:, 1]) if vehicle is DRIVE else None,
        "yaw rate": np.abs(values.get("yaw_rate", 0)),
    }
    if vehicle is DRIVE:
        for side, name in enumerate(("left", "right")):
            samples[f"{name} wheel acceleration"] = np.abs(values["wheel_accelerations"][:, side])
    extremes = vehicle.check_curve(plan, yaw)
    assert {extreme.name: extreme.unit for extreme in extremes} == vehicle.limits
    for extreme in extremes:
        sampled = samples.get(extreme.name, values.get(extreme.name.replace(" ", "_")))
        value = -extreme.value if extreme.name == "lowest thrust" else extreme.value
        assert value >= sampled.max() * (1 - 1e-14 * np.sign(sampled.max()))
        # The bound of a square near 0 is accurate to a share of the square of the limit.
        assert value <= sampled.max() + 1e-6 * max(abs(sampled.max()), extreme.limit)


def test_the_extreme_agrees_with_forty_digits():
    plan = smooth(5, 3)
    extreme = {e.name: e for e in QUADROTOR.check_curve(plan)}["body rate"]
    segment = int(np.searchsorted(plan.times, extreme.time, "right")) - 1
    with mpmath.workdps(40):
        long = mpmath.mpf(plan.durations[segment])
        rows = [[mpmath.mpf(c) for c in axis] for axis in plan.coefficients[segment].T.tolist()]

        def force(s):
            result = []
            for axis, row in enumerate(rows):
                v = mpmath.polyval([k * c for k, c in enumerate(row)][1:], s, asc=True) / long
                a = (
                    mpmath.polyval([k * (k - 1) * c for k, c in enumerate(row)][2:], s, asc=True)
                    / long**2
                )
                weight = mpmath.mpf(1.3) * mpmath.mpf(9.81) if axis == 2 else 0
                result.append(mpmath.mpf(1.3) * a + mpmath.mpf(0.3) * v + weight)
            return result

        def rate(s):
            f = force(s)
            df = [mpmath.diff(lambda u, i=i: force(u)[i], s) / long for i in range(3)]
            n2 = sum(x * x for x in f)
            n = mpmath.sqrt(n2)
            along = sum(x * y for x, y in zip(f, df, strict=True)) / n2
            dz = [(y - x * along) / n for x, y in zip(f, df, strict=True)]
            spin = (f[1] * dz[0] - f[0] * dz[1]) / (n + f[2])
            return mpmath.sqrt(sum(x * x for x in dz) + spin**2)

        s = mpmath.mpf((extreme.time - plan.times[segment]) / plan.durations[segment])
        best = max(rate(s + k * mpmath.mpf("1e-5")) for k in range(-3, 4) if 0 <= s + k * 1e-5 <= 1)
    assert float(best) <= extreme.value * (1 + 1e-13)
    assert extreme.value == pytest.approx(float(best), rel=1e-8)


def test_checks_find_limits_slightly_below_and_above_the_extreme():
    for plan, vehicle, dimensions in ((smooth(6, 3), QUADROTOR, 3), (smooth(6, 2), DRIVE, 2)):
        extremes = {e.name: e for e in vehicle.check_curve(plan)}
        fields = {"body rate": "body_rate", "left wheel speed": "wheel_speed"}
        for name in ("tilt", "body rate", "speed", "acceleration", "left wheel speed"):
            if name not in extremes or (dimensions == 2 and name == "speed"):
                continue
            for factor in (0.9, 1.1):
                field = fields.get(name, name)
                data = {**vehicle.data(), field: factor * extremes[name].value}
                if dimensions == 2:
                    data["wheel_acceleration"] = None
                changed = type(vehicle).from_data(data)
                points = np.vstack([plan(t) for t in plan.times])
                model = MinimumSnap(points, plan.times, vehicle=changed)
                checks = {check.name: check for check in model.verify(plan).checks}
                check = checks[f"{name} limit"]
                assert check.ok == (factor > 1)
                if factor < 1:
                    assert check.worst == pytest.approx(0.1 * extremes[name].value, rel=1e-6)
                    assert float(check.where.split()[2]) == pytest.approx(
                        extremes[name].time, rel=1e-3
                    )


def test_zero_thrust_has_unbounded_rates():
    # Free fall at t = 1: the acceleration reaches -g while the jerk turns the force.
    fall = np.zeros((1, 5, 3))
    fall[0, 3, 0], fall[0, 2, 2], fall[0, 3, 2] = 1.0, 0.0, -9.81 / 6
    fall[0, 3, 0] = 0.0
    fall[0, 4, 0] = 0.0
    plan = Trajectory([0.0, 2.0], fall * 2.0 ** np.arange(5)[None, :, None])
    values = {e.name: e for e in Quadrotor(1.0, (1.0, 40.0), 0.5, 3.0).check_curve(plan)}
    assert values["lowest thrust"].value < 1e-3 and values["lowest thrust"].time == pytest.approx(1)
    assert values["tilt"].value > 3 and np.isfinite(values["thrust"].value)


def test_a_reversal_is_beyond_every_wheel_speed():
    plan = Trajectory([0.0, 1.0], [[[0, 0], [1, 0], [-1, 0]]])  # turns back at s = 1/2
    values = {e.name: e.value for e in DRIVE.check_curve(plan)}
    assert values["left wheel speed"] == np.inf and np.isfinite(values["speed"])


def test_a_corner_at_standstill_has_a_jump_of_the_heading():
    model = MinimumDerivative(
        [[0, 0], [1, 0], [1, 1]], [0, 2, 4], order=3, vehicle=DRIVE,
        derivatives=[[[None, None]], [[0, 0]], [[None, None]]],
    )  # fmt: skip
    s = np.array([0, 0, 0, 10.0, -15, 6])
    still = np.zeros(6)
    east, north = np.column_stack([s, still]), np.column_stack([still, s])
    north[0, 0] = 1.0
    checks = {c.name: c for c in model.verify(Trajectory(model.times, [east, north])).checks}
    assert checks["continuity of heading"].worst == pytest.approx(np.pi / 2)
    assert checks["left wheel speed limit"].ok


def test_large_coefficients_that_cancel_are_no_standstill():
    """The velocity has the sizes of Chebyshev polynomials, with coefficients up to 1e10."""
    shifted = np.polynomial.Chebyshev.basis(14, domain=[0, 1]).convert(
        kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]
    )
    velocity = np.zeros((15, 2))
    velocity[:, 0] = shifted.coef
    velocity[0] += [1.2, 0.5]
    powers = np.concatenate([np.zeros((1, 2)), velocity / np.arange(1, 16)[:, None]])
    plan = Trajectory([0.0, 1.0], powers[None])
    extremes = {e.name: e.value for e in DRIVE.check_curve(plan)}
    t = np.linspace(0, 1, 20001)
    (vx, vy), (ax, ay) = plan(t, 1).T, plan(t, 2).T
    turn = (vx * ay - vy * ax) / (vx**2 + vy**2)
    for name, side in (("left", -1), ("right", 1)):
        speed = np.abs(np.hypot(vx, vy) + side * 0.5 * DRIVE.track * turn).max()
        assert extremes[f"{name} wheel speed"] == pytest.approx(speed, rel=1e-4)


def test_a_robot_at_rest_is_within_its_limits():
    plan = Trajectory([0.0, 1.0, 2.0], np.ones((2, 1, 2)))
    assert all(e.value <= 1e-6 * e.limit for e in DRIVE.check_curve(plan))
