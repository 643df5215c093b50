"""Exact search and program of sequential ordering, compared with enumeration; kernels, limits, seeds."""

import itertools

import numpy as np
import pytest
from sequential_ordering.enumerated import best, random_problem

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances.sequential_ordering import generate_ordering
from crosstrack.models import SequentialOrdering, SequentialOrderingPlan
from crosstrack.models.sequential_ordering.orders import OrdersFormulation
from crosstrack.solvers import Control, Limit, Request
from crosstrack.solvers.sequential_ordering import bounded_levels, exchange_kernels, level_kernels
from crosstrack.solvers.sequential_ordering.bounded_levels import BoundedLevels, _Search
from crosstrack.solvers.sequential_ordering.cut_bound import cut_bound
from crosstrack.solvers.sequential_ordering.level_kernels import new_states
from crosstrack.solvers.sequential_ordering.three_exchange import (
    ThreeExchange,
    _paths,
    costs_of,
    length_of,
    nearest_available,
)


def solved(model, backend, **options):
    """Return the answer after verifying its plan and its value."""
    answer = backend.run(model, Request(options=backend.checked_options(options)))
    if answer.point is not None:
        found = model.verify(answer.point)
        assert found.ok, found
        assert answer.primal_bound == pytest.approx(found.objective, rel=1e-12)
    return answer


def check(seed, width=0):
    model = random_problem(seed)
    least = best(model)
    answer = solved(model, BoundedLevels(), width=width)
    heuristic = solved(model, ThreeExchange(), iterations=20)
    assert heuristic.point is None or heuristic.primal_bound >= least - 1e-9 * least, seed
    if width:
        assert answer.dual_bound is None or answer.dual_bound <= least, seed
        assert answer.primal_bound is None or answer.primal_bound >= least - 1e-9 * least, seed
    elif np.isinf(least):
        assert answer.termination == "infeasible", seed
    else:
        assert answer.termination == "optimal", seed
        assert answer.primal_bound == pytest.approx(least, rel=1e-9), seed
        assert answer.dual_bound <= least * (1 + 1e-9), seed


@pytest.mark.parametrize(
    ("first", "end"),
    [
        (0, 60),
        pytest.param(60, 120, marks=pytest.mark.slow),
        *(pytest.param(k, k + 250, marks=pytest.mark.slow) for k in range(200, 1200, 250)),
    ],
)
def test_small_problems_equal_enumeration(first, end):
    for seed in range(first, end):
        check(seed)


def test_bounds_of_narrow_searches_are_sound():
    for seed in range(2000, 2060):
        check(seed, width=1 + seed % 2)


def test_searches_with_cuts_equal_enumeration(monkeypatch):
    monkeypatch.setattr(bounded_levels, "_HARD", 0)
    for seed in range(3000, 3060):
        check(seed)


def test_bounds_by_cuts_are_sound():
    """The bound is below every path that is shorter than the given length, whose arcs remain."""
    tight = 0
    for seed in range(4000, 4060):
        model = random_problem(seed)
        least = best(model)
        if np.isinf(least):
            continue
        cost, missing = costs_of(model), least * 1.5 + 1.0
        bound, arcs = cut_bound(model, cost, missing, lambda: np.inf)
        assert bound <= least + 1e-9 * missing, seed
        order = solved(model, BoundedLevels()).point.order
        assert arcs[order[:-1], order[1:]].all(), seed
        assert not arcs[cost >= missing].any()
        tight += bound >= least * (1 - 1e-6) - 1e-6
    assert tight > 30
    assert cut_bound(model, cost, missing, lambda: 0.0)[0] == 0.0


def test_the_separation_of_cuts_stops_at_the_limit(monkeypatch):
    import scipy.sparse.csgraph

    flows, flow = [], scipy.sparse.csgraph.maximum_flow
    monkeypatch.setattr(
        scipy.sparse.csgraph, "maximum_flow", lambda *data: flows.append(1) or flow(*data)
    )
    model, left = SequentialOrdering(np.ones((6, 6))), iter([99.0, 99.0, 99.0])
    cut_bound(model, costs_of(model), model.missing, lambda: next(left, 0.0))
    assert len(flows) == 2


