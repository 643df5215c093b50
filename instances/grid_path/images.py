"""Maps in images, a pixel a cell: no more is decoded than a map may hold."""

from __future__ import annotations

import io
import os
import warnings
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendMissing, InvalidData
from ...files import LARGEST_FILE, as_path
from ...models.fields import Real
from ...models.grid_path.gridmap import MOST, GridMap
from ...models.records import Member

__all__ = ["SUFFIXES", "read_image"]

#: What Pillow decodes by itself; others, such as EPS, it hands to further programs.
_FORMATS = ("PNG", "BMP", "GIF", "JPEG", "PPM", "WEBP")
#: Brightness of a cell that no sensor has seen, in maps of ROS (``map_saver``).
UNKNOWN = 205 / 255
#: What names of such files end in.
SUFFIXES = (".png", ".bmp", ".gif", ".jpg", ".jpeg", ".pgm", ".pbm", ".ppm", ".webp")


class Unknown(StrEnum):
    """State of cells that no sensor has seen."""

    BLOCKED = "blocked"  #: paths keep away from them
    FREE = "free"  #: paths may cross them


def read_image(
    path: str | os.PathLike[str],
    *,
    cell: float = 1.0,
    origin: ArrayLike = (0.0, 0.0),
    upward: bool = False,
    threshold: float = 0.5,
    unknown: str = "blocked",
) -> GridMap:
    """Return the map in an image: dark pixels are blocked cells.

    The map savers of ROS write cells that no sensor has seen with the gray 205. These cells are
    blocked as well, unless `unknown` says otherwise.

    Parameters
    ----------
    path : path-like
        A PNG, BMP, GIF, JPEG, PPM or WebP file; of several pictures in it the first is read. What is
        transparent counts as white.
    cell : float
        Side of a pixel, m.
    origin : array-like, shape (2,)
        As of :class:`~crosstrack.models.grid_path.GridMap`: the corner of the least x and y.
    upward : bool
        Whether y grows upward: then the lowest line of pixels is row 0, else the highest.
    threshold : float
        Brightness below which a pixel is blocked: 0 is black, 1 white.
    unknown : {"blocked", "free"}
        State of pixels of the gray 205 of 255 in images of 8 bits.

    Raises
    ------
    BackendMissing
        Pillow is not installed.
    InvalidData
        The file is no such image, has more pixels than a map may have cells, or no bright pixel.
    """
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"{path}: images need Pillow, which is not installed ({error}): "
            "pip install 'crosstrack[plot]', or save the map as text"
        ) from None
    file = as_path(path)
    bound = Real(0, 1).coerce("threshold", threshold, {})
    state = Member(Unknown).coerce("unknown", unknown, {})
    raw = _bytes(file)
    try:
        with warnings.catch_warnings():
            # Of sizes that are refused below anyway, and of damage that the pixels do not show.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(raw), formats=_FORMATS) as image:
                if image.width * image.height > MOST:
                    raise InvalidData(
                        f"{file}: must have at most {MOST} pixels, got {image.width} × {image.height}",
                        field="map",
                    )
                bright = _brightness(image)
    except InvalidData:
        raise
    except Exception as error:  # Pillow raises whatever a damaged file makes it trip over
        raise InvalidData(
            f"{file}: cannot be read as an image: {type(error).__name__}: {error}", field="map"
        ) from None
    blocked = bright < bound
    unseen = np.abs(bright - UNKNOWN) < 1e-9
    blocked |= unseen & (state is Unknown.BLOCKED)
    if blocked.all():
        raise InvalidData(
            f"{file}: no pixel is as bright as the threshold {bound:g}, so no cell is free"
            + (" (gray 205 is unknown: unknown='free' makes it free)" if unseen.any() else ""),
            field="map",
        )
    return GridMap(blocked[::-1] if upward else blocked, cell, origin, upward)  # type: ignore[arg-type]


def _brightness(image: Any) -> NDArray[np.float64]:
    """Return how bright the pixels are, from 0 to 1."""
    if image.mode.startswith("I"):  # gray in 16 bits
        return np.asarray(image, float) / 65535
    if "A" in image.mode or "transparency" in image.info:
        from PIL import Image

        above = image.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", above.size, "white"), above)
    return np.asarray(image.convert("L"), float) / 255


def _bytes(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InvalidData(f"{file}: no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidData(f"{file}: cannot be read: {reason}") from None
    if len(raw) > LARGEST_FILE:
        raise InvalidData(f"{file}: holds more than {LARGEST_FILE} bytes")
    return raw
