"""The data of a slew, and the optimal control problem it is a case of."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from slews import BETA, FULL, close

from crosstrack.errors import InvalidData
from crosstrack.models import Model, SatelliteSlew
from crosstrack.models.satellite_slew.dynamics import SlewMotion
from crosstrack.models.satellite_slew.gyros import (
    momentum_direction,
    singularity_measure,
)
from crosstrack.models.satellite_slew.quaternions import (
    conjugate,
    quaternion_rate,
    rotation_about,
    rotation_matrix,
)


def conserved_slopes(model, x):
    """Derivatives of the length of q and of the total momentum by the state, shape (4, 11)."""
    motion, step = SlewMotion.of(model), 1e-6

    def values(y):
        return np.append(motion.total_momentum(y) / 100, y[:4] @ y[:4])

    columns = [
        (values(x + step * unit) - values(x - step * unit)) / (2 * step) for unit in np.eye(11)
    ]
    return np.array(columns).T


@pytest.mark.parametrize(
    ("axis", "angle"), [("roll", 45), ("roll", 180), ("yaw", 120), ([1, 2, 3], 70)]
)
@pytest.mark.parametrize("free", [False, True])
def test_conditions_at_the_end_are_independent_and_imply_the_rest(axis, angle, free):
    model = SatelliteSlew.about(axis, angle, **({"final_gimbals": None} if free else {}))
    phase = model.lower().definition.phases[0]
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    fixed = np.flatnonzero(low == high)
    end = np.concatenate([model.target, np.zeros(7)])
    close(low[fixed], end[fixed])
    assert (low <= end).all() and (end <= high).all()
    # Momentum and length hold anyway: with them, the fixed entries are independent.
    rows = np.vstack([conserved_slopes(model, end), np.eye(11)[fixed]])
    assert fixed.size == (6 if free else 7)
    if free:
        # The rates are fixed, the gimbals free to move within the null space: one direction is left.
        assert np.linalg.matrix_rank(rows, tol=1e-5) == 10
        return
    assert np.linalg.matrix_rank(rows, tol=1e-5) == 11
    # Any further condition depends on these.
    everything = np.vstack([conserved_slopes(model, end), np.eye(11)])
    assert np.linalg.matrix_rank(everything, tol=1e-5) == 11


def test_lowered_problem_is_kept_named_and_travels():
    model = SatelliteSlew(name="mine", margin=0.1)
    problem = model.lower()
    assert problem is model.lower()
    assert problem.name == "mine"
    assert problem.objective_unit == model.objective_unit == "s"
    again = pickle.loads(pickle.dumps(model))
    assert again.digest == model.digest
    assert again.lower().digest == problem.digest
    phase = problem.definition.phases[0]
    assert [r.name for r in phase.paths] == ["singularity measure", "control torque"]
    close(phase.paths[1].upper, [22.5] * 3)
    close(phase.controls[0].upper, [0.9] * 4)
    close(phase.states[1].upper, [0.125] * 3)  # the rates are no actuator's
    assert phase.guess.states.shape[1] == 11
    measures = singularity_measure(phase.guess.states[:, 7:], model.beta)
    assert measures.min() > 0.2
    assert SatelliteSlew(time_range=(9, 9)).lower().definition.phases[0].end_lower == 9


def test_guess_goes_from_end_to_end():
    model = SatelliteSlew.about([1, -2, 1], 100)
    guess = model.lower().definition.phases[0].guess
    close(guess.states[0], [1, *[0] * 10])
    close(guess.states[-1, :4], model.target, 1e-9)
    close((guess.states[:, :4] ** 2).sum(axis=1), np.ones(len(guess.states)))
    # Rates and attitude belong together.
    times = guess.start + guess.fractions * (guess.end - guess.start)
    slope = np.gradient(guess.states[:, :4], times, axis=0)
    rates = quaternion_rate(guess.states[:, :4], guess.states[:, 4:7])
    assert np.abs(slope - rates)[1:-1].max() < 5e-3
    assert SatelliteSlew.about("roll", 0.0).lower().definition.phases[0].guess.end > 1


def test_defaults_are_the_papers():
    model = SatelliteSlew()
    close(model.inertia, np.diag([228.0, 188, 176]))
    close(model.rate_weight, [0.1] * 4)
    assert model.final_attitude[1] == pytest.approx(0.38268, abs=5e-6)
    assert model.beta == pytest.approx(BETA)
    about = SatelliteSlew.about("roll", 45.0)
    close(about.final_attitude, model.final_attitude)
    close(SatelliteSlew.about([2, 0, 0], -45.0).final_attitude, conjugate(model.final_attitude))
    start = rotation_about([0, 0, 1], 1.0)
    turned = SatelliteSlew.about("pitch", 30, initial_attitude=start)
    axis, angle = turned.turn
    close(axis, [0, 1, 0])
    assert np.rad2deg(angle) == pytest.approx(30)


def test_the_short_way_is_taken():
    model = SatelliteSlew.about("roll", 270.0)
    axis, angle = model.turn
    close(axis, [-1, 0, 0])
    assert np.rad2deg(angle) == pytest.approx(90)
    assert model.target @ model.initial_attitude > 0
    other = replace(model, final_attitude=-model.final_attitude)
    close(other.target, model.target)


@pytest.mark.parametrize(
    "change",
    [{}, {"inertia": FULL}, {"final_gimbals": None, "rate_weight": [0, 1, 2, 3]}, {"margin": 0.25}],
)
def test_json_round_trip_is_exact(change):
    model = SatelliteSlew.about([1, 2, 3], 33.3, name="a", **change)
    again = Model.from_json(model.to_json())
    assert isinstance(again, SatelliteSlew)
    assert again.digest == model.digest
    assert again.to_json() == model.to_json()
    assert json.loads(model.to_json())["data"]["pyramid_angle"] == 54.73


def test_final_gimbals_may_lie_anywhere_on_the_same_momentum():
    # Null motion from zero: gimbals that hold no momentum either.
    s = 0.3
    other = [s, -s, s, -s]
    close(momentum_direction(other, BETA), np.zeros(3))
    assert SatelliteSlew(final_gimbals=other).final_gimbals[0] == s
    # And with a momentum of their own, which stays where it is while the body turns.
    held = SatelliteSlew(initial_gimbals=[0.1, 0.2, 0.3, 0.4], final_gimbals=None)
    close(rotation_matrix(held.final_attitude) @ held.final_momentum, held.total_momentum)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inertia": [228, 188]}, "inertia must be a symmetric matrix of shape .* got shape"),
        ({"inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "inertia must be symmetric"),
        ({"inertia": [1, 1, -1]}, "inertia must be positive definite"),
        ({"inertia": [1, 1, 3]}, "no principal moment of a body exceeds"),
        ({"inertia": ["a", 1, 3]}, "must be a number"),
        ({"final_attitude": [1, 1, 0, 0]}, "final_attitude must be a unit quaternion"),
        ({"initial_attitude": [1, 0, 0]}, "initial_attitude must have shape"),
        ({"margin": 1.0}, "margin must be < 1"),
        ({"margin": -0.1}, "margin must be >= 0"),
        ({"momentum": 0}, "momentum must be > 0 N m s"),
        ({"torque_limit": -1}, "torque_limit must be > 0 N m"),
        ({"time_range": [5, 4]}, "time_range must be"),
        ({"time_range": [0, 0]}, "time_range must be"),
        ({"pyramid_angle": 95}, "pyramid_angle must be <= 90 degrees"),
        ({"rate_weight": [1, 2]}, "rate_weight must have shape"),
        ({"rate_weight": -1}, "must be >= 0"),
        ({"final_gimbals": [0.5, 0, 0, 0]}, "would not be at rest"),
        ({"initial_gimbals": [0.5, 0, 0, 0]}, "would not be at rest"),
        ({"initial_gimbals": [-np.pi / 2, 0, np.pi / 2, 0]}, "initial_gimbals must have det"),
        ({"momentum": float("nan")}, "momentum must be finite"),
        ({"margin": "0.1"}, "margin must be a number"),
    ],
)
def test_bad_data_is_named(change, words):
    with pytest.raises(InvalidData, match=words):
        SatelliteSlew(**change)


def test_bad_turns_are_named():
    with pytest.raises(InvalidData, match="axis must not be zero"):
        SatelliteSlew.about([0, 0, 0], 10)
    with pytest.raises(InvalidData, match="axis must be one of roll, pitch, yaw"):
        SatelliteSlew.about("x", 10)
    with pytest.raises(InvalidData, match="leave it out"):
        SatelliteSlew.about("roll", 10, final_attitude=[1, 0, 0, 0])
    with pytest.raises(InvalidData, match="unknown key 'omega'"):
        SatelliteSlew.from_data({"omega": 1})
