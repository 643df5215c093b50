"""Readers of scenes: drawings in text files, and maps of MovingAI with starts and targets."""

from __future__ import annotations

import os
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import Array
from ...models.grid_path.gridmap import read_cells
from ...models.unknown_grid.model import UnknownGridNavigation, split_drawing
from ..grid_path.movingai import read_map
from ..map_files import map_of_file
from ..storage import Find, reference
from .laws import SceneArrays

__all__ = ["read_map_scenes", "read_scenes", "resolve_references", "scenes_on_map"]


def read_scenes(path: str | os.PathLike[str], **fields: Any) -> UnknownGridNavigation:
    """Return the scenes drawn in a text file with one character per cell.

    Parameters
    ----------
    path : path-like
        File in which ``.`` and ``G`` are free, ``@``, ``O``, ``W`` and ``#`` are blocked, one ``S`` per
        drawing is the start and one ``T`` the target. Empty lines separate the drawings, which have equal
        numbers of rows and columns.
    **fields
        Further fields of the model, such as `view`.

    Returns
    -------
    UnknownGridNavigation
        Model with one scene per drawing.

    Raises
    ------
    InvalidData
        A character is unknown, the sizes of lines or drawings differ, or a drawing has not exactly one start
        and one target. The message names file, line and column.
    """
    return _read_drawings(as_path(path)).pose(**fields)


def read_map_scenes(
    path: str | os.PathLike[str], starts: ArrayLike, targets: ArrayLike, **fields: Any
) -> UnknownGridNavigation:
    """Return scenes on the map in a ``.map`` file of MovingAI.

    Parameters
    ----------
    path : path-like
        File, see :func:`~crosstrack.instances.grid_path.read_map`.
    starts, targets : array-like of int, shape (k, 2)
        Row and column in each scene.
    **fields
        Further fields of the model.

    Returns
    -------
    UnknownGridNavigation
        Model with k scenes on the same map.

    Raises
    ------
    InvalidData
        The file is not a valid map (the message names file, line and column), or a start or target is blocked
        or outside the map.
    """
    return _scenes_on(read_map(path).blocked, starts, targets, **fields)


def scenes_on_map(
    path: Path, *, form: str, find: Find, starts: Any, targets: Any, **data: Any
) -> UnknownGridNavigation:
    """Return the scenes on the map in a file of the format `form`; see :func:`.map_files.map_of_file`."""
    grid, fields = map_of_file(path, form, find, data)
    return _scenes_on(grid.blocked, starts, targets, **fields)


def _scenes_on(
    blocked: NDArray[np.bool_], starts: ArrayLike, targets: ArrayLike, **fields: Any
) -> UnknownGridNavigation:
    """Return scenes on the same map."""
    sizes: dict[str, tuple[int, str]] = {}
    first = Array(("k", 2), int).coerce("starts", starts, sizes)
    last = Array(("k", 2), int).coerce("targets", targets, sizes)
    maps = np.broadcast_to(blocked, (len(first), *blocked.shape))
    return SceneArrays(maps, first, last).pose(**fields)


def _read_drawings(file: Path) -> SceneArrays:
    """Return the scenes in the text of a file."""
    lines = enumerate((line.rstrip() for line in read_text(file).splitlines()), start=1)
    blocked: list[NDArray[np.bool_]] = []
    starts, targets = [], []
    for is_drawing, numbered in groupby(lines, key=lambda entry: entry[1] != ""):
        if not is_drawing:
            continue
        numbers, drawing = zip(*numbered, strict=True)
        first, where = numbers[0], f"{file}, line {numbers[0]}: the drawing that begins here"
        plain, start, target = split_drawing(where, drawing, (first, 1))
        drawn = read_cells(plain, str(file), (first, 1))
        if blocked and drawn.shape != blocked[0].shape:
            raise InvalidData(
                f"{where} must have {_size(blocked[0].shape)} cells as the first, got "
                f"{_size(drawn.shape)}",
                field="blocked",
            )
        blocked.append(drawn)
        starts.append(start)
        targets.append(target)
    if not blocked:
        raise InvalidData(f"{file}: must hold at least one drawing, got none", field="blocked")
    return SceneArrays(np.array(blocked), np.array(starts), np.array(targets))


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[0]} × {shape[1]}"


def _scenes_of(file: Path) -> dict[str, Any]:
    """Return the data of an instance from the drawings in a file."""
    scenes = _read_drawings(file)
    return {**scenes._asdict(), "shape": scenes.blocked.shape[1:]}


#: Replaces ``"scenes": "traps.txt"`` in an instance by the scenes in the file.
resolve_references = reference("scenes", _scenes_of, only=True)
