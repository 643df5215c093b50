"""Shortest orders of a few nodes by enumeration, and random problems of every kind."""

from __future__ import annotations

import itertools

import numpy as np

from crosstrack.models import SequentialOrdering


def best(model):
    """Return the least length over all orders of at most 8 nodes; inf if none is feasible."""
    size, pairs = model.size, model.precedence.tolist()
    least = np.inf
    for inner in itertools.permutations(range(1, size - 1)):
        order = (0, *inner, size - 1)
        place = {node: stop for stop, node in enumerate(order)}
        if all(place[a] < place[b] for a, b in pairs):
            least = min(least, sum(model.distances[a, b] for a, b in itertools.pairwise(order)))
    return float(least)


def random_problem(seed, most=7):
    """Return a problem with integers, ties, reals of any scale or missing arcs, and any relation."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, most + 1))
    distances = rng.integers(0, (2, 10, 1000)[int(rng.integers(3))], (size, size)).astype(float)
    if rng.random() < 0.25:
        distances = rng.random((size, size)) * 10.0 ** rng.integers(-3, 7)
    if rng.random() < 0.3:
        distances[rng.random((size, size)) < 0.3] = np.inf
    inner = size - 2
    order = 1 + rng.permutation(inner)
    pairs = order[np.argwhere(np.triu(rng.random((inner, inner)) < rng.random(), 1))]
    if rng.random() < 0.3:  # pairs that hold in every order
        pairs = np.vstack([pairs.reshape(-1, 2), [[0, size - 1]]])
    return SequentialOrdering(distances, precedence=pairs)
