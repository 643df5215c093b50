"""The paper's algorithms: worked steps computed by hand, and feasible tours on extreme cases."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.instances.messenger import generate
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.interception import intercept
from crosstrack.solvers import Limit, Termination
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.messenger.decoding import KAPPA, assess, bisect, follow, violation
from crosstrack.solvers.messenger.heuristics import exchange, move, next_vehicle
from crosstrack.solvers.messenger.memetic import (
    Rules,
    cross,
    descend,
    evolve,
    mutate,
    resample,
    settle,
    transform,
)
from crosstrack.solvers.messenger.rivals import Flight

MEMETIC = ("memetic", "memetic-untransformed", "memetic-relaxed")
RANDOM = (*MEMETIC, "variable-neighbourhood")
RIVALS = (*RANDOM, "greedy-boundary", "greedy-centre", "direct-sampling")
#: Options that make a run short.
SHORT: dict[str, dict[str, Any]] = {
    **{name: {"generations": 4, "population": 4} for name in MEMETIC},
    "variable-neighbourhood": {"iterations": 4},
    "greedy-boundary": {"samples": 24},
    "direct-sampling": {"samples": 6},
}


def wild(seed: int, most: int = 8) -> MessengerTour:
    """Return a tour with extreme sizes, ratios, ties and speeds."""
    rng = np.random.default_rng([seed, 11])
    n = int(rng.integers(1, most + 1))
    size = 10.0 ** rng.choice([-3, 0, 2, 4, 7])
    places = rng.uniform(-1, 1, (n, 2)) * rng.choice([0.0, 1.0, 1.0, 1.0], 2)
    if rng.random() < 0.3:
        places[n // 2 :] = places[0]
    headings = rng.uniform(0, 2 * math.pi, n)
    if rng.random() < 0.3:  # away from the start, or towards it
        headings = np.arctan2(places[:, 1], places[:, 0]) + math.pi * rng.integers(0, 2)
    speed = size * 10.0 ** rng.uniform(-2, 1)
    fast = speed * rng.choice([0.0, 0.35, 0.9, 0.999]) * rng.choice([1.0, rng.random()])
    radius = size * 10.0 ** rng.choice([-6, -2, -1, 0, 1], n)
    radius *= rng.choice([0.0, 1.0, 1.0], n)
    return MessengerTour(
        places * size,
        fast * np.stack([np.cos(headings), np.sin(headings)], axis=1),
        radius if rng.random() < 0.7 else float(radius[0]),
        speed,
        size * rng.choice([0.0, 1e-6, 1e-2, 0.1, 1.0, 100.0]),
        (*rng.uniform(-1, 1, 2) * size * rng.choice([0, 1]), rng.uniform(-9, 9)),
    )


def solved(model: MessengerTour, name: str, **more: Any) -> Any:
    """Return the solution of a short run."""
    options = {**SHORT.get(name, {}), **more.pop("options", {})}
    if name not in RANDOM:
        more.pop("seed", None)
    return ct.solve(model, name, backend_options=options, **more)


def ahead(*vehicles: tuple[float, float, float], **changes: Any) -> Flight:
    """Return a flight from the origin along x at 10 m/s, with vehicles given by x, y and vx."""
    rows = np.array(vehicles)
    model = MessengerTour(
        rows[:, :2], np.column_stack([rows[:, 2], np.zeros(len(rows))]), 5.0, start=(0, 0, 0),
        **changes,
    )  # fmt: skip
    return Flight(model, Request(seed=0))


def genes(*rows: tuple[float, float]) -> Any:
    """Return the genes θ and Δt of vehicles."""
    return np.array(rows, float)


def rules(timed: bool, transformed: bool) -> Rules:
    """Return the parameters of the paper's Table II."""
    return Rules(timed, transformed, mutation=0.1, period=2, step=0.01, samples=20)


# -- worked steps of the paper ---------------------------------------------------------------------


def test_algorithm_1_meets_a_vehicle_ahead_after_the_distance_by_the_closing_speed() -> None:
    for pace, by_hand in ((0.0, 6.0), (2.0, 60 / 8), (-2.0, 60 / 12)):
        assert bisect(0, 0, 0, 0, 60, 0, pace, 0, 10, 5) == pytest.approx(by_hand, rel=1e-8)
    # To the left: a quarter of the circle of radius 5, then 40 m north to (5, 45).
    found = bisect(0, 0, 0, 3, 5, 45, 0, 0, 10, 5)
    assert found == pytest.approx((2.5 * math.pi + 40) / 10, rel=1e-8)


