"""One call from a map to a flight."""

from __future__ import annotations

import dataclasses
from typing import Any

from ...models.flight.model import Flight
from ...models.flight.plan import FlightPlan
from ..contract.solution import Solution
from ..run.dispatch import solve

__all__ = ["plan_flight"]

_FIELDS = frozenset(field.name for field in dataclasses.fields(Flight))


def plan_flight(
    map: Any,  # noqa: A002 - public name of the field
    start: Any,
    goal: Any,
    vehicle: Any,
    **options: Any,
) -> Solution[FlightPlan]:
    """Plan a flight from a start to a goal on a map: path, corridor, curve and verification.

    Parameters
    ----------
    map : GridMap, VoxelMap, list of polygons, or ndarray of shape (n, 2) or (n, 3)
        Obstacles, see :class:`~crosstrack.models.Flight`.
    start, goal : array-like, shape (axes,)
        Positions in metres.
    vehicle : PointMass, Quadrotor or DifferentialDrive
        Vehicle with its limits.
    **options
        Further fields of :class:`~crosstrack.models.Flight` (`radius`, `waypoints`,
        `start_velocity` …), and options of :func:`crosstrack.solve` (`backend`, `time_limit` …).

    Returns
    -------
    Solution
        The solution. Its plan is a verified :class:`~crosstrack.models.FlightPlan`, or None.

    Raises
    ------
    InvalidData
        A field of the flight is invalid.
    UnsupportedOption, UnknownName
        An option or a backend does not exist.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import PointMass
    >>> wall = [[4, -3], [6, -3], [6, 3], [4, 3]]
    >>> flight = ct.plan_flight([wall], (0, 0), (10, 0), PointMass(2.0, 1.0), radius=0.3)
    >>> flight.verification.ok
    True
    """
    fields = {name: options.pop(name) for name in list(options) if name in _FIELDS}
    return solve(Flight(map, start, goal, vehicle, **fields), **options)
