"""Readers of scenes: drawings in text files, and maps of MovingAI with starts and targets."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import Array
from ...models.grid_path.gridmap import read_cells
from ...models.unknown_grid.model import UnknownGridNavigation
from ..grid_path.movingai import read_map
from ..map_files import map_of_file
from ..storage import Find, reference
from .laws import SceneArrays

__all__ = ["read_map_scenes", "read_scenes", "resolve_references", "scenes_on_map"]

#: Letters of start and target in drawings.
_ENDS = {"S": "start", "T": "target"}


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
    lines = [line.rstrip() for line in read_text(file).splitlines()]
    blocked: list[Any] = []
    ends: dict[str, list[tuple[int, int]]] = {letter: [] for letter in _ENDS}
    for first, drawing in _split(lines):
        where = f"{file}, line {first}"
        for letter, word in _ENDS.items():
            cells = [
                (r, c) for r, line in enumerate(drawing) for c, x in enumerate(line) if x == letter
            ]
            if not cells:
                raise InvalidData(
                    f"{where}: the drawing that begins here must have one {letter} ({word}), got none",
                    field=f"{word}s",
                )
            if len(cells) > 1:
                row, column = cells[1]
                raise InvalidData(
                    f"{file}, line {first + row}, column {column + 1}: must not be a second {letter} "
                    f"({word}) in the drawing that begins in line {first}",
                    field=f"{word}s",
                )
            ends[letter].append(cells[0])
        plain = [line.replace("S", ".").replace("T", ".") for line in drawing]
        drawn = read_cells(plain, str(file), (first, 1))
        if blocked and drawn.shape != blocked[0].shape:
            raise InvalidData(
                f"{where}: the drawing that begins here must have {_size(blocked[0].shape)} cells as the "
                f"first, got {_size(drawn.shape)}",
                field="blocked",
            )
        blocked.append(drawn)
    if not blocked:
        raise InvalidData(f"{file}: must hold at least one drawing, got none", field="blocked")
    return SceneArrays(np.array(blocked), np.array(ends["S"]), np.array(ends["T"]))


def _split(lines: list[str]) -> list[tuple[int, list[str]]]:
    """Return the drawings between empty lines, each with the number of its first line."""
    drawings: list[tuple[int, list[str]]] = []
    open_drawing = False
    for number, line in enumerate(lines, start=1):
        if line and not open_drawing:
            drawings.append((number, []))
        if line:
            drawings[-1][1].append(line)
        open_drawing = bool(line)
    return drawings


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[0]} × {shape[1]}"


def _scenes_of(file: Path) -> dict[str, Any]:
    """Return the data of an instance from the drawings in a file."""
    scenes = _read_drawings(file)
    return {**scenes._asdict(), "shape": scenes.blocked.shape[1:]}


#: Replaces ``"scenes": "traps.txt"`` in an instance by the scenes in the file.
resolve_references = reference("scenes", _scenes_of, only=True)