def test_algorithm_1_ends_where_the_shortest_path_jumps() -> None:
    """The vehicle leaves the turning circle after 1.2 s: the sign of δ changes there without a root."""
    model = ct.load("messenger/gap")
    (px, py), (vx, vy) = model.positions[0], model.velocities[0]
    start = (*model.start, 0.0, px, py, vx, vy, 10.0, 5.0)
    assert bisect(*start) == pytest.approx(intercept(*start), rel=1e-9)


def test_equation_7_is_the_missing_length_and_covers_the_gap() -> None:
    assert violation(0, 0, 0, 30, 0, 5, 20, 0.0) == (10.0, 0.0)
    assert violation(0, 0, 0, 30, 0, 5, 29.995, 0.01) == (0.0, 0.0)
    assert violation(0, 0, 0, 30, 0, 5, 70, 0.0)[0] == 0.0
    # At the pose itself, no path has a length between 0 and the circle of 10 π = 31.4 m.
    assert violation(0, 0, 0, 0, 0, 5, 10, 0.0)[0] == -10.0
    assert violation(0, 0, 0, 0, 0, 5, 32, 0.0)[0] == 0.0


def test_equations_5_to_8_evaluate_an_individual() -> None:
    """Access points (45, 0) and (95, 0): the first leg lacks 5 m, the second has 10 m of slack."""
    one = ahead((50, 0, 0), (100, 0, 0))
    own = genes((math.pi, 4.0), (math.pi, 6.0))
    end, off = assess(np.array([0, 1]), own, one.task, False)
    assert (end, off) == (10.0, pytest.approx(5.0))
    assert one.task.poses[1:, :2] == pytest.approx(np.array([[45, 0], [95, 0]]), abs=1e-6)
    value = settle(np.array([0, 1]), own.copy(), one.task, rules(True, False))
    assert value == pytest.approx(105.0, abs=0.01)  # repaired: 4.5 s and 6 s
    assert KAPPA > 1e6 * 100


def test_equations_9_and_10_repair_an_interval_in_one_step_where_the_violation_is_linear() -> None:
    """c(4) = 50 + 8 - 5 - 40 = 13, slope 2 - 10 = -8: Δt = 4 + 13 / 8."""
    one = ahead((50, 0, 2), (100, 0, 0))
    own = genes((math.pi, 4.0), (math.pi, 9.0))
    _, off = assess(np.array([0, 1]), own, one.task, True)
    assert off == 0.0
    assert own[0, 1] == pytest.approx(5.625, abs=1e-5)
    assert own[1, 1] == 9.0


def test_the_crossover_gives_the_child_that_the_paper_prints() -> None:
    one, two = np.array([1, 3, 2, 4]) - 1, np.array([4, 2, 3, 1]) - 1
    first, second = genes(*[(k, k) for k in range(4)]), genes(*[(10 + k, 10 + k) for k in range(4)])
    child, own = np.zeros(4, np.int64), np.zeros((4, 2))
    cross(np.array([1, 2, 2, 1]), one, first, two, second, child, own)
    assert (child + 1).tolist() == [1, 4, 2, 3]
    assert own[:, 0].tolist() == [0, 11, 2, 13]  # vehicles 1 and 3 from the first parent


def test_the_three_mutations() -> None:
    one = ahead((50, 0, 2), (100, 0, 0), (150, 0, 0))
    start, most = genes((math.pi, 9.0), (math.pi, 9.0), (math.pi, 9.0)), 0.0
    for _ in range(300):
        order, own = np.arange(3), start.copy()
        mutate(1, order, own, one.task, one.rng)
        assert (order != np.arange(3)).sum() == 2
        assert (own == start).all()
        order = np.arange(3)
        mutate(2, order, own, one.task, one.rng)
        assert (own[:, 1] == 9.0).all()
        assert 0 < own[:, 0].min() <= own[:, 0].max() <= 2 * math.pi
        own = start.copy()
        mutate(3, order, own, one.task, one.rng)
        assert (own[:, 0] == math.pi).all()
        if own[0, 1] != 9.0:  # at most t_max of Lemma 1: 45 / (10 - 2)
            most = max(most, own[0, 1])
    assert 5.0 < most <= 45 / 8


