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
from crosstrack.solvers.fleet.breeding_kernels import _cross, _move, breed, polish
from crosstrack.solvers.fleet.clustering import clustered, k_means, positions
from crosstrack.solvers.fleet.clustering_kernels import assign
from crosstrack.solvers.fleet.colony_kernels import colony, measure, nearest
from crosstrack.solvers.fleet.swarm import (
    array_evaluation,
    swarm,
    threaded,
    torch_evaluation,
)

GO = np.zeros(1, np.int8)
TORCH = importlib.util.find_spec("torch") is not None


def clouds() -> list[tuple[Any, Any, int]]:
    """Return points, particles and slacks: random, twins, collinear, at one place, far apart."""
    rng = np.random.default_rng(6)
    one = rng.random((30, 2))
    found = [
        (one, 4, 1),
        (one, 4, 30),
        (one, 30, 1),
        (one, 1, 1),
        (np.repeat(one[:6], 5, axis=0), 3, 2),
        (np.column_stack([np.arange(12.0) / 11, np.zeros(12)]), 5, 1),
        (np.full((9, 2), 0.5), 3, 1),
        (np.vstack([1e-6 * one, [[1.0, 1.0]]]), 3, 1),
    ]
    return [(p, p[rng.integers(0, len(p), (20, m))], slack) for p, m, slack in found]


@pytest.mark.parametrize("case", range(8))
def test_nodes_go_to_the_nearest_centre_and_then_from_large_to_small(case: int) -> None:
    points, place, slack = clouds()[case]
    for centres in place:
        labels, gaps = np.empty(len(points), np.int64), np.empty((len(points), len(centres)))
        assign(points, centres, slack, gaps, labels)
        np.testing.assert_allclose(gaps, cdist(points, centres), rtol=1e-12, atol=1e-15)
        # The same, said plainly.
        wanted = gaps.argmin(axis=1)
        while True:
            counts = np.bincount(wanted, minlength=len(centres))
            large, small = int(counts.argmax()), int(counts.argmin())
            if counts[large] - counts[small] <= slack:
                break
            members = np.flatnonzero(wanted == large)
            cost = gaps[members, small] - gaps[members, large]
            wanted[members[int(cost.argmin())]] = small
        assert labels.tolist() == wanted.tolist()
        assert np.ptp(np.bincount(labels, minlength=len(centres))) <= slack


@pytest.mark.parametrize("case", range(8))
@pytest.mark.parametrize("balance", [0.0, 1.0, 1e3])
def test_loops_arrays_and_torch_agree(case: int, balance: float) -> None:
    points, place, slack = clouds()[case]
    labels, worth = threaded(points, slack, balance, 1, None, GO)(place)
    same, value = array_evaluation(points, slack, balance)(place)
    assert labels.tolist() == same.tolist()
    np.testing.assert_allclose(worth, value, rtol=1e-12, atol=1e-12)
    for k in range(len(place)):
        gaps = cdist(points, place[k])
        sums = [gaps[labels[k] == j, j].sum() for j in range(place.shape[1])]
        assert worth[k] == pytest.approx(sum(sums) + balance * np.std(sums), rel=1e-9, abs=1e-9)
    if TORCH:
        held, sums = torch_evaluation(points, slack, balance, "cpu")(place)
        assert held.tolist() == labels.tolist()
        np.testing.assert_allclose(sums, worth, rtol=1e-12, atol=1e-12)


@pytest.mark.skipif(not TORCH, reason="torch is not installed")
def test_torch_moves_the_same_swarm() -> None:
    points = np.random.default_rng(1).random((40, 2))
    evaluations = [threaded(points, 1, 1.0, 1, None, GO), torch_evaluation(points, 1, 1.0, "cpu")]
    seen: list[list[Any]] = [[], []]
    for evaluate, places in zip(evaluations, seen, strict=True):

        def told(place: Any, evaluate: Any = evaluate, places: Any = places) -> Any:
            places.append(place.copy())
            return evaluate(place)

        swarm(points, 3, 10, 5, 1.97, told, np.random.default_rng(4), GO)
    np.testing.assert_array_equal(seen[0], seen[1])


def test_a_gpu_is_used_or_its_want_is_said() -> None:
    model = FleetRouting(3, points=np.random.default_rng(2).random((60, 2)))
    options = {"device": "gpu", "iterations": 20}
    if not TORCH:
        with pytest.raises(BackendMissing, match="torch"):
            ct.solve(model, "pso-ac", backend_options=options)
        return
    import torch

    if not torch.cuda.is_available():
        with pytest.raises(UnsupportedOption, match="CUDA"):
            ct.solve(model, "pso-ac", backend_options=options)
        return
    found = ct.solve(model, "pso-ac", seed=1, backend_options=options)
    assert found.verification is not None
    assert found.verification.ok
    loops = ct.solve(model, "pso-ac", seed=1, backend_options={**options, "device": "cpu"})
    assert found.primal_bound == pytest.approx(loops.primal_bound, rel=0.05)


def test_a_swarm_improves_and_stops() -> None:
    points = np.random.default_rng(7).random((50, 2))
    evaluate = threaded(points, 1, 1.0, 1, None, GO)
    worths: list[float] = []

    def told(place: Any) -> Any:
        labels, worth = evaluate(place)
        worths.append(worth.min())
        return labels, worth

    labels, done, count = swarm(points, 4, 20, 40, 1.97, told, np.random.default_rng(0), GO)
    assert (done, count) == (40, 41 * 20)
    assert min(worths) < 0.95 * worths[0]
    assert np.ptp(np.bincount(labels, minlength=4)) <= 1
    flag = np.ones(1, np.int8)
    labels, done, _ = swarm(points, 4, 20, 40, 1.97, evaluate, np.random.default_rng(0), flag)
    assert done == 0
    assert set(labels) <= set(range(4))


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


def test_no_cluster_is_left_empty_and_each_depot_has_the_nearest() -> None:
    points = np.vstack([[[0, 0], [9, 0], [0, 9]], np.random.default_rng(4).random((12, 2))])
    points[3:7] += [8, 0]
    points[7:11] += [0, 8]
    model = FleetRouting(3, points=points, depots=[0, 1, 2])
    labels = np.array([1] * 4 + [2] * 4 + [0] * 4)
    for shuffled in itertools.permutations(range(3)):
        parts = clustered(model, positions(model), np.array(shuffled)[labels])
        assert [part.tolist() for part in parts] == [[8, 9, 10, 11], [0, 1, 2, 3], [4, 5, 6, 7]]
    lone = clustered(FleetRouting(4, points=points), points[1:], np.zeros(14, np.int64))
    assert sorted(len(part) for part in lone) == [1, 1, 1, 11]


def test_k_means_ends_where_no_node_changes() -> None:
    points = np.random.default_rng(5).random((60, 2))
    labels = k_means(points, 4, 60, 100, np.random.default_rng(0))
    centres = np.array([points[labels == k].mean(axis=0) for k in range(4)])
    assert cdist(points, centres).argmin(axis=1).tolist() == labels.tolist()


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
        # What is not of the first parent stands in the order of the second.
        rest = [node for node in two if node in child[~kept]]
        assert child[~kept].tolist() == rest
