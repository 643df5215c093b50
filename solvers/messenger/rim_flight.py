"""Tour in a given order from boundary to boundary: fast for many vehicles, exact for long legs.

Each leg begins at the end of the previous one and has a free final heading, so neither turns nor
rounding errors accumulate as legs grow.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.dubins import advance, dubins_path
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, TourPlan
from .emission import cut
from .last_leg import Disc, shortest_to_disc

__all__ = ["fly_to_rims"]

#: Margin inside the boundary, as a share of the radius.
MARGIN = 1e-6
#: Number of places per radius at which a primitive is checked for vehicles that it passes, and its
#: limit.
DENSITY, PLACES = 4.0, 50
#: Upper bound, in turning radii, on the length flown before the pursuit on a line, with a reserve.
TURNS = 30.0


def fly_to_rims(problem: MessengerTour, order: Iterable[int]) -> TourPlan | None:
    """Return the tour of shortest legs to the discs in an order; None if a leg is not found.

    Vehicles that a leg passes are met on the way.

    Parameters
    ----------
    problem : MessengerTour
        A model with a heading at the start and a turning radius above 0.
    order : iterable of int
        Every vehicle once.
    """
    assert problem.start is not None
    speed, r, reach = problem.speed, problem.turning_radius, problem.radius * (1.0 - MARGIN)
    start = pose = (float(problem.start[0]), float(problem.start[1]), float(problem.start[2]))
    flown, missed = 0.0, np.ones(problem.size, bool)
    path: list[tuple[int, float, float | None]] = []
    stops: dict[int, float] = {}
    for target in order:
        if target in stops:
            continue
        px, py = problem.where(target, flown / speed).tolist()
        vx, vy = problem.velocities[target].tolist()
        far = math.hypot(px - pose[0], py - pose[1])
        most = (far + TURNS * r) / (1.0 - math.hypot(vx, vy) / speed)
        disc = Disc(px, py, vx, vy, float(reach[target]))
        leg = shortest_to_disc(pose, disc, speed, r, most)
        if leg is None:
            return None
        for sign, part in leg:
            count = 1 + int(min(DENSITY * part / max(float(reach.min()), r / PLACES), PLACES))
            for along in np.linspace(0.0, part, count, endpoint=False).tolist():
                x, y, _ = advance(*pose, along, sign, r)
                for vehicle in _within(problem, (x, y), flown + along, reach, missed).tolist():
                    missed[vehicle] = False
                    stops[vehicle] = flown + along
            path.append((sign, part, None))
            pose, flown = advance(*pose, part, sign, r), flown + part
        missed[target] = False
        stops.setdefault(target, flown)
    if problem.closed:
        path += [(int(SIGNS[turn]), part, None) for turn, part in dubins_path(pose, start, r)]
    return cut(problem, start, path, stops)


def _within(
    problem: MessengerTour, place: tuple[float, float], flown: float, reach: NDArray[np.float64],
    missed: NDArray[np.bool_],
) -> NDArray[np.intp]:  # fmt: skip
    """Return the vehicles not met yet whose discs the UAV is in."""
    apart = problem.positions + problem.velocities * (flown / problem.speed) - place
    return np.flatnonzero(missed & (np.hypot(*apart.T) <= reach))
