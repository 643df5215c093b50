"""Fast curves along the polyline of a corridor: straight legs and corners rounded outwards.

The shortest curve stops at every corner; passing corners at a positive speed is faster. Two polynomials of
degree 7 pass each corner exactly. They leave the first leg and join the second one with acceleration and
jerk 0. A leg has an acceleration, a cruise and a braking phase. The acceleration in a phase is a trapezoid
with smooth ramps, so the jerk is continuous. Dynamic programming over the speeds at the corners minimises
the flight time; the additional length is limited.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from ...models.fleet_mission.curves import coefficients_between
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.polynomials import bernstein_matrix, derived, factorials, gauss_legendre
from ...models.minimum_snap.trajectory import Trajectory
from .corridor import Corridor

__all__ = ["Legs", "legs_of", "rounded_curve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Degree of all pieces.
DEGREE = 7
#: Share of a cell up to which a knot is on a straight leg.
STRAIGHT = 1e-9
#: Smallest turn at which a robot with stops has to stop, rad.
SLIGHT = 1e-3
#: Shapes of corners: speed at the start, relative to the mean speed from there to the knot, and deceleration
#: there, in units of the reach per squared time. With 2 and 2, the robot brakes uniformly to a stop.
RATIOS, PULLS = np.tile(np.linspace(1.0, 2.0, 11), 6), np.repeat(np.linspace(0.0, 2.0, 6), 11)
#: Samples per piece of a corner (odd, for Simpson's rule), and factor on sampled peaks.
SAMPLES, PEAK = 65, 1.0 + 1e-3
#: Speeds per corner, and the factors between neighbouring ones in consecutive passes.
SPEEDS, FACTORS = 12, (0.7, 0.9, 0.97)
#: Least share of the largest reach, so that slight turns have a low acceleration, and of a ramp's duration.
GENTLE = 0.1
#: Durations of ramps relative to the shortest acceleration phase of a leg. Shorter ramps are faster and
#: have a larger jerk; the first one is used that needs at most `GAIN` times the time with stops.
RAMPS, GAIN = (0.05, 0.02, 0.005, 0.001), 0.99
#: Bisections of a speed or a time, and shares of a time or a length that are rounding errors.
BISECTIONS, SHORT = 50, 1e-10
#: Longest flight in multiples of the shortest acceleration phase and of the shortest ramp.
PHASES = 1e7


class Legs(NamedTuple):
    """Straight legs of a polyline, along the first axis of each array.

    `knots` of the corridor at the ends of the legs, `length` (m), unit vectors `direction`, and the largest
    `speed` (m/s) and acceleration `push` (m/s²) along each leg within the limits of the components.
    """

    knots: Ints
    length: Floats
    direction: Floats
    speed: Floats
    push: Floats

    def stopping(self) -> float:
        """Return the time of a robot that stops at every corner and whose acceleration may jump, s."""
        sharp = np.hypot(*np.diff(self.direction, axis=0).T) > SLIGHT
        first = np.flatnonzero(np.append(True, sharp))
        length, speed, push = (
            np.add.reduceat(self.length, first),
            self.speed[first],
            self.push[first],
        )
        ramps = np.minimum(length, speed**2 / push)
        return float((2.0 * np.sqrt(ramps / push) + (length - ramps) / speed).sum())


def legs_of(problem: FleetMission, way: Corridor) -> Legs:
    """Return the straight legs of a corridor's polyline, none if all its knots coincide."""
    same, knots = STRAIGHT * problem.cell, way.knots
    kept = [0]
    for k in range(1, len(knots) - 1):
        between = knots[kept[-1] + 1 : k + 2] - knots[kept[-1]]
        size = float(np.hypot(*between[-1]))
        chord = between[-1] / max(size, 1e-300)
        along = between @ chord
        off = np.hypot(*(between - np.clip(along, 0.0, size)[:, None] * chord).T).max()
        if np.hypot(*between[-2]) > same and (off > same or (np.diff(along) < -same).any()):
            kept.append(k)
    while kept and np.hypot(*(knots[-1] - knots[kept[-1]])) <= same:
        kept.pop()
    corners = np.array([*kept, len(knots) - 1])
    step = np.diff(knots[corners], axis=0)
    length = np.hypot(*step.T)
    direction = step / length[:, None]
    share = np.maximum(np.abs(direction), 1e-300)
    speed = (problem.velocity_limit / share).min(axis=1)
    push = (problem.acceleration_limit / share).min(axis=1)
    shortest = (length / speed).sum() / PHASES
    return Legs(corners, length, direction, speed, np.minimum(push, speed / max(shortest, 1e-300)))


