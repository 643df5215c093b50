"""``minco``: the curve of minimum time in the corridor, durations and knots as unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.flight.model import Flight, FlightObjective
from ...models.flight.plan import FlightPlan
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import Option, Request
from ..minimum_snap.minco import Fastest, Region, Rows, fastest, limits_of
from .course import Course, excess, times_along, typical
from .staged import StagedFlight, smoothest, standing

__all__ = ["Minco", "ends_of", "engine", "limits_within"]

Floats = NDArray[np.float64]

#: Numbers of polynomials per polytope that are tried by default.
PIECES = (1, 2)
#: Length of an excess 1 of a polytope in cells.
SIZE = 1.0


class Minco(StagedFlight):
    """Path by A*, corridor of convex polytopes, curve of locally minimum time or weighted objective.

    Source: Wang, Zhou, Xu and Gao, "Geometrically constrained trajectory optimization for
    multicopters", 2022. The durations and the knots in the corridor are optimised together, and the time
    is stretched until the exact checks of the vehicle accept the curve. If none is accepted, the smoothest
    curve of the backend ``staged`` is returned.
    """

    name = "minco"
    options: ClassVar[Mapping[str, Option]] = {
        "evaluations": Option(4000, "Largest number of evaluations of each search.", int, lower=1),
        "pieces": Option(
            0, "Number of polynomials per polytope; 0 tries 1 and 2 and keeps the better.", int,
            lower=0, upper=8,
        ),
    }  # fmt: skip
    summary = "path, corridor, and durations and knots optimised together; ours"

    def fly(
        self, problem: Flight, course: Course, request: Request, statistics: dict[str, Any]
    ) -> FlightPlan | None:
        """Optimise the curve in the corridor."""
        own, flag = request.options, request.control.flag
        best: tuple[float, FlightPlan] | None = None
        for pieces in [own["pieces"]] if own["pieces"] else PIECES:
            divided = course.divided(pieces)
            result = engine(problem, divided, flag=flag, evaluations=own["evaluations"])
            spent = statistics.get("evaluations", 0)
            statistics["evaluations"] = spent + result.evaluations
            times = np.concatenate([[0.0], np.cumsum(result.durations)])
            if not np.isfinite(result.coefficients).all() or not (np.diff(times) > 0).all():
                continue
            curve = Trajectory(times, result.coefficients)
            plan = FlightPlan(curve, times[divided.stops[1:-1]], course.path)
            checked = standing(problem).verify(plan, tolerance=request.tolerance)
            objective = checked.objective
            if checked.ok and objective is not None and (best is None or objective < best[0]):
                best = objective, plan
        return smoothest(problem, course, request, statistics) if best is None else best[1]


def engine(
    problem: Flight,
    course: Course,
    *,
    points: Floats | None = None,
    durations: Floats | None = None,
    limits: Floats | None = None,
    **options: Any,
) -> Fastest:
    """Return the curve of locally minimum objective in the corridor of a course.

    The search starts at the knots `points`, m, and `durations`, s, by default those of the course, and keeps
    `limits`, by default those of the vehicle. Further options are those of
    :func:`~crosstrack.solvers.minimum_snap.minco.fastest`.
    """
    knots = course.knots if points is None else points
    timed = problem.objective is FlightObjective.TIME
    vehicle = problem.vehicle
    regions, jets = ends_of(problem, course)
    return fastest(
        knots, limits_within(vehicle) if limits is None else limits, regions=regions, jets=jets, order=problem.order,
        rows=Rows.of_polytopes(course.polytopes, SIZE * problem.cell),
        time_weight=None if timed else problem.time_weight,
        durations=times_along(problem, knots) if durations is None else durations,
        exact=lambda times, powers: excess(
            vehicle, Trajectory(np.concatenate([[0.0], np.cumsum(times)]), powers)
        ),
        **options,
    )  # fmt: skip


def ends_of(problem: Flight, course: Course) -> tuple[list[Region], Floats]:
    """Return the region of each knot, and the derivatives at the knots, infinite if free."""
    count, axes = course.knots.shape
    free = Region("affine", np.zeros(axes), problem.cell * np.eye(axes))
    regions = [free] * count
    for knot, place in zip(course.stops.tolist(), problem.places, strict=True):
        regions[knot] = Region.fixed(place)
    jets = np.full((count, problem.order, axes), np.inf)
    for end, side in ((0, "start"), (-1, "goal")):
        jets[end, 1:] = 0.0
        jets[end, 1] = getattr(problem, f"{side}_velocity")
        jets[end, 2] = getattr(problem, f"{side}_acceleration")
    return regions, jets


def limits_within(vehicle: Any, reserve: float = 0.0) -> Floats:
    """Return the limits of a vehicle for the engine, tighter by a share `reserve`."""
    limits = limits_of(vehicle)
    if hasattr(vehicle, "wheel_speed"):
        speed, push = typical(vehicle)
        limits[2:4] = speed**2, push**2
    share = (1.0 - reserve) ** 2
    limits[[2, 3, 4, 7]] *= share
    limits[5] /= share
    limits[6] = np.cos((1.0 - reserve) * np.arccos(limits[6])) if limits[6] > -1.0 else -1.0
    return limits
