"""Tracking a planned slew."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from slews import close

from crosstrack.errors import InvalidData
from crosstrack.models import SatelliteSlew
from crosstrack.models.satellite_slew.controller import Controller
from crosstrack.models.satellite_slew.gyros import gimbal_jacobian
from crosstrack.models.satellite_slew.tracking import track
from crosstrack.models.verification import Verification


def test_without_disturbance_the_plan_is_followed(reserved):
    model, plan = reserved
    found = track(model, plan, disturbance=(0, 0, 0))
    assert found.max_quaternion_error < 1e-6
    assert found.max_rate_error < 1e-5
    assert not found.saturated.any()
    n = found.times.size
    assert found.quaternion_errors.shape == (n, 4)
    assert found.gimbal_rates.shape == (n - 1, 4)
    assert found.times[-1] == plan.end
    close((found.attitudes**2).sum(axis=1), np.ones(n), 1e-7)
    # The gyros give what is asked for, on the whole.
    assert np.abs(found.commanded - found.applied).max() < 0.05
    assert found.measures.min() > 0.2
    assert found.ok
    assert found.breach is None
    assert str(found).endswith("0 % of the samples saturated; verified")


def test_papers_figures_are_kept_with_a_reserve(reserved):
    model, plan = reserved
    found = track(model, plan, disturbance=(0.1, 0.1, 0.1))
    assert found.max_quaternion_error < 4e-4
    assert found.max_rate_error < 1e-3
    # An unknown constant torque leaves q_e = T / (2 ω² I).
    fly = partial(track, model, plan, disturbance=(0.1, 0.1, 0.1), sample_time=0.04)
    late = fly(after=10.0)
    rest = 0.1 / (2 * 2.0**2 * np.diag(model.inertia))
    close(late.quaternion_errors[-1, 1:], rest, 1e-6)
    known = fly(known_disturbance=1.0)
    assert known.max_quaternion_error < 0.1 * found.max_quaternion_error
    assert "quaternion error" in str(found)


def test_errors_grow_with_what_disturbs(reserved):
    # Samples of four times the usual length are enough for how errors compare.
    fly = partial(track, *reserved, sample_time=0.08)
    worst = [fly(disturbance=(size, 0, 0)).max_quaternion_error for size in (0.1, 0.4)]
    assert worst[1] == pytest.approx(4 * worst[0], rel=0.1)
    shares = [
        fly(disturbance=(0, 0, 0), inertia_error=share).max_quaternion_error
        for share in (0.005, 0.01)
    ]
    assert 1e-5 < shares[0] < shares[1]
    stiff = fly(natural_frequency=4.0).max_quaternion_error
    soft = fly(natural_frequency=1.0).max_quaternion_error
    assert stiff < 0.2 * soft
    waves = fly(disturbance=lambda t: [0.1 * np.sin(t), 0.0, 0.0])
    assert 0 < waves.max_quaternion_error < worst[0]


def test_a_plan_beyond_the_limits_saturates(steered):
    fly = partial(track, sample_time=0.04)
    roomy = fly(SatelliteSlew(), steered)
    assert not roomy.saturated.any()
    tight = fly(SatelliteSlew(gimbal_rate_limit=0.8), steered)
    assert 0 < tight.saturated_share < 0.5
    assert tight.max_rate_error > 2 * roomy.max_rate_error
    assert np.abs(tight.gimbal_rates).max() == 0.8
    weak = fly(SatelliteSlew(torque_limit=8.0), steered)
    assert weak.saturated.any()
    assert np.abs(weak.applied).max() < 8.5


def test_bad_parameters_of_tracking_are_named(reserved):
    model, plan = reserved
    for change, words in (
        ({"sample_time": 0}, "sample_time must be > 0"),
        ({"natural_frequency": -1}, "natural_frequency must be > 0"),
        ({"disturbance": (1, 2)}, "disturbance must have shape"),
        ({"disturbance": lambda t: [1]}, "disturbance must have shape"),
        ({"known_disturbance": 2}, "known_disturbance must be <= 1"),
        ({"inertia_error": -1.0}, "inertia_error must be > -1"),
        ({"inertia_error": "5 %"}, "inertia_error must be a number"),
        ({"inertia_error": [1.0, 2.0]}, "inertia_error must be a symmetric matrix"),
        ({"inertia_error": [[0, 5, 0], [4, 0, 0], [0, 0, 0]]}, "no body has: .* symmetric"),
        ({"inertia_error": [-300.0, 0, 0]}, "no body has: .* positive definite"),
        ({"inertia_error": [300.0, 0, 0]}, "no body has: .* sum of the other two"),
        ({"disturbance": (1e200, 0, 0)}, "beyond all numbers at t = 0.02 s"),
        ({"final_angle": 0.0}, "final_angle must be > 0"),
        ({"final_rate": -1.0}, "final_rate must be > 0"),
        ({"sample_time": 1e-6}, "at most 1000000 steps"),
        ({"after": -1.0}, "after must be >= 0"),
    ):
        with pytest.raises(InvalidData, match=words):
            track(model, plan, **change)


def worst(flight, name):
    """The check called `name`."""
    (found,) = [check for check in flight.verification.checks if check.name == name]
    return found


def test_a_flight_says_which_limit_it_breaks_first(reserved):
    found = track(*reserved, disturbance=(0, 0, 0), inertia_error=0.1, sample_time=0.04)
    assert not found.ok
    breach = found.breach
    assert breach.name == "singularity measure"
    assert breach.limit == 0.2
    assert breach.worst < 0.15 < breach.value < 0.198
    # Seen no later than at the next sample, and no earlier than after the one before.
    first = int((found.measures < 0.198).argmax())
    assert found.times[first - 1] < breach.time <= found.times[first]
    assert 0.2 - worst(found, "singularity measure").worst == pytest.approx(breach.worst)
    assert breach.worst <= found.measures.min()
    assert f"NOT verified: singularity measure {breach.value:.4g} at t = " in str(found)
    assert "% of the samples saturated from t = " in str(found)
    whole = replace(found, saturated=np.ones_like(found.saturated))
    assert "100 % of the samples" in str(whole)
    data = json.loads(json.dumps(found.to_data()))
    close(data["gimbals"], found.gimbals)
    assert data["breach"]["time"] == breach.time
    assert Verification.from_dict(data["verification"]) == found.verification


def test_every_limit_of_the_model_is_held(steered):
    fly = partial(track, disturbance=(0, 0, 0), sample_time=0.1)
    free = fly(SatelliteSlew(), steered)
    # The objective of a flight along a plan is the plan's.
    assert free.verification.objective == pytest.approx(steered.primal_bound, rel=1e-3)
    assert free.ok
    fastest = np.abs(free.rates).max()
    slow = fly(SatelliteSlew(rate_limit=0.9 * fastest), steered)
    assert slow.breach.name == "body rate"
    assert slow.breach.worst == pytest.approx(fastest, rel=1e-6)
    assert fly(SatelliteSlew(rate_limit=0.995 * fastest), steered).ok
    assert not fly(SatelliteSlew(rate_limit=0.995 * fastest), steered, tolerance=1e-3).ok
    weak = fly(SatelliteSlew(torque_limit=8.0), steered)
    assert not weak.ok
    # Long samples: the least measure lies between them.
    long = fly(SatelliteSlew(), steered, sample_time=2.0)
    assert worst(long, "singularity measure").worst > 0.2 - long.measures.min() + 1e-3
    # A torque that is not known leaves an angle of T / (ω² I).
    pushed = fly(SatelliteSlew(), steered, disturbance=(0, 0, 0.4))
    angle = 0.4 / (2.0**2 * 176)
    assert worst(pushed, "final angle off the target").worst == 0.0
    strict = fly(SatelliteSlew(), steered, disturbance=(0, 0, 0.4), final_angle=0.5 * angle)
    assert strict.breach.name == "final angle off the target"
    assert strict.breach.value == pytest.approx(angle, rel=0.02)
    assert strict.breach.time == strict.times[-1]


def test_an_inertia_error_is_a_share_or_a_matrix(reserved):
    model, _ = reserved
    fly = partial(track, *reserved, disturbance=(0, 0, 0), sample_time=0.08)
    share = fly(inertia_error=0.02)
    for same in (0.02 * model.inertia, 0.02 * np.diag(model.inertia)):
        close(fly(inertia_error=same).attitudes, share.attitudes, 1e-15)
    products = fly(inertia_error=[[0, 6, 0], [6, 0, 0], [0, 0, 0]])
    # A product of inertia couples the roll with the pitch.
    assert np.abs(products.quaternion_errors[:, 2]).max() > 1e-5
    assert np.abs(share.quaternion_errors[:, 2]).max() < 1e-6


@pytest.mark.parametrize(("size", "waves"), [(0.01, True), (1.0, False)])
def test_knowing_the_disturbance_helps(reserved, size, waves):
    push = size * np.array([1.0, 0.5, -0.5])
    outer = (lambda t: push * np.sin([t, 2 * t, 3 * t])) if waves else push
    blind, aware = (
        track(*reserved, disturbance=outer, known_disturbance=share, sample_time=0.04)
        for share in (0.0, 1.0)
    )
    assert not aware.saturated.any()
    # Sampling alone leaves 3e-6.
    assert aware.max_quaternion_error < 0.1 * blind.max_quaternion_error + 3e-6
    assert aware.max_quaternion_error < 0.7 * blind.max_quaternion_error


def test_what_the_gyros_cannot_give_no_knowledge_gives(reserved):
    flown = track(*reserved, disturbance=(-1, 0, 0), known_disturbance=1.0, sample_time=0.08)
    assert flown.saturated_share > 0.2
    assert flown.breach.name == "singularity measure"


def test_gimbal_rates_within_limits_give_the_torque_that_they_can():
    rng = np.random.default_rng(3)
    model = SatelliteSlew(gimbal_rate_limit=0.7)
    controller = Controller(model, None, 2.0, 1.0, None, 0.0, 5.0)
    for _ in range(200):
        jacobian = gimbal_jacobian(rng.uniform(-1.5, 1.5, 4), model.beta)
        possible = rng.uniform(-0.7, 0.7, 4)
        found = controller.steer(jacobian, jacobian @ possible, rng.uniform(-3, 3, 4))
        assert np.abs(found).max() <= 0.7
        close(jacobian @ found, jacobian @ possible, 1e-4)
