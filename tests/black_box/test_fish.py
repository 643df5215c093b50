"""Swarms of artificial fish: any budget and function, and the pull to the origin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models.black_box.functions import Landscape, Named
from crosstrack.models.black_box.model import BlackBoxMinimisation
from crosstrack.models.black_box.plan import BlackBoxPoint
from crosstrack.solvers.black_box.fish import FishSwarm, HybridFishSwarm, ImprovedFishSwarm
from crosstrack.solvers.black_box.native import BlackBoxBackend
from crosstrack.solvers.black_box.random_search import RandomSearch
from crosstrack.solvers.contract.backend import Answer, Control, Limit, Request, Termination

Floats = NDArray[np.float64]

SWARMS: list[type[FishSwarm]] = [FishSwarm, HybridFishSwarm, ImprovedFishSwarm]
swarms = pytest.mark.parametrize("backend", SWARMS, ids=lambda one: one.name)
#: The swarms that no point attracts.
unpulled = pytest.mark.parametrize("backend", SWARMS[:2], ids=lambda one: one.name)


def answer(
    model: BlackBoxMinimisation,
    backend: type[BlackBoxBackend],
    seed: int = 0,
    warm_start: BlackBoxPoint | None = None,
    **options: Any,
) -> Answer:
    """Run in this process."""
    one = backend()
    return one.run(
        model,
        Request(
            seed=seed,
            warm_start=warm_start,
            options=one.checked_options(options),
            control=Control(oracle=model.oracle()),
        ),
    )


def value(model: BlackBoxMinimisation, backend: type[BlackBoxBackend], **options: Any) -> float:
    found = answer(model, backend, **options).primal_bound
    assert found is not None
    return found


# Whole runs


@swarms
@pytest.mark.parametrize("budget", [1, 2, 7, 99, 100, 101, 199, 200, 201, 733])
def test_any_budget_is_used_to_the_last_evaluation(backend: type[FishSwarm], budget: int) -> None:
    model = BlackBoxMinimisation("rastrigin", [[-5, 5]] * 3, budget=budget)
    found = answer(model, backend)
    assert found.statistics["evaluations"] == budget
    assert found.limit is Limit.EVALUATIONS
    assert model.verify(found.point).objective == found.primal_bound


@pytest.mark.sample(2)
@swarms
@pytest.mark.parametrize("function", ["rastrigin", "step", "constant", "sphere", "ackley"])
@pytest.mark.parametrize("dimension", [1, 100])
@pytest.mark.parametrize("stretch", [1e-9, 1e9])
def test_wild_functions_and_bounds(
    backend: type[FishSwarm], function: str, dimension: int, stretch: float
) -> None:
    named = Named(Landscape(function), stretch=stretch)
    bounds = np.tile([-4.0 * stretch, 5.0 * stretch], (dimension, 1))
    model = BlackBoxMinimisation(named, bounds, budget=1500)
    found = answer(model, backend)
    checked = model.verify(found.point)
    assert checked.ok
    assert checked.objective == found.primal_bound
    assert found.statistics["evaluations"] == 1500
    if dimension == 1:
        assert found.primal_bound is not None
        assert found.primal_bound <= 0.1


@unpulled
def test_bounds_of_all_sizes_at_once_and_fixed_variables(backend: type[FishSwarm]) -> None:
    widths = np.array([1e-9, 1e-3, 1.0, 1e3, 1e9, 0.0])
    centre = np.array([3.0, -1.0, 0.0, 1e6, -1e9, 7.0])

    def bowl(x: Floats) -> float:
        return float((((x - centre)[:5] / widths[:5]) ** 2).sum())

    bounds = np.stack([centre - 0.4 * widths, centre + 0.6 * widths], axis=1)
    found = answer(BlackBoxMinimisation(bowl, bounds, budget=3000), backend)
    assert found.point.x[5] == 7.0
    assert found.primal_bound is not None
    assert found.primal_bound < 0.02  # 0.2 on average at the start


@swarms
def test_no_value_anywhere_and_no_value_in_places(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation(lambda x: math.nan, [[0, 1]] * 2, budget=500)
    found = answer(model, backend)
    assert found.termination is Termination.NO_SOLUTION
    assert found.statistics["points without a value"] == 500

    def half(x: Floats) -> float:
        return float("nan") if x[0] > 0.3 else (math.inf if x[1] > 0.3 else float(-x.sum()))

    found = answer(BlackBoxMinimisation(half, [[0, 1]] * 2, budget=3000), backend)
    assert found.primal_bound == pytest.approx(-0.6, abs=0.03)
    assert 0 < found.statistics["points without a value"] < 3000


@swarms
def test_an_optimum_in_a_corner_is_met(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation(
        lambda x: float(x[0] - 2 * x[1] + x[2]), [[-2, 3]] * 3, budget=10_000
    )
    assert value(model, backend) == pytest.approx(-10.0, abs=1e-9)


@swarms
def test_noise_misleads_little(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation(
        Named(Landscape.SPHERE, deviation=0.05), [[-4, 5]] * 2, budget=3000
    )
    checked = model.verify(answer(model, backend).point)
    assert checked.objective is not None
    assert checked.objective < 0.3


@swarms
def test_one_fish_and_a_warm_start(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation("rosenbrock", [[-2, 2]] * 4, budget=400)
    start = BlackBoxPoint((0.9, 0.8, 0.7, 0.6))
    before = model.verify(start).objective
    assert before is not None
    for fish in (1, 2, 30):
        found = answer(model, backend, warm_start=start, fish=fish)
        assert found.statistics["evaluations"] == 400
        assert found.primal_bound is not None
        assert found.primal_bound <= before + 1e-12
    alone = answer(
        BlackBoxMinimisation("rosenbrock", [[-2, 2]] * 4, budget=1), backend, warm_start=start
    )
    assert alone.point.x == pytest.approx(start.x, rel=1e-14)


@swarms
def test_edges_of_the_options(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation("sphere", [[-1, 2]] * 2, budget=60)
    for options in (
        {"visual": 0.0}, {"step": 0.0}, {"crowd": 0.0}, {"tries": 1}, {"fish": 1, "tries": 1000},
        {"visual": 1.0, "step": 1.0, "crowd": 1.0},
    ):  # fmt: skip
        assert answer(model, backend, **options).statistics["evaluations"] == 60
    for wrong in (
        {"fish": 0},
        {"visual": 1.5},
        {"step": -0.1},
        {"crowd": 2},
        {"tries": 0},
        {"x": 1},
    ):
        with pytest.raises(UnsupportedOption):
            backend().checked_options(wrong)


@swarms
def test_the_seed_decides_the_plan(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation("ackley", [[-30, 30]] * 5, budget=1000)
    first, again, other = (answer(model, backend, seed=seed).point for seed in (3, 3, 4))
    assert first == again
    assert first != other


@swarms
def test_fish_find_more_than_chance(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation(
        Named(Landscape.SUM_SQUARES, shift=np.full(10, 2.5)), [[-10, 10]] * 10, budget=10_000
    )
    fish = [value(model, backend, seed=seed) for seed in range(3)]
    chance = [value(model, RandomSearch, seed=seed) for seed in range(3)]
    assert 2 * np.median(fish) < np.median(chance)


@pytest.mark.parametrize("backend", SWARMS[1:], ids=lambda one: one.name)
def test_fish_find_more_than_chance_in_many_dimensions(backend: type[FishSwarm]) -> None:
    model = BlackBoxMinimisation("sphere", [[-4, 5]] * 100, budget=10_000)
    assert value(model, backend) < 0.95 * value(model, RandomSearch)


# No pull to anywhere


def moved(
    function: Landscape, centre: Floats, stretch: float, budget: int = 700
) -> BlackBoxMinimisation:
    """Return the function with bounds and all multiplied, then moved, in units of the old range."""
    shift = centre * stretch
    bounds = np.stack([shift - 4.0 * stretch, shift + 6.0 * stretch], axis=1)
    return BlackBoxMinimisation(
        Named(function, shift=shift, stretch=stretch), bounds, budget=budget
    )


@unpulled
@given(
    function=st.sampled_from(
        [Landscape.RASTRIGIN, Landscape.SUM_SQUARES, Landscape.ROSENBROCK, Landscape.ACKLEY]
    ),
    centre=st.lists(st.integers(-1000, 1000), min_size=2, max_size=5),
    stretch=st.floats(1e-9, 1e9),
    seed=st.integers(0, 1000),
)
@settings(max_examples=12, deadline=None)
def test_the_answer_moves_and_grows_with_the_function(
    backend: type[FishSwarm], function: Landscape, centre: list[int], stretch: float, seed: int
) -> None:
    where = np.array(centre, float)
    plain = answer(moved(function, 0.0 * where, 1.0), backend, seed=seed, fish=30)
    there = answer(moved(function, where, stretch), backend, seed=seed, fish=30)
    back = np.array(there.point.x) / stretch - where
    assert back == pytest.approx(np.array(plain.point.x), abs=1e-4)  # in ranges of 10
    assert there.primal_bound == pytest.approx(plain.primal_bound, rel=1e-3, abs=1e-7)


def test_the_answer_moves_with_the_function_through_solve() -> None:
    where = np.array([300.0, -70.0, 5.0])
    for name in ("afsa", "haafsa"):
        plain = ct.solve(moved(Landscape.RASTRIGIN, 0 * where, 1.0), name, seed=2)
        there = ct.solve(moved(Landscape.RASTRIGIN, where, 64.0), name, seed=2)
        assert plain.plan is not None
        assert there.plan is not None
        back = np.array(there.plan.x) / 64.0 - where
        assert back == pytest.approx(np.array(plain.plan.x), abs=1e-4)


@pytest.mark.parametrize("function", [Landscape.RASTRIGIN, Landscape.SUM_SQUARES])
def test_the_printed_inertia_pulls_to_the_origin(function: Landscape) -> None:
    def run(shift: float, seed: int) -> float:
        named = Named(function, shift=np.full(10, shift))
        model = BlackBoxMinimisation(named, [[-5, 5]] * 10, budget=10_000)
        return value(model, ImprovedFishSwarm, seed=seed)

    assert max(run(0.0, seed) for seed in range(3)) < 1e-4
    assert min(run(1.25, seed) for seed in range(3)) > 10.0


def test_a_run_of_some_iterations_ends_by_itself() -> None:
    model = BlackBoxMinimisation("sphere", [[-1, 2]] * 2, budget=10**6)
    found = answer(model, ImprovedFishSwarm, iterations=7, fish=10)
    assert (found.limit, found.statistics["iterations"]) == (None, 7)
    assert 0 <= found.statistics["converged after"] <= 7


def test_a_run_that_is_stopped_keeps_its_best() -> None:
    model = BlackBoxMinimisation("sphere", [[-1, 2]] * 2, budget=10**6)
    control = Control(oracle=model.oracle())
    backend = ImprovedFishSwarm()
    plain = control.evaluated

    def evaluated(count: int = 1) -> bool:
        if control.evaluations > 500:
            control.stop(Limit.TIME)
        return plain(count)

    control.evaluated = evaluated  # type: ignore[method-assign]
    found = backend.run(model, Request(options=backend.checked_options({}), control=control))
    assert found.limit is Limit.TIME
    assert found.primal_bound is not None
