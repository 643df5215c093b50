"""Legs with a free final heading that end on the boundary of a disc.

The last leg of an open tour is of this kind, and all legs of a tour from boundary to boundary.

The boundary of the region that a vehicle of bounded curvature reaches after a given length consists
of ends of an arc and a line, and of ends of two arcs (Cockayne and Hall, SIAM Journal on Control
13, 1975). The first contact with the disc is therefore the end of such a path.

- A line ends with the disc's centre straight ahead. Consider the times between those at which the centre
  is ahead of the pose, or at which its distance to the turning circle equals the radius. Between
  them the length of arc and line changes at most as fast as the disc moves, which is slower than
  the UAV: at most one root exists, and it is bracketed.
- The ends of two arcs of a given length form a cardioid, whose critical points are roots of a quartic.
  Its distance to the centre changes by at most the sum of both displacements, so a step of the
  remaining distance cannot skip the first contact.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.dubins import WORDS, advance, shortest
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, Primitive, TourPlan
from .emission import cut, safe_radius

__all__ = ["Disc", "bound_only_leg", "fly_to_rims", "shorten_last_leg", "shortest_to_disc"]

Path = list[tuple[int, float]]
Flag = NDArray[np.int8]

FULL = 2.0 * math.pi
#: Margin inside the boundary, as a share of the radius, against rounding: of the last leg alone, and
#: of legs that others follow.
MARGIN, WIDE_MARGIN = 1e-10, 1e-6
#: Relative rounding error of a bound.
EXACT = 1e-9
#: Least gain of a leg, relative to the tour.
GAIN = 1e-13
#: Tolerance of the contact, as a share of the radius and of the turning radius.
TOUCH, ROUNDING = 1e-11, 1e-14
#: Smallest step, as a share of the radius. A contact shallower than this may be skipped.
FINEST = 1e-7
#: Largest error of an angle to a point near the line ahead, in rad.
AHEAD = 1e-9
#: Number of places per radius at which a primitive is checked for vehicles that it passes, and its
#: limit.
DENSITY, PLACES = 4.0, 50
#: Upper bound, in turning radii, on the length flown before the pursuit on a line, with a reserve.
TURNS = 30.0


class Disc(NamedTuple):
    """Moving disc: centre (m), velocity (m/s) and radius (m) at the start of the leg."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float

    @classmethod
    def at(cls, problem: MessengerTour, vehicle: int, time: float, margin: float) -> Disc:
        """Return the disc of `vehicle` at `time` (s), smaller by a share `margin`."""
        (x, y), (vx, vy) = (
            problem.where(vehicle, time).tolist(),
            problem.velocities[vehicle].tolist(),
        )
        return cls(x, y, vx, vy, float(problem.radius[vehicle]) * (1.0 - margin))

    def limit(self, pose: tuple[float, float, float], speed: float, r: float) -> float:
        """Return an upper bound (m) on the shortest flight from a pose to the disc."""
        far = math.hypot(self.x - pose[0], self.y - pose[1])
        return (far + TURNS * r) / (1.0 - math.hypot(self.vx, self.vy) / speed)


def bound_only_leg(problem: MessengerTour) -> float | None:
    """Return a lower bound (m), exact up to rounding, on an open tour to one vehicle; None for other tours."""
    r, start = problem.turning_radius, problem.start
    if problem.size > 1 or problem.closed or start is None or problem.heading is None or r == 0.0:
        return None
    disc, pose = Disc.at(problem, 0, 0.0, 0.0), (float(start[0]), float(start[1]), problem.heading)
    path = shortest_to_disc(pose, disc, problem.speed, r, disc.limit(pose, problem.speed, r))
    return None if path is None else (1.0 - EXACT) * sum(part for _, part in path)


