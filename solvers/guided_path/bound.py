"""Lower bound on the remaining length of a tour along a path, and the tables of its search states.

A state is a position and the number of customers served in each chain of the minimum chain cover. A
gap is the interval between two neighbouring places. Each remaining path of the relation crosses a
gap some number of times before it ends at the start, and the tour crosses it at least as often. So
the sum over gaps of length times the largest remaining number of crossings is a lower bound. All
paths from one position cross a gap an odd number of times, or all an even number. The crossings
from the position to the first customer therefore need no table: the largest number is rounded up to
the right parity. The bound is consistent: it decreases by at most the distance walked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.walks import Flag
from ...timing import stop_if

__all__ = ["MOST_NEEDS", "SAFE", "Tables", "needs_of", "whole_lengths"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Binary digits of the largest coordinate difference, so that the sum of 20,000 of them is an exact
#: integer.
DIGITS = 44
#: Relative safety margin of a bound if lengths are rounded.
SAFE = 1e-12
#: Maximum number of entries of :func:`needs_of`, 0.2 GB.
MOST_NEEDS = 50_000_000
#: Maximum number of groups of gaps in the bound, apart from one more at the start.
MOST_GROUPS = 2048
#: Bits used in a word of a state's key, without the sign and one spare bit.
WORD = 62


def whole_lengths(places: Floats) -> tuple[Ints, float, bool]:
    """Return the gaps between sorted places as integers, their unit, and whether this is exact.

    If no unit divides all gaps, the range is divided into 2^43 … 2^44 units and the gaps are
    rounded down, so that integer lengths never exceed true lengths.

    `places`, shape (p,): sorted places, in m. Result: lengths of the gaps in units, the unit (m), and True if
    the lengths are exact.
    """
    gaps = np.diff(places)
    span = float(places[-1] - places[0])
    if span == 0.0:
        return np.zeros(gaps.size, np.int64), 1.0, True
    unit = max(math.ldexp(1.0, math.frexp(span)[1] - DIGITS), 5e-324)
    whole = np.floor(gaps / unit).astype(np.int64)
    exact = bool((whole * unit == gaps).all())
    if exact:
        common = int(np.gcd.reduce(whole))
        return whole // common, unit * common, True
    return whole, unit, False


class Tables(NamedTuple):
    """Arrays of a model for the searches and their kernels; customers are numbered chain by chain.

    Attributes
    ----------
    customers : ndarray of int, shape (n,)
        Numbers of the customers in the model.
    first : ndarray of int, shape (chains + 1,)
        First customer of each chain, and n.
    place : ndarray of int, shape (n + 1,)
        Index of the place of each customer, and last of the start; places are sorted and distinct.
    length : ndarray of int, shape (places - 1,)
        Lengths of the gaps between neighbouring places, in units.
    at : ndarray of int, shape (places,)
        Cumulative sums of `length`.
    wide : ndarray of int, shape (groups,)
        Lengths of groups of neighbouring gaps, in units. Each gap is a group unless there are more than
        `MOST_GROUPS`.
    group : ndarray of int, shape (places,)
        Index of the first group at or to the right of each place; the place of the start separates two groups.
    over : ndarray of int, shape (places,)
        Length from each place to the left end of that group, in units.
    crossings : ndarray of int16, shape (n, groups)
        Number of crossings of each group on a path of the relation from a customer to the start: the
        largest one on any path, counting only steps that cross the whole group.
    change : ndarray of int, shape (n, 2)
        First group, and the one after the last group, at which the crossings of the next customer of the chain
        differ from those of each customer.
    needs : ndarray of int, shape (n + 1,)
        Index of the first row of each customer in `needed`, and the number of rows.
    needed : ndarray of int, shape (m, 2)
        Chain, and the number of its customers that must be served before.
    fields : ndarray of int, shape (chains + 1, 3)
        Word, shift and mask of each chain's count in a key; the last row is for the place.
    words : int
        Number of words of a key.
    unit : float
        Unit of the lengths, in m.
    exact : bool
        Whether the lengths are exact, i.e. not rounded.
    """

    customers: Ints
    first: Ints
    place: Ints
    length: Ints
    at: Ints
    wide: Ints
    group: Ints
    over: Ints
    crossings: NDArray[np.int16]
    change: Ints
    needs: Ints
    needed: Ints
    fields: Ints
    words: int
    unit: float
    exact: bool

    @classmethod
    def of(cls, model: GuidedPathData, flag: Flag = None) -> Tables:
        """Return the tables of `model`; raise :class:`OutOfTime` if `flag` is set."""
        chains = model.cover
        customers = np.array([c for chain in chains for c in chain], np.int64)
        first = np.cumsum([0, *map(len, chains)])
        number = np.empty(model.size, np.int64)
        number[customers] = np.arange(customers.size)
        places, place = np.unique(model.coordinates, return_inverse=True)
        length, unit, exact = whole_lengths(places)
        needs, needed = _needs(model, first, number, flag)
        fields, words = _fields([*map(len, chains), places.size - 1])
        where = np.append(place[customers], place[0])
        at = np.append(0, np.cumsum(length))
        ends = np.linspace(0, length.size, min(length.size, MOST_GROUPS) + 1).astype(np.int64)
        ends = np.union1d(ends, where[-1:])
        group = np.searchsorted(ends, np.arange(at.size))
        over = at[ends][group] - at
        crossings = _crossings(model, number, where, group, np.isin(np.arange(at.size), ends), flag)
        return cls(
            customers, first, where, length, at, np.diff(at[ends]), group, over, crossings,
            _changes(crossings, first), needs, needed, fields, words, unit, exact,
        )  # fmt: skip

    def root(self) -> int:
        """Return the lower bound on the length of every tour, in units."""
        limits = self.crossings.max(axis=0, initial=0).astype(np.int64)
        return int(self.wide @ (limits + limits % 2))


def needs_of(
    model: GuidedPathData,
    chains: Sequence[Sequence[int]],
    *,
    plain: bool = False,
    flag: Flag = None,
) -> NDArray[np.int32]:
    """Return how many customers of each chain must be served before each customer.

    Parameters
    ----------
    model : GuidedPathData
        The model.
    chains : sequence of sequences of int
        Disjoint chains of customers.
    plain : bool
        Whether to return the table even if no pair relates two chains.
    flag : ndarray of int8, shape (1,), optional
        Stop flag, nonzero to stop.

    Returns
    -------
    ndarray of int32, shape (n, k)
        One row per customer, chain after chain. Without pairs between chains, the shape is (0, k).

    Raises
    ------
    UnsupportedFormulation
        The table would have more than `MOST_NEEDS` entries.
    OutOfTime
        `flag` stopped it.
    """
    owner = {c: (k, place) for k, chain in enumerate(chains) for place, c in enumerate(chain)}
    first, second = np.array([owner.get(c, (-1, 0))[0] for c in range(model.size)])[model.links.T]
    if not plain and ((first == second) & (first >= 0)).all():
        return np.zeros((0, len(chains)), np.int32)
    if model.size * len(chains) > MOST_NEEDS:
        raise UnsupportedFormulation(
            f"pairs between chains of {model.size - 1} customers and {len(chains)} chains need a table of at "
            f"most {MOST_NEEDS} entries"
        )
    need = np.zeros((model.size, len(chains)), np.int32)
    for c in model.sorted_customers:
        stop_if(flag)
        for entry in model.before[c]:
            np.maximum(need[c], need[entry], out=need[c])
            k, place = owner.get(entry, (-1, 0))
            if k >= 0:
                need[c, k] = max(need[c, k], place + 1)
    return need[[c for chain in chains for c in chain]]


def _needs(model: GuidedPathData, first: Ints, number: Ints, flag: Flag) -> tuple[Ints, Ints]:
    """Return the requirements of each customer in other chains, without those implied by its chain."""
    chain = np.repeat(np.arange(first.size - 1), np.diff(first)).tolist()
    places = (np.arange(model.size - 1) - first[chain] + 1).tolist()
    numbers, starts, rows = number.tolist(), [0], list[tuple[int, int]]()
    known: dict[int, int] = {}
    for b, c in enumerate((np.argsort(number[1:]) + 1).tolist()):
        stop_if(flag)
        if places[b] == 1:
            known = {}
        before = [numbers[entry] for entry in model.before[c]]
        needed = [(chain[a], places[a]) for a in before if chain[a] != chain[b]]
        for k, count in sorted(needed, reverse=True):
            if known.get(k, 0) < count:
                known[k] = count
                rows.append((k, count))
        starts.append(len(rows))
    return np.array(starts), np.array(rows, np.int64).reshape(-1, 2)


def _fields(most: list[int]) -> tuple[Ints, int]:
    """Return word, shift and mask of integers up to `most`, and the number of words."""
    rows, word, shift = [], 0, 0
    for entry in most:
        bits = entry.bit_length()
        if shift + bits > WORD:
            word, shift = word + 1, 0
        rows.append((word, shift, (1 << bits) - 1))
        shift += bits
    return np.array(rows, np.int64), word + 1


def _crossings(
    model: GuidedPathData,
    number: Ints,
    place: Ints,
    group: Ints,
    ends: NDArray[np.bool_],
    flag: Flag,
) -> NDArray[np.int16]:
    groups = int(group[-1])
    crossings = np.zeros((model.size - 1, groups), np.int16)
    for c in reversed(model.sorted_customers):
        stop_if(flag)
        row = crossings[number[c]]
        here = int(place[number[c]])
        for other in (*number[model.after[c]].tolist(), -1):
            # The start has the last index, and no crossings follow it.
            way = crossings[other].copy() if other >= 0 else np.zeros(groups, np.int16)
            low, high = sorted((here, int(place[other])))
            way[group[low] : group[high] + ends[high] - 1] += 1
            np.maximum(row, way, out=row)
    return crossings


def _changes(crossings: NDArray[np.int16], first: Ints) -> Ints:
    """Return the range of groups at which each row differs from the next one of its chain."""
    change = np.zeros((len(crossings), 2), np.int64)
    lasts = set(first[1:].tolist())
    for c, row in enumerate(crossings):
        differs = np.flatnonzero(row != crossings[c + 1] if c + 1 not in lasts else row)
        if differs.size:
            change[c] = differs[0], differs[-1] + 1
    return change
