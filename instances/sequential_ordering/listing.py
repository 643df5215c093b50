"""Catalogue of sequential ordering: random problems by the rule of SOPLIB, special cases."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...models.fields import Real, Whole
from ...models.sequential_ordering.model import MOST, SequentialOrdering
from ..catalogue import CatalogueEntry, Provenance, Row, listed

__all__ = ["catalogue_entries", "generate_ordering"]

PAPER = (
    "R. Montemanni, D. H. Smith, L. M. Gambardella, A heuristic manipulation technique for the sequential "
    "ordering problem, Computers & Operations Research 35, 2008"
)
_SIMILAR = (
    "Similar to the instances R.n.s.p of SOPLIB, not the files: drawn by the published rule from our own seed, so "
    "lengths are not comparable."
)
#: Nodes, largest distance, percentage and seed of the random entries.
_RANDOM = (
    (10, 100, 30, 1), (20, 1000, 15, 2), (40, 1000, 60, 3), (100, 100, 30, 4), (200, 1000, 15, 5),
    (500, 1000, 60, 6), (500, 1000, 1, 7),
)  # fmt: skip


def generate_ordering(
    nodes: int, largest: int, percentage: float, seed: int, *, name: str = ""
) -> SequentialOrdering:
    """Return a random problem by the rule of the instances R.n.s.p of SOPLIB.

    Distances are uniform among 0, 1, …, `largest`. The inner nodes have a random order, and a node precedes a later
    one of this order with the probability `percentage`.

    Parameters
    ----------
    nodes : int
        Number of nodes n, 2 to 3000.
    largest : int
        Largest distance s.
    percentage : float
        Probability p of a pair, in %.
    seed : int
        Seed of the random numbers.
    name : str
        Name of the model.

    Returns
    -------
    SequentialOrdering
        The model.

    Raises
    ------
    InvalidData
        A value is out of range. The message contains its name.
    """
    size = Whole(2, MOST).coerce("nodes", nodes, {})
    most = Whole(0, 10**9).coerce("largest", largest, {})
    share = Real(lower=0.0, upper=100.0).coerce("percentage", percentage, {}) / 100.0
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    distances = np.floor(rng.random((size, size)) * (most + 1))
    order = 1 + np.argsort(rng.random(size - 2))
    pairs = order[np.argwhere(np.triu(rng.random((size - 2, size - 2)) < share, 1))]
    return SequentialOrdering(distances, precedence=pairs, name=name)


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries."""
    random = (
        Row(
            f"random-{n}-{most}-{share}", f"{n} nodes, distances up to {most}, pairs with probability {share} %",
            partial(generate_ordering, n, most, share, seed), _SIMILAR,
        )
        for n, most, share, seed in _RANDOM
    )  # fmt: skip
    jobs = (
        (0, 4, 6, 5, 0), (0, 0, 3, 9, 2), (0, 8, 0, 2, 4), (0, 1, 7, 0, 3), (0, 0, 0, 0, 0),
    )  # fmt: skip
    ours: dict[str, Any] = {
        "provenance": Provenance.OURS,
        "note": "the optimum follows from an enumeration or the only order",
    }
    special = (
        Row(
            "jobs-3", "Three jobs with setup times, the second one after the first",
            partial(_given, jobs, [[1, 2]], ["start", "drill", "mill", "paint", "end"]), published={"optimum": 12}, **ours,
        ),
        Row("two", "Two nodes: one arc", partial(_given, ((0, 2.5), (0, 0))), published={"optimum": 2.5}, **ours),
        Row(
            "one-order", "A chain of 30 nodes: there is only one order",
            partial(_given, np.add.outer(np.arange(30.0), np.arange(30.0)), [[k, k + 1] for k in range(1, 28)]),
            published={"optimum": 841}, **ours,
        ),
        Row(
            "ring", "Missing arcs: each node can only be followed by the next two", partial(_given, _ring(12)),
            published={"optimum": 11}, **ours,
        ),
    )  # fmt: skip
    return listed("sequential-ordering", "sequential-ordering", PAPER, (*special, *random))


def _given(distances: Any, precedence: Any = (), ids: Any = None) -> SequentialOrdering:
    return SequentialOrdering(distances, precedence, ids)


def _ring(size: int) -> list[list[float]]:
    """Return distances of 1 to the next node, of 3 to the one after it, and no others."""
    steps = {1: 1.0, 2: 3.0}
    return [[steps.get(j - i, np.inf) for j in range(size)] for i in range(size)]
