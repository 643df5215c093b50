"""Roads that drivers follow: the course of their middle, smoothed by cubics.

The paper's coefficients are lost. Each shift of the lane is the cubic ``3 s² - 2 s³``, whose slope is zero at both ends.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Road", "RoadKind", "road_of"]

Floats = NDArray[np.float64]

#: Segments of the double lane change, in metres for each m/s of its speed, and where each ends sideways, in lanes.
#: The paper gives the lengths; that its second and fifth shift the lane is taken from the shape of ISO 3888-1.
LANE_CHANGE = ((2, 0), (2, 1), (2, 1), (1, 1), (2, 0), (5, 0), (3, 0))
#: Width of a lane, m.
LANE = 3.5
#: Distance of the poles of the serpentine, m, and their number: those for cars in GB/T 6323.1-1994, whose speed is
#: that of the paper.
POLE_DISTANCE, POLES = 30.0, 10
#: Width of the serpentine, m. The course swings by half of it to either side.
POLE_WIDTH = 2.46
#: Seconds of straight road before the first pole, and after the last.
BEFORE, AFTER = 2.0, 3.0


class RoadKind(StrEnum):
    """A road of the paper."""

    #: Over to the next lane and back.
    LANE_CHANGE = "lane-change"
    #: Past poles in a line, left and right in turn.
    SERPENTINE = "serpentine"


class Road(NamedTuple):
    """The course of a road in the plane.

    Parameters
    ----------
    along : ndarray, shape (k,)
        Where its pieces begin and end, m, rising.
    aside : ndarray, shape (k,)
        How far it is to the left there, m. In between it follows ``3 s² - 2 s³``, beyond the ends it is straight.
    speed : float
        Speed that it is made for, m/s.
    """

    along: Floats
    aside: Floats
    speed: float

    @property
    def length(self) -> float:
        """Where the last piece ends, m."""
        return float(self.along[-1])


def road_of(kind: RoadKind, length: float = 0.0) -> Road:
    """Return a road.

    Parameters
    ----------
    kind : RoadKind
        Which.
    length : float
        How long it must be at least, m: the serpentine gets more poles, the lane change ends straight.
    """
    if kind is RoadKind.LANE_CHANGE:
        speed = 80.0 / 3.6
        lengths, lanes = np.array(LANE_CHANGE, dtype=float).T
        along = speed * np.concatenate([[0.0], np.cumsum(lengths)])
        return Road(along, LANE * np.concatenate([[0.0], lanes]), speed)
    speed = 65.0 / 3.6
    rest = (length - (BEFORE + AFTER) * speed) / POLE_DISTANCE
    poles = max(POLES, int(np.ceil(rest)) + 1)
    at = BEFORE * speed + POLE_DISTANCE * np.arange(poles)
    side = 0.5 * POLE_WIDTH * np.where(np.arange(poles) % 2, -1.0, 1.0)
    ends = (at[0] - POLE_DISTANCE, at[-1] + POLE_DISTANCE, at[-1] + AFTER * speed)
    along = np.concatenate([[0.0, ends[0]], at, ends[1:]])
    return Road(along, np.concatenate([[0.0, 0.0], side, [0.0, 0.0]]), speed)
