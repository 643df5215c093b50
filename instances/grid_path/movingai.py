"""Maps and scenarios of the benchmark sets of MovingAI (https://movingai.com/benchmarks/formats.html).

A map has four header lines and one letter per cell; the first line of letters is row 0. A scenario is a
start and a goal with the length of the shortest path along eight neighbours without cutting corners.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, NamedTuple

from ...errors import InvalidData
from ...files import as_path, read_text, write_text
from ...models.fields import required, show
from ...models.grid_path.gridmap import GridMap, read_cells
from ...models.grid_path.model import GridPath
from ..tables import number

__all__ = ["Scenario", "read_map", "read_scenarios", "write_map"]

#: Letters of free cells. Swamp (S) is treated as free.
_FREE = ".GS"
_HEADER = ("type octile", "height", "width", "map")
#: Columns of a scenario: the start and the goal are x (column) and y (row).
_COLUMNS = (
    *("bucket", "map", "width", "height"),
    *("start x", "start y", "goal x", "goal y", "optimum"),
)
_WHOLE = re.compile("[0-9]{1,9}")


def read_map(path: str | os.PathLike[str], *, cell: float = 1.0) -> GridMap:
    """Return the map in a ``.map`` file.

    ``.``, ``G`` and ``S`` are free, ``@``, ``O``, ``T`` and ``W`` are blocked.

    Parameters
    ----------
    path : path-like
        Path of the file.
    cell : float, default 1
        Side of a cell, m.

    Returns
    -------
    GridMap
        Map in the file.

    Raises
    ------
    InvalidData
        The header is wrong, the number of lines is wrong, or a letter is unknown. The message names file,
        line and column.
    """
    file = as_path(path)
    lines = read_text(file).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    sizes = []
    for place, entry in enumerate(_HEADER):
        words = lines[place].split() if place < len(lines) else []
        has_size = entry in ("height", "width")
        good = len(words) == 2 and words[0] == entry if has_size else " ".join(words) == entry
        if not good or (has_size and not _WHOLE.fullmatch(words[1])):
            raise InvalidData(
                f"{file}, line {place + 1}: must be {entry}{' and a number' * has_size}, got "
                f"{show(' '.join(words))}",
                field="map",
            )
        if has_size:
            sizes.append(int(words[1]))
    rows = lines[len(_HEADER) :]
    if len(rows) != sizes[0]:
        raise InvalidData(
            f"{file}: must have {sizes[0]} lines of cells, as line 2 says, got {len(rows)}",
            field="map",
        )
    first = len(_HEADER) + 1
    if rows and len(rows[0]) != sizes[1]:
        raise InvalidData(
            f"{file}, line {first}: must have {sizes[1]} cells, as line 3 says, got {len(rows[0])}",
            field="map",
        )
    blocked = read_cells(rows, str(file), (first, 1), _FREE)
    try:
        return GridMap(blocked, cell)
    except InvalidData as error:
        if error.field != "blocked":
            raise
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def write_map(grid: GridMap, path: str | os.PathLike[str]) -> Path:
    """Write a map as a ``.map`` file, atomically. The size of cells and the origin are lost.

    Parameters
    ----------
    grid : GridMap
        Map to write.
    path : path-like
        Path of the file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    rows, columns = required("grid", grid, GridMap).shape
    head = ["type octile", f"height {rows}", f"width {columns}", "map"]
    return write_text(path, "\n".join([*head, *grid.data()["blocked"]]) + "\n")


class Scenario(NamedTuple):
    """Start and goal on a map with the published length of the shortest path.

    Attributes
    ----------
    start, goal : tuple of int
        Row and column.
    optimum : float
        Length of the shortest path along eight neighbours without cutting corners, m. Files print five to
        nine decimals of the length in cells.
    bucket : int
        Group of the scenario. In most files, it is a quarter of the optimum in cells.
    """

    start: tuple[int, int]
    goal: tuple[int, int]
    optimum: float
    bucket: int

    def pose(self, grid: GridMap, **options: Any) -> GridPath:
        """Return the model on `grid`; `options` are further fields of the model."""
        data = {"map": grid, "start": self.start, "goals": self.goal, **options}
        return GridPath.from_data(data)


def read_scenarios(
    path: str | os.PathLike[str], grid: GridMap, *, bucket: int | None = None
) -> list[Scenario]:
    """Return the scenarios in a ``.scen`` file.

    Parameters
    ----------
    path : path-like
        Path of the file.
    grid : GridMap
        Map of the scenarios. The name of the map in the file is ignored.
    bucket : int, optional
        Group to select. None returns all scenarios.

    Returns
    -------
    list of Scenario
        Scenarios in the order of the file.

    Raises
    ------
    InvalidData
        The number of columns is wrong, a value is not a number, the size of the map differs, or a start or
        goal is not free. The message names file, line and column.
    """
    file = as_path(path)
    rows, columns = required("grid", grid, GridMap).shape
    scenarios = []
    lines = read_text(file).splitlines()
    if not lines or not re.fullmatch(r"version 1(\.0)?", lines[0].strip()):
        got = show(lines[0] if lines else "")
        raise InvalidData(f"{file}, line 1: must be version 1, got {got}", field="version")
    for line, text in enumerate(lines[1:], start=2):
        if not text.strip():
            continue
        # Names of maps may hold spaces, but no tabs.
        values = [value.strip() for value in (text.split("\t") if "\t" in text else text.split())]
        where = f"{file}, line {line}"
        if len(values) != len(_COLUMNS):
            raise InvalidData(
                f"{where}: must have the {len(_COLUMNS)} columns {', '.join(_COLUMNS)}, got "
                f"{len(values)}: {show(text)}",
                field="line",
            )
        entry = dict(zip(_COLUMNS, values, strict=True))
        whole = {}
        for name in _COLUMNS[:1] + _COLUMNS[2:8]:
            if not _WHOLE.fullmatch(entry[name]):
                raise InvalidData(
                    f"{where}, column {name}: must be a whole number >= 0, got {show(entry[name])}",
                    field=name,
                )
            whole[name] = int(entry[name])
        optimum = number(entry["optimum"], f"{where}, column optimum", "optimum")
        if optimum < 0:
            raise InvalidData(
                f"{where}, column optimum: must be >= 0, got {optimum:g}", field="optimum"
            )
        if (whole["height"], whole["width"]) != (rows, columns):
            raise InvalidData(
                f"{where}: is about a map of {whole['height']} × {whole['width']} cells, where the "
                f"given one has {rows} × {columns}",
                field="grid",
            )
        ends = {end: (whole[f"{end} y"], whole[f"{end} x"]) for end in ("start", "goal")}
        for end, place in ends.items():
            if not grid.holds(place):
                raise InvalidData(
                    f"{where}: the {end} must be a free cell, got x {place[1]}, y {place[0]}",
                    field=end,
                )
        if bucket is None or whole["bucket"] == bucket:
            length = optimum * grid.cell
            scenarios.append(Scenario(ends["start"], ends["goal"], length, whole["bucket"]))
    return scenarios
