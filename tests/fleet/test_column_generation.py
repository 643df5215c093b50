"""Column generation: optima and bounds against enumeration, and the reduced costs of its pricing."""

import itertools
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from fleet.enumerated import best, random_fleet, sweep
from fleet.rich_oracle import enumerate_best
from fleet.rich_random import scaled, supported

import crosstrack as ct
from crosstrack import jit
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances import entry
from crosstrack.instances.fleet import read_vrplib
from crosstrack.models import FleetRouting
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend, rivals
from crosstrack.solvers.fleet import column_generation, route_tree
from crosstrack.solvers.fleet.route_kernels import CUTS
from crosstrack.solvers.fleet.route_master import Master, visits_twice
from crosstrack.solvers.fleet.route_pricing import TIERS, Network, Prices, Pricing, kinds_of
from crosstrack.solvers.fleet.route_start import insert_nodes
from crosstrack.solvers.fleet.route_tree import Node, Tree
from crosstrack.timing import OutOfTime

#: Number of the exact search, after the heuristic ones.
EXACT = len(TIERS)
FILES = Path(__file__).parents[3] / "shared" / "data" / "fleet-vrplib" / "CVRP"


@pytest.fixture
def in_this_process():
    """Skip a test that replaces parts of the backend if it would run in another process."""
    if any(module in sys.modules for module in rivals(find_backend("column-generation"))):
        pytest.skip(
            "a library is loaded that clashes with HiGHS, so the backend runs in another process"
        )


needs_files = pytest.mark.skipif(
    not FILES.exists(),
    reason="the public instances lie in ../shared/data/fleet-vrplib, which is absent",
)


def solved(model, seconds=120.0, **options):
    """Return the answer of the backend, called directly."""
    backend = column_generation.ColumnGeneration()
    request = Request(time_limit=seconds, seed=1, options=backend.checked_options(options))
    request.control.arm(seconds)
    try:
        return backend.run(model, request)
    finally:
        request.control.disarm()


def settled(model, answer, value):
    """Assert that an answer is the enumerated optimum, and its bound not above it."""
    if value == np.inf:
        assert answer.termination == "infeasible", (model.name, answer)
        return
    scale = max(abs(value), float(model.distances.max()))
    assert answer.termination == "optimal", (model.name, answer)
    assert answer.primal_bound == pytest.approx(value, rel=0, abs=2e-6 * scale)
    assert answer.dual_bound <= value + 1e-12 * scale
    assert model.verify(answer.point).ok


@pytest.mark.parametrize("block", sweep(1, 10))
@pytest.mark.parametrize("start", [True, False])
def test_equals_enumeration(block, start, monkeypatch, in_this_process):
    """Without the heuristic and its bounds, the routes and the proof come from column generation alone."""
    if not start:
        monkeypatch.setattr(column_generation._Search, "_start", lambda self: None)
    for seed in range(2000 + 10 * block, 2010 + 10 * block):
        model = replace(
            random_fleet(seed), objective="sum" if seed % 2 else "max", q=0.0, budget=None,
            deviation_limit=None, range_limit=None,
        )  # fmt: skip
        settled(model, solved(model), best(model)[0])


def rich_fleets(seeds):
    """Yield random rich fleets of many scales; in each fifth one every vehicle is used."""
    options = {"features": column_generation.ColumnGeneration.rich}
    for number, model in enumerate(supported("column-generation", seeds, **options)):
        use_all = number % 5 == 0 and model.vehicles <= model.customers.size
        yield replace(scaled(model, 10.0 ** (number % 6 - 2)), use_all=use_all)


@pytest.mark.parametrize("block", sweep(1, 110))
def test_rich_fleets_equal_enumeration(block):
    for model in rich_fleets(range(20 * block, 20 * block + 20)):
        settled(model, solved(model), enumerate_best(model)[0])


@pytest.mark.parametrize("scale", [1e-6, 1e7])
@pytest.mark.parametrize("objective", ["sum", "max"])
def test_equals_subset_dp(objective, scale):
    rng = np.random.default_rng(7)
    model = FleetRouting(
        3, points=scale * rng.random((11, 2)), objective=objective, demands=rng.integers(1, 5, 11),
        capacity=[12, 12, 9], battery=3.2 * scale,
    )  # fmt: skip
    settled(model, solved(model), ct.solve(model, "subset-dp").primal_bound)


def test_proves_the_optimum_of_a_rich_fleet_of_the_catalogue():
    model = ct.load("fleet/windows-7")
    settled(model, solved(model), entry("fleet/windows-7").published["optimum"])


