"""Plan of a mission: routes, trajectories and visit times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, show
from ..minimum_snap.trajectory import Trajectory

__all__ = ["MissionPlan"]

Floats = NDArray[np.float64]
_KEYS = ("routes", "trajectories", "visits")


@dataclass(frozen=True, eq=False)
class MissionPlan:
    """Routes, trajectories and visit times of all robots.

    Parameters
    ----------
    routes : tuple of tuple of int
        Nodes of each robot in the order of its visits; empty for an idle robot.
    trajectories : tuple of Trajectory or None
        x, y (m) of each robot over time, from the depot and back; the first knot is the departure.
        None for an idle robot.
    visits : tuple of ndarray
        Times at which each robot passes the nodes of its route, s.

    Raises
    ------
    InvalidData
        The fields have different lengths, or an entry has another type or shape.
    """

    routes: tuple[tuple[int, ...], ...]
    trajectories: tuple[Trajectory | None, ...]
    visits: tuple[Floats, ...]

    def __post_init__(self) -> None:
        routes = tuple(
            tuple(Array((f"n{k}",), int).coerce(f"routes[{k}]", route, {}).tolist())
            for k, route in enumerate(_require_list("routes", self.routes))
        )
        trajectories = tuple(
            _trajectory(f"trajectories[{k}]", one)
            for k, one in enumerate(_require_list("trajectories", self.trajectories))
        )
        visits = tuple(
            Array((f"n{k}",)).coerce(f"visits[{k}]", one, {})
            for k, one in enumerate(_require_list("visits", self.visits))
        )
        for name, entries in (("trajectories", trajectories), ("visits", visits)):
            if len(entries) != len(routes):
                raise InvalidData(
                    f"{name} has {len(entries)} entries where routes has {len(routes)}", field=name
                )
        for k, (route, times) in enumerate(zip(routes, visits, strict=True)):
            if len(route) != len(times):
                raise InvalidData(
                    f"visits[{k}] has {len(times)} entries where routes[{k}] has {len(route)}",
                    field="visits",
                )
        object.__setattr__(self, "routes", routes)
        object.__setattr__(self, "trajectories", trajectories)
        object.__setattr__(self, "visits", visits)

    @property
    def parking(self) -> tuple[tuple[float, float] | None, ...]:
        """Waiting place of each robot before its departure and after its return, m: the depot's queue.

        None for a robot without a trajectory.
        """
        return tuple(
            None if one is None else (float(one(one.times[0])[0]), float(one(one.times[0])[1]))
            for one in self.trajectories
        )

    @property
    def end(self) -> float:
        """Return time of the last robot, s."""
        return max(
            (float(one.times[-1]) for one in self.trajectories if one is not None), default=0
        )

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {
            "routes": [list(route) for route in self.routes],
            "trajectories": [None if one is None else one.to_data() for one in self.trajectories],
            "visits": [times.tolist() for times in self.visits],
        }

    @classmethod
    def from_data(cls, data: Any) -> MissionPlan:
        """Return the plan stored in `data` by :meth:`to_data`; bad data raises ``InvalidData``."""
        if not isinstance(data, Mapping) or set(data) != set(_KEYS):
            raise InvalidData(
                f"a plan must be an object with the keys {', '.join(_KEYS)}, got {show(data)}",
                field="plan",
            )
        return cls(**data)

    def __str__(self) -> str:
        routes = " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
        return f"{routes}, {self.end:.10g} s"


def _require_list(name: str, value: Any) -> Sequence[Any]:
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
        raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
    return value


def _trajectory(name: str, value: Any) -> Trajectory | None:
    if value is None:
        return None
    trajectory = value if isinstance(value, Trajectory) else None
    if trajectory is None:
        if not isinstance(value, Mapping):
            raise InvalidData(
                f"{name} must be a trajectory or null, got {show(value)}", field="trajectories"
            )
        try:
            trajectory = Trajectory.from_data(value)
        except InvalidData as error:
            raise InvalidData(f"{name}: {error}", field="trajectories") from None
    if trajectory.dimensions != 2:
        raise InvalidData(
            f"{name} must be x, y, got {trajectory.dimensions} dimensions", field="trajectories"
        )
    return trajectory
