"""Data of a guided vehicle's tour: coordinates of the customers and their precedence relation."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, declared
from ..inputs import Field, FloatArray, FloatsOrNone, Names, Numbers
from ..labels import Ids
from ..model import Model
from .plan import GuidedPathPlan
from .relation import Chains, chain_cover, closure_of, joined_chains, listed_pairs, sorted_customers
from .track import End, Track, TrackSpec

__all__ = ["MOST", "MOST_DENSE", "GuidedPathData"]


#: Maximum number of customers.
MOST = 20_000
#: Maximum number of customers of :attr:`GuidedPathData.closure`, a dense Boolean matrix of 25 MB, and of dense
#: distances in files.
MOST_DENSE = 5000
#: Number of pairs, including implied ones, above which the minimum chain cover takes minutes.
DENSE = 50_000


@dataclass(frozen=True, eq=False, repr=False)
class GuidedPathData(Model[GuidedPathPlan]):
    """Data fields of :class:`~crosstrack.models.guided_path.GuidedPathTour`, which documents them."""

    coordinates: FloatArray = declared(Array(("n",), unit="m"))
    chains: Field[Sequence[Sequence[int]], tuple[tuple[int, ...], ...]] = declared(
        Chains(), default=()
    )
    precedence: Field[Numbers, NDArray[np.int64]] = declared(
        Array(("pairs", 2), int, lower=0), default=()
    )
    ids: Names = declared(Optional(Ids()), default=None)
    end: Field[float | str | None, float | str | None] = declared(End(), default=None, added=True)
    loads: FloatsOrNone = declared(Optional(Array(("n",))), default=None, added=True)
    capacity: float | None = declared(Optional(Real(lower=0)), default=None, added=True)
    speed: float | None = declared(
        Optional(Real(lower=0, strict=True, unit="m/s")), default=None, added=True
    )
    service: FloatsOrNone = declared(
        Optional(Array(("n",), lower=0, unit="s")), default=None, added=True
    )
    windows: FloatsOrNone = declared(
        Optional(Array(("n", 2), infinity=1, unit="s")), default=None, added=True
    )
    track: Field[Any, str | Track] = declared(TrackSpec(), default="line", added=True)
    vehicles: FloatsOrNone = declared(
        Optional(Array(("vehicles",), unit="m")), default=None, added=True
    )

    def check(self) -> None:
        """Validate customer numbers, and reject chains with a common customer and cycles."""
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
        chain_of: dict[int, int] = {}
        for k, chain in enumerate(self.chains):
            for place, customer in enumerate(chain):
                name = f"chains[{k}][{place}]"
                if customer >= self.size or (customer == 0 and place):
                    raise InvalidData(
                        f"{name} must lie in 1 … {self.size - 1} (0, the start, may only begin a "
                        f"chain), got {customer}",
                        field="chains",
                    )
                if (other := chain_of.get(customer, k)) != k:
                    raise InvalidData(
                        f"{name}: customer {customer} must be in one chain only, it is in chains "
                        f"{other} and {k}: state further pairs as precedence",
                        field="chains",
                    )
                if customer in chain_of:
                    raise InvalidData(
                        f"{name}: customer {customer} must be in the chain once", field="chains"
                    )
                if customer:
                    chain_of[customer] = k
        for row, column in np.argwhere((self.precedence < [0, 1]) | (self.precedence >= self.size))[
            :1
        ].tolist():
            raise InvalidData(
                f"precedence[{row}, {column}] must be in {column} … {self.size - 1}, got "
                f"{self.precedence[row, column]}",
                field="precedence",
            )
        # Computed here because it rejects cycles.
        _ = self.sorted_customers

    @property
    def size(self) -> int:
        """Number of customers plus 1 for the start, which has number 0."""
        return len(self.coordinates)

    def label(self, customer: int) -> str:
        """Return the name of `customer`: its id, or its number if the model has no ids."""
        return str(customer if self.ids is None else self.ids[customer])

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Coordinates in m; in a tree the distances from node 0, for pictures, shape (n + 1,)."""
        if isinstance(track := self.track, Track) and track.edges:
            ways = [
                min(float(track.nodes[0, node]) + way for node, way in track.ends(k, float(x)))
                for k, x in enumerate(self.coordinates)
            ]
            return np.array(ways)
        return self.coordinates

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """Direct precedence pairs of chains and precedence, without duplicates and sorted, shape (p, 2)."""
        chained = [pair for chain in self.chains for pair in itertools.pairwise(chain)]
        every = np.concatenate([np.array(chained, np.int64).reshape(-1, 2), self.precedence])
        codes = np.sort(every[:, 0] * self.size + every[:, 1])
        before, after = np.divmod(codes[np.diff(codes, prepend=-1) > 0], self.size)
        links = np.column_stack([before, after])[before > 0]
        links.flags.writeable = False
        return links

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The rows of `links`."""
        return tuple(map(tuple, self.links.tolist()))

    @cached_property
    def before(self) -> list[list[int]]:
        """Direct predecessors of each customer in ascending order; entry 0 is empty."""
        return listed_pairs(self.size, self.links[:, ::-1])

    @cached_property
    def after(self) -> list[list[int]]:
        """Direct successors of each customer in ascending order; entry 0 is empty."""
        return listed_pairs(self.size, self.links)

    @property
    def is_disjoint(self) -> bool:
        """Whether the relation consists of disjoint chains."""
        return all(len(entry) <= 1 for entry in (*self.before, *self.after))

    @cached_property
    def sorted_customers(self) -> tuple[int, ...]:
        """Customers in a topological order of the relation."""
        return sorted_customers(self.before, self.after)

    @cached_property
    def closure(self) -> NDArray[np.bool_]:
        """Transitive closure: True if i must precede j, directly or indirectly, shape (size, size).

        Raises :class:`InvalidData` for more than `MOST_DENSE` customers.
        """
        if self.size > MOST_DENSE + 1:
            raise InvalidData(
                f"closure is available for at most {MOST_DENSE} customers, got {self.size - 1}: use pairs",
                field="precedence",
            )
        matrix = closure_of(self.after, self.sorted_customers)
        matrix.flags.writeable = False
        return matrix

    @cached_property
    def cover(self) -> tuple[tuple[int, ...], ...]:
        """Minimum chain cover of the customers; a small, not minimum one if the relation is large."""
        if self.is_disjoint or self.size > MOST_DENSE + 1 or self.closure.sum() > DENSE:
            return joined_chains(self.before, self.sorted_customers)
        return chain_cover(self.closure, self.sorted_customers)
