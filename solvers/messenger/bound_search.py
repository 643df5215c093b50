"""Branch and bound by insertion: the shortest tour without curvature, over all orders.

A node is an order of some of the vehicles. The length of the shortest path that meets these in this
order is a lower bound for every tour that also meets the others in between. The search branches on
a vehicle that this path misses: one child per place in the order. A path that misses none is a
tour. The initial bound of a child is proven by its parent's directions with those of two legs
replaced. A child is solved only when it has the smallest bound of the open nodes.
"""

from __future__ import annotations

import heapq
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import chase
from ...models.messenger.relaxation import Field
from .bound_conic import Chains, Path
from .bound_kernels import insertions, tabulate

__all__ = ["Guide", "OrderSearch", "Ordered", "best_orders", "guide"]

Floats = NDArray[np.float64]

#: Tolerance of an encounter, relative to the radius plus the unit of the field.
NEAR = 1e-9
#: Number of expanded nodes between two dives for a tour.
DIVE_EVERY = 40
#: Number of most-missed vehicles among which the branching vehicle is selected.
CANDIDATES = 12


class Ordered(NamedTuple):
    """Tour without curvature limit, and the places of its encounters, shape (n, 2), in m."""

    length: float
    order: tuple[int, ...]
    points: Floats


class Guide(NamedTuple):
    """Poses suggested by the dual solution of the `bound` (m) of an order.

    `offsets` (k, 2), in m, and `headings` (k,), in rad, are those of the UAV relative to the vehicles.
    """

    bound: float
    offsets: Floats
    headings: Floats


@dataclass(order=True)
class _Node:
    """Node of the search; ties of the bound are resolved in favour of more complete orders."""

    bound: float
    lacking: int
    number: int
    order: tuple[int, ...]
    path: Path | None = None


