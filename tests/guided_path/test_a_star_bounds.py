"""Bounds of a-star: they equal their definitions, and are never too large."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, random_tour
from guided_path.searched import shortest, solve

from crosstrack.models.guided_path import data
from crosstrack.models.guided_path.relation import chain_cover
from crosstrack.solvers.guided_path import (
    share_kernels,
    shares as shares_module,
    state_kernels,
)
from crosstrack.solvers.guided_path.bound import Tables, whole_lengths
from crosstrack.solvers.guided_path.shares import shares_of
from crosstrack.solvers.guided_path.state_kernels import least_rest


def plain_bound(model, served, here):
    """Return the sum over gaps of the most crossings of any remaining path."""
    x = model.coordinates
    places = np.unique(x)
    left = set(range(1, model.size)) - served
    after = {c: [b for a, b in model.pairs if a == c] for c in left}

    def paths(c):
        yield (c,)
        for other in after[c]:
            for rest in paths(other):
                yield (c, *rest)

    total = 0.0
    for low, high in itertools.pairwise(places):
        most = 0
        for path in [(), *(one for c in left for one in paths(c))]:
            sides = [here > low, *(x[c] > low for c in path), x[0] > low]
            most = max(most, sum(a != b for a, b in itertools.pairwise(sides)))
        total += (high - low) * most
    return total


@pytest.mark.parametrize("seed", range(30))
def test_bound_counts_crossings(seed):
    rng = np.random.default_rng(seed)
    model = random_tour(seed, 9)
    tables = Tables.of(model)
    sizes = np.diff(tables.first)
    for _ in range(10):
        order = [c for c in model.sorted_customers if rng.random() < 0.8]
        served = set()
        for c in order:
            if all(a in served for a, b in model.pairs if b == c):
                served.add(c)
        counts = np.array(
            [sum(int(c) in served for c in tables.customers[a:b]) for a, b in
             itertools.pairwise(tables.first)]
        )  # fmt: skip
        assert (counts <= sizes).all()
        here = int(rng.integers(len(tables.at)))
        most = np.empty(len(tables.wide), np.int16)
        value = state_kernels.rest_by_gaps(tables, counts, here, most)
        plain = plain_bound(model, served, np.unique(model.coordinates)[here])
        assert value * tables.unit == pytest.approx(plain, rel=1e-9, abs=1e-300)
        key = np.empty(tables.words, np.int64)
        state_kernels.pack(counts, here, tables.fields, key)
        again = np.empty_like(counts)
        assert state_kernels.unpack(key, tables.fields, again) == here
        assert (again == counts).all()
        near = state_kernels.neighbours(tables, counts, here)
        ready = [
            c for c in range(1, model.size)
            if c not in served and all(a in served for a, b in model.pairs if b == c)
        ]  # fmt: skip
        where = {int(tables.place[k]) for k, c in enumerate(tables.customers) if c in ready}
        assert near[0] == max((one for one in where if one < here), default=-1)
        assert near[1] == min((one for one in where if one > here), default=-1)
    start = np.zeros_like(counts)
    root = state_kernels.rest_by_gaps(tables, start, int(tables.place[-1]), most)
    assert root == tables.root()


def start_of(tables):
    """Return the start as the only state of a sample."""
    return np.array([[0] * (len(tables.first) - 1) + [tables.place[-1]]])


def rest_of(tables, shares, counts, here):
    """Return the bound by shares, in m."""
    value = share_kernels.rest_of_shares(tables, shares, counts, here)
    return value * shares.times / shares.over * tables.unit


@pytest.mark.parametrize("seed", range(12))
def test_one_group_of_all_chains_is_the_problem_itself(seed):
    rng = np.random.default_rng(seed)
    model = chains_tour(3, 3, seed)
    if seed % 2:
        model = replace(
            model, coordinates=rng.normal(size=model.size) * 10.0 ** rng.integers(-6, 7)
        )
    tables = Tables.of(model)
    shares = shares_of(tables, 2 * int(tables.at[-1]) * 9, start_of(tables), np.zeros(1, np.int8))
    assert len(shares.weighted) == 1
    value = shortest(model)
    found = rest_of(tables, shares, np.zeros(3, np.int64), int(tables.place[-1]))
    assert value * (1 - 1e-5) <= found <= value * (1 + 1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_shares_are_consistent_with_the_distance_walked(monkeypatch, seed):
    monkeypatch.setattr(shares_module, "MOST", 2)
    rng = np.random.default_rng(seed)
    model = chains_tour(5, 5, seed)
    if seed % 2:
        model = replace(model, coordinates=rng.normal(size=model.size))
    tables = Tables.of(model)
    shares = shares_of(tables, 2 * int(tables.at[-1]) * 25, start_of(tables), np.zeros(1, np.int8))
    assert len(shares.weighted) == 3
    crossings = np.diff(shares.weighted, axis=1).sum(axis=0)
    assert (crossings * shares.times <= tables.length * shares.over).all()  # rounded down
    start, value = int(tables.place[-1]), solve(model).primal_bound
    for _ in range(20):
        counts, here = np.zeros(5, np.int64), start
        rest = rest_of(tables, shares, counts, here)
        assert rest <= value * (1 + 1e-12)
        while (counts < 5).any():
            k = int(rng.choice(np.flatnonzero(counts < 5)))
            there = int(tables.place[tables.first[k] + counts[k]])
            counts[k] += 1
            after = rest_of(tables, shares, counts, there)
            walked = abs(tables.at[there] - tables.at[here]) * tables.unit
            assert rest <= walked + after + 1e-12 * abs(rest)
            here, rest = there, after
        home = abs(tables.at[start] - tables.at[here]) * tables.unit
        assert rest == pytest.approx(home, rel=1e-4, abs=1e-9)
        assert rest <= home * (1 + 1e-12)


@pytest.mark.parametrize(
    ("chains", "seed"),
    [
        (8, 1),
        pytest.param(8, 2, marks=pytest.mark.slow),
        (12, 3),
        pytest.param(12, 4, marks=pytest.mark.slow),
    ],
)
def test_shares_are_better_than_gaps(chains, seed):
    model = chains_tour(chains, 8, seed)
    tables = Tables.of(model)
    value = round(solve(model).primal_bound / tables.unit)
    shares = shares_of(tables, value, start_of(tables), np.zeros(1, np.int8))
    counts, here = np.zeros(len(tables.first) - 1, np.int64), int(tables.place[-1])
    found = rest_of(tables, shares, counts, here) / tables.unit
    assert tables.root() < found <= value


def test_a_stop_leaves_no_shares():
    tables = Tables.of(chains_tour(8, 8, 1))
    assert shares_of(tables, 5000, start_of(tables), np.ones(1, np.int8)) is None
    # A search that stops the ascent keeps its best bound, which is that of the shares.
    bounds = list[int]()

    def between(bound, work):
        bounds.append(bound)
        return len(bounds) == 3 or work < 0

    shares = shares_of(tables, 5000, start_of(tables), np.zeros(1, np.int8), between)
    assert len(bounds) == 3 and bounds == sorted(bounds)
    counts, scratch = (
        np.zeros(tables.first.size - 1, np.int64),
        np.empty(tables.wide.size, np.int16),
    )
    root = least_rest.py_func(tables, shares, counts, int(tables.place[-1]), scratch)
    assert root >= bounds[-1]


def test_shares_are_the_nearest_that_add_up():
    rng = np.random.default_rng(1)
    for _ in range(20):
        given = rng.normal(size=(6, 4)) * 10
        whole = rng.integers(0, 9, 4)
        found = shares_module._project(given, whole)
        assert (found >= 0).all()
        assert found.sum(axis=0) == pytest.approx(whole, abs=1e-12)
        # Optimality condition of the projection.
        others = rng.dirichlet(np.ones(6) * 0.3, size=(200, 4)).transpose(0, 2, 1) * whole
        assert (((given - found) * (others - found)).sum(axis=1) <= 1e-9).all()


def test_many_chains_are_grouped_as_far_as_tables_may_grow():
    for sizes in ([1], [3] * 44, [21, 17, 19, 23, 21, 21, 15, 21, 19, 19], [300], [50] * 100):
        limits = shares_module.ENTRIES, shares_module.ALL_ENTRIES
        groups = shares_module._group_chains(np.array(sizes), np.array(sizes), *limits)
        assert sorted(np.concatenate(groups).tolist()) == list(range(len(sizes)))
        entries = [float(np.prod(np.array(sizes)[one] + 1.0)) * len(one) for one in groups]
        assert max(entries) <= shares_module.ENTRIES
        assert sum(entries) <= shares_module.ALL_ENTRIES
    assert len(shares_module._group_chains(np.full(10, 20), np.arange(10), *limits)) == 2


@pytest.mark.parametrize("dense", [50_000, 0])
def test_chains_cover_all(monkeypatch, dense):
    monkeypatch.setattr(data, "DENSE", dense)
    for seed in range(60):
        model = random_tour(seed, 9)
        tables = Tables.of(model)
        assert sorted(tables.customers.tolist()) == list(range(1, model.size))
        for a, b in itertools.pairwise(tables.first):
            for one, other in itertools.pairwise(tables.customers[a:b]):
                assert model.closure[one, other]
        fewest = len(chain_cover(model.closure, model.sorted_customers))
        if dense or not len(model.precedence):
            assert len(tables.first) - 1 == fewest
        else:
            assert len(tables.first) - 1 >= fewest


def test_keys_of_many_chains_take_several_words():
    model = chains_tour(60, 3, 1)
    tables = Tables.of(model)
    assert tables.words == 3
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(300):
        counts = rng.integers(0, np.diff(tables.first) + 1)
        key = np.empty(tables.words, np.int64)
        state_kernels.pack(counts, 5, tables.fields, key)
        again = np.empty_like(counts)
        assert state_kernels.unpack(key, tables.fields, again) == 5
        assert (again == counts).all()
        seen.add(int(state_kernels.hashed(key)))
    assert len(seen) == 300


@pytest.mark.parametrize(
    ("places", "lengths", "unit"),
    [
        ([3, 6, 12, 999999999], [1, 2, 333333329], 3.0), ([0.25, 0.5, 2], [1, 6], 0.25), ([7.0], [], 1.0),
        ([-1e15, 1e15], [1], 2e15), ([0, 5e-324, 15e-324], [1, 2], 5e-324),
    ],
)  # fmt: skip
def test_gaps_that_a_unit_divides(places, lengths, unit):
    found, common, exact = whole_lengths(np.array(places, float))
    assert found.tolist() == lengths
    assert common == unit
    assert exact


def test_gaps_that_no_unit_divides_are_rounded_down():
    places = np.sort(np.random.default_rng(1).normal(size=200))
    lengths, unit, exact = whole_lengths(places)
    assert not exact
    short = np.diff(places) - lengths * unit
    assert (short >= 0).all()
    assert short.max() <= 2.0**-42 * np.ptp(places)


@pytest.mark.parametrize(
    "cases", [range(40), pytest.param(range(40, 1040), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_no_stage_of_the_ascent_exceeds_the_optimum(monkeypatch, cases):
    for name, value in {"WIDE_ENTRIES": 300, "FIRST": 12, "HASTY": 2}.items():
        monkeypatch.setattr(shares_module, name, value)
    several = [0, 0]
    for seed in cases:
        four = seed % 8 == 0  # one group of four chains, or single chains before the wide groups
        monkeypatch.setattr(shares_module, "ENTRIES", 400 if four else 12)
        model = random_tour(seed, 7) if seed % 2 else chains_tour(3 + four, 2, seed)
        tables, optimum, bounds, works = Tables.of(model), best(model), [], set()

        def between(bound, work, bounds=bounds, works=works):
            bounds.append(bound)
            works.add(work)
            return False

        length = math.ceil(optimum / tables.unit)
        shares_of(tables, length, start_of(tables), np.zeros(1, np.int8), between)
        # The callback rounds the bound up to a whole number of units.
        assert all((bound - 1) * tables.unit <= optimum * (1 + 1e-12) for bound in bounds)
        if tables.exact:
            assert max(bounds, default=0) <= length
        several[four] += len(works) > 1
    assert min(several) > 0
