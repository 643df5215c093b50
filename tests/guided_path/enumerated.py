"""Shortest tours of a few customers by enumeration, and random relations of every kind."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
from hypothesis import strategies as st

from crosstrack.models import GuidedPathTour

#: Kinds of coordinates: ties, both signs, ratios of 1e6, far away, all at the start.
KINDS = ("integers", "ties", "signed", "ratios", "far", "nowhere", "reals")
#: Kinds of relations.
RELATIONS = ("none", "chains", "dag", "both", "one chain", "dense")


@cache
def _orders(count):
    orders = np.array(list(itertools.permutations(range(1, count + 1))))
    return orders, np.argsort(orders, axis=1)


def lengths(coordinates, orders):
    """Return the length of each tour, with one tour per row."""
    stops = np.pad(orders, ((0, 0), (1, 1)))
    return np.abs(np.diff(coordinates[stops], axis=1)).sum(axis=1)


def extensions(model):
    """Return all feasible orders, with one order per row."""
    orders, places = _orders(model.size - 1)
    allowed = np.ones(len(orders), bool)
    for a, b in model.pairs:
        allowed &= places[:, a - 1] < places[:, b - 1]
    return orders[allowed]


def best(model):
    """Return the least length over all orders; 8 customers at most, please."""
    return float(lengths(model.coordinates, extensions(model)).min())


def prefix_lengths(model):
    """Return the least length from the start through each closed set to each last customer."""
    found = {}
    for order in extensions(model).tolist():
        way = 0.0
        for k, (a, b) in enumerate(itertools.pairwise((0, *order))):
            way += abs(model.coordinates[b] - model.coordinates[a])
            key = frozenset(order[: k + 1]), b
            found[key] = min(found.get(key, np.inf), way)
    return found


def coordinates(rng, kind, count):
    """Return the coordinates of the start and `count` customers."""
    size = count + 1
    return {
        "integers": lambda: rng.integers(0, 201, size),
        "ties": lambda: rng.integers(-1, 3, size),
        "signed": lambda: rng.integers(-20, 21, size),
        "ratios": lambda: 10.0 ** rng.integers(-3, 4, size) * rng.choice([-1.0, 1.0], size),
        "far": lambda: 1e9 + rng.integers(-3, 4, size),
        "nowhere": lambda: np.full(size, rng.choice([0.0, -7.0])),
        "reals": lambda: rng.normal(size=size),
    }[kind]().astype(float)


def cut(rng, customers):
    """Return `customers` cut into chains of random lengths."""
    ends = np.flatnonzero(rng.random(len(customers) - 1) < rng.random()) + 1
    return [part.tolist() for part in np.split(customers, ends)]


def random_tour(seed, most=6, kind=None, relation=None):
    """Return a tour of 1 to `most` customers of a random or given kind."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, most + 1))
    kind = rng.choice(KINDS) if kind is None else kind
    relation = rng.choice(RELATIONS) if relation is None else relation
    customers = rng.permutation(count) + 1
    chains, pairs = [], []
    if relation in ("chains", "both"):
        chains = cut(rng, customers)
        if rng.random() < 0.3:
            chains[0] = [0, *chains[0]]
    if relation == "one chain":
        chains = [customers.tolist()]
    if relation in ("dag", "both", "dense"):
        share = 0.7 if relation == "dense" else 0.5 * rng.random()
        # Pairs along one order of the customers, so that the relation is acyclic.
        pairs = [pair for pair in itertools.combinations(customers, 2) if rng.random() < share]
    return GuidedPathTour(coordinates(rng, kind, count), chains=chains, precedence=pairs or ())


def chains_tour(k, each, seed, most=200, far=0):
    """Return a tour of `k` chains of `each` customers at integer coordinates from 1 to `most`."""
    rng = np.random.default_rng(seed)
    places = np.concatenate(([0], rng.integers(1, most + 1, k * each))) + far
    return GuidedPathTour(places, chains=(np.arange(k * each) + 1).reshape(k, each).tolist())


def tours(most=6):
    """Return a Hypothesis strategy of tours, which shrinks to few customers and small numbers."""
    numbers = st.one_of(
        st.integers(-3, 3).map(float),
        st.integers(-200, 200).map(float),
        st.sampled_from([1e-6, 1e6, -1e6, 1e9, -1e9, 1e9 + 1, 0.1, 1 / 3]),
        st.floats(-1e3, 1e3, allow_subnormal=False),
    )

    @st.composite
    def draw_tour(draw):
        places = draw(st.lists(numbers, min_size=2, max_size=most + 1))
        count = len(places) - 1
        order = draw(st.permutations(range(1, count + 1)))
        ends = draw(st.lists(st.booleans(), min_size=count, max_size=count))
        chains, chain = [], []
        for customer, ended in zip(order, ends, strict=True):
            chain.append(customer)
            if ended:
                chains.append(chain)
                chain = []
        choices = list(itertools.combinations(order, 2)) or [None]
        pairs = draw(st.lists(st.sampled_from(choices), max_size=6, unique=True))
        pairs = [pair for pair in pairs if pair is not None]
        return GuidedPathTour(places, chains=chains, precedence=pairs or ())

    return draw_tour()
