"""The data of a guided vehicle's tour: where its customers are, and who must precede whom."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Optional, declared
from ..labels import Ids
from .relation import Chains, chain_cover, closure_of, joined_chains, sorted_customers

__all__ = ["MOST", "GuidedPathData"]

Floats = NDArray[np.float64]

#: Customers at the most: the relation is held as a table of truth values.
MOST = 5000
#: Pairs of a relation, implied ones too, beyond which the fewest chains take minutes to find.
DENSE = 50_000


@dataclass(frozen=True, eq=False, repr=False)
class GuidedPathData(Declared):
    """What :class:`~crosstrack.models.guided_path.GuidedPathTour` asks; the fields are said there."""

    coordinates: Floats = declared(Array(("n",)))
    chains: tuple[tuple[int, ...], ...] = declared(Chains(), default=())
    precedence: NDArray[np.int64] = declared(Array(("pairs", 2), int, lower=0), default=())
    ids: tuple[int | str, ...] | None = declared(Optional(Ids()), default=None)

    def check(self) -> None:
        """Refuse customers that there are not, chains that share one, and cycles."""
        if not 2 <= self.size <= MOST + 1:
            raise InvalidData(
                f"coordinates must be those of the start and of 1 … {MOST} customers, got "
                f"{self.size} numbers",
                field="coordinates",
            )
        if not np.isfinite(4.0 * self.size * float(np.ptp(self.coordinates))):
            raise InvalidData(
                f"coordinates must be near enough to add up ways of {np.ptp(self.coordinates):g} m",
                field="coordinates",
            )
        seen: dict[int, int] = {}
        for k, chain in enumerate(self.chains):
            for place, customer in enumerate(chain):
                name = f"chains[{k}][{place}]"
                if customer >= self.size or (customer == 0 and place):
                    raise InvalidData(
                        f"{name} must lie in 1 … {self.size - 1} (0, the start, may only begin a "
                        f"chain), got {customer}",
                        field="chains",
                    )
                if customer and seen.setdefault(customer, k) != k:
                    raise InvalidData(
                        f"{name}: customer {customer} must be in one chain only, it is in chains "
                        f"{seen[customer]} and {k}: state further pairs as precedence",
                        field="chains",
                    )
                if chain.index(customer) != place:
                    raise InvalidData(
                        f"{name}: customer {customer} must be in the chain once", field="chains"
                    )
        for row, (before, after) in enumerate(self.precedence.tolist()):
            for column, customer in enumerate((before, after)):
                if not column <= customer < self.size:
                    raise InvalidData(
                        f"precedence[{row}, {column}] must lie in {column} … {self.size - 1}, got "
                        f"{customer}",
                        field="precedence",
                    )
        # Computed here, for it refuses cycles.
        _ = self.sorted_customers

    @property
    def size(self) -> int:
        """Customers and the start, which is number 0."""
        return len(self.coordinates)

    def label(self, customer: int) -> str:
        """Return what a customer is called: its id, where it has one."""
        return str(customer if self.ids is None else self.ids[customer])

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Who must directly precede whom, of chains and precedence, each pair once and sorted."""
        links = itertools.chain.from_iterable(map(itertools.pairwise, self.chains))
        given = map(tuple, self.precedence.tolist())
        return tuple(sorted({(a, b) for a, b in (*links, *given) if a}))

    @cached_property
    def sorted_customers(self) -> tuple[int, ...]:
        """The customers such that whoever must precede comes first."""
        return sorted_customers(self.size, self.pairs)

    @cached_property
    def closure(self) -> NDArray[np.bool_]:
        """Whether i must precede j, directly or through others, shape (size, size)."""
        found = closure_of(self.size, self.pairs, self.sorted_customers)
        found.flags.writeable = False
        return found

    @cached_property
    def cover(self) -> tuple[tuple[int, ...], ...]:
        """The fewest chains that hold each customer once, or few where the relation is large."""
        pairs = self.pairs
        plain = len(pairs) == len(dict(pairs)) == len({after for _, after in pairs})
        if plain or self.closure.sum() > DENSE:
            return joined_chains(self.size, pairs, self.sorted_customers)
        return chain_cover(self.closure, self.sorted_customers)
