"""Demonstration of grid paths: a path across a map of 28 polygons, or on a map from a file."""

from __future__ import annotations

from typing import Any

from ...errors import InvalidData
from ...models.grid_path.model import GridPath
from ..demos import Demo, DemoOption
from .maps import read_grid

__all__ = ["DEMO"]


def _from_file(map: str, start: str, goal: str, connectivity: str) -> GridPath:  # noqa: A002 - the option's name
    """Return the model of a path on the map in a file."""
    data: dict[str, Any] = {"map": read_grid(map), "connectivity": connectivity}
    for name, key, text in (("start", "start", start), ("goal", "goals", goal)):
        try:
            data[key] = [int(part) for part in text.split(",")]
        except ValueError:
            raise InvalidData(f"{name} must be ROW,COLUMN, got {text!r}", field=key) from None
    return GridPath.from_data(data)


DEMO = Demo(
    "grid-path/paper-map",
    {
        "map": DemoOption(
            "A map (.map, .txt, .png) instead of grid-path/paper-map.", metavar="FILE"
        ),
        "start": DemoOption("ROW,COLUMN for --map.", default="0,0"),
        "goal": DemoOption("ROW,COLUMN for --map.", default="0,0"),
        "connectivity": DemoOption("8, 4 or any for --map.", default="8"),
    },
    _from_file,
)
