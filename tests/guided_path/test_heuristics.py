"""The paper's heuristics, compared with worked steps, enumeration and plain loops."""

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, random_tour, tours
from hypothesis import given, settings

import crosstrack as ct
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.walks import length_of, passed, reduced, served
from crosstrack.solvers import Limit, Request
from crosstrack.solvers.guided_path import insertion_kernels
from crosstrack.solvers.guided_path.bound import needs_of
from crosstrack.solvers.guided_path.dynamic_programming import DynamicProgramming
from crosstrack.solvers.guided_path.insertion import (
    Greedy,
    InsertIndex,
    InsertNearest,
    ordered_chains,
)
from crosstrack.solvers.guided_path.insertion_kernels import (
    merge_by_index,
    merge_nearest,
    merge_walks,
    visit_nearest,
)

BACKENDS = (InsertNearest, InsertIndex, Greedy)
GO = np.zeros(1, np.int8)
each = pytest.mark.parametrize("backend", BACKENDS, ids=lambda one: one.name)


def close(model):
    """Return the tolerance of lengths for rounding."""
    return 1e-12 * model.size * max(1e-300, float(np.abs(model.coordinates).max()))


def answered(backend, model, **options):
    """Return the answer after verifying its plan and comparing its length."""
    one = backend()
    answer = one.run(model, Request(options=one.checked_options(options)))
    found = model.verify(answer.point)
    assert (answer.termination, answer.dual_bound) == ("feasible", None)
    assert found.ok, found
    assert answer.primal_bound == pytest.approx(found.objective, abs=close(model))
    built = answer.statistics["length as built"]
    if options:
        assert answer.primal_bound <= built + close(model)
    else:
        assert answer.primal_bound == pytest.approx(built, abs=close(model))
    return answer


def built(loop, model, chains):
    """Return the tour that a kernel builds from some chains."""
    members = np.array([c for chain in chains for c in chain])
    order = np.zeros(members.size, np.int64)
    starts = np.cumsum([0, *map(len, chains)])
    assert loop(model.coordinates, needs_of(model, chains), members, starts, order, GO)
    return members[order].tolist()


# -- whole runs ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seeds", [120, pytest.param(300, marks=pytest.mark.slow)])
@each
def test_tours_are_verified_and_no_shorter_than_the_shortest(backend, seeds):
    for seed in range(seeds):
        model = random_tour([seed, 5])
        plain, left = (answered(backend, model, **one) for one in ({}, {"passing": True}))
        assert (
            plain.primal_bound >= left.primal_bound - close(model) >= best(model) - 2 * close(model)
        )
        if backend is Greedy:  # it always visits the nearest available customer
            assert abs(plain.primal_bound - left.primal_bound) <= close(model)


@given(tours())
@settings(max_examples=60, deadline=None)
def test_drawn_tours(model):
    value = best(model)
    for backend in BACKENDS:
        assert answered(backend, model).primal_bound >= value - close(model)


@pytest.mark.parametrize("backend", [InsertNearest, InsertIndex], ids=lambda one: one.name)
def test_two_chains_are_merged_to_the_optimum(backend):
    count = 0
    for seed in range(100):
        model = random_tour([seed, 6], most=7)
        if len(reduced(model, passing=False)[0].cover) <= 2:
            count += 1
            assert abs(answered(backend, model).primal_bound - best(model)) <= close(model)
    assert count > 50


def test_merged_walks_are_feasible_and_of_two_chains_the_shortest():
    pairs = 0
    for seed in range(200):
        small, _ = reduced(random_tour([seed, 6], most=7))
        sizes = np.array(list(map(len, small.cover)))
        if len(small.pairs) != small.size - 1 - len(sizes):
            continue
        members = np.array([c for chain in small.cover for c in chain])
        starts, walk = np.cumsum([0, *sizes]), np.zeros(members.size, np.int64)
        for order in (np.zeros(0, np.int64), np.arange(len(sizes))[::-1].copy()):
            data = (small.coordinates, members, starts, order, walk)
            stops = walk[: merge_walks.py_func(*data, GO)].tolist()
            assert stops == walk[: merge_walks(*data, GO)].tolist()
            length = length_of(small, served(small, stops))
            assert length <= length_of(small, stops) + close(small)
            assert length >= best(small) - close(small)
            if len(sizes) == 2:
                pairs += 1
                assert abs(length_of(small, stops) - best(small)) <= close(small)
    assert pairs > 50
    assert merge_walks(*data[:3], np.arange(len(sizes)), walk, np.ones(1, np.int8)) in (-1, 0)


