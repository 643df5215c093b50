"""Dynamic program and its parts, compared with enumeration: tours, tables, walks."""

import itertools

import numpy as np
import pytest
from guided_path.enumerated import (
    best,
    chains_tour,
    coordinates,
    extensions,
    lengths,
    prefix_lengths,
    random_tour,
    tours,
)
from hypothesis import given, settings

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.walks import length_of, reduced, served
from crosstrack.solvers import Limit, Request
from crosstrack.solvers.guided_path import table_kernels
from crosstrack.solvers.guided_path.dynamic_programming import DynamicProgramming, Table

EXAMPLE = GuidedPathTour([0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]])
GO = np.zeros(1, np.int8)


def close(model):
    """Return the tolerance of lengths for rounding."""
    return 1e-12 * model.size * max(1e-300, float(np.abs(model.coordinates).max()))


def solved(model, **options):
    """Return the answer after verifying its plan and comparing its bounds."""
    backend = DynamicProgramming()
    answer = backend.run(model, Request(options=backend.checked_options(options)))
    found = model.verify(answer.point)
    assert answer.termination == "optimal"
    assert found.ok, found
    assert answer.primal_bound == pytest.approx(found.objective, abs=close(model))
    assert answer.dual_bound == answer.primal_bound
    return answer


# -- tours ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (500, 1000, 1500))]
)
def test_two_thousand_tours_equal_enumeration(first):
    for seed in range(first, first + 500):
        model = random_tour(seed)
        # Half of the tables are those of the paper, with all customers that Property 1 keeps.
        answer = solved(model, passing=seed % 2 == 0)
        assert abs(answer.primal_bound - best(model)) <= close(model), (seed, model.to_dict())


@given(tours())
@settings(max_examples=60, deadline=None)
def test_drawn_tours_equal_enumeration(model):
    for passing in (True, False):
        assert abs(solved(model, passing=passing).primal_bound - best(model)) <= close(model)


@pytest.mark.parametrize("relation", ["chains", "dag", "both"])
def test_seven_customers(relation):
    for seed in range(20):
        model = random_tour([seed, 7], most=7, relation=relation)
        assert abs(solved(model).primal_bound - best(model)) <= close(model)


def test_more_customers_with_and_without_those_that_are_passed():
    """Twenty customers are too many to enumerate; the paper's plain table is the reference."""
    large = 0
    for seed in range(60):
        model = random_tour([seed, 10], most=20, relation=("both", "dag", "dense")[seed % 3])
        if Table.of(model).states <= 1e5:
            plain, left = solved(model, passing=False), solved(model)
            assert abs(plain.primal_bound - left.primal_bound) <= close(model)
            large += model.size > 10
    assert large >= 15


def test_the_papers_example():
    solution = ct.solve(EXAMPLE, DynamicProgramming(), seed=3, threads=1)
    assert (solution.termination, solution.primal_bound) == ("optimal", 8.0)
    assert solution.dual_bound == 8.0
    again = ct.solve(EXAMPLE, DynamicProgramming(), seed=4)
    assert again.plan == solution.plan


@pytest.mark.parametrize(
    ("model", "value"),
    [
        (GuidedPathTour(np.arange(301.0), chains=[range(1, 301)]), 600.0),
        (GuidedPathTour(np.arange(301.0), chains=[range(300, 0, -1)]), 600.0),
        # Each step crosses from one side to the other: 0, 1, -1, 2, -2, …
        (GuidedPathTour([0, 1, -1, 2, -2, 3, -3], chains=[range(1, 7)]), 24.0),
        (GuidedPathTour(np.arange(101) - 50.0, chains=[[k] for k in range(1, 101)]), 200.0),
        (GuidedPathTour(np.zeros(101), chains=[range(100, 0, -1)]), 0.0),
        (GuidedPathTour(np.full(6, 1e9), precedence=[[5, 1], [3, 2]]), 0.0),
        (GuidedPathTour([0, 1e9, 1.0, 1e9], chains=[[1, 2, 3]]), 4e9 - 2),
        (GuidedPathTour([0, 1e-6, 1.0, 1e-6], chains=[[2, 1], [3]]), 2.0),
        (GuidedPathTour([5.0, -3.0]), 16.0),
    ],
)
def test_tours_known_by_hand(model, value):
    for passing in (True, False):
        assert solved(model, passing=passing).primal_bound == pytest.approx(value, abs=close(model))


@pytest.mark.parametrize("far", [0, -1000, 10**9])
def test_a_shift_changes_nothing(far):
    plain = solved(chains_tour(5, 5, 1), passing=False)
    assert solved(chains_tour(5, 5, 1, far=far)).primal_bound == plain.primal_bound


