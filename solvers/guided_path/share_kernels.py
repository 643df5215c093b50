"""Shortest tours of a few chains alone, where gaps have other lengths: the loops.

``rests[s * g + i]``, with the counts of g chains as one number s, is the shortest way from the next
customer of chain i through all that is left of these chains to the start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["FAR", "fill_rests", "rest_of_shares", "walk_alone"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Longer than any way.
FAR = (1 << 31) - 1


@kernel(interpretable=True)
def fill_rests(heads: Ints, sizes: Ints, rests: Links, flag: NDArray[np.int8]) -> bool:
    """Fill in the ways that are left, from the last counts to the first; return whether all are.

    Parameters
    ----------
    heads : ndarray of int, shape (g + 1, longest + 1)
        Where the customers of each chain are, and the start begins the last row.
    sizes : ndarray of int, shape (g,)
        How many there are.
    rests : ndarray of int32
        Filled in; `FAR` where a chain is done.
    flag : ndarray of int8
        Not 0 asks to stop.
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
        # What comes after a customer is known, so it is handed to the counts before that one.
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
    """Return the length of the shortest ways back from several states, and count their crossings.

    Parameters
    ----------
    heads, sizes, rests
        As in :func:`fill_rests`, the latter filled in.
    places : ndarray of int, shape (g + 1, longest + 1)
        Numbers of the places in `heads`.
    begun : ndarray of int, shape (m, g)
        How much of each chain each state has served.
    starts : ndarray of int, shape (m,)
        The number of each state's place.
    weighted : ndarray of int, shape (gaps + 1,)
        Where the places are.
    crossed : ndarray of int, shape (gaps,)
        Filled in with how often all the ways together cross each gap.
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
def rest_of_shares(
    counts: Ints, here: int, first: Ints, place: Ints, groups: Ints, members: Ints, weighted: Ints,
    rests: Links,
) -> int:  # fmt: skip
    """Return the sum over all groups of chains of what is left of each alone.

    Parameters
    ----------
    counts, here, first, place
        The state, and as in :class:`~.bound.Tables`.
    groups : ndarray of int, shape (groups + 1, 2)
        Where each begins in `members` and in `rests`.
    members : ndarray of int, shape (chains, 2)
        The chains by group, and what each count adds to the number of the counts.
    weighted : ndarray of int, shape (groups, places)
        Where the places are for each group.
    rests : ndarray of int32
        Those of all groups.
    """
    total, start = 0, place[place.size - 1]
    for group in range(len(weighted)):
        low, high = groups[group, 0], groups[group + 1, 0]
        s = 0
        for i in range(low, high):
            s += counts[members[i, 0]] * members[i, 1]
        row = groups[group, 1] + s * (high - low) - low
        at, least = weighted[group, here], FAR
        for i in range(low, high):
            k = members[i, 0]
            customer = first[k] + counts[k]
            if customer < first[k + 1]:
                least = min(least, abs(weighted[group, place[customer]] - at) + rests[row + i])
        total += abs(at - weighted[group, start]) if least == FAR else least
    return total
