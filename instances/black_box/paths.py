"""Seeded maps for the planning of waypoint paths, similar to those of the paper's section 5."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import UnknownName
from ...models.black_box import BlackBoxMinimisation, path_problem
from ...models.grid_path import GridMap, GridPath
from ..grid_path import random_cells, random_polygons, rooms

__all__ = ["PATHS", "PathMap", "path_grid", "path_instance"]


class PathMap(NamedTuple):
    """Map with its start and goal.

    Parameters
    ----------
    title : str
        Title of the map.
    note : str
        Remark on the map.
    waypoints : int
        Number of points at which a path may turn, at least as many as the shortest path needs.
    grid : callable
        Function that returns the model of paths in any direction from start to goal.
    """

    title: str
    note: str
    waypoints: int
    grid: Callable[[], GridPath]


def path_grid(name: str) -> GridPath:
    """Return the grid model of an instance, for paths in any direction.

    Parameters
    ----------
    name : str
        A name in ``PATHS``.

    Returns
    -------
    GridPath
        The model.

    Raises
    ------
    UnknownName
        The name does not exist.
    """
    if name not in PATHS:
        raise UnknownName("map of paths", name, PATHS)
    return PATHS[name].grid()


def path_instance(name: str, budget: int = 10_000) -> BlackBoxMinimisation:
    """Return an instance: the waypoints of a path on a map of ``PATHS``.

    Parameters
    ----------
    name : str
        A name in ``PATHS``.
    budget : int
        Largest number of evaluations of a run.

    Returns
    -------
    BlackBoxMinimisation
        The instance.
    """
    grid = path_grid(name)
    return path_problem(grid, PATHS[name].waypoints, budget=budget)


# -- the maps ------------------------------------------------------------------------------------


def _gap() -> GridPath:
    blocked = np.zeros((40, 40), bool)
    blocked[:, 20] = True
    blocked[3, 20] = False
    return _between(blocked, (35, 4), (35, 35))


def _pocket() -> GridPath:
    blocked = np.zeros((30, 30), bool)
    blocked[7:23, 22] = blocked[7, 8:23] = blocked[22, 8:23] = True
    return _between(blocked, (15, 18), (15, 27))


def _enclosed() -> GridPath:
    blocked = np.zeros((20, 20), bool)
    blocked[12:17, 12:17] = True
    blocked[13:16, 13:16] = False
    return _between(blocked, (2, 2), (14, 14))


def _polygons(side: int, count: int, seed: int, radius: float) -> GridPath:
    """Return a path across a square map of polygons for a round robot, with cells of 1 m."""
    bounds = (0.0, 0.0, float(side), float(side))
    ends = [(1.5, 1.5), (side - 1.5, side - 1.5)]
    polygons = random_polygons(count, seed, bounds, keep=ends, gap=0.5)
    grid = GridMap.from_polygons(polygons, bounds, 1.0, radius)
    return _grid_path(grid, *grid.cells_of(ends))


def _across(grid: GridMap) -> GridPath:
    """Return a path from the first to the last cell of the largest connected part of a map."""
    from scipy.ndimage import label

    parts, _ = label(~grid.blocked)
    largest = 1 + int(np.bincount(parts.ravel())[1:].argmax())
    cells = np.argwhere(parts == largest)
    return _grid_path(grid, cells[0], cells[-1])


def _between(blocked: NDArray[np.bool_], start: tuple[int, int], goal: tuple[int, int]) -> GridPath:
    return _grid_path(GridMap(blocked), np.array(start), np.array(goal))


def _grid_path(grid: GridMap, start: NDArray[np.int64], goal: NDArray[np.int64]) -> GridPath:
    return GridPath.from_data({"map": grid, "start": start, "goals": goal, "connectivity": "any"})


#: Maps by name, from easy to hard.
PATHS: Mapping[str, PathMap] = MappingProxyType(
    {
        "open": PathMap(
            "Across 20 × 20 free cells",
            "The optimum is the straight line.",
            3,
            lambda: _between(np.zeros((20, 20), bool), (0, 0), (19, 19)),
        ),
        "cells": PathMap(
            "Among single blocked cells on 20 × 20",
            "Many paths are about as good.",
            5,
            lambda: _across(random_cells(20, 20, 0.1, 3)),
        ),
        "blocks": PathMap(
            "Among 8 polygons on 20 m × 20 m", "", 4, lambda: _polygons(20, 8, 4, 0.0)
        ),
        "polygons-30": PathMap(
            "Among 14 polygons on 30 m × 30 m, for a robot of radius 0.3 m",
            "",
            5,
            lambda: _polygons(30, 14, 11, 0.3),
        ),
        "polygons-40": PathMap(
            "Among 24 polygons on 40 m × 40 m, for a robot of radius 0.3 m",
            "",
            5,
            lambda: _polygons(40, 24, 10, 0.3),
        ),
        "gap": PathMap(
            "Through the one gap of a wall on 40 × 40 cells",
            "The gap is one cell wide and far from the straight line.",
            3,
            _gap,
        ),
        "pocket": PathMap(
            "Out of a pocket on 30 × 30 cells",
            "It opens away from the goal, so that every way out is longer at first.",
            4,
            _pocket,
        ),
        "corners": PathMap(
            "Among cells that touch at corners, on 24 × 24",
            "Between two blocked cells that touch there is no way.",
            10,
            lambda: _across(random_cells(24, 24, 0.3, 9)),
        ),
        "rooms": PathMap(
            "Through 9 rooms on 37 × 37 cells",
            "Doors are one cell wide.",
            8,
            lambda: _across(rooms(37, 37, 4, size=11, doors=0.8)),
        ),
        "enclosed": PathMap(
            "To a goal that is walled in, on 20 × 20 cells",
            "There is no free path: the best one crosses the wall by the shortest way.",
            3,
            _enclosed,
        ),
    }
)