def test_a_mirror_and_another_direction_change_nothing():
    model = chains_tour(6, 5, 2)
    value = solved(model).primal_bound
    assert solved(GuidedPathTour(-model.coordinates, chains=model.chains)).primal_bound == value
    back = [chain[::-1] for chain in model.chains]
    assert solved(GuidedPathTour(model.coordinates, chains=back)).primal_bound == value


# -- the table -----------------------------------------------------------------------------------


def entries(model):
    """Return the finite entries of the table, by the set served and the last customer."""
    table = Table.of(model)
    values = table.filled(GO)
    found = {}
    for counts in itertools.product(*(range(len(chain) + 1) for chain in table.chains)):
        state = int(np.dot(counts, table.strides))
        done = frozenset(
            c for chain, k in zip(table.chains, counts, strict=True) for c in chain[:k]
        )
        for t, count in enumerate(counts):
            if np.isfinite(values[state, t]):
                found[done, table.chains[t][count - 1]] = values[state, t]
    return found


def test_the_table_of_the_example():
    found = entries(EXAMPLE)
    assert found == prefix_lengths(EXAMPLE)
    # Example 5 of the paper, eq. 14 to 24: customers served, last one, f*.
    printed = {
        (4, 4): 4, (3, 3): 3, (42, 2): 6, (34, 3): 5, (34, 4): 4, (31, 1): 5, (342, 3): 7, (342, 2): 6,
        (314, 1): 7, (314, 4): 8, (3142, 1): 7, (3142, 2): 8,
    }  # fmt: skip
    assert found == {
        (frozenset(map(int, str(served_))), last): value
        for (served_, last), value in printed.items()
    }


def test_tables_equal_enumeration():
    for seed in range(150):
        model = random_tour([seed, 1], most=5)
        found, wanted = entries(model), prefix_lengths(model)
        assert found.keys() == wanted.keys()
        for key, value in wanted.items():
            assert abs(found[key] - value) <= close(model)


def test_compiled_and_interpreted_tables_are_the_same():
    for seed in range(20):
        table = Table.of(random_tour([seed, 2], most=7))
        data = (table.start, table.places, table.starts, table.strides)
        shape = table.states, len(table.chains)
        one, other = np.empty(shape), np.empty(shape)
        assert table_kernels.fill_table.dispatcher(*data, table.need, one, GO)
        assert table_kernels.fill_table.py_func(*data, table.need, other, GO)
        assert np.array_equal(one, other)
        orders = np.zeros((2, len(table.places)), np.int64)
        found = (
            table_kernels.trace_table.dispatcher(*data, one, orders[0]),
            table_kernels.trace_table.py_func(*data, one, orders[1]),
        )
        assert found[0] == found[1]
        assert np.array_equal(orders[0], orders[1])


def test_sizes_are_the_papers():
    statistics = solved(chains_tour(5, 5, 1), passing=False).statistics
    assert (statistics["states"], statistics["table entries"]) == (6**5, 5 * 6**5)
    assert statistics["customers left out"] == 0
    assert solved(chains_tour(5, 5, 1)).statistics["states"] <= 6**5


def test_tables_that_are_too_large():
    model = chains_tour(10, 5, 1)
    backend = DynamicProgramming()
    assert not backend.refuses(model)
    with pytest.raises(UnsupportedFormulation, match=r"100,000,000 entries, .* 6.05e\+08 for 10"):
        ct.solve(model, backend, backend_options={"passing": False})
    large = chains_tour(1000, 5, 1)
    assert "chains that matter" in backend.refuses(large)
    with pytest.raises(UnsupportedFormulation, match="chains that matter"):
        ct.solve(large, backend)


def test_a_run_that_is_stopped():
    request = Request(options={"passing": False})
    request.control.stop(Limit.TIME)
    answer = DynamicProgramming().run(EXAMPLE, request)
    assert (answer.termination, answer.limit) == ("feasible", "time")
    assert EXAMPLE.verify(answer.point).ok
    assert answer.dual_bound is None


# -- customers that decide nothing ---------------------------------------------------------------


@given(tours())
@settings(max_examples=80, deadline=None)
def test_omitted_customers_are_served_in_passing(model):
    value = best(model)
    for passing in (True, False):
        small, numbers = reduced(model, passing=passing)
        assert numbers == (0, *sorted(set(numbers[1:])))
        assert np.array_equal(small.coordinates, model.coordinates[list(numbers)])
        inner = model.closure[np.ix_(numbers, numbers)]
        assert np.array_equal(small.closure, inner)
        assert len(small.pairs) <= len(model.pairs)
        orders = extensions(small)
        ways = lengths(small.coordinates, orders)
        assert abs(ways.min() - value) <= close(model)
        order = served(model, [numbers[c] for c in orders[ways.argmin()]])
        assert abs(length_of(model, order) - value) <= close(model)


