"""The parts of the rivals beside their plain meanings: clusters, swarms, embeddings and tours."""

from __future__ import annotations

import importlib.util
import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import cdist, pdist, squareform

import crosstrack as ct
from crosstrack.errors import BackendMissing, UnsupportedOption
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.models.fleet.checks import objective_of
from crosstrack.solvers import Request
from crosstrack.solvers.fleet.array_colonies import ArrayColonies, torch_colonies
from crosstrack.solvers.fleet.rivals import Best
from crosstrack.solvers.fleet.swarm import (
    Colonies,
    assign_vehicles,
    energies,
    k_means,
    move_centres,
    positions,
    reclassify,
    swarm,
)
from crosstrack.solvers.fleet.tour_kernels import (
    _cross,
    _mark,
    _move,
    breed,
    colony,
    measure,
    nearest,
    polish,
)

GO = np.zeros(1, np.int8)
#: Colonies as loops, and as array code on NumPy and on PyTorch if it is installed.
KINDS = [Colonies, ArrayColonies]
if importlib.util.find_spec("torch") is not None:
    KINDS.append(torch_colonies("cpu"))


def on_a_line(**more: Any) -> FleetRouting:
    """Return two robots at x = 0 and nodes at x = 1, 2, 4 and 8."""
    return FleetRouting(2, points=[[0, 0], [1, 0], [2, 0], [4, 0], [8, 0]], **more)


def colonies(model: FleetRouting, flag: Any = GO, kind: type[Colonies] = Colonies) -> Colonies:
    """Return colonies of 10 ants and 30 iterations on one thread."""
    return kind(model, np.array([10, 30, 1.0, 3.0, 0.1]), None, flag)


@pytest.mark.parametrize(
    ("centres", "labels", "means", "loads", "fitness"),
    [
        # R_i of eq. 18 is 12, 11, 13 and 25, so R is 61 and a share 30.5. The centre at 0 takes the nodes
        # at 1 and 2, 12 + 11 = 23; with the one at 4 it would have 36. Tours 2 x 2 and 2 x 8.
        ([0.0, 8.0], [0, 0, 1, 1], [1.5, 6.0], [4.0, 16.0], 20 + 0.5 * 36),
        # The centre at 8 comes first: 25, and with the node at 4 it would have 38. Tours 16 and 8.
        ([8.0, 0.0], [1, 1, 1, 0], [8.0, 7 / 3], [16.0, 8.0], 24 + 0.5 * 16),
        # The centre at 3 sorts the nodes as 2, 4, 1, 8; 11 + 13 fits, 36 does not. Tours 8 and 16.
        ([3.0, 9.0], [1, 0, 0, 1], [3.0, 4.5], [8.0, 16.0], 24 + 0.5 * 16),
    ],
)
def test_one_particle_of_algorithm_3_by_hand(
    centres: Any, labels: Any, means: Any, loads: Any, fitness: float
) -> None:
    model = on_a_line(objective="sum-variance", q=0.5)
    weights = energies(model)
    assert weights.tolist() == [12, 11, 13, 25]
    place = np.array([[x, 0.0] for x in centres])
    points, found = np.array(model.points[1:]), np.empty(4, np.int64)
    reclassify(points, place, weights, weights.sum() / 2, found)
    assert found.tolist() == labels
    place = move_centres(points, found, place)
    assert place[:, 0].tolist() == pytest.approx(means)
    for kind in KINDS:
        own = colonies(model, kind=kind)
        lengths, routes, _ = own.tours(found[None], [np.random.default_rng(0)])
        assert lengths[0].tolist() == pytest.approx(loads)
        assert [sorted(route) for route in routes[0]] == [
            [i + 1 for i in range(4) if labels[i] == k] for k in range(2)
        ]
        # Eq. 15 plus q times eq. 16: the mean is 10 or 12, the differences to it 6 or 4.
        assert objective_of(model, lengths[0]) == pytest.approx(fitness)


def clouds() -> list[tuple[Any, int]]:
    """Return points and numbers of centres: random, twins, collinear, at one place, far apart."""
    one = np.random.default_rng(6).random((30, 2))
    return [
        (one, 4),
        (one, 30),
        (one, 1),
        (np.repeat(one[:6], 5, axis=0), 3),
        (np.column_stack([np.arange(12.0) / 11, np.zeros(12)]), 5),
        (np.full((9, 2), 0.5), 3),
        (np.vstack([1e-6 * one, [[1.0, 1.0]]]), 3),
    ]


