"""Robots under way keep their separation everywhere, in a check that shares nothing with ours."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from fleet_mission.contacts import contacts, least_distance, mission
from fleet_mission.missions import flown, small

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission.curves import coefficients_between

HEAD_ON = FleetMission(
    obstacles=[[[5, 9], [6, 9], [6, 10], [5, 10]]], bounds=(0, 0, 20, 10), nodes=[[18, 5], [18, 5.5]],
    depot=(1, 5), vehicles=2, cell=0.5, radius=0.4, separation=0.8,
)  # fmt: skip


def test_a_robot_that_returns_does_not_meet_one_that_leaves():
    """They were 3.5 cm apart 1.19 m from the depot, and the plan was verified."""
    answer = ct.solve(HEAD_ON, time_limit=20, seed=1)
    assert answer.verified
    assert not contacts(HEAD_ON, answer.plan)
    assert answer.plan.parking == ((1.0, 5.0), (1.0, 5.0))
    check = answer.verification.checks[-1]
    assert check.name == "distance between robots"
    assert "queue" in check.where


# Two to nine robots. If the separation is not required, each mission has contacts (1 to 36 pairs).
@pytest.mark.parametrize(
    "seeds",
    [
        (5, 11),
        pytest.param((1,), marks=pytest.mark.slow),
        *(pytest.param(range(k, k + 25), marks=pytest.mark.slow) for k in range(0, 500, 25)),
    ],
)
def test_drawn_missions_have_plans_without_a_contact(seeds):
    for seed in seeds:
        model = mission(seed)
        answer = ct.solve(model, time_limit=20, seed=1)
        assert answer.plan is not None, (seed, answer)
        assert not contacts(model, answer.plan), seed


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_both_checks_find_the_same_least_distance(share):
    """Two robots pass one another on parallel lines, near the depot too."""
    model = small(separation=1.0, obstacles=[])
    plan = flown(
        [[1, 1], (1, [8, 2]), (None, [1, 1])], [[1, 1], (0, [8, 8]), (2, [2, 8]), (None, [1, 1])]
    )
    late = plan.trajectories[1]
    for delay in np.linspace(0.0, late.times[-1], 7):
        moved = type(late)(late.times + delay, late.coefficients)
        changed = replace(
            plan, trajectories=(plan.trajectories[0], moved), visits=(plan.visits[0], plan.visits[1] + delay)
        )  # fmt: skip
        data = [one.to_data() for one in changed.trajectories]
        least, _ = least_distance(*data)
        if not np.isfinite(least):
            continue
        limit = max(least, 1e-3) / share
        asked = replace(model, separation=limit)
        check = asked.verify(changed).checks[-1]
        assert check.ok == (least >= limit - check.tolerance)
        assert bool(contacts(asked, changed)) != check.ok
        if not check.ok:
            assert check.worst == pytest.approx(limit - least, abs=1e-5)


def test_the_separation_is_two_radii_unless_it_is_given():
    """It was 0, and robots of radius 0.4 m passed 0.08 m apart."""
    model = replace(HEAD_ON, separation=None)
    assert model.separation == 0.8
    assert model.digest == HEAD_ON.digest
    free = replace(HEAD_ON, separation=0)
    answer = ct.solve(free, time_limit=20, seed=1)
    assert answer.verification.checks[-1].name == "separation not required"
    with pytest.raises(InvalidData, match="separation must be >= 0"):
        replace(HEAD_ON, separation=-1)


def test_a_radius_around_the_depot_exempts_no_robot():
    with pytest.warns(DeprecationWarning, match="depot_radius has no effect"):
        model = replace(HEAD_ON, depot_radius=5.0)
    assert model.digest == HEAD_ON.digest
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert FleetMission.from_json(HEAD_ON.to_json()).digest == HEAD_ON.digest


def test_a_curve_with_further_knots_and_a_higher_degree_is_the_same():
    draw = np.random.default_rng(4)
    curve = Trajectory([1.0, 1.5, 4.0], draw.normal(size=(2, 4, 2)))
    knots = np.array([1.0, 1.2, 1.5, 2.0, 4.0])
    finer = Trajectory(knots, coefficients_between(curve, knots, 6))
    times = np.linspace(1.0, 4.0, 50)
    assert finer.degree == 6
    assert np.allclose(finer(times), curve(times), rtol=1e-12, atol=1e-12)
