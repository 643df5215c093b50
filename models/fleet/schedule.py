"""Exact schedule of one route: several windows, releases, shift and a limit on the duration.

The earliest return is a function of the departure d. It is nondecreasing and consists of pieces
max(fixed, d + delay) on intervals of d. Travel and service shift a piece, a release raises its fixed
part, and each window keeps the departures that reach it. For one window per node this is the forward
time slack of M. Savelsbergh, "The vehicle routing problem with time windows: minimizing route
duration", ORSA Journal on Computing 4, 1992.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .rich_data import RichData
    from .specs import Spans

__all__ = ["Piece", "earliest_returns", "schedule_route"]

#: Arrivals are rounded: one this much after a window, relative to the times of the route, is in time. Four
#: times this value must stay below the rounding that the verification accepts.
_ROUNDING = 2e-13


class Piece(NamedTuple):
    """Departures `first` … `last` with the earliest return max(`fixed`, departure + `delay`), all in s."""

    first: float
    last: float
    fixed: float
    delay: float

    @property
    def earliest(self) -> float:
        """Earliest return of all departures, s."""
        return max(self.fixed, self.first + self.delay)

    @property
    def latest_departure(self) -> float:
        """Latest departure with the earliest return, s; the duration is then the least of the piece."""
        return min(self.last, max(self.first, self.fixed - self.delay))

    @property
    def duration(self) -> float:
        """Least duration, s."""
        return max(self.fixed - self.latest_departure, self.delay)

    def moved(self, seconds: float) -> Piece:
        """Return the piece `seconds` later."""
        return self._replace(fixed=self.fixed + seconds, delay=self.delay + seconds)


class _Stop(NamedTuple):
    """Travel time to a node, its windows and service, and the release of the trip that begins there."""

    travel: float
    windows: Spans
    service: float
    release: float


def _stops(model: RichData, vehicle: int, route: Sequence[int]) -> tuple[float, list[_Stop]]:
    """Return the earliest departure of the first trip, and the stops of the route with its end."""
    release, stops = -math.inf, []
    # Backwards, so that the release of a trip is known at the reload that begins it.
    path = model.path_of(vehicle, route)
    for place in range(len(path) - 1, 0, -1):
        node, inner = path[place], place <= len(route)
        begins = inner and node in (model.reloads or ())
        stops.append(
            _Stop(
                model.travel_time(vehicle, path[place - 1], node),
                None if model.windows is None else model.windows[node],
                float(model.service[node]) if inner and model.service is not None else 0.0,
                release if begins else -math.inf,
            )
        )
        if begins:
            release = -math.inf
        elif model.releases is not None and model.is_customer[node]:
            release = max(release, float(model.releases[node]))
    return release, stops[::-1]


def _through(pieces: Iterable[Piece], windows: Spans) -> list[Piece]:
    """Return the pieces of the begin of a service within `windows`, from those of the arrival."""
    if windows is None:
        return list(pieces)
    result = []
    for piece in pieces:
        before = -math.inf
        for begin, end in windows:
            # A departure that also meets an earlier window belongs to that one, except at its end.
            first = piece.first if piece.fixed > before else max(piece.first, before - piece.delay)
            last = min(piece.last, end - piece.delay)
            slack = _ROUNDING * (abs(first) + abs(piece.delay))
            if first <= last + slack and piece.fixed <= end + slack:
                fixed = max(min(piece.fixed, end), begin)
                result.append(Piece(first, max(first, last), fixed, piece.delay))
            before = max(before, end)
    return result


def earliest_returns(
    model: RichData, vehicle: int, route: Sequence[int], *, returned: bool = True
) -> list[Piece]:
    """Return the pieces of the earliest return of a route by its departure; empty without a schedule.

    All limits on times hold: windows, releases, the shift and the duration. The arguments are those of
    :func:`schedule_route`; the route has at least one node. Unless `returned`, the route ends with the service of
    its last node.
    """
    release, stops = _stops(model, vehicle, route)
    stops = stops if returned else stops[: len(route)]
    begin, end = (0.0, math.inf) if model.shifts is None else model.shifts[vehicle].tolist()
    home = None if model.windows is None else model.windows[int(model.homes[vehicle])]
    spans = ((-math.inf, math.inf),) if home is None else home
    pieces = [
        Piece(max(begin, release, a), min(end, b), -math.inf, 0.0)
        for a, b in spans
        if max(begin, release, a) <= min(end, b)
    ]
    for stop in stops:
        pieces = _through([piece.moved(stop.travel) for piece in pieces], stop.windows)
        pieces = [
            piece._replace(fixed=max(piece.fixed, stop.release))
            for piece in (piece.moved(stop.service) for piece in pieces)
        ]
    pieces = _through(pieces, ((-math.inf, end),))
    if model.max_duration is not None:
        limit = float(model.max_duration[vehicle])
        pieces = [
            piece._replace(first=max(piece.first, piece.fixed - limit))
            for piece in pieces
            if piece.duration <= limit * (1 + _ROUNDING)
        ]
    return [piece._replace(first=min(piece.first, piece.last)) for piece in pieces]


def schedule_route(model: RichData, vehicle: int, route: Sequence[int]) -> tuple[float, ...]:
    """Return the departure, the begin of each service and the return of a route, in s; empty for an empty route.

    The return is the earliest one within all limits, and the departure the latest for it. If the duration has a
    cost, the duration is the least possible instead, with the earliest return for it. If no schedule keeps all
    limits, the services are as early as possible, and the verification names the violated limits. `route` does
    not contain the depots.
    """
    if not route:
        return ()
    pieces = earliest_returns(model, vehicle, route)
    paid = model.time_cost is not None and model.time_cost[vehicle] > 0
    release, stops = _stops(model, vehicle, route)
    if pieces:
        if paid:
            best = min(pieces, key=lambda piece: (piece.duration, piece.earliest))
            departure = best.latest_departure
        else:
            soonest = min(piece.earliest for piece in pieces)
            departure = max(p.latest_departure for p in pieces if p.earliest == soonest)
    else:
        begin = 0.0 if model.shifts is None else float(model.shifts[vehicle, 0])
        home = None if model.windows is None else model.windows[int(model.homes[vehicle])]
        departure = max(begin, release, home[0][0] if home else -math.inf)
    times, now = [departure], departure
    slack = 4 * _ROUNDING * (abs(departure) + sum(stop.travel + stop.service for stop in stops))
    for stop in stops:
        now = _begin(now + stop.travel, stop.windows, slack)
        times.append(now)
        now = max(now + stop.service, stop.release)
    if len(times) == len(route) + 1:  # an open route ends after its last service
        times.append(now)
    return tuple(times)


def _begin(arrival: float, windows: Spans, slack: float) -> float:
    """Return the begin of a service: the first time in a window, or the arrival after all windows."""
    for begin, end in windows or ():
        if arrival <= end + slack:
            return max(begin, min(arrival, end))
    return arrival
