"""Projection of latitudes and longitudes to metres in a plane.

The projection is azimuthal equidistant about the mean position on the ellipsoid WGS 84: every point has
its true distance and direction from the centre. Distances between other points are too long by at most
the factor c / sin c at the angle c from the centre (J. P. Snyder, "Map projections: a working manual",
USGS 1395, 1987, section 25). Angles at the centre are of the normal sections.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence, Set as AbstractSet
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidData
from ..models.fields import Array
from .tables import Column
from .units import LENGTHS

__all__ = [
    "LARGEST_ERROR", "POSITIONS", "has_positions", "positions_of", "project_positions", "project_rings",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Largest accepted relative error of a distance.
LARGEST_ERROR = 0.005
#: Equatorial radius, m, and squared eccentricity of WGS 84.
_RADIUS, _SQUARE = 6378137.0, 6.69437999014e-3

_DEGREES = {"deg": 1.0, "°": 1.0, "degrees": 1.0}
#: Columns of positions; the first pair has precedence, unless the user maps only the second one.
POSITIONS = (
    Column("x", units=LENGTHS, bare=True, optional=True, aliases=("easting",)),
    Column("y", units=LENGTHS, bare=True, optional=True, aliases=("northing",)),
    Column("lat", units=_DEGREES, bare=True, optional=True, aliases=("latitude",),
           lower=-90.0, upper=90.0),
    Column("lon", units=_DEGREES, bare=True, optional=True, aliases=("longitude", "lng", "long"),
           lower=-180.0, upper=360.0),
)  # fmt: skip

log = logging.getLogger("crosstrack")


def has_positions(names: AbstractSet[str]) -> bool:
    """Return whether columns contain ``x,y`` or ``lat,lon``, and no incomplete pair."""
    pairs = [{"x", "y"} & names, {"lat", "lon"} & names]
    return any(pairs) and all(len(pair) in (0, 2) for pair in pairs)


def positions_of(
    values: Mapping[str, list[Any]], where: str, mapped: Iterable[str] = ()
) -> list[tuple[float, float]]:
    """Return the positions (m) in the columns of a table; latitudes and longitudes are projected.

    `mapped` are the columns in the user's map. Of two pairs, the unread one is named in the log.
    """
    chosen = {name.strip().casefold() for name in mapped}
    flat = "x" in values
    if flat and "lat" in values:
        flat = bool(chosen & {"x", "y"}) or not chosen & {"lat", "lon"}
        log.warning("%s: columns that are not read: %s", where, "lat, lon" if flat else "x, y")
    if flat:
        return list(zip(values["x"], values["y"], strict=True))
    plane = project_positions(values["lat"], values["lon"], where)
    return [(x, y) for x, y in plane.tolist()]


def project_positions(
    latitudes: ArrayLike, longitudes: ArrayLike, where: str = "positions"
) -> Floats:
    """Return positions in a plane; state the projection and its error in the log.

    Poles and the antimeridian need no special treatment.

    Parameters
    ----------
    latitudes, longitudes : array_like, shape (n,)
        Geodetic coordinates in degrees, north and east positive.
    where : str
        Name of their file, for messages.

    Returns
    -------
    ndarray, shape (n, 2)
        Metres to the east and to the north of the centre.

    Raises
    ------
    InvalidData
        A latitude is not in -90 … 90 or a longitude not in -180 … 360, no position is given, or
        positions are so far apart that a distance can be wrong by more than 0.5 %.
    """
    sizes: dict[str, tuple[int, str]] = {}
    try:
        north = Array(("n",), lower=-90.0, upper=90.0).coerce("latitudes", latitudes, sizes)
        east = Array(("n",), lower=-180.0, upper=360.0).coerce("longitudes", longitudes, sizes)
    except InvalidData as fault:
        raise InvalidData(f"{where}: {fault}", field=fault.field) from None
    if not north.size:
        raise InvalidData(f"{where}: latitudes must hold at least one entry", field="latitudes")
    points, up, _ = _geocentric(np.radians(north), np.radians(east))
    mean = up.mean(axis=0)
    lat, lon = np.arctan2(mean[2], np.hypot(*mean[:2])), np.arctan2(mean[1], mean[0])
    centre, normal, curvature = _geocentric(lat, lon)
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    offsets = points - centre
    plane = np.stack([offsets @ east, offsets @ np.cross(normal, east)], axis=-1)
    azimuths = np.arctan2(plane[:, 0], plane[:, 1])
    # Radius of curvature in the direction of each point (Euler), for arcs above the chords.
    radii = 1.0 / (np.cos(azimuths) ** 2 / curvature[0] + np.sin(azimuths) ** 2 / curvature[1])
    chords = np.linalg.norm(offsets, axis=-1)
    angles = 2.0 * np.arcsin(np.minimum(chords / (2.0 * radii), 1.0))
    widest = float(angles.max())
    excess = np.inf if widest >= np.pi / 2 else 1.0 / np.sinc(widest / np.pi) - 1.0
    place = (
        f"{abs(np.degrees(lat)):.4f}° {'NS'[bool(lat < 0)]}, "
        f"{abs(np.degrees(lon)):.4f}° {'EW'[bool(lon < 0)]}"
    )
    if not mean.any() or not excess <= LARGEST_ERROR:
        raise InvalidData(
            f"{where}: positions must be within 1100 km of their centre, {place}, so that distances in "
            f"the plane are within {LARGEST_ERROR:.1%}; got {float((radii * angles).max()) / 1e3:.0f} km: "
            "give a matrix of distances instead",
            field="latitudes",
        )
    log.warning(
        "%s: latitudes and longitudes are projected to metres (azimuthal equidistant about %s); "
        "distances are at most %.2g %% too long",
        where, place, 100.0 * excess,
    )  # fmt: skip
    directions: Floats = np.stack([np.sin(azimuths), np.cos(azimuths)], axis=-1)
    directions *= (radii * angles)[:, None]
    return directions


def _geocentric(lat: Floats, lon: Floats) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """Return geocentric positions (m), unit normals, and radii of curvature along and across meridians."""
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    root = 1.0 - _SQUARE * np.sin(lat) ** 2
    across = _RADIUS / np.sqrt(root)
    along = across * (1.0 - _SQUARE) / root
    return across[..., None] * up * [1.0, 1.0, 1.0 - _SQUARE], up, (along, across)


def project_rings(
    polygons: Sequence[Any], positions: ArrayLike, where: str
) -> tuple[list[dict[str, Any]], Floats]:
    """Return polygons and further positions, both of longitudes and latitudes, in a common plane.

    Parameters
    ----------
    polygons : sequence of Polygon
        Polygons with longitudes and latitudes in degrees. Edges are straight in the plane.
    positions : array-like, shape (k, 2)
        Further longitudes and latitudes in degrees.
    where : str
        File of the polygons, for messages.

    Returns
    -------
    list of dict, ndarray of shape (k, 2)
        ``shell`` and ``holes`` of each polygon, and the positions, in metres.

    Raises
    ------
    InvalidData
        A longitude or latitude is out of range, positions are too far apart, or the file has no polygon.
    """
    rings = [ring for polygon in polygons for ring in (polygon.shell, *polygon.holes)]
    parts = [np.asarray(part, float).reshape(-1, 2) for part in (*rings, positions)]
    points = np.concatenate(parts)
    plane = project_positions(points[:, 1], points[:, 0], where)
    *flat, rest = np.split(plane, np.cumsum([len(part) for part in parts])[:-1])
    queue = iter(flat)
    shapes = [
        {"shell": next(queue), "holes": [next(queue) for _ in polygon.holes]}
        for polygon in polygons
    ]
    return shapes, rest
