"""``resource-labelling``: our own exact search for routes with resources."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ...jit import MOST_LABELS
from ...models.resource_routing.checks import walk_route
from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.route import Route
from ..contract.backend import Request
from .native import RouteSearch

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .elementary import Found
    from .start import Start

__all__ = ["ResourceLabelling"]

#: The first ceiling above what is proven, relative, the factor by which that share rises, and the
#: share from which on there is no ceiling.
FIRST, RISE, LAST = 0.004, 2.2, 8.0
#: The same for the straight line, below which few points are taken first.
LEAST, GROWTH = 0.02, 4.0
#: By how much the longest route of interest exceeds the known one, relative.
MARGIN = 1e-9
#: Number of points up to which cutting planes and rising ceilings take longer than one search with plain bounds.
TINY = 10
#: Labels, beside four per point, after which multipliers are computed.
LIGHT = 4000
#: What rounding adds to a length, relative.
SLACK = 1e-12


class ResourceLabelling(RouteSearch):
    """Best-first label setting with dominance on the length and on every level.

    Labels leave the heap in the order of their length and the least length from there to the end.
    Arcs on which a single resource leaves no way are taken out first. With revisits allowed the
    search is exact as it is. Without them, the walk it finds is accepted if it is simple, and
    otherwise the points that it repeats become critical (see :mod:`.elementary`), and the ceiling on
    the length rises from what is proven, so that labels may ignore what they cannot visit below it.

    A run that reaches its time limit returns the best route of the searches with few labels per point. It
    ends without a plan only if none of them found a route.
    """

    name = "resource-labelling"
    accepts = ResourceRouting
    summary = "best-first label setting with dominance on the length and all resources; ours"

    def measure(self, problem: ResourceRouting, plan: Route) -> float:
        """Return the length of `plan` less its prizes, added exactly."""
        return walk_route(problem, plan)[0][-1].value

    def find(
        self,
        problem: ResourceRouting,
        cutoff: float,
        request: Request,
        least: NDArray[np.float64] | None = None,
    ) -> tuple[Found, Mapping[str, float | int | str]]:
        """Return the best route no longer than `cutoff`, and the number of arcs.

        `least`, shape (n,), are lower bounds on the lengths from the points to the end, for a model without
        prizes; inf for points on no route up to `cutoff`. Their errors must be below those of sums of lengths.

        If all pairs of points are arcs, points far from the straight line are left out first. A run with
        a time limit begins with searches that keep few labels per point, see :mod:`.first` and
        :mod:`.start`; it returns their route if it is stopped.
        """
        import numpy as np

        from .outcomes import FOUND, NOTHING
        from .start import Start

        if problem.routes > 1:
            cutoff = math.inf  # the other routes may be longer
        start = Start(problem, request)
        start.begin()
        made = settled = 0
        for rows, proven, ceiling in _stages(problem, cutoff):
            result, arcs = _under(problem, rows, ceiling, request.control.flag, start, least)
            made, settled = made + result.made, settled + result.settled
            known = start.route is not None and start.length * (1.0 + MARGIN) <= ceiling
            if result.status == NOTHING and known:
                # Rounding hides the known route, which no route is shorter than.
                result = replace(result, status=FOUND)
            bound = max(result.bound, min(proven, result.length))
            missing = result.status == FOUND and 1 + len(result.others) < problem.routes
            if missing and result.route.size:
                start.keep(Route(tuple(result.route.tolist())))
            if result.status != NOTHING and not missing:
                break
        if start.route is not None and result.status != NOTHING:
            # A stopped search may have found longer routes only.
            ways = [tuple(way.tolist()) for way in (result.route, *result.others) if way.size]
            ways += [] if start.route.route in ways else [start.route.route]
            ways.sort(key=lambda way: self.measure(problem, Route(way)))
            first, *others = map(np.array, ways[: problem.routes])
            result = replace(result, route=first, others=tuple(others))
        return replace(result, made=made, settled=settled, bound=bound), {"arcs": arcs}


def _stages(
    problem: ResourceRouting, cutoff: float
) -> Iterator[tuple[NDArray[np.int64], float, float]]:
    """Return points, a bound on all routes, and the length up to which no route needs other points.

    The last length is `cutoff`.
    """
    import numpy as np

    from .network import distances

    count, share = len(problem.kinds), LEAST
    if problem.arcs is not None or problem.has_prizes:
        yield np.arange(count), -math.inf if problem.has_prizes else 0.0, cutoff
        return
    assert problem.points is not None
    detour = distances(problem.points, problem.start) + distances(problem.points, problem.end)
    proven = straight = float(detour[problem.start])
    while True:
        ceiling = straight * (1 + share)
        rows = np.flatnonzero(detour <= ceiling * (1 + SLACK))
        if ceiling >= cutoff or 2 * rows.size > count or not straight > 0:
            break
        yield rows, proven, ceiling
        proven, share = ceiling, share * GROWTH
    keep = ~(detour > cutoff * (1 + SLACK))
    keep[[problem.start, problem.end]] = True
    yield np.flatnonzero(keep), proven, cutoff


def _under(
    problem: ResourceRouting,
    rows: NDArray[np.int64],
    cutoff: float,
    flag: NDArray[np.int8],
    start: Start,
    least: NDArray[np.float64] | None,
) -> tuple[Found, int]:
    """Return the best routes through `rows` no longer than `cutoff`, and the number of arcs; see :meth:`find`."""
    import numpy as np

    from .elementary import Found, elementary
    from .label_kernels import Guide, best_first
    from .multipliers import best_bounds, cumulative, plain_bounds
    from .network import counted, network, shut_levels
    from .ng_routes import Memory
    from .outcomes import FULL, NOTHING, STOPPED

    net = network(problem, rows, flag)
    if flag[0]:
        # Arcs may be missing.
        return Found(STOPPED, np.empty(0, np.int64), math.inf, 0.0, 0, 0), 0
    signed = bool((net.length < 0).any())
    if signed:
        # Multipliers of the resources, or of the number of arcs, leave no negative cycle.
        whole = counted(net)
        bounds = (best_bounds(whole) if len(rows) > TINY else None) or plain_bounds(whole)
        if bounds.weight.size > net.initial.size and bounds.weight[-1] > 0.0:
            net = whole
        bounds = replace(bounds, weight=bounds.weight[: net.initial.size])
    else:
        bounds = plain_bounds(net)
        start.search(net, bounds.ahead, rows)
        if problem.routes == 1:
            cutoff = min(cutoff, start.length * (1.0 + MARGIN))
    light = LIGHT + 4 * len(rows)
    if signed or not cumulative(net).size:
        light = MOST_LABELS
    memory, shut = Memory(net, signed), shut_levels(net)
    # Length of the last walk of the first search, which the last of as many simple routes is not shorter than.
    longest = -math.inf

    def bounds_by_way(critical: NDArray[np.int64]) -> tuple[NDArray[np.float64], ...]:
        ahead, via = bounds.ahead, bounds.via(net, critical)
        if least is None or bounds.weight.any():
            return ahead, via
        better = np.maximum(ahead, least[rows])
        return better, via + (better[critical] - ahead[critical])

    def search(critical: NDArray[np.int64], proven: float) -> Found:
        nonlocal bounds, light, longest
        critical, bits, words = memory.arrays(critical)
        ahead, via = bounds_by_way(critical)
        made = settled = rounds = 0
        below = proven = max(proven, float(ahead[net.start]))
        has_ceiling = critical.size and len(rows) > TINY and 0 < abs(proven) < math.inf
        share = FIRST if has_ceiling else LAST
        while True:
            floor = max(proven, longest)
            ceiling = min(cutoff, floor + abs(floor) * share) if share < LAST else cutoff
            guide = Guide(bounds.weight, ahead, via, bits, words, shut[critical], bounds.rounding)
            status, points, sizes, lengths, bound, *counts, pruned = best_first(
                net, guide, ceiling, problem.routes, light, flag
            )
            made, settled, rounds = made + counts[0], settled + counts[1], rounds + 1
            if status == FULL and light < MOST_LABELS:
                light, bounds = MOST_LABELS, best_bounds(net) or bounds
                ahead, via = bounds_by_way(critical)
                continue
            # A ceiling also closes critical points, which lets labels dominate more.
            cut = pruned > 0 or (critical.size > 0 and ceiling < math.inf)
            if status >= NOTHING and len(sizes) < problem.routes and cut and ceiling < cutoff:
                below, share = ceiling if status == NOTHING else below, share * RISE
                continue
            if status == NOTHING and not cut:
                bound = math.inf
            ways = np.split(points, np.cumsum(sizes))[:-1] or [points]
            length = min(lengths, default=math.inf)
            if len(sizes) == problem.routes > 1:
                longest = float(lengths[-1])
            return Found(
                status, ways[0], length, max(bound, below), made, settled, rounds,
                critical.size, tuple(ways[1:]),
            )  # fmt: skip

    result = elementary(search, revisits=problem.revisits, learn=memory.learn if signed else None)
    others = tuple(rows[other] for other in result.others)
    return replace(result, route=rows[result.route], others=others), len(net.head)
