"""Merges of chains and cheapest insertion, against enumeration and plain loops."""

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, random_tour, tours
from hypothesis import given, settings

import crosstrack as ct
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.walks import length_of, reduced
from crosstrack.solvers import Limit, Request
from crosstrack.solvers.guided_path.dynamic_programming import DynamicProgramming
from crosstrack.solvers.guided_path.greedy import Greedy
from crosstrack.solvers.guided_path.insertion import InsertIndex, InsertNearest, ordered_chains
from crosstrack.solvers.guided_path.insertion_kernels import insert_cheapest, merge_chains

BACKENDS = (InsertNearest, InsertIndex, Greedy)
GO = np.zeros(1, np.int8)
each = pytest.mark.parametrize("backend", BACKENDS, ids=lambda one: one.name)


def close(model):
    """Return how far lengths may differ by rounding."""
    return 1e-12 * model.size * max(1e-300, float(np.abs(model.coordinates).max()))


def answered(backend, model):
    """Return the answer, of which the plan is walked and the length compared."""
    answer = backend().run(model, Request())
    found = model.verify(answer.point)
    assert (answer.termination, answer.dual_bound) == ("feasible", None)
    assert found.ok, found
    assert answer.primal_bound == pytest.approx(found.objective, abs=close(model))
    assert answer.primal_bound <= answer.statistics["length as built"] + close(model)
    return answer


def built(loop, model, chains):
    """Return the tour that a kernel builds of some chains."""
    members = np.array([c for chain in chains for c in chain])
    order = np.zeros(members.size, np.int64)
    starts = np.cumsum([0, *map(len, chains)])
    assert loop(model.coordinates, model.closure, members, starts, order, GO)
    return order.tolist()


# -- whole runs ----------------------------------------------------------------------------------


@each
def test_tours_are_verified_and_no_shorter_than_the_shortest(backend):
    for seed in range(300):
        model = random_tour([seed, 5])
        assert answered(backend, model).primal_bound >= best(model) - close(model)


@given(tours())
@settings(max_examples=60, deadline=None)
def test_drawn_tours(model):
    value = best(model)
    for backend in BACKENDS:
        assert answered(backend, model).primal_bound >= value - close(model)


@pytest.mark.parametrize("backend", [InsertNearest, InsertIndex], ids=lambda one: one.name)
def test_two_chains_are_merged_to_the_optimum(backend):
    count = 0
    for seed in range(200):
        model = random_tour([seed, 6], most=7)
        if len(reduced(model, passing=False)[0].cover) <= 2:
            count += 1
            assert abs(answered(backend, model).primal_bound - best(model)) <= close(model)
    assert count > 100


def test_lengths_in_sixes():
    """20 seeds of 6 chains of 5: merging is within 2 % of the optimum, insertion is not."""
    models = [chains_tour(6, 5, seed) for seed in range(20)]
    names = (DynamicProgramming(), "insert-nearest", "insert-index", "greedy")
    found = np.array([[ct.solve(m, name).primal_bound for m in models] for name in names])
    assert (found >= found[0]).all()
    least, nearest, index, greedy = found.mean(axis=1)
    assert nearest < 1.02 * least
    assert index < 1.03 * least
    assert 1.1 * least < greedy < 1.25 * least


@each
def test_the_same_tour_again(backend):
    model = chains_tour(8, 5, 3)
    one, other = (ct.solve(model, backend(), seed=seed, threads=1) for seed in (1, 2))
    assert one.plan == other.plan


@each
@pytest.mark.parametrize(
    "model",
    [
        GuidedPathTour([3.0, -1e9]),
        GuidedPathTour(np.zeros(101), chains=[range(100, 0, -1)]),
        GuidedPathTour(np.arange(101) - 50.0),
        GuidedPathTour(np.arange(301.0), chains=[range(300, 0, -1)]),
        GuidedPathTour(np.arange(101) - 50.0, chains=[[k, k + 1] for k in range(1, 100, 2)]),
        GuidedPathTour([0, 1e-6, 1e6, 1e-6, 1e6, -1e6], chains=[[2, 1], [3, 4]]),
    ],
)
def test_wild_tours_that_no_order_makes_longer(backend, model):
    least = 2 * np.ptp(model.coordinates)
    assert answered(backend, model).primal_bound == pytest.approx(least, abs=close(model))