@pytest.mark.parametrize(("pace", "interval"), [(2.0, 4.5), (0.0, 4.5), (-2.0, 6.0)])
def test_algorithm_4_shortens_the_way_to_a_vehicle_whose_successor_is_caught_up_with(
    pace: float, interval: float
) -> None:
    """45 m in 4.5 s instead of 6 s, unless the next vehicle approaches the UAV."""
    one = ahead((50, 0, 0), (100, 0, pace))
    order, own = np.array([0, 1]), genes((math.pi, 6.0), (math.pi, 9.0))
    assess(order, own, one.task, False)
    transform(order, own, one.task)
    assert own[0] == pytest.approx([math.pi, interval], rel=1e-8)
    assert own[1].tolist() == [math.pi, 9.0]
    assert order.tolist() == [0, 1]


def test_equations_11_and_12_descend_by_the_printed_step() -> None:
    """One vehicle at rest 50 m ahead: the access point at θ is (50 + 5 cos θ, 5 sin θ).

    The path is a left turn and a line. The derivative of its length is the motion of the access
    point along the final heading.
    """

    def flown(theta: float) -> tuple[float, float]:
        x, y = 50 + 5 * math.cos(theta), 5 * math.sin(theta) - 5  # from the centre of the circle
        line = math.sqrt(x * x + y * y - 25)
        heading = math.atan2(y, x) + math.asin(5 / math.hypot(x, y))
        slope = 5 * (math.cos(heading) * -math.sin(theta) + math.sin(heading) * math.cos(theta))
        return 5 * heading + line, slope

    by_hand, steps = 0.5 * math.pi, 0
    assert flown(by_hand)[1] == pytest.approx(-5 * math.sqrt(1 - 0.01), rel=1e-12)
    while steps < 628:
        after = by_hand - 0.01 * flown(by_hand)[1]
        if not flown(after)[0] < flown(by_hand)[0]:
            break
        by_hand, steps = after, steps + 1
    one, order = ahead((50, 0, 0)), np.array([0])
    own = genes((0.5 * math.pi, 0.0))
    cost = settle(order, own, one.task, rules(False, False))
    assert cost == pytest.approx(flown(0.5 * math.pi)[0], rel=1e-6)
    cost = descend(0, order, own, cost, one.task, rules(False, False))
    assert steps > 50
    assert own[0, 0] == pytest.approx(by_hand, abs=2e-2)
    assert cost == pytest.approx(flown(by_hand)[0], abs=1e-3)


def test_equation_13_keeps_the_best_of_the_sampled_angles() -> None:
    """Samples at 0, 90, 180 and 270 degrees of a disc 50 m ahead: its near side is 45 m away."""
    one, order = ahead((50, 0, 0)), np.array([0])
    own = genes((0.0, 7.0))
    cost = resample(0, order, own, 70.0, one.task, rules(True, True)._replace(samples=4))
    assert own[0] == pytest.approx([math.pi, 4.5], abs=1e-6)
    assert cost == pytest.approx(45.0, abs=1e-5)


def test_algorithm_3_replaces_an_individual_only_by_a_better_one() -> None:
    one = Flight(generate(6, 6.0, 1), Request(seed=0))
    task = one.task._replace(margin=0.01)
    orders, own = np.zeros((24, 6), np.int64), np.zeros((24, 6, 2))
    costs = np.empty(24)
    for number in range(5):
        before = costs.copy()
        best = evolve(number, orders, own, costs, task, rules(True, True), one.rng)
        assert costs[best] == costs.min()
        assert number == 0 or (costs <= before).all()
        for p in range(24):  # an evaluation is that of its individual
            end, off = assess(orders[p], own[p], task, False)
            assert 10 * end + KAPPA * off == pytest.approx(costs[p], rel=1e-9)
            assert sorted(orders[p]) == list(range(6))
    assert costs.max() < KAPPA * 0.01  # the repair has made all of them feasible