@pytest.mark.parametrize("case", range(7))
def test_each_centre_takes_its_nearest_free_samples_within_its_share(case: int) -> None:
    points, m = clouds()[case]
    rng = np.random.default_rng(case)
    for weights in (np.ones(len(points)), rng.integers(1, 99, len(points)) * 1.0):
        centres, share = points[rng.integers(0, len(points), m)], weights.sum() / m
        labels = np.empty(len(points), np.int64)
        reclassify(points, centres, weights, share, labels)
        free = np.ones(len(points), bool)
        for k in range(m):
            own = labels == k
            assert own.any()
            gaps = cdist(points, centres[k : k + 1])[:, 0]
            rest = free & ~own
            if rest.any():
                assert gaps[own].max() <= gaps[rest].min() + 1e-12
            if k < m - 1:
                assert weights[own].sum() <= share * (1 + 1e-9) or own.sum() == 1
                near = np.flatnonzero(rest)[gaps[rest].argmin()]
                full = weights[own].sum() + weights[near] > share or rest.sum() == m - 1 - k
                ties = np.isclose(gaps[rest], gaps[near]).sum() > 1
                assert full or ties
            free &= ~own


@pytest.mark.parametrize(
    ("weights", "labels"),
    [
        # TPHA: two nodes each. From 8 and 1 the first takes 8 and 4; the means 6 and 1.5 change nothing.
        ([1.0, 1.0, 1.0, 1.0], [1, 1, 0, 0]),
        # k-means-AC: 25 + 13 is more than 30.5, so the first takes 8 alone; the means are 8 and 7/3.
        ([12.0, 11.0, 13.0, 25.0], [1, 1, 1, 0]),
    ],
)
def test_bounded_k_means_by_hand(weights: list[float], labels: list[int]) -> None:
    class Drawn:
        def choice(self, *_: Any, **__: Any) -> Any:
            return np.array([3, 0])

    points, share = np.array(on_a_line().points[1:]), sum(weights) / 2
    found = k_means(points, 2, np.array(weights), share, 100, Drawn())  # type: ignore[arg-type]
    assert found.tolist() == labels


def test_rivals_find_the_tours_of_their_clusters() -> None:
    """With one robot there is one cluster: 2 x 8 along the line, and all do find it."""
    for name in ("pso-ac", "kmeans-ac", "tpha"):
        found = ct.solve(on_a_line().__class__(1, points=on_a_line().points), name, seed=1)
        assert found.primal_bound == pytest.approx(16)


@pytest.mark.parametrize("kind", KINDS)
def test_colonies_find_good_tours_of_every_cluster(kind: type[Colonies]) -> None:
    rng = np.random.default_rng(14)
    points = rng.random((22, 2))
    costs = cdist(points, points) + np.triu(rng.random((22, 22)), 1)
    models = [FleetRouting(3, points=points, depots=[0, 0, 1]), FleetRouting(2, costs=costs)]
    for model in models:
        n, m = len(model.customers), model.vehicles
        labels = rng.integers(0, m, (3, n))
        labels[0] = m - 1  # clusters without nodes
        draws = [np.random.default_rng(p) for p in range(3)]
        lengths, routes, done = colonies(model, kind=kind).tours(labels, draws)
        assert done > 0
        for p, k in itertools.product(range(3), range(m)):
            assert sorted(routes[p][k]) == model.customers[labels[p] == k].tolist()
            stops = [int(model.homes[k]), *routes[p][k], int(model.homes[k])]
            nodes = np.array(stops[:-1])
            d = np.ascontiguousarray(model.distances[np.ix_(nodes, nodes)])
            order = np.arange(1, len(nodes))
            assert lengths[p, k] == pytest.approx(measure(d, order))
            polish(d, model.symmetric, GO, order)
            assert lengths[p, k] <= 1.2 * measure(d, order)


def test_a_missing_card_is_named() -> None:
    if importlib.util.find_spec("torch") is None:
        with pytest.raises(BackendMissing, match="torch"):
            ct.solve(on_a_line(), "pso-ac", backend_options={"device": "gpu"})
        return
    import torch

    if not torch.cuda.is_available():
        with pytest.raises(UnsupportedOption, match="CUDA"):
            ct.solve(on_a_line(), "pso-ac", backend_options={"device": "gpu"})


