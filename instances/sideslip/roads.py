"""Centre lines of the paper's two roads, equations 4-7.

The lane change consists of cubics with a continuous derivative, which determines the coefficients of equations 4 and 5:
each shift is ``3 s² - 2 s³``. The serpentine consists of the sines of equation 7.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Road", "RoadKind", "road_of"]

Floats = NDArray[np.float64]

#: Segments s0 … s6 of the double lane change: length in multiples of the speed u, and lateral position at the end in
#: lanes. The car is in its lane on s1, changes on s2, stays on s3 and returns on s4 (equation 4, Figure 3).
LANE_CHANGE = ((2, 0), (2, 0), (2, 1), (1, 1), (2, 0), (5, 0), (3, 0))
#: Width of a lane, m.
LANE = 3.5
#: Seconds from one pole of the serpentine to the next, L = 2u, and the number of such distances, 5L.
POLE_SECONDS, DISTANCES = 2.0, 5
#: The course swings to both sides by 2H, which is the pole width B = 2.46 m, since H = B / 2 in equation 7.
SWING = 2.46
#: Seconds of straight road before the first pole, s0 = 2u, and after the last one, s = 3u.
BEFORE, AFTER = 2.0, 3.0


class RoadKind(StrEnum):
    """Road of the paper."""

    #: Double lane change: to the next lane and back, designed for 80 km/h.
    LANE_CHANGE = "lane-change"
    #: Slalom around poles in a line, designed for 65 km/h.
    SERPENTINE = "serpentine"


class Road(NamedTuple):
    """Centre line of a road in the plane with its design speed, m/s.

    `along`, shape (k,), are the increasing longitudinal positions of the ends of its segments, m, and
    `aside` the lateral positions there, m, positive to the left. Between two positions the road follows
    the cubic ``3 s² - 2 s³`` or, if `sine`, the sine ``(1 - cos π s) / 2``. It is straight before the
    first and after the last.
    """

    along: Floats
    aside: Floats
    speed: float
    sine: bool = False

    @property
    def length(self) -> float:
        """Longitudinal position of the end of the last segment, m."""
        return float(self.along[-1])


def road_of(kind: RoadKind, length: float = 0.0) -> Road:
    """Return the centre line of a road of at least `length` m.

    The serpentine is extended by poles, the lane change by a straight end.
    """
    if kind is RoadKind.LANE_CHANGE:
        speed = 80.0 / 3.6
        lengths, lanes = np.array(LANE_CHANGE, dtype=float).T
        along = speed * np.concatenate([[0.0], np.cumsum(lengths)])
        return Road(along, LANE * np.concatenate([[0.0], lanes]), speed)
    speed = 65.0 / 3.6
    distance = POLE_SECONDS * speed
    rest = (length - (BEFORE + AFTER) * speed) / distance
    count = max(DISTANCES, int(np.ceil(rest)))
    along = np.asarray(BEFORE * speed + distance * np.arange(count + 1), dtype=np.float64)
    # With five distances the last segment leads from -2H to 0, as printed in equation 7.
    aside = SWING * np.where(np.arange(count + 1) % 2, 1.0, -1.0)
    aside[0] = aside[-1] = 0.0
    along = np.concatenate([[0.0], along, [along[-1] + AFTER * speed]])
    return Road(along, np.concatenate([[0.0], aside, [0.0]]), speed, sine=True)