def test_several_depots_and_asymmetric_costs_equal_the_program():
    rng = np.random.default_rng(1)
    costs = rng.uniform(1, 9, (9, 9)) * (1 - np.eye(9))
    model = FleetRouting(3, costs=costs, depots=[0, 0, 1], objective="sum", use_all=False,
                         demands=np.ones(9), capacity=[3, 3, 4])  # fmt: skip
    program = ct.solve(model, "highs", formulation="three-index", gap=1e-9)
    settled(model, solved(model), program.primal_bound)


# -- pricing ---------------------------------------------------------------------------------------


def priced(model, prices, near=None, tier=EXACT, longest=np.inf):
    """Return the network, and the result of the pricing of the first kind."""
    network = Network(model, kinds_of(model))
    if near is not None:
        network.near[:] = near
    pricing = Pricing(network, np.zeros(1, np.int8))
    return network, pricing.best(0, prices, network.barred[0], longest, 1e3, tier)


@pytest.mark.parametrize("seed", range(6))
def test_pricing_equals_enumeration(seed):
    """Least reduced cost with a subset-row cut: exact with full ng-sets, and never above the optimum."""
    rng = np.random.default_rng(seed)
    n, members = 5, (0, 2, 3)
    costs = rng.uniform(1, 3, (n + 1, n + 1)) * (1 - np.eye(n + 1))
    if seed % 2:
        costs = costs + costs.T
    model = FleetRouting(2, costs=costs, objective="sum", demands=[0, 1, 2, 1, 3, 2], capacity=7)
    memory = np.isin(np.arange(n), [*members, 4])
    prices = Prices(rng.uniform(0, 5, n), np.zeros((n + 1, n + 1)), np.zeros(n, np.uint64),
                    memory.astype(np.uint64))  # fmt: skip
    prices.members[list(members)] = 1
    prices.penalty[0] = 1.5
    network, result = priced(model, prices, near=True)
    cheapest = np.full((n + 1, n + 1), np.inf)
    for count in range(1, n + 1):
        for route in itertools.permutations(range(n), count):
            if model.demands[[node + 1 for node in route]].sum() <= 7:
                tails, heads = [n, *route], [*route, n]
                total = network.costs[0, tails, heads].sum()
                total -= prices.nodes[list(route)].sum()
                total += 1.5 * visits_twice(route, members, memory)
                cheapest[tails, heads] = np.minimum(cheapest[tails, heads], total)
    least = cheapest.min()
    assert result[0] == pytest.approx(least, abs=1e-12)
    assert priced(model, prices, near=np.eye(n, dtype=bool))[1][0] <= result[0] + 1e-12
    for tier in range(EXACT):
        assert priced(model, prices, near=True, tier=tier)[1][0] >= result[0] - 1e-12
    assert prices.penalty.size == CUTS
    network.near[:] = True
    pricing = Pricing(network, np.zeros(1, np.int8))
    excluded = 0
    for most in least + np.array([0.1, 0.5, 1.0, 2.0, 4.0]):
        useful = pricing.useful(0, prices, network.barred[0], np.inf, most)
        assert useful[cheapest < most - 1e-9].all()
        excluded += (~useful & (cheapest < np.inf)).sum()
    assert excluded > 10


def test_kernels_equal_their_plain_python_version(monkeypatch):
    rng = np.random.default_rng(2)
    model = FleetRouting(
        2, points=rng.random((9, 2)), objective="sum", demands=rng.integers(1, 4, 9), capacity=9,
    )  # fmt: skip
    members = np.array([1, 0, 1, 1, 0, 0, 0, 0], np.uint64)
    prices = Prices(rng.uniform(0, 1, 8), np.zeros((9, 9)), members, np.ones(8, np.uint64))
    prices.penalty[0] = 0.2
    network = Network(model, kinds_of(model))
    pricing = Pricing(network, np.zeros(1, np.int8))

    def results():
        useful = pricing.useful(0, prices, network.barred[0], np.inf, -0.5)
        return [priced(model, prices, tier=tier)[1] for tier in range(EXACT + 1)], useful.tolist()

    compiled = results()
    monkeypatch.setattr(jit._here, "deadline", 1e9)  # every kernel is interpreted
    assert results() == compiled
    useful = np.array(compiled[1])
    assert useful.any() and not useful[~np.eye(9, dtype=bool)].all()


