"""Precedence relation of customers: chains and pairs as one acyclic relation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Spec, show

__all__ = [
    "Chains",
    "chain_cover",
    "closure_of",
    "joined_chains",
    "listed_pairs",
    "sorted_customers",
]

Truths = NDArray[np.bool_]
Lists = Sequence[Sequence[int]]


@dataclass(frozen=True)
class Chains(Spec):
    """Lists of customers, each in its order of service."""

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[tuple[int, ...], ...]:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, str | bytes) or not isinstance(value, Sequence):
            raise InvalidData(f"{name} must be a list of chains, got {show(value)}", field=name)
        chains = []
        for k, chain in enumerate(value):
            members = Array(("members",), int, lower=0).coerce(f"{name}[{k}]", chain, {})
            chains.append(tuple(members.tolist()))
        return tuple(chains)

    def encode(self, value: tuple[tuple[int, ...], ...]) -> Any:
        return [list(chain) for chain in value]


def sorted_customers(before: Lists, after: Lists) -> tuple[int, ...]:
    """Return customers 1 … size - 1 in a topological order of direct predecessors and successors; ties by number.

    Raise :class:`InvalidData` with the cycle if the relation has one.
    """
    missing = list(map(len, before))
    order: list[int] = []
    ready = [c for c in range(1, len(before)) if not missing[c]]
    while ready:
        order += ready
        free = []
        for c in ready:
            for other in after[c]:
                missing[other] -= 1
                if not missing[other]:
                    free.append(other)
        ready = sorted(free)
    if len(order) < len(before) - 1:
        try:  # the library takes four times as long, but names the cycle
            TopologicalSorter(dict(enumerate(before))).prepare()
        except CycleError as error:
            cycle = " -> ".join(map(str, error.args[1]))
            raise InvalidData(
                f"precedence must have no cycle, got {cycle}: each must precede the next",
                field="precedence",
            ) from None
    return tuple(order)


def listed_pairs(size: int, pairs: NDArray[np.int64]) -> list[list[int]]:
    """Return the second entries of the pairs, shape (p, 2), with each first entry 0 … size - 1, ascending."""
    first, second = pairs[np.lexsort(pairs.T[::-1])].T
    parts = np.split(second, np.searchsorted(first, np.arange(1, size)))
    return [part.tolist() for part in parts]


def closure_of(after: Lists, order: Sequence[int]) -> Truths:
    """Return the transitive closure: True if i must precede j, directly or indirectly.

    `after` contains the direct successors, and `order` is the result of :func:`sorted_customers`. Row and column 0,
    those of the start, are False.
    """
    closure = np.zeros((len(after), len(after)), bool)
    for k in reversed(order):
        for other in after[k]:
            closure[k] |= closure[other]
            closure[k, other] = True
    return closure


def joined_chains(before: Lists, order: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Return chains that contain every customer once, by a greedy method.

    Each customer is appended to a chain that ends with one of its direct predecessors. If the
    relation consists of disjoint chains, the result is these chains, which is the minimum. The arguments are the
    direct predecessors and the result of :func:`sorted_customers`.
    """
    ends: dict[int, list[int]] = {}
    chains: list[list[int]] = []
    for customer in order:
        last = next((entry for entry in before[customer] if entry in ends), None)
        chain = [] if last is None else ends.pop(last)
        if last is None:
            chains.append(chain)
        chain.append(customer)
        ends[customer] = chain
    return tuple(sorted(map(tuple, chains)))


def chain_cover(closure: Truths, order: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Return a minimum chain cover: the fewest chains that contain every customer once.

    Each customer of a chain must precede the next, directly or through other customers. The number
    of chains is the width of the relation. Source: R. P. Dilworth, "A decomposition theorem for
    partially ordered sets", Annals of Mathematics 51, 1950. Method: bipartite matching, D. R.
    Fulkerson, "Note on Dilworth's decomposition theorem", Proceedings of the AMS 7, 1956. The arguments are
    the results of :func:`closure_of` and :func:`sorted_customers`.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    follows = maximum_bipartite_matching(csr_array(closure), perm_type="column")
    led = set(follows[follows >= 0].tolist())
    chains = []
    for head in order:
        if head in led:
            continue
        chain = [head]
        while follows[chain[-1]] >= 0:
            chain.append(int(follows[chain[-1]]))
        chains.append(tuple(chain))
    return tuple(sorted(chains))
