"""Flights that are planned again in the air."""

import numpy as np
import pytest
from flight.flights import RING, around

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.solvers.flight import replanning
from crosstrack.solvers.minimum_snap import minco


def test_replans_along_the_way_and_keeps_the_limits():
    model = around()
    prepared = ct.prepare(model)
    replan = prepared.replan(model.start)
    flown, count = 0.0, 0
    while replan.trajectory.duration > 0.4:
        state = [replan.trajectory(0.2, order) for order in range(3)]
        flown += 0.2
        replan = prepared.replan(*state)
        count += 1
        assert replan.ok
        if count % 10 == 1:
            assert replan.verification().ok
        np.testing.assert_allclose(replan.trajectory(0.0), state[0], atol=1e-9)
        np.testing.assert_allclose(replan.trajectory(0.0, 1), state[1], atol=1e-8)
    assert flown + replan.trajectory.duration == pytest.approx(
        prepared.solution.plan.duration, rel=0.05
    )
    assert count > 30


def test_replans_from_a_disturbed_state_and_outside_the_corridor():
    prepared = ct.prepare(around(waypoints=[[5, 4]]))
    near = prepared.replan([0.3, 0.5], [0.2, 0.3])
    assert near.ok and near.warm and near.verification().ok
    away = prepared.replan([-12.0, 8.0])
    assert away.ok and not away.warm and away.verification().ok
    with pytest.raises(InvalidData, match="position"):
        prepared.replan([np.nan, 0.0])
    with pytest.raises(InvalidData, match="obstacle"):
        prepared.replan([5.0, 0.0])


@pytest.mark.parametrize(("middle", "kept"), [(-0.033, False), (-0.034, True)])
def test_a_replan_is_checked_between_instants(monkeypatch, middle, kept):
    prepared = ct.prepare(around())
    last = prepared._last

    def measure(task, durations, jets, vehicle, rows):
        vehicle[:], rows[:] = -0.3, -0.3
        rows[-1, 8:10] = middle  # the parabola is higher by an eighth of the difference to -0.3

    monkeypatch.setattr(replanning, "measure", measure)
    assert prepared._keeps(last.durations, last.jets()[0], np.arange(last.segments)) is kept


def test_a_search_computes_its_derivatives_once_per_unknowns(monkeypatch):
    search = ct.prepare(around())._last
    calls = []
    spline = minco.spline
    monkeypatch.setattr(minco, "spline", lambda *given: calls.append(1) or spline(*given))
    search.last = None
    before = search.jets()
    assert search.jets() is before and len(calls) == 1
    search.stretch(1.1)
    after = search.jets()
    assert len(calls) == 2 and after[1] < before[1]
    np.testing.assert_array_equal(after[0][:, 0], before[0][:, 0])


def test_a_replan_returns_to_the_last_plan_if_the_search_fails(monkeypatch):
    prepared = ct.prepare(around(waypoints=[[5, 4]]))
    last = prepared.replan((0, 0)).trajectory
    monkeypatch.setattr(prepared, "_keep", lambda *_: False)
    for _ in range(2):  # from the last curve, and from a corrected one
        state = np.stack([last(1.0, order) for order in range(3)])
        state = state + np.array([[0.01], [0.01], [0.0]])
        replan = prepared.replan(*state)
        assert replan.ok and replan.warm and replan.returns
        curve = replan.trajectory
        np.testing.assert_allclose([curve(0.0, order) for order in range(3)], state, atol=1e-7)
        assert curve.duration == pytest.approx(last.duration - 1.0, abs=0.05)
        # Beyond the correction it is the last plan.
        later = np.linspace(0.7, 1.0, 9) * curve.duration
        ends = later + last.duration - curve.duration
        np.testing.assert_allclose(curve(later), last(ends), atol=1e-7)
        assert replan.verification().ok
        assert np.linalg.norm(curve(curve.times) - [5.0, 4.0], axis=1).min() < 1e-9
        last = curve
    # Too fast to be on the last plan again before the goal: the last segment takes longer.
    state = [last(last.duration - 0.5, order) for order in range(3)]
    state[1] = state[1] + [0.2, 0.0]
    slower = prepared.replan(*state)
    assert slower.ok and slower.returns and slower.trajectory.duration > 0.5
    assert slower.verification().ok


def test_prepare_refuses_options_and_flights_without_a_plan():
    with pytest.raises(UnsupportedOption, match="no options"):
        ct.prepare(around(), intervals=4)
    with pytest.raises(UnsupportedOption, match="no options"):
        ct.prepare(around(), backend="staged")
    with pytest.raises(UnsupportedFormulation, match="corridor: path must keep a distance"):
        ct.prepare(around(start=(3.7, 0)))
    with pytest.raises(UnsupportedFormulation, match="infeasible"):
        ct.prepare(around(map=[RING], goal=(5, 0)))
    with pytest.raises(UnsupportedFormulation, match="different places"):
        ct.prepare(around(goal=(0, 0)))


def test_a_replan_that_leaves_the_bounds_at_the_start_is_not_ok():
    """The corridor has no inset at the start, which touches the bounds."""
    prepared = ct.prepare(around(bounds=(0, -9, 11, 9)))
    for velocity in ((0.0, 0.2), (-0.05, 0.0)):
        replan = prepared.replan((0, 0), velocity)
        assert replan.ok == (velocity[0] == 0.0)
        assert replan.verification().ok == replan.ok


def test_replanning_at_the_goal_and_outside_the_corridor():
    prepared = ct.prepare(around())
    assert prepared.replan((10, 0)).ok
    replan = prepared.replan((3, -4))  # the other side of the wall
    assert replan.ok and not replan.warm
    assert replan.verification().ok
    assert np.allclose(replan.trajectory(0.0), (3, -4))
