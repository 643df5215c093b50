"""Layout of a figure of runs: positions of the map, the moments and the panel of scenes, in inches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .drawn import Box

__all__ = ["Layout", "Place", "arrange", "is_square", "proportion"]

#: Lengths in inches: outer margin, gap between moments, tick labels of rows and of columns, caption above
#: a map, line of a title or a legend, and height of the panel of scenes.
_MARGIN, _GAP, _ROWS, _COLUMNS, _WORDS, _LINE, _SCENES = 0.2, 0.12, 0.5, 0.48, 0.24, 0.17, 1.5
#: Height of the map divided by the width of the sheet.
_MAP = 0.42
#: Limits on the ratio of width to height of a drawn map.
_NARROWEST, _BROADEST = 0.2, 12.0
#: Ratio of width to height above which the moments are placed below the map.
_BROAD = 1.35


class Place(NamedTuple):
    """Rectangle on a sheet: distances from the left and upper edges, width and height."""

    left: float
    top: float
    broad: float
    tall: float


class Layout(NamedTuple):
    """Size of a sheet, and the rectangles of the map, the moments and the panel of scenes."""

    size: tuple[float, float]
    map: Place
    moments: list[Place]
    panel: Place | None


def proportion(box: Box) -> float:
    """Return the ratio of width to height of a part of a map as drawn."""
    rows, columns = box.size.tolist()
    return float(np.clip(columns / rows, _NARROWEST, _BROADEST))


def is_square(box: Box) -> bool:
    """Return whether the cells of a part of a map appear as squares."""
    rows, columns = box.size.tolist()
    return bool(proportion(box) == columns / rows)


def arrange(
    size: tuple[float, float | None], whole: Box, part: Box, count: int, *, head: int, foot: int,
    panel: bool,
) -> Layout:  # fmt: skip
    """Return the layout of the map, its `count` moments and the panel of scenes.

    `size` is width and height of the sheet, None computes the height. The map shows the part `whole`, each moment
    `part`. `head` and `foot` are the numbers of lines of the title and of the legend.
    """
    broad, limit = size
    words = (broad, head, foot)
    for share in np.linspace(_MAP, 0.05, 1 if limit is None else 40):
        layout = _arranged(words, whole, part, count, share=float(share), panel=panel)
        if limit is None or layout.size[1] <= limit:
            break
    return layout if limit is None else layout._replace(size=(broad, limit))


def _arranged(
    words: tuple[float, int, int], whole: Box, part: Box, count: int, *, share: float, panel: bool
) -> Layout:
    """Return the layout with a map of at most `share` of the width in height."""
    broad, head, foot = words
    top = 0.2 + _LINE * head + _WORDS
    room = broad - 2 * _MARGIN - _ROWS
    ratio = proportion(whole)
    beside = ratio <= _BROAD and count > 0
    wide = min(share * broad * ratio, 0.52 * broad if beside else room)
    tall = wide / ratio
    left = _MARGIN + _ROWS + (0.0 if beside else (room - wide) / 2)
    first = Place(left, top, wide, tall)
    bottom = top + tall + _COLUMNS
    area = Place(_MARGIN, bottom + _WORDS, broad - 2 * _MARGIN, share * broad)
    if beside:
        right = left + wide + 0.2
        area = Place(right, top, broad - _MARGIN - right, tall)
    moments = _tiles(area, count, proportion(part)) if count else []
    if moments:
        shift = 0.5 * (broad - _MARGIN - max(tile.left + tile.broad for tile in moments))
        moments = [tile._replace(left=tile.left + shift) for tile in moments]
        first = first._replace(left=first.left + shift * beside)
    bottom = max([bottom, *(tile.top + tile.tall + _GAP for tile in moments)])
    scenes = Place(0.75, bottom + 0.1, broad - 1.0, _SCENES) if panel else None
    if scenes is not None:
        bottom += 0.1 + _SCENES + _COLUMNS
    return Layout((broad, bottom + 0.12 + _LINE * foot), first, moments, scenes)


def _tiles(area: Place, count: int, ratio: float) -> list[Place]:
    """Return rectangles of equal, maximum size, each with a caption above."""
    best = (0.0, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        tall = (area.tall + _WORDS) / rows - _WORDS - _GAP
        best = max(best, (min((area.broad + _GAP) / columns - _GAP, tall * ratio), columns))
    wide, columns = best
    tall = wide / ratio
    cells = (divmod(k, columns) for k in range(count))
    return [
        Place(area.left + k * (wide + _GAP), area.top + row * (tall + _WORDS + _GAP), wide, tall)
        for row, k in cells
    ]