def test_mean_lengths_of_merging_and_greedy_insertion():
    """8 seeds of 6 chains of 5: merging is within 6 % of the optimum, greedy insertion is not."""
    models = [chains_tour(6, 5, seed) for seed in range(8)]
    names = (DynamicProgramming(), "insert-nearest", "insert-index", "greedy")
    lengths = np.array(
        [[run.primal_bound for run in ct.compare(models, [n]).solutions] for n in names]
    )
    assert (lengths >= lengths[0]).all()
    least, nearest, index, greedy = lengths.mean(axis=1)
    assert max(nearest, index) < 1.06 * least
    assert 1.1 * least < greedy < 1.3 * least


# -- worked steps by hand ------------------------------------------------------------------------


def test_greedy_visits_the_nearest_available_customer():
    # From 0: 10 and 4 are available, 4 is nearer. Then 10 (6 m) and 12 (8 m), then 1 (9 m) and 12 (2 m).
    model = GuidedPathTour([0, 10, 1, 4, 12], chains=[[1, 2], [3, 4]])
    answer = answered(Greedy, model)
    assert (answer.point.order, answer.primal_bound) == ((3, 1, 4, 2), 4 + 6 + 2 + 11 + 1)
    # The example of the paper: 3 at 3, 4 at 4, then 2 (2 m) before 1 (3 m).
    example = GuidedPathTour([0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]])
    assert answered(Greedy, example).point.order == (3, 4, 2, 1)
    ties = GuidedPathTour([0, 5, -5], chains=[[1], [2]])
    assert answered(Greedy, ties).point.order == (1, 2)


def test_algorithm_6_takes_the_chain_whose_first_customer_is_nearest_to_the_end_of_the_tour(
    monkeypatch,
):
    """First customers at 5, 7 and 28. After chain (5, 30) the tour ends at 30, so 28 comes before 7."""
    model = GuidedPathTour([0, 5, 30, 7, 2, 28, 29], chains=[[1, 2], [3, 4], [5, 6]])
    begun, merge = [], insertion_kernels._merge
    monkeypatch.setattr(
        insertion_kernels, "_merge", lambda *args: begun.append(args[3][args[4]]) or merge(*args)
    )
    # 0, 5, 28, 29, 30 is 30 m long and has no turn; then 7 on the way out and 2 on the way back: 60 m.
    assert built(merge_nearest.py_func, model, model.chains) == [1, 3, 5, 6, 2, 4]
    assert begun == [0, 4, 2]
    begun.clear()
    built(merge_by_index.py_func, model, model.chains)
    assert begun == [0, 2, 4]
    monkeypatch.undo()  # a compiled kernel needs the kernel that it calls
    assert answered(InsertNearest, model).primal_bound == 60.0


def test_algorithm_1_serves_the_others_when_they_are_passed():
    model = GuidedPathTour([0, 4, 8, 2, 6, 8, 0], chains=[[2, 1]])
    assert passed(model, [2, 1]) == (6, 3, 4, 5, 2, 1)
    back = GuidedPathTour([0, -4, -8, -2, 6], chains=[[1, 2]])
    assert passed(back, [4, 1, 2]) == (4, 3, 1, 2)


@each
def test_runs_are_deterministic(backend):
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
def test_solves_tours_whose_length_is_the_same_in_every_order(backend, model):
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


def test_each_merge_is_optimal():
    for seed in range(150):
        model = random_tour([seed, 7])
        chains = model.cover
        for count in range(1, len(chains)):
            tour = built(merge_by_index, model, chains[:count])
            merged = built(merge_by_index, model, chains[: count + 1])
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


def visited(model):
    """Return the tour of greedy insertion by a plain loop."""
    order, at = [], model.coordinates[0]
    members = [c for chain in model.cover for c in chain]
    while len(order) < len(members):
        free = [
            c
            for c in members
            if c not in order and set(np.flatnonzero(model.closure[:, c])) <= {*order}
        ]
        order.append(min(free, key=lambda c: abs(model.coordinates[c] - at)))
        at = model.coordinates[order[-1]]
    return order


def test_greedy_insertion_equals_a_plain_loop():
    for seed in range(100):
        kind = ("integers", "ties", "signed", "far", "nowhere")[seed % 5]
        model = random_tour([seed, 8], most=12, kind=kind)
        assert built(visit_nearest, model, model.cover) == visited(model)


@pytest.mark.parametrize("loop", [merge_by_index, merge_nearest, visit_nearest])
def test_compiled_and_interpreted_loops_are_the_same(loop):
    for seed in range(30):
        model = random_tour([seed, 9], most=12)
        first, second = [built(one, model, model.cover) for one in (loop.dispatcher, loop.py_func)]
        assert first == second


def test_chains_go_by_index():
    model = GuidedPathTour([10, 30, 11, 4, 16, 14, 50, -9, 4], chains=[[6, 1], [4, 2], [0, 3], [5]])
    small, numbers = reduced(model, passing=False)
    assert numbers == (0, 1, 2, 4, 6, 7)
    chains = ordered_chains(model, numbers, small.cover)
    assert [[numbers[c] for c in chain] for chain in chains] == [[6, 1], [4, 2], [7]]
