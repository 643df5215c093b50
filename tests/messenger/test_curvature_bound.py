"""Curvature bound: flights that it never exceeds, and flights that it equals."""

import math

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.checks import integrated
from crosstrack.models.messenger.plan import Primitive, TourPlan
from crosstrack.solvers.messenger.bound_conic import Chains
from crosstrack.solvers.messenger.bound_kernels import splice, tabulate
from crosstrack.solvers.messenger.bound_search import guide
from crosstrack.solvers.messenger.turn_kernels import corner

BOUNDS = ("euclidean-bound", "curvature-bound")


def flight(seed, turns, straight):
    """Return a model and a feasible flight with turns of at most `turns` rad."""
    draw = np.random.default_rng(seed)
    radius = 10.0 ** draw.uniform(-2, 2)
    n = int(draw.integers(1, 6))
    pieces, heading = [], 0.0
    for leg in range(n):
        for turn in draw.choice(["L", "R"]), "S", draw.choice(["L", "R"]):
            length = float(draw.uniform(0, straight if turn == "S" else turns) * radius)
            pieces.append(Primitive(leg, str(turn), length, heading))
            heading += {"L": 1, "S": 0, "R": -1}[turn] * length / radius
    times = np.cumsum([one.length for one in pieces])[2::3] / 10
    plan = TourPlan(range(n), times, np.zeros((n, 2)), np.zeros(3), pieces)
    points = integrated(plan, radius)[3::3, :2]
    ways = draw.uniform(0, 2 * math.pi, n)
    fast = 10 * draw.choice([0.0, 0.35, 0.99], n, p=[0.5, 0.3, 0.2])
    motion = (fast * [np.cos(ways), np.sin(ways)]).T
    reach = draw.choice([0.0, 1e-3, 0.5, 3.0], n) * radius
    apart = draw.normal(size=(n, 2))
    apart *= (reach * draw.choice([0.5, 1 - 1e-9], n) / np.hypot(*apart.T))[:, None]
    model = MessengerTour(
        points + apart - motion * times[:, None], motion, reach, turning_radius=radius,
        start=[0, 0, 0] if seed % 3 else [0, 0],
    )  # fmt: skip
    return model, TourPlan(range(n), times, points, np.zeros(3), pieces)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(45))
def test_no_flight_is_shorter_than_a_bound(seed):
    model, plan = flight(seed, *[(1.0, 8.0), (3.0, 4.0), (6.0, 1.0)][seed // 15])
    checked = model.verify(plan)
    assert checked.ok, checked.summary()
    plain, curved = (ct.solve(model, name).dual_bound for name in BOUNDS)
    assert 0 <= plain * (1 - 1e-9) <= curved <= checked.objective * (1 + 1e-12)


def round_flight(seed):
    """Return a closed model and a feasible flight around a convex polygon, in either direction."""
    draw = np.random.default_rng(seed)
    radius, n = 10.0 ** draw.uniform(-2, 2), int(draw.integers(1, 6))
    ways = np.sort(draw.uniform(0, 2 * math.pi, 5))
    corners = radius * draw.choice([0.1, 3.0, 20.0]) * np.column_stack([np.cos(ways), np.sin(ways)])
    sides = np.roll(corners, -1, axis=0) - corners
    headings = np.unwrap(np.arctan2(sides[:, 1], sides[:, 0]))
    turns = np.diff([*headings, headings[0] + 2 * math.pi])
    sign = 1 - 2 * (seed % 2)
    letter = "L" if sign > 0 else "R"
    # Each side and the following turn, cut at the encounters, from the middle of a side on.
    whole = [("S", 0.5 * np.hypot(*sides[0])), (letter, radius * turns[0])]
    for side, turn in zip(sides[1:], turns[1:], strict=True):
        whole += [("S", np.hypot(*side)), (letter, radius * turn)]
    whole.append(("S", whole[0][1]))
    met = np.sort(draw.uniform(0, sum(length for _, length in whole), n))
    start = np.array([0, 0, draw.uniform(0, 6)])
    pieces, heading, flown_so_far = [], start[2], 0.0
    for letters, length in whole:
        ends = [one - flown_so_far for one in met if flown_so_far < one < flown_so_far + length]
        for part in np.diff([0, *ends, length]).tolist():
            leg = int((met < flown_so_far + part / 2).sum())
            pieces.append(Primitive(leg, letters, part, heading))
            heading += 0 if letters == "S" else sign * part / radius
            flown_so_far += part
    draft = TourPlan(range(n), met / 10, np.zeros((n, 2)), start, pieces)
    legs = np.array([one.leg for one in pieces])
    points = integrated(draft, radius)[np.searchsorted(legs, range(n), side="right"), :2]
    still = seed % 3 > 0
    motion = draw.uniform(-6, 6, (n, 2)) * (not still)
    reach = draw.choice([0.0, 0.5], n) * radius
    where = [None, start[:2], start][draw.integers(0 if still else 1, 3)]
    model = MessengerTour(
        points - motion * draft.times[:, None], motion, reach, turning_radius=radius, start=where,
        closed=True,
    )  # fmt: skip
    return model, TourPlan(range(n), draft.times, points, start, pieces)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(40))
def test_no_closed_flight_is_shorter_than_a_bound(seed):
    model, plan = round_flight(seed)
    checked = model.verify(plan)
    assert checked.ok, checked.summary()
    plain, curved = (ct.solve(model, name).dual_bound for name in BOUNDS)
    assert 0 <= plain * (1 - 1e-9) <= curved <= checked.objective * (1 + 1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.5, 2.5, 3.14])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e6])