@cache
def _shapes() -> tuple[Floats, Floats]:
    """Return polynomials of corners from their start to their knot, both of shape (ratios, degree + 1).

    Along the bisector of both legs, the position increases from -1 to 0, with acceleration 0 at the knot.
    Across it, the position decreases from 1 to 0, with velocity and jerk 0 there. The curve after the knot
    is the mirror image, so derivatives up to the jerk are continuous. The other derivatives at the knot
    minimise the integral of the squared jerk.
    """
    start = np.diag(np.append([1.0, 1.0, 2.0, 6.0], np.zeros(DEGREE - 3)))[:4]
    end = [np.append(np.zeros(order), factorials(DEGREE, order)) for order in range(4)]
    hermite = np.linalg.inv(np.concatenate([start, end]))
    nodes, weights = gauss_legendre(DEGREE)
    powers = np.vander(nodes, DEGREE - 2, increasing=True) * factorials(DEGREE, 3)
    jerk = np.sqrt(weights)[:, None] * (powers @ hermite[3:])
    shapes = []
    for sign, free in ((-1.0, [5, 7]), (1.0, [6])):
        states = np.zeros((len(RATIOS), DEGREE + 1))
        states[:, :3] = sign * np.array([np.ones(len(RATIOS)), -RATIOS, PULLS]).T
        states[:, free] = -np.linalg.lstsq(jerk[:, free], jerk @ states.T, rcond=None)[0].T
        shapes.append(states @ hermite.T)
    return shapes[0], shapes[1]


def _halves(legs: Legs, first: Floats, second: Floats) -> Floats:
    """Return both halves of corners with reach 1 m, the second one in reverse order of time.

    `first` and `second` are along and across the bisector, the same for all corners or with one row per corner;
    the result has the shape (2, corners, …, 2).
    """
    before, after = legs.direction[:-1, None], legs.direction[1:, None]
    along = 0.5 * (before + after) * first[..., None]
    across = 0.5 * (after - before) * second[..., None]
    return np.stack([across + along, across - along])


