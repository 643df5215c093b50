"""The two-track simulator of the tests agrees with closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sideslip import two_track
from sideslip.two_track import CAR, GRAVITY, SCENARIOS, Scenario, drive, magic_formula, simulate


def steady(speed: float, acceleration: float, **fields):
    """Return the last sample of a steady turn."""
    steering = acceleration * two_track.gain(speed)
    motion = simulate(Scenario(8.0, speed, two_track.ramp((0, 0), (2, steering)), **fields))
    return {name: values[-1] for name, values in motion.items()}


@pytest.mark.parametrize("speed", [8.0, 20.0, 35.0])
def test_slow_turn_has_the_understeer_gradient_of_the_single_track_model(speed):
    # Radius, angle and yaw rate of the linear single-track model; the tyres are linear at 0.2 m/s². The drive force
    # that compensates drag would take grip from the rear tyres.
    turn = steady(speed, 0.2, car=replace(CAR, drag=0.0))
    vx, rate = turn["vx"], turn["yaw_rate"]
    expected = vx * turn["steering"] / (vx**2 * two_track.gain(vx))
    assert rate == pytest.approx(expected, rel=2e-3)
    rear = 2.0 * CAR.stiffness[1]
    slip = CAR.front / CAR.base * CAR.mass * vx * rate / rear
    assert turn["vy"] / vx == pytest.approx(CAR.rear * rate / vx - slip, rel=5e-3, abs=1e-5)


def test_static_loads_and_load_transfer_balance():
    turn = steady(20.0, 4.0)
    loads = turn["loads"]
    assert loads.sum() == pytest.approx(CAR.mass * GRAVITY, rel=1e-9)
    moment = (loads[1] + loads[3] - loads[0] - loads[2]) * CAR.track / 2
    assert moment == pytest.approx(CAR.mass * turn["ay"] * CAR.height, rel=1e-3)
    braking = simulate(Scenario(3.0, 25.0, lambda t: 0.0, thrust=lambda t: -5.0))
    moved = braking["loads"][-1, :2].sum() - braking["loads"][0, :2].sum()
    assert moved == pytest.approx(-CAR.mass * braking["ax"][-1] * CAR.height / CAR.base, rel=1e-3)


def test_tyre_has_its_stiffness_and_its_peak():
    nominal = CAR.static_loads()[0]
    slope = magic_formula(1e-6, nominal, 0.9, CAR, 0, nominal) / 1e-6
    assert slope == pytest.approx(CAR.stiffness[0], rel=1e-6)
    forces = [
        magic_formula(slip, nominal, 0.9, CAR, 0, nominal) for slip in np.linspace(0, 1.5, 3000)
    ]
    assert max(forces) == pytest.approx(0.9 * nominal, rel=1e-6)
    # A pair of tyres loses stiffness by load transfer.
    pair = sum(magic_formula(1e-6, part * nominal, 0.9, CAR, 0, nominal) for part in (0.5, 1.5))
    assert pair < 2.0 * slope * 1e-6


def test_banked_straight_needs_the_force_of_gravity():
    motion = simulate(Scenario(10.0, 25.0, lambda t: 0.0, bank=two_track.ramp((0, 0), (1, 0.05))))
    measured, turn = motion["ay"][-1], motion["vx"][-1] * motion["yaw_rate"][-1]
    assert measured - turn == pytest.approx(GRAVITY * math.sin(0.05), rel=1e-3)


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_scenario_follows_kinematics(name):
    # dvy/dt = ay - g sin(bank) - vx r, integrated by the trapezoidal rule.
    true = drive(name).true
    rate = true["ay"] - GRAVITY * np.sin(true["bank"]) - true["vx"] * true["yaw_rate"]
    change = np.cumsum(0.5 * (rate[1:] + rate[:-1])) * two_track.PERIOD
    assert np.abs(true["vy"][1:] - change).max() < 0.05
    assert np.abs(true["ay"]).max() < 0.95 * GRAVITY


def test_scenarios_differ_as_named():
    peak = {name: np.degrees(np.abs(drive(name).truth)).max() for name in SCENARIOS}
    assert len(SCENARIOS) == 13
    assert 45.0 < peak["spin"] < 89.0
    assert all(
        peak[name] < 20.0 if name == "parking" else peak[name] < 5.0
        for name in SCENARIOS
        if name != "spin"
    )
    assert drive("parking").true["vx"].min() < 0.5


def test_seed_draws_the_noise_only():
    first, second = drive("serpentine", 0), drive("serpentine", 1)
    assert np.array_equal(first.truth, second.truth)
    assert not np.array_equal(first.yaw_rate, second.yaw_rate)
    assert np.array_equal(first.yaw_rate, drive("serpentine", 0).yaw_rate)
    assert np.std(first.yaw_rate - first.true["yaw_rate"]) == pytest.approx(0.002, rel=0.1)
    biased = drive("bias")
    assert np.mean(biased.yaw_rate - biased.true["yaw_rate"]) == pytest.approx(0.01, abs=5e-4)


def test_wheel_speeds_follow_the_rigid_body():
    steer = drive("step-steer").true
    rear = steer["wheels"][:, 2:]
    outer = rear[:, 1] - rear[:, 0]
    assert np.allclose(outer, CAR.track * steer["yaw_rate"], atol=0.15)
