"""Files of missions: obstacles, samples, trajectories for Crazyflies, and curves on a map."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Flag, required
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.sampling import sample_count
from ..exports import ExportFormat, closed_ring, write_geojson
from ..grid_path import read_geojson_polygons
from ..minimum_snap.poly7 import PIECES_THAT_FIT, Poly7Report, write_poly7
from ..storage import reference
from ..tables import write_rows

__all__ = [
    "GEOJSON",
    "POLY7",
    "SAMPLES",
    "Poly7Reports",
    "resolve_references",
    "write_mission_geojson",
    "write_mission_poly7",
    "write_mission_samples",
]

#: Advice if the pieces do not fit into the firmware's memory.
_FEWER = "staged has fewer pieces with the option trajectories=interior-point (minimum snap)"
_NAMES = ("robot", "t", "x", "y", "vx", "vy", "ax", "ay")


def write_mission_samples(
    plan: MissionPlan, path: str | os.PathLike[str], *, rate: float = 20.0
) -> Path:
    """Write positions, velocities and accelerations at equal steps of time as CSV; return the path.

    The columns are ``robot,t,x,y,vx,vy,ax,ay``: the number of the robot from 0, s, m, m/s, m/s². Each
    robot has rows from when it leaves the depot until it is back. Robots that stay have none.

    Parameters
    ----------
    plan, path
        The mission, and file to write.
    rate : float
        Samples per second (Hz); the end of a robot's trajectory is always included.
    """
    rows = []
    for robot, trajectory in enumerate(required("plan", plan, MissionPlan).trajectories):
        if trajectory is not None:
            sample_count(trajectory.duration, rate)
            rows += [(robot, *row) for row in trajectory.sampled(rate, 2).tolist()]
    return write_rows(path, _NAMES, rows)


@dataclass(frozen=True)
class Poly7Reports:
    """Effect of 4-byte floats on the trajectories of a mission.

    Parameters
    ----------
    robots : tuple of int
        The robots that fly.
    starts : tuple of float
        Time at which each robot leaves the depot, s: a poly7 file begins at 0.
    reports : tuple of Poly7Report
        One report per robot.
    """

    robots: tuple[int, ...]
    starts: tuple[float, ...]
    reports: tuple[Poly7Report, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the reports as JSON data."""
        rows = zip(self.robots, self.starts, self.reports, strict=True)
        return {"files": [{"robot": k, "start": t, **report.to_dict()} for k, t, report in rows]}

    def __str__(self) -> str:
        rows = zip(self.robots, self.starts, self.reports, strict=True)
        lines = [f"robot {k}, to be started at {t:.6g} s\n{report}" for k, t, report in rows]
        if not all(report.fits for report in self.reports):
            lines.append(_FEWER)
        return "\n".join(lines)


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
        Path from which the names of the files are derived.
    height : float
        z of all robots, m.
    strict : bool
        Refuse more pieces than fit into the firmware's memory, instead of reporting it.

    Returns
    -------
    Poly7Reports
        Start time of each robot, and the effect of rounding on each trajectory.

    Raises
    ------
    InvalidData
        A trajectory has too many pieces with `strict`. No file is written, and the message names the option
        of `staged` that gives fewer.
    """
    from ...models.minimum_snap.trajectory import Trajectory

    file, strict = as_path(path), Flag().coerce("strict", strict, {})
    for k, trajectory in enumerate(required("plan", plan, MissionPlan).trajectories):
        if strict and trajectory is not None and trajectory.segments > PIECES_THAT_FIT:
            raise InvalidData(
                f"trajectories[{k}] must have at most {PIECES_THAT_FIT} pieces, got "
                f"{trajectory.segments}; {_FEWER}",
                field="trajectories",
            )
    robots, starts, reports = [], [], []
    for k, trajectory in enumerate(plan.trajectories):
        if trajectory is None:
            continue
        level = np.zeros((trajectory.segments, trajectory.degree + 1, 1))
        level[:, 0] = height
        coefficients = np.concatenate([trajectory.coefficients, level], axis=2)
        target = file.with_name(f"{file.stem}-{k}{file.suffix}")
        robots.append(k)
        starts.append(float(trajectory.times[0]))
        reports.append(write_poly7(Trajectory(trajectory.times, coefficients), target))
    return Poly7Reports(tuple(robots), tuple(starts), tuple(reports))


def write_mission_geojson(
    plan: MissionPlan, path: str | os.PathLike[str], *, model: FleetMission, rate: float = 10.0
) -> Path:
    """Write obstacles, depot, nodes and the robots' curves as GeoJSON, in one step; return the path.

    Coordinates are metres in the map's plane, not longitudes and latitudes.

    Parameters
    ----------
    plan, path, model
        The mission, file to write, and model of the plan.
    rate : float
        Points of a curve per second (Hz).
    """
    required("plan", plan, MissionPlan)
    required("model", model, FleetMission)
    features: list[tuple[str, Any, dict[str, Any]]] = [
        ("Polygon", [closed_ring(ring) for ring in (area.shell, *area.holes)], {"obstacle": k})
        for k, area in enumerate(model.obstacles)
    ]
    features.append(("Point", model.depot.tolist(), {"depot": True}))
    visits = {
        node: (robot, float(t))
        for robot, (route, times) in enumerate(zip(plan.routes, plan.visits, strict=True))
        for node, t in zip(route, times, strict=True)
    }
    for k, node in enumerate(model.nodes.tolist()):
        robot, t = visits.get(k, (None, None))
        features.append(("Point", node, {"node": model.label(k), "robot": robot, "time": t}))
    for robot, trajectory in enumerate(plan.trajectories):
        if trajectory is not None:
            line = trajectory.sampled(rate, 0)
            properties = {"robot": robot, "times": line[:, 0].tolist()}
            features.append(("LineString", line[:, 1:].tolist(), properties))
    return write_geojson(path, features)


SAMPLES = ExportFormat("samples of all robots (CSV)", ".csv", write_mission_samples)
POLY7 = ExportFormat(
    "pieces of degree 7 as Crazyflies fly them, a file each (CSV)", ".csv", write_mission_poly7
)
GEOJSON = ExportFormat("map and curves (GeoJSON, in metres)", ".geojson", write_mission_geojson)

#: Replaces ``"obstacles": "file.geojson"`` in an instance by the polygons, whose coordinates are metres.
resolve_references = reference("obstacles", lambda file: {"obstacles": read_geojson_polygons(file)})