def _limits_of_corners(problem: FleetMission, way: Corridor, legs: Legs, detour: float) -> Floats:
    """Return limits of each corner and shape, shape (3, corners, shapes).

    The largest reach within half of both legs, up to the next stop on a leg, within the boxes beside the knot
    and the allowed additional length (m), the largest speed at the start (m/s), and the least reach per
    squared speed at the start (s²/m).
    """
    knots = legs.knots[1:-1]
    most = 0.5 * np.minimum(legs.length[:-1], legs.length[1:])
    for k, knot in enumerate(knots):
        on_legs = (way.stops > legs.knots[k]) & (way.stops < legs.knots[k + 2])
        gaps = np.hypot(*(way.knots[way.stops[on_legs]] - way.knots[knot]).T)
        most[k] = min(most[k], *gaps[gaps > STRAIGHT * problem.cell], np.inf)
    allowed = 0.5 * detour * (legs.length[:-1] + legs.length[1:])
    weak = np.minimum(legs.push[:-1], legs.push[1:])
    steps, control = np.linspace(0.0, 1.0, SAMPLES), bernstein_matrix(DEGREE)
    powers = [np.vander(steps, DEGREE + 1 - order, increasing=True) for order in range(3)]
    limits = []
    for ratio, pull, x, y in zip(RATIOS, PULLS, *_shapes(), strict=True):
        velocity, acceleration = (
            np.abs(_halves(legs, *(powers[k] @ derived(one[None], k)[0] for one in (x, y))))
            for k in (1, 2)
        )
        longer = 2.0 * (simpson(np.hypot(*np.moveaxis(velocity[0], 2, 0)), x=steps) - 1.0)
        reach = np.minimum(most, allowed / np.maximum(longer, 1e-9))
        hulls = _halves(legs, control @ x, control @ y)
        for hull, box in zip(hulls, (knots - 1, knots), strict=True):
            above, below = (bound[box] - way.knots[knots] for bound in (way.upper, way.lower))
            share = np.abs(np.where(hull > 0.0, above[:, None], below[:, None]) / hull)
            share[np.abs(hull) <= 1e-9] = np.inf
            reach = np.minimum(reach, share.min(axis=(1, 2)))
        slowest = PEAK * (velocity.max(axis=(0, 2)) / problem.velocity_limit).max(axis=1)
        bend = PEAK * (acceleration.max(axis=(0, 2)) / problem.acceleration_limit).max(axis=1)
        limits.append((reach, ratio / slowest, np.maximum(bend, pull / weak) / ratio**2))
    return np.array(limits).transpose(1, 2, 0)


def _ways(legs: Legs, limits: Floats, around: Floats | None, factor: float) -> Floats:
    """Return ways to pass each corner: a stop, and speeds near `around` or below the largest speed.

    The result, shape (5, corners, ways), contains the speed at start and end (m/s), the reach from there to
    the knot (m), the time to the knot (s), the deceleration at the start (m/s²) and the index of the shape.
    Shape and reach minimise the time lost beside a robot that flies straight on.
    """
    reach, speed_limit, bend = limits
    straight = np.minimum(legs.speed[:-1], legs.speed[1:])[:, None]
    most = np.minimum(np.minimum(speed_limit, straight), np.sqrt(reach / bend))
    top = most.max(axis=1, keepdims=True)
    near = top if around is None else around[:, None]
    speed = np.minimum(near * factor ** np.arange(-3.0, SPEEDS - 3), top)
    wide = speed[:, :, None]
    long = np.maximum(wide**2 * bend[:, None], GENTLE * reach[:, None])
    seconds = RATIOS * long / wide
    lost = 2.0 * seconds
    for side in (slice(None, -1), slice(1, None)):
        fast, push = legs.speed[side, None, None], legs.push[side, None, None]
        lost = lost - long / fast + (fast - wide) ** 2 / (2.0 * fast * push)
    shape = np.where(wide <= most[:, None], lost, np.inf).argmin(axis=2)
    pick = (np.arange(len(reach))[:, None], np.arange(SPEEDS), shape)
    pull = PULLS[shape] * long[pick] / seconds[pick] ** 2
    ways = np.where(speed > 0.0, [speed, long[pick], seconds[pick], pull, shape], 0.0)
    return np.pad(ways, ((0, 0), (0, 0), (1, 0)))


def _phase(
    slow: Floats, fast: Floats, pull: Floats, push: Floats, ramp: Floats
) -> tuple[Floats, Floats]:
    """Return the times of ramp, plateau and ramp along the first axis (s), and the length of a phase (m).

    The acceleration is `pull` at the slow end and 0 at the fast end.
    """
    change = np.maximum(fast - slow, 0.0)
    first, last = ramp * np.maximum(1.0 - pull / push, GENTLE), ramp
    rise, fall = 0.5 * (push + pull) * first, 0.5 * push * last
    scale = np.minimum(1.0, change / (rise + fall))
    first, last, rise, fall = (value * scale for value in (first, last, rise, fall))
    plateau = np.maximum(change - rise - fall, 0.0) / push
    length = slow * first + (0.35 * pull + 0.15 * push) * first**2
    length += (slow + rise) * plateau + 0.5 * push * plateau**2
    length += fast * last - 0.15 * push * last**2
    return np.stack([first, plateau, last]), length


