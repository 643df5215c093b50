"""Data of fleet routing: nodes, distances, vehicles, limits and the objective."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import Array, Flag, NumberTuple, Optional, Real, Text, declared, frozen, show
from ..grid_path import GridMap
from ..inputs import Field, FloatsOrNone, Names, Numbers
from ..labels import Ids
from ..model import Model
from ..records import Member, Several
from .features import features_of
from .plan import FleetPlan
from .specs import (
    Count,
    Depots,
    EachVehicle,
    Loads,
    NameLists,
    NodeList,
    NodeLists,
    Prizes,
    Shifts,
    Spans,
    Windows,
    added,
)

__all__ = ["Deviation", "FleetData", "Metric", "Objective"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Maximum number of vehicles, and of nodes.
MOST = 10_000
#: Largest number of points whose distances are always stored.
LARGE = 1000
#: Number of distances computed at once, which limits the memory for differences.
BLOCK = 1 << 20
#: Weight of the sum in the lexicographic objective.
LEXICOGRAPHIC = 1e-6


class Objective(StrEnum):
    """Objective to minimise; all but the last two are functions of the route lengths L_1 … L_m."""

    SUM = "sum"  #: Σ L_k (eq. 15)
    MAX = "max"  #: max L_k
    VARIANCE = "sum-variance"  #: Σ L_k + q Y, with their variance Y (eq. 15 and 16)
    DEVIATION = "sum-deviation"  #: Σ L_k + q s, with their standard deviation s
    RANGE = "range"  #: max L_k - min L_k
    LEXICOGRAPHIC = "max-sum"  #: max L_k, then Σ L_k: max L_k + 1e-6 Σ L_k
    COST = (
        "cost"  #: fixed, distance and time costs of the used vehicles, minus the collected prizes
    )
    MAKESPAN = "makespan"  #: latest return, s


class Deviation(StrEnum):
    """Divisor of the sum of squared differences to the mean in the standard deviation."""

    SAMPLE = "sample"  #: m - 1, as in the column "Standard deviation" of Table 3
    POPULATION = "population"  #: m, so that s² is the variance of eq. 16


class Metric(StrEnum):
    """Distance of two points."""

    EUCLIDEAN = "euclidean"  #: straight line
    ROUNDED = "rounded"  #: straight line, rounded to a whole number as TSPLIB's EUC_2D
    PAPER = "paper"  #: Manhattan: eq. 14 with the unit energy of eq. 17 for every pair
    GRID = "grid"  #: shortest path on the map, along eight neighbours


@dataclass(frozen=True, eq=False, repr=False)
class FleetData(Model[FleetPlan]):
    """Fields of :class:`~crosstrack.models.fleet.model.FleetRouting`, documented there."""

    vehicles: int = declared(Count(1, MOST))
    costs: FloatsOrNone = declared(Optional(Array(("n", "n"), lower=0)), default=None)
    points: FloatsOrNone = declared(Optional(Array(("n", 2), unit="m")), default=None)
    map: Field[GridMap | Mapping[str, Any] | None, GridMap | None] = declared(
        Optional(Nested(GridMap)), default=None
    )
    metric: Field[str | None, Metric | None] = declared(Optional(Member(Metric)), default=None)
    depots: Field[Numbers, NDArray[np.int64]] = declared(Depots(("d",), int, lower=0), default=0)
    use_all: Field[bool | None, bool] = declared(Optional(Flag()), default=None)
    objective: Field[str, Objective] = declared(Member(Objective), default=Objective.MAX)
    q: float = declared(Real(lower=0), default=0.0)
    deviation: Field[str, Deviation] = declared(Member(Deviation), default=Deviation.SAMPLE)
    demands: FloatsOrNone = declared(Optional(Loads(("n",), lower=0)), default=None)
    capacity: FloatsOrNone = declared(Optional(Loads(("vehicles",), lower=0)), default=None)
    battery: FloatsOrNone = declared(Optional(EachVehicle(("vehicles",), lower=0)), default=None)
    budget: float | None = declared(Optional(Real(lower=0)), default=None)
    deviation_limit: float | None = declared(Optional(Real(lower=0)), default=None)
    range_limit: float | None = declared(Optional(Real(lower=0)), default=None)
    ids: Names = declared(Optional(Ids()), default=None)
    # Fields of rich fleets.
    times: FloatsOrNone = added(Array(("n", "n"), lower=0, unit="s"))
    speed: FloatsOrNone = added(EachVehicle(("vehicles",), lower=0))
    service: FloatsOrNone = added(Array(("n",), lower=0, unit="s"))
    windows: Field[Sequence[Any] | Numbers | None, tuple[Spans, ...] | None] = added(Windows())
    releases: FloatsOrNone = added(Array(("n",), unit="s"))
    pickups: FloatsOrNone = added(Loads(("n",), lower=0))
    backhauls: bool = declared(Flag(), added=True, default=False)
    pairs: Field[Numbers | None, Ints | None] = added(Array(("pairs", 2), int, lower=0))
    fixed_cost: FloatsOrNone = added(EachVehicle(("vehicles",), lower=0))
    distance_cost: FloatsOrNone = added(EachVehicle(("vehicles",), lower=0))
    time_cost: FloatsOrNone = added(EachVehicle(("vehicles",), lower=0))
    shifts: FloatsOrNone = added(Shifts(("vehicles", 2), infinity=1, unit="s"))
    max_duration: FloatsOrNone = added(EachVehicle(("vehicles",), lower=0, infinity=1, unit="s"))
    ends: Field[Numbers | None, Ints | None] = added(EachVehicle(("vehicles",), int, lower=-1))
    requires: NameLists = added(Several(Several(Text()), "n"))
    skills: NameLists = added(Several(Several(Text()), "vehicles"))
    prizes: FloatsOrNone = added(Prizes(("n",), lower=0))
    groups: NodeLists = added(Several(NumberTuple(("group",), int, lower=0)))
    reloads: NodeList = added(NumberTuple(("reloads",), int, lower=0))
    max_reloads: Field[Numbers | None, Ints | None] = added(
        EachVehicle(("vehicles",), int, lower=0)
    )
    stations: NodeList = added(NumberTuple(("stations",), int, lower=0))

    def check(self) -> None:
        """Fill in defaults and validate constraints between fields."""
        self._check_distances()
        if self.size > MOST:
            raise InvalidData(f"points must be at most {MOST}, got {self.size}", field="points")
        if self.depots.size not in (1, self.vehicles):
            raise InvalidData(
                f"depots must be one node, or one for each of {self.vehicles} vehicles, got "
                f"{self.depots.size}",
                field="depots",
            )
        if (self.depots >= self.size).any():
            raise InvalidData(
                f"depots must be nodes 0 … {self.size - 1}, got {int(self.depots.max())}",
                field="depots",
            )
        if self.use_all is None:
            object.__setattr__(self, "use_all", not features_of(self))
        count = len(self.customers)
        if not count:
            raise InvalidData(
                f"there must be a node to visit beside the depot, got {self.size} nodes in all",
                field="points" if self.costs is None else "costs",
            )
        if self.use_all and self.vehicles > count:
            raise InvalidData(
                f"vehicles must be at most the {count} nodes to visit if all are used, got "
                f"{self.vehicles}",
                field="vehicles",
            )
        if self.q and self.objective not in (Objective.VARIANCE, Objective.DEVIATION):
            raise InvalidData(
                "q must be 0 unless the objective is 'sum-variance' or 'sum-deviation', got objective "
                f"{str(self.objective)!r} and q {self.q:g}",
                field="q",
            )
        self._check_reachable()

    def _check_distances(self) -> None:
        if (self.costs is None) == (
            self.points is None and self.map is None
        ) and self.costs is None:
            raise InvalidData("costs or points must be given, got neither", field="costs")
        if self.costs is not None:
            if self.map is not None or self.metric is not None:
                name = "map" if self.map is not None else "metric"
                raise InvalidData(f"{name} must not be given beside costs", field=name)
            if (np.diagonal(self.costs) != 0).any():
                row = int(np.flatnonzero(np.diagonal(self.costs))[0])
                raise InvalidData(
                    f"costs[{row}, {row}] must be 0, got {self.costs[row, row]:g}", field="costs"
                )
            return
        if self.points is None:
            raise InvalidData("points must be given beside a map, got none", field="points")
        if self.metric is None:
            default = Metric.EUCLIDEAN if self.map is None else Metric.GRID
            object.__setattr__(self, "metric", default)
        if self.metric is Metric.GRID:
            if self.map is None:
                raise InvalidData("map must be given for the metric 'grid'", field="map")
            cells = self.map.cells_of(self.points)
            bad = np.flatnonzero(~self.map.holds(cells))
            if bad.size:
                k = int(bad[0])
                raise InvalidData(
                    f"points[{k}] (node {self.label(k)}) must lie in a free cell of the map, got "
                    f"{show(self.points[k].tolist())}",
                    field="points",
                )

    def _check_reachable(self) -> None:
        if self.size > LARGE and self.is_plane:
            longest = self.longest
        else:
            longest = float(np.max(self.distances, where=np.isfinite(self.distances), initial=0.0))
        if not np.isfinite(longest * 4.0 * self.size):
            raise InvalidData(
                f"distances must be small enough to add up, got {longest:g}",
                field="points" if self.costs is None else "costs",
            )
        if self.size > LARGE and self.is_plane:
            return
        unreachable = np.argwhere(~np.isfinite(self.distances))
        if unreachable.size:
            a, b = (int(x) for x in unreachable[0])
            start = int(self.depots[0])
            cut_off = np.flatnonzero(~np.isfinite(self.distances[start]))
            # Prefer nodes that the depot cannot reach.
            a, b = (start, int(cut_off[0])) if cut_off.size else (a, b)
            raise InvalidData(
                f"node {self.label(b)} cannot be reached from node {self.label(a)}",
                field="map" if self.metric is Metric.GRID else "points",
            )

    @property
    def size(self) -> int:
        """Number of nodes, depots included."""
        rows = self.points if self.costs is None else self.costs
        assert rows is not None
        return len(rows)

    @cached_property
    def customers(self) -> NDArray[np.int64]:
        """Nodes to visit: neither depots nor ends nor reloads nor stations, ascending."""
        ends = [] if self.ends is None else self.ends.tolist()
        stops = [*(self.reloads or ()), *(self.stations or ())]
        return np.setdiff1d(np.arange(self.size), [*self.depots.tolist(), *ends, *stops])

    @cached_property
    def homes(self) -> NDArray[np.int64]:
        """Depot of each vehicle, shape (vehicles,)."""
        return np.broadcast_to(self.depots, (self.vehicles,)).copy()

    @cached_property
    def finishes(self) -> NDArray[np.int64]:
        """Node at which each vehicle ends, shape (vehicles,); -1 for the last node of its route."""
        return self.homes if self.ends is None else self.ends

    def path_of(self, vehicle: int, route: Sequence[int]) -> list[int]:
        """Return the nodes of `route` from the depot of `vehicle` to its end; empty if it is idle."""
        end = int(self.finishes[vehicle])
        return [int(self.homes[vehicle]), *route, *([end] if end >= 0 else [])] if route else []

    @cached_property
    def symmetric(self) -> bool:
        """Whether all distances are the same in both directions."""
        return self.is_plane or bool(np.array_equal(self.distances, self.distances.T))

    @property
    def is_plane(self) -> bool:
        """Whether the distances follow from two points."""
        return self.costs is None and self.metric is not Metric.GRID

    @cached_property
    def longest(self) -> float:
        """Longest distance; for more than :data:`LARGE` points at least as long, from their extent."""
        if self.size <= LARGE or not self.is_plane:
            return float(self.distances.max())
        assert self.points is not None
        # Rounding of a length adds at most a half.
        return float(np.ptp(self.points, axis=0).sum()) + 0.5 * (self.metric is Metric.ROUNDED)

    def legs(self, tails: ArrayLike, heads: ArrayLike) -> Floats:
        """Return the distances from nodes `tails` to nodes `heads`, which broadcast.

        Without :attr:`distances`, which takes memory for n² numbers, they are computed from the points.
        """
        first, second = np.asarray(tails, np.int64), np.asarray(heads, np.int64)
        if "distances" in self.__dict__ or self.size <= LARGE or not self.is_plane:
            legs: Floats = self.distances[first, second]
            return legs
        assert self.points is not None
        return self.between(self.points[first], self.points[second])

    def between(self, tails: Floats, heads: Floats) -> Floats:
        """Return the distances between points by the metric."""
        apart = tails - heads
        x, y = apart[..., 0], apart[..., 1]
        if self.metric is Metric.PAPER:
            return np.asarray(np.abs(x) + np.abs(y))
        lengths: Floats = np.hypot(x, y)
        return np.floor(lengths + 0.5) if self.metric is Metric.ROUNDED else lengths

    @cached_property
    def distances(self) -> Floats:
        """Cost or distance from one node to another, shape (n, n)."""
        if self.costs is not None:
            return self.costs
        assert self.points is not None
        if self.metric is Metric.GRID:
            from ..grid_path import distances

            assert self.map is not None
            return frozen(distances(self.map, self.map.cells_of(self.points)))
        result = np.empty((self.size, self.size))
        step = max(1, BLOCK // self.size)
        for begin in range(0, self.size, step):
            block = self.between(self.points[begin : begin + step, None], self.points[begin:])
            result[begin : begin + step, begin:] = block
            result[begin:, begin : begin + step] = block.T  # distances of points are symmetric
        return frozen(result)

    @cached_property
    def round_trips(self) -> Floats:
        """Length of the shortest round trip to each customer, shape (vehicles, customers).

        Other nodes may be on the way, so no route that visits the customer is shorter.
        """
        near = np.array(self.distances)
        for k in range(self.size):
            np.minimum(near, near[:, k, None] + near[k], out=near)
        there = near[np.ix_(self.homes, self.customers)]
        return frozen(there + near[np.ix_(self.customers, self.homes)].T)

    @property
    def length_unit(self) -> str:
        """Unit of distances: "m", or empty for costs."""
        return "" if self.costs is not None else "m"

    def label(self, node: int) -> str:
        """Return the name of `node`: its id, or its index."""
        return str(node if self.ids is None else self.ids[node])
