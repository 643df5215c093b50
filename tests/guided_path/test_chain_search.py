"""Merges of chains, the search that repeats them, the bound updated per step, and tours of 20,000 customers."""

import math
import threading
import time
from functools import cache

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, random_tour

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.walks import length_of, reduced
from crosstrack.solvers import Limit, Request
from crosstrack.solvers.contract.backend import Control
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.guided_path import a_star, bound, chain_search
from crosstrack.solvers.guided_path.a_star import AStar
from crosstrack.solvers.guided_path.bound import Tables, needs_of
from crosstrack.solvers.guided_path.chain_kernels import merge_again, path_length
from crosstrack.solvers.guided_path.chain_search import ChainSearch
from crosstrack.solvers.guided_path.insertion import ChainLists, Greedy, InsertIndex, InsertNearest
from crosstrack.solvers.guided_path.merge_kernels import merge_two
from crosstrack.solvers.guided_path.state_kernels import rest_after, rest_by_gaps
from crosstrack.timing import OutOfTime

GO = np.zeros(1, np.int8)


def answered(backend, model, **fields):
    options = fields.pop("options", {})
    answer = backend.run(model, Request(options=backend.checked_options(options), **fields))
    found = model.verify(answer.point)
    assert found.ok, found
    assert found.objective == pytest.approx(answer.primal_bound, rel=1e-12, abs=1e-300)
    return answer


# -- the bound -------------------------------------------------------------------------------------


def rests_of(model):
    """Return the function of least lengths from a coordinate through unserved customers to the start."""
    x, pairs = model.coordinates.tolist(), model.pairs

    @cache
    def rest(here, left):
        if not left:
            return abs(here - x[0])
        ready = [c for c in left if not any(b == c and a in left for a, b in pairs)]
        return min(abs(here - x[c]) + rest(x[c], left - {c}) for c in ready)

    return rest


@pytest.mark.parametrize("groups", [2048, 2])
@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(part, id=f"{part[0]}", marks=[pytest.mark.slow] if part[0] >= 200 else [])
        for part in np.split(np.arange(500), 5)
    ],
)
def test_the_updated_bound_is_below_every_rest(monkeypatch, seeds, groups):
    """1,000 tours, 400 of them in the fast tests: after each step, the update equals the bound of the state, which is at most the rest."""
    monkeypatch.setattr(bound, "MOST_GROUPS", groups)
    for seed in seeds.tolist():
        model = random_tour([seed, 38], most=7)
        tables, rest, rng = Tables.of(model), rests_of(model), np.random.default_rng(seed)
        counts, here = np.zeros(len(tables.first) - 1, np.int64), int(tables.place[-1])
        most, again = (np.empty(len(tables.wide), np.int16) for _ in range(2))
        value = rest_by_gaps.py_func(tables, counts, here, most)
        places, left = np.unique(model.coordinates), frozenset(range(1, model.size))
        while left:
            true = rest(float(places[here]), left)
            assert value * tables.unit <= true * (1 + 1e-12)
            ready = [c for c in left if not any(b == c and a in left for a, b in model.pairs)]
            heads = tables.first[:-1] + np.minimum(counts, np.diff(tables.first) - 1)
            ready = [c for c in ready if c in tables.customers[heads]]
            c = int(rng.choice(ready))
            number = int(np.flatnonzero(tables.customers == c)[0])
            then = counts.copy()
            then[np.searchsorted(tables.first, number, side="right") - 1] += 1
            there = int(tables.place[number])
            value = rest_after.py_func(tables, counts, then, here, there, value, most)
            counts, here, left = then, there, left - {c}
            assert value == rest_by_gaps.py_func(tables, counts, here, again)
            assert (most == again).all()


def test_groups_of_gaps_lower_the_bound_slightly(monkeypatch):
    tables = Tables.of(reduced(chains_tour(10, 100, 1))[0])
    monkeypatch.setattr(bound, "MOST_GROUPS", 50)
    grouped = Tables.of(reduced(chains_tour(10, 100, 1))[0])
    assert len(grouped.wide) in (50, 51) < (len(tables.wide),)
    assert grouped.wide.sum() == tables.wide.sum()
    assert 0.9 * tables.root() < grouped.root() <= tables.root()


