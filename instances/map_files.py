"""Paths on the maps in files of any format: the data of an instance, and the map in a file."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import InvalidData
from ..files import read_text
from ..models.fields import Whole, show
from ..models.grid_path.gridmap import GridMap
from ..models.grid_path.model import GridPath
from .formats import recognise
from .grid_path.images import read_image
from .grid_path.maps import read_text_map
from .grid_path.movingai import read_map, read_scenarios
from .grid_path.ros import image_of_ros, read_ros_map
from .storage import Find, joined

__all__ = ["map_of_file", "path_of_scenario", "path_on_map"]

log = logging.getLogger("crosstrack")

#: Readers of maps by the name of the format.
_READERS: dict[str, Callable[..., GridMap]] = {
    "movingai-map": read_map,
    "text-map": read_text_map,
    "image": read_image,
    "ros-map": read_ros_map,
}


def map_of_file(
    path: Path, form: str, find: Find, data: dict[str, Any]
) -> tuple[GridMap, dict[str, Any]]:
    """Return the map in a file, and `data` without the options of its reader.

    The YAML file of ROS beside an image states its resolution and origin, unless `data` do.
    """
    beside = path.with_suffix(".yaml")
    names = inspect.signature(_READERS[form]).parameters.keys() - {"path", "find"}
    options = {key: data.pop(key) for key in names & data.keys()}
    if form == "image" and options.keys() <= {"unknown"} and beside.is_file():
        companion = recognise(beside)
        is_ros = companion is not None and companion.name == "ros-map"
        if is_ros and PurePosixPath(image_of_ros(beside)).name == path.name:
            log.warning("%s: resolution and origin are those in %s", path, beside)
            path, form = find(beside.name), "ros-map"
    if form == "image" and "cell" not in options:
        log.warning("%s: cell = 1 m is assumed, as the file has none: --data cell=…", path)
    if form == "ros-map":
        options["find"] = find
    return _READERS[form](path, **options), data


def path_on_map(path: Path, *, form: str, find: Find, **data: Any) -> GridPath:
    """Return the model on the map in a file, with `start` and `goals` in `data`."""
    grid, fields = map_of_file(path, form, find, data)
    return GridPath.from_data(joined({"map": grid}, fields), name=path.stem)


def path_of_scenario(
    path: Path, *, find: Find, scenario: Any = None, map_file: Any = None, **data: Any
) -> GridPath:
    """Return the model of one row of a MovingAI scenario file.

    Parameters
    ----------
    path : Path
        The ``.scen`` file.
    find : callable
        Function that returns the path of the map by its name.
    scenario : int, optional
        Number of the row from 0; required if there are several.
    map_file : str, optional
        Name of the file of the map. By default, that of the scenario file without ``.scen``, or
        the name in its first row, in the same folder.
    **data
        Further fields of the model.
    """
    if map_file is None:
        lines = [line for line in read_text(path).splitlines() if line.strip()]
        words = lines[1].split("\t" if "\t" in lines[1] else None) if len(lines) > 1 else []
        if len(words) < 2:
            raise InvalidData(f"{path}: must have a row for each scenario", field="map_file")
        within = path.name.casefold().endswith(".map.scen")
        map_file = (
            path.name[: -len(".scen")] if within else words[1].replace("\\", "/").split("/")[-1]
        )
    if not isinstance(map_file, str):
        raise InvalidData(
            f"{path}: map_file must be a file name, got {show(map_file)}", field="map_file"
        )
    grid = read_map(find(map_file))
    rows = read_scenarios(path, grid)
    if scenario is None and len(rows) != 1:
        raise InvalidData(
            f"{path}: scenario must choose one of its {len(rows)} rows, 0 … {len(rows) - 1} (a model "
            "has one agent)",
            field="scenario",
        )
    row = Whole(0, len(rows) - 1).coerce("scenario", 0 if scenario is None else scenario, {})
    fields = {"map": grid, "start": rows[row].start, "goals": rows[row].goal}
    return GridPath.from_data(joined(fields, data), name=f"{path.stem}-{row}")