def test_ants_leave_pheromone_along_their_tour() -> None:
    trail = np.zeros((4, 4))
    _mark(trail, np.array([2, 1, 3]), 0.5, False)
    assert trail.tolist() == [[0, 0, 0.5, 0], [0, 0, 0, 0.5], [0, 0.5, 0, 0], [0.5, 0, 0, 0]]
    _mark(trail, np.array([2, 1, 3]), 0.5, True)
    assert trail[0, 2] == 1.0
    assert trail[2, 0] == 0.5


def test_a_swarm_improves_and_stops() -> None:
    model = FleetRouting(4, points=np.random.default_rng(7).random((41, 2)), objective="sum")
    points, weights = positions(model), energies(model)
    best: list[float] = []

    def fitness(loads: Any) -> float:
        best.append(float(loads.sum()))
        return best[-1]

    def moved(iterations: int, flag: Any = GO) -> Any:
        return swarm(
            points, 4, 8, iterations, 1.97, weights.sum() / 4, weights, colonies(model, flag), fitness,
            lambda routes: None, np.random.SeedSequence(3),
        )  # fmt: skip

    found = moved(15)
    assert (found.iterations, found.evaluations) == (15, 16 * 8)
    assert found.fitness == min(best) < 0.98 * min(best[:8])
    assert sorted(itertools.chain(*found.routes)) == list(range(1, 41))
    stopped = moved(15, np.ones(1, np.int8))
    assert stopped.iterations == 0
    assert sorted(itertools.chain(*stopped.routes)) == list(range(1, 41))


def test_distances_of_a_plane_are_embedded_exactly() -> None:
    points = np.random.default_rng(3).normal(size=(25, 2)) * [1, 1e-3]
    for count in (2, 3, 25):
        d = squareform(pdist(points[:count]))
        found = positions(FleetRouting(1, costs=d))  # without the depot
        wanted = pdist(points[1:count])
        scale = np.ptp(found, axis=0).max()
        assert scale == (pytest.approx(1.0) if count > 2 else 0.0)
        if count > 2:
            ratio = pdist(found) / wanted
            np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)
    assert not positions(FleetRouting(1, costs=np.zeros((6, 6)))).any()
    # Beyond 500 nodes, by Lanczos's method.
    points = np.random.default_rng(3).normal(size=(520, 2))
    ratio = pdist(positions(FleetRouting(1, costs=squareform(pdist(points))))) / pdist(points[1:])
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)


def test_each_depot_has_the_nearest_cluster() -> None:
    points = np.vstack([[[0, 0], [9, 0], [0, 9]], np.random.default_rng(4).random((12, 2))])
    points[3:7] += [8, 0]
    points[7:11] += [0, 8]
    model = FleetRouting(3, points=points, depots=[0, 1, 2])
    labels = np.array([1] * 4 + [2] * 4 + [0] * 4)
    for shuffled in itertools.permutations(range(3)):
        assert assign_vehicles(model, np.array(shuffled)[labels]).tolist() == labels.tolist()


def shortest(d: Any) -> float:
    """Return the length of the best closed tour from node 0, by trying all."""
    return min(
        math.fsum(d[a, b] for a, b in itertools.pairwise([0, *order, 0]))
        for order in itertools.permutations(range(1, len(d)))
    )


def matrices() -> list[tuple[Any, bool]]:
    """Return distances, and whether they are symmetric: points, ties, zeros, ratios of 1e6, one-way."""
    rng = np.random.default_rng(11)
    found = [(squareform(pdist(rng.random((7, 2)))) / 2, True) for _ in range(4)]
    found += [(squareform(pdist(rng.integers(0, 2, (7, 2)))), True), (np.zeros((5, 5)), True)]
    for n in (2, 3, 6, 7, 7):
        d = rng.choice([1e-6, 0.0, 1.0, 0.3], (n, n))
        np.fill_diagonal(d, 0)
        found.append((d, False))
    return found