def test_the_heuristics_fly_to_centres_and_to_the_nearest_samples() -> None:
    line = MessengerTour([[0, 100], [0, 50]], radius=5.0)
    assert solved(line, "greedy-centre").plan.order == (1, 0)
    assert solved(line, "greedy-centre").primal_bound == pytest.approx(100.0)
    boundary = solved(line, "greedy-boundary", options={"samples": 100})
    assert boundary.primal_bound == pytest.approx(95.0)


def test_the_receding_horizon_looks_ahead() -> None:
    """From 0: A at -10, B at 11, C at 30. With a horizon of two, A then B is 31, B then C is 30."""
    fleet = np.array([[-10.0, 0, 0, 0, 1], [11.0, 0, 0, 0, 1], [30.0, 0, 0, 0, 1]])
    assert next_vehicle(np.arange(3), 0, 0.0, 0.0, fleet, 1) == 0
    assert next_vehicle(np.arange(3), 0, 0.0, 0.0, fleet, 2) == 1


def test_double_sampling_takes_the_first_sampled_time_that_can_be_flown() -> None:
    """The near side is 45 m away, so 4.5 s; sampled times are multiples of 0.2 s."""
    one = MessengerTour([[0, 50]], radius=5.0)
    options = {"samples": 4, "step": 0.2}
    assert solved(one, "direct-sampling", options=options).primal_bound == pytest.approx(46.0)
    options["step"] = 0.3
    assert solved(one, "direct-sampling", options=options).primal_bound == pytest.approx(45.0)


def test_double_sampling_is_the_best_of_all_combinations() -> None:
    model = replace(generate(2, 2.0, 5), name="")
    one, step, samples = Flight(model, Request()), 1.0, 5
    least = math.inf
    for order in itertools.permutations(range(2)):
        for first, second in itertools.product(range(samples), repeat=2):
            for ticks in itertools.product(range(1, 14), repeat=2):
                own = np.zeros((2, 2))
                for i, angle, tick in zip(order, (first, second), ticks, strict=True):
                    own[i] = 2 * math.pi * angle / samples, tick * step
                end, off = assess(np.array(order), own, one.task, False)
                least = end if off == 0 and end < least else least
    found = solved(model, "direct-sampling", options={"samples": samples, "step": step})
    assert found.primal_bound == pytest.approx(10 * least)


def test_the_variable_neighbourhood_search_starts_from_the_greedy_tour() -> None:
    model = generate(8, 6.0, 2)
    greedy = solved(model, "greedy-boundary", options={"samples": 100}).primal_bound
    found = solved(model, "variable-neighbourhood", seed=1)
    assert found.incumbents[0].objective == pytest.approx(greedy)
    assert found.primal_bound < greedy


def test_the_shortest_encounters_have_no_earlier_ones() -> None:
    one = Flight(generate(6, 6.0, 3), Request())
    own, order = np.zeros((6, 2)), np.arange(6)
    end = follow(order, own, one.task, 0, math.inf)
    assert assess(order, own, one.task, False) == (end, 0.0)
    own[:, 1] *= 0.999
    assert assess(order, own, one.task, False)[1] > 0.0


# -- honest results --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RIVALS)
def test_wild_cases_have_valid_plans_or_none(name: str) -> None:
    plans = 0
    for seed in range(20):
        model = wild(seed, 2 if name == "direct-sampling" else 8)
        if model.turning_radius == 0:
            continue
        options = {}
        if name in MEMETIC[:2]:
            options["margin"] = 1e-3 * model.turning_radius
        if name == "direct-sampling":
            options["step"] = max((model.extent + model.turning_radius) / model.speed / 10, 1e-6)
        found = solved(model, name, seed=seed, options=options, time_limit=0.2)
        if found.termination == Termination.REJECTED:
            assert "not decidable in double precision" in str(found.verification), seed
            continue
        if found.plan is None:
            # Algorithms with shortest encounters always return a plan.
            assert name in (*MEMETIC[:2], "direct-sampling"), seed
            assert found.termination == Termination.NO_SOLUTION, found.message
            continue
        plans += 1
        assert found.verification.ok, (seed, found.summary())
        lengths = [one.objective for one in found.incumbents]
        assert lengths == sorted(lengths, reverse=True), seed
        assert lengths[-1] == pytest.approx(found.primal_bound, rel=1e-12), seed
    assert plans >= 10


