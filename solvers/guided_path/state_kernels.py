"""Kernels on single search states of tours along a path; see :mod:`.bound` for the tables.

The counts of a state are the numbers of customers served in each chain. Its key packs them and the
place into words.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .bound import Tables
from .share_kernels import Shares, rest_of_shares

__all__ = ["hashed", "least_rest", "neighbours", "pack", "rest_by_gaps", "serve", "unpack"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Mask of half a word, and two 31-bit factors: products stay within 62 bits, compiled or not.
HALF = (1 << 31) - 1
MIX, STIR = 0x5851F42D, 0x2545F491


@kernel
def unpack(key: Ints, fields: Ints, counts: Ints) -> int:
    """Fill in the counts of a key; return its place."""
    chains = counts.size
    for k in range(chains):
        counts[k] = (key[fields[k, 0]] >> fields[k, 1]) & fields[k, 2]
    return int((key[fields[chains, 0]] >> fields[chains, 1]) & fields[chains, 2])


@kernel
def pack(counts: Ints, place: int, fields: Ints, key: Ints) -> None:
    """Fill in the key of a state."""
    chains = counts.size
    for word in range(key.size):
        key[word] = 0
    for k in range(chains):
        key[fields[k, 0]] |= counts[k] << fields[k, 1]
    key[fields[chains, 0]] |= place << fields[chains, 1]


@kernel
def hashed(key: Ints) -> int:
    """Return a 31-bit hash of a key."""
    value = HALF
    for word in range(key.size):
        for half in ((key[word] >> 31) & HALF, key[word] & HALF):
            value = (value ^ half) * MIX
            value = (value ^ (value >> 33)) & HALF
    value = value * STIR
    return (value ^ (value >> 29)) & HALF


@kernel
def _is_available(tables: Tables, counts: Ints, customer: int) -> bool:
    """Return whether all predecessors of a customer in other chains are served."""
    for row in range(tables.needs[customer], tables.needs[customer + 1]):
        if counts[tables.needed[row, 0]] < tables.needed[row, 1]:
            return False
    return True


@kernel
def neighbours(tables: Tables, counts: Ints, here: int) -> tuple[int, int]:
    """Return the nearest places left and right with an available customer, or -1."""
    first, place = tables.first, tables.place
    left, right = -1, -1
    for k in range(counts.size):
        customer = first[k] + counts[k]
        if customer < first[k + 1]:
            there = place[customer]
            if (there < here and there > left) or (there > here and (right < 0 or there < right)):
                if _is_available(tables, counts, customer):
                    if there < here:
                        left = there
                    else:
                        right = there
    return left, right


@kernel
def serve(tables: Tables, counts: Ints, here: int) -> int:
    """Serve all customers that are or become available at a place; return their number."""
    first, place = tables.first, tables.place
    served, again = 0, True
    while again:
        again = False
        for k in range(counts.size):
            customer = first[k] + counts[k]
            while (
                customer < first[k + 1]
                and place[customer] == here
                and _is_available(tables, counts, customer)
            ):
                customer += 1
                counts[k] += 1
                served += 1
                again = len(tables.needed) > 0
    return served


@kernel
def rest_by_gaps(tables: Tables, counts: Ints, here: int, most: NDArray[np.int16]) -> int:
    """Return a lower bound on the path from `here` through all unserved customers to the start.

    `most` is scratch space with one entry per gap.
    """
    first, place, length, crossings = tables.first, tables.place, tables.length, tables.crossings
    gaps = length.size
    for gap in range(gaps):
        most[gap] = 0
    for k in range(counts.size):
        customer = first[k] + counts[k]
        if customer < first[k + 1]:
            for gap in range(gaps):
                most[gap] = max(most[gap], crossings[customer, gap])
    total, start = 0, place[place.size - 1]
    for gap in range(gaps):
        odd = (here <= gap) != (start <= gap)
        total += length[gap] * (most[gap] + ((most[gap] + odd) & 1))
    return total


@kernel(interpretable=True)
def least_rest(
    tables: Tables, shares: Shares, counts: Ints, here: int, most: NDArray[np.int16]
) -> int:
    """Return the maximum of the bound by gaps and the bound by shares.

    The lengths of all paths from `here` to the start have the same parity, in units.
    """
    rest = rest_by_gaps(tables, counts, here, most)
    if len(shares.weighted) > 0:
        shared = rest_of_shares(tables, shares, counts, here)
        shared = (shared * shares.times + shares.over - 1) // shares.over
        rest = max(rest, shared + ((shared - rest) & 1))
    return rest
