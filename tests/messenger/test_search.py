"""``tour-search``: feasible plans for all cases, and optimal plans for small ones."""

import functools
import itertools
import math

import numpy as np
import pytest
from listening import incumbents
from messenger.flights import shortest_lengths
from numpy.random import default_rng

import crosstrack as ct
from crosstrack import jit
from crosstrack.instances.messenger import generate
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.checks import integrated
from crosstrack.solvers.messenger import search
from crosstrack.solvers.messenger.chain import arrive
from crosstrack.solvers.messenger.emission import Chain, cut

QUICK = {"bound": False, "polish": False, "patience": 1, "steps": 200}


def drawn(n, seed, *, side=60.0, fastest=3.5, **fields):
    """A tour over `n` vehicles in a square, the UAV in its corner."""
    draw = default_rng(seed)
    headings, speeds = draw.uniform(0.0, 2 * np.pi, n), draw.uniform(0.0, fastest, n)
    velocities = np.column_stack([np.cos(headings), np.sin(headings)]) * speeds[:, None]
    return MessengerTour(draw.uniform(0.0, side, (n, 2)), velocities, **fields)


def searched(model, seed=1, **options):
    return ct.solve(model, "tour-search", seed=seed, backend_options={**QUICK, **options})


WILD = {
    "one": MessengerTour([[30.0, 0.0]]),
    "behind": MessengerTour([[0.0, -1.0]], radius=0.0),
    "many": drawn(35, 0, side=115.0),
    "dense": drawn(12, 1, side=15.0),
    "targets": drawn(8, 2, radius=0.0),
    "on the spot": drawn(8, 2, turning_radius=0.0),
    "points on the spot": drawn(8, 2, turning_radius=0.0, radius=0.0),
    "wide turns": drawn(5, 3, turning_radius=500.0),
    "narrow turns": drawn(6, 3, turning_radius=1e-4),
    "closed": drawn(7, 4, closed=True),
    "closed, any heading": drawn(7, 4, closed=True, start=[5.0, 5.0]),
    "any heading": drawn(7, 5, start=[0.0, 0.0]),
    "any start": drawn(7, 6, fastest=0.0, closed=True, start=None),
    "any start, points": drawn(7, 6, fastest=0.0, closed=True, start=None, radius=0.0),
    "one, any start": MessengerTour([[3.0, 4.0]], start=None, closed=True),
    "a line": MessengerTour([[10.0 * k, 0.0] for k in range(1, 8)], [[3.0, 0.0]] * 7),
    "one place": MessengerTour([[40.0, 40.0]] * 5, radius=[0.0, 0.0, 1.0, 5.0, 50.0]),
    "touching": MessengerTour([[20.0, 0.0], [30.0, 0.0], [40.0, 0.0]], radius=5.0),
    "fleeing": MessengerTour([[30.0, 0.0]], [[9.99, 0.0]]),
    "approaching": MessengerTour([[300.0, 10.0], [0.0, 500.0]], [[-9.99, 0.0], [0.0, -9.99]]),
    "all sizes": drawn(6, 7, radius=[1e-3, 1.0, 1e3, 0.0, 10.0, 1e-6]),
    "millimetres": drawn(6, 8, side=0.06, fastest=3.5e-3, speed=0.01, radius=5e-3, turning_radius=5e-3),
    "thousands of km": drawn(6, 8, side=6e6, fastest=350.0, speed=1e3, radius=5e5, turning_radius=5e5),
    "met on the way": MessengerTour([[0.0, 3.0], [0.0, 30.0]], [[0.5, 0.0], [0.0, 0.0]]),
    "far from the origin": MessengerTour(
        drawn(6, 9).positions + 1e6, drawn(6, 9).velocities, start=[1e6, 1e6, 0.0]
    ),
}  # fmt: skip


@functools.cache
def answer_to(name, interior=True):
    """Return the solution of a case; several tests look at the same."""
    return searched(WILD[name], interior=interior)


@pytest.mark.sample(2)
@pytest.mark.parametrize("interior", [True, False], ids=["inside", "boundary"])
@pytest.mark.parametrize("name", WILD)
def test_plans_of_all_cases_are_feasible(name, interior):
    model, found = WILD[name], answer_to(name, interior)
    assert found.plan is not None, found
    assert found.verification.ok
    legs_are_possible(model, found.plan)
    if not interior:
        on_the_boundary(model, found.plan)


@pytest.mark.parametrize("case", WILD)
def test_bounds_are_below_the_plan(case):
    model, found = WILD[case], answer_to(case)
    size = model.radius.max() + model.extent
    for name in ("euclidean-bound", "curvature-bound"):
        bound = ct.solve(model, name, time_limit=0.1).dual_bound
        # A plan may use the tolerance of its check.
        assert bound <= found.primal_bound * (1 + 1e-7) + 1e-7 * size


