"""Initial guess of a tour: the vehicle met soonest comes next, headings bisect the directions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from .dubins import WORDS, shortest, word_lengths
from .model import MessengerTour
from .motion import tour
from .plan import TourPlan

__all__ = ["guess_tour", "met_after"]

Floats = NDArray[np.float64]

#: Letters of the six words by code.
LETTERS = ["".join("RSL"[sign + 1] for sign in word) for word in WORDS.tolist()]
#: Initial angle of each turn of a word other than the six, in rad.
ANGLE = 0.1


def met_after(
    model: MessengerTour, place: Floats, time: float, vehicles: Sequence[int] | NDArray[np.int64]
) -> Floats:
    """Return the durations (s) of straight flights from `place` (m) at `time` (s) to vehicles."""
    rate = model.velocities[vehicles]
    way = model.positions[vehicles] + rate * time - place
    along, fast = (way * rate).sum(axis=1), np.hypot(*rate.T)
    room = (model.speed - fast) * (model.speed + fast)
    after: Floats = (along + np.sqrt(along**2 + room * (way**2).sum(axis=1))) / room
    return after


def guess_tour(
    model: MessengerTour, order: Sequence[int] | None, words: Sequence[str] | None
) -> TourPlan:
    """Return a tour that meets each vehicle at its centre, unless a given word cannot lead there.

    Without `order`, the vehicle met soonest on a straight line comes next. Without `words`, the legs
    are shortest paths. The tour may be infeasible if a word is not one of the six Dubins words.
    """
    n, r = model.size, model.turning_radius
    met: list[int] = []

    def soonest(place: Floats, time: float) -> tuple[int, Floats, float]:
        """Return the next vehicle, and the place and duration of a straight flight to it."""
        left = [k for k in range(n) if k not in met] if order is None else [order[len(met)]]
        after = met_after(model, place, time, left)
        k = int(np.argmin(after))
        return left[k], model.where(left[k], time + float(after[k])), float(after[k])

    place = model.positions[0 if order is None else order[0]]
    place, time = place if model.start is None else model.start[:2], 0.0
    _, goal, after = soonest(place, time)
    ahead = goal - place
    heading = math.atan2(ahead[1], ahead[0]) if model.heading is None else model.heading
    start = pose = np.append(place, heading)
    legs: list[tuple[str, tuple[float, ...], float]] = []
    for row in range(n + model.closed):
        goal, after, rate, end = start[:2], 0.0, np.zeros(2), float(start[2])
        if row < n:
            vehicle, goal, after = soonest(place, time)
            met.append(vehicle)
            rate = model.velocities[vehicle]
            beyond = start[:2] if model.closed else goal
            if row + 1 < n:
                beyond = soonest(goal, time + after)[1]
            end = _halfway(goal - place, beyond - goal)
        ahead = goal - place
        leg: tuple[str, tuple[float, ...]] = ("S", (float(np.hypot(*ahead)),))
        if r > 0.0:
            word = None if words is None else words[row]
            goal = goal + rate * _delay(model.speed, pose, goal, end, rate, r, word, after)
            leg = _leg(pose, np.append(goal, end), r, word)
        legs.append((*leg, math.atan2(ahead[1], ahead[0])))
        time += sum(leg[1]) / model.speed
        place, pose = goal, np.append(goal, end)
    return tour(
        model, met, [word for word, *_ in legs], start,
        np.array([length for _, lengths, _ in legs for length in lengths]),
        np.repeat([way for *_, way in legs], [len(lengths) for _, lengths, _ in legs]),
    )  # fmt: skip


def _halfway(before: Floats, after: Floats) -> float:
    """Return the heading that bisects the directions of two consecutive sides of a path."""
    x, y = before / (math.hypot(*before) or 1.0) + after / (math.hypot(*after) or 1.0)
    return math.atan2(y, x)


def _delay(
    speed: float, pose: Floats, goal: Floats, heading: float, rate: Floats, r: float,
    word: str | None, after: float,
) -> float:  # fmt: skip
    """Return the delay (s) of an encounter relative to a straight flight of `after` seconds.

    The leg of `word` begins at `pose`. The straight flight ends at `goal`, where the vehicle has the
    velocity `rate`, and the leg arrives with `heading`.
    """

    def early(late: float) -> float:
        _, lengths = _leg(pose, np.array([*(goal + rate * late), heading]), r, word)
        return speed * (after + late) - sum(lengths)

    if not rate.any():
        return 0.0
    surplus = early(0.0)
    if surplus >= 0.0:
        return 0.0
    upper = -surplus / speed
    while early(upper) < 0.0:
        upper *= 2.0
    # The length may jump by a full circle. The result is then one side of the jump.
    return float(brentq(early, 0.0, upper, xtol=1e-12 * upper))


def _leg(a: Floats, b: Floats, r: float, word: str | None) -> tuple[str, tuple[float, ...]]:
    """Return a word between two poses and its lengths; the lengths of an unusual word are a guess."""
    (x0, y0, h0), (x1, y1, h1) = a.tolist(), b.tolist()
    if word is None:
        first, second, third, code = shortest(x0, y0, h0, x1, y1, h1, r)
        return LETTERS[code], (first, second, third)
    if word in LETTERS:
        lengths = word_lengths(x0, y0, h0, x1, y1, h1, r, LETTERS.index(word))
        if math.isfinite(lengths[0]):
            return word, lengths
    straight = float(np.hypot(*(b - a)[:2])) / max(word.count("S"), 1)
    return word, tuple(straight if letter == "S" else ANGLE * r for letter in word)