def test_the_arcs_of_a_route_and_of_its_reverse_stay_together():
    """Their reduced costs may differ by rounding, but a branch without one of them has asymmetric costs."""
    rng = np.random.default_rng(0)
    n = 5
    model = FleetRouting(
        2, points=rng.random((n + 1, 2)), demands=np.ones(n + 1), capacity=3, objective="sum"
    )
    network = Network(model, kinds_of(model))
    pricing = Pricing(network, np.zeros(1, np.int8))
    words = np.zeros(n, np.uint64)
    for _ in range(4):
        prices = Prices(rng.uniform(0, 1, n), np.zeros((n + 1, n + 1)), words, words)
        half = 0.5 * np.append(prices.nodes, 0.0)
        costs = network.costs[0] - half[:, None] - half
        for i, j, k in itertools.permutations(range(n), 3):
            ahead = costs[n, i] + costs[i, j] + costs[j, k] + costs[k, n]
            behind = costs[n, k] + costs[k, j] + costs[j, i] + costs[i, n]
            joined = costs[n, i] + costs[i, j] + (costs[n, k] + costs[k, j])
            useful = pricing.useful(
                0, prices, network.barred[0], np.inf, max(ahead, behind, joined)
            )
            assert (useful == useful.T).all()


def test_length_limit_is_respected_by_the_pricing():
    model = FleetRouting(1, points=[[0, 0], [3, 0], [0, 4], [3, 4]], objective="sum")
    prices = Prices(np.full(3, 10.0), np.zeros((4, 4)), *np.zeros((2, 3), np.uint64))
    for longest, size in ((5.9, 0), (6.0, 1), (8.0, 1), (12.0, 2), (13.0, 2), (14.0, 3)):
        _, (_, routes) = priced(model, prices, near=True, longest=longest)
        assert max((len(route) for route in routes), default=0) == size


# -- contract --------------------------------------------------------------------------------------


@needs_files
@pytest.mark.parametrize(
    ("name", "vehicles", "known"),
    [
        pytest.param("X-n101-k25", 26, 27591, marks=pytest.mark.slow),
        ("X-n110-k13", 13, 14971),
    ],
)
def test_bounds_of_public_files_are_below_the_best_known(name, vehicles, known):
    model = read_vrplib(FILES / f"{name}.vrp", vehicles, rounded=True, use_all=False)
    answer = solved(model, 0.5)
    assert answer.dual_bound <= known
    assert answer.primal_bound is None or answer.primal_bound >= known


def test_reports_incumbents_and_bounds():
    points = np.random.default_rng(0).random((14, 2))
    model = FleetRouting(4, points=points, objective="max")
    bounds, plans = [], []

    def listen(event):
        bounds.extend([event.bound] if event.kind == "bound" else [])
        plans.extend([event.incumbent.objective] if event.kind == "incumbent" else [])

    result = ct.solve(model, "column-generation", time_limit=2, seed=1, on_event=listen)
    assert bounds == sorted(bounds) and plans == sorted(plans, reverse=True)
    assert max(bounds) <= min(plans)
    assert result.dual_bound == pytest.approx(max(bounds))
    assert result.verification.ok


def test_auto_prefers_other_backends():
    model = FleetRouting(3, points=np.random.default_rng(0).random((30, 2)), objective="max")
    assert ct.solve(model, time_limit=0.2).backend != "column-generation"


def test_stops_at_once_and_keeps_the_warm_start():
    points = np.random.default_rng(0).random((60, 2))
    model = FleetRouting(3, points=points, objective="max")
    steps = {"steps": 500, "bound": False}
    warm = ct.solve(model, "fleet-search", backend_options=steps, seed=2).plan
    result = ct.solve(model, "column-generation", time_limit=0.3, warm_start=warm)
    assert result.primal_bound <= model.verify(warm).objective
    assert result.dual_bound <= result.primal_bound


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"objective": "range"}, "the objective 'range'"),
        ({"objective": "sum", "budget": 9.0}, "the limit budget"),
        ({"objective": "max", "deviation_limit": 1.0}, "the limit deviation_limit"),
        ({"objective": "sum", "windows": [None, [(0, 1), (2, 3)], None]}, "several windows"),
        ({"objective": "makespan"}, "makespan"),
        ({"objective": "sum", "releases": [0, 1, 1]}, "releases"),
        (
            {"points": np.eye(260, 2), "vehicles": 70, "speed": np.arange(1, 71)},
            "arcs of all kinds",
        ),
    ],
)
def test_refuses_by_name(fields, text):
    model = FleetRouting(**{"vehicles": 1, "points": [[0, 0], [1, 0], [2, 0]], **fields})
    with pytest.raises(UnsupportedFormulation, match=text):
        ct.solve(model, "column-generation")