@pytest.mark.parametrize(
    ("places", "kept"),
    [
        ([0, 5, -3, 2, -1], {1, 2}),
        ([0, 5, 5, 3], {1}),
        ([0, -2, -2, -2], {1}),
        ([0, 1, 2, 3], {3}),
        ([2, 5, 5, -7, -7], {1, 3}),
        ([0, 0, 0], {2}),
    ],
)
def test_property_1(places, kept):
    for passing in (True, False):
        assert set(reduced(GuidedPathTour(places), passing=passing)[1]) - {0} == kept


def test_property_1_beside_chains():
    """Customers without a relation matter only outside the range of the others."""
    model = GuidedPathTour([0, 9, -4, -2, 10, 8, -4, -5, -6], chains=[[1, 2, 3]])
    assert reduced(model, passing=False)[1] == (0, 1, 2, 3, 4, 8)
    assert reduced(model)[1] == (0, 1, 2, 4, 8)


def test_chains_omit_customers_on_the_way():
    places = [0, 1, 5, 9, 4, 2, 2, 7]
    small, numbers = reduced(GuidedPathTour(places, chains=[range(1, 8)]))
    assert [places[c] for c in numbers] == [0, 9, 2, 7]
    assert small.pairs == ((1, 2), (2, 3))
    up = GuidedPathTour(np.arange(301.0), chains=[range(1, 301)])
    assert reduced(up)[1] == (0, 300)
    assert reduced(up, passing=False)[0].size == 301


def test_chains_keep_where_they_turn():
    model = chains_tour(20, 20, 1)
    ways = [model.coordinates[[0, *chain, 0]] for chain in model.chains]
    steps = [np.sign(np.diff(way[np.r_[True, np.diff(way) != 0]])) for way in ways]
    turns = [int((np.diff(one) != 0).sum()) for one in steps]
    small, _ = reduced(model)
    assert sorted(map(len, small.cover)) == sorted(turns)
    assert small.size - 1 == sum(turns) < 0.7 * 400


# -- walks ---------------------------------------------------------------------------------------


def walked(model, stops):
    """Return the order of service by stepping over every place; None if it is incomplete."""
    x, line = model.coordinates.tolist(), np.unique(model.coordinates).tolist()
    order, at = [], x[0]
    for stop in (0, *stops, 0):
        there = x[stop]
        way = [p for p in line if min(at, there) <= p <= max(at, there)]
        for place in way if there >= at else way[::-1]:
            while True:
                open_ = [
                    c
                    for c in range(1, model.size)
                    if x[c] == place
                    and c not in order
                    and all(a in order for a, b in model.pairs if b == c)
                ]
                if not open_:
                    break
                order.append(open_[0])
        at = there
    return tuple(order) if len(order) == model.size - 1 else None


def test_walks_equal_plain_walking():
    refused = 0
    for seed in range(400):
        model = random_tour([seed, 3], most=8)
        rng = np.random.default_rng(seed)
        stops = rng.integers(0, model.size, rng.integers(0, 9)).tolist()
        order = walked(model, stops)
        if order is None:
            refused += 1
            with pytest.raises(InvalidData, match="stops must lead past customer"):
                served(model, stops)
            continue
        assert served(model, stops) == order
        model.verify(model.as_plan({"order": order}))
        assert length_of(model, order) <= length_of(model, stops) + close(model)
    assert 100 < refused < 300


def test_ties_are_served_by_number():
    still = GuidedPathTour(np.zeros(6), precedence=[[5, 1], [4, 2]])
    assert served(still, []) == (3, 4, 2, 5, 1)
    assert served(GuidedPathTour([0, 2, 2, 1, 1]), [1]) == (3, 4, 1, 2)
    assert served(GuidedPathTour([0, -2, -2, -1]), [2]) == (3, 1, 2)


def test_any_order_that_keeps_the_relation_serves_all():
    for seed in range(100):
        model = random_tour([seed, 4])
        for order in extensions(model)[:20]:
            again = served(model, order)
            assert model.verify(model.as_plan({"order": again})).ok
            assert length_of(model, again) <= length_of(model, order) + close(model)


def test_kinds_of_coordinates_match_their_names():
    rng = np.random.default_rng(1)
    assert np.ptp(np.log10(np.abs(coordinates(rng, "ratios", 400)))) == pytest.approx(6.0)
    assert np.unique(coordinates(rng, "ties", 400)).size == 4
    assert coordinates(rng, "far", 4).min() > 9e8
    assert np.ptp(coordinates(rng, "nowhere", 4)) == 0
