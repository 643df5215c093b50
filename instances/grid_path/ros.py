"""Maps of ROS: a YAML file with the resolution and the origin beside an image.

Source: the page of ``map_server``, http://wiki.ros.org/map_server, section "Map format".
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import numpy as np

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import show
from ...models.grid_path.gridmap import GridMap
from ...models.records import Member
from ..storage import Find
from ..tables import number
from .images import Unknown, read_brightness

__all__ = ["image_of_ros", "read_ros_map"]

#: Values of keys that a file may omit, those of map_saver.
_DEFAULTS = {
    "origin": ["0", "0", "0"], "negate": ["0"], "occupied_thresh": ["0.65"],
    "free_thresh": ["0.196"], "mode": ["trinary"],
}  # fmt: skip
_KEYS = ("image", "resolution", *_DEFAULTS)
_LINE = re.compile(r"(\w+)\s*:(?:\s+(.*))?")


def read_ros_map(
    path: str | os.PathLike[str], *, find: Find | None = None, unknown: str = "blocked"
) -> GridMap:
    """Return the map in a YAML file of ROS, with its image.

    A pixel is free if its occupancy is below ``free_thresh``, and occupied above
    ``occupied_thresh``. The keys ``negate`` and ``mode`` (``trinary`` or ``scale``) are respected.

    Parameters
    ----------
    path : path-like
        YAML file with ``image``, ``resolution`` (m) and ``origin``.
    find : callable, optional
        Function that returns the path of the image by its name in the file; by default relative to
        the folder of the file.
    unknown : {"blocked", "free"}
        State of the pixels between the thresholds.

    Returns
    -------
    GridMap
        Map whose row 0 is the bottom of the image, with y upward.

    Raises
    ------
    BackendMissing
        Pillow is not installed.
    InvalidData
        A key is unknown, missing or repeated, a value is not a number or out of range, the origin is
        rotated, or the image cannot be read. The message names file, line and key.
    """
    file = as_path(path)
    values = _values(file)
    state = Member(Unknown).coerce("unknown", unknown, {})
    for key in ("image", "resolution"):
        if key not in values:
            raise InvalidData(f"{file}: key {key} is missing", field=key)
    values = {**_DEFAULTS, **values}
    mode = values["mode"][0]
    if mode not in ("trinary", "scale"):
        raise InvalidData(f"{file}: mode must be trinary or scale, got {show(mode)}", field="mode")
    numbers = {
        key: [number(text, f"{file}, key {key}", key) for text in values[key]]
        for key in _KEYS
        if key not in ("image", "mode")
    }
    for key, entry in numbers.items():
        if len(entry) != (3 if key == "origin" else 1):
            raise InvalidData(
                f"{file}: {key} must be {'[x, y, yaw]' if key == 'origin' else 'a number'}, got "
                f"{show(values[key])}",
                field=key,
            )
    if math.remainder(numbers["origin"][2], math.tau):
        raise InvalidData(
            f"{file}: the yaw of the origin must be 0, got {numbers['origin'][2]:g}: rotate the map first",
            field="origin",
        )
    find = find or (lambda name: file.parent / name)
    bright = read_brightness(find(values["image"][0]))
    occupancy = bright if numbers["negate"][0] else 1.0 - bright
    free = occupancy < numbers["free_thresh"][0]
    occupied = occupancy > numbers["occupied_thresh"][0]
    # map_server compares with occupied_thresh first.
    blocked = occupied | ~free if state is Unknown.BLOCKED else occupied
    try:
        return GridMap(
            blocked[::-1], numbers["resolution"][0], np.array(numbers["origin"][:2]), upward=True
        )
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def image_of_ros(file: Path) -> str:
    """Return the name of the image in a YAML file of ROS; empty if it has none."""
    return _values(file).get("image", [""])[0]


def _values(file: Path) -> dict[str, list[str]]:
    """Return the values of each key: one, or the items of a list."""
    result: dict[str, list[str]] = {}
    key = ""
    for line, raw in enumerate(read_text(file).splitlines(), 1):
        text = re.sub(r"(?:^|\s)#.*", "", raw).strip()
        if text in ("", "---", "...") or text.startswith("%YAML"):
            continue
        where = f"{file}, line {line}"
        match = _LINE.fullmatch(text)
        if match:
            key, value = match[1], (match[2] or "").strip()
            if key not in _KEYS or key in result:
                raise InvalidData(
                    f"{where}: each key must be there once and be one of {', '.join(_KEYS)}, got "
                    f"{show(key)}",
                    field=key,
                )
            items = value[1:-1].split(",") if value[:1] + value[-1:] == "[]" else [value]
            result[key] = [part.strip().strip("\"'") for part in items if part]
        elif key and text.startswith("-") and key == "origin":
            result[key].append(text[1:].strip())
        else:
            raise InvalidData(f"{where}: must be 'key: value', got {show(text)}", field="yaml")
    for name, value in result.items():
        if not value:
            raise InvalidData(f"{file}: {name} must have a value, got none", field=name)
    return result
