"""Array form of the routing problem, the input of the kernels of this package.

A visited point resets one of the two errors, so only one survives: the vertical error at a horizontal
correction point, the horizontal error at a vertical one. The state of a partial route is therefore
its length and one *surviving error*.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.error_correction.model import (
    END,
    HORIZONTAL,
    START,
    VERTICAL,
    ErrorCorrectionRouting,
)

__all__ = ["END", "HORIZONTAL", "START", "VERTICAL", "Airspace", "airspace"]


class Airspace(NamedTuple):
    """Points in metres, shape (n, 3), their kinds, thresholds and rates.

    `start` and `end` are the indices of A and B. `limits`, shape (4, 2), are the largest vertical
    (column 0) and horizontal (column 1) error on arrival, one row per kind of point, slack included; the
    row of ``START`` is -1, as no route returns there. `rates` are the vertical and the horizontal error
    per metre of flight.
    """

    points: NDArray[np.float64]
    kinds: NDArray[np.int8]
    start: int
    end: int
    limits: NDArray[np.float64]
    rates: NDArray[np.float64]


def airspace(model: ErrorCorrectionRouting) -> Airspace:
    """Return the arrays of `model`; the limits include the rounding tolerance."""
    limits = np.ascontiguousarray(model.rounded_limits[:, ::-1])
    limits[START] = -1.0
    return Airspace(
        model.points,
        model.codes,
        model.start,
        model.end,
        limits,
        np.array([model.vertical_rate, model.horizontal_rate]),
    )