def test_programs_equal_enumeration():
    solvable = 0
    for seed in range(24):
        model = random_problem(seed, 6)
        least = best(model)
        answer = ct.solve(model, "highs")
        if np.isinf(least):
            assert answer.termination == "infeasible", seed
        else:
            solvable += 1
            assert answer.primal_bound == pytest.approx(least, rel=1e-6, abs=1e-9), seed
    assert solvable > 12


def test_plans_encode_without_violated_rows():
    for seed in range(30):
        model = random_problem(seed)
        answer = solved(model, BoundedLevels())
        if answer.point is not None:
            form = OrdersFormulation(model)
            point = form.encode(answer.point)
            rows = form.program.matrix @ point
            assert (rows >= form.program.row_lower - 1e-9).all()
            assert (rows <= form.program.row_upper + 1e-9).all()
            assert form.decode(point) == answer.point
            assert form.program.objective(point) == pytest.approx(answer.primal_bound)
    with pytest.raises(UnsupportedFormulation, match="at most 62 nodes, got 63"):
        OrdersFormulation(generate_ordering(63, 9, 5, 0))


def test_search_and_program_agree():
    model = generate_ordering(10, 100, 30, 3)
    verdict = ct.compare(model, ["bounded-levels", "highs"], time_limit=60)
    assert verdict.outcome == "AGREED", verdict
    least = ct.solve(model).primal_bound
    assert ct.solve(model, "three-exchange").primal_bound >= least


def test_seeds_repeat_and_limits_stop():
    model = generate_ordering(25, 1000, 5, 1)
    runs = [ct.solve(model, "three-exchange", seed=seed) for seed in (1, 1, 2)]
    assert runs[0].plan == runs[1].plan
    assert runs[0].primal_bound < length_of(
        costs_of(model), nearest_available(model, costs_of(model))
    )
    control = Control()
    control.stop(Limit.INTERRUPTED)
    answer = BoundedLevels().run(
        model, Request(options=BoundedLevels().checked_options({}), control=control)
    )
    assert answer.termination == "feasible"
    assert answer.limit is Limit.INTERRUPTED
    narrow = ct.solve(model, "bounded-levels", backend_options={"width": 8})
    assert narrow.termination == "feasible"
    assert narrow.limit is Limit.ITERATIONS
    assert 0 < narrow.dual_bound < narrow.primal_bound
    loose = ct.solve(model, "bounded-levels", gap=0.99)
    assert loose.gap <= 0.99
    warm = ct.solve(
        model, "three-exchange", warm_start=narrow.plan, backend_options={"iterations": 1}
    )
    assert warm.primal_bound <= narrow.primal_bound


def test_the_local_search_keeps_the_relation_and_the_length():
    for seed in range(20):
        model = generate_ordering(30, 100, 5 * seed, seed)
        cost = costs_of(model)
        order = nearest_available(model, cost)
        state = _paths(model, cost, order)
        shortest, lengths = order.copy(), np.full(2, length_of(cost, order))
        draws = np.random.default_rng(seed).random((50, exchange_kernels.DRAWS))
        flag = np.zeros(1, np.int8)
        exchange_kernels.anneal.py_func(state, shortest, lengths, 3.0, 0.0, draws, 1e-9, True, flag)
        for path, length in ((state.path, lengths[0]), (shortest, lengths[1])):
            found = model.verify(SequentialOrderingPlan(tuple(path.tolist())))
            assert found.ok, (seed, found)
            assert found.objective == pytest.approx(length)
        assert (state.path[state.place] == np.arange(30)).all()
        assert not state.waits.any()


def test_compiled_kernels_equal_their_plain_versions():
    model = generate_ordering(12, 50, 20, 4)
    search = _Search(model, Request(options={"width": 0}))
    waits = np.ascontiguousarray(model.closure[1:].any(axis=0))
    flag, results = np.zeros(1, np.int8), []
    for plain in (True, False):
        root, children = new_states(12, 1), new_states(12, 64)
        table = np.empty(256, np.int32)
        first, second = level_kernels.assign_root, level_kernels.expand
        if plain:
            first, second = first.py_func, second.py_func
        assert first(search.cost, model.missing, waits, root, flag)
        counts = second(
            search.cost, model.missing, search.before, root, 1, children, table, model.missing, flag
        )
        results.append(
            (float(root.rest[0]), *counts, *children.rest[: counts[1]], *children.last[: counts[1]])
        )
    assert results[0] == results[1]


