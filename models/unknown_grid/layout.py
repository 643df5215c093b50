"""Where the parts of a picture of runs lie on its sheet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .drawn import Box

__all__ = ["Layout", "Place", "arrange", "is_square", "proportion"]

#: Inches: around everything, between moments, for numbers of rows and of columns, for words above a map,
#: a line of a title or a legend, and the panel over scenes.
_MARGIN, _GAP, _ROWS, _COLUMNS, _WORDS, _LINE, _SCENES = 0.2, 0.12, 0.5, 0.48, 0.24, 0.17, 1.5
#: Height of the map as a part of the sheet's width.
_MAP = 0.42
#: Width over height of what is drawn.
_NARROWEST, _BROADEST = 0.2, 12.0
#: Maps that are broader than so many times their height have moments below.
_BROAD = 1.35


class Place(NamedTuple):
    """A rectangle on a sheet, its left upper corner first (inch)."""

    left: float
    top: float
    broad: float
    tall: float

    def share(self, size: tuple[float, float]) -> tuple[float, float, float, float]:
        """Return it as parts of a sheet of `size`, its left lower corner first."""
        low = 1 - (self.top + self.tall) / size[1]
        return self.left / size[0], low, self.broad / size[0], self.tall / size[1]


class Layout(NamedTuple):
    """A sheet's size (inch), and the places on it."""

    size: tuple[float, float]
    map: Place
    moments: list[Place]
    panel: Place | None


def proportion(box: Box) -> float:
    """Return width over height of a part of a map as it is drawn."""
    rows, columns = box.size.tolist()
    return float(np.clip(columns / rows, _NARROWEST, _BROADEST))


def is_square(box: Box) -> bool:
    """Return whether the cells of a part of a map are drawn as squares."""
    rows, columns = box.size.tolist()
    return bool(proportion(box) == columns / rows)


def arrange(
    size: tuple[float, float | None], whole: Box, part: Box, count: int, *, head: int, foot: int,
    panel: bool,
) -> Layout:  # fmt: skip
    """Return where the map, its moments, and the panel over scenes lie.

    Parameters
    ----------
    size : (float, float)
        Width and height of the sheet (inch); the height that suits, for None.
    whole, part : Box
        What the map and what a moment shows.
    count : int
        How many moments.
    head, foot : int
        Lines of the title and of the legend.
    panel : bool
        Whether there is one over scenes.
    """
    broad, given = size
    words = (broad, head, foot)
    for share in np.linspace(_MAP, 0.05, 1 if given is None else 40):
        found = _arranged(words, whole, part, count, share=float(share), panel=panel)
        if given is None or found.size[1] <= given:
            break
    return found if given is None else found._replace(size=(broad, given))


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
    left = _MARGIN + _ROWS
    if not beside:
        left += (room - wide) / 2
    first = Place(left, top, wide, tall)
    low = top + tall + _COLUMNS
    moments: list[Place] = []
    if beside:
        right = left + wide + 0.2
        moments = _tiles(Place(right, top, broad - _MARGIN - right, tall), count, proportion(part))
    elif count:
        area = Place(_MARGIN, low + _WORDS, broad - 2 * _MARGIN, share * broad)
        moments = _tiles(area, count, proportion(part))
    if moments:
        free = 0.5 * (broad - _MARGIN - max(one.left + one.broad for one in moments))
        moments = [one._replace(left=one.left + free) for one in moments]
        first = first._replace(left=first.left + free * beside)
    low = max([low, *(one.top + one.tall + _GAP for one in moments)])
    scenes = Place(0.75, low + 0.1, broad - 1.0, _SCENES) if panel else None
    if scenes is not None:
        low += 0.1 + _SCENES + _COLUMNS
    return Layout((broad, low + 0.12 + _LINE * foot), first, moments, scenes)


def _tiles(area: Place, count: int, ratio: float) -> list[Place]:
    """Return places of equal size, as large as they can be, words above each."""
    best = (0.0, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        tall = (area.tall + _WORDS) / rows - _WORDS - _GAP
        wide = min((area.broad + _GAP) / columns - _GAP, tall * ratio)
        best = max(best, (wide, columns))
    wide, columns = best
    tall = wide / ratio
    return [
        Place(
            area.left + (k % columns) * (wide + _GAP),
            area.top + (k // columns) * (tall + _WORDS + _GAP),
            wide,
            tall,
        )
        for k in range(count)
    ]
