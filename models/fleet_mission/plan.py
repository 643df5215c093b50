"""Plan of a mission: routes, trajectories and visit times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared, Nested, Plan
from ..fields import Array, NumberTuple, Optional, declared, show
from ..minimum_snap.trajectory import Trajectory
from ..records import Several

__all__ = ["MissionPlan"]

Floats = NDArray[np.float64]


class _Course(Nested):
    """Trajectory in x and y; errors name the robot."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Declared:
        if not isinstance(value, Trajectory | Mapping):
            raise InvalidData(
                f"{name} must be a trajectory or null, got {show(value)}", field="trajectories"
            )
        try:
            course = super().coerce(name, value, sizes)
        except InvalidData as error:
            raise InvalidData(f"{name}: {error}", field="trajectories") from None
        assert isinstance(course, Trajectory)
        if course.dimensions != 2:
            raise InvalidData(
                f"{name} must be x, y, got {course.dimensions} dimensions", field="trajectories"
            )
        return course


@dataclass(frozen=True, eq=False)
class MissionPlan(Plan):
    """Routes, trajectories and visit times of all robots.

    Parameters
    ----------
    routes : tuple of tuple of int
        Nodes of each robot in the order of its visits; empty for an idle robot.
    trajectories : tuple of Trajectory or None
        x and y of each robot over time, in metres, from the depot and back; the first knot is the departure.
        None for an idle robot.
    visits : tuple of ndarray
        Times at which each robot passes the nodes of its route, in seconds.

    Raises
    ------
    InvalidData
        The fields have different lengths, or an entry has another type or shape.
    """

    routes: tuple[tuple[int, ...], ...] = declared(Several(NumberTuple(("stops",), int), "robots"))
    trajectories: tuple[Trajectory | None, ...] = declared(
        Several(Optional(_Course(Trajectory)), "robots")
    )
    visits: tuple[Floats, ...] = declared(Several(Array(("stops",)), "robots"))

    def check(self) -> None:
        """Reject visit times that do not fit a route."""
        for k, (route, times) in enumerate(zip(self.routes, self.visits, strict=True)):
            if len(route) != len(times):
                raise InvalidData(
                    f"visits[{k}] has {len(times)} entries where routes[{k}] has {len(route)}",
                    field="visits",
                )

    @property
    def parking(self) -> tuple[tuple[float, float] | None, ...]:
        """Waiting place of each robot before its departure and after its return, m: the depot's queue.

        None for a robot without a trajectory.
        """
        return tuple(
            None
            if entry is None
            else (float(entry(entry.times[0])[0]), float(entry(entry.times[0])[1]))
            for entry in self.trajectories
        )

    @property
    def end(self) -> float:
        """Return time of the last robot, s."""
        return max(
            (float(entry.times[-1]) for entry in self.trajectories if entry is not None), default=0
        )

    def __str__(self) -> str:
        routes = " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
        return f"{routes}, {self.end:.10g} s"