@each
def test_a_run_that_is_stopped(backend):
    request = Request()
    request.control.stop(Limit.TIME)
    answer = backend().run(chains_tour(3, 3, 1), request)
    assert (answer.termination, answer.limit, answer.point) == ("no_solution", "time", None)


@each
@pytest.mark.slow
@pytest.mark.parametrize(("k", "size"), [(1000, 5), (5000, 1), (2, 2500), (2500, 2), (1, 5000)])
def test_five_thousand_customers(backend, k, size):
    answered(backend, chains_tour(k, size, 1))


@each
@pytest.mark.slow
def test_five_thousand_customers_in_any_relation(backend):
    rng = np.random.default_rng(1)
    pairs = np.sort(rng.integers(1, 5001, (20000, 2)), axis=1)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    answered(backend, GuidedPathTour(rng.normal(size=5001), precedence=pairs))


# -- loops ---------------------------------------------------------------------------------------


def test_each_merge_is_the_best_there_is():
    for seed in range(150):
        model = random_tour([seed, 7])
        chains = model.cover
        for count in range(1, len(chains)):
            tour = built(merge_chains, model, chains[:count])
            merged = built(merge_chains, model, chains[: count + 1])
            both = [*tour, *chains[count]]
            assert sorted(merged) == sorted(both)
            pairs = np.argwhere(model.closure[np.ix_(both, both)]) + 1
            fixed = GuidedPathTour(
                model.coordinates[[0, *both]],
                chains=np.split(np.arange(len(both)) + 1, [len(tour)]),
                precedence=pairs if len(pairs) else (),
            )
            assert abs(length_of(model, merged) - best(fixed)) <= close(model)
            assert [c for c in merged if c in tour] == tour


def inserted(model, chains):
    """Return the tour of cheapest insertion, the whole length computed anew for each place."""
    tour = []
    for c in (c for chain in chains for c in chain):
        tried = []
        for place in range(len(tour) + 1):
            before, behind = tour[:place], tour[place:]
            if model.closure[c, before].any() or model.closure[behind, c].any():
                continue
            tried.append((length_of(model, [*before, c, *behind]), place))
        tour.insert(min(tried)[1], c)
    return tour


def test_insertion_equals_a_plain_loop():
    for seed in range(150):
        kind = ("integers", "ties", "signed", "far", "nowhere")[seed % 5]  # exact sums: equal ties
        model = random_tour([seed, 8], most=12, kind=kind)
        assert built(insert_cheapest, model, model.cover) == inserted(model, model.cover)


@pytest.mark.parametrize("loop", [merge_chains, insert_cheapest], ids=["merge", "insert"])
def test_compiled_and_interpreted_loops_are_the_same(loop):
    for seed in range(30):
        model = random_tour([seed, 9], most=12)
        found = [built(one, model, model.cover) for one in (loop.dispatcher, loop.py_func)]
        assert found[0] == found[1]


def test_the_order_of_chains():
    model = GuidedPathTour([10, 30, 11, 4, 16, 14, 50, -9, 4], chains=[[6, 1], [4, 2], [0, 3], [5]])
    small, numbers = reduced(model, passing=False)
    assert numbers == (0, 1, 2, 4, 6, 7)
    own = [
        [numbers[c] for c in chain] for chain in ordered_chains(model, numbers, small.cover, False)
    ]
    assert own == [[6, 1], [4, 2], [7]]
    near = [
        [numbers[c] for c in chain] for chain in ordered_chains(model, numbers, small.cover, True)
    ]
    assert near == [[4, 2], [7], [6, 1]]


def test_ties_of_nearness_go_by_index():
    model = GuidedPathTour([0, 5, 9, -5, -9, 7, 5], chains=[[5, 6], [4, 3], [2, 1]])
    for nearest in (True, False):
        chains = ordered_chains(model, tuple(range(7)), model.cover, nearest)
        assert chains == ((5, 6), (4, 3), (2, 1))
