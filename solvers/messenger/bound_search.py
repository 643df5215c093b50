"""Branch and bound by insertion: the shortest tour without curvature, over all orders.

A node is an order of some of the vehicles. The shortest path that meets these in this order is no
longer than any tour that does so and meets the others in between, so its length bounds all of them.
A vehicle that this path misses is met somewhere in between: one child a place. A path that misses
none is a tour. Children first have the bound that their parent's path proves with two legs turned,
and are solved only when no other node has a smaller one.
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
from ...models.messenger.relaxation import Field
from .bound_conic import Chains, Path
from .bound_kernels import insertions, misses
from .splice_kernels import tabulated

__all__ = ["Guide", "OrderSearch", "Ordered", "best_orders", "guide"]

Floats = NDArray[np.float64]

#: By how much a path may miss a vehicle, in its radius and in the field, and count as meeting it.
NEAR = 1e-9
#: Nodes whose children are made before the search goes for a tour again, straight down.
DIVE_EVERY = 40
#: Vehicles, the most missed ones, among which the next one to insert is chosen.
CANDIDATES = 12


class Ordered(NamedTuple):
    """A tour without curvature, flown at full speed.

    Parameters
    ----------
    length : float
        m.
    order : tuple of int
        All vehicles, as they are met.
    points : ndarray, shape (n, 2)
        Where, m.
    times : ndarray, shape (n,)
        When, in the length that is flown until then, m.
    """

    length: float
    order: tuple[int, ...]
    points: Floats
    times: Floats


class Guide(NamedTuple):
    """Where the proof of an order's bound says that a flight should go.

    Parameters
    ----------
    bound : float
        m; no flight that meets the vehicles in this order is shorter.
    offsets : ndarray, shape (k, 2)
        From each vehicle of the order, in that order, to where it is met, m.
    headings : ndarray, shape (k,)
        There, rad.
    """

    bound: float
    offsets: Floats
    headings: Floats


@dataclass(order=True)
class _Node:
    """An order of some vehicles; of equal bounds, the one that lacks fewer comes first."""

    bound: float
    lacking: int
    number: int
    order: tuple[int, ...]
    path: Path | None = None


class OrderSearch:
    """The search; it may be stopped and looked at between any two steps.

    Parameters
    ----------
    model : MessengerTour
        Whose curvature is left out.
    cutoff : float
        In m: orders whose tours are no better are left out.
    curved : bool
        Whether bounds make use of the limit on curvature. Then no tour is met.

    Attributes
    ----------
    tours : dict of tuple to Ordered
        The tours met, by their orders; none where bounds are `curved`.
    orders : list of tuple
        Where they are, the orders of all vehicles that were met instead: bound, m, and order.
    made, expanded : int
        Nodes made, and nodes whose children were made.
    """

    def __init__(
        self,
        model: MessengerTour,
        cutoff: float = math.inf,
        *,
        curved: bool = False,
    ) -> None:
        self.chains = Chains(model, curved)
        self.field = self.chains.field
        self.tours: dict[tuple[int, ...], Ordered] = {}
        self.orders: list[tuple[float, tuple[int, ...]]] = []
        self.made = self.expanded = 0
        # Flown backwards, a closed tour at rest is as long, but has the other heading at its start.
        headed = self.chains.curved and model.heading is not None
        self._mirrored = model.closed and model.at_rest and not headed
        self._cutoff = cutoff / self.field.unit
        #: The smallest bound of what is neither open nor divided any further.
        self._settled = math.inf
        # Dives are for tours.
        self._dive_every = sys.maxsize if self.chains.curved else DIVE_EVERY
        first = (self._outermost(),) if self.field.free else ()
        self._open = [_Node(0.0, self.field.size, 0, first)]

    @property
    def bound(self) -> float:
        """What is proven so far, m: no tour is shorter."""
        least = self._open[0].bound if self._open else math.inf
        return min(least, self._settled, self._cutoff) * self.field.unit

    @property
    def best(self) -> Ordered | None:
        """The shortest tour met."""
        return min(self.tours.values(), key=lambda one: one.length, default=None)

    def run(self, stopped: Callable[[], bool], rising: Callable[[float], Any], gap: float) -> bool:
        """Search until the bound is within `gap` of the best tour; return whether it is.

        Parameters
        ----------
        stopped : callable
            Asked before every path that is solved.
        rising : callable
            Told of the bound, m.
        gap : float
            Relative.
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
                heapq.heapreplace(self._open, self._solved(node))
                continue
            heapq.heappop(self._open)
            children = self._children(node)
            while dive <= 0 and children:
                if stopped():
                    break
                node = heapq.heappop(children)
                if node.path is None:
                    heapq.heappush(children, self._solved(node))
                    continue
                # The others stay open; this one is divided at once.
                for one in children:
                    heapq.heappush(self._open, one)
                children = self._children(node)
            if dive <= 0:
                dive = self._dive_every
            dive -= 1
            for one in children:
                heapq.heappush(self._open, one)
        return True

    def _solved(self, node: _Node) -> _Node:
        path = self.chains.solve(self.field.chain(node.order))
        bound = max(node.bound, path.bound)
        return _Node(bound, node.lacking, node.number, node.order, path)

    def _children(self, node: _Node) -> list[_Node]:
        """Return the nodes that `node` is divided into, as a heap; a tour has none, and is kept."""
        field, path = self.field, node.path
        assert path is not None
        n = field.size
        missed, where = np.empty(n), np.empty(n)
        data = self.chains.data
        misses(*data[:3], path.points, path.times, missed, where)
        missed[list(node.order)] = -math.inf
        # With a limit on curvature a vehicle that the path without one meets costs turns, too.
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
            insertions(*data, stops, path.directions, path.points, path.times, vehicle, bounds)
            bounds = np.maximum(bounds, node.bound)
            found = (float(bounds.min()), float(missed[vehicle]))
            if found > score:
                chosen, score, worst = vehicle, found, bounds
        children = []
        # Without a start the first vehicle of the order stays the first.
        shift = int(field.free)
        for place, bound in enumerate(worst.tolist()):
            self.made += 1
            at = place + shift
            order = (*node.order[:at], chosen, *node.order[at:])
            if bound < self._cutoff:
                children.append(_Node(bound, node.lacking - 1, self.made, order))
            else:
                self._settled = min(self._settled, bound)
        heapq.heapify(children)
        return children

    def _keep(self, node: _Node, where: Floats) -> None:
        """Keep the tour that the path of `node` is."""
        path = node.path
        assert path is not None
        field = self.field
        shift = 0.0 if field.free else 1.0
        known = {vehicle: k + shift for k, vehicle in enumerate(node.order)}
        at = {k: known.get(k, float(where[k])) for k in range(field.size)}
        order = tuple(sorted(at, key=lambda k: at[k]))
        if order not in self.tours:
            self.tours[order] = flown(field, order, path, [at[k] for k in order])

    def _outermost(self) -> int:
        """Return the vehicle whose disc is furthest from the middle of the field."""
        apart = np.hypot(*self.field.centres[:-1].T) - self.field.radii[:-1]
        return int(apart.argmax())