class OrderSearch:
    """Branch and bound over orders, which can be stopped and inspected between two steps.

    Orders whose bound reaches the length `cutoff` (m) are discarded. `tours` are those found, by order. `curved` bounds
    use the limit on curvature and yield no tours, but `orders`, the complete ones with their bounds (m). `made` and
    `expanded` are numbers of nodes.
    """

    def __init__(
        self, model: MessengerTour, cutoff: float = math.inf, *, curved: bool = False
    ) -> None:
        self.chains = Chains(model, curved)
        self.field = self.chains.field
        self.tours: dict[tuple[int, ...], Ordered] = {}
        self.orders: list[tuple[float, tuple[int, ...]]] = []
        self.made = self.expanded = 0
        # The reverse of a closed tour at rest has the same length, but another heading at its
        # start.
        headed = self.chains.curved and model.heading is not None
        self._mirrored = model.closed and model.at_rest and not headed
        self._cutoff = cutoff / self.field.unit
        #: Smallest bound of the nodes that are closed but not expanded.
        self._settled = math.inf
        # Dives serve to find tours.
        self._dive_every = sys.maxsize if self.chains.curved else DIVE_EVERY
        first = (self._outermost(),) if self.field.free else ()
        self._open = [_Node(0.0, self.field.size, 0, first)]

    @property
    def bound(self) -> float:
        """Lower bound proven so far, in m."""
        lower = self._open[0].bound if self._open else math.inf
        return min(lower, self._settled, self._cutoff) * self.field.unit

    @property
    def best(self) -> Ordered | None:
        """Shortest tour found, or None."""
        return min(self.tours.values(), key=lambda tour: tour.length, default=None)

    def run(self, stopped: Callable[[], bool], rising: Callable[[float], Any], gap: float) -> bool:
        """Search until the bound is within the relative `gap` of the best tour; return True if it is.

        The result is False if `stopped`, called before each path is solved, ended the search.
        `rising` receives the bound, in m.
        """
        dive = self._dive_every if self.chains.curved else 0
        while self._open:
            if stopped():
                return False
            node = self._open[0]
            rising(self.bound)
            best = self.best
            if best is not None and self.bound >= best.length * (1 - gap):
                return True
            if self.bound >= min(self._cutoff, self._settled * (1 - gap)) * self.field.unit:
                return True
            if node.path is None:
                heapq.heapreplace(self._open, self._solve_node(node))
                continue
            heapq.heappop(self._open)
            children = self._children(node)
            while dive <= 0 and children:
                if stopped():
                    break
                node = heapq.heappop(children)
                if node.path is None:
                    heapq.heappush(children, self._solve_node(node))
                    continue
                # A dive expands this node next; its siblings stay open.
                for child in children:
                    heapq.heappush(self._open, child)
                children = self._children(node)
            if dive <= 0:
                dive = self._dive_every
            dive -= 1
            for child in children:
                heapq.heappush(self._open, child)
        return True

    def _solve_node(self, node: _Node) -> _Node:
        path = self.chains.solve(self.field.chain(node.order))
        bound = max(node.bound, path.bound)
        return _Node(bound, node.lacking, node.number, node.order, path)

    def _children(self, node: _Node) -> list[_Node]:
        """Return the children of `node` as a heap; store a node without missed vehicles as a tour."""
        field, path = self.field, node.path
        assert path is not None
        n = field.size
        missed, where = _find_misses(field, path)
        data = self.chains.data
        missed[list(node.order)] = -math.inf
        # With the curvature limit, vehicles on the path also add turns, so every vehicle is
        # inserted.
        near = -math.inf if self.chains.curved else NEAR
        left = np.flatnonzero(missed > near * (field.radii[:n] + 1.0))
        left = left[np.argsort(-missed[left], kind="stable")[:CANDIDATES]]
        if not left.size:
            self._settled = min(self._settled, node.bound)
            if self.chains.curved:
                self.orders.append((node.bound * field.unit, node.order))
            else:
                self._keep(node, where)
            return []
        self.expanded += 1
        stops = field.chain(node.order)
        legs = len(stops) - 1
        places = 1 if self._mirrored and legs <= 2 else legs + (not self.field.closed)
        worst: Floats = np.zeros(places)
        chosen, score = -1, (-math.inf, -math.inf)
        for vehicle in left.tolist():
            bounds = np.empty(places)
            insertions(data, stops, path.directions, path.points, path.times, vehicle, bounds)
            bounds = np.maximum(bounds, node.bound)
            candidate = (float(bounds.min()), float(missed[vehicle]))
            if candidate > score:
                chosen, score, worst = vehicle, candidate, bounds
        children = []
        # Without a fixed start, the first vehicle of the order stays first.
        shift = int(field.free)
        for place, bound in enumerate(worst.tolist()):
            self.made += 1
            position = place + shift
            order = (*node.order[:position], chosen, *node.order[position:])
            if bound < self._cutoff:
                children.append(_Node(bound, node.lacking - 1, self.made, order))
            else:
                self._settled = min(self._settled, bound)
        heapq.heapify(children)
        return children

    def _keep(self, node: _Node, where: Floats) -> None:
        """Store the path of `node` as a tour."""
        path = node.path
        assert path is not None
        field = self.field
        shift = 0.0 if field.free else 1.0
        known = {vehicle: k + shift for k, vehicle in enumerate(node.order)}
        at = {k: known.get(k, float(where[k])) for k in range(field.size)}
        order = tuple(sorted(at, key=lambda k: at[k]))
        if order not in self.tours:
            self.tours[order] = fly_path(field, order, path, [at[k] for k in order])

    def _outermost(self) -> int:
        """Return the vehicle whose disc is farthest from the origin of the field."""
        apart = np.hypot(*self.field.centres[:-1].T) - self.field.radii[:-1]
        return int(apart.argmax())


