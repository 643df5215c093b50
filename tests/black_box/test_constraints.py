"""Constraints and kinds of variables in every search, against published optima and enumeration."""

import itertools
import math

import numpy as np
import pytest
from black_box.published import PUBLISHED
from black_box.searches import EVERY, allowed, box, search

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.models.black_box import BlackBoxPoint, PythonFunction
from crosstrack.solvers import Termination, find_backend
from crosstrack.solvers.black_box.constraints import Constraints


def many(function):
    """Return a function of many points."""
    return PythonFunction(function, vectorized=True)


@pytest.mark.parametrize(
    ("problem", "name", "budget"),
    [
        pytest.param("g01", "cma-es", 20_000, marks=pytest.mark.slow), pytest.param("g01", "portfolio", 20_000, marks=pytest.mark.slow), pytest.param("g01", "differential-evolution", 100_000, marks=pytest.mark.slow), pytest.param("g04", "cma-es", 6000, marks=pytest.mark.slow), pytest.param("g04", "differential-evolution", 10_000, marks=pytest.mark.slow),
        *[(problem, name, budget) for problem in ("g04", "g06", "g08") for name, budget in (("cma-es", 6000), ("differential-evolution", 10_000), ("portfolio", 1000)) if (problem, name) not in (("g04", "cma-es"), ("g04", "differential-evolution"), ("g06", "cma-es"), ("g08", "differential-evolution"))],
        pytest.param("g06", "cma-es", 6000, marks=pytest.mark.slow), pytest.param("g08", "differential-evolution", 10_000, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_published_problems_are_solved_within_one_per_cent(problem, name, budget):
    if find_backend(name).missing() or find_backend("cma-es").missing():
        pytest.skip(f"{name} needs crosstrack[blackbox]")
    function, bounds, count, optimum = PUBLISHED[problem]
    model = box(many(function), *bounds, inequalities=count, budget=budget)
    answer, _ = search(name, model, seed=2)
    assert model.verify(answer.point).ok
    assert optimum - 1e-6 * abs(optimum) <= answer.primal_bound <= optimum + 0.01 * abs(optimum)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_every_search_keeps_inequalities_of_any_scale(name, scale):
    """Minimum of the sum over a disc in a corner: all answers verify, and most are close."""

    def function(x):
        return np.column_stack([x.sum(1), scale * (((x - 0.75) ** 2).sum(1) - 0.04)])

    model = box(many(function), (0, 1), (0, 1), inequalities=1, budget=allowed(name, 50, 600))
    answer, oracle = search(name, model, seed=1)
    assert model.verify(answer.point).ok and len(oracle.points) <= 600
    assert answer.primal_bound == pytest.approx(1.5 - 0.2 * math.sqrt(2), abs=0.05)


@pytest.mark.parametrize(
    ("name", "budget"),
    [
        *(("differential-evolution", 4000), ("dual-annealing", 4000), ("portfolio", 1000)),
        *(("cobyqa", 60), ("surrogate-search", 40)),
    ],
)
def test_equalities_hold_within_their_tolerance(name, budget):
    model = box(
        lambda x: [x[0] ** 2 + x[1] ** 2, x[0] + 2 * x[1] - 1], (-1, 1), (-1, 1),
        equalities=1, equality_tolerance=1e-3, budget=budget,
    )  # fmt: skip
    answer, _ = search(name, model, seed=1)
    assert model.verify(answer.point).ok and answer.primal_bound == pytest.approx(0.2, abs=2e-3)


@pytest.mark.parametrize("name", ["cobyqa", "surrogate-search"])
def test_more_constraints_than_processes(name):
    model = box(
        lambda x: [x.sum(), *(0.3 - x[0] - np.arange(30) / 1000)],
        (0, 1),
        (0, 1),
        inequalities=30,
        budget=40,
    )
    answer, _ = search(name, model, seed=1)
    assert model.verify(answer.point).ok and answer.primal_bound == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize("name", EVERY)
def test_no_feasible_point_is_no_plan(name):
    answer, _ = search(name, box(lambda x: [x[0], 1.0 + x[0]], (0, 1), inequalities=1, budget=15))
    assert answer.termination is Termination.NO_SOLUTION and answer.point is None
    assert (
        answer.message.startswith("none of ") and "points holds all constraints" in answer.message
    )


@pytest.mark.parametrize("name", EVERY)
def test_constraints_without_values_do_not_stop_a_search(name):
    def partly(x):
        return [x[0], math.nan if x[0] < 0.3 else 0.5 - x[0]]

    answer, _ = search(
        name, box(partly, (0, 1), inequalities=1, budget=allowed(name, 40, 300)), seed=1
    )
    assert 0.5 <= answer.primal_bound < 0.6


def test_the_rules_order_points_as_deb():
    problem = box(lambda x: 0, (0, 1), inequalities=1, equalities=1, equality_tolerance=0.1)
    table = np.array(
        [
            [5, -1, 0.05],
            [1e99, 0, -0.1],
            [-9, 1e-9, 0],
            [-9, 0, 0.3],
            [-9, 3, 0.3],
            [0, math.nan, 0],
        ]
    )
    rules = Constraints(problem)
    assert rules.feasible(table).tolist() == [True, True, False, False, False, False]
    merit = rules.merit(np.zeros((6, 1)), table)
    assert merit.argsort().tolist() == [0, 1, 2, 3, 4, 5] and merit[5] == math.inf
    np.testing.assert_array_equal(rules.merit(np.zeros((2, 1)), table[2:4]), merit[2:4])


def test_a_second_lagrangian_does_not_know_the_best_point_of_the_first():
    rules = Constraints(box(lambda x: 0, (0, 1), inequalities=1))
    table = np.array([[0.0, 1.0], [2.0, -1.0], [3.0, -1.0]])
    rules.begin(table)
    rules.merit(np.zeros((1, 1)), np.array([[-1e9, -1.0]]))
    rules.begin(table)
    rules.merit(np.ones((3, 1)), table)
    assert rules.best[0] > -10 and rules.best[1].tolist() == [1.0]


def test_several_objectives_are_refused_by_name():
    model = box(lambda x: [x[0], 1 - x[0]], (0, 1), objectives=2, reference=[1, 1], budget=50)
    for parameter in EVERY:
        (name,) = parameter.values
        if name == "random-search" or find_backend(name).missing():
            continue
        with pytest.raises(
            UnsupportedFormulation, match="does not support several objectives, got 2"
        ):
            search(name, model)
    with pytest.raises(UnsupportedFormulation, match="at least two objectives, got 1"):
        search("nsga-ii", box("sphere", (0, 1)))


# -- kinds of variables -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_small_mixed_problems_equal_enumeration(name, seed):
    """An integer, a category, and a conditional integer, with a linear constraint and random costs."""
    generator = np.random.default_rng(seed)
    costs, weights = generator.random((6, 3, 4)), generator.random((6, 3, 4))
    kinds = [
        "integer", {"type": "category", "values": ["a", "b", "c"]},
        {"type": "integer", "when": {"variable": 1, "in": ["b", "c"]}},
    ]  # fmt: skip

    def function(x):
        i, j, k = int(x[0] + 2), int(x[1]), int(x[2])
        assert j > 0 or k == 0
        return [costs[i, j, k], weights[i, j, k] - 0.5]

    # The others may stop in a local minimum of these random costs.
    is_exact = name in ("random-search", "differential-evolution", "portfolio", "cma-es")
    budget = 2000 if is_exact else allowed(name, 40, 400)
    model = box(function, (-2, 3), (0, 2), (0, 3), variables=kinds, inequalities=1, budget=budget)
    points = [
        (i, j, k) for i, j, k in itertools.product(range(-2, 4), range(3), range(4)) if j or not k
    ]
    best = min(function(point)[0] for point in points if function(point)[1] <= 0)
    answer, _ = search(name, model, seed=seed)
    assert model.verify(answer.point).ok
    if is_exact:
        assert answer.primal_bound == best


@pytest.mark.parametrize("name", EVERY)
def test_a_range_of_many_integers(name):
    model = box(
        lambda x: abs(x[0] - 123_457.3),
        (-1e6, 1e6),
        variables=["integer"],
        budget=allowed(name, 50, 400),
    )
    answer, _ = search(name, model, seed=1)
    (x,) = answer.point.x
    assert x.is_integer() and model.verify(answer.point).ok


def test_a_warm_start_is_made_canonical_and_counted():
    kinds = ["integer", {"when": {"variable": 0, "in": [1]}}]
    model = box("sphere", (0, 3), (1, 2), variables=kinds, budget=1)
    answer, oracle = search("random-search", model, warm=[0.4, 1.5])
    assert answer.point == BlackBoxPoint((0, 1)) and oracle.points == [[0.0, 1.0]]


def test_repeats_reduce_noise_and_count():
    calls = []

    def noisy(x):
        calls.append(1)
        return float(x @ x) + (-1) ** len(calls)

    model = box(noisy, (-1, 1), (-1, 1), repeats=2, budget=101, samples=2)
    answer, oracle = search("random-search", model, seed=1)
    assert len(calls) == 100 == answer.statistics["evaluations"] and len(oracle.points) == 50
    assert answer.primal_bound == pytest.approx(float(np.sum(np.square(answer.point.x))))
    found = ct.solve(model, "random-search", seed=1)
    assert found.primal_bound == pytest.approx(answer.primal_bound)
    assert found.incumbents[-1].evaluations % 2 == 0