# -- merges ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [True, False])
def test_a_merge_of_two_chains_is_shortest(exact):
    rng = np.random.default_rng(2)
    for _ in range(100):
        p, q = rng.integers(0, 5, 2)
        x = rng.integers(-5, 6, p + q + 2) if exact else rng.normal(size=p + q + 2)
        base, chain, (start, end) = x[:p].copy(), x[p : p + q].copy(), x[-2:]
        before_base = np.sort(rng.integers(0, q + 1, p)) * (rng.random() < 0.5)
        # Each customer of the chain needs those of the base that do not need it.
        before_chain = np.zeros(q, np.int64)
        for j in range(q):
            free = int((before_base <= j).sum())
            before_chain[j] = max(before_chain[j - 1] if j else 0, rng.integers(0, free + 1))
        merged = np.zeros(p + q, np.uint8)
        far = 1 << 60 if exact else math.inf
        moves = np.empty((p + 1) * (q + 1), np.uint8)
        fields = (start, end, base, chain, before_base, before_chain, far, moves)
        assert merge_two(*fields, merged, GO)
        assert merged.sum() == q

        def least(i, j, here, fields=fields):
            _, end, base, chain, before_base, before_chain, far, _ = fields
            ways = [abs(here - end)] if i == len(base) and j == len(chain) else []
            if i < len(base) and before_base[i] <= j:
                ways.append(abs(here - base[i]) + least(i + 1, j, base[i]))
            if j < len(chain) and before_chain[j] <= i:
                ways.append(abs(here - chain[j]) + least(i, j + 1, chain[j]))
            return min(ways, default=far)

        i = j = 0
        stops = [start]
        for side in merged.tolist():
            assert (before_chain[j] <= i) if side else (before_base[i] <= j)
            stops.append(chain[j] if side else base[i])
            i, j = i + 1 - side, j + side
        length = np.abs(np.diff([*stops, end])).sum()
        assert length == pytest.approx(least(0, 0, start), rel=1e-12)
        plain = np.zeros_like(merged)
        assert merge_two.py_func(*fields, plain, GO)
        assert (plain == merged).all()


def test_needs_follow_from_the_closure():
    for seed in range(100):
        model = random_tour([seed, 39], most=9)
        chains = model.cover
        members = [c for chain in chains for c in chain]
        heads = np.cumsum([0, *map(len, chains)])[:-1]
        precede = model.closure[np.ix_(members, members)].T
        expected = np.add.reduceat(precede, heads, axis=1, dtype=np.int64)
        assert (needs_of(model, chains, plain=True) == expected).all()
        assert len(needs_of(model, chains)) in (0, len(members))


# -- the search ------------------------------------------------------------------------------------


def test_the_search_finds_optima_of_small_tours():
    lengths = []
    for seed in range(25):
        model = random_tour([seed, 40], most=7)
        answer = answered(ChainSearch(), model, options={"rounds": 3})
        lengths.append((answer.primal_bound, best(model)))
    found, least = np.array(lengths).T
    assert (found >= least - 1e-9 * np.maximum(least, 1.0) - 1e-5).all()
    assert np.isclose(found, least, rtol=1e-9, atol=1e-5).mean() >= 0.95


def test_compiled_and_interpreted_searches_are_the_same():
    for seed in range(4):
        model = random_tour([seed, 41], most=12, relation=["chains", "dag", "both"][seed % 3])
        tables = Tables.of(model)
        need = needs_of(model, model.cover)
        position = {c: i for i, c in enumerate(tables.customers.tolist())}
        order = np.array([position[c] for c in model.sorted_customers])
        results = []
        for loop in (merge_again.dispatcher, merge_again.py_func):
            mine, shortest = order.copy(), order.copy()
            value = loop(
                tables, need, mine, shortest, 1500, 5.0, 0.0, np.empty(400, np.uint8),
                np.random.default_rng(seed), GO,
            )  # fmt: skip
            assert value == path_length(tables, shortest, tables.place[-1], tables.place[-1])
            results.append((value, mine.tolist(), shortest.tolist()))
        assert results[0] == results[1]


def test_a_seed_gives_the_same_tour_and_rounds_improve_it():
    model = chains_tour(10, 40, 1)
    short, one, other = (
        answered(ChainSearch(), model, seed=3, options={"rounds": rounds}) for rounds in (0, 4, 4)
    )
    assert one.point == other.point
    assert one.primal_bound < short.primal_bound
    again = answered(ChainSearch(), model, warm_start=one.point, options={"rounds": 0})
    assert again.primal_bound <= one.primal_bound


