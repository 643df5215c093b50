"""Gaps between places along the path, and a lower bound on the crossings of each gap.

A tour that visits a chain of customers crosses a gap whenever two consecutive customers are on
different sides of it. The largest number of crossings over all chains of the relation is a lower
bound for every tour. A tour is closed, so it crosses each gap to the left as often as to the right.
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
    """Distinct places of a model from left to right; gap g is the interval between places g and g + 1.

    Parameters
    ----------
    model : GuidedPathData
        The model.
    """

    model: GuidedPathData

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """Distinct coordinates in ascending order, in m."""
        return np.unique(self.model.coordinates)

    @cached_property
    def at(self) -> NDArray[np.int64]:
        """Index of the place of the start and of each customer, shape (size,)."""
        return np.searchsorted(self.places, self.model.coordinates)

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Length of each gap, in m.

        Coordinates are interpreted as their shortest decimal representation, so the length between
        0.1 and 0.3 is 0.2. Integer solvers then need few digits.
        """
        exact = [Fraction(repr(place)) for place in self.places.tolist()]
        return np.array([float(b - a) for a, b in itertools.pairwise(exact)], float)

    @cached_property
    def crossings(self) -> NDArray[np.int64]:
        """Lower bound on the number of crossings of each gap to the right."""
        before = self.before
        at, size = self.at.tolist(), self.lengths.size
        so_far = np.zeros((self.model.size, size), np.int16)
        result = np.zeros(size, np.int16)
        for c in self.model.sorted_customers:
            counts = so_far[c]
            for entry in before[c]:
                candidate = so_far[entry].copy()
                candidate[at[entry] : at[c]] += 1
                np.maximum(counts, candidate, out=counts)
            home = counts.copy()
            home[at[c] : at[0]] += 1
            np.maximum(result, home, out=result)
        return result.astype(np.int64)

    @property
    def bound(self) -> float:
        """Lower bound on the length of every tour, in m."""
        return 2.0 * float(self.lengths @ self.crossings)

    def forcing(self, gap: int) -> tuple[int, ...]:
        """Return customers on alternate sides of `gap`, each before the next, that force its crossings.

        The sequence has maximum length. Its first and last customer are on the opposite side of the
        start. It is empty if no customer forces a crossing.
        """
        before, right = self.before, (self.at > gap).tolist()
        # Largest number of changes of side up to each customer, and the customer before it.
        best: dict[int, tuple[int, int]] = {0: (0, 0)}
        for c in self.model.sorted_customers:
            best[c] = max(
                (best[entry][0] + (right[entry] != right[c]), entry) for entry in before[c]
            )
        c = max(best, key=lambda c: (best[c][0], -c))
        customers: list[int] = []
        while c:
            entry = best[c][1]
            if right[entry] != right[c]:
                customers.append(c)
            c = entry
        customers.reverse()
        # The return to the start adds the last crossing.
        return tuple(customers[:-1] if len(customers) % 2 == 0 else customers)

    @cached_property
    def before(self) -> list[list[int]]:
        """Direct predecessors of each customer; [0], the start, if it has none."""
        return [entry or [0] for entry in self.model.before]

    @cached_property
    def after(self) -> list[list[int]]:
        """Direct successors of each customer; [0], the start, if it has none."""
        return [entry or [0] for entry in self.model.after]

    def between(self, one: int, other: int) -> NDArray[np.bool_]:
        """Return a mask of the gaps between two places."""
        gap = np.arange(self.lengths.size)
        return (gap >= min(one, other)) & (gap < max(one, other))