def shorten_last_leg(
    problem: MessengerTour, plan: TourPlan, flag: Flag | None = None
) -> TourPlan | None:
    """Return `plan` with the shortest last leg from its beginning; None if this gains nothing."""
    if problem.closed or problem.turning_radius == 0 or not plan.order:
        return None
    last, r = len(plan.order) - 1, problem.turning_radius
    before = [primitive for primitive in plan.primitives if primitive.leg < last]
    flown = float(sum(primitive.length for primitive in before))
    pose = (float(plan.start[0]), float(plan.start[1]), float(plan.start[2]))
    for primitive in before:
        pose = advance(*pose, primitive.length, int(SIGNS[primitive.turn]), r)
    disc = Disc.at(problem, plan.order[last], flown / problem.speed, MARGIN)
    limit = plan.length - flown
    path = shortest_to_disc(pose, disc, problem.speed, r, limit, flag)
    length = sum(part for _, part in path or ())
    if path is None or length >= limit - GAIN * plan.length:
        return None
    pieces, (x, y, heading) = list(before), pose
    for sign, part in path:
        if part > 0.0:
            pieces.append(Primitive(last, "RSL"[sign + 1], part, heading))
            x, y, heading = advance(x, y, heading, part, sign, r)
    times, points = plan.times.copy(), plan.points.copy()
    times[last], points[last] = (flown + length) / problem.speed, (x, y)
    return TourPlan(plan.order, times, points, plan.start, tuple(pieces))


def fly_to_rims(
    problem: MessengerTour, order: Iterable[int], flag: Flag | None = None
) -> TourPlan | None:
    """Return the tour of shortest legs to the discs in an order; None if a leg is not found or the home moves.

    The tour is fast for many vehicles, and exact for long legs: each leg begins at the end of the
    previous one and has a free final heading, so neither turns nor rounding errors accumulate.
    Vehicles that a leg passes are met on the way. The model has a heading at the start and a turning
    radius above 0, and `order` contains every vehicle once.
    """
    assert problem.start is not None
    if problem.home_velocity is not None:
        return None
    speed, r, reach = problem.speed, problem.turning_radius, safe_radius(problem, WIDE_MARGIN)
    start = pose = (float(problem.start[0]), float(problem.start[1]), float(problem.start[2]))
    flown, missed = 0.0, np.ones(problem.size, bool)
    path: list[tuple[int, float, float | None]] = []
    stops: dict[int, float] = {}
    for target in order:
        if target in stops:
            continue
        disc = Disc.at(problem, target, flown / speed, WIDE_MARGIN)
        if math.hypot(disc.x - pose[0], disc.y - pose[1]) <= reach[target]:
            # At the rim of its disc, a flight to the smaller disc could be long.
            missed[target], stops[target] = False, flown
            continue
        leg = shortest_to_disc(pose, disc, speed, r, disc.limit(pose, speed, r), flag)
        if leg is None:
            return None
        for sign, part in leg:
            count = 1 + int(min(DENSITY * part / max(float(reach.min()), r / PLACES), PLACES))
            for along in np.linspace(0.0, part, count, endpoint=False).tolist():
                x, y, _ = advance(*pose, along, sign, r)
                apart = problem.positions + problem.velocities * ((flown + along) / speed) - (x, y)
                for vehicle in np.flatnonzero(missed & (np.hypot(*apart.T) <= reach)).tolist():
                    missed[vehicle] = False
                    stops[vehicle] = flown + along
            path.append((sign, part, None))
            pose, flown = advance(*pose, part, sign, r), flown + part
        missed[target] = False
        stops.setdefault(target, flown)
    if problem.closed:
        *parts, word = shortest(*pose, *start, r)
        path += [(sign, part, None) for sign, part in zip(WORDS[word].tolist(), parts, strict=True)]
    return cut(problem, start, path, stops)


def shortest_to_disc(
    pose: tuple[float, float, float], disc: Disc, speed: float, turning: float, most: float,
    flag: Flag | None = None,
) -> Path | None:  # fmt: skip
    """Return the signs and lengths (m) of the primitives of the shortest path from `pose` to a disc.

    The path is empty if the UAV is in the disc, and None if no path is at most `most` (m) long. If
    the stop flag is set, no path of two arcs is searched for. `turning` is the turning radius (m).
    """
    x, y, heading = pose
    if math.hypot(disc.x - x, disc.y - y) <= disc.radius:
        return []
    if not 0.0 < most < math.inf:
        return None
    # Frame of the UAV, with turning radius and speed scaled to 1.
    turned = cmath.exp(-1j * heading)
    place = complex(disc.x - x, disc.y - y) * turned / turning
    velocity = complex(disc.vx, disc.vy) * turned / speed
    reach, most = disc.radius / turning, most / turning
    best: Path | None = None
    for path in _lines(place, velocity, reach, most):
        length = path[0][1] + path[1][1]
        if length <= most:
            best, most = path, length
    best = _arcs(place, velocity, reach, min(most, 2.0 * FULL), flag) or best
    return None if best is None else [(sign, turning * part) for sign, part in best]


