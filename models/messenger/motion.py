"""Equations of motion along a tour, conversion of primitive lengths to a tour, and an initial guess.

The columns are the start, the length of each primitive and the state at each encounter: the offset
from the vehicle, the heading and the length flown. A leg couples only two states and its own
lengths, so Jacobian and Hessian are banded. An offset keeps its precision however far apart the
vehicles are. With the start at the origin, c_i = V_i / v and the offset d_i, vehicle i is met at
P_i + c_i s_i + d_i after a flight of length s_i. A turn of length l and sign σ advances by 2 r
sin(l / 2r) in the direction h + σ l / 2r, a straight line by l in the direction h.

With a turning radius of 0, a leg of length l reaches any point within distance l: the surplus is
flown out and back. The only constraint is |P - Q| <= l, a cone, so the program of an order is
convex.

In the initial guess, the vehicle met soonest comes next, and headings bisect the directions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from .checks import integrated
from .dubins import WORDS, shortest, word_lengths
from .model import MessengerTour
from .plan import Primitive, TourPlan

__all__ = [
    "Layout",
    "chase",
    "equations",
    "guess_tour",
    "match_primitives",
    "met_after",
    "tour",
    "words_of",
]

Floats = NDArray[np.float64]

#: Letters of the six words by code.
LETTERS = ["".join("RSL"[sign + 1] for sign in word) for word in WORDS.tolist()]
#: Initial angle of each turn of a word other than the six, in rad.
ANGLE = 0.1


class Layout(NamedTuple):
    """Positions of the blocks of columns.

    `counts` are the numbers of primitives of the legs, 1 each without `turning`, i.e. with a turning radius of 0. A
    closed tour over `vehicles` has one more leg, which leads back.
    """

    counts: tuple[int, ...]
    vehicles: int
    turning: bool

    @property
    def pieces(self) -> int:
        """Number of primitives."""
        return sum(self.counts)

    @property
    def sizes(self) -> dict[str, int]:
        """Size of each block of columns, in order."""
        n, k = self.vehicles, self.pieces
        heading = n if self.turning else 0
        return {"start": 3, "length": k, "offset": 2 * n, "heading": heading, "flown": n}

    def split(self, x: Any) -> dict[str, Any]:
        """Return the blocks of a column vector by name."""
        start, blocks = 0, {}
        for name, size in self.sizes.items():
            blocks[name] = x[start : start + size]
            start += size
        return blocks


def equations(
    x: Any, layout: Layout, signs: Sequence[float], data: dict[str, Any]
) -> dict[str, Any]:
    """Return the objective and the rows as expressions of the columns `x`, a casadi.SX.

    `signs` are those of the curvature of every primitive. `data` has ``"place"`` (n, 2), P_i in the order of
    encounters relative to the start, in m; ``"drift"`` (n, 2), c_i; ``"home"`` (2,), that of the home; ``"radius"``,
    the turning radius in m; ``"winding"``, the number of full circles of a closed tour; ``"blunt"``, the rounding
    of the tip of the cone of a leg without turns, in m.

    The result has ``"length"``, the objective, and lists of rows: ``"motion"``, two per leg, in m, equal to 0;
    ``"turn"``, one per leg, in rad, equal to 0; with a turning radius of 0 instead ``"straight"``, one per leg, in m,
    at most 0; ``"flown"``, one per vehicle, in m, equal to 0; ``"apart"``, the squared offset of each vehicle, in m².
    """
    import casadi as ca

    part = layout.split(x)
    place, drift, r = data["place"], data["drift"], data["radius"]
    offset, flown = part["offset"], part["flown"]
    x0, y0, h0 = (part["start"][k] for k in range(3))
    here, heading, before = (x0, y0), h0, 0.0
    rows: dict[str, Any] = {name: [] for name in ("motion", "turn", "straight", "flown", "apart")}
    piece = 0
    for leg, count in enumerate(layout.counts):
        ahead, left, way = here[0], here[1], before
        for k in range(piece, piece + count):
            length, sign = part["length"][k], signs[k]
            if not layout.turning:
                bend = chord = 0.0
            else:
                bend = 0.5 * sign * length / r
                chord = length if sign == 0 else 2.0 * r * ca.sin(0.5 * length / r)
            ahead += chord * ca.cos(heading + bend)
            left += chord * ca.sin(heading + bend)
            heading, way = heading + 2.0 * bend, way + length
        piece += count
        if leg < layout.vehicles:
            s, dx, dy = flown[leg], offset[2 * leg], offset[2 * leg + 1]
            here = (place[leg, 0] + drift[leg, 0] * s + dx, place[leg, 1] + drift[leg, 1] * s + dy)
            rows["flown"].append(way - s)
            rows["apart"].append(dx * dx + dy * dy)
            goal, before = part["heading"][leg] if layout.turning else 0.0, s
        else:
            here = (x0 + data["home"][0] * way, y0 + data["home"][1] * way)
            goal = h0 + 2.0 * math.pi * data["winding"]
        ahead, left = ahead - here[0], left - here[1]
        if layout.turning:
            rows["motion"] += [ahead, left]
            rows["turn"].append(heading - goal)
            heading = goal
        else:
            chord = ca.sqrt(ahead * ahead + left * left + data["blunt"] ** 2)
            rows["straight"].append(chord - part["length"][leg])
    rows["length"] = way
    return rows


def tour(
    model: MessengerTour, order: Sequence[int], words: Sequence[str], start: Floats,
    lengths: Floats, directions: Floats | None = None,
) -> TourPlan:  # fmt: skip
    """Return the plan that flies given primitives, with times and points from their integration.

    `words` contains the turns of each leg, `start` x, y (m) and heading (rad), `lengths` the lengths
    of all k primitives (m), and `directions`, if the turning radius is 0, their headings (rad).
    """
    letters = "".join(words)
    legs = np.repeat(np.arange(len(words)), [len(word) for word in words])
    initial = np.zeros(len(letters)) if directions is None else directions
    pieces = [
        Primitive(int(leg), turn, float(length), float(heading))
        for leg, turn, length, heading in zip(legs, letters, lengths, initial, strict=True)
    ]
    n = len(order)
    bare = TourPlan(tuple(order), np.zeros(n), np.zeros((n, 2)), start, tuple(pieces))
    poses = integrated(bare, model.turning_radius)
    ends = np.searchsorted(legs, np.arange(n), side="right")
    flown = np.concatenate([[0.0], np.cumsum(lengths)])
    headed = (
        piece._replace(heading=float(h)) for piece, h in zip(pieces, poses[:, 2], strict=False)
    )
    points = poses[ends, :2] + flown[ends, None] * model.drift
    return replace(bare, times=flown[ends] / model.speed, points=points, primitives=tuple(headed))


def words_of(model: MessengerTour, plan: TourPlan) -> tuple[str, ...]:
    """Return the turns of each leg of `plan`; with a turning radius of 0, one line per leg.

    :class:`~crosstrack.errors.InvalidData` is raised if the leg number of a primitive is out of range.
    """
    words = [""] * (model.size + model.closed)
    for row, primitive in enumerate(plan.primitives):
        if not 0 <= primitive.leg < len(words):
            raise InvalidData(
                f"primitives[{row}].leg must lie in 0 … {len(words) - 1}, got {primitive.leg}",
                field="primitives",
            )
        words[primitive.leg] += primitive.turn
    return tuple(words) if model.turning_radius > 0 else ("S",) * len(words)


def match_primitives(words: Sequence[str], targets: Sequence[str]) -> list[int]:
    """Return the index of each letter of the `words` of the legs among those of their `targets`.

    :class:`~crosstrack.errors.InvalidData` is raised if a word is not a subsequence of its target.
    """
    indices: list[int] = []
    first = 0
    for leg, (word, target) in enumerate(zip(words, targets, strict=True)):
        position = -1
        for letter in word:
            position = target.find(letter, position + 1)
            if position < 0:
                raise InvalidData(
                    f"primitives: leg {leg} turns {word!r}, the formulation's word is {target!r}",
                    field="primitives",
                )
            indices.append(first + position)
        first += len(target)
    return indices


def met_after(
    model: MessengerTour, place: Floats, time: float, vehicles: Sequence[int] | NDArray[np.int64]
) -> Floats:
    """Return the durations (s) of straight flights from `place` (m) at `time` (s) to vehicles."""
    rate = model.velocities[vehicles]
    return chase(model.positions[vehicles] + rate * time - place, rate, model.speed)


def chase(way: Floats, rate: Floats, speed: float) -> Floats:
    """Return the durations (s) of straight flights to places at `way` (m) that move at `rate` (m/s)."""
    along, fast = (way * rate).sum(axis=-1), np.hypot(*rate.T)
    room = (speed - fast) * (speed + fast)
    after: Floats = (along + np.sqrt(along**2 + room * (way**2).sum(axis=-1))) / room
    return after


def guess_tour(
    model: MessengerTour, order: Sequence[int] | None, words: Sequence[str] | None
) -> TourPlan:
    """Return a tour that meets each vehicle at its centre, unless a given word cannot lead there.

    Without `order`, the vehicle met soonest on a straight line comes next. Without `words`, the legs
    are shortest paths. The tour may be infeasible if a word is not one of the six Dubins words.
    """
    ground, model = model, model.relative_to_air()
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
        rate, end = model.home_drift, float(start[2])
        goal = start[:2] + rate * time
        after = float(chase(goal - place, rate, model.speed))
        goal = goal + rate * after
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
        ground, met, [word for word, *_ in legs], start,
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
    """Return the delay (s) of a leg from `pose`, compared with a straight flight of `after` s to `goal`."""
    from scipy.optimize import brentq

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
