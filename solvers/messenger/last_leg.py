"""The last leg of an open tour: the heading at its end is free, and the disc is met at its rim.

The boundary of what a vehicle of bounded curvature reaches after a given length consists of ends of
an arc and a line, and of ends of two arcs (Cockayne and Hall, SIAM Journal on Control 13, 1975), so
the disc is first met at one of these.

- A line ends with the disc's centre straight ahead. Between the times at which the centre is ahead of
  the pose or as far from the turning circle as the radius, the length of arc and line changes at most
  as fast as the disc moves, which is slower than the UAV: there is one root at most, and a bracket.
- The ends of two arcs of a given length are a cardioid, and its critical points are roots of a quartic.
  The distance from it to the centre changes at most by the sum of both ways, so a step of
  the distance left cannot pass over the first contact.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...models.messenger.dubins import advance
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, Primitive, TourPlan

__all__ = ["Disc", "shorten_last_leg", "shortest_to_disc"]

Path = list[tuple[int, float]]

FULL = 2.0 * math.pi
#: Share of the radius that the path goes inside the rim, so that rounding keeps it within.
MARGIN = 1e-10
#: Least gain of a leg, relative to the tour.
GAIN = 1e-13
#: Distance from the rim at contact, as a share of the radius and of the turning radius.
TOUCH, ROUNDING = 1e-11, 1e-14
#: Smallest step, as a share of the radius: a disc that dips in by less may be passed over.
FINEST = 1e-7
#: Largest error of an angle to a point near the line ahead, rad.
AHEAD = 1e-9


class Disc(NamedTuple):
    """A disc that moves: centre (m), velocity (m/s) and radius (m), as the UAV begins its leg."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float


def shorten_last_leg(problem: MessengerTour, plan: TourPlan) -> TourPlan | None:
    """Return `plan` with the shortest last leg from its beginning; None if that gains nothing."""
    if problem.closed or problem.turning_radius == 0 or not plan.order:
        return None
    last = len(plan.order) - 1
    before = [one for one in plan.primitives if one.leg < last]
    flown = float(sum(one.length for one in before))
    pose = (float(plan.start[0]), float(plan.start[1]), float(plan.start[2]))
    for one in before:
        pose = advance(*pose, one.length, int(SIGNS[one.turn]), problem.turning_radius)
    vehicle = plan.order[last]
    place = problem.where(vehicle, flown / problem.speed)
    radius = float(problem.radius[vehicle]) * (1.0 - MARGIN)
    px, py = place.tolist()
    vx, vy = problem.velocities[vehicle].tolist()
    disc = Disc(px, py, vx, vy, radius)
    most = plan.length - flown
    path = shortest_to_disc(pose, disc, problem.speed, problem.turning_radius, most)
    length = sum(part for _, part in path or ())
    if path is None or length >= most - GAIN * plan.length:
        return None
    pieces, (x, y, heading) = list(before), pose
    for sign, part in path:
        if part > 0.0:
            pieces.append(Primitive(last, "RSL"[sign + 1], part, heading))
            x, y, heading = advance(x, y, heading, part, sign, problem.turning_radius)
    times, points = plan.times.copy(), plan.points.copy()
    times[last], points[last] = (flown + length) / problem.speed, (x, y)
    return TourPlan(plan.order, times, points, plan.start, tuple(pieces))


def shortest_to_disc(
    pose: tuple[float, float, float], disc: Disc, speed: float, turning: float, most: float
) -> list[tuple[int, float]] | None:
    """Return the signs and lengths (m) of the arcs and lines of the shortest path to a disc.

    Parameters
    ----------
    pose : tuple of 3 float
        x, y (m), heading (rad) at the beginning.
    disc : Disc
        The disc to reach.
    speed : float
        Of the UAV, m/s.
    turning : float
        Least turning radius, m.
    most : float
        Length beyond which no path is looked for, m.

    Returns
    -------
    list of (int, float) or None
        Nothing to fly where the UAV is in the disc; None if no path is shorter than `most`.
    """
    x, y, heading = pose
    if math.hypot(disc.x - x, disc.y - y) <= disc.radius:
        return []
    if not 0.0 < most < math.inf:
        return None
    # In the frame of the UAV, the turning radius and the UAV's speed being 1.
    turned = cmath.exp(-1j * heading)
    place = complex(disc.x - x, disc.y - y) * turned / turning
    velocity = complex(disc.vx, disc.vy) * turned / speed
    reach, most = disc.radius / turning, most / turning
    best: Path | None = None
    for path in _lines(place, velocity, reach, most):
        length = path[0][1] + path[1][1]
        if length <= most:
            best, most = path, length
    best = _arcs(place, velocity, reach, min(most, 2.0 * FULL)) or best
    return None if best is None else [(sign, turning * part) for sign, part in best]


def _lines(q: complex, w: complex, reach: float, most: float) -> Iterator[Path]:
    """Yield the paths of an arc and a line to a disc at `q` that moves by `w` per length flown."""
    from scipy.optimize import brentq

    for sign in (1, -1):
        p, v = (q, w) if sign > 0 else (q.conjugate(), w.conjugate())
        cuts = [0.0, most, -p.imag / v.imag if v.imag else 0.0]
        square = abs(v) ** 2
        if square > 0.0:  # the distance from the turning circle is the radius
            middle = -((p - 1j) * v.conjugate()).real / square
            aside = abs(p - 1j + v * middle) ** 2
            half = math.sqrt(max(1.0 + reach**2 - aside, 0.0) / square)
            cuts += [middle - half, middle + half]
        for low, high in pairwise(sorted(min(max(cut, 0.0), most) for cut in cuts)):
            at = p + v * 0.5 * (low + high)
            if low == high or abs(at - 1j) ** 2 < 1.0 + reach**2:
                continue
            data = (p, v, reach, at.imag >= 0.0)
            if _excess(low, *data) >= 0.0 >= _excess(high, *data):
                root = brentq(_excess, low, high, args=data, xtol=1e-300, rtol=1e-15)
                arc, ahead = _tangent(p + v * root, at.imag >= 0.0)
                yield [(sign, arc), (0, max(ahead - reach, 0.0))]
                break


def _tangent(p: complex, above: bool) -> tuple[float, float]:
    """Return the arc to the left and the line that lead to `p`, which is above the line ahead."""
    ahead = math.sqrt(max(abs(p - 1j) ** 2 - 1.0, 0.0))
    arc = (cmath.phase(p - 1j) + math.atan2(1.0, ahead)) % FULL
    if above and arc > FULL - AHEAD:
        arc = 0.0
    elif not above and arc < AHEAD:
        arc += FULL
    return arc, ahead


def _excess(length: float, p: complex, v: complex, reach: float, above: bool) -> float:
    """Return by how much arc and line to the rim of a disc are longer than the length flown."""
    arc, ahead = _tangent(p + v * length, above)
    return arc + ahead - reach - length


def _arcs(q: complex, w: complex, reach: float, most: float) -> Path | None:
    """Return the two arcs that first meet a disc at `q` that moves by `w` per length flown."""
    from scipy.optimize import brentq

    def gap(length: float) -> float:
        """Return the distance of the rim from the ends of arcs."""
        return _nearest(q + w * length, length)[0] - reach

    length, before = 0.0, 0.0
    while length <= most:
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
    """Return the distance from `q` to the ends of two arcs of a length, and the nearest ones.

    Seen from the centre of the first circle, the ends are -2 z + k z² up to a factor i, z = exp(i arc)
    and k = exp(-i length). The distance is stationary at a root of a polynomial of degree 4.
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