@pytest.mark.parametrize("case", range(11))
def test_small_tours_are_the_best_or_near(case: int) -> None:
    d, symmetric = matrices()[case]
    best = shortest(d)
    start = np.empty(len(d) - 1, np.int64)
    nearest(d, start)
    here = 0
    for k, node in enumerate(start):
        assert d[here, node] == d[here, start[k:]].min()
        here = node
    order = start.copy()
    length, _ = breed(d, symmetric, 30, 60, 0.3, np.random.default_rng(1), GO, order)
    assert sorted(order) == list(range(1, len(d)))
    assert length == pytest.approx(measure(d, order), rel=1e-12, abs=1e-15)
    assert length == pytest.approx(best, rel=1e-9, abs=1e-12)
    # Ants are drawn to short ways, the more so the shorter they are, and may miss the best.
    ends = []
    for seed in range(3):
        order = start.copy()
        rng = np.random.default_rng(seed)
        length, done = colony(d, symmetric, 20, 40, 1.0, 3.0, 0.1, rng, GO, order)
        assert sorted(order) == list(range(1, len(d)))
        assert length == pytest.approx(measure(d, order), rel=1e-12, abs=1e-15)
        assert length <= measure(d, start)
        assert done == 40 or best == 0.0 or len(d) == 2
        ends.append(length)
    if symmetric:
        assert min(ends) <= 1.01 * best + 1e-12


def test_polishing_never_lengthens_and_leaves_no_move() -> None:
    rng = np.random.default_rng(12)
    gained = 0
    for seed in range(12):
        symmetric = seed % 2 == 0
        d = squareform(pdist(rng.random((16, 2)))) if symmetric else rng.random((16, 16))
        order = rng.permutation(15) + 1
        before = measure(d, order)
        polish(d, symmetric, GO, order)
        after = measure(d, order)
        gained += after < 0.8 * before
        assert sorted(order) == list(range(1, 16))
        for i, j in itertools.combinations(range(16), 2):
            turned = np.concatenate([order[:i], order[i:j][::-1], order[j:]])
            if symmetric:
                assert measure(d, turned) >= after - 1e-9
            for size in (1, 2, 3):
                rest = np.delete(order, range(i, min(i + size, 15)))
                moved = np.insert(rest, min(j, len(rest)), order[i : i + size])
                assert measure(d, moved) >= after - 1e-9
    assert gained == 12
    # Stopped at once, it is left as it is.
    order = rng.permutation(15) + 1
    left = order.copy()
    polish(d, False, np.ones(1, np.int8), order)
    assert order.tolist() == left.tolist()


def test_stretches_are_moved_and_children_are_tours() -> None:
    for first, size, place in itertools.product(range(7), range(1, 4), range(-1, 7)):
        last = first + size - 1
        if last > 6 or first - 1 <= place <= last:
            continue
        order = np.arange(7)
        _move(order, first, last, place)
        rest = [k for k in range(7) if not first <= k <= last]
        at = rest.index(place) + 1 if place >= 0 else 0
        rest[at:at] = range(first, last + 1)
        assert order.tolist() == rest
    rng = np.random.default_rng(0)
    for _ in range(50):
        one, two, child = rng.permutation(8) + 1, rng.permutation(8) + 1, np.zeros(8, np.int64)
        _cross(one, two, child, rng)
        assert sorted(child) == list(range(1, 9))
        kept = child == one
        # The other nodes are in the order of the second parent.
        rest = [node for node in two if node in child[~kept]]
        assert child[~kept].tolist() == rest


def test_empty_vehicles_are_given_the_best_node() -> None:
    rng = np.random.default_rng(13)
    objectives = ("sum", "max", "sum-variance", "range")
    for seed, objective in itertools.product(range(4), objectives):
        costs = rng.integers(0, 6, (9, 9)) * (1.0 - np.eye(9))
        q = {"q": 2.0} if objective == "sum-variance" else {}
        model = FleetRouting(3, costs=costs, objective=objective, **q)
        order = rng.permutation(8) + 1
        routes = [order[:5].tolist(), [], order[5:].tolist()]
        best = Best(model, Request())
        assert best.offer_filled(routes)
        wanted = math.inf
        for node in order.tolist():
            tried = [[one for one in route if one != node] for route in routes]
            tried[1] = [node]
            plan = FleetPlan(tuple(map(tuple, tried)))
            wanted = min(wanted, model.verify(plan).objective or 0.0)
        assert best.objective == pytest.approx(wanted, abs=1e-12), (seed, objective)
    many = FleetRouting(60, points=rng.random((900, 2)), objective="sum")
    best = Best(many, Request())
    assert best.offer_filled([list(range(1, 900)), *[[] for _ in range(59)]])
    assert best.plan is not None
    assert all(best.plan.routes)
