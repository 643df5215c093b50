"""The vehicle of simulated drives, vehicles in JSON files, such as identified ones, and instances that refer to such files."""

from __future__ import annotations

import json
import os
from pathlib import Path

from ...errors import InvalidData
from ...files import write_text
from ...models.fields import required
from ...models.sideslip.data import Vehicle
from ..storage import read_content, reference

__all__ = ["VEHICLE", "read_vehicle", "resolve_references", "write_vehicle"]

#: Car with the parameters of an exercise in the chapter on handling of Z. Yu, Automobile Theory (in Chinese, China
#: Machine Press). The stiffness is that of both tyres of an axle. The paper does not print its parameters.
VEHICLE = Vehicle(
    mass=1818.2, yaw_inertia=3885.0, front=1.463, rear=1.585, cornering_front=62618.0,
    cornering_rear=110185.0,
)  # fmt: skip


def read_vehicle(path: str | os.PathLike[str]) -> Vehicle:
    """Return the vehicle in a JSON file with the fields of :class:`~crosstrack.models.sideslip.Vehicle`.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    Vehicle
        The vehicle.

    Raises
    ------
    InvalidData
        The file cannot be read, or a key or a value is missing, unknown or invalid. The message names file
        and key.
    """
    data = read_content(path)
    try:
        return Vehicle.from_data(data)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def write_vehicle(vehicle: Vehicle, path: str | os.PathLike[str]) -> Path:
    """Write a vehicle as JSON, atomically, and return the path.

    Parameters
    ----------
    vehicle, path
        Vehicle, and file to write.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    data = required("vehicle", vehicle, Vehicle).data()
    return write_text(path, json.dumps(data, indent=2) + "\n")


resolve_references = reference("vehicle", lambda file: {"vehicle": read_vehicle(file).data()})
