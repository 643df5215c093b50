"""Catalogue of flights: maps of all four forms, vehicles of all kinds, and special cases."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.fleet_mission import MovingObstacle
from ...models.flight import Flight
from ...models.grid_path import GridMap
from ...models.minimum_snap import DifferentialDrive, PointMass, Quadrotor
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generators import forest

__all__ = ["SOURCE", "catalogue_entries"]

SOURCE = (
    "Geometrically Constrained Trajectory Optimization for Multicopters, IEEE Transactions on "
    "Robotics 38(5), 2022"
)
_OURS = "Ours: the paper has no such instance."
_WALL = [[4.0, -3.0], [6.0, -3.0], [6.0, 3.0], [4.0, 3.0]]


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    ours = Provenance.OURS
    rows = (
        Row("wall", "A point mass around a wall", _wall, _OURS, ours),
        Row(
            "forest",
            "A quadrotor through 120 pillars and 30 rings on 50 m × 50 m × 5 m",
            _forest,
            "A map by seed in the manner of the examples of the paper's program GCOPTER.",
        ),
        Row("cloud", "A quadrotor past 400 points", _cloud, _OURS),
        Row("rooms", "A robot on two wheels through two doors", _rooms, _OURS, ours),
        Row("snap", "Jerk replaced by snap, weighted with the time, past two waypoints", _snap, _OURS, ours),
        Row("crossing", "A moving obstacle that crosses the way", _crossing, _OURS, ours),
        Row("no-way", "A goal behind a closed wall", _no_way, _OURS, ours),
        Row("one-place", "A start that is the goal", _one_place, _OURS, ours),
    )  # fmt: skip
    return listed("flight", "flight", SOURCE, rows)


def _quadrotor() -> Quadrotor:
    return Quadrotor(0.61, (2.0, 12.0), tilt=1.05, body_rate=2.1, speed=4.0)


def _wall() -> Flight:
    return Flight([_WALL], (0, 0), (10, 0), PointMass(2.0, 1.0), radius=0.3)


def _forest() -> Flight:
    ends = [[2.0, 2.0, 2.5], [48.0, 48.0, 2.5]]
    world = forest(1, keep=ends)
    return Flight(world, ends[0], ends[1], _quadrotor(), radius=0.2)


def _cloud() -> Flight:
    rng = np.random.default_rng(5)
    points = np.round(rng.random((400, 3)) * [18.0, 10.0, 4.0] + [1.0, 0.0, 0.0], 3)
    return Flight(points, (-1, 5, 2), (21, 5, 2), _quadrotor(), radius=0.4, cell=0.25)


def _rooms() -> Flight:
    lines = ["." * 24 for _ in range(16)]
    lines = [line[:8] + ("." if k in (2, 3) else "@") + line[9:] for k, line in enumerate(lines)]
    lines = [
        line[:16] + ("." if k in (11, 12) else "@") + line[17:] for k, line in enumerate(lines)
    ]
    vehicle = DifferentialDrive(0.8, 0.8, 0.3)
    return Flight(GridMap(lines, 0.5), (1, 6), (11, 1), vehicle, radius=0.2)


def _snap() -> Flight:
    stops: Any = [[5.0, 4.0], [7.0, 4.0]]
    return Flight(
        [_WALL], (0, 0), (10, 0), PointMass(3.0, 3.0), radius=0.3, waypoints=stops, order=4,
        objective="weighted", time_weight=50.0,
    )  # fmt: skip


def _crossing() -> Flight:
    cart = MovingObstacle(0.5, [0.0, 8.0], [[5.0, -4.0], [5.0, 4.0]])
    return Flight([], (0, 0), (10, 0), PointMass(1.5, 1.0), radius=0.3, moving=[cart], cell=0.1)


def _no_way() -> Flight:
    lines = ["........", "..@@@@..", "..@..@..", "..@..@..", "..@@@@..", "........"]
    return Flight(GridMap(lines), (1, 1), (4, 3), PointMass(1.0, 1.0), radius=0.2)


def _one_place() -> Flight:
    return Flight([_WALL], (0, 0), (0, 0), PointMass(2.0, 1.0))