def flown(field: Field, order: tuple[int, ...], path: Path, at: list[float]) -> Ordered:
    """Return the tour that flies through a path's points, relative to the vehicles, at full speed.

    Parameters
    ----------
    field : Field
        What is flown through.
    order : tuple of int
        All vehicles.
    path : Path
        Where they are met, but for the solver's tolerance.
    at : list of float
        The leg of the path, and the share of it, at which each vehicle is met.
    """
    legs = len(path.times) - 1
    place = np.zeros(2) if not field.free else np.empty(0)
    clock, points, times = 0.0, [], []
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
        along, rest = float(ahead @ velocity), 1.0 - float(velocity @ velocity)
        # |ahead + W t| = t
        wait = (along + math.sqrt(along * along + rest * float(ahead @ ahead))) / rest
        clock += wait
        place = target + velocity * clock
        points.append(place)
        times.append(clock)
    length = clock
    if field.closed:
        home = points[0] if field.free else np.zeros(2)
        length += float(np.hypot(*(place - home)))
    return Ordered(
        length * field.unit,
        order,
        np.array(points) * field.unit + field.origin,
        np.array(times) * field.unit,
    )


def best_orders(
    model: MessengerTour,
    stopped: Callable[[OrderSearch], bool],
    *,
    most: int = 20,
    gap: float = 1e-6,
) -> list[tuple[tuple[int, ...], float]]:
    """Return good orders of the vehicles, and the lengths of their tours without curvature, m.

    Parameters
    ----------
    model : MessengerTour
        Whose orders are wanted.
    stopped : callable
        Asked of the search before every program that is solved; it ends sooner where the best order
        is proven.
    most : int
        Orders that are returned at most, the best first.
    gap : float
        Relative difference to what is proven at which the search ends.
    """
    search = OrderSearch(model)
    search.run(lambda: stopped(search), lambda bound: None, gap)
    found = sorted(search.tours.values(), key=lambda one: one.length)
    return [(one.order, one.length) for one in found[:most]]


def guide(model: MessengerTour, order: Sequence[int]) -> Guide:
    """Return where and with which headings a flight in a given order nearly attains its bound.

    A disc is entered against the pull of the dual, and an angle is divided evenly. Where the bound is
    exact, so is this; elsewhere it is a start for a search.

    Parameters
    ----------
    model : MessengerTour
        What is flown through.
    order : sequence of int
        Vehicles, at least one and each at most once.
    """
    chains = Chains(model, curved=True)
    field = chains.field
    stops = field.chain(order)
    path = chains.solve(stops)
    table = np.empty((len(stops) - 1, 6))
    tabulated(*chains.data, stops, path.directions, table)
    ahead, weights = table[:, :2], table[:, 2:3]
    # What comes after each stop: nothing after the last one, or the first leg again.
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
    # A stop that pulls at nothing is met on the way.
    offsets = np.where(size > 1e-7, away, near) * field.unit
    bound = path.bound * field.unit
    return Guide(bound, offsets, np.arctan2(turn[rows, 1], turn[rows, 0]))