def test_states_have_the_least_length_of_their_nodes():
    size, flag = 6, np.zeros(1, np.int8)
    cost = np.random.default_rng(0).integers(1, 100, (size, size)).astype(float)
    search = _Search(SequentialOrdering(cost), Request(options={"width": 0}))
    level, shared = new_states(size, 1), 0
    level_kernels.assign_root(search.cost, 1e6, np.zeros(size, bool), level, flag)
    for inner in (1, 2, 3):
        children, table = new_states(size, 64), np.empty(256, np.int32)
        done, count = level_kernels.expand(
            search.cost, 1e6, search.before, level, len(level.last), children, table, np.inf, flag
        )
        assert done == len(level.last)
        level = type(level)._make(field[:count] for field in children)
        for k, last in enumerate(level.last.tolist()):
            nodes = [j for j in range(1, size) if level.sets[k, 0] >> j & 1 and j != last]
            orders = [(0, *order, last) for order in itertools.permutations(nodes)]
            assert len(nodes) == inner - 1
            assert level.length[k] == min(
                sum(cost[a, b] for a, b in itertools.pairwise(order)) for order in orders
            )
            shared += len(orders) > 1
    assert shared > 10


def test_the_assignment_bound_equals_scipy():
    from scipy.optimize import linear_sum_assignment

    for seed in range(20):
        model = generate_ordering(20, 100, 10, seed)
        search = _Search(model, Request(options={"width": 0}))
        root = new_states(20, 1)
        waits = np.ascontiguousarray(model.closure[1:].any(axis=0))
        level_kernels.assign_root(search.cost, model.missing, waits, root, np.zeros(1, np.int8))
        cost = search.cost[:-1, 1:].copy()
        cost[0, waits[1:]] = model.missing
        assert root.rest[0] == cost[linear_sum_assignment(cost)].sum()


def test_two_nodes_and_equal_distances():
    two = ct.solve(SequentialOrdering([[0, 5], [9, 0]]))
    assert (two.plan.order, two.primal_bound, two.termination) == ((0, 1), 5.0, "optimal")
    zero = ct.solve(SequentialOrdering(np.zeros((30, 30))))
    assert (zero.primal_bound, zero.termination) == (0.0, "optimal")


@pytest.mark.parametrize("forbidden", [1e9, 1e15, 1e300])
def test_long_arcs_cause_no_rounding_errors(forbidden):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        distances = np.where(rng.random((6, 6)) < 0.4, forbidden, 10.0 * rng.random((6, 6)))
        model = SequentialOrdering(distances, precedence=[[2, 1]])
        found = ct.solve(model)
        assert found.termination == "optimal", seed
        assert found.primal_bound == pytest.approx(best(model), rel=1e-9), seed
        assert ct.solve(model, "three-exchange").primal_bound < found.primal_bound * 3, seed


def test_a_run_ends_without_a_time_limit(monkeypatch):
    monkeypatch.setattr(bounded_levels, "WORK", 64 * 40**3)
    found = solved(generate_ordering(40, 1000, 5, 1), BoundedLevels())
    assert (found.termination, found.limit) == ("feasible", Limit.ITERATIONS)
    assert found.statistics["width"] == 64
    assert 0.0 < found.dual_bound < found.primal_bound


def test_a_run_that_is_out_of_time_has_a_plan():
    found = ct.solve(generate_ordering(300, 1000, 5, 1), time_limit=1e-3)
    assert found.plan is not None
    assert found.limit is Limit.TIME


def test_a_search_that_ends_with_its_time_names_the_limit():
    backend, model = ThreeExchange(), generate_ordering(200, 1000, 5, 1)
    options = backend.checked_options({"iterations": 10**9})
    answer = backend.run(model, Request(options=options, time_limit=0.15))
    assert answer.statistics["iterations"] < 10**9
    assert answer.limit is Limit.TIME
