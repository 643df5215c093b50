"""Lanes: corridors that keep to the right in passages with room for two robots."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .corridor import Corridor, _string

__all__ = ["kept_right"]

Floats = NDArray[np.float64]

#: Gap between two lanes as a multiple of the separation, with an allowance for the grid of time of the schedule.
GAP = 1.06
#: Widths of passages with two lanes as multiples of the separation.
NARROW, WIDE = 1.12, 12.0


class _Box(NamedTuple):
    """Box of a corridor, and the segment that it was made for."""

    low: Floats
    high: Floats
    row: int


def kept_right(way: Corridor, separation: float, margin: float) -> Corridor | None:
    """Return the corridor without the left half of each passage, or None if no passage has two lanes.

    Robots in opposite lanes of a passage keep their `separation` (m) at any time. A passage is a box that a
    robot crosses along its longer side. Near a stop, the box keeps its full width. The boxes of `way` have
    their full width; those of the result extend at most `margin` (m) beyond the polyline.
    """
    rows = {row for row in range(len(way.lower)) if _is_passage(way, row, separation)}
    while rows:
        boxes: list[_Box] = []
        stops = [0]
        for row, end in itertools.pairwise([0, *way.stops[1:].tolist()]):
            for k in range(row, end):
                boxes += _halved(way, k, separation) if k in rows else [_whole(way, k)]
            stops.append(len(boxes))
        low, high = (np.array([box[side] for box in boxes]) for side in (0, 1))
        fixed = dict(zip(stops, way.knots[way.stops], strict=True))
        apart = (np.maximum(low[:-1], low[1:]) > np.minimum(high[:-1], high[1:])).any(axis=1)
        apart &= [knot not in fixed for knot in range(1, len(boxes))]
        if not apart.any():
            knots = _string(low, high, fixed)
            near, far = np.minimum(knots[:-1], knots[1:]), np.maximum(knots[:-1], knots[1:])
            low, high = np.maximum(low, near - margin), np.minimum(high, far + margin)
            return Corridor(low, high, knots, np.array(stops))
        joint = int(np.argmax(apart))
        rows -= {boxes[joint].row, boxes[joint + 1].row}
    return None


def _is_passage(way: Corridor, row: int, separation: float) -> bool:
    """Return whether a box has room for two lanes in the direction of the polyline."""
    step = np.abs(way.knots[row + 1] - way.knots[row])
    width = (way.upper[row] - way.lower[row])[int(np.argmin(step))]
    return bool(NARROW * separation <= width <= min(WIDE * separation, step.max()))


def _whole(way: Corridor, row: int) -> _Box:
    return _Box(way.lower[row].copy(), way.upper[row].copy(), row)


def _halved(way: Corridor, row: int, separation: float) -> list[_Box]:
    """Return the right half of a box, with boxes of the full width near stops outside of this half."""
    first, last = way.knots[row], way.knots[row + 1]
    axis = int(np.argmax(np.abs(last - first)))
    across, forward = 1 - axis, last[axis] > first[axis]
    lane = _whole(way, row)
    middle = 0.5 * (lane.low[across] + lane.high[across])
    # The right-hand side of the direction x is -y, that of y is x.
    if forward == (axis == 0):
        lane.high[across] = middle - 0.5 * GAP * separation
    else:
        lane.low[across] = middle + 0.5 * GAP * separation
    width = 2.0 * (way.upper[row] - way.lower[row])[across]
    long = min(width, 0.3 * abs(last[axis] - first[axis]))
    boxes = [lane]
    for knot, place in ((row, first), (row + 1, last)):
        inside = lane.low[across] <= place[across] <= lane.high[across]
        if knot not in way.stops or inside:
            continue
        beside = _whole(way, row)
        # Both boxes share a third of the length that the robot has to change to its lane.
        rising = forward == (knot == row)
        if rising:
            beside.high[axis] = min(beside.high[axis], place[axis] + long)
            lane.low[axis] = place[axis] + 2.0 / 3.0 * long
        else:
            beside.low[axis] = max(beside.low[axis], place[axis] - long)
            lane.high[axis] = place[axis] - 2.0 / 3.0 * long
        boxes.insert(0 if knot == row else len(boxes), beside)
    return boxes
