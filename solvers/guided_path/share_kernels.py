"""Kernels for shortest tours of a few chains with modified gap lengths.

``rests[s * g + i]``, with the counts of g chains encoded as one number s, is the length of the
shortest path from the next customer of chain i through all remaining customers of these chains to
the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .bound import Tables

__all__ = ["FAR", "Shares", "fill_rests", "rest_of_shares", "walk_alone"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Length greater than that of any path.
FAR = (1 << 31) - 1


class Shares(NamedTuple):
    """Groups of chains for :func:`rest_of_shares`.

    Attributes
    ----------
    groups : ndarray of int, shape (groups + 1, 2)
        First index of each group in `members` and in `rests`.
    members : ndarray of int, shape (chains, 2)
        Chains by group, and the increment of the encoded counts per customer.
    weighted : ndarray of int, shape (groups, places)
        Coordinates of the places for each group.
    rests : ndarray of int32
        Remaining lengths of all groups.
    times, over : int
        Factor and divisor that convert its value to units of the tables.
    """

    groups: Ints
    members: Ints
    weighted: Ints
    rests: NDArray[np.int32]
    times: int
    over: int


@kernel(interpretable=True)
def fill_rests(heads: Ints, sizes: Ints, rests: Links, flag: NDArray[np.int8]) -> bool:
    """Fill in the remaining lengths, from the last counts to the first; return whether it finished.

    `heads`, shape (g + 1, longest + 1): coordinates of the customers of each chain; the last row begins with
    the start. `sizes`, shape (g,): number of customers of each chain. `rests`: overwritten; `FAR` if a chain is
    finished.
    """
    g, home = sizes.size, heads[sizes.size, 0]
    radix, counts, at = np.ones(g, np.int64), sizes.copy(), np.full(g, home)
    for i in range(1, g):
        radix[i] = radix[i - 1] * (sizes[i - 1] + 1)
    total = radix[g - 1] * (sizes[g - 1] + 1)
    ways = np.empty(g, np.int64)
    for s in range(total - 1, -1, -1):
        if flag[0] != 0:
            return False
        for i in range(g):
            if counts[i] == sizes[i]:
                rests[s * g + i] = FAR
            ways[i] = rests[s * g + i]
        # The value of a customer follows from the current counts, and is stored at the counts
        # before it.
        for i in range(g):
            if counts[i] > 0:
                here, least = heads[i, counts[i] - 1], FAR
                for j in range(g):
                    least = min(least, abs(at[j] - here) + ways[j])
                if least >= FAR:
                    least = abs(here - home)
                rests[(s - radix[i]) * g + i] = least
        for i in range(g):
            if counts[i] > 0:
                counts[i] -= 1
                at[i] = heads[i, counts[i]]
                break
            counts[i] = sizes[i]
            at[i] = home
    return True


@kernel(interpretable=True)
def walk_alone(
    heads: Ints, sizes: Ints, rests: Links, places: Ints, begun: Ints, starts: Ints, weighted: Ints,
    crossed: Ints,
) -> int:  # fmt: skip
    """Return the total length of the shortest paths from several states; count their crossings.

    `heads`, `sizes`, `rests`: as :func:`fill_rests` filled them. `places`, shape (g + 1, longest + 1): indices
    of the places in `heads`. `begun`, shape (m, g): number of customers of each chain served in each state.
    `starts`, shape (m,): index of each state's place. `weighted`, shape (gaps + 1,): coordinates of the places.
    `crossed`, shape (gaps,): overwritten with the total number of crossings of each gap. Result: sum of the
    lengths.
    """
    g = sizes.size
    radix = np.ones(g, np.int64)
    for i in range(1, g):
        radix[i] = radix[i - 1] * (sizes[i - 1] + 1)
    for gap in range(crossed.size):
        crossed[gap] = 0
    way, counts = 0, np.empty(g, np.int64)
    for state in range(starts.size):
        here, s, chosen = starts[state], 0, 0
        for i in range(g):
            counts[i] = begun[state, i]
            s += radix[i] * counts[i]
        while chosen >= 0:
            least, chosen, there = FAR, -1, places[g, 0]
            for i in range(g):
                if counts[i] < sizes[i]:
                    rest = abs(heads[i, counts[i]] - weighted[here]) + rests[s * g + i]
                    if rest < least:
                        least, chosen = rest, i
            if chosen >= 0:
                there = places[chosen, counts[chosen]]
                counts[chosen] += 1
                s += radix[chosen]
            way += abs(weighted[there] - weighted[here])
            for gap in range(min(here, there), max(here, there)):
                crossed[gap] += 1
            here = there
    return way


@kernel
def rest_of_shares(tables: Tables, shares: Shares, counts: Ints, here: int) -> int:
    """Return the sum over all groups of chains of the remaining length of each group alone."""
    first, place, members = tables.first, tables.place, shares.members
    total, start = 0, place[place.size - 1]
    for group in range(len(shares.weighted)):
        low, high = shares.groups[group, 0], shares.groups[group + 1, 0]
        weighted, s = shares.weighted[group], 0
        for i in range(low, high):
            s += counts[members[i, 0]] * members[i, 1]
        row = shares.groups[group, 1] + s * (high - low) - low
        at, least = weighted[here], FAR
        for i in range(low, high):
            k = members[i, 0]
            customer = first[k] + counts[k]
            if customer < first[k + 1]:
                least = min(least, abs(weighted[place[customer]] - at) + shares.rests[row + i])
        total += abs(at - weighted[start]) if least == FAR else least
    return total