def test_a_fleet_that_is_too_small_is_infeasible():
    points = [[0, 0], [1, 0], [2, 0], [0, 2]]
    for objective in ("sum", "max"):
        model = FleetRouting(
            2, points=points, objective=objective, demands=[0, 2, 2, 2], capacity=3
        )
        assert solved(model).termination == "infeasible"


# -- bound -----------------------------------------------------------------------------------------


def exact_and_computed(seed):
    """Return the Lagrangian bound at random prices in rational numbers, and the computed one."""
    rng = np.random.default_rng(seed)
    n, members, size = 5, (0, 2, 3), 10.0 ** rng.uniform(-3, 6)
    costs = rng.uniform(0.1, 3, (n + 1, n + 1)) * (1 - np.eye(n + 1))
    if seed % 2:
        costs = costs + costs.T
    demands = np.array([0, 1, 2, 1, 3, 2])
    model = FleetRouting(
        3, costs=costs, objective="sum", demands=demands, capacity=[5, 7, 7], use_all=False
    )
    network = Network(model, kinds_of(model))
    network.near[:] = True
    counts = tuple((float(rng.integers(2)), float(len(kind.vehicles))) for kind in network.kinds)
    master = Master(network, False, np.array(counts), 2.0, np.full(n, np.inf))
    tree = Tree(network, master, Request(), True)
    cut = np.isin(np.arange(n + 1), [1, 2, 4])
    cut_arcs = 0.5 * (cut[:, None] != cut)
    row = master.add_arcs(cut_arcs, 2.0, np.inf)
    memory = np.isin(np.arange(n), [*members, 4])
    triple = master._row(-np.inf, 1.0)
    master.triples.append((triple, members, memory))
    duals = size * rng.normal(size=len(master.limits))
    duals[row], duals[triple] = abs(duals[row]), -abs(duals[triple])
    below = tree._price(Node(network.barred, frozenset(), counts), duals, EXACT)[0]

    pi = [Fraction(value) for value in duals.tolist()]
    total = sum(pi[:n]) + 2 * pi[row] + pi[triple]
    for k, (kind, (low, high)) in enumerate(zip(network.kinds, counts, strict=True)):
        least = pi[n + k]  # the count's own price is an upper limit
        for length in range(1, n + 1):
            for route in itertools.permutations(range(n), length):
                if demands[[node + 1 for node in route]].sum() > kind.capacity[0]:
                    continue
                tails, heads = [n, *route], [*route, n]
                nodes = np.append(model.customers, 0)
                reduced = sum(map(Fraction, costs[nodes[tails], nodes[heads]].tolist()))
                reduced /= Fraction(network.unit)
                reduced -= sum(pi[node] for node in route)
                reduced -= Fraction(float(cut_arcs[tails, heads].sum())) * pi[row]
                reduced -= visits_twice(route, members, memory) * pi[triple]
                least = min(least, reduced)
        total += least * int(low if least > 0 else high)
    return total, below, size


@pytest.mark.parametrize("seed", range(12))
def test_bound_is_not_above_its_value_in_rational_numbers(seed):
    exact, below, size = exact_and_computed(seed)
    assert Fraction(below) <= exact
    assert below == pytest.approx(float(exact), rel=0, abs=1e-11 * max(size, 1.0))


def test_bound_without_its_margin_would_be_above(monkeypatch, in_this_process):
    monkeypatch.setattr(route_tree, "EPSILON", 0.0)
    results = [exact_and_computed(seed) for seed in range(12)]
    assert any(Fraction(below) > exact for exact, below, _ in results)


def test_large_whole_numbers_equal_subset_dp():
    rng = np.random.default_rng(0)
    costs = rng.integers(1, 2**35, (7, 7)) * (1 - np.eye(7))
    model = FleetRouting(2, costs=costs, objective="sum", demands=np.ones(7), capacity=4)
    settled(model, solved(model), ct.solve(model, "subset-dp").primal_bound)


def test_an_edge_with_a_flow_above_one_is_no_branch():
    """A cycle of two nodes with half a route: requiring its edge would not exclude it."""
    model = FleetRouting(
        2, points=[[0, 0], [1, 0], [1, 0.1], [5, 5]], objective="sum", use_all=False
    )
    network = Network(model, kinds_of(model))
    network.near[:] = np.eye(3, dtype=bool)
    master = Master(network, False, np.array([(0.0, 2.0)]), 2.0, np.full(3, np.inf))
    for route in ((0, 1, 0, 1), (2,)):
        master.add(0, route)
    tree = Tree(network, master, Request(), True)
    node = Node(network.barred, frozenset(), ((0.0, 2.0),))
    assert tree.children(node, np.array([0.5, 1.0]))[0].counts == ((0.0, 1.0),)
    assert tree.remember(np.array([0.5, 1.0]))
    assert network.near[0, 1]


