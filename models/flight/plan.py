"""Plan of a flight: the curve over time, with the path that it follows."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Nested, Plan
from ..fields import Array, Optional, declared
from ..inputs import FloatArray, FloatsOrNone
from ..minimum_snap.trajectory import Trajectory

__all__ = ["FlightPlan"]


@dataclass(frozen=True, eq=False)
class FlightPlan(Plan):
    """Curve of a flight over time.

    Parameters
    ----------
    trajectory : Trajectory
        Position over time, in metres and seconds, with one dimension per axis of the map.
    visits : ndarray, shape (k,)
        Times at which the curve passes the waypoints of the model, in seconds.
    path : ndarray, shape (n, axes), optional
        Polyline from the start to the goal beside the curve, in metres. The
        verification ignores it.

    Raises
    ------
    InvalidData
        A field has another type or shape, or a number is not finite.
    """

    trajectory: Trajectory = declared(Nested(Trajectory))
    visits: FloatArray = declared(Array(("stops",)), default=())
    path: FloatsOrNone = declared(Optional(Array(("points", "axes"))), default=None)

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return self.trajectory.duration

    def __str__(self) -> str:
        return f"{self.trajectory.segments} segments, {self.duration:.6g} s"
