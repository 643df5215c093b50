"""Lower bounds on routes: never above the optimum by enumeration, and close to known optima."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fleet.enumerated import best, random_fleet, sweep
from scipy.sparse import csgraph, csr_array

from crosstrack.instances.fleet import read_tsplib
from crosstrack.models import FleetRouting
from crosstrack.solvers.fleet import bound
from crosstrack.solvers.fleet.bound import _paths, _Proof, _spread, lower_bound, spanning_tree

GO = np.zeros(1, np.int8)
DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "tsplib"
public = pytest.mark.skipif(
    not DATA.exists(), reason="the public instances lie in ../shared/data/tsplib, which is absent"
)


def wild(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return costs: random, with ties and zeros, of ratios 1e12, symmetric or not, twins, one far."""
    kind = rng.integers(0, 8)
    if kind < 3:
        costs = [
            rng.random((n, n)),
            rng.integers(0, 3, (n, n)).astype(float),
            10.0 ** rng.integers(-6, 7, (n, n)),
        ][kind]
    elif kind < 5:
        costs = [rng.random((n, n)), rng.integers(0, 2, (n, n)).astype(float)][kind - 3]
        costs = np.maximum(costs, costs.T)
    else:
        points = rng.random((n, 2))
        if kind == 5:
            points = np.round(2 * points)
        if kind == 6:
            points[-1] *= 1e6
        costs = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(costs, 0.0)
    scale: float = rng.choice([1.0, 1.0, 1e6, 1e-290, 1e280])
    return costs * scale


