"""What artificial fish see and do, one behaviour at a time and by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from crosstrack.models.black_box.model import BlackBoxMinimisation
from crosstrack.solvers.backend import Control, Request
from crosstrack.solvers.black_box.fish_moves import (
    attenuation,
    centres,
    leaders,
    neighbours,
    segment,
    towards,
)
from crosstrack.solvers.black_box.fish_swarms import AdaptiveSwarm, ImprovedSwarm, Swarm
from crosstrack.solvers.black_box.native import Ended, Objective

Floats = NDArray[np.float64]


class Pool:
    """A swarm on the unit cube whose questions are kept."""

    def __init__(
        self,
        kind: type[Swarm],
        function: Callable[[Floats], Floats],
        place: Any,
        budget: int = 1000,
        bounds: tuple[float, float] = (0.0, 1.0),
        **options: Any,
    ) -> None:
        place = np.array(place, float)
        self.asked: list[Floats] = []

        def oracle(points: Floats) -> Floats:
            self.asked.append(points.copy())
            return function(points)[:, None]

        model = BlackBoxMinimisation(
            lambda x: 0.0, np.tile(bounds, (place.shape[1], 1)), budget=budget
        )
        objective = Objective(model, Request(control=Control(oracle=oracle)))
        objective._several = 1000  # each batch is one question
        chosen = {
            "fish": len(place), "crowd": 1.0, "visual": 0.3, "step": 0.1, "tries": 3, "finest": 1e-6,
            "power": 3, "shrink": False, **options,
        }  # fmt: skip
        self.swarm = kind(objective, np.random.default_rng(5), chosen)
        self.swarm.place, self.swarm.motion = place, np.zeros_like(place)
        self.swarm.value = function(place)


def flat(points: Floats) -> Floats:
    return np.zeros(len(points))


def slope(points: Floats) -> Floats:
    return points[:, 0].copy()


# What fish see


@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 5))
@settings(max_examples=40)
def test_neighbours_leaders_and_centres_are_those_of_plain_loops(seed: int, n: int, d: int) -> None:
    draw = np.random.default_rng(seed)
    place = draw.random((n, d)).round(1)  # with duplicates
    value = draw.integers(0, 4, n).astype(float)
    value[draw.random(n) < 0.2] = math.inf
    near = neighbours(place, 0.35)
    middle, lead = centres(place, near), leaders(value, near)
    for i in range(n):
        seen = [
            j
            for j in range(n)
            if j != i and max(abs(place[i, k] - place[j, k]) for k in range(d)) < 0.35
        ]
        assert np.flatnonzero(near[i]).tolist() == seen
        best = value[seen].min(initial=math.inf)
        if np.isfinite(best):
            assert lead[i] in seen
            assert value[lead[i]] == best
        else:
            assert lead[i] in (i, *seen)
        mean = place[seen].mean(axis=0) if seen else place[i]
        assert middle[i] == pytest.approx(mean)


def test_a_move_has_the_length_asked_and_the_direction_of_its_target() -> None:
    place = np.array([[0.0, 0.0], [0.5, 0.5], [0.2, 0.2]])
    target = np.array([[0.3, 0.4], [0.5, 0.1], [0.2, 0.2]])
    move = towards(place, target, np.array([0.1, 0.8, 0.1]))
    assert move == pytest.approx(np.array([[0.075, 0.1], [0.0, -0.8], [0.0, 0.0]]))


def test_vision_falls_as_its_formulas_say() -> None:
    assert [attenuation(0.0, 3), attenuation(1.0, 3)] == [1.0, pytest.approx(9.357623e-14)]
    assert attenuation(0.5, 3) == pytest.approx(math.exp(-3.75))
    got = [segment(share, 1e-4) for share in (0.0, 0.25, 0.375, 0.5, 0.75, 1.0)]
    assert got == pytest.approx([1.0, 1.0, 0.1, 0.01, 1e-4, 1e-4])


# What fish do, by hand


def test_a_fish_follows_the_best_one_that_it_sees() -> None:
    pool = Pool(Swarm, slope, [[0.5, 0.5], [0.4, 0.6], [0.31, 0.5], [0.1, 0.5]])
    pool.swarm.cycle()
    # The first one's leader is the third; the fourth is better and out of sight of the first.
    ahead = pool.asked[0][0] - [0.5, 0.5]
    assert ahead[1] == 0.0
    assert -0.1 <= ahead[0] < 0.0
    # The third one's leader is the fourth, and so is it of nobody else's.
    assert pool.asked[0][2][0] < 0.31
    assert (pool.swarm.value < [0.5, 0.4, 0.31, 1.0]).all()


def test_fish_do_not_follow_into_a_crowd() -> None:
    place = [[0.5, 0.5], [0.45, 0.5], [0.44, 0.5], [0.43, 0.5], [0.9, 0.9]]
    pool = Pool(Swarm, slope, place, crowd=0.6, tries=2)
    pool.swarm.cycle()
    # All four see three of five, 0.6 of the swarm: neither followers nor centres, only prey.
    assert len(pool.asked[0]) == 0 or len(pool.asked[0]) == 5
    loose = Pool(Swarm, slope, place, crowd=0.61, tries=2)
    loose.swarm.cycle()
    assert len(loose.asked[0]) == 3 + 4  # three followers, four centres


def test_the_crowd_that_counts_is_the_leaders() -> None:
    place = [[0.55, 0.5], [0.3, 0.5], [0.2, 0.5], [0.1, 0.5], [0.05, 0.5]]
    pool = Pool(Swarm, slope, place, crowd=0.5)
    pool.swarm.cycle()
    # The first one sees one fish, which sees four of five: no follower, and one centre.
    assert pool.asked[0].tolist() == [[0.3, 0.5]]


def test_fish_swarm_to_a_centre_that_is_better() -> None:
    def bowl(points: Floats) -> Floats:
        return ((points - 0.5) ** 2).sum(axis=1)

    place = np.array([[0.4, 0.4], [0.6, 0.4], [0.4, 0.6], [0.6, 0.6]])
    pool = Pool(Swarm, bowl, place, step=0.02)  # all alike: nobody leads
    pool.swarm.value[:] = bowl(place)[0]
    pool.swarm.cycle()
    others = (place.sum(axis=0) - place) / 3
    assert pool.asked[0] == pytest.approx(others)
    move = pool.asked[1] - place
    cross = move[:, 0] * (others - place)[:, 1] - move[:, 1] * (others - place)[:, 0]
    assert cross == pytest.approx(0.0, abs=1e-15)
    assert (np.abs(move).max(axis=1) <= 0.02).all()
    assert len(pool.asked) == 2  # nobody had to prey
    assert pool.swarm.place == pytest.approx(pool.asked[1])


def test_fish_do_not_swarm_to_a_centre_that_is_worse() -> None:
    def hill(points: Floats) -> Floats:
        return -((points - 0.5) ** 2).sum(axis=1)

    place = [[0.4, 0.4], [0.6, 0.4], [0.4, 0.6], [0.6, 0.6]]
    pool = Pool(Swarm, hill, place)
    pool.swarm.value[:] = hill(np.array(place))[0]
    pool.swarm.cycle()
    looks = pool.asked[1]  # right after the centres
    assert np.abs(looks - place).max() > 0.1


def test_a_fish_that_preys_moves_towards_the_first_better_place() -> None:
    pool = Pool(Swarm, slope, [[0.5, 0.5]], tries=50)
    pool.swarm.cycle()
    *looks, moved = [points[0] for points in pool.asked if len(points)]
    assert all(look[0] >= 0.5 for look in looks[:-1])
    seen = looks[-1]
    assert seen[0] < 0.5
    assert np.abs(np.array(looks) - 0.5).max() <= 0.3
    move = moved - 0.5
    assert 0 < np.abs(move).max() <= 0.1
    assert move / np.linalg.norm(move) == pytest.approx((seen - 0.5) / np.linalg.norm(seen - 0.5))
    assert (pool.swarm.place[0] == moved).all()


def test_a_fish_that_finds_nothing_takes_a_random_step_and_leaps_at_last() -> None:
    pool = Pool(Swarm, flat, [[0.5] * 40], tries=2)
    before = pool.swarm.place
    for _ in range(3):  # the first cycle finds the first value, after which three are calm
        pool.asked.clear()
        pool.swarm.cycle()
        assert len([points for points in pool.asked if len(points)]) == 2 + 1
        away = np.abs(pool.swarm.place - before).max()
        assert 0.08 < away <= 0.1
        before = pool.swarm.place
    pool.asked.clear()
    pool.swarm.cycle()
    step, leap = [points for points in pool.asked if len(points)][2:]
    assert 0.2 < np.abs(leap - step).max() <= 0.3
    assert (pool.swarm.place == leap).all()


def test_adaptive_prey_sees_half_as_far_with_each_try_and_stays_where_it_sees_nothing() -> None:
    pool = Pool(AdaptiveSwarm, flat, [[0.5] * 60], tries=4, budget=100)
    pool.swarm.cycle()
    looks = [points[0] for points in pool.asked if len(points)]
    reach = [np.abs(look - 0.5).max() for look in looks]
    assert len(reach) == 4
    for got, most in zip(reach, (0.3, 0.15, 0.075, 0.0375), strict=True):
        assert 0.8 * most < got <= most
    assert (pool.swarm.place == 0.5).all()
    better = Pool(AdaptiveSwarm, slope, [[0.5, 0.5]], tries=50)
    better.swarm.cycle()
    assert (better.swarm.place == better.asked[-1]).all()  # right to what it saw, asked once
    assert better.swarm.value[0] < 0.5


def test_opposition_keeps_the_better_half() -> None:
    pool = Pool(ImprovedSwarm, slope, [[0.5, 0.5]] * 6)
    pool.swarm.begin(None)
    (asked,) = pool.asked
    assert asked[:6] + asked[6:] == pytest.approx(1.0)
    assert np.sort(pool.swarm.place[:, 0]) == pytest.approx(np.sort(asked[:, 0])[:6])
    assert (pool.swarm.value == pool.swarm.place[:, 0]).all()


def test_inertia_acts_on_the_move_or_as_printed_on_the_place() -> None:
    who = np.array([0])
    moving = Pool(ImprovedSwarm, slope, [[0.5, 0.25]], bounds=(-1.0, 3.0))
    moving.swarm.motion = np.array([[0.1, -0.2]])
    assert moving.swarm.base(who) == pytest.approx(np.array([[0.52, 0.21]]))
    printed = Pool(ImprovedSwarm, slope, [[0.5, 0.25]], bounds=(-1.0, 3.0), shrink=True)
    # x = (1, 0), of which a fifth is (0.2, 0).
    assert printed.swarm.base(who) == pytest.approx(np.array([[0.3, 0.25]]))
    for pool in (moving, printed):
        pool.swarm.objective.left = 500  # of 1000: β is 0.55
    assert moving.swarm.base(who) == pytest.approx(np.array([[0.555, 0.14]]))
    assert printed.swarm.base(who) == pytest.approx(np.array([[0.3875, 0.25]]))


def test_a_cycle_notes_how_far_each_fish_moved() -> None:
    pool = Pool(ImprovedSwarm, slope, [[0.5, 0.5], [0.4, 0.45], [0.9, 0.1]])
    before = pool.swarm.place
    pool.swarm.cycle()
    assert (pool.swarm.motion == pool.swarm.place - before).all()
    assert pool.swarm.motion.any()


def test_vision_and_step_change_with_the_share_of_evaluations() -> None:
    adaptive = Pool(AdaptiveSwarm, flat, [[0.5]], finest=1e-4)
    improved = Pool(ImprovedSwarm, flat, [[0.5]], power=1)
    plain = Pool(Swarm, flat, [[0.5]])
    assert adaptive.swarm.ranges() == improved.swarm.ranges() == plain.swarm.ranges() == (0.3, 0.1)
    for pool in (adaptive, improved, plain):
        pool.swarm.objective.left = 500  # of 1000
    assert adaptive.swarm.ranges() == pytest.approx((0.003, 0.001))
    assert improved.swarm.ranges() == pytest.approx((0.3 * math.exp(-15), 0.1 * math.exp(-15)))
    assert plain.swarm.ranges() == (0.3, 0.1)


def test_a_warm_start_is_the_first_fish_and_is_not_asked_again() -> None:
    pool = Pool(Swarm, slope, [[0.5, 0.5]] * 4)
    pool.swarm.objective(np.array([[0.25, 0.75]]))
    pool.swarm.begin(np.array([0.25, 0.75]))
    assert pool.swarm.place[0].tolist() == [0.25, 0.75]
    assert pool.swarm.value.tolist() == [0.25, *pool.asked[1][:, 0]]
    assert len(pool.asked[1]) == 3


def test_steps_of_the_improved_swarm_are_gaussian() -> None:
    pool = Pool(ImprovedSwarm, slope, [[0.5, 0.5]])
    lengths = pool.swarm.lengths(20_000)
    assert (lengths >= 0).all()
    assert lengths.mean() == pytest.approx(math.sqrt(2 / math.pi), rel=0.03)
    assert (lengths > 1).mean() == pytest.approx(0.3173, abs=0.015)


def test_without_the_pull_a_fish_never_preys_for_the_worse() -> None:
    kept = Pool(ImprovedSwarm, slope, [[0.5, 0.5]], budget=10**6)
    for _ in range(50):
        before = kept.swarm.value[0]
        who = np.array([0])
        kept.swarm.place, kept.swarm.value = kept.swarm.prey(who, 0.3, 0.1)
        assert kept.swarm.value[0] <= before


def test_the_swarm_ends_by_the_objective_alone() -> None:
    pool = Pool(Swarm, flat, [[0.5]], budget=5)
    pool.swarm.cycle()  # three tries and a step
    with pytest.raises(Ended):
        pool.swarm.cycle()
    assert sum(map(len, pool.asked)) == 5
