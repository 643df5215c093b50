"""Maps: equal scales on both axes, in a unit that suits the size of what is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .style import bare, inches

__all__ = ["dress_map", "length_unit"]

#: Units of length: from what extent on (m), the factor from metres, and the name.
_UNITS = ((2000.0, 1e-3, "km"), (0.5, 1.0, "m"), (0.0, 1e3, "mm"))
#: Room around what is drawn, as a part of its extent.
_MARGIN = 0.06


def length_unit(extent: float) -> tuple[float, str]:
    """Return the factor from metres to the unit for what is as large as `extent` (m), and the unit."""
    return next((factor, unit) for least, factor, unit in _UNITS if extent >= least or not least)


def dress_map(axes: Any, low: NDArray[Any], high: NDArray[Any], unit: str) -> None:
    """Set the limits of a map, and equal scales that fill the axes.

    Parameters
    ----------
    axes : matplotlib axes
        The axes.
    low, high : ndarray, shape (2,)
        The box around what is drawn, in the axes' unit.
    unit : str
        Its name.
    """
    span = high - low
    # A side without any extent has no scale of its own: it gets that of the other.
    around = _MARGIN * (float(span.max()) or max(1.0, float(np.abs(low).max())))
    broad, tall = axes.get_position().size * inches(axes.figure)
    wide, long = span + 2 * around
    half = 0.5 * max(wide / broad, long / tall) * np.array([broad, tall])
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal")
    axes.set_xlabel(f"x ({unit})", fontsize=8.5)
    axes.set_ylabel(f"y ({unit})", fontsize=8.5)
    bare(axes)
