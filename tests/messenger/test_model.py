"""Messenger tours: data, plan, and verification from the primitives alone."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

from crosstrack.errors import InvalidData
from crosstrack.models import MessengerTour, Model, Primitive, TourPlan
from crosstrack.models.messenger.checks import integrated
from crosstrack.models.messenger.motion import guess_tour

CURVATURE = {"L": 1.0, "S": 0.0, "R": -1.0}


def drawn(seed, n=5, side=150.0, **how):
    rng = np.random.default_rng(seed)
    angle, pace = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 3.5, n)
    rate = pace[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return MessengerTour(rng.uniform(0, side, (n, 2)), rate, **how)


def bound(model):
    """Return a verified tour of `model` through the centre of every disc."""
    plan = guess_tour(model, None, None)
    assert model.verify(plan, tolerance=1e-9).ok
    return plan


def violated(model, plan, tolerance=1e-6):
    return {check.name for check in model.verify(plan, tolerance=tolerance).violated}


def changed(plan, number, **what):
    """Return `plan` with some fields of one primitive changed."""
    pieces = list(plan.primitives)
    pieces[number] = pieces[number]._replace(**what)
    return replace(plan, primitives=tuple(pieces))


# -- what the check finds ------------------------------------------------------------------------


@pytest.fixture
def model():
    return drawn(3)


@pytest.fixture
def plan(model):
    return bound(model)


def test_late_times_are_violations(model, plan):
    times = plan.times.copy()
    times[2] += 1e-4
    found = model.verify(replace(plan, times=times))
    (check,) = found.violated
    assert check.name == "length flown is speed times time"
    assert check.worst == pytest.approx(1e-3, rel=1e-6)
    assert check.where == f"vehicle {plan.order[2]}"


def test_rejects_a_vehicle_outside_its_radius(model, plan):
    smaller = replace(model, radius=1e-3)
    assert smaller.verify(plan).ok
    positions = model.positions.copy()
    positions[plan.order[1]] += [0.0, 0.002]
    moved = replace(smaller, positions=positions)
    found = moved.verify(plan)
    (check,) = found.violated
    assert check.name == "encounter within radius"
    assert check.where == f"vehicle {plan.order[1]}"
    assert check.worst == pytest.approx(1e-3, rel=1e-5)


def test_rejects_a_point_off_the_path(model, plan):
    points = plan.points.copy()
    points[0, 1] += 1e-4
    assert violated(model, replace(plan, points=points)) == {"encounter at its point"}


@pytest.mark.parametrize("turn", [2e-6, -1.0, math.pi])
def test_rejects_a_heading_with_a_jump(model, plan, turn):
    at = len(plan.primitives) // 2
    bent = changed(plan, at, heading=plan.primitives[at].heading + turn)
    found = model.verify(bent)
    assert {check.name for check in found.violated} == {"headings without a jump"}
    assert found.violated[0].where == f"primitive {at}"
    # A full circle is not a jump.
    assert model.verify(changed(plan, at, heading=plan.primitives[at].heading - 2 * math.pi)).ok


def test_rejects_a_reversed_turn(model, plan):
    at = next(k for k, one in enumerate(plan.primitives) if one.turn != "S" and one.length > 1)
    other = {"L": "R", "R": "L"}[plan.primitives[at].turn]
    found = violated(model, changed(plan, at, turn=other))
    assert {"headings without a jump", "encounter at its point", "encounter within radius"} <= found


def test_rejects_a_negative_length(model, plan):
    at = next(k for k, one in enumerate(plan.primitives) if one.turn == "S" and one.leg == 0)
    back = Primitive(0, "S", -1.0, plan.primitives[at].heading)
    on = Primitive(0, "S", 1.0, plan.primitives[at].heading)
    pieces = (*plan.primitives[: at + 1], on, back, *plan.primitives[at + 1 :])
    found = model.verify(replace(plan, primitives=pieces))
    (check,) = found.violated
    assert (check.name, check.where, check.worst) == (
        "lengths at least 0",
        f"primitive {at + 2}",
        1.0,
    )


def test_rejects_missing_and_repeated_vehicles(model, plan):
    twice = replace(plan, order=(plan.order[0], *plan.order[:-1]))
    assert "each vehicle met once" in violated(model, twice)
    short = replace(plan, order=plan.order[:-1], times=plan.times[:-1], points=plan.points[:-1])
    assert violated(model, short) == {
        "each vehicle met once", "legs in order", "ends at the last encounter"
    } - ({"legs in order"} if max(p.leg for p in plan.primitives) < model.size else set())  # fmt: skip
    swapped = (plan.order[1], plan.order[0], *plan.order[2:])
    assert violated(model, replace(plan, order=swapped)) == {"encounter within radius"}
    with pytest.raises(InvalidData, match=r"order\[0\] must be in 0 … 4, got 5"):
        model.verify(replace(plan, order=(5, *plan.order[1:])))
    nobody = TourPlan((), [], np.zeros((0, 2)), plan.start, ())
    assert "each vehicle met once" in violated(model, nobody)


def test_rejects_legs_out_of_order(model, plan):
    swapped = changed(plan, 0, leg=plan.primitives[-1].leg)
    assert "legs in order" in violated(model, swapped)
    assert "legs in order" in violated(model, changed(plan, -1, leg=model.size))


def test_rejects_another_start(model, plan):
    moved = replace(
        plan, start=plan.start + np.array([1e-4, 0, 0]), points=plan.points + np.array([1e-4, 0])
    )
    assert violated(model, moved) == {"starts at its place"}
    pieces = tuple(one._replace(heading=one.heading + 1e-3) for one in plan.primitives)
    turned = replace(plan, start=plan.start + np.array([0, 0, 1e-3]), primitives=pieces)
    assert "starts with its heading" in violated(model, turned)
    assert "starts with its heading" not in violated(replace(model, start=model.start[:2]), turned)
    full = replace(plan, start=plan.start + np.array([0, 0, 2 * math.pi]))
    assert model.verify(full).ok


def test_rejects_a_flight_beyond_the_last_encounter(model, plan):
    end = integrated(plan, model.turning_radius)[-1, 2]
    last = Primitive(model.size - 1, "S", 1.0, float(end))
    longer = replace(plan, primitives=(*plan.primitives, last))
    # In the last leg it delays the encounter; as an additional leg it exceeds the number of legs.
    assert "length flown is speed times time" in violated(model, longer)
    beyond = replace(plan, primitives=(*plan.primitives, last._replace(leg=model.size)))
    assert violated(model, beyond) == {"legs in order", "ends at the last encounter"}


def test_rejects_a_tour_that_does_not_close():
    model = drawn(4, closed=True)
    plan = bound(model)
    assert violated(model, changed(plan, -1, length=plan.primitives[-1].length + 1e-3)) == {
        "ends where it begins"
    } | ({"headings without a jump"} if plan.primitives[-1].turn != "S" else set())  # fmt: skip
    # Back at the start with another heading.
    open_end = replace(model, start=model.start[:2])
    assert open_end.verify(plan).ok
    cut = tuple(one for one in plan.primitives if one.leg < model.size)
    assert violated(model, replace(plan, primitives=cut)) >= {"ends where it begins"}


def test_a_turn_without_a_radius_has_no_length():
    model = drawn(5, turning_radius=0.0)
    plan = bound(model)
    at = len(plan.primitives) // 2
    assert violated(model, changed(plan, at, turn="L")) == {"straight but for turns on the spot"}
    turned = Primitive(plan.primitives[at].leg, "L", 0.0, 1.0)
    pieces = (*plan.primitives[:at], turned, *plan.primitives[at:])
    assert model.verify(replace(plan, primitives=pieces)).ok
    # Each line keeps its own heading.
    assert violated(model, changed(plan, at, heading=plan.primitives[at].heading + 0.1)) == {
        "encounter at its point", "encounter within radius"
    }  # fmt: skip


@pytest.mark.parametrize("length", [1e300, 1.7e308])
def test_overflow_is_a_violation(model, plan, length):
    for at in range(len(plan.primitives)):
        assert not model.verify(changed(plan, at, length=length)).ok
    assert not model.verify(replace(plan, times=plan.times + 1e308)).ok
    assert not model.verify(replace(plan, points=plan.points + 1e308)).ok
    assert not model.verify(replace(plan, start=plan.start + 1e308)).ok


# -- what it does not let pass -------------------------------------------------------------------


def test_a_wide_disc_does_not_widen_a_narrow_one(model, plan):
    radius = np.full(5, 1e6)
    radius[plan.order[3]] = 1e-4
    wide = replace(model, radius=radius)
    assert wide.verify(plan).ok
    positions = model.positions.copy()
    positions[plan.order[3], 0] += 1.2e-4
    assert violated(replace(wide, positions=positions), plan) == {"encounter within radius"}


@pytest.mark.parametrize("far", [1e9, 1e11])
def test_a_far_vehicle_does_not_excuse_the_near_ones(far):
    model = MessengerTour([[100.0, 0.0], [far, 0.0]], radius=1.0, start=(0.0, 0.0, 0.0))
    plan = bound(model)
    moved = replace(model, positions=[[100.0, 1.001], [far, 0.0]])
    assert violated(moved, plan) == {"encounter within radius"}
    # The rounding error of the far one is excused, because no plan can avoid it.
    assert model.verify(changed(plan, -1, length=plan.primitives[-1].length)).ok


def test_without_a_radius_the_field_is_the_scale():
    model = drawn(6, radius=0.0)
    plan = bound(model)
    room = model.extent / model.size
    for share, fine in ((0.9e-6, True), (1.1e-6, False)):
        positions = model.positions.copy()
        positions[plan.order[2], 0] += share * room
        assert replace(model, positions=positions).verify(plan).ok == fine


@given(
    st.integers(0, 10),
    st.sampled_from([1e-3, 0.1, 1e3, 1e7]),
    st.sampled_from([0.0, 1e-7, 3e-6, 0.1]),
)
@settings(max_examples=40, deadline=None)
def test_answers_scale(seed, scale, off):
    model = drawn(seed, closed=bool(seed % 2))
    plan = guess_tour(model, None, None)
    plan = replace(plan, points=plan.points + off * 5.0, times=plan.times * (1 + off))
    large = replace(
        model, positions=scale * model.positions, velocities=scale * model.velocities,
        radius=scale * model.radius, speed=scale * model.speed,
        turning_radius=scale * model.turning_radius, start=model.start * [scale, scale, 1],
    )  # fmt: skip
    pieces = tuple(one._replace(length=scale * one.length) for one in plan.primitives)
    grown = replace(
        plan, points=scale * plan.points, start=plan.start * [scale, scale, 1], primitives=pieces
    )
    first, second = model.verify(plan), large.verify(grown)
    assert first.objective * scale == pytest.approx(second.objective, rel=1e-12)
    for one, other in zip(first.checks, second.checks, strict=True):
        unit = scale if one.unit == "m" else 1.0
        assert (one.name, one.ok) == (other.name, other.ok)
        assert other.worst == pytest.approx(unit * one.worst, rel=1e-6, abs=unit * 1e-9)
        assert other.tolerance == pytest.approx(unit * one.tolerance, rel=1e-4)


# -- the motion, by other means ------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.sampled_from("LSR"), st.floats(0, 30)), min_size=1, max_size=12),
    st.floats(-10, 10), st.sampled_from([0.5, 5.0, 1e6]),
)  # fmt: skip
@settings(max_examples=15, deadline=None)
def test_poses_follow_the_curvature(pieces, heading, radius):
    plan = TourPlan(
        (), [], np.zeros((0, 2)), [3.0, -2.0, heading],
        tuple(Primitive(0, turn, length, 0.0) for turn, length in pieces),
    )  # fmt: skip
    poses = integrated(plan, radius)
    pose = plan.start
    for (turn, length), expected in zip(pieces, poses[1:], strict=True):
        kappa = CURVATURE[turn] / radius
        found = solve_ivp(
            lambda s, p, kappa=kappa: [math.cos(p[2]), math.sin(p[2]), kappa],
            (0.0, length), pose, method="DOP853", rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        pose = found.y[:, -1]
        np.testing.assert_allclose(expected, pose, atol=1e-8 * max(1.0, 30 / radius))


def test_without_a_turning_radius_lines_keep_their_headings():
    pieces = (
        Primitive(0, "S", 3.0, 0.0),
        Primitive(1, "S", 4.0, math.pi / 2),
        Primitive(1, "L", 0.0, 1.0),
    )
    plan = TourPlan((), [], np.zeros((0, 2)), [1.0, 1.0, 2.0], pieces)
    np.testing.assert_allclose(
        integrated(plan, 0.0), [[1, 1, 0], [4, 1, math.pi / 2], [4, 5, 1], [4, 5, 1]], atol=1e-15
    )
    assert integrated(replace(plan, primitives=()), 0.0).tolist() == [[1.0, 1.0, 2.0]]


# -- data ----------------------------------------------------------------------------------------


def test_json_round_trips(model, plan):
    again = Model.from_json(model.to_json())
    assert again.digest == model.digest
    data = json.loads(json.dumps(model.plan_to_data(plan), allow_nan=False))
    back = model.plan_from_data(data)
    assert back.order == plan.order
    assert back.primitives == plan.primitives
    for name in ("times", "points", "start"):
        np.testing.assert_array_equal(getattr(back, name), getattr(plan, name))
    assert model.verify(back) == model.verify(plan)
    named = replace(model, ids=list("abcde"), start=None, closed=True, velocities=None, name="five")
    assert Model.from_json(named.to_json()).digest == named.digest


def test_defaults_and_sizes():
    model = MessengerTour([[60, 20], [10, 70]], ids=["a", 7])
    assert model.at_rest
    assert model.velocities.tolist() == [[0, 0], [0, 0]]
    assert model.radius.tolist() == [5, 5]
    assert model.heading == pytest.approx(math.pi / 2)
    assert [model.label(k) for k in range(2)] == ["a", "7"]
    assert model.extent == pytest.approx(math.hypot(60, 70))
    assert model.sparsity == pytest.approx((math.hypot(50, 50) - 10) / 5)
    assert MessengerTour([[1, 1]]).sparsity == math.inf
    moving = MessengerTour([[0, 0]], [[1, -2]])
    assert moving.where(0, 3.0).tolist() == [3, -6]
    assert not moving.at_rest


@pytest.mark.parametrize(
    ("data", "field", "words"),
    [
        ({"positions": np.zeros((0, 2))}, "positions", "at least one vehicle"),
        ({"positions": [[0, 0, 0]]}, "positions", ""),
        ({"positions": [[0, math.nan]]}, "positions", "nan"),
        ({"positions": [[0, "a"]]}, "positions", ""),
        ({"velocities": [[1, 0]]}, "velocities", ""),
        ({"velocities": [[0, 0], [0, 0], [6, 8]]}, "velocities", r"velocities\[2\] must be slower"),
        ({"velocities": [[0, 0], [0, 0], [math.inf, 8]]}, "velocities", ""),
        ({"radius": -1.0}, "radius", "-1"),
        ({"radius": [1.0, -1e-9, 1.0]}, "radius", ""),
        ({"radius": [1.0, 1.0]}, "radius", ""),
        ({"radius": "wide"}, "radius", "wide"),
        ({"speed": 0.0}, "speed", ""),
        ({"turning_radius": -5.0}, "turning_radius", ""),
        ({"turning_radius": math.inf}, "turning_radius", ""),
        ({"start": (0.0,)}, "start", "got 1 numbers"),
        ({"start": (0.0, 0.0, 0.0, 0.0)}, "start", "got 4 numbers"),
        ({"start": None}, "start", "closed tour"),
        ({"start": None, "closed": True, "velocities": np.eye(3)[:, :2]}, "start", "at rest"),
        ({"closed": "yes"}, "closed", ""),
        ({"ids": ["a", "b", "a"]}, "ids", ""),
        ({"ids": ["a", "b"]}, "ids", ""),
    ],
)
def test_bad_data_is_rejected_with_its_field(data, field, words):
    with pytest.raises(InvalidData, match=words or field) as error:
        MessengerTour(**{"positions": np.zeros((3, 2)), **data})
    assert error.value.field == field


def test_a_bad_plan_is_rejected_with_its_field(model, plan):
    data = plan.to_data()
    piece = data["primitives"][0]
    for key, value, field in [
        ("order", [0.5, 1], "order"),
        ("order", ["0"], "order"),
        ("times", [math.nan] * 5, "times"),
        ("points", [[0, 0]], "points"),
        ("points", [[math.inf, 0]] * 5, "points"),
        ("start", [0, 0], "start"),
        ("primitives", "LSR", "primitives"),
        ("primitives", [{**piece, "turn": "X"}], "primitives[0]"),
        ("primitives", [{**piece, "turn": None}], "primitives[0]"),
        ("primitives", [piece, {**piece, "length": math.nan}], "primitives[1].length"),
        ("primitives", [{**piece, "length": math.inf}], "primitives[0].length"),
        ("primitives", [{**piece, "heading": "north"}], "primitives[0].heading"),
        ("primitives", [{**piece, "leg": -1}], "primitives[0].leg"),
        ("primitives", [{**piece, "leg": 0.5}], "primitives[0].leg"),
        ("primitives", [{"leg": 0}], "primitives[0]"),
        ("primitives", [[0, "L", 1.0]], "primitives[0]"),
    ]:
        with pytest.raises(InvalidData) as error:
            model.plan_from_data({**data, key: value})
        assert error.value.field == field
    with pytest.raises(InvalidData, match="'order'"):
        model.plan_from_data({key: value for key, value in data.items() if key != "order"})
    with pytest.raises(InvalidData, match="speed"):
        model.plan_from_data({**data, "speed": 1.0})
    with pytest.raises(InvalidData, match="object"):
        model.plan_from_data([1, 2])
    with pytest.raises(InvalidData, match="plan"):
        model.verify("a plan")


def test_a_plan_has_length_and_legs(model, plan):
    assert plan.length == pytest.approx(sum(one.length for one in plan.primitives), rel=1e-14)
    assert sum((plan.leg(k) for k in range(5)), ()) == plan.primitives
    assert str(plan).startswith("-".join(map(str, plan.order)))