def fleet(seed: int) -> FleetRouting:
    """Return a fleet of 1 to 6 nodes and 1 to 4 vehicles, from up to 4 depots."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 7)), int(rng.integers(1, 5))
    homes = int(rng.integers(1, m + 1)) if rng.random() < 0.35 else 1
    more: dict[str, Any] = {"objective": ("sum", "max", "max-sum", "sum-deviation")[seed % 4]}
    if homes > 1:
        more["depots"] = np.append(np.arange(homes), rng.integers(0, homes, m - homes))
    if rng.random() < 0.2:
        demands = rng.integers(0, 5, n + homes).astype(float)
        more |= {"demands": demands, "capacity": demands.sum() / m + rng.integers(0, 4, m)}
    use_all = bool(rng.random() < 0.6) and m <= n
    return FleetRouting(m, costs=wild(rng, n + homes), use_all=use_all, **more)


def shares(model: FleetRouting) -> tuple[np.ndarray, np.ndarray]:
    """Return who visits each node, for all ways to share them out, and the shortest routes then."""
    d, nodes, m = model.distances, model.customers.tolist(), model.vehicles
    groups = [
        [node for k, node in enumerate(nodes) if chosen >> k & 1]
        for chosen in range(2 ** len(nodes))
    ]
    tours = {
        home: np.array(
            [
                min(
                    math.fsum(d[a, b] for a, b in itertools.pairwise((home, *order, home)))
                    for order in itertools.permutations(group)
                )
                for group in groups
            ]
        )
        for home in set(model.homes.tolist())
    }
    owners = np.array(list(itertools.product(range(m), repeat=len(nodes))))
    sets = [((owners == k) << np.arange(len(nodes))).sum(axis=1) for k in range(m)]
    loads = np.array([tours[int(home)][s] for home, s in zip(model.homes, sets, strict=True)]).T
    fits = (
        np.array([s > 0 for s in sets]).all(axis=0) if model.use_all else np.full(len(owners), True)
    )
    if model.capacity is not None:
        assert model.demands is not None
        carried = np.array([model.demands[group].sum() for group in groups])
        for s, most in zip(sets, model.capacity, strict=True):
            fits &= carried[s] <= most
    return owners[fits], loads[fits]


def optimum(model: FleetRouting) -> float:
    """Return the least objective, infinite without a plan; weights of deviations are 0 here."""
    loads = shares(model)[1]
    most, total = loads.max(axis=1, initial=0.0), loads.sum(axis=1)
    values = {"max": most, "max-sum": most + 1e-6 * total}.get(str(model.objective), total)
    return float(values.min(initial=np.inf))


@pytest.mark.parametrize("part", sweep(1, 8))
def test_no_bound_is_above_the_optimum(part: int) -> None:
    near = []
    for seed in range(part, 280, 8):
        model = fleet(seed)
        bound, least = lower_bound(model, GO), optimum(model)
        assert 0.0 <= bound <= least, seed
        if model.capacity is None and math.isfinite(least):
            near.append(bound / least if least else 1.0)
    assert np.mean(near) > 0.85


@pytest.mark.parametrize("part", sweep(2, 4))
def test_nor_is_one_of_any_other_objective_or_limit(part: int) -> None:
    counted = 0
    for seed in range(part, 80, 4):
        model = random_fleet(seed)
        if model.vehicles ** len(model.customers) > 30:
            continue
        least, _ = best(model)
        if least is not None:
            assert lower_bound(model, GO) <= least, seed
            counted += 1
    assert counted > 3


@pytest.mark.parametrize("seed", range(12))
def test_prices_bound_routes_of_which_some_nodes_share_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = 6, int(rng.integers(2, 4))
    model = FleetRouting(m, costs=wild(rng, n + 1), objective="sum", use_all=bool(seed % 2))
    unit = float(model.distances.max())
    owners, loads = shares(model)
    for count in range(1, m + 1):
        nodes = rng.permutation(n)[:count].tolist()
        apart = [len(set(row)) == count for row in owners[:, nodes].tolist()]
        total, most = loads[apart].sum(axis=1), loads[apart].max(axis=1)
        proof = _Proof.of(model, unit, GO)
        assert proof.prices(0.0, each=False, apart=nodes) <= total.min() / unit * (1 + 1e-12)
        assert proof.prices(0.0, each=True, apart=nodes) <= most.min() / unit * (1 + 1e-12)


@pytest.mark.parametrize("roots", [1, 2, 5])
@pytest.mark.parametrize("seed", range(4))
def test_tree_weights_equal_scipy(seed: int, roots: int) -> None:
    rng = np.random.default_rng(seed)
    n = (5, 9, 20, 30)[seed]
    costs = rng.random((n, n)) if seed % 2 else rng.integers(0, 4, (n, n)).astype(float)
    leave, enter = rng.random((2, n)) - 0.5
    tails, heads = np.empty((2, n - roots), np.int64)
    weights = np.empty(n - roots)
    spanning_tree(
        costs, np.ascontiguousarray(costs.T), leave, enter, tails, heads, weights, roots, True
    )
    arcs = costs - leave[:, None] - enter
    np.testing.assert_allclose(weights, arcs[tails, heads], rtol=0, atol=1e-12)
    # SciPy takes 0 for no edge: all weights are raised, and the roots joined by lighter edges.
    edges = np.minimum(arcs, arcs.T) + 10.0
    edges[:roots, :roots] = 1.0
    expected = (
        csgraph.minimum_spanning_tree(np.triu(edges, 1)).sum() - (roots - 1) - 10 * (n - roots)
    )
    assert weights.sum() == pytest.approx(expected, abs=1e-9)
    made = csr_array((np.ones(n - roots), (tails, heads)), (n, n))
    count, part = csgraph.connected_components(made, directed=False)
    assert count == roots == len(set(part[:roots].tolist()))


def test_sets_of_nodes_far_apart() -> None:
    rng = np.random.default_rng(3)
    points = rng.random((12, 2))
    trips = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) + 1.0
    found = _spread(trips.copy(), 5, 0.0)
    assert [len(nodes) for _, nodes in found] == [2, 3, 4, 5]
    for length, nodes in found:
        assert length == min(trips[a, b] for a, b in itertools.combinations(nodes, 2))
    assert found[0][0] == trips.max()
    enough = found[1][0]
    assert [len(nodes) for _, nodes in _spread(trips.copy(), 5, enough)] == [2]


ARMS = np.array([[0, 0], [0, 1], [3**0.5 / 2, -0.5], [-(3**0.5) / 2, -0.5]])
RING = np.array([[math.cos(t), math.sin(t)] for t in np.arange(5) * 2 * math.pi / 5])
EXACT = {
    "two of three arms share a route": (FleetRouting(2, points=ARMS), 2 + 3**0.5),
    "a node a vehicle": (FleetRouting(4, points=RING, objective="sum"), 8 * (math.sin(math.pi / 5) + math.sin(2 * math.pi / 5))),
    "one node": (FleetRouting(1, points=[[0, 0], [3, 4]]), 10.0),
    "one node of many vehicles": (
        FleetRouting(9, points=[[0, 0], [3, 4]], use_all=False, objective="sum"), 10.0,
    ),
    "all at one place": (FleetRouting(2, points=np.full((5, 2), 7.0)), 0.0),
    "a range": (FleetRouting(2, points=ARMS, objective="range"), 0.0),
    "twins far away": (FleetRouting(2, points=[[0, 0], [5, 0], [5, 0]], objective="sum"), 20.0),
    "a way around by others": (
        FleetRouting(1, costs=[[0, 1, 50], [1, 0, 0], [50, 0, 0]], objective="sum"), 51.0,
    ),
    "one way only is cheap": (
        FleetRouting(1, costs=[[0, 1, 9], [9, 0, 1], [1, 9, 0]], objective="sum"), 3.0,
    ),
    "two lorries carry what one cannot": (
        FleetRouting(
            3, points=[[0, 0], [5, 0], [5, 0]], objective="sum", use_all=False,
            demands=[0, 2, 2], capacity=3.0,
        ), 20.0,
    ),
    "one vehicle far from all": (
        FleetRouting(2, points=[[0, 0], [90, 0], [1, 0], [2, 0]], depots=[0, 1]), 176.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_bounds_that_are_optima(name: str) -> None:
    model, known = EXACT[name]
    found = lower_bound(model, GO)
    assert found <= known
    assert found == pytest.approx(known, rel=2e-9)


def test_paths_follow_the_direction_of_arcs() -> None:
    table = np.random.default_rng(3).random((12, 12))
    table[:, 0] = 0.0  # no arc leads back to the first node
    lengths = _paths(table[0, 1:], table[1:, 1:])
    assert lengths == pytest.approx(csgraph.dijkstra(table, indices=0)[1:], rel=1e-12)


@pytest.mark.parametrize("objective", ["max", "sum"])
def test_many_nodes(objective: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the nodes up to which all pairs of paths are looked at; ways back are uphill or not."""
    monkeypatch.setattr(bound, "MANY", 150)
    rng = np.random.default_rng(7)
    points = rng.random((160, 2))
    flat = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    for costs in (flat, flat + np.maximum(points[:, 1] - points[:, None, 1], 0.0)):
        model = FleetRouting(3, costs=costs, objective=objective, depots=[0, 1, 1], use_all=False)
        found = lower_bound(model, GO)
        # A strip after the other, from the first depot.
        strips = np.lexsort((points[:, 1], np.floor(10 * points[:, 0])))
        route = [0, *(int(k) for k in strips if k > 1), 0]
        total = sum(costs[a, b] for a, b in itertools.pairwise(route))
        assert found < total * (1 + 1e-6)
        trees = csgraph.minimum_spanning_tree(np.triu(flat[2:, 2:])).sum()
        assert found > 0.99 * trees / (1 if objective == "sum" else 3)


