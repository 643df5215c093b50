"""Bézier control points in JSON files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from ...errors import InvalidData
from ...files import as_path, read_text, write_text
from ...models.fields import required
from ...models.minimum_snap.trajectory import Trajectory
from ...models.model import parse_json

__all__ = ["read_bezier", "write_bezier"]

_KEYS = ("times", "points")


def write_bezier(trajectory: Trajectory, path: str | os.PathLike[str]) -> Path:
    """Write a trajectory as ``{"times": […], "points": [[[…]]]}``, in one step; return the path.

    ``points[segment][k]`` is control point k of a segment, a coordinate an axis (m); the knots in
    ``times`` are in seconds. Every curve lies in the convex hull of its control points.
    """
    required("trajectory", trajectory, Trajectory)
    points = ",\n    ".join(json.dumps(segment) for segment in trajectory.bezier().tolist())
    times = json.dumps(trajectory.times.tolist())
    return write_text(path, f'{{\n  "times": {times},\n  "points": [\n    {points}\n  ]\n}}\n')


def read_bezier(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory whose control points are in a file that :func:`write_bezier` wrote.

    Raises
    ------
    InvalidData
        Naming the file and the key, index and value at fault.
    """
    path = as_path(path)
    try:
        content = parse_json(read_text(path))
        if not isinstance(content, Mapping) or set(content) != set(_KEYS):
            raise InvalidData('must hold exactly {"times": […], "points": [[[…]]]}', field="points")
        return Trajectory.from_bezier(content["times"], content["points"])
    except InvalidData as error:
        if str(error).startswith(str(path)):
            raise
        raise InvalidData(f"{path}: {error}", field=error.field) from None
