"""Maps and scenarios of the benchmark sets of MovingAI (https://movingai.com/benchmarks/formats.html).

A map has four lines of header, then a letter a cell; the first line of letters is row 0. A scenario
is a start and a goal, with the length of the shortest path by steps to eight neighbours that cut no
corners.
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
from ..storage import number

__all__ = ["Scenario", "read_map", "read_scenarios", "write_map"]

#: Free cells; a swamp (S) may be entered as any other.
_FREE = ".GS"
_HEADER = ("type octile", "height", "width", "map")
#: Columns of a scenario: the start and the goal are x (column) and y (row).
_COLUMNS = (
    *("bucket", "map", "width", "height"),
    *("start x", "start y", "goal x", "goal y", "optimum"),
)
_WHOLE = re.compile("[0-9]{1,9}")


def read_map(path: str | os.PathLike[str], *, cell: float = 1.0) -> GridMap:
    """Return the map in a ``.map`` file; its cells have the side `cell` (m).

    ``.``, ``G`` and ``S`` are free, ``@``, ``O``, ``T`` and ``W`` blocked.

    Raises
    ------
    InvalidData
        Naming file, line and column: another header, too few or too many lines, unknown letters.
    """
    file = as_path(path)
    lines = read_text(file).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    sizes = []
    for place, wanted in enumerate(_HEADER):
        words = lines[place].split() if place < len(lines) else []
        sized = wanted in ("height", "width")
        good = len(words) == 2 and words[0] == wanted if sized else " ".join(words) == wanted
        if not good or (sized and not _WHOLE.fullmatch(words[1])):
            raise InvalidData(
                f"{file}, line {place + 1}: must be {wanted}{' and a number' * sized}, got "
                f"{show(' '.join(words))}",
                field="map",
            )
        if sized:
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
    return _made(file, blocked, cell=cell)


def _made(file: Path, blocked: Any, **options: Any) -> GridMap:
    """Return the map of cells that `file` holds."""
    try:
        return GridMap(blocked, **options)
    except InvalidData as error:
        if error.field != "blocked":
            raise
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def write_map(grid: GridMap, path: str | os.PathLike[str]) -> Path:
    """Write a map as a ``.map`` file, in one step; return the path.

    The file holds the cells alone: not their size, nor where the map lies.
    """
    rows, columns = required("grid", grid, GridMap).shape
    head = ["type octile", f"height {rows}", f"width {columns}", "map"]
    return write_text(path, "\n".join([*head, *grid.data()["blocked"]]) + "\n")


class Scenario(NamedTuple):
    """A question about a map, and the answer that its authors give.

    Attributes
    ----------
    start, goal : tuple of int
        Row and column.
    optimum : float
        Length of the shortest path by steps to eight neighbours without cutting corners, m; files
        print from five to nine digits behind the point of its cells.
    bucket : int
        Group of the scenario: in most files, a quarter of the optimum in cells.
    """

    start: tuple[int, int]
    goal: tuple[int, int]
    optimum: float
    bucket: int

    def pose(self, grid: GridMap, **options: Any) -> GridPath:
        """Return the model on `grid`; `options` are further fields of it."""
        data = {"map": grid, "start": self.start, "goals": self.goal, **options}
        return GridPath.from_data(data)


def read_scenarios(
    path: str | os.PathLike[str], grid: GridMap, *, bucket: int | None = None
) -> list[Scenario]:
    """Return the scenarios in a ``.scen`` file.

    Parameters
    ----------
    path : path-like
        The file.
    grid : GridMap
        The map that it is about; the name of a map in the file is not followed.
    bucket : int, optional
        The only one that is wanted.

    Raises
    ------
    InvalidData
        Naming file, line and column: another number of columns, what is no number, a map of another
        size, ends off the map or blocked.
    """
    file = as_path(path)
    rows, columns = required("grid", grid, GridMap).shape
    found = []
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
        held = dict(zip(_COLUMNS, values, strict=True))
        whole = {}
        for name in _COLUMNS[:1] + _COLUMNS[2:8]:
            if not _WHOLE.fullmatch(held[name]):
                raise InvalidData(
                    f"{where}, column {name}: must be a whole number >= 0, got {show(held[name])}",
                    field=name,
                )
            whole[name] = int(held[name])
        optimum = number(held["optimum"], f"{where}, column optimum", "optimum")
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
            found.append(Scenario(ends["start"], ends["goal"], length, whole["bucket"]))
    return found
