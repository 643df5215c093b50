"""Catalogue of grid paths: a map similar to the paper's, and further cases."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.grid_path.gridmap import GridMap
from ...models.grid_path.model import GridPath
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generators import maze, random_cells, random_nodes, random_polygons, rooms

__all__ = ["PAPER", "catalogue_entries", "paper_map"]

PAPER = (
    "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for Multirobot in Obstacle "
    "Environment, Wireless Communications and Mobile Computing, 2021"
)

#: Bounds (m) and seed of the map similar to the paper's, and a depot outside all obstacles (m).
BOUNDS, SEED, DEPOT = (0.0, 0.0, 200.0, 200.0), 28, (100.0, 100.0)

_OURS = "Ours: the paper has no such instance."
_LOST = "The paper prints no coordinates: the polygons are ours by seed, with their number."


def paper_map(cell: float = 2.5, radius: float = 1.0) -> GridMap:
    """Return the map of 28 irregular polygons on 200 m × 200 m around a depot in the middle.

    Parameters
    ----------
    cell : float, default 2.5
        Side of a cell, m.
    radius : float, default 1
        Radius of the robot, m.

    Returns
    -------
    GridMap
        Map with the lower left corner at (0, 0).
    """
    polygons = random_polygons(28, SEED, BOUNDS, keep=[DEPOT], gap=6.0)
    return GridMap.from_polygons(polygons, BOUNDS, cell, radius)


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of grid paths."""
    rows = (
        Row(
            "paper-map",
            "Across 28 irregular polygons on 200 m × 200 m, for a robot of radius 1 m",
            lambda: _pose(paper_map(), (1, 1), (78, 78)),
            _LOST,
        ),
        Row(
            "any-angle",
            "Straight lines in any direction across the same polygons, on cells of 5 m",
            lambda: _pose(paper_map(5.0), (1, 1), (38, 31), connectivity="any"),
            _LOST,
        ),
        Row(
            "corners",
            "Any direction among random cells, many of which touch at corners",
            lambda: _pose(random_cells(24, 24, 0.3, 9), (0, 0), (23, 23), connectivity="any"),
            f"{_OURS} A path may turn at corners of blocked cells, but not pass between two that touch.",
        ),
        Row(
            "errands",
            "From the depot to 6 goals each, by four neighbours as in the paper",
            _errands,
            _LOST,
        ),
        Row(
            "maze",
            "A maze of 41 × 41 cells with one way between any two",
            lambda: _pose(maze(41, 41, 1), (1, 1), (39, 39)),
        ),
        Row(
            "rooms",
            "49 rooms, and the nearest of 3 goals",
            lambda: _pose(rooms(57, 57, 1), (28, 28), [(1, 1), (1, 55), (55, 55)]),
            f"{_OURS} Many paths are equally long.",
        ),
        Row(
            "terrain",
            "Random cells, where a metre costs from 1 to 100",
            _terrain,
            f"{_OURS} The shortest path is not the cheapest.",
        ),
        Row(
            "pocket",
            "Out of a pocket that opens away from the goal",
            _pocket,
            f"{_OURS} A search that goes straight for the goal fills the pocket first.",
            Provenance.OURS,
        ),
        Row(
            "passage",
            "A passage that leaves a robot of radius 0.3 m one row of cells, to the last digit",
            _passage,
            f"{_OURS} Two walls are 0.9 m apart, and cells measure 0.3 m, none of which floats hold "
            "exactly: contact does not block.",
            Provenance.OURS,
        ),
        Row(
            "one-cell",
            "A map with one free cell, which is start and goal",
            _one_cell,
            f"{_OURS} The optimum is to stay.",
            Provenance.OURS,
            {"optimum": 0.0, "source": "no path is shorter than none"},
        ),
        Row(
            "unreachable",
            "A goal that touches the outside at a corner only",
            _unreachable,
            f"{_OURS} There is no path: none leads between cells that touch at a corner.",
            Provenance.OURS,
        ),
    )
    return listed("grid-path", "grid-path", PAPER, rows, note=_OURS)


# -- the instances -------------------------------------------------------------------------------


def _errands() -> GridPath:
    grid = paper_map(4.0)
    depot = grid.cells_of(DEPOT)
    goals = grid.cells_of(random_nodes(grid, DEPOT, 6, SEED))
    return _pose(grid, depot, goals, connectivity="4", reach="each")


def _terrain() -> GridPath:
    grid = random_cells(40, 40, 0.2, 6)
    coarse = np.random.default_rng(4).random((8, 8))
    weights = np.round(100.0**coarse, 3).repeat(5, axis=0).repeat(5, axis=1)
    return _pose(grid, (0, 0), (39, 39), weights=weights)


def _pocket() -> GridPath:
    blocked = np.zeros((30, 40), bool)
    blocked[5:25, 30] = blocked[5, 8:31] = blocked[24, 8:31] = True
    return _pose(GridMap(blocked), (14, 27), (14, 36))


def _passage() -> GridPath:
    lower, upper = ((2.4, -0.6), (3.9, 0.9)), ((2.4, 1.8), (3.9, 4.2))
    walls = [[(a, c), (b, c), (b, d), (a, d)] for (a, c), (b, d) in (lower, upper)]
    grid = GridMap.from_polygons(walls, (0.0, -0.6, 6.3, 4.2), 0.3, 0.3)
    return _pose(grid, grid.cells_of((0.75, 0.15)), grid.cells_of((5.55, 3.45)))


def _one_cell() -> GridPath:
    return _pose({"blocked": ["@@@", "@.@", "@@@"]}, (1, 1), (1, 1))


def _unreachable() -> GridPath:
    lines = ["......", "..@@@.", "..@..@", "..@..@", "...@@.", "......"]
    return _pose({"blocked": lines}, (0, 0), (2, 4))


def _pose(grid: GridMap | dict[str, Any], start: Any, goals: Any, **others: Any) -> GridPath:
    return GridPath.from_data({"map": grid, "start": start, "goals": goals, **others})
