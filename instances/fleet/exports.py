"""Routes of a fleet as tables, lines on a plane, and solutions of VRPLIB."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import InvalidData, UnsupportedFormulation
from ...files import write_text
from ...models.fields import required
from ...models.fleet.checks import loads_of, value_of
from ...models.fleet.data import Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ...models.fleet.rich_checks import missing_times
from ..exports import ExportFormat, write_geojson
from ..tables import write_rows

__all__ = ["CSV", "GEOJSON", "VRPLIB", "write_routes_csv", "write_routes_geojson", "write_vrplib"]


def write_routes_csv(plan: FleetPlan, path: str | os.PathLike[str], *, model: FleetRouting) -> Path:
    """Write one row per stop as CSV, atomically; return the path.

    The columns are ``vehicle,stop,node,x,y,arrival``: vehicle and stop numbers from 0, the name of
    the node, its coordinates in m, and the route length up to the stop. Each route begins and ends
    with its depot, unless it is open. For models with costs and without points, x and y are empty. A
    plan with times has another column ``time``: departure, begin of each service, and return, in s.

    Parameters
    ----------
    plan, path, model
        The routes, file to write, and model of the plan.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The plan has other nodes or vehicles, an id does not fit into a CSV row, or the file cannot
        be written.
    """
    rows = []
    for k, stops in _walks(plan, model):
        arrivals = np.append(0.0, np.cumsum(model.distances[stops[:-1], stops[1:]])).tolist()
        for stop, node in enumerate(stops):
            place = ("", "") if model.points is None else model.points[node].tolist()
            time = () if plan.starts is None else (plan.starts[k][stop],)
            rows.append((k, stop, model.label(node), *place, arrivals[stop], *time))
    columns = ("vehicle", "stop", "node", "x", "y", "arrival")
    return write_rows(path, (*columns, "time") if plan.starts is not None else columns, rows)


def write_routes_geojson(
    plan: FleetPlan, path: str | os.PathLike[str], *, model: FleetRouting
) -> Path:
    """Write each route as a LineString of a GeoJSON file, atomically; return the path.

    Coordinates are metres in the plane, not longitudes and latitudes. Lines are straight from node to
    node, even if the distances are lengths of paths on a map. An idle vehicle has no line.

    Parameters
    ----------
    plan, path, model
        As for :func:`write_routes_csv`.

    Raises
    ------
    UnsupportedFormulation
        The model has costs and no points.
    InvalidData
        As for :func:`write_routes_csv`.
    """
    loads, features = loads_of(model, plan), []
    for k, stops in _walks(plan, model):
        if model.points is None:
            raise UnsupportedFormulation(
                "routes without points cannot be drawn: the model has costs"
            )
        properties = {
            "vehicle": k,
            "length": float(loads[k]),
            "nodes": [model.label(node) for node in stops],
        }
        features.append(("LineString", model.points[stops].tolist(), properties))
    return write_geojson(path, features)


def write_vrplib(plan: FleetPlan, path: str | os.PathLike[str], *, model: FleetRouting) -> Path:
    """Write the routes as a VRPLIB solution, atomically; return the path.

    Customers are numbered from 1, without the depot, in the order of the nodes; a reload is 0. The cost is
    the total length, or the objective "cost".

    Parameters
    ----------
    plan, path, model
        As for :func:`write_routes_csv`.

    Raises
    ------
    UnsupportedFormulation
        The model has several depots or stations.
    InvalidData
        As for :func:`write_routes_csv`, or the cost depends on times that the plan lacks.
    """
    if model.stations:
        raise UnsupportedFormulation("solutions of VRPLIB have no stations, the model has some")
    if np.unique(model.depots).size > 1:
        raise UnsupportedFormulation("solutions of VRPLIB have one depot, the model has several")
    place = {node: k for k, node in enumerate(model.customers.tolist(), 1)}
    lines = []
    for number, (k, _) in enumerate(_walks(plan, model), 1):
        # A reload is 0 as in PyVRP's solutions, also at a depot.
        stops = " ".join(str(place.get(node, 0)) for node in plan.routes[k])
        lines.append(f"Route #{number}: {stops}")
    is_cost = model.objective is Objective.COST
    cost = value_of(model, plan) if is_cost else float(loads_of(model, plan).sum())
    if cost is None:
        raise InvalidData(
            "starts must be given, as the cost depends on times, got none", field="starts"
        )
    lines.append(f"Cost {cost!r}")
    return write_text(path, "\n".join(lines) + "\n")


def _walks(plan: FleetPlan, model: FleetRouting) -> Iterator[tuple[int, list[int]]]:
    """Yield the index and the stops, depots included, of every used vehicle."""
    required("plan", plan, FleetPlan)
    required("model", model, FleetRouting)
    if len(plan.routes) != model.vehicles:
        raise InvalidData(
            f"routes must be {model.vehicles}, one for each vehicle, got {len(plan.routes)}",
            field="routes",
        )
    if plan.starts is not None and missing_times(plan):
        raise InvalidData("starts must be the times of each route", field="starts")
    known = {*model.customers.tolist(), *(model.reloads or ()), *(model.stations or ())}
    other = next((x for x in itertools.chain(*plan.routes) if x not in known), None)
    if other is not None:
        raise InvalidData(f"routes must visit nodes other than depots, got {other}", field="routes")
    for k, route in enumerate(plan.routes):
        if route:
            yield k, model.path_of(k, route)


CSV = ExportFormat("one row per stop (CSV)", ".csv", write_routes_csv)
GEOJSON = ExportFormat("routes as lines (GeoJSON, in metres)", ".geojson", write_routes_geojson)
VRPLIB = ExportFormat("a solution of VRPLIB", ".sol", write_vrplib)