def _lines(q: complex, w: complex, reach: float, most: float) -> Iterator[Path]:
    """Yield the arc-line paths to a disc at `q` that moves by `w` per unit of length flown."""
    from scipy.optimize import brentq

    for sign in (1, -1):
        p, v = (q, w) if sign > 0 else (q.conjugate(), w.conjugate())
        cuts = [0.0, most, -p.imag / v.imag if v.imag else 0.0]
        square = abs(v) ** 2
        if square > 0.0:  # times at which the distance to the turning circle equals the radius
            middle = -((p - 1j) * v.conjugate()).real / square
            aside = abs(p - 1j + v * middle) ** 2
            half = math.sqrt(max(1.0 + reach**2 - aside, 0.0) / square)
            cuts += [middle - half, middle + half]
        for low, high in pairwise(sorted(min(max(end, 0.0), most) for end in cuts)):
            point = p + v * 0.5 * (low + high)
            if low == high or abs(point - 1j) ** 2 < 1.0 + reach**2:
                continue
            data = (p, v, reach, point.imag >= 0.0)
            if _excess(low, *data) >= 0.0 >= _excess(high, *data):
                root = brentq(_excess, low, high, args=data, xtol=1e-300, rtol=1e-15)
                arc, ahead = _tangent(p + v * root, point.imag >= 0.0)
                yield [(sign, arc), (0, max(ahead - reach, 0.0))]
                break


def _tangent(p: complex, above: bool) -> tuple[float, float]:
    """Return the left arc and the line to `p`; `above` states whether `p` is left of the line ahead."""
    ahead = math.sqrt(max(abs(p - 1j) ** 2 - 1.0, 0.0))
    arc = (cmath.phase(p - 1j) + math.atan2(1.0, ahead)) % FULL
    if above and arc > FULL - AHEAD:
        arc = 0.0
    elif not above and arc < AHEAD:
        arc += FULL
    return arc, ahead


def _excess(length: float, p: complex, v: complex, reach: float, above: bool) -> float:
    """Return the length of arc and line to the boundary of a disc minus the length flown."""
    arc, ahead = _tangent(p + v * length, above)
    return arc + ahead - reach - length


def _arcs(q: complex, w: complex, reach: float, most: float, flag: Flag | None) -> Path | None:
    """Return the first two-arc path to a disc at `q` that moves by `w` per unit of length flown."""
    from scipy.optimize import brentq

    def gap(length: float) -> float:
        """Return the distance of the boundary from the ends of two-arc paths."""
        return _nearest(q + w * length, length)[0] - reach

    length, before = 0.0, 0.0
    while length <= most and (flag is None or not flag[0]):
        left, sign, arc = _nearest(q + w * length, length)
        left -= reach
        if left < -TOUCH * reach:
            length = brentq(gap, before, length, xtol=1e-300, rtol=1e-15)
            left, sign, arc = _nearest(q + w * length, length)
            left = 0.0
        if left <= TOUCH * reach + ROUNDING:
            return [(sign, arc), (-sign, length - arc)]
        before = length
        length += max(left, FINEST * reach) / (1.0 + abs(w))
    return None


def _nearest(q: complex, length: float) -> tuple[float, int, float]:
    """Return the distance from `q` to the ends of two-arc paths of a length, and the nearest path.

    Relative to the centre of the first circle, the ends are -2 z + k z² up to a factor i, with z = exp(i arc) and
    k = exp(-i length). The distance is stationary at roots of a quartic polynomial.
    """
    best = (math.inf, 0, 0.0)
    k = cmath.exp(-1j * length)
    for sign in (1, -1):
        p = ((q if sign > 0 else q.conjugate()) - 1j) / 1j
        a, b = p.conjugate() - k, -k * p.conjugate()
        roots = np.roots([b, a, 0.0, -a.conjugate(), -b.conjugate()])
        for arc in (0.0, *(cmath.phase(root) % FULL for root in roots.tolist())):
            z = cmath.exp(1j * arc)
            distance = abs(p + 2.0 * z - k * z * z)
            if arc <= length and distance < best[0]:
                best = (distance, sign, arc)
    return best
