"""First routes of column generation by cheapest insertion."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetPlan
from .route_pricing import Network

__all__ = ["fill_idle", "insert_nodes", "list_columns"]


def insert_nodes(
    network: Network, prizes: NDArray[np.float64], priced: bool, stopped: Callable[[], bool]
) -> list[tuple[int, tuple[int, ...]]]:
    """Return routes by cheapest insertion: nodes whose windows end first, then distant ones.

    `prizes`, shape (n,), is the relative cost of a node that is not visited, infinite if it must be visited.
    The increase of the costs is minimised if `priced`, otherwise the length of the route. The result is the
    kind and the nodes of each vehicle, idle ones included; it is empty after a stop, or if a node does not fit.
    """
    n, relative = network.size, network.costs if priced else network.lengths
    routes = [(k, tuple[int, ...]()) for k, kind in enumerate(network.kinds) for _ in kind.vehicles]
    ends = [network.window(int(node))[1] for node in network.model.customers]

    def total(k: int, route: tuple[int, ...]) -> float:
        return float(relative[k, [n, *route], [*route, n]].sum()) if route else 0.0

    for node in sorted(range(n), key=lambda i: (ends[i], -network.lengths[0, n, i])):
        least, chosen = float(prizes[node]), None
        for r, (k, route) in enumerate(routes):
            if stopped():
                return []
            if not route and (k, route) in routes[:r]:
                continue  # like an earlier vehicle
            before = total(k, route) if priced else 0.0
            for place in range(len(route) + 1):
                trial = (*route[:place], node, *route[place:])
                cost = total(k, trial) - before
                if cost < least and network.fits(k, trial):
                    least, chosen = cost, (r, (k, trial))
        if chosen is not None:
            routes[chosen[0]] = chosen[1]
        elif np.isinf(prizes[node]):
            return []
    return routes


def fill_idle(stops: list[tuple[int, ...]]) -> None:
    """Give each idle vehicle the last node of a route with several nodes."""
    for k, route in enumerate(stops):
        donor = max(range(len(stops)), key=lambda other: len(stops[other]))
        if not route and len(stops[donor]) > 1:
            stops[k], stops[donor] = stops[donor][-1:], stops[donor][:-1]


def list_columns(network: Network, plan: FleetPlan | None) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Yield the kinds and nodes of the feasible routes of one node, and of the routes of a plan."""
    for k in range(len(network.kinds)):
        for node in range(network.size):
            if network.fits(k, (node,)):
                yield k, (node,)
    place = {int(node): k for k, node in enumerate(network.model.customers)}
    for vehicle, stops in enumerate(() if plan is None else plan.routes):
        k = next(k for k, kind in enumerate(network.kinds) if vehicle in kind.vehicles)
        route = tuple(place[node] for node in stops)
        if route:
            yield k, min(route, route[::-1]) if network.symmetric else route
