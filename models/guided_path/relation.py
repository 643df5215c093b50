"""Which customers must precede which: chains and pairs as one acyclic relation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Spec, show

__all__ = ["Chains", "chain_cover", "closure_of", "joined_chains", "sorted_customers"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]


@dataclass(frozen=True)
class Chains(Spec):
    """Lists of customers, each served in its order."""

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[tuple[int, ...], ...]:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, str | bytes) or not isinstance(value, Sequence):
            raise InvalidData(f"{name} must be a list of chains, got {show(value)}", field=name)
        found = []
        for k, chain in enumerate(value):
            members = Array(("members",), int, lower=0).coerce(f"{name}[{k}]", chain, {})
            found.append(tuple(members.tolist()))
        return tuple(found)

    def encode(self, value: tuple[tuple[int, ...], ...]) -> Any:
        return [list(chain) for chain in value]


def sorted_customers(size: int, pairs: Iterable[tuple[int, int]]) -> tuple[int, ...]:
    """Return customers 1 … size - 1 such that whoever must precede comes first; ties by number.

    Raises
    ------
    InvalidData
        The relation has a cycle, which is named.
    """
    sorter = TopologicalSorter(dict.fromkeys(range(1, size), ()))
    for before, after in pairs:
        sorter.add(after, before)
    try:
        sorter.prepare()
    except CycleError as error:
        cycle = " -> ".join(map(str, error.args[1]))
        raise InvalidData(
            f"precedence must have no cycle, got {cycle}: each must precede the next",
            field="precedence",
        ) from None
    order: list[int] = []
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        order += ready
        sorter.done(*ready)
    return tuple(order)


def closure_of(size: int, pairs: Iterable[tuple[int, int]], order: Sequence[int]) -> Truths:
    """Return whether i must precede j, directly or through others, shape (size, size).

    Parameters
    ----------
    size : int
        Customers and the start, whose row and column are empty.
    pairs : iterable of (int, int)
        Who must directly precede whom.
    order : sequence of int
        As :func:`sorted_customers` returns it.
    """
    after: list[list[int]] = [[] for _ in range(size)]
    for one, other in pairs:
        after[one].append(other)
    found = np.zeros((size, size), bool)
    for k in reversed(order):
        for other in after[k]:
            found[k] |= found[other]
            found[k, other] = True
    return found


def joined_chains(
    size: int, pairs: Iterable[tuple[int, int]], order: Sequence[int]
) -> tuple[tuple[int, ...], ...]:
    """Return chains that together hold every customer once, without a search for the fewest.

    Each customer goes behind somebody who must directly precede it and ends a chain. Chains that have
    nothing to do with one another are found again so, and there are no fewer.
    """
    before: list[list[int]] = [[] for _ in range(size)]
    for one, other in pairs:
        before[other].append(one)
    ends: dict[int, list[int]] = {}
    chains: list[list[int]] = []
    for customer in order:
        last = next((one for one in before[customer] if one in ends), None)
        chain = [] if last is None else ends.pop(last)
        if last is None:
            chains.append(chain)
        chain.append(customer)
        ends[customer] = chain
    return tuple(sorted(map(tuple, chains)))


def chain_cover(closure: Truths, order: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Return the fewest chains that together hold every customer once.

    In each, every customer must precede the next, perhaps through customers of other chains. Their
    number is the width of the relation. Source: R. P. Dilworth, "A decomposition theorem for
    partially ordered sets", Annals of Mathematics 51, 1950; by a matching, as D. R. Fulkerson, "Note
    on Dilworth's decomposition theorem", Proceedings of the AMS 7, 1956.
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