def shapes(seed):
    """Return a random tour of one of many shapes."""
    rng = np.random.default_rng([seed, 42])
    k, length = [(4, 60), (60, 4), (12, 20), (1, 200), (150, 1), (3, 90), (30, 15)][seed % 7]
    n = k * length
    x = [
        lambda: rng.integers(1, 201, n), lambda: rng.normal(size=n), lambda: np.full(n, 3.0),
        lambda: rng.integers(-2, 3, n), lambda: rng.random(n),
    ][seed % 5]() * [1.0, 1e-6, 1e9][seed % 3]  # fmt: skip
    chains = (1 + rng.permutation(n)).reshape(k, length)
    pairs = ()
    if seed % 4 == 3:
        rank = np.empty(n + 1, int)
        rank[chains.T.ravel()] = np.arange(n)
        ends = rng.integers(1, n + 1, (n // 4, 2))
        pairs = ends[rank[ends[:, 0]] < rank[ends[:, 1]]]
    return GuidedPathTour(np.append(0.0, x), chains=chains.tolist(), precedence=pairs)


@pytest.mark.parametrize(
    "seeds", [[0, 3, 5, 7, 8, 11, 13, 16, 19, 25], pytest.param(range(200), marks=pytest.mark.slow)]
)
def test_a_star_and_the_search_are_no_longer_than_any_heuristic(monkeypatch, seeds):
    """200 tours: long chains, many short ones, relations, one place, equal places, 1e-6 and 1e9."""
    monkeypatch.setattr(chain_search, "STALE", 1)
    monkeypatch.setattr(a_star, "WIDEST", 16)
    for seed in seeds:
        model = shapes(seed)
        best_of = min(
            answered(one(), model, options={"passing": passing}).primal_bound
            for one in (InsertIndex, InsertNearest, Greedy) for passing in (False, True)
        )  # fmt: skip
        rounding = 1e-9 * best_of
        searched = answered(ChainSearch(), model, options={"rounds": 1})
        exact = answered(AStar(), model, options={"states": 500})
        assert searched.primal_bound <= best_of + rounding
        assert exact.primal_bound <= best_of + rounding
        assert exact.dual_bound <= min(searched.primal_bound, exact.primal_bound) + rounding


def test_a_stop_keeps_the_tour():
    control = Control()
    control.stop(Limit.INTERRUPTED)
    answer = answered(ChainSearch(), chains_tour(10, 40, 1), control=control)
    assert answer.limit is Limit.INTERRUPTED


@pytest.mark.parametrize("backend", ["a-star", "chain-search"])
@pytest.mark.parametrize(
    "late",
    [(chain_search, "merge_walks"), (chain_search, "merge_by_index"), (Tables, "of")],
    ids=["walks", "insert", "tables"],
)
def test_a_limit_in_any_step_keeps_the_tours_before_it(monkeypatch, backend, late):
    def end(*_arguments):
        raise OutOfTime

    model = chains_tour(5, 40, 1)
    least = answered(Greedy(), model).primal_bound
    if late[1] == "merge_walks":  # the first step
        end.is_compiled, least = True, math.inf
    monkeypatch.setattr(*late, end)
    solution = ct.solve(model, backend, time_limit=60)
    assert (solution.termination, solution.limit) == ("feasible", "time")
    assert solution.primal_bound <= least


def test_preparations_stop_at_the_flag():
    model, flag = chains_tour(5, 8, 1), np.ones(1, np.int8)
    steps = (
        lambda: reduced(model, flag=flag),
        lambda: reduced(model, passing=False, flag=flag),
        lambda: needs_of(model, model.cover, plain=True, flag=flag),
        lambda: Tables.of(model, flag),
        lambda: ChainLists.of(model, flag),
    )
    for step in steps:
        with pytest.raises(OutOfTime):
            step()
    flag[0] = 0
    assert [step() is not None for step in steps] == [True] * 5


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.2, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("backend", ["a-star", "chain-search", "insert-nearest", "greedy"])
def test_limits_are_kept_with_many_pairs(backend, seconds):
    """20,000 customers and 400,000 pairs, in CPU seconds, so that other processes have no effect."""
    rng = np.random.default_rng(1)
    pairs = np.sort(rng.integers(1, 20_001, (400_000, 2)), axis=1)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    model = GuidedPathTour(np.append(0.0, rng.random(20_000)), precedence=pairs)
    control, begin = Control(), time.process_time()

    def watch():
        while time.process_time() - begin < seconds:
            time.sleep(0.02)
        control.stop(Limit.TIME)

    threading.Thread(target=watch, daemon=True).start()
    chosen = find_backend(backend, model)
    options = chosen.checked_options({})
    answer = chosen.run(model, Request(options=options, control=control))
    assert answer.limit == "time"
    assert time.process_time() - begin <= seconds + 0.5


# -- 20,000 customers ------------------------------------------------------------------------------


def test_twenty_thousand_customers_need_no_dense_table():
    rng = np.random.default_rng(1)
    model = GuidedPathTour(
        np.append(0.0, rng.random(20_000)), chains=(1 + np.arange(20_000)).reshape(20, 1000)
    )
    assert len(model.cover) == 20
    tables = Tables.of(reduced(model)[0])
    assert tables.crossings.nbytes < 1e8
    merged = answered(InsertNearest(), model)
    assert merged.primal_bound > tables.root() * tables.unit
    assert length_of(model, merged.point.order) == merged.primal_bound
    with pytest.raises(InvalidData, match="at most 5000 customers, got 20000"):
        _ = model.closure
    with pytest.raises(InvalidData, match="1 … 20000 customers"):
        GuidedPathTour(np.zeros(20_002))


def test_a_relation_of_too_many_chains_is_refused(monkeypatch):
    monkeypatch.setattr(bound, "MOST_NEEDS", 10)
    model = GuidedPathTour(
        np.arange(9.0) * [1, -1, 1, -1, 1, -1, 1, -1, 1],
        precedence=[[1, 4], [5, 4], [4, 7], [4, 8], [2, 3]],
    )
    with pytest.raises(UnsupportedFormulation, match="at most 10 entries"):
        answered(InsertIndex(), model)
    assert answered(AStar(), model).primal_bound == pytest.approx(best(model))
    assert ct.solve(model, "a-star", time_limit=60).primal_bound == pytest.approx(best(model))
    large = GuidedPathTour(np.arange(80.0) * (-1.0) ** np.arange(80), precedence=[[1, 4], [5, 4]])
    assert ct.solve(large, "a-star", time_limit=60).termination == "optimal"
