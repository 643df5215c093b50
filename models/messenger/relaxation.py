"""Euclidean relaxation of a tour for a given order: a second-order cone program.

Without the limit on curvature, a tour that meets the vehicles in a given order is a sequence of
legs, each at least as long as the distance between its ends. With the length flown s = v t in place
of the
time, and W = V / v, the program is::

    minimise    s_L
    subject to  |Q_k - Q_{k-1}| <= s_k - s_{k-1}         each leg
                Q_k = P_k + W_k s_k + r_k e_k, |e_k| <= 1   each encounter

Its optimum is a lower bound for every tour in this order, also with more vehicles in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ..programs.builder import ProgramBuilder
from ..programs.cones import ConeKind

if TYPE_CHECKING:
    from ..programs.conic import ConicProgram
    from .model import MessengerTour

__all__ = ["Field", "euclidean_relaxation"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Field:
    """Scaled data of a model relative to the air: its vehicles, followed by its start and home.

    `centres` (n + 1, 2), `velocities` (n + 1, 2) and `radii` (n + 1,) are P relative to `origin`, V / v,
    and r, in units of `unit` (m); 0 for the start. `origin` (m) is the start of the path or, without
    one, the mean of the vehicles' positions. `closed` states whether the path leads back, and `free`
    whether its start is free.
    """

    centres: Floats
    velocities: Floats
    radii: Floats
    unit: float
    origin: Floats
    closed: bool
    free: bool

    @classmethod
    def of(cls, model: MessengerTour) -> Field:
        """Return the scaled data of `model`."""
        free = model.start is None
        origin = model.positions.mean(axis=0) if model.start is None else model.start[:2]
        apart = model.positions - origin
        unit = float(np.hypot(*apart.T).max()) or float(model.radius.max()) or 1.0
        return cls(
            np.vstack([apart, np.zeros((1, 2))]) / unit,
            np.vstack([model.drifts, model.home_drift]) / model.speed,
            np.append(model.radius, 0.0) / unit,
            unit,
            origin,
            model.closed,
            free,
        )

    @property
    def size(self) -> int:
        """Number of vehicles."""
        return len(self.radii) - 1

    def chain(self, order: Sequence[int]) -> Indices:
        """Return the stops of a path, including its first and last one; the start has the last index.

        With a free start, the path begins and ends at the first vehicle of the order.
        """
        if self.free:
            return np.array([*order, *order[:1]], np.int64)
        return np.array([self.size, *order, *([self.size] if self.closed else [])], np.int64)


def euclidean_relaxation(model: MessengerTour, order: Sequence[int]) -> ConicProgram:
    """Return the program of the shortest path without curvature limit that meets `order`.

    Parameters
    ----------
    model : MessengerTour
        The model.
    order : sequence of int
        Order of the vehicles, each at most once. The path may miss the other vehicles.

    Returns
    -------
    ConicProgram
        Program with the columns ``offset`` (e_k, two per stop) and ``flown`` (s_k, in the scaled
        unit of length). Its objective is the length of the path, in m.

    Raises
    ------
    InvalidData
        `order` is empty, contains an unknown vehicle, or repeats one.
    UnsupportedFormulation
        The model has several UAVs.
    """
    met = [int(index) for index in order]
    if not met or len(set(met)) < len(met) or not all(0 <= index < model.size for index in met):
        raise InvalidData(
            f"order must name vehicles 0 … {model.size - 1}, at least one and each once, "
            f"got {list(order)}",
            field="order",
        )
    if model.uavs is not None:
        raise UnsupportedFormulation("the relaxation of an order does not cover the field uavs")
    field = Field.of(model)
    stops = field.chain(met)
    legs, count = len(stops) - 1, len(met)
    # Position in the order of the vehicle at each end of a leg; -1 for the start, which is fixed.
    place = {vehicle: k for k, vehicle in enumerate(met)}
    rank = np.array([place.get(int(stop), -1) for stop in stops])
    builder = ProgramBuilder()
    offset = builder.columns("offset", 2 * count, lower=-np.inf).reshape(-1, 2)
    flown = builder.columns("flown", legs, lower=0.0, cost=np.eye(legs)[-1] * field.unit)
    leg = np.arange(legs)
    terms: list[tuple[ArrayLike, ArrayLike, ArrayLike]] = [
        (3 * leg, flown, 1.0),
        (3 * leg[1:], flown[:-1], -1.0),
    ]
    for axis in range(2):
        row = 3 * leg + 1 + axis
        for end, sign in ((1, 1.0), (0, -1.0)):
            stop, vehicle = stops[end:][:legs], rank[end:][:legs]
            driven = leg + end - 1
            moves = driven >= 0
            terms.append(
                (row[moves], flown[driven[moves]], sign * field.velocities[stop[moves], axis])
            )
            real = vehicle >= 0
            terms.append((row[real], offset[vehicle[real], axis], sign * field.radii[stop[real]]))
    steps = np.column_stack([np.zeros(legs), np.diff(field.centres[stops], axis=0)])
    builder.cones(
        "legs", ConeKind.SECOND_ORDER, legs, 3, *terms, offset=steps,
        template="leg {0}", index=leg,
    )  # fmt: skip
    index = np.arange(count)
    builder.cones(
        "within radius", ConeKind.SECOND_ORDER, count, 3,
        *((3 * index + 1 + axis, offset[:, axis], 1.0) for axis in range(2)),
        offset=np.tile([1.0, 0.0, 0.0], (count, 1)), template="vehicle {0}", index=np.array(met),
    )  # fmt: skip
    return builder.build_conic(name=f"{model.name} in order" if model.name else "")