def legs_are_possible(model, plan):
    """No leg is shorter than the shortest path between its ends."""
    poses = integrated(plan, model.turning_radius)
    legs = np.array([one.leg for one in plan.primitives])
    lengths = np.array([one.length for one in plan.primitives])
    for leg in np.unique(legs):
        at = np.flatnonzero(legs == leg)
        least = shortest_lengths(poses[at[0]], poses[at[-1] + 1], model.turning_radius)
        size = lengths[at].sum() + np.abs(poses[:, :2]).max()
        if model.turning_radius > 0:
            # Because of rounding, a turn of angle 0 may become a full circle.
            off = (least - lengths[at].sum()) / (2 * np.pi * model.turning_radius)
            assert off < 1e-6 or abs(off - round(off)) < 1e-6
        else:
            assert least <= lengths[at].sum() + 1e-12 * size


def on_the_boundary(model, plan):
    for k, i in enumerate(plan.order):
        apart = math.dist(plan.points[k], model.where(i, plan.times[k]))
        assert apart == pytest.approx(model.radius[i], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("model", [WILD["dense"], WILD["closed"], WILD["all sizes"], drawn(10, 3)])
def test_polish_and_bound_keep_to_the_boundary(model):
    found = searched(model, interior=False, polish=True, bound=True)
    on_the_boundary(model, found.plan)


@pytest.mark.parametrize("seed", range(4))
def test_without_turns_and_at_rest_the_tour_is_optimal(seed):
    model = drawn(6, seed, fastest=0.0, radius=0.0, turning_radius=0.0, closed=seed % 2 == 1)
    stops = [model.start[:2], *model.positions]

    def length(order):
        way = [0, *order, *([0] if model.closed else [])]
        return sum(math.dist(stops[a], stops[b]) for a, b in itertools.pairwise(way))

    best = min(map(length, itertools.permutations(range(1, 7))))
    assert searched(model, steps=600).primal_bound == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize(
    ("seed", "closed"),
    [
        (0, False),
        (1, True),
        *(
            pytest.param(seed, closed, marks=pytest.mark.slow)
            for seed, closed in ((0, True), (1, False), (2, False), (2, True))
        ),
    ],
)
def test_at_points_at_rest_it_beats_a_grid_of_headings(seed, closed):
    model = drawn(4, seed, side=25.0, fastest=0.0, radius=0.0, closed=closed)
    headings = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    best = math.inf
    for order in itertools.permutations(range(4)):
        poses, lengths = np.array([model.start]), np.zeros(1)
        for i in order:
            new = np.column_stack([np.tile(model.positions[i], (48, 1)), headings])
            legs = shortest_lengths(poses[:, None], new[None], model.turning_radius)
            poses, lengths = new, (lengths[:, None] + legs).min(axis=0)
        if closed:
            lengths = lengths + shortest_lengths(poses, model.start, model.turning_radius)
        best = min(best, lengths.min())
    found = searched(model, steps=800, patience=3)
    assert found.primal_bound <= best * (1 + 1e-9)
    assert found.primal_bound >= 0.9 * best  # 48 headings are near enough to the best


def test_the_same_seed_gives_the_same_plan():
    model = drawn(9, 3)
    first, again, other = (searched(model, seed) for seed in (1, 1, 2))
    assert first.plan.to_data() == again.plan.to_data()
    assert first.plan.to_data() != other.plan.to_data()


def test_a_warm_start_is_never_lost():
    model = drawn(9, 4)
    good = searched(model, steps=600, patience=2)
    poor = ct.solve(
        model, "tour-search", seed=1, warm_start=good, backend_options={**QUICK, "steps": 1, "patience": 1}
    )  # fmt: skip
    assert poor.primal_bound <= good.primal_bound


def test_answers_scale():
    model = drawn(6, 5)
    for scale in (1e-3, 1e5):
        larger = MessengerTour(
            model.positions * scale, model.velocities * scale, model.radius * scale,
            model.speed * scale, model.turning_radius * scale,
        )  # fmt: skip
        ratio = searched(larger).primal_bound / searched(model).primal_bound
        assert ratio == pytest.approx(scale, rel=0.01)


def test_vehicles_met_at_the_start_cost_nothing():
    model = MessengerTour([[1.0, 0.0], [0.0, -4.9]])
    found = searched(model)
    assert found.primal_bound == 0.0
    assert found.plan.primitives == ()
    assert found.plan.times.tolist() == [0.0, 0.0]
    outwards = searched(model, interior=False)
    assert outwards.primal_bound > 0.0


@pytest.mark.parametrize("seed", range(40))
def test_a_leg_arrives_when_its_length_is_flown(seed):
    draw = default_rng(seed)
    speed, r = 10.0, float(draw.choice([0.0, 1.0, 5.0, 50.0]))
    pace = draw.choice([0.0, 3.0, 9.0, 9.99])
    angle, h = draw.uniform(0.0, 2 * np.pi, 2)
    node = np.array([*draw.uniform(-60, 60, 2), pace * np.cos(angle), pace * np.sin(angle), 5.0])
    pose = np.array([*draw.uniform(-4, 4, 2), draw.uniform(0.0, 2 * np.pi)])
    t = arrive(0.0, 0.0, h, 2.0, node, pose, speed, r)
    assert 2.0 <= t < math.inf
    end = [*(node[:2] + node[2:4] * t + pose[:2]), pose[2]]
    flown = speed * (t - 2.0)
    # As long as one of the words, the shortest but where the pose runs away from it.
    from crosstrack.models.messenger.dubins import word_lengths

    words = [sum(word_lengths(0.0, 0.0, h, *end, r, word)) for word in range(6)]
    assert min(abs(length - flown) for length in words) <= 1e-9 * (flown + r)


def test_limits_and_incumbents():
    model = drawn(30, 6)
    seen = []
    found = ct.solve(
        model, "tour-search", time_limit=0.4, seed=0, on_event=incumbents(seen.append),
        backend_options={"polish": False, "bound": False},
    )  # fmt: skip
    assert found.limit == "time"
    assert found.plan is not None
    assert [one.objective for one in seen] == sorted((one.objective for one in seen), reverse=True)
    assert seen[-1].objective == found.primal_bound


def test_overflowing_tours_end_without_a_plan():
    """Each vehicle that is caught makes the next a thousand times as far."""
    draw = default_rng(0)
    angles = draw.uniform(0.0, 2 * np.pi, 9)
    flight = np.column_stack([np.cos(angles), np.sin(angles)])
    model = MessengerTour(20.0 * flight, 9.99 * flight)
    found = searched(model)
    assert found.plan is None
    assert "no tour" in found.message


def crowd(vehicles, fastest, closed):
    model = generate(vehicles, 8.0, 1, fastest=fastest)
    return MessengerTour(model.positions, model.velocities, radius=model.radius, closed=closed)


@pytest.mark.parametrize(
    ("vehicles", "fastest", "closed"),
    [
        pytest.param(200, 3.5, False, marks=pytest.mark.slow),
        *((200, 3.5, True), (40, 9.99, False)),
    ],
)
def test_many_or_fast_vehicles_have_a_plan(vehicles, fastest, closed):
    """Up to 1e10 m are flown, so a turn that is off by 1e-10 m misses a disc.

    A busy machine returns the tour to the nearest vehicle next, so that its length has no tighter limit.
    """
    answer = ct.solve(crowd(vehicles, fastest, closed), time_limit=0.5, seed=0)
    assert answer.verified
    assert answer.primal_bound <= 1e11


@pytest.mark.slow
@pytest.mark.parametrize("closed", [False, True])
def test_two_hundred_vehicles_have_a_short_tour(closed):
    answer = searched(crowd(200, 3.5, closed), seed=0)
    assert answer.verified
    assert answer.primal_bound <= 1e6


def test_a_cut_path_keeps_the_lengths_of_its_turns():
    """A billion metres on, differences of lengths flown have 1e-7 m."""
    model = MessengerTour([[0.0, 1e9], [0.0, 2e9]])
    path = [(0, 1e9, None), (1, 3.3, None), (0, 1e9, None)]
    plan = cut(model, (0.0, 0.0, 0.0), path, {0: 1e9 + 1.1, 1: 2e9 + 3.3})
    turns = [one.length for one in plan.primitives if one.turn == "L"]
    assert len(turns) == 2
    assert sum(turns) == pytest.approx(3.3, abs=1e-15)


@pytest.mark.parametrize("velocity", [0.0, 9.99])
def test_a_tour_that_cannot_be_checked_names_the_reason(velocity):
    far = 3e13 * (1 - velocity / 10)
    model = MessengerTour([[0.0, far]], [[0.0, velocity]], radius=5.0)
    answer = ct.solve(model, time_limit=5, seed=0)
    assert answer.termination == "no_solution"
    reason = "velocities[0] of 9.99 m/s" if velocity else "nearer positions"
    for part in ("3e+13 m long", "beyond 5e+12 m", "radius, 5 m", reason):
        assert part in answer.message, part


def test_chains_of_other_models_are_not_shared():
    model = drawn(4, 1)
    chain = Chain(model)
    other = chain.copy()
    other.stops.poses[:] = 1.0
    assert not chain.stops.poses[:-1].any()


@pytest.mark.parametrize("interior", [True, False])
@pytest.mark.parametrize(
    "fields", [{}, {"start": None, "closed": True, "fastest": 0.0}, {"turning_radius": 0.0}]
)
def test_a_run_without_time_to_compile_returns_the_nearest_tour(monkeypatch, fields, interior):
    def out_of_time(*arguments):
        raise jit.OutOfTime

    monkeypatch.setattr(search, "anneal", out_of_time)
    model = drawn(15, 4, **fields)
    solution = ct.solve(model, "tour-search", time_limit=60, backend_options={"interior": interior})
    assert solution.termination == "feasible" and solution.plan is not None
