"""Reader of maps in images with one pixel per cell and a limit on the decoded size."""

from __future__ import annotations

import io
import os
import warnings
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendMissing, InvalidData
from ...files import LARGEST_FILE, as_path, read_bytes
from ...models.fields import Real
from ...models.grid_path.gridmap import MOST, GridMap
from ...models.records import Member

__all__ = ["SUFFIXES", "read_brightness", "read_image"]

#: Formats that Pillow decodes itself. It passes others, such as EPS, to external programs.
_FORMATS = ("PNG", "BMP", "GIF", "JPEG", "PPM", "WEBP")
#: Brightness of unknown cells in maps of ROS (``map_saver``).
UNKNOWN = 205 / 255
#: Suffixes of image files.
SUFFIXES = (".png", ".bmp", ".gif", ".jpg", ".jpeg", ".pgm", ".pbm", ".ppm", ".webp")


class Unknown(StrEnum):
    """State of unknown cells."""

    BLOCKED = "blocked"  #: Unknown cells are blocked, so paths avoid them.
    FREE = "free"  #: Unknown cells are free, so paths may cross them.


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

    The map savers of ROS write unknown cells as gray 205. By default, these cells are blocked as well.

    Parameters
    ----------
    path : path-like
        PNG, BMP, GIF, JPEG, PPM or WebP file. If it has several frames, the first is read. Transparent
        pixels are white.
    cell : float, default 1
        Side of a pixel, m.
    origin : array-like, shape (2,), default (0, 0)
        Corner of the map with the lowest x and y, m.
    upward : bool, default False
        Whether y points upward. If true, row 0 is the bottom line of pixels, otherwise the top line.
    threshold : float, default 0.5
        Brightness below which a pixel is blocked, from 0 (black) to 1 (white).
    unknown : {"blocked", "free"}, default "blocked"
        State of pixels with gray 205 of 255 in images of 8 bits.

    Returns
    -------
    GridMap
        Map with one cell per pixel.

    Raises
    ------
    BackendMissing
        Pillow is not installed.
    InvalidData
        The file is not a readable image, has more than 2**26 pixels, or no pixel is bright enough.
    """
    file = as_path(path)
    bound = Real(0, 1).coerce("threshold", threshold, {})
    state = Member(Unknown).coerce("unknown", unknown, {})
    bright = read_brightness(file)
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


def read_brightness(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Return the brightness of the pixels of an image, from 0 to 1, shape (rows, columns).

    The errors are those of :func:`read_image`.
    """
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"{path}: images need Pillow, which is not installed ({error}): "
            "pip install 'crosstrack[plot]', or save the map as text"
        ) from None
    file = as_path(path)
    raw = read_bytes(file)
    if len(raw) > LARGEST_FILE:
        raise InvalidData(f"{file}: holds more than {LARGEST_FILE} bytes")
    try:
        with warnings.catch_warnings():
            # Pillow warns about sizes that are rejected below, and about harmless damage.
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
    except Exception as error:  # a damaged file may raise any exception in Pillow
        raise InvalidData(
            f"{file}: cannot be read as an image: {type(error).__name__}: {error}", field="map"
        ) from None
    return bright


def _brightness(image: Any) -> NDArray[np.float64]:
    """Return the brightness of the pixels, from 0 to 1, shape (rows, columns)."""
    if image.mode.startswith("I"):  # gray in 16 bits
        return np.asarray(image, float) / 65535
    if "A" in image.mode or "transparency" in image.info:
        from PIL import Image

        above = image.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", above.size, "white"), above)
    return np.asarray(image.convert("L"), float) / 255
