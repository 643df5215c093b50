"""Route as a sequence of points, the plan of several problems."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import NumberTuple, declared, show
from ..records import Several

__all__ = ["Route", "route_from_data", "route_of_indices", "route_to_data"]


@dataclass(frozen=True, eq=False)
class Route(Plan):
    """Route from point to point, a sequence that supports ``len``, iteration and indexing.

    Parameters
    ----------
    route : tuple of int
        Indices into the model's points, from the first to the last.
    others : tuple of tuple of int
        Further routes, if the model asks for several, in the order of their lengths.

    Raises
    ------
    InvalidData
        The entries are not whole numbers.
    """

    route: tuple[int, ...] = declared(NumberTuple(("stops",), int))
    others: tuple[tuple[int, ...], ...] = declared(
        Several(NumberTuple(("stops",), int)), default=(), added=True
    )

    @property
    def corrections(self) -> int:
        """Number of points between the first and the last, such as corrections."""
        return max(len(self.route) - 2, 0)

    def __len__(self) -> int:
        return len(self.route)

    def __iter__(self) -> Iterator[int]:
        return iter(self.route)

    def __getitem__(self, place: int) -> int:
        return self.route[place]

    def __str__(self) -> str:
        return "-".join(map(str, self.route))


Names = tuple[int | str, ...] | None


def route_to_data(route: Route, names: Names) -> dict[str, Any]:
    """Return ``{"route": [indices]}``, with ``"ids"`` if `names` are given, and ``"others"`` if any."""
    data: dict[str, Any] = {"route": list(route.route)}
    if route.others:
        data["others"] = [list(other) for other in route.others]
    if names is not None:
        data["ids"] = [names[k] for k in route.route]
    return data


def route_from_data(data: Any, count: int, names: Names) -> Route:
    """Return the route in `data`: a list of indices, ``{"route": […]}`` or ``{"ids": […]}``.

    `names` are those of the `count` points, 0 … count - 1 by default. Raise ``InvalidData`` naming stop and
    value.
    """
    if isinstance(data, Mapping):
        for key in data:
            if key not in ("route", "ids", "others"):
                raise InvalidData(
                    f"unknown key {key!r} in a plan; allowed: route, ids, others", field=str(key)
                )
        if not data.keys() & {"route", "ids"}:
            raise InvalidData("a plan needs the key route or ids", field="route")
        by_index = route_of_indices(data["route"], count) if "route" in data else None
        by_id = _from_ids(data["ids"], count, names) if "ids" in data else None
        if by_index is not None and by_id is not None and by_index != by_id:
            raise InvalidData("route and ids of the plan name different points", field="ids")
        route = by_index or by_id or Route(())
        others = data.get("others", ())
        if isinstance(others, str | Mapping) or not isinstance(others, Sequence):
            raise InvalidData(
                f"others must be a list of routes, got {show(others)}", field="others"
            )
        return replace(route, others=tuple(route_of_indices(one, count).route for one in others))
    return route_of_indices(data, count)


def route_of_indices(value: Any, count: int) -> Route:
    """Return the route through the points with the given indices, each in 0 … count - 1."""
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence | np.ndarray):
        raise InvalidData(
            f"route must be a list of point indices, got {show(value)}", field="route"
        )
    route = []
    for stop, entry in enumerate(value):
        if isinstance(entry, bool) or not isinstance(entry, int | np.integer):
            raise InvalidData(
                f"route[{stop}] must be a point index, got {show(entry)}", field="route"
            )
        if not 0 <= entry < count:
            raise InvalidData(
                f"route[{stop}] must be in 0 … {count - 1}, got {show(entry)}", field="route"
            )
        route.append(int(entry))
    return Route(tuple(route))


def _from_ids(value: Any, count: int, names: Names) -> Route:
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
        raise InvalidData(f"ids must be a list, got {show(value)}", field="ids")
    places = {name: k for k, name in enumerate(range(count) if names is None else names)}
    for stop, entry in enumerate(value):
        if isinstance(entry, bool) or not isinstance(entry, int | str) or entry not in places:
            raise InvalidData(f"ids[{stop}]: no point is called {show(entry)}", field="ids")
    return Route(tuple(places[entry] for entry in value))