def test_the_curvature_bound_of_a_turn_and_a_straight_line_is_exact(turn, unit):
    along = np.array([math.cos(turn), math.sin(turn)])
    target = unit * (np.array([along[1], 1 - along[0]]) + 20 * along)
    model = MessengerTour([target], radius=0, turning_radius=unit, start=[0, 0, 0])
    found = ct.solve(model, "curvature-bound").dual_bound
    assert found == pytest.approx((turn + 20) * unit, rel=1e-5)
    assert found <= (turn + 20) * unit * (1 + 1e-12)


def test_the_curvature_bound_of_a_square_is_exact():
    # Four sides, each with an eighth of a circle at either end.
    corners = [[0, 20], [20, 20], [20, 0], [0, 0]]
    model = MessengerTour(corners, radius=0, turning_radius=1, start=None, closed=True)
    wanted = 4 * (20 + 2 * (math.pi / 4 - math.sin(math.pi / 4)))
    found = ct.solve(model, "curvature-bound").dual_bound
    assert found == pytest.approx(wanted, rel=1e-5)
    assert found <= wanted * (1 + 1e-12)
    began = MessengerTour(corners[:3], radius=0, turning_radius=1, start=[0, 0], closed=True)
    assert ct.solve(began, "curvature-bound").dual_bound == pytest.approx(wanted, rel=1e-5)
    headed = MessengerTour(
        corners[:3], radius=0, turning_radius=1, start=[0, 0, 0.75 * math.pi], closed=True
    )
    assert ct.solve(headed, "curvature-bound").dual_bound == pytest.approx(wanted, rel=1e-5)


@pytest.mark.sample(2)
@pytest.mark.parametrize("angle", [1e-6, 0.3, 1.5, 2.5, 3.1, math.pi])
@pytest.mark.parametrize("weights", [(1.0, 1.0), (1e-3, 2.0), (5.0, 0.1), (1.0, 0.0)])
@pytest.mark.parametrize("halves", [(9.0, 9.0), (0.0, 9.0), (0.2, 0.7), (1.5, 1.0)])
def test_the_loss_at_a_corner_is_a_close_lower_bound(angle, weights, halves):
    def lost(off, half):
        # The angle decreases by at most the length flown.
        s = (np.arange(500) + 0.5) * half / 500
        return (1 - np.cos(np.maximum(off[:, None] - s, 0))).mean(axis=1) * half

    x = np.linspace(0, angle, 301)
    least = (weights[0] * lost(x, halves[0]) + weights[1] * lost(angle - x, halves[1])).min()
    found = corner(angle, weights[0], halves[0], weights[1], halves[1])
    assert -1e-4 <= least - found <= 0.03 * max(least, 1e-3) + 1e-4