def test_subset_row_cuts_of_three_half_routes_and_a_stop():
    points = [[0, 0], [1, 0], [0, 1], [1, 1]]
    model = FleetRouting(3, points=points, objective="sum", use_all=False)
    network = Network(model, kinds_of(model))
    master = Master(network, False, np.array([(0.0, 3.0)]), 2.0, np.full(3, np.inf))
    for route in ((0, 1), (1, 2), (0, 2)):
        master.add(0, route)
    assert master.cut_triples(np.full(3, 0.5), lambda: True) == 0
    assert master.cut_triples(np.full(3, 0.5), lambda: False) == 1
    lacking = master.solve(None)[3]
    assert lacking == pytest.approx(1.0)  # one route of two nodes remains


# -- first plans -----------------------------------------------------------------------------------


def timed_fleet():
    """Return 15 nodes with windows and capacities."""
    rng = np.random.default_rng(5)
    begins = rng.uniform(0, 30, 16)
    windows = [None, *((a, a + 15.0) for a in begins[1:])]
    return FleetRouting(
        6, points=10 * rng.random((16, 2)), objective="sum", windows=windows, service=np.ones(16),
        demands=rng.integers(1, 4, 16), capacity=9,
    )  # fmt: skip


def test_insertion_gives_a_first_plan_without_other_packages(monkeypatch, in_this_process):
    monkeypatch.setattr(column_generation.PyVrpRouting, "missing", lambda self: ("pyvrp",))
    model = timed_fleet()
    network = Network(model, kinds_of(model))
    routes = insert_nodes(network, np.full(15, np.inf), True, lambda: False)
    stops = [[int(model.customers[node]) for node in route] for _, route in routes]
    assert model.verify(model.with_schedule(stops)).ok
    assert insert_nodes(network, np.full(15, np.inf), True, lambda: True) == []
    answer = solved(model, 10.0, branch=False)
    assert answer.primal_bound <= model.verify(model.with_schedule(stops)).objective


def test_insertion_skips_prizes_below_the_detour():
    model = FleetRouting(1, points=[[0, 0], [1, 0], [9, 0]], objective="cost", prizes=[None, 3, 3])
    network = Network(model, kinds_of(model))
    routes = insert_nodes(network, np.array([3.0, 3.0]) / network.unit, True, lambda: False)
    assert routes == [(0, (0,))]


def test_starts_by_insertion_if_the_search_does_not_compile_in_time(monkeypatch, in_this_process):
    def is_late(*_):
        raise OutOfTime

    def stop(*_):
        raise route_tree.Stopped

    monkeypatch.setattr(column_generation.FleetSearch, "run", is_late)
    monkeypatch.setattr(column_generation._Search, "_root", stop)
    model = FleetRouting(
        3, points=np.random.default_rng(0).random((16, 2)), objective="sum", demands=[0] + [1] * 15,
        capacity=6,
    )  # fmt: skip
    answer = ct.solve(model, "column-generation", time_limit=20.0)
    assert (answer.termination, answer.verification.ok) == ("feasible", True)


@pytest.mark.parametrize(("limit", "least"), [(1.0, 0.4), (4.0, 1.0), (30.0, 2.9)])
def test_the_first_search_has_one_second_of_a_short_limit(
    limit, least, monkeypatch, in_this_process
):
    """A tenth of 1 s gave a longest route of 238.7 instead of 220.8."""
    pytest.importorskip(
        "pyvrp", reason="the first search of the backend needs PyVRP, which is an extra"
    )
    granted = []

    def record(self, problem, request):
        granted.append(request.time_limit)
        raise OutOfTime

    def stop(*_):
        raise route_tree.Stopped

    monkeypatch.setattr(column_generation.PyVrpRouting, "run", record)
    monkeypatch.setattr(column_generation._Search, "_root", stop)
    solved(timed_fleet(), limit)
    assert least <= granted[0] <= least + 0.2


def test_bounds_the_longest_route_of_one_vehicle_like_the_sum(in_this_process):
    """Bisection to a length without a feasible relaxation gave a lower bound."""
    rng = np.random.default_rng(15)
    points, begins = 100 * rng.random((13, 2)), 200 * rng.random(12)
    windows = [None, *((a, a + 300.0) for a in begins)]
    longest, total = (
        solved(
            FleetRouting(1, points=points, objective=objective, windows=windows), branch=False
        ).dual_bound
        for objective in ("max", "sum")
    )
    assert longest == pytest.approx(total, rel=1e-9)
