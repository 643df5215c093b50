"""Arc-flow program of a route with resources, with one block of levels per resource.

The columns are x_a (arc a used) and u_a (level of a resource on leaving the tail of a, 0 for unused
arcs). For an arc a from i to j that adds c_a to the resource:

* the head's limit bounds the level, ``u_a <= (limit of j - c_a) x_a``, and so does the least possible level
  on leaving i, ``u_a >= least_i x_a``;
* at a point without reset, the level on leaving is at least the level on arrival: the sum of u over
  the outgoing arcs is at least the sum of ``u + c x`` over the incoming arcs. No big M is needed;
* a point that resets to 0, or to a value below every arrival, needs neither columns nor rows;
* a point that resets to at most r, with a limit L > r, has a binary z for the minimum: the level on
  leaving is at least ``arrival - (L - r) z`` and at least ``r z``. As the arrival is at most L, z = 1
  requires r, and z = 0 the arrival;
* waiting raises a level: ``u_a >= floor_i x_a``;
* a resource that nothing resets, and whose limit is least at the end, needs no levels: one knapsack row bounds
  the sum of ``c_a x_a``. A lower limit at the end bounds the same sum from below;
* with negative lengths or lower limits, the number of arcs up to a point is a further level, which allows no
  separate cycle;
* at most one arc leaves a point, and the same number arrives.

Integral x decomposes into one route from start to end and separate cycles. The objective includes the
cycles; :meth:`ResourceFlowFormulation.decode` drops them. Along the route the levels are upper bounds
of the true ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ..formulation import Formulation
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .arcs import UsedArcs, least_levels, possible_arcs, shortest_ways
from .checks import walk_route
from .model import ResourceRouting
from .route import Route
from .routes import follow, refuse_revisits, require_positive, require_route

__all__ = ["ResourceFlowFormulation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class _Levels(NamedTuple):
    """Data of the columns of one resource.

    `carrying` are the arcs with a level column, with bounds `least` and `room` on their levels; `constant` is the
    level of each other arc when used. `either` are the points with a binary, because the arrival may be above or
    below the reset, and `most` the largest level on arrival there.
    """

    resource: int
    carrying: Ints
    room: Floats
    constant: Floats
    either: Ints
    most: Floats
    least: Floats


@dataclass(frozen=True, eq=False)
class ResourceFlowFormulation(Formulation[Any, Route]):
    """Program of the arcs that the limits allow, with the level of each resource on them.

    Parameters
    ----------
    model : ResourceRouting
        The model; ``revisits`` must be off.
    length_bound : float, optional
        Length of a verified route; arcs that only longer routes can use are omitted.

    Raises
    ------
    UnsupportedFormulation
        The model allows revisits, asks for several routes, or has too many arcs, or a lower limit applies to a
        resource that waits or is reset, or at a point other than the end.
    UnsupportedOption
        `length_bound` is not a positive number.
    """

    length_bound: float | None = None

    name: ClassVar[str] = "arc-flow"
    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    summary: ClassVar[str] = "possible arcs only, levels carried on arcs, no big M"

    def __post_init__(self) -> None:
        refuse_revisits(self._routing, self.name)
        require_positive(self.name, length_bound=self.length_bound)
        model = self._routing
        for k, resource in enumerate(model.resources):
            word = model.kinds[model.end]
            covered = {word} if k in self._kept and model.kinds.count(word) == 1 else set()
            if not {kind for kind, value in resource.lower_limits if value} <= covered:
                raise UnsupportedFormulation(
                    f"formulation {self.name!r} has lower limits at the end alone, of resources that neither "
                    f"wait nor are reset, but resources[{k}] ({resource.name!r}) has others; use a native backend"
                )

    @cached_property
    def _routing(self) -> ResourceRouting:
        """Routing problem of the program."""
        model: ResourceRouting = self.model
        return model

    @cached_property
    def _kept(self) -> tuple[int, ...]:
        """Resources without resets and floors."""
        return tuple(
            k
            for k in range(len(self._routing.resources))
            if np.isinf(self._routing.resets[:, k]).all() and not self._routing.floors[:, k].any()
        )

    @cached_property
    def _ordered(self) -> bool:
        """Whether the program must exclude separate cycles."""
        model = self._routing
        return model.has_prizes or bool(model.lower_limits.any())

    @cached_property
    def _knapsacks(self) -> tuple[int, ...]:
        """Resources whose levels one row replaces."""
        model = self._routing
        limit = model.limits[model.codes]
        least = limit[model.end]
        return tuple(
            k for k in self._kept if np.isfinite(least[k]) and least[k] <= limit[:, k].min()
        )

    def bounded(self, objective: float) -> Self:
        """Return the formulation without arcs that only routes longer than `objective` can use."""
        return replace(self, length_bound=objective) if objective > 0 else self

    @cached_property
    def arcs(self) -> UsedArcs:
        """Arcs with columns in the program."""
        bound = np.inf if self.length_bound is None else self.length_bound
        arcs = possible_arcs(self._routing, bound)
        if self._ordered:
            arcs = replace(arcs, use=np.column_stack([arcs.use, np.ones(len(arcs))]))
        return arcs

    @cached_property
    def floor(self) -> float:
        """Length of the shortest path from start to end over the possible arcs."""
        model, arcs = self._routing, self.arcs
        if model.has_prizes:
            return -np.inf
        ahead, _ = shortest_ways(
            len(model.kinds), model.start, model.end, arcs.tail, arcs.head, arcs.length
        )
        least = float(ahead[model.end])
        # The sparse graph stores lengths of 0 as the smallest positive number.
        return -np.inf if math.isinf(least) else 0.0 if least < 1e-290 else least

    @cached_property
    def _levels(self) -> tuple[_Levels, ...]:
        return tuple(
            self._columns(k)
            for k in range(len(self._routing.resources))
            if np.isfinite(self._routing.limits[:, k]).any() and k not in self._knapsacks
        ) + ((self._order(),) if self._ordered else ())

    def _order(self) -> _Levels:
        """Return the columns of the number of arcs up to each point."""
        arcs, none = self.arcs, np.empty(0, np.int64)
        carrying = np.flatnonzero(arcs.tail != self._routing.start)
        room = np.full(carrying.size, max(len(self._routing.kinds) - 2.0, 0.0))
        return _Levels(
            len(self._routing.resources), carrying, room, np.zeros(len(arcs)), none, np.empty(0),
            np.ones(carrying.size),
        )  # fmt: skip

    def _columns(self, k: int) -> _Levels:
        model, arcs = self._routing, self.arcs
        n = len(model.kinds)
        limit = model.rounded_limits[model.codes, k]
        reset = model.resets[model.codes, k]
        # The sum of the largest uses into all points bounds the level of a simple route.
        largest = np.zeros(n)
        np.maximum.at(largest, arcs.head, arcs.use[:, k])
        most = np.minimum(limit, model.initial[k] + model.floors[:, k].max() + largest.sum())
        leaving = least_levels(model, self._with_uses)[:, k]
        least = np.full(n, np.inf)
        np.minimum.at(least, arcs.head, leaving[arcs.tail] + arcs.use[:, k])
        inner = np.ones(n, bool)
        inner[[model.start, model.end]] = False
        # If every arrival is above the reset, the level on leaving is the reset.
        known = np.where(inner & (least >= reset), reset, np.inf)
        known[model.start] = model.initial[k]
        constant = np.where(np.isfinite(known), known, 0.0)[arcs.tail]
        carrying = np.flatnonzero(np.isinf(known[arcs.tail]))
        room = np.minimum(
            most[arcs.head[carrying]] - arcs.use[carrying, k],
            np.minimum(most, reset)[arcs.tail[carrying]],
        )
        either = np.flatnonzero(inner & np.isinf(known) & (reset < most))
        return _Levels(
            k, carrying, np.maximum(room, 0.0), constant, either, most[either],
            leaving[arcs.tail[carrying]],
        )  # fmt: skip

    @cached_property
    def _with_uses(self) -> UsedArcs:
        """Arcs without the column of the order."""
        return replace(self.arcs, use=self.arcs.use[:, : len(self._routing.resources)])

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the module's docstring."""
        model, arcs = self._routing, self.arcs
        n = len(model.kinds)
        index = np.column_stack([arcs.tail, arcs.head])
        inner = np.setdiff1d(np.arange(n), [model.start, model.end])
        place = np.full(n, -1)
        place[inner] = np.arange(inner.size)
        b = ProgramBuilder()
        x = b.columns(
            "arc used", len(arcs), upper=1, cost=arcs.length, integral=True,
            template="arc {0}-{1}", index=index,
        )  # fmt: skip
        out, into = arcs.tail == model.start, arcs.head == model.end
        b.rows("one arc out of the start", 1, (0, x[out], 1.0), lower=1, upper=1)
        b.rows("one arc into the end", 1, (0, x[into], 1.0), lower=1, upper=1)
        heads, tails = place[arcs.head] >= 0, place[arcs.tail] >= 0
        b.rows(
            "arcs in and out", inner.size,
            (place[arcs.head[heads]], x[heads], 1.0), (place[arcs.tail[tails]], x[tails], -1.0),
            lower=0, upper=0, template="at point {0}", index=inner,
        )  # fmt: skip
        b.rows(
            "visited at most once", inner.size, (place[arcs.tail[tails]], x[tails], 1.0),
            upper=1, template="at point {0}", index=inner,
        )  # fmt: skip
        for k in range(len(model.resources)):
            low = float(model.lower_limits[model.codes[model.end], k])
            if k in self._knapsacks or (low and k in self._kept):
                high = model.rounded_limits[model.codes[model.end], k] - model.initial[k]
                low -= model.initial[k]
                b.rows(
                    f"{model.resources[k].name} of the route", 1, (0, x, arcs.use[:, k]),
                    lower=low if low > 0 else -np.inf, upper=high, unit=model.resources[k].unit,
                )  # fmt: skip
        for levels in self._levels:
            self._add(b, levels, x, index)
        self._add_rows(b, x)
        return b.build(name=f"{model.name}:arc-flow" if model.name else "arc-flow")

    def _add_rows(self, b: ProgramBuilder, x: Ints) -> None:
        """Add further rows on the used arcs, for programs of other problems."""

    def _add(self, b: ProgramBuilder, levels: _Levels, x: Ints, index: Ints) -> None:
        """Add the columns and rows of one resource."""
        model, arcs = self._routing, self.arcs
        k, carrying, room, constant, either, most, least = levels
        is_order = k == len(model.resources)
        name, unit = (
            ("order", "") if is_order else (model.resources[k].name, model.resources[k].unit)
        )
        u = b.columns(
            f"{name} carried", carrying.size, upper=room, template="on arc {0}-{1}",
            index=index[carrying], unit=unit,
        )  # fmt: skip
        z = b.columns(
            f"{name} reset", either.size, upper=1, integral=True, template="at point {0}",
            index=either,
        )  # fmt: skip
        entry = np.arange(carrying.size)
        b.rows(
            f"{name} within limits", carrying.size, (entry, u, 1.0), (entry, x[carrying], -room),
            upper=0, template="along arc {0}-{1}", index=index[carrying], unit=unit,
        )  # fmt: skip
        some = np.flatnonzero(least > 0.0)
        b.rows(
            f"{name} gained at least", some.size, (np.arange(some.size), u[some], 1.0),
            (np.arange(some.size), x[carrying[some]], -least[some]), lower=0,
            template="along arc {0}-{1}", index=index[carrying[some]], unit=unit,
        )  # fmt: skip
        reset = np.full(len(model.kinds), np.inf) if is_order else model.resets[model.codes, k]
        tails_with_level = np.unique(arcs.tail[carrying])
        place = np.full(len(model.kinds), -1)
        place[tails_with_level] = np.arange(tails_with_level.size)
        into = np.flatnonzero(place[arcs.head] >= 0)
        carried = np.flatnonzero(place[arcs.head[carrying]] >= 0)
        use = arcs.use[:, k] + constant
        tails = arcs.tail[carrying]
        b.rows(
            f"{name} kept", tails_with_level.size, (place[tails], u, 1.0),
            (place[arcs.head[carrying[carried]]], u[carried], -1.0),
            (place[arcs.head[into]], x[into], -use[into]),
            (place[either], z, most - reset[either]),
            lower=0, template="at point {0}", index=tails_with_level, unit=unit,
        )  # fmt: skip
        spot = np.full(len(model.kinds), -1)
        spot[either] = np.arange(either.size)
        at_resets = np.flatnonzero(spot[tails] >= 0)
        b.rows(
            f"{name} left by a reset", either.size, (spot[tails[at_resets]], u[at_resets], 1.0),
            (np.arange(either.size), z, -reset[either]), lower=0, template="at point {0}",
            index=either, unit=unit,
        )  # fmt: skip

    def encode(self, plan: Route) -> Floats:
        """Return the columns of a simple route; raise for an excluded arc."""
        model, arcs = self._routing, self.arcs
        route = require_route(model, plan)
        n = len(model.kinds)
        key = arcs.tail * n + arcs.head
        visits, _ = walk_route(model, plan)
        used = []
        for i, j in pairwise(route):
            arc = int(np.searchsorted(key, i * n + j))
            if arc == len(key) or key[arc] != i * n + j:
                raise InvalidData(
                    f"arc {i}-{j} of the route is excluded by limits or length_bound", field="route"
                )
            used.append(arc)
        point = np.zeros(len(arcs))
        point[used] = 1.0
        parts = [point]
        for levels in self._levels:
            carried, resets = np.zeros(len(arcs)), np.zeros(n)
            if levels.resource == len(model.resources):
                carried[used] = np.arange(len(used))
                parts.append(carried[levels.carrying])
                continue
            for arc, visit in zip(used, visits, strict=False):
                carried[arc] = visit.leaving[levels.resource]
            for visit in visits:
                arrival, leaving = visit.arrival[levels.resource], visit.leaving[levels.resource]
                resets[visit.point] = float(arrival > leaving)
            parts += [carried[levels.carrying], resets[levels.either]]
        return np.concatenate(parts)

    def decode(self, point: Floats) -> Route:
        """Return the route formed by the used arcs; separate cycles are dropped."""
        arcs = self.arcs
        count = len(arcs) + sum(entry.carrying.size + entry.either.size for entry in self._levels)
        if point.size != count:
            raise InvalidData(f"point must have {count} entries, got {point.size}", field="point")
        used = point[: len(arcs)] > 0.5
        return follow(self._routing, arcs.tail[used], arcs.head[used])
