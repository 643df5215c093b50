"""Simulated vehicle and driver, compared with integration by SciPy and textbook formulas."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import simulator
from crosstrack.instances.sideslip.drivers import HELD_OUT, Design, Driver, design_drivers
from crosstrack.instances.sideslip.roads import Road, RoadKind, road_of
from crosstrack.instances.sideslip.simulator import STEERING_LIMIT, STEP, simulate
from crosstrack.instances.sideslip.vehicles import VEHICLE
from crosstrack.models.sideslip import Vehicle

#: Goal far to the left, for which the steering soon stays at its limit.
TURN = Road(np.array([-1e6, 1.0 - 1e6]), np.array([0.0, 1e9]), 1.0)


def vehicle(**changes):
    return Vehicle.from_data({**VEHICLE.data(), **changes})


def driven(car, road, speed, driver=HELD_OUT, friction=0.9, shocks=None, period=0.05):
    """Return a drive with or without shocks; `speed` and `friction` may be single numbers."""
    speed = np.asarray(speed, dtype=float)
    shocks = np.zeros((len(speed), 2)) if shocks is None else shocks
    return simulate(car, road, driver, speed, np.broadcast_to(friction, len(speed)), shocks, period)


#: Cubic with values 0 and 1 and zero slopes at the ends, by SciPy.
cubic_hermite = CubicHermiteSpline([0.0, 1.0], [0.0, 1.0], [0.0, 0.0])


def integrated(car, speed, friction, steering, period):
    """Return x, y, heading, sideslip and yaw rate by SciPy for the given steering."""
    times = np.arange(len(speed)) * period

    def force(angle, stiffness, limit):
        if car.tyre == "linear":
            return stiffness * angle
        t, full = abs(math.tan(angle)), 3 * limit / stiffness
        if t >= full:
            return math.copysign(limit, angle)
        size = stiffness * t - (stiffness * t) ** 2 / (3 * limit)
        return math.copysign(size + (stiffness * t) ** 3 / (27 * limit**2), angle)

    def flow(t, state):
        _, _, heading, beta, omega = state
        u, delta = np.interp(t, times, speed), np.interp(t, times, steering)
        grip = friction[min(int(t / period + 1e-9), len(friction) - 1)]
        weight = car.mass * 9.80665 / (car.front + car.rear)
        front = force(
            delta - beta - car.front * omega / u, car.cornering_front, grip * weight * car.rear
        )
        rear = force(car.rear * omega / u - beta, car.cornering_rear, grip * weight * car.front)
        turn = (car.front * front - car.rear * rear) / car.yaw_inertia
        course = heading + beta
        slide = (front + rear) / (car.mass * u) - omega
        return [u * math.cos(course), u * math.sin(course), omega, slide, turn]

    found = solve_ivp(
        flow, (0, times[-1]), np.zeros(5), t_eval=times, rtol=1e-9, atol=1e-12, max_step=period
    )
    return found.y


@pytest.mark.parametrize(
    ("tyre", "friction", "speed"),
    [
        ("linear", (0.9, 0.9), 80 / 3.6),
        ("saturating", (0.35, 0.35), 80 / 3.6),
        ("saturating", (0.9, 0.3), 80 / 3.6),
        ("linear", (0.9, 0.9), None),
    ],
    ids=["linear", "near-the-limit", "friction-falls", "speed-varies"],
)
def test_the_drive_is_what_scipy_integrates(tyre, friction, speed):
    # One integration step per sample: the steering within a step is known exactly.
    count = 800
    speeds = np.full(count, speed) if speed else np.linspace(25.0, 2.0, count)
    grips = np.where(np.arange(count) < 400, *friction)
    car = vehicle(tyre=tyre)
    drive = driven(car, road_of(RoadKind.LANE_CHANGE), speeds, friction=grips, period=STEP)
    assert np.abs(drive.steering).max() > 0.02
    wanted = integrated(car, speeds, grips, drive.steering, STEP)
    found = np.stack(drive[:5])
    scale = np.abs(wanted).max(axis=1)
    # At 2 m/s the model is 20 times stiffer, and its fastest mode dominates the error.
    assert (np.abs(found - wanted).max(axis=1) / scale).max() < (2e-5 if speed else 1e-3)
    by_forces = drive.lateral_acceleration[1:-1]
    slide = np.gradient(drive.sideslip, STEP)[1:-1] + drive.yaw_rate[1:-1]
    assert by_forces == pytest.approx(speeds[1:-1] * slide, abs=0.05)


@pytest.mark.parametrize("speed", [1.0, 5.0, 15.0, 40.0, 100.0])
@pytest.mark.parametrize("change", [{}, {"mass": 900.0}, {"cornering_front": 40_000.0}])
def test_a_steady_turn_is_that_of_the_formulas(speed, change):
    car = vehicle(**change)
    drive = driven(car, TURN, np.full(601, speed))
    assert drive.steering[-100:] == pytest.approx(np.full(100, STEERING_LIMIT), rel=1e-12)
    a, b, length = car.front, car.rear, car.wheelbase
    needed = car.mass * (b / car.cornering_front - a / car.cornering_rear) / length
    yaw_rate = speed * STEERING_LIMIT / (length + needed * speed**2)
    sideslip = yaw_rate * (b / speed - a * car.mass * speed / (car.cornering_rear * length))
    assert drive.yaw_rate[-1] == pytest.approx(yaw_rate, rel=1e-6)
    assert drive.sideslip[-1] == pytest.approx(sideslip, rel=1e-6, abs=1e-9)
    assert drive.lateral_acceleration[-1] == pytest.approx(speed * yaw_rate, rel=1e-6)


@pytest.mark.parametrize("friction", [1e-9, 0.1, 0.5, 1.0])
def test_no_tyre_holds_more_than_the_friction(friction):
    car = vehicle(tyre="saturating")
    drive = driven(car, TURN, np.full(41, 30.0), friction=friction)
    limit = friction * 9.80665
    # At the steering limit the front axle slides all the time.
    assert np.abs(drive.lateral_acceleration).max() <= limit * (1 + 1e-12)
    assert np.abs(drive.lateral_acceleration).max() > 0.4 * limit


def test_shocks_are_added_at_their_samples():
    speed, car = np.full(200, 20.0), vehicle()
    shocks = np.zeros((200, 2))
    shocks[120] = [0.01, -0.03]
    still = driven(car, road_of(RoadKind.SERPENTINE), speed)
    shaken = driven(car, road_of(RoadKind.SERPENTINE), speed, shocks=shocks)
    for one, two in zip(still, shaken, strict=True):
        assert np.array_equal(one[:120], two[:120])
    assert shaken.sideslip[120] - still.sideslip[120] == pytest.approx(0.01, rel=1e-12)
    assert shaken.yaw_rate[120] - still.yaw_rate[120] == pytest.approx(-0.03, rel=1e-12)
    assert shaken.y[120] == still.y[120]
    assert shaken.lateral_acceleration[120] != still.lateral_acceleration[120]


def test_left_is_right_mirrored():
    road = road_of(RoadKind.LANE_CHANGE)
    car = vehicle(tyre="saturating")
    speed = np.interp(np.arange(500), [0, 200, 300, 499], [22, 0, 0, 20])
    one = driven(car, road, speed, friction=0.4)
    two = driven(car, road._replace(aside=-road.aside), speed, friction=0.4)
    assert np.array_equal(one.x, two.x)
    for left, right in zip(one[1:], two[1:], strict=True):
        assert np.array_equal(left, -right)


@pytest.mark.parametrize("tyre", ["linear", "saturating"])
def test_compiled_and_interpreted_drives_are_the_same(tyre, monkeypatch):
    speed = np.interp(np.arange(300), [0, 150, 200, 299], [22.0, 0.0, 0.0, 15.0])
    shocks = np.random.default_rng(4).normal(0, 0.002, (300, 2))
    given = (vehicle(tyre=tyre), road_of(RoadKind.SERPENTINE), speed, HELD_OUT, 0.4, shocks)
    loops = {name: getattr(simulator, name) for name in ("_drive", "_rates", "_force", "_aside")}
    monkeypatch.setattr(simulator, "_drive", loops["_drive"].dispatcher)
    compiled = driven(*given)
    for name, loop in loops.items():
        monkeypatch.setattr(simulator, name, loop.py_func)
    assert np.array_equal(np.stack(compiled), np.stack(driven(*given)))


# -- slow ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.05, 0.5, 0.999, 1.0, 1.5])
def test_a_slow_vehicle_rolls_where_its_wheels_point(speed):
    car = vehicle()
    drive = driven(car, TURN, np.full(2001, speed))
    assert drive.yaw_rate[-1] == pytest.approx(speed * STEERING_LIMIT / car.wheelbase, rel=0.01)
    assert drive.sideslip[-1] == pytest.approx(STEERING_LIMIT * car.rear / car.wheelbase, rel=0.02)


def test_a_vehicle_at_rest_does_not_turn():
    speed = np.interp(np.arange(600), [0, 100, 300, 599], [20.0, 0.0, 0.0, 20.0])
    road = road_of(RoadKind.SERPENTINE)
    drive = driven(vehicle(), road, speed)
    rest = slice(101, 300)
    assert np.abs(drive.steering[rest]).max() > 0.004
    for values in (drive.x, drive.y):
        assert np.ptp(values[rest]) == 0.0
    # The remaining turn decays within a few tenths of a second.
    assert np.abs(drive.yaw_rate[110:300]).max() < 1e-9
    assert np.ptp(drive.heading[110:300]) < 1e-9
    assert np.isfinite(np.stack(drive)).all()
    assert np.abs(drive.y[-50:]).max() < 3.0


# -- drivers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", list(RoadKind))
def test_drivers_follow_the_road_and_come_to_rest_on_it(kind):
    road = road_of(kind)
    count = round(road.length / road.speed / 0.05) + 101
    rng = np.random.default_rng(3)
    drivers = [
        HELD_OUT,
        *design_drivers(15, Design.UNIFORM, rng),
        *design_drivers(60, Design.RANDOM, rng),
    ]
    for driver in drivers:
        drive = driven(vehicle(), road, np.full(count, road.speed), driver)
        assert np.abs(drive.steering).max() < 0.5 * STEERING_LIMIT
        assert np.abs(drive.y).max() < 1.8 * np.abs(road.aside).max()
        assert np.abs(drive.y[-20:]).max() < 0.05
        # Check the whole drive: on average within a fifth of the width.
        piece = np.clip(np.searchsorted(road.along, drive.x) - 1, 0, len(road.along) - 2)
        share = (drive.x - road.along[piece]) / np.diff(road.along)[piece]
        rise = cubic_hermite(np.clip(share, 0.0, 1.0))
        course = road.aside[piece] + np.diff(road.aside)[piece] * rise
        assert np.abs(drive.y - course).mean() < 0.2 * np.ptp(road.aside)


@pytest.mark.parametrize("preview", [0.6, 1.2])
def test_a_driver_sees_the_preview_ahead_and_reacts_after_the_delay(preview):
    road = Road(np.array([0.0, 60.0, 90.0]), np.array([0.0, 0.0, 5.0]), 20.0)
    for delay in (0.0, 0.1, 0.4):
        driver = Driver(preview, 0.1, 1.0, delay, 0.05)
        drive = driven(vehicle(), road, np.full(2000, 20.0), driver, period=0.01)
        first = np.flatnonzero(drive.steering)[0] * 0.01
        assert first == pytest.approx(60.0 / 20.0 - preview + delay, abs=0.025)


def test_a_slow_muscle_follows_with_its_time_constant():
    # A preview of 10 s keeps the demanded angle nearly constant. Without correction only the lag acts.
    road = Road(np.array([-1.0, 0.0]), np.array([0.0, 5.0]), 1.0)
    driver = Driver(preview=10.0, correction=0.0, gain=1.0, delay=0.0, lag=0.5)
    drive = driven(vehicle(), road, np.full(200, 1.0), driver, period=0.01)
    wanted = (VEHICLE.wheelbase / 9.0 + 0.0071826) * 2 * 5.0 / 100.0
    times = np.arange(40) * 0.01
    assert drive.steering[:40] == pytest.approx(wanted * (1 - np.exp(-times / 0.5)), rel=0.02)


# -- wild ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"cornering_front": 1e2, "cornering_rear": 1e8},
        {"cornering_front": 1e-3, "cornering_rear": 1e-3},
        {"mass": 1e6, "yaw_inertia": 1.0, "cornering_front": 1.0},
        {"mass": 1.8e9, "yaw_inertia": 3.9e9, "cornering_front": 6e10, "cornering_rear": 1e11},
        {"front": 1e-6},
    ],
)
@pytest.mark.parametrize("speed", [0.1, 22.0, 1000.0])
def test_wild_vehicles_stay_finite_or_are_refused(change, speed):
    car = vehicle(**change, tyre="saturating")
    drive, said = None, "spins"
    try:
        drive = driven(car, road_of(RoadKind.LANE_CHANGE), np.full(30, speed), friction=0.9)
    except InvalidData as error:
        said = str(error)
    assert drive is None or np.isfinite(np.stack(drive)).all()
    assert "spins" in said or "too stiff" in said


def test_refusals_say_what_happened():
    with pytest.raises(InvalidData, match=r"spins [\d.]+ s after the start"):
        driven(
            vehicle(tyre="saturating"),
            road_of(RoadKind.LANE_CHANGE),
            np.full(341, 22.0),
            friction=0.1,
        )
    with pytest.raises(InvalidData, match="too stiff"):
        driven(vehicle(cornering_front=1e13), road_of(RoadKind.LANE_CHANGE), np.full(341, 22.0))
