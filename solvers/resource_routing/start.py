"""The first routes of the exact search: what searches with few labels per point find."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.route import Route
from ..contract.backend import Request
from .first import route_in_time
from .narrow_kernels import narrow
from .network import Network

__all__ = ["Start"]

#: Labels per point, from search to search. With 4 the routes through 100 × 100 crossings are within 2 % of
#: the bound after 0.03 s, with 64 after 0.6 s.
WIDTHS = (1, 4, 16, 64)
#: Weights of the resources in the order of a search: the second one if the first finds no route.
WEIGHTS = (0.0, 0.3)
#: Points above which a run with a time limit begins with these searches.
FEW = 20
#: Shares of the time limit after which no search begins if a route is known, and after which all end.
IMPROVING, SEEKING = 0.1, 0.5


@dataclass
class Start:
    """The best route of the searches with few labels per point, and its length.

    Without a time limit in `request` nothing is searched. `searched` is true after a search of a network found a
    route.
    """

    problem: ResourceRouting
    request: Request
    route: Route | None = None
    length: float = math.inf
    searched: bool = False

    def begin(self) -> None:
        """Search without compiled loops, so that a route is known if no time is left to compile."""
        route = route_in_time(self.problem, self.request)
        if route is not None:
            self.keep(route)

    def search(self, net: Network, ahead: NDArray[np.float64], rows: NDArray[np.int64]) -> None:
        """Search `net`, unless another one led to a route, and report each shorter route.

        `rows`, shape (n,), are the points of `net`, and `ahead`, shape (n,), the least lengths from them to the
        end.
        """
        whole, control = self.request.time_limit, self.request.control
        if whole is None or self.searched or len(self.problem.kinds) <= FEW:
            return
        with control.stage(SEEKING * whole) as part:
            for width in WIDTHS:
                for weight in WEIGHTS:
                    route, _ = narrow(
                        net, ahead, width, weight, self.problem.revisits, self.length, part.flag
                    )
                    if route.size:
                        self.searched = True
                        self.keep(Route(tuple(rows[route].tolist())))
                    if part.stopped:
                        return
                    if self.route is not None:
                        break
                if self.route is not None and part.progress.seconds > IMPROVING * whole:
                    return

    def keep(self, route: Route) -> None:
        """Report `route` if it is feasible and shorter than the best one."""
        checked = self.problem.verify(route)
        value = checked.objective
        if not checked.ok or checked.within_tolerance or value is None or value >= self.length:
            return
        self.route, self.length = route, value
        self.request.control.incumbent(value, route)
