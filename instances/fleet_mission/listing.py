"""Catalogue entries of fleet missions: one with the paper's numbers, and special cases."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...models.fleet_mission.model import FleetMission
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from ..grid_path.listing import PAPER
from .generator import random_mission

__all__ = ["PAPER", "catalogue_entries"]

_OURS = "Ours: the paper has no such instance."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    ours = Provenance.OURS
    rows = (
        Row(
            "paper",
            "4 robots, 75 nodes and 28 irregular polygons on 200 m × 200 m",
            partial(random_mission, 75, 28, 4, 28),
            "The paper prints no coordinates: polygons and nodes are ours by seed, with its numbers. The "
            "depot is in the middle; Figure 2 has it at the bottom left.",
        ),
        Row(
            "example",
            "Three robots, one map, equal batteries",
            _example,
            f"{_OURS} The longest way of the three is to be short.",
        ),
        Row(
            "pocket",
            "A depot in a pocket that opens away from both nodes",
            _pocket,
            f"{_OURS} The straight line to each node leads through a wall.",
            ours,
        ),
        Row(
            "corridor",
            "2 robots that must share a passage, and keep 1 m from one another",
            _corridor,
            f"{_OURS} The passage is one cell wide, so one robot waits for the other.",
            ours,
        ),
        Row(
            "nested",
            "Polygons that touch, overlap and nest, and one with a hole",
            _nested,
            f"{_OURS} A node lies within a frame that opens away from the depot.",
            ours,
        ),
        Row(
            "one-place",
            "As many robots as nodes, all at one place",
            _one_place,
            f"{_OURS} All ways are equally long.",
            ours,
        ),
        Row(
            "one-cell",
            "A free space of one cell, which holds the depot and the nodes",
            _one_cell,
            f"{_OURS} Two robots move by centimetres, and a third stays where it is.",
            ours,
        ),
    )
    return listed("fleet-mission", "fleet-mission", PAPER, rows)


def _box(x: float, y: float, right: float, top: float) -> list[list[float]]:
    return [[x, y], [right, y], [right, top], [x, top]]


def _example() -> FleetMission:
    from dataclasses import replace

    from ...models.fleet.data import Objective

    mission = random_mission(
        9, 5, 3, 3, bounds=(0.0, 0.0, 40.0, 30.0), cell=0.5, radius=0.3, velocity_limit=1.0,
        acceleration_limit=0.5, separation=0.8,
    )  # fmt: skip
    return replace(mission, objective=Objective.LEXICOGRAPHIC)


def _mission(**data: Any) -> FleetMission:
    return FleetMission.from_data(data)


def _pocket() -> FleetMission:
    return _mission(
        obstacles=[_box(4, 3, 5, 9), _box(5, 3, 11, 4), _box(5, 8, 11, 9)],
        bounds=[0, 0, 14, 12], nodes=[[2, 6], [1.5, 10.5]], depot=[6.5, 6], vehicles=1, cell=0.5,
        radius=0.25,
    )  # fmt: skip


def _corridor() -> FleetMission:
    # The passage leaves a robot of radius 0.25 m one row of cells.
    return _mission(
        obstacles=[_box(4, 0, 6, 3.25), _box(4, 4.25, 6, 8)], bounds=[0, 0, 10, 8],
        nodes=[[8.25, 2.25], [8.25, 5.75]], depot=[1.25, 4], vehicles=2, cell=0.5, radius=0.25,
        separation=1.0,
    )  # fmt: skip


def _nested() -> FleetMission:
    # A frame in the form of a C, whose opening is on the right.
    frame = [
        *([3, 3], [9, 3], [9, 5], [8, 5], [8, 4], [4, 4]),
        *([4, 8], [8, 8], [8, 7], [9, 7], [9, 9], [3, 9]),
    ]
    ring = {"shell": _box(11, 1, 15, 5), "holes": [_box(12, 2, 14, 4)]}
    more = [_box(5, 8.25, 6, 8.75), _box(9, 8, 11, 9), _box(10, 8, 12, 10)]
    return _mission(
        obstacles=[frame, ring, *more], bounds=[0, 0, 16, 12], nodes=[[5, 6], [13, 7], [1, 1]],
        depot=[1, 11], vehicles=2, cell=0.5, radius=0.25,
    )  # fmt: skip


def _one_place() -> FleetMission:
    return _mission(
        obstacles=[_box(4, 2, 6, 8)], bounds=[0, 0, 10, 10], nodes=[[8.5, 5.5]] * 3,
        depot=[1.5, 5.5], vehicles=3, cell=0.5, radius=0.3,
    )  # fmt: skip


def _one_cell() -> FleetMission:
    shell = {"shell": _box(-1, -1, 2, 2), "holes": [_box(0, 0, 1, 1)]}
    return _mission(
        obstacles=[shell], bounds=[-1, -1, 2, 2], nodes=[[0.4, 0.5], [0.5, 0.6], [0.5, 0.5]],
        depot=[0.5, 0.5], vehicles=3, cell=1.0,
    )  # fmt: skip
