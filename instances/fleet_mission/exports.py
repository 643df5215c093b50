"""Missions for other software: samples, what Crazyflies fly, and curves on a map."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...files import as_path, write_text
from ...models.fields import required
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.sampling import sample_count
from ..exports import ExportFormat
from ..minimum_snap.poly7 import Poly7Report, write_poly7

__all__ = [
    "GEOJSON",
    "POLY7",
    "SAMPLES",
    "Poly7Reports",
    "write_mission_geojson",
    "write_mission_poly7",
    "write_mission_samples",
]

_NAMES = ("t", "x", "y", "vx", "vy", "ax", "ay")


def write_mission_samples(
    plan: MissionPlan, path: str | os.PathLike[str], *, rate: float = 20.0
) -> Path:
    """Write positions, velocities and accelerations at equal steps of time as CSV; return the path.

    The columns are ``robot,t,x,y,vx,vy,ax,ay``: the number of the robot from 0, s, m, m/s, m/s². Each
    robot has rows from when it leaves the depot until it is back. Robots that stay have none.

    Parameters
    ----------
    plan : MissionPlan
        The mission.
    path : path-like
        The file.
    rate : float
        Samples a second (Hz); a robot's end is always included.
    """
    lines = ["robot," + ",".join(_NAMES)]
    for robot, one in enumerate(required("plan", plan, MissionPlan).trajectories):
        if one is not None:
            sample_count(one.duration, rate)
            table = one.sampled(rate, 2).tolist()
            lines += [f"{robot}," + ",".join(map(repr, row)) for row in table]
    return write_text(path, "\n".join(lines) + "\n")


@dataclass(frozen=True)
class Poly7Reports:
    """What 4-byte floats do to the trajectories of a mission.

    Parameters
    ----------
    robots : tuple of int
        The robots that fly.
    starts : tuple of float
        When each leaves the depot, s: a poly7 file begins at 0.
    reports : tuple of Poly7Report
        One a robot.
    """

    robots: tuple[int, ...]
    starts: tuple[float, ...]
    reports: tuple[Poly7Report, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the reports as JSON data."""
        rows = zip(self.robots, self.starts, self.reports, strict=True)
        return {"files": [{"robot": k, "start": t, **one.to_dict()} for k, t, one in rows]}

    def __str__(self) -> str:
        rows = zip(self.robots, self.starts, self.reports, strict=True)
        return "\n".join(f"robot {k}, to be started at {t:.6g} s\n{one}" for k, t, one in rows)


def write_mission_poly7(
    plan: MissionPlan, path: str | os.PathLike[str], *, height: float = 1.0, strict: bool = False
) -> Poly7Reports:
    """Write a poly7 file for each robot, as Crazyflies and Crazyswarm take them.

    A robot's file has its number before the suffix: ``mission.csv`` becomes ``mission-0.csv``, ….

    Parameters
    ----------
    plan : MissionPlan
        The mission.
    path : path-like
        Names the files.
    height : float
        z of all robots, m.
    strict : bool
        Refuse more pieces than fit into the firmware's memory, instead of reporting it.

    Returns
    -------
    Poly7Reports
        When each robot is to be started, and what rounding does to each trajectory.
    """
    from ...models.minimum_snap.trajectory import Trajectory

    file = as_path(path)
    flown = [
        (k, one)
        for k, one in enumerate(required("plan", plan, MissionPlan).trajectories)
        if one is not None
    ]
    reports = []
    for k, one in flown:
        level = np.zeros((one.segments, one.degree + 1, 1))
        level[:, 0] = height
        in_space = Trajectory(one.times, np.concatenate([one.coefficients, level], axis=2))
        own = file.with_name(f"{file.stem}-{k}{file.suffix}")
        reports.append(write_poly7(in_space, own, strict=strict))
    return Poly7Reports(
        tuple(k for k, _ in flown),
        tuple(float(one.times[0]) for _, one in flown),
        tuple(reports),
    )


def write_mission_geojson(
    plan: MissionPlan, path: str | os.PathLike[str], *, model: FleetMission, rate: float = 10.0
) -> Path:
    """Write obstacles, depot, nodes and the robots' curves as GeoJSON, in one step; return the path.

    Coordinates are metres in the map's plane, not longitudes and latitudes.

    Parameters
    ----------
    plan : MissionPlan
        The mission.
    path : path-like
        The file.
    model : FleetMission
        Intended software.
    rate : float
        Points of a curve a second (Hz).
    """
    required("plan", plan, MissionPlan)
    required("model", model, FleetMission)
    features = [
        _feature("Polygon", [_closed(ring) for ring in (one.shell, *one.holes)], {"obstacle": k})
        for k, one in enumerate(model.obstacles)
    ]
    features.append(_feature("Point", model.depot.tolist(), {"depot": True}))
    met = {
        node: (robot, float(t))
        for robot, (route, times) in enumerate(zip(plan.routes, plan.visits, strict=True))
        for node, t in zip(route, times, strict=True)
    }
    for k, node in enumerate(model.nodes.tolist()):
        robot, t = met.get(k, (None, None))
        features.append(
            _feature("Point", node, {"node": model.label(k), "robot": robot, "time": t})
        )
    for robot, one in enumerate(plan.trajectories):
        if one is not None:
            line = one.sampled(rate, 0)
            own = {"robot": robot, "times": line[:, 0].tolist()}
            features.append(_feature("LineString", line[:, 1:].tolist(), own))
    rows = ",\n".join(json.dumps(one, allow_nan=False, ensure_ascii=False) for one in features)
    return write_text(path, f'{{"type": "FeatureCollection", "features": [\n{rows}\n]}}\n')


def _closed(ring: Any) -> list[list[float]]:
    points: list[list[float]] = ring.tolist()
    return [*points, points[0]]


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


SAMPLES = ExportFormat("samples of all robots (CSV)", ".csv", write_mission_samples)
POLY7 = ExportFormat(
    "pieces of degree 7 as Crazyflies fly them, a file each (CSV)", ".csv", write_mission_poly7
)
GEOJSON = ExportFormat("map and curves (GeoJSON, in metres)", ".geojson", write_mission_geojson)
