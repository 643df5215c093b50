"""Equations of the artificial fish and iterations of the swarms, with numbers computed by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from crosstrack.models.black_box.model import BlackBoxMinimisation
from crosstrack.solvers.black_box.fish import converged
from crosstrack.solvers.black_box.fish_swarms import (
    AdaptiveSwarm,
    ImprovedSwarm,
    Swarm,
    attenuation,
    gaussian,
    inertia,
    leaders,
    segment,
    towards,
)
from crosstrack.solvers.black_box.native import Ended, Objective
from crosstrack.solvers.contract.backend import Control, Request

Floats = NDArray[np.float64]


class Fixed:
    """A generator that draws 0.5 in [0, 1], and `rand` in [-1, 1]."""

    def __init__(self, rand: float) -> None:
        self.rand = rand

    def random(self, shape: Any) -> Floats:
        return np.full(shape, 0.5)

    def uniform(self, low: float, high: float, shape: Any) -> Floats:
        assert (low, high) == (-1.0, 1.0)
        return np.full(shape, self.rand)


class Pool:
    """A swarm on the unit cube that records the points that it evaluates."""

    def __init__(
        self,
        kind: type[Swarm],
        function: Callable[[Floats], Floats],
        place: Any,
        budget: int = 1000,
        rand: float | None = None,
        **options: Any,
    ) -> None:
        place = np.array(place, float)
        self.asked: list[Floats] = []

        def oracle(points: Floats) -> Floats:
            self.asked.append(points.copy())
            return function(points)[:, None]

        model = BlackBoxMinimisation(lambda x: 0.0, [[0, 1]] * place.shape[1], budget=budget)
        objective = Objective(model, Request(control=Control(oracle=oracle)))
        objective._several = 1000  # each batch is one question
        chosen = {
            "fish": len(place), "crowd": 1.0, "visual": 0.3, "step": 0.1, "tries": 3, "finest": 1e-6,
            "power": 3, "sigma": 0.4, "least": 0.001, "iterations": 0, **options,
        }  # fmt: skip
        generator: Any = np.random.default_rng(5) if rand is None else Fixed(rand)
        self.swarm = kind(objective, generator, chosen)
        self.swarm.place, self.swarm.value = place, function(place)
        self.swarm.bulletin = [float(self.swarm.value.min())]


def flat(points: Floats) -> Floats:
    return np.zeros(len(points))


def slope(points: Floats) -> Floats:
    return points[:, 0].copy()


def total(points: Floats) -> Floats:
    return points.sum(axis=1)


# Equations


@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 5))
@settings(max_examples=40)
def test_leaders_are_those_of_a_plain_loop(seed: int, n: int, d: int) -> None:
    draw = np.random.default_rng(seed)
    place = draw.random((n, d)).round(1)  # with duplicates
    value = draw.integers(0, 4, n).astype(float)
    value[draw.random(n) < 0.2] = np.inf
    lead = leaders(place, value, 0.35)
    for i in range(n):
        seen = [j for j in range(n) if j == i or sum((place[i] - place[j]) ** 2) ** 0.5 < 0.35]
        assert value[lead[i]] == value[seen].min()
        assert lead[i] in seen or np.isinf(value[seen]).all()


def test_a_move_has_the_euclidean_length_and_the_direction_of_its_target() -> None:
    place = np.array([[0.0, 0.0], [0.5, 0.5], [0.2, 0.2]])
    target = np.array([[0.3, 0.4], [0.5, 0.1], [0.2, 0.2]])
    move = towards(place, target, np.array([0.1, 0.8, 0.1]))
    assert move == pytest.approx(np.array([[0.06, 0.08], [0.0, -0.8], [0.0, 0.0]]))


def test_factors_over_a_run() -> None:
    # exp(-25 / 8), 1 / (0.4 sqrt(2 pi)) and its product with exp(-25 / 32); 0.2 + 0.7 t / T.
    assert [attenuation(t, 3) for t in (0.0, 0.5)] == pytest.approx([1.0, 0.0439369336])
    assert [gaussian(t, 0.4) for t in (0.0, 0.5)] == pytest.approx([0.9973557010, 0.4566227135])
    assert [inertia(t) for t in (0.0, 0.5, 1.0)] == pytest.approx([0.2, 0.55, 0.9])
    parts = [segment(share, 1e-4) for share in (0.0, 0.25, 0.375, 0.5, 0.75, 1.0)]
    assert parts == pytest.approx([1.0, 1.0, 0.1, 0.01, 1e-4, 1e-4])


def test_convergence_is_the_first_iteration_with_99_percent_of_the_decrease() -> None:
    assert converged([100.0, 50.0, 1.1, 0.9, 0.0, 0.0]) == 3
    assert converged([2.0, 2.0]) == 0


# AFSA, section 2


def test_afsa_swarms_and_preys_as_computed_by_hand() -> None:
    """Move half a step of 0.1; the centre of (0.6, 0.6) and (0.3, 0.2) is (0.45, 0.4)."""
    pool = Pool(Swarm, total, [[0.6, 0.6], [0.3, 0.2]], rand=-0.5, visual=0.2)
    pool.swarm.cycle()
    # First fish: centre 0.85 < 1.2, direction (-0.15, -0.2) / 0.25, eq. 5.
    # Second fish: centre is worse, sees (0.2, 0.1) (eq. 2), moves 0.05 along (-1, -1) / sqrt 2 (eq. 3).
    assert pool.swarm.place == pytest.approx(np.array([[0.57, 0.56], [0.2646446609, 0.1646446609]]))
    assert pool.swarm.value == pytest.approx(pool.swarm.place.sum(axis=1))


def test_afsa_follows_if_that_leads_to_a_better_point_than_swarming() -> None:
    """The first fish sees the second at distance 0.2; the centre is (0.36, 0.6733), at distance 0.251."""
    pool = Pool(Swarm, total, [[0.6, 0.6], [0.48, 0.44], [0.0, 0.98]], rand=-0.5, visual=0.25)
    pool.swarm.cycle()
    # Direction (-0.12, -0.16) / 0.2: 1.13, better than 1.167 after a move towards the centre.
    assert pool.swarm.place[0] == pytest.approx([0.57, 0.56])


def test_afsa_does_not_swarm_or_follow_if_the_centre_is_crowded() -> None:
    place = [[0.5, 0.5], [0.45, 0.5], [0.44, 0.5], [0.9, 0.9], [0.1, 0.1]]
    for crowd, free in ((0.61, True), (0.6, False)):  # the centre sees three of five
        pool = Pool(Swarm, slope, place, crowd=crowd, visual=0.2, tries=1)
        assert bool(pool.swarm.targets(0.2)) is free


def test_afsa_leaps_within_its_visual_if_all_tries_fail() -> None:
    pool = Pool(Swarm, flat, [[0.5, 0.5]], rand=0.5, tries=2)
    pool.swarm.cycle()
    assert [len(points) for points in pool.asked if len(points)] == [1, 1, 1]  # tries and leap
    assert pool.swarm.place == pytest.approx(0.65)


def test_afsa_may_get_worse_and_its_bulletin_does_not() -> None:
    pool = Pool(Swarm, slope, [[0.5, 0.5]], rand=0.5)
    for _ in range(2):
        pool.swarm.cycle()
    assert pool.swarm.value[0] > 0.5
    assert pool.swarm.bulletin[0] == 0.5
    assert pool.swarm.bulletin[1] == pool.swarm.bulletin[2]


# IAFSA, section 3


def test_iafsa_moves_to_the_opposite_point_if_that_is_better() -> None:
    pool = Pool(ImprovedSwarm, slope, [[0.8, 0.5]], rand=0.5, iterations=2)
    pool.swarm.cycle()
    # 1 - 0.8 is better than 0.8; then (1 - 0.55) X, as centre and best fish are the fish itself.
    assert pool.swarm.place == pytest.approx(np.array([[0.09, 0.225]]))


def test_iafsa_swarms_and_follows_as_computed_by_hand() -> None:
    """At t / T = 0.5: β = 0.55, step 0.1 · 0.45662 + 0.001, length β · step / 2 = 0.0128321."""
    pool = Pool(ImprovedSwarm, slope, [[0.2, 0.5], [0.4, 0.2]], rand=0.5, iterations=2)
    pool.swarm.cycle()
    # First fish: 0.45 X = (0.09, 0.225) when it follows itself, better than towards the centre (eq. 18).
    # Second fish: 0.45 X = (0.18, 0.09), plus 0.0128321 along (-0.2, 0.3) / 0.360555 (eq. 17).
    wanted = [[0.09, 0.225], [0.1728820, 0.1006770]]
    assert pool.swarm.place == pytest.approx(np.array(wanted), abs=1e-6)


def test_iafsa_preys_around_the_shrunk_position_and_leaps_if_that_fails() -> None:
    def bowl(middle: float) -> Callable[[Floats], Floats]:
        return lambda points: ((points - middle) ** 2).sum(axis=1)

    who = np.array([0])
    pool = Pool(ImprovedSwarm, bowl(0.2), [[0.4]], rand=0.5, iterations=2)
    visual, step = pool.swarm.ranges()
    assert (visual, step) == pytest.approx((0.0141810801, 0.0466622714))
    # 0.45 · 0.4 + 0.5 · 0.55 · step (eq. 15); kept as it is better (eq. 16).
    assert pool.swarm.prey(who, visual, step)[0] == pytest.approx(0.1928321246)
    # Around 0.36 everything is worse than at the minimum 0.8: leap to 0.8 + 0.5 · visual (eq. 7).
    lost = Pool(ImprovedSwarm, bowl(0.8), [[0.8]], rand=0.5, iterations=2)
    lost.swarm.cycle()
    assert lost.swarm.place == pytest.approx(0.8070905400)


# HAAFSA, and all swarms


def test_haafsa_sees_half_as_far_with_each_try_and_stays_if_it_sees_nothing() -> None:
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
    assert 0.2 <= better.swarm.value[0] < 0.5
    assert any((better.swarm.place[0] == points).all(axis=1).any() for points in better.asked)


def test_time_is_the_share_of_iterations_or_of_evaluations() -> None:
    pool = Pool(AdaptiveSwarm, flat, [[0.5]], finest=1e-4)
    assert pool.swarm.ranges() == (0.3, 0.1)
    pool.swarm.objective.left = 500  # of 1000
    assert pool.swarm.ranges() == pytest.approx((0.003, 0.001))
    assert Pool(Swarm, flat, [[0.5]], iterations=4).swarm.progress == 0.25


def test_a_warm_start_is_the_first_fish_and_is_not_evaluated_again() -> None:
    pool = Pool(Swarm, slope, [[0.5, 0.5]] * 4)
    pool.swarm.objective(np.array([[0.25, 0.75]]))
    pool.swarm.begin(np.array([0.25, 0.75]))
    assert pool.swarm.place[0].tolist() == [0.25, 0.75]
    assert pool.swarm.value.tolist() == [0.25, *pool.asked[1][:, 0]]
    assert len(pool.asked[1]) == 3


def test_the_swarm_ends_when_the_evaluations_are_used_up() -> None:
    pool = Pool(Swarm, flat, [[0.5]], budget=5)
    pool.swarm.cycle()  # three tries and a leap
    with pytest.raises(Ended):
        pool.swarm.cycle()
    assert sum(map(len, pool.asked)) == 5
