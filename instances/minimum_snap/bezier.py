"""Bézier control points in JSON files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from ...errors import InvalidData
from ...files import as_path, read_text, write_text
from ...models.fields import required
from ...models.json_text import parse_json
from ...models.minimum_snap.trajectory import Trajectory
from ..exports import ExportFormat

__all__ = ["BEZIER", "read_bezier", "write_bezier"]

_KEYS = ("times", "points")


def write_bezier(trajectory: Trajectory, path: str | os.PathLike[str]) -> Path:
    """Write a trajectory atomically as ``{"times": […], "points": [[[…]]]}``.

    ``points[segment][k]`` is control point k of a segment, with one coordinate (m) per axis. The
    knots in ``times`` are in seconds. The convex hull of the control points contains the curve.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory to write.
    path : path-like
        Path of the file.

    Returns
    -------
    Path
        Path of the written file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    required("trajectory", trajectory, Trajectory)
    points = ",\n    ".join(json.dumps(segment) for segment in trajectory.bezier().tolist())
    times = json.dumps(trajectory.times.tolist())
    return write_text(path, f'{{\n  "times": {times},\n  "points": [\n    {points}\n  ]\n}}\n')


def read_bezier(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory from a file of :func:`write_bezier`.

    Parameters
    ----------
    path : path-like
        Path of the file.

    Returns
    -------
    Trajectory

    Raises
    ------
    InvalidData
        The file is invalid. The message names file, key, index and value.
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


BEZIER = ExportFormat("Bézier points (JSON)", ".json", write_bezier)
