"""Projection of latitudes and longitudes to metres in a plane.

The projection is azimuthal equidistant about the mean position on the ellipsoid WGS 84: every point has
its true distance and direction from the centre. Distances between other points are too long by at most
the factor c / sin c at the angle c from the centre (J. P. Snyder, "Map projections: a working manual",
USGS 1395, 1987, section 25). Angles at the centre are of the normal sections.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidData
from ..models.fields import Array

__all__ = ["LARGEST_ERROR", "project_positions"]

Floats = NDArray[np.float64]

#: Largest accepted relative error of a distance.
LARGEST_ERROR = 0.005
#: Equatorial radius, m, and squared eccentricity of WGS 84.
_RADIUS, _SQUARE = 6378137.0, 6.69437999014e-3

log = logging.getLogger("crosstrack")


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
        A latitude is not in -90 … 90 or a longitude not in -180 … 360, there is no position, or
        positions are so far apart that a distance can be wrong by more than 0.5 %.
    """
    sizes: dict[str, tuple[int, str]] = {}
    try:
        north = Array(("n",), lower=-90.0, upper=90.0).coerce("latitudes", latitudes, sizes)
        east = Array(("n",), lower=-180.0, upper=360.0).coerce("longitudes", longitudes, sizes)
    except InvalidData as error:
        raise InvalidData(f"{where}: {error}", field=error.field) from None
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
    excess = widest / np.sin(widest) - 1.0 if 0.0 < widest < np.pi / 2 else np.inf * bool(widest)
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