def test_a_best_individual_that_violates_its_constraints_is_no_plan() -> None:
    found = solved(generate(9, 6.0, 1), "memetic", options={"generations": 0}, seed=1)
    assert found.termination == Termination.NO_SOLUTION
    assert "cannot be flown" in found.message


def test_a_hundred_vehicles_within_a_time_limit() -> None:
    model = generate(100, 6.0, 1)
    for name in ("memetic-relaxed", "variable-neighbourhood"):
        found = ct.solve(model, name, time_limit=0.3)
        assert found.verification is not None
        assert found.verification.ok, name
        assert found.seconds["solve"] < 2.0, name
        assert found.limit == Limit.TIME, name


@pytest.mark.parametrize("name", RANDOM)
def test_a_seed_gives_one_plan_and_runs_differ(name: str) -> None:
    model = generate(7, 6.0, 3)
    one, two = (solved(model, name, seed=5, options={"runs": 3}) for _ in range(2))
    assert one.plan.to_data() == two.plan.to_data()
    lengths = list(map(float, one.statistics["lengths"].split()))
    assert len(set(lengths)) == 3
    assert min(lengths) == pytest.approx(one.primal_bound, rel=1e-12)


@pytest.mark.parametrize("name", RIVALS[3:6])
def test_answers_scale(name: str) -> None:
    """A power of two scales every number exactly, so all decisions are identical."""
    model, by = generate(6, 6.0, 4), 2.0**20
    larger = MessengerTour(
        model.positions * by, model.velocities * by, model.radius * by, model.speed * by,
        model.turning_radius * by,
    )  # fmt: skip
    one, two = solved(model, name, seed=1), solved(larger, name, seed=1)
    assert two.plan.order == one.plan.order
    assert two.primal_bound == pytest.approx(by * one.primal_bound, rel=1e-12)


def test_rejects_models_outside_the_paper() -> None:
    closed = MessengerTour([[30, 0], [0, 30]], closed=True)
    anywhere = MessengerTour([[30, 0], [0, 30]], start=(0, 0))
    for name in RIVALS:
        with pytest.raises(UnsupportedFormulation, match="closed"):
            ct.solve(closed, name)
        with pytest.raises(UnsupportedFormulation, match="heading"):
            ct.solve(anywhere, name)
        with pytest.raises(UnsupportedFormulation, match="Dubins vehicle"):
            ct.solve(replace(anywhere, turning_radius=0.0), name)
    with pytest.raises(UnsupportedFormulation, match="more than 3 vehicles, got 4"):
        ct.solve(generate(4, 6.0, 1), "direct-sampling")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("memetic", {"generations": -1}),
        ("memetic", {"mutation": 1.5}),
        ("memetic-relaxed", {"samples": 20}),
        ("memetic", {"margin": float("nan")}),
        ("greedy-centre", {"horizon": 3}),
        ("greedy-boundary", {"samples": 0}),
        ("variable-neighbourhood", {"iterations": 1.5}),
        ("direct-sampling", {"step": 0}),
    ],
)
def test_bad_options_are_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(UnsupportedOption, match=next(iter(options))):
        ct.solve(generate(2, 6.0, 1), name, backend_options=options)


def test_moves_and_exchanges_of_stretches() -> None:
    for begin, count, place in itertools.product(range(6), range(1, 7), range(6)):
        if begin + count <= 6 and place + count <= 6:
            order = np.arange(6)
            move(order, begin, count, place)
            rest = [k for k in range(6) if not begin <= k < begin + count]
            rest[place:place] = range(begin, begin + count)
            assert order.tolist() == rest
    for a, b, c, d in itertools.combinations_with_replacement(range(7), 4):
        order = np.arange(6)
        exchange(order, a, b, c, d)
        every = list(range(6))
        wanted = every[:a] + every[c:d] + every[b:c] + every[a:b] + every[d:]
        assert order.tolist() == wanted


def test_the_transformation_pays() -> None:
    lengths = {
        name: np.array(
            [ct.solve(generate(10, 6.0, k), name, seed=k).primal_bound for k in range(3)]
        )
        for name in MEMETIC[:2]
    }
    assert lengths["memetic"].sum() < 0.9 * lengths["memetic-untransformed"].sum()