@np.errstate(all="ignore")  # overflow yields inf or NaN, which is not a closest approach
def _find_misses(field: Field, path: Path) -> tuple[Floats, Floats]:
    """Return the distance of a path to every disc, and leg plus share of it at the closest approach."""
    vehicles = slice(field.size)
    driven = field.velocities[vehicles] * path.times[:, None, None]
    apart = path.points[:, None] - field.centres[vehicles] - driven
    begin, step = apart, np.zeros_like(apart)
    if len(apart) > 1:
        begin, step = apart[:-1], np.diff(apart, axis=0)
    span = (step**2).sum(axis=-1)
    share = np.clip(-(begin * step).sum(axis=-1) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
    away = np.linalg.norm(begin + share[..., None] * step, axis=-1) - field.radii[vehicles]
    away[np.isnan(away)] = np.inf
    leg, rows = away.argmin(axis=0), np.arange(field.size)
    return away[leg, rows], leg + share[leg, rows]


def fly_path(field: Field, order: tuple[int, ...], path: Path, at: list[float]) -> Ordered:
    """Return the tour through a path's points, relative to the vehicles, at full speed.

    `at` is the leg of the path plus the share of it at the encounter with each vehicle of `order`.
    """
    legs = len(path.times) - 1
    place = np.zeros(2) if not field.free else np.empty(0)
    clock, points = 0.0, []
    for vehicle, share in zip(order, at, strict=True):
        k = min(int(share), max(legs - 1, 0))
        part = share - k
        later = min(k + 1, legs)
        point = path.points[k] + part * (path.points[later] - path.points[k])
        now = path.times[k] + part * (path.times[later] - path.times[k])
        velocity, radius = field.velocities[vehicle], field.radii[vehicle]
        offset = point - field.centres[vehicle] - velocity * now
        offset *= min(1.0, radius / max(float(np.hypot(*offset)), 1e-300))
        target = field.centres[vehicle] + offset
        if not place.size:
            place = target
        ahead = target + velocity * clock - place
        clock += float(chase(ahead, velocity, 1.0))
        place = target + velocity * clock
        points.append(place)
    length = clock
    if field.closed:
        home = points[0] if field.free else np.zeros(2)
        drift = np.zeros(2) if field.free else field.velocities[-1]
        length += float(chase(home + drift * length - place, drift, 1.0))
    return Ordered(length * field.unit, order, np.array(points) * field.unit + field.origin)


def best_orders(
    model: MessengerTour, stopped: Callable[[OrderSearch], bool], *, gap: float = 1e-6
) -> list[tuple[tuple[int, ...], float]]:
    """Return the orders found, and their increasing lengths without curvature limit, in m.

    The search ends if `stopped`, called with the search before each path is solved, returns True, or
    if the best order is proven within the relative `gap`.
    """
    search = OrderSearch(model)
    search.run(lambda: stopped(search), lambda bound: None, gap)
    tours = sorted(search.tours.values(), key=lambda ordered: ordered.length)
    return [(ordered.order, ordered.length) for ordered in tours]


def guide(model: MessengerTour, order: Sequence[int]) -> Guide:
    """Return poses at which a flight in a given order nearly attains its bound.

    The encounter is on the boundary of the disc, opposite to the dual force, and its heading
    bisects the directions of the legs. The result is exact if the bound is exact; otherwise it is
    an initial guess for a search. `order` has at least one vehicle, and each at most once.
    """
    chains = Chains(model, curved=True)
    field = chains.field
    stops = field.chain(order)
    path = chains.solve(stops)
    table = np.empty((len(stops) - 1, 6))
    tabulate(chains.data, stops, path.directions, table)
    ahead, weights = table[:, :2], table[:, 2:3]
    # Direction after each stop. After the last stop: none, or the first leg of a closed tour.
    after = np.roll(ahead, -1, axis=0)
    heavy = np.roll(weights, -1, axis=0)
    if stops[0] != stops[-1]:
        after[-1], heavy[-1] = ahead[-1], 0.0
    pull = weights * ahead - heavy * after
    turn = ahead + after
    rows = np.arange(len(order)) - int(field.free)  # the first stop is that after the last leg
    size = np.hypot(*pull.T)[rows, None]
    met = stops[1:][rows]
    near = (
        path.points[1:][rows]
        - field.centres[met]
        - field.velocities[met] * path.times[1:][rows, None]
    )
    if field.free:
        near[0] = path.points[0] - field.centres[met[0]]
    away = -field.radii[met][:, None] * pull[rows] / np.maximum(size, 1e-300)
    # A stop without dual force is met on the path.
    offsets = np.where(size > 1e-7, away, near) * field.unit
    bound = path.bound * field.unit
    return Guide(bound, offsets, np.arctan2(turn[rows, 1], turn[rows, 0]))
