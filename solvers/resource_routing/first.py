"""A first route without compiled loops: few labels per point, the arcs of a label extended as arrays."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.route import Route
from ..contract.backend import Request

__all__ = ["first_route", "route_in_time"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
#: Heads of the arcs that leave a point, their lengths, and what they add to each resource.
Leaving = Callable[[int], tuple[Whole, Floats, Floats]]

#: Labels per point and weight of the largest used share of a resource, in lengths of the shortest way, from
#: search to search. The first four find a route in all catalogue entries that have one, in at most 0.2 s.
SEARCHES = ((1, 0.0), (1, 0.1), (4, 0.0), (4, 1.0), (16, 0.0), (16, 0.1))


#: Limits on the number of points: up to FEW the exact search is quick enough. Above MANY, if all pairs of points are
#: arcs, these searches take too long: one among 20,000 points takes 15 s.
FEW, MANY = 20, 2000
#: Share of the time limit for these searches, and their most seconds, which bound the memory as well.
SHARE, SECONDS = 0.2, 2.0


class _Arcs(NamedTuple):
    """The arcs that leave each point, and levels above which no route is assumed.

    `leaving` returns the heads of the arcs from a point, their lengths, and their use of each resource. `ahead`,
    shape (n,), bounds the length to the end, and `most`, shape (n, r), the assumed level on leaving a point.
    """

    leaving: Leaving
    ahead: Floats
    most: Floats


def route_in_time(problem: ResourceRouting, request: Request) -> Route | None:
    """Return a first route for a run with a time limit; None if none is found or needed."""
    count, limit = len(problem.kinds), request.time_limit
    if limit is None or count <= FEW or (problem.arcs is None and count > MANY):
        return None
    with request.control.stage(min(SHARE * limit, SECONDS)) as part:
        return first_route(problem, lambda: part.stopped)


def first_route(
    problem: ResourceRouting, ended: Callable[[], bool] = lambda: False
) -> Route | None:
    """Return a route that searches with few labels per point find, or None if they find no route.

    `ended` returns True if the time is up.
    """
    with np.errstate(all="ignore"):  # an overflow makes an arc infinitely long
        net = _pairs(problem) if problem.arcs is None else _listed(problem)
        for width, weight in SEARCHES:
            route = _search(problem, net, width, weight, ended)
            if route is not None or ended():
                return route
    return None


def _search(
    problem: ResourceRouting,
    net: _Arcs,
    width: int,
    weight: float,
    ended: Callable[[], bool],
) -> Route | None:
    """Return the route of one search; labels leave in the order of length, bound and used share."""
    start, end = problem.start, problem.end
    limit, reset = problem.rounded_limits[problem.codes], problem.resets[problem.codes]
    bounded = np.isfinite(net.most) & (net.most > 0.0)
    scale = weight * float(net.ahead[start])
    extended, lowest = np.zeros(len(net.ahead), np.int64), np.full(len(net.ahead), math.inf)
    ties = itertools.count()
    heap: list[tuple[float, int, int, float, Floats, tuple[int, ...]]]
    heap = [(0.0, next(ties), start, 0.0, np.asarray(problem.initial, float), (start,))]
    while heap and not ended():
        _, _, here, length, level, route = heappop(heap)
        if here == end:
            return Route(route)
        if extended[here] >= width:
            continue
        extended[here] += 1
        heads, legs, uses = net.leaving(here)
        arrival, reached = level + uses, length + legs
        leaves = np.minimum(arrival, reset[heads])
        share = np.where(bounded[heads], leaves / net.most[heads], 0.0).max(axis=1, initial=0.0)
        keys = reached + net.ahead[heads] + scale * share
        usable = (arrival <= limit[heads]).all(axis=1) & (leaves <= net.most[heads]).all(axis=1)
        usable &= (keys < math.inf) & (heads != start) & (extended[heads] < width)
        if width == 1:
            usable &= keys < lowest[heads]
        for k in np.flatnonzero(usable).tolist():
            there = int(heads[k])
            if there not in route:
                lowest[there] = min(lowest[there], keys[k])
                heappush(heap, (keys[k], next(ties), there, reached[k], leaves[k], (*route, there)))
    return None


def _pairs(problem: ResourceRouting) -> _Arcs:
    """Return the arcs of a model if all pairs of points are arcs."""
    assert problem.points is not None
    points, everywhere = problem.points, np.arange(len(problem.kinds))
    gain = problem.gains[problem.codes]

    def leaving(here: int) -> tuple[Whole, Floats, Floats]:
        legs = np.linalg.norm(points - points[here], axis=1)
        return everywhere, legs, _used(problem, legs) + gain

    ahead = np.linalg.norm(points - points[problem.end], axis=1)
    return _Arcs(leaving, ahead, problem.rounded_limits[problem.codes])


def _listed(problem: ResourceRouting) -> _Arcs:
    """Return the arcs of a model that lists them."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    assert problem.arcs is not None
    count = len(problem.kinds)
    order = np.argsort(problem.arcs[:, 0], kind="stable")
    tails, heads = problem.arcs[order].T
    if problem.lengths is None:
        assert problem.points is not None
        lengths = np.linalg.norm(problem.points[tails] - problem.points[heads], axis=1)
    else:
        lengths = problem.lengths[order]
    used = _used(problem, lengths) + problem.gains[problem.codes[heads]]
    if problem.uses is not None:
        used = used + problem.uses[order]
    first = np.searchsorted(tails, np.arange(count + 1))

    def leaving(here: int) -> tuple[Whole, Floats, Floats]:
        part = slice(first[here], first[here + 1])
        return heads[part], lengths[part], used[part]

    def least(weights: Floats, targets: Whole) -> Floats:
        """Return the least sum of weights from each point to the nearest of `targets`."""
        back = csr_array((np.maximum(weights, 0.0), (heads, tails)), shape=(count, count))
        return np.asarray(dijkstra(back, indices=targets, min_only=True))

    limit, reset = problem.rounded_limits[problem.codes], problem.resets[problem.codes]
    most = np.full_like(limit, math.inf)
    for k in range(limit.shape[1]):
        # A resource must last to the end or to a point that resets it.
        targets = np.flatnonzero(np.isfinite(reset[:, k]) | (np.arange(count) == problem.end))
        most[:, k] = limit[targets, k].max() - least(used[:, k], targets)
    most = np.minimum(most, limit)
    return _Arcs(leaving, least(lengths, np.array([problem.end])), most)


def _used(problem: ResourceRouting, legs: Floats) -> Floats:
    """Return what legs use of each resource, shape (legs, resources)."""
    return np.where(problem.rates == 0.0, 0.0, legs[:, None] * problem.rates)