def _cruise(
    legs: Legs, ramp: Floats, before: Floats, after: Floats, length: Floats, bisections: int
) -> tuple[Floats, Floats]:
    """Return the cruise speeds (m/s) and the times (s; infinite if impossible) on straight legs.

    `before` and `after` contain the speed and the acceleration at both ends.
    """
    shape = (-1, *[1] * (length.ndim - 1))
    push, ramps = legs.push.reshape(shape), ramp.reshape(shape)

    def phases(cruise: Floats) -> tuple[Floats, Floats]:
        first, second = (_phase(end[0], cruise, end[1], push, ramps) for end in (before, after))
        return (first[0] + second[0]).sum(axis=0), first[1] + second[1]

    least = np.broadcast_to(np.maximum(before[0], after[0]), length.shape)
    possible = (phases(least)[1] <= length) & (length > 0.0)
    low, high = least, np.broadcast_to(legs.speed.reshape(shape), length.shape)
    low = np.where(phases(high)[1] <= length, high, low)
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        fits = phases(middle)[1] <= length
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    seconds, used = phases(low)
    rest = length - used
    rest[rest <= SHORT * length] = 0.0
    for speed, pull in (before, after):
        # Without a phase, the acceleration would jump.
        possible &= (pull == 0.0) | (low > speed * (1.0 + GENTLE**2))
    return low, np.where(possible, seconds + rest / np.maximum(low, 1e-300), np.inf)


def _fastest(legs: Legs, ways: Floats, ramp: Floats) -> Ints:
    """Return the way to pass each corner with the least total time, by dynamic programming."""
    speed, reach, own, pull = np.pad(ways[:4], ((0, 0), (1, 1), (0, 0)))
    ends = np.array([speed, pull])
    length = legs.length[:, None, None] - reach[:-1, :, None] - reach[1:, None]
    _, seconds = _cruise(
        legs, ramp, ends[:, :-1, :, None], ends[:, 1:, None], length, BISECTIONS // 2
    )
    seconds += own[:-1, :, None] + own[1:, None]
    total = np.append(0.0, np.full(SPEEDS, np.inf))
    origins = []
    for step in seconds:
        each = total[:, None] + step
        origins.append(each.argmin(axis=0))
        total = each.min(axis=0)
    path = [0]
    for origin in origins[:0:-1]:
        path.append(int(origin[path[-1]]))
    return np.array(path[:0:-1], np.int64)


def _pieces(legs: Legs, places: Floats, corners: Floats, ramp: Floats) -> tuple[Floats, Floats]:
    """Return coefficients and durations of nine pieces per leg, including the following corner.

    Unused pieces have duration 0.
    """
    count = len(legs.length)
    speed, reach, _, pull = np.pad(corners[:4], ((0, 0), (1, 1)))
    length = legs.length - reach[:-1] - reach[1:]
    ends = np.array([speed, pull])
    cruise, total = _cruise(legs, ramp, ends[:, :-1], ends[:, 1:], length, BISECTIONS)
    times = np.zeros((count, 9))
    forces = np.zeros((count, 8))
    for columns, sign, (slow, weak) in (([0, 1, 2], 1, ends[:, :-1]), ([6, 5, 4], -1, ends[:, 1:])):
        times[:, columns] = _phase(slow, cruise, weak, legs.push, ramp)[0].T
        forces[:, columns[1]] = forces[:, columns[1] + 1] = sign * legs.push
    forces[:, 0], forces[:, 7] = pull[:-1], -pull[1:]
    times[:, 3] = total - times[:, :3].sum(axis=1) - times[:, 4:7].sum(axis=1)
    times[times <= SHORT * total[:, None]] = 0.0
    pieces = np.zeros((count, 9, DEGREE + 1, 2))
    along, rate = reach[:-1], speed[:-1]
    for column in range(7):
        # The acceleration changes by a smooth step of degree 3.
        seconds, start, end = times[:, column], forces[:, column], forces[:, column + 1]
        terms = np.zeros((count, DEGREE + 1))
        terms[:, 1], terms[:, 2] = rate * seconds, 0.5 * start * seconds**2
        terms[:, 4], terms[:, 5] = np.outer([0.25, -0.1], (end - start) * seconds**2)
        pieces[:, column] = terms[:, :, None] * legs.direction[:, None]
        pieces[:, column, 0] = places[:-1] + along[:, None] * legs.direction
        along = along + terms.sum(axis=1)
        rate = rate + 0.5 * (start + end) * seconds
    control = bernstein_matrix(DEGREE)
    shapes = (shape[corners[4].astype(int)] for shape in _shapes())
    halves = corners[1, :, None, None] * _halves(legs, *shapes)
    halves[1] = np.linalg.solve(control, control[::-1]) @ halves[1]  # reverses time
    halves[:, :, 0] += places[1:-1]
    pieces[:-1, 7:] = np.moveaxis(halves, 0, 1)
    times[:-1, 7:] = corners[2, :, None]
    return pieces, times