@pytest.mark.parametrize("seed", range(16))
def test_any_directions_prove_a_bound_with_turns(seed):
    model, plan = flight(seed, 1.0, 8.0)
    chains = Chains(model, curved=True)
    field = chains.field
    stops = field.chain(plan.order)
    draw = np.random.default_rng(seed)
    length = sum(one.length for one in plan.primitives)
    path = chains.solve(stops)
    for noise in (0.0, 0.01, 0.3, 3.0):
        directions = path.directions + draw.normal(0, noise, path.directions.shape)
        assert chains.prove(stops, directions) * field.unit <= length * (1 + 1e-12)
    assert 0 <= chains.prove(stops, path.directions) <= path.bound
    assert Chains(model).solve(stops).bound <= path.bound * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(24))
def test_a_bound_with_legs_replaced_is_that_of_the_whole_path(seed):
    model, plan = (flight if seed % 2 else round_flight)(seed, *([2.0, 4.0] if seed % 2 else []))
    chains = Chains(model, curved=seed % 4 > 1)
    draw = np.random.default_rng(seed)
    stops = chains.field.chain(plan.order)
    if len(stops) < 3:
        return
    legs = len(stops) - 1
    directions = chains.solve(stops).directions + draw.normal(0, 0.2, (legs, 2))
    for taken in range(1, legs if model.closed else legs + 1):
        fewer, table = np.delete(stops, taken), np.empty((legs - 1, 6))
        rest = np.delete(directions, taken - 1, axis=0)
        tabulate(chains.data, fewer, rest, table)
        more, tried = stops[taken - 1 : taken + 2], directions[taken - 1 : taken + 1]
        until = min(taken, legs - 1)
        found = splice(chains.data, fewer, table, taken - 1, until, more.copy(), tried.copy())
        wanted = chains.prove(stops, directions)
        size = max(wanted, np.abs(chains.field.centres).max())
        assert max(found, 0) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * size)


def test_a_guide_is_the_flight_where_the_bound_is_exact():
    corners = np.array([[0, 20], [20, 20], [20, 0], [0, 0]])
    # Around a square of discs, the flight is that around their outermost points; with and without
    # start.
    inner = corners + 2 * np.sqrt(0.5) * np.sign(10 - corners)
    for where in ({"start": None}, {"start": [0, -1e-9, -0.75 * math.pi]}):
        model = MessengerTour(inner, radius=2, turning_radius=1, closed=True, **where)
        found = guide(model, [0, 1, 2, 3] if where["start"] is None else [2, 1, 0])
        assert found.bound > 0
        assert np.hypot(*found.offsets.T) == pytest.approx(np.full(len(found.offsets), 2.0))
    still = MessengerTour(corners, radius=0, turning_radius=1, start=None, closed=True)
    found = guide(still, [0, 1, 2, 3])
    wanted = np.array([0.25, -0.25, -0.75, 0.75]) * math.pi
    assert np.abs(np.sin((found.headings - wanted) / 2)).max() < 1e-3
    assert np.abs(found.offsets).max() == 0
    # The single disc is met straight ahead, on its near side.
    ahead = MessengerTour([[30, 0]], [[-3, 0]], radius=2, turning_radius=1, start=[0, 0, 0])
    found = guide(ahead, [0])
    assert found.offsets[0] == pytest.approx([-2, 0], abs=1e-3)
    assert found.headings[0] == pytest.approx(0, abs=1e-3)
    assert found.bound == pytest.approx(28 / 1.3, rel=1e-6)
