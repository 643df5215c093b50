"""The gaps between places along the path, and how often any tour must cross each.

Whoever visits customers that must precede one another crosses a gap wherever two that follow one
another lie on its two sides. The most that any chain of the relation asks of a gap is a bound for all
tours; a tour is closed, so it crosses each gap to the left as often as to the right.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .data import GuidedPathData

__all__ = ["Gaps"]


@dataclass(frozen=True, eq=False)
class Gaps:
    """Places of a model from left to right; gap g lies between the places g and g + 1.

    Parameters
    ----------
    model : GuidedPathData
    """

    model: GuidedPathData

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """The different coordinates, ascending, m."""
        return np.unique(self.model.coordinates)

    @cached_property
    def at(self) -> NDArray[np.int64]:
        """Number of the place of the start and of each customer, shape (size,)."""
        return np.searchsorted(self.places, self.model.coordinates)

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Length of each gap, m.

        Coordinates count as the decimal numbers that they are written as, so between 0.1 and 0.3 lies
        0.2: solvers in whole numbers then need few digits.
        """
        exact = [Fraction(repr(place)) for place in self.places.tolist()]
        return np.array([float(b - a) for a, b in itertools.pairwise(exact)], float)

    @cached_property
    def crossings(self) -> NDArray[np.int64]:
        """How often each gap is crossed to the right at least."""
        before = self.before
        at, size = self.at.tolist(), self.lengths.size
        so_far = np.zeros((self.model.size, size), np.int16)
        most = np.zeros(size, np.int16)
        for c in self.model.sorted_customers:
            own = so_far[c]
            for one in before[c]:
                came = so_far[one].copy()
                came[at[one] : at[c]] += 1
                np.maximum(own, came, out=own)
            home = own.copy()
            home[at[c] : at[0]] += 1
            np.maximum(most, home, out=most)
        return most.astype(np.int64)

    @property
    def bound(self) -> float:
        """The length that no tour falls below, m."""
        return 2.0 * float(self.lengths @ self.crossings)

    def forcing(self, gap: int) -> tuple[int, ...]:
        """Return customers on alternate sides of `gap`, each before the next, that force its crossings.

        They are as many as any can be; the first and the last are on the other side than the start.
        None, where nobody is.
        """
        before, right = self.before, (self.at > gap).tolist()
        # Changes of side until each customer is served, and who was served before it.
        best: dict[int, tuple[int, int]] = {0: (0, 0)}
        for c in self.model.sorted_customers:
            best[c] = max((best[one][0] + (right[one] != right[c]), one) for one in before[c])
        c = max(best, key=lambda c: (best[c][0], -c))
        found: list[int] = []
        while c:
            one = best[c][1]
            if right[one] != right[c]:
                found.append(c)
            c = one
        found.reverse()
        # The way home crosses by itself.
        return tuple(found[:-1] if len(found) % 2 == 0 else found)

    @cached_property
    def before(self) -> list[list[int]]:
        """Who must directly precede each customer; the start, where there is nobody."""
        found: list[list[int]] = [[] for _ in range(self.model.size)]
        for one, other in self.model.pairs:
            found[other].append(one)
        return [one or [0] for one in found]

    @cached_property
    def after(self) -> list[list[int]]:
        """Who must directly follow each customer; the start, where there is nobody."""
        found: list[list[int]] = [[] for _ in range(self.model.size)]
        for one, other in self.model.pairs:
            found[one].append(other)
        return [one or [0] for one in found]

    def between(self, one: int, other: int) -> NDArray[np.bool_]:
        """Return which gaps lie between two places."""
        gap = np.arange(self.lengths.size)
        return (gap >= min(one, other)) & (gap < max(one, other))
