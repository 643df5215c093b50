"""The Magic Formula and the load transfer of the vehicle, compared with the two-track simulator of the tests."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq
from sideslip.drives import CAR as PARAMETERS
from sideslip.two_track import CAR, drive, magic_formula

from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import generate
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, Vehicle
from crosstrack.models.sideslip.dynamics import axle_force, magic_force, measured, parameters, rates
from crosstrack.solvers import Request, find_backend

LINEAR = Vehicle(**PARAMETERS, friction=0.95)
BRUSH = dataclasses.replace(LINEAR, tyre="saturating")
MAGIC = dataclasses.replace(LINEAR, tyre="magic-formula")
LOADED = dataclasses.replace(MAGIC, load_loss=0.24)


def error(name, vehicle, backend="kalman-filter"):
    """Return the mean error of a backend (degrees) on a drive of the two-track simulator."""
    found = drive(name)
    model = SideslipEstimation(vehicle, Recording(**found.recording()), truth=found.truth)
    chosen = find_backend(backend)
    plan = chosen.run(model.blinded(), Request(options=chosen.checked_options({}))).point
    return model.verify(plan).objective


@pytest.mark.parametrize("slip", [-1.2, -0.1, -1e-9, 0.0, 1e-3, 0.05, 0.2, 1.5])
def test_force_is_that_of_two_tyres_at_static_load(slip):
    load = CAR.static_loads()[0]
    force, _ = magic_force(slip, 80_000.0, 2 * 0.95 * load, 1.35, -0.5)
    assert force == pytest.approx(2 * magic_formula(slip, load, 0.95, CAR, 0, load), rel=1e-12)


@pytest.mark.parametrize("curvature", [-10.0, -0.5, 0.0, 1.0])
@pytest.mark.parametrize("shape", [1.0, 1.35, 2.0])
def test_slope_is_the_derivative(shape, curvature):
    given = 80_000.0, 7000.0, shape, curvature
    for slip in np.linspace(-0.6, 0.6, 25):
        ends = [magic_force(slip + step, *given)[0] for step in (-1e-7, 1e-7)]
        assert magic_force(slip, *given)[1] == pytest.approx(
            (ends[1] - ends[0]) / 2e-7, rel=1e-5, abs=1.0
        )
    assert magic_force(0.0, *given) == (0.0, 80_000.0)
    assert all(math.isfinite(value) for value in magic_force(1e300, *given))


def test_kernel_is_the_plain_function():
    for slip in (-0.4, 0.0, 0.02, 0.3):
        given = slip, 80_000.0, 7000.0, 1.35, -0.5
        assert magic_force.py_func(*given) == pytest.approx(
            magic_force.dispatcher(*given), rel=1e-13
        )
    for vehicle in (MAGIC, LOADED):
        given = 0.05, 0.3, 20.0, 0.06, parameters(vehicle)
        assert rates.py_func(*given) == pytest.approx(rates.dispatcher(*given), rel=1e-13)


def test_load_transfer_lowers_stiffness_and_friction_of_both_axles():
    # At u ω = 5 m/s² each axle has the share 1 - 0.24 (5 / g)² of its forces at equal slip angles.
    left = 1.0 - 0.24 * (5.0 / 9.80665) ** 2
    weaker = dataclasses.replace(
        MAGIC, friction=left * 0.95, cornering_front=left * 80_000.0, cornering_rear=left * 90_000.0
    )
    state = 0.03, 0.25, 20.0, 0.08
    assert measured(*state, parameters(LOADED)) == pytest.approx(
        measured(*state, parameters(weaker))
    )
    still = 0.03, 0.0, 20.0, 0.08
    assert measured(*still, parameters(LOADED)) == measured(*still, parameters(MAGIC))


def test_axle_of_two_tyres_loses_the_given_share():
    # K(z) = C z (1 - k (z - 1)) for both tyres at z = 1 ± d has the sum 2 C (1 - k d²), with d = 2 h a / (g t).
    k, height, track = 0.44, 0.55, 1.5
    transfer = 2.0 * height * 5.0 / (9.80665 * track)
    pair = sum(z * (1.0 - k * (z - 1.0)) for z in (1.0 - transfer, 1.0 + transfer)) / 2.0
    p = parameters(dataclasses.replace(MAGIC, load_loss=k * (2 * height / track) ** 2))
    assert 1.0 - p[10] * 25.0 == pytest.approx(pair, rel=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_brush_loses_stiffness_in_proportion_to_the_force(share):
    """The ratio of force and slip angle falls by s / 3 for the brush model, and by about s² for the Magic Formula."""
    most, stiffness = 7000.0, 80_000.0

    def secant(law, *more):
        slip = brentq(lambda x: law(x, stiffness, most, *more)[0] - share * most, 1e-9, 0.25)
        return share * most / slip / stiffness

    grip = (1.0 - share) ** (1 / 3)
    assert secant(axle_force) == pytest.approx((1.0 + grip + grip * grip) / 3.0, rel=0.02)
    assert secant(axle_force) < 1.0 - share / 3.0 + 0.01
    # Series of the formula: sin(C atan(x - E (x - atan x))), to the third power of x.
    lost = (share / 1.35) ** 2 * (1.35**2 / 6.0 + (1.0 - 0.5) / 3.0)
    assert secant(magic_force, 1.35, -0.5) > 1.0 - 1.6 * lost and secant(
        magic_force, 1.35, -0.5
    ) > secant(axle_force)


def test_magic_formula_is_better_than_linear_and_brush_on_its_tyres():
    for name in ("step-steer", "serpentine"):
        linear, brush, loaded = (error(name, vehicle) for vehicle in (LINEAR, BRUSH, LOADED))
        assert loaded < 0.6 * min(linear, brush)
    # In gentle drives the brush model is too soft.
    assert error("banked-road", BRUSH) > error("banked-road", LINEAR)


@pytest.mark.parametrize(
    "backend", ["kalman-filter", "rts-smoother", "moving-horizon", "unscented-filter"]
)
def test_backends_accept_the_law(backend):
    name = "lane-change"
    found = drive(name)
    end = 120 if backend == "moving-horizon" else 200
    part = {key: values[100:end] for key, values in found.recording().items()}
    model = SideslipEstimation(LOADED, Recording(**part), truth=found.truth[100:end])
    chosen = find_backend(backend)
    plan = chosen.run(model.blinded(), Request(options=chosen.checked_options({}))).point
    assert model.verify(plan).objective < 0.1


def test_old_vehicles_keep_their_data_and_new_ones_are_stored():
    assert {"shape", "curvature", "load_loss"}.isdisjoint(LINEAR.data())
    assert Vehicle.from_data(LOADED.data()).data() == LOADED.data()


@pytest.mark.parametrize(
    ("field", "value"),
    [("shape", 0.5), ("shape", 2.5), ("curvature", 1.5), ("load_loss", -0.1), ("load_loss", 2.0),
     ("shape", float("nan")), ("tyre", "magic")],
)  # fmt: skip
def test_rejects_wrong_parameters(field, value):
    with pytest.raises(InvalidData, match=field):
        dataclasses.replace(MAGIC, **{field: value})


def test_simulator_refuses_laws_that_it_lacks():
    with pytest.raises(InvalidData, match="linear or saturating"):
        generate(tyre="magic-formula", drivers=0)
    assert generate(believed_tyre="magic-formula", drivers=0).vehicle.tyre == "magic-formula"
