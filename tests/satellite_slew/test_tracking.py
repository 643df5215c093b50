"""Tracking a planned slew."""

from functools import partial

import numpy as np
import pytest
from slews import close

from crosstrack.errors import InvalidData
from crosstrack.models import SatelliteSlew
from crosstrack.models.satellite_slew.tracking import track


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


def test_papers_figures_are_kept_with_a_reserve(reserved):
    model, plan = reserved
    found = track(model, plan, disturbance=(0.1, 0.1, 0.1))
    assert found.max_quaternion_error < 4e-4
    assert found.max_rate_error < 1e-3
    # An unknown constant torque leaves q_e = T / (2 ω² I).
    late = track(model, plan, disturbance=(0.1, 0.1, 0.1), after=10.0)
    rest = 0.1 / (2 * 2.0**2 * np.diag(model.inertia))
    close(late.quaternion_errors[-1, 1:], rest, 1e-6)
    known = track(model, plan, disturbance=(0.1, 0.1, 0.1), known_disturbance=1.0)
    assert known.max_quaternion_error < 0.1 * found.max_quaternion_error
    assert "quaternion error" in str(found)


def test_errors_grow_with_what_disturbs(reserved):
    # Samples of twice the usual length are enough for how errors compare.
    fly = partial(track, *reserved, sample_time=0.04)
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
    roomy = track(SatelliteSlew(), steered)
    assert not roomy.saturated.any()
    tight = track(SatelliteSlew(gimbal_rate_limit=0.8), steered)
    assert 0 < tight.saturated_share < 0.5
    assert tight.max_rate_error > 2 * roomy.max_rate_error
    assert np.abs(tight.gimbal_rates).max() == 0.8
    weak = track(SatelliteSlew(torque_limit=8.0), steered)
    assert weak.saturated.any()
    assert np.abs(weak.applied).max() < 8.5


def test_bad_parameters_of_tracking_are_named(reserved):
    model, plan = reserved
    for change, words in (
        ({"sample_time": 0}, "sample_time must be > 0"),
        ({"natural_frequency": -1}, "natural_frequency must be > 0"),
        ({"disturbance": (1, 2)}, "disturbance must have shape"),
        ({"disturbance": lambda t: [1]}, "disturbance must return 3 finite numbers"),
        ({"known_disturbance": 2}, "known_disturbance must be <= 1"),
        ({"inertia_error": -1.0}, "inertia_error must be > -1"),
        ({"after": -1.0}, "after must be >= 0"),
    ):
        with pytest.raises(InvalidData, match=words):
            track(model, plan, **change)