def rounded_curve(
    problem: FleetMission, way: Corridor, detour: float
) -> tuple[Trajectory, Ints, bool] | None:
    """Return a fast trajectory along the polyline of a corridor, or None if all its knots coincide.

    The curve leaves the polyline only at corners, within the boxes beside them, and is at most the share
    `detour` longer. The result is the trajectory from time 0, its knots at the stops of the corridor, and
    whether it rests at every corner.
    """
    legs = legs_of(problem, way)
    if len(legs.length) == 0:
        return None
    limits = _limits_of_corners(problem, way, legs, detour)
    shortest = np.minimum(legs.speed / legs.push, np.sqrt(legs.length / legs.push))
    row = np.arange(len(legs.length) - 1)
    for share in RAMPS:
        ramp = np.maximum(share * shortest, legs.stopping() / PHASES)
        speed = None
        for factor in FACTORS:
            ways = _ways(legs, limits, speed, factor)
            corners = ways[:, row, _fastest(legs, ways, ramp)]
            speed = corners[0]
        pieces, times = _pieces(legs, way.knots[legs.knots], corners, ramp)
        if times.sum() <= GAIN * legs.stopping():
            break
    used = times.ravel() > 0.0
    instants = np.append(0.0, np.cumsum(times.ravel()[used]))
    curve = Trajectory(instants, pieces.reshape(-1, DEGREE + 1, 2)[used])
    # The knot of a corner is behind the eighth piece of its leg.
    passed = instants[np.append(0, np.cumsum(used).reshape(times.shape)[:, 7])]
    visits = [
        _instant(curve, legs, passed, way, stop, STRAIGHT * problem.cell) for stop in way.stops
    ]
    times = np.union1d(curve.times, visits)
    curve = Trajectory(times, coefficients_between(curve, times, DEGREE))
    return curve, np.searchsorted(times, visits), not corners[0].any()


def _instant(
    curve: Trajectory, legs: Legs, passed: Floats, way: Corridor, stop: int, same: float
) -> float:
    """Return the instant at which the curve passes a stop, at a corner or on a straight leg, s."""
    leg = min(int(np.searchsorted(legs.knots, stop, "right")) - 1, len(legs.length) - 1)
    begin, direction = way.knots[legs.knots[leg]], legs.direction[leg]
    along = float((way.knots[stop] - begin) @ direction)
    if min(along, legs.length[leg] - along) <= same:
        return float(passed[leg + (2.0 * along > legs.length[leg])])
    low, high = passed[leg : leg + 2].tolist()
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if (curve(middle) - begin) @ direction > along else (middle, high)
    near = float(curve.times[np.abs(curve.times - low).argmin()])
    return near if abs(near - low) <= SHORT * curve.duration else float(low)