def test_a_stop_returns_the_proven_bound() -> None:
    model = FleetRouting(2, points=np.random.default_rng(0).random((30, 2)), objective="sum")
    assert lower_bound(model, np.ones(1, np.int8)) == 0.0


def test_scipy_waits_until_it_is_needed() -> None:
    """Importing the bounds takes NumPy alone."""
    code = (
        "import sys, crosstrack.solvers.fleet.bound; "
        "sys.exit(any(name.split('.')[0] in ('scipy', 'numba') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


#: Proven or best known, of real distances from city 1: the sum for one vehicle, and the longest route
#: of 2, 3, 5 and 7; and the shares of those that the bound must reach.
KNOWN = [
    ("berlin52", 1, "sum", 7544.3659, 0.9999999),
    ("berlin52", 3, "sum", 7737.0185, 0.9999),
    ("berlin52", 7, "max", 2440.9221, 0.9999999),
    ("berlin52", 3, "max", 3069.59, 0.89),
    ("eil51", 1, "sum", 428.8717, 0.985),
    ("eil51", 2, "max", 222.7334, 0.96),
    ("eil76", 5, "max", 142.88, 0.92),
    ("kroA200", 1, "sum", 29369.407, 0.985),
]


@public
@pytest.mark.parametrize(("name", "vehicles", "objective", "known", "share"), KNOWN)
def test_known_optima(name: str, vehicles: int, objective: str, known: float, share: float) -> None:
    model = read_tsplib(DATA / f"{name}.tsp", vehicles, objective=objective)
    assert share * known <= lower_bound(model, GO) <= known * (1 + 1e-7)
