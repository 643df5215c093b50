"""Regions of knots, linear bounds and limits of vehicles as the arrays of :mod:`.minco_kernels`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.hermite import hermite_basis
from ...models.minimum_snap.formulations.piecewise import power_rows
from .chain import unit_cost
from .minco_limits import AFFINE, BALL, HULL, Task

__all__ = ["Region", "Rows", "basis", "limits_of", "posed"]


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Region(NamedTuple):
    """Set of positions of a knot: ``centre + y @ reach``.

    Parameters
    ----------
    kind : str
        ``"affine"``: any y. ``"ball"``: any y with a norm of at most 1. ``"hull"``: any y >= 0 with
        the sum 1, so that ``centre`` is usually zero and the rows of `reach` are vertices.
    centre : ndarray, shape (D,)
        Point, m.
    reach : ndarray, shape (n, D)
        One row per unknown, m. Without rows the position is fixed.
    """

    kind: str
    centre: Floats
    reach: Floats

    @classmethod
    def fixed(cls, point: Floats) -> Region:
        """Return the region that has one point."""
        return cls("affine", np.asarray(point, float), np.empty((0, len(point))))

    def unknowns(self, point: Floats) -> Floats:
        """Return unknowns of a position in the region near `point`."""
        count = len(self.reach)
        if self.kind == "hull":
            # Weights by inverse distances: positive, so that no unknown starts at its saddle 0.
            apart = np.linalg.norm(self.reach + self.centre - point, axis=1)
            weights = 1.0 / (apart + 0.1 * apart.max() + 1e-300) ** 2
            return np.asarray(np.sqrt(weights / weights.sum()), np.float64)
        if not count:
            return np.empty(0)
        y = np.linalg.lstsq(self.reach.T, point - self.centre, rcond=None)[0]
        if self.kind == "affine":
            return np.asarray(y, np.float64)
        size = float(np.linalg.norm(y))
        y *= min(1.0, 0.95 / size) if size else 1.0
        # y = 2 x / (1 + |x|²), solved for the smaller x.
        y /= 1.0 + np.sqrt(max(0.0, 1.0 - float(y @ y)))
        return np.asarray(y, np.float64)


class Rows(NamedTuple):
    """Linear bounds ``normal @ x^(order) <= offset`` at every instant of a segment.

    Parameters
    ----------
    segment, order : ndarray of int, shape (R,)
        Segment and order of the derivative, at most 3.
    normal : ndarray, shape (R, D)
        Directions.
    offset, size : ndarray, shape (R,)
        Bounds, and the unit of an excess, in m/s^order. With the size of a limit, an excess is
        relative to the limit; for a position, the size is a length of the path.
    """

    segment: Ints
    order: Ints
    normal: Floats
    offset: Floats
    size: Floats

    @classmethod
    def of_polytopes(cls, polytopes: Sequence[tuple[Floats, Floats]], size: float) -> Rows:
        """Return the rows of one polytope ``normals @ x <= offsets`` per segment, of unit normals."""
        counts = [len(offsets) for _, offsets in polytopes]
        segment = np.repeat(np.arange(len(counts)), counts)
        return cls(
            segment,
            np.zeros(len(segment), np.int64),
            np.concatenate([np.asarray(normals, float) for normals, _ in polytopes]),
            np.concatenate([np.asarray(offsets, float) for _, offsets in polytopes]),
            np.full(len(segment), size),
        )


def limits_of(vehicle: Any) -> Floats:
    """Return the limits of a vehicle in the order of :class:`~.minco_kernels.Task`.

    The attributes `mass`, `gravity`, `drag`, `thrust`, `tilt`, `body_rate`, `speed` and
    `acceleration` (for wheels: `wheel_speed` and `wheel_acceleration`, without turns) are read if the
    vehicle has them. None is unlimited.
    """

    def square(name: str) -> float:
        value = getattr(vehicle, name, None)
        return np.inf if value is None else float(value) ** 2

    # The wheels of a robot that turns are slower: its motion is stretched later.
    speed = min(square("speed"), square("wheel_speed"))
    acceleration = min(square("acceleration"), square("wheel_acceleration"))
    limits = np.array([9.81, 0.0, speed, acceleration, np.inf, 0, -1, np.inf, 0])
    if getattr(vehicle, "thrust", None) is not None:
        mass, tilt = float(vehicle.mass), vehicle.tilt
        low, high = (float(side) / mass for side in vehicle.thrust)
        limits[[0, 1, 4, 5]] = vehicle.gravity, vehicle.drag / mass, high**2, low**2
        limits[6] = -1.0 if tilt is None else np.cos(tilt)
        limits[7:] = square("body_rate"), 1.0
    return limits


@cache
def basis(order: int, count: int) -> Floats:
    """Return derivatives 0 … 3 in s of the Hermite functions at equal steps, shape (4, count, 2r)."""
    s = np.linspace(0.0, 1.0, count)
    degree = 2 * order - 1
    hermite = hermite_basis(order, degree)
    return np.stack([power_rows(s, j, degree) @ hermite for j in range(4)])


def _places(nodes: int, periodic: bool) -> tuple[Ints, int]:
    """Return the place of each node in the band, and the half-width in blocks.

    The nodes of a lap are ordered 0, 1, N-1, 2, N-2, …, so that neighbours are two places apart.
    """
    if not periodic or nodes < 3:
        return np.arange(nodes), 1
    place = np.arange(nodes)
    order = np.array([k // 2 + 1 if k % 2 == 0 else nodes - 1 - k // 2 for k in range(nodes - 1)])
    place[order] = np.arange(1, nodes)
    return place, 2


def posed(
    regions: Sequence[Region], jets: Floats, rows: Rows, limits: Floats, weights: Floats,
    periodic: bool,
    instants: int,
) -> Task:  # fmt: skip
    """Return the arrays of a problem. Infinite entries of `jets` are free."""
    order, segments = jets.shape[1], len(jets) - 1
    nodes = np.stack([np.arange(segments), np.arange(1, segments + 1)], axis=1)
    if periodic:
        nodes[-1, 1] = 0
        regions, jets = regions[:-1], jets[:-1]
    place, width = _places(len(jets), periodic)
    orders = np.flatnonzero(weights) + 1
    forms = [unit_cost(order, 2 * order - 1, int(j)) for j in orders]
    sort = np.argsort(rows.segment, kind="stable")
    free = ~np.isfinite(jets)
    kinds = {"affine": AFFINE, "ball": BALL, "hull": HULL}
    return Task(
        basis(order, instants),
        np.stack([w * (f.T @ f) for w, f in zip(weights[orders - 1], forms, strict=True)]),
        orders.astype(np.int64),
        nodes, place, width,
        np.where(free, 0.0, jets), free,
        np.array([kinds[region.kind] for region in regions]),
        np.cumsum([0, *(len(region.reach) for region in regions)]),
        np.stack([region.centre for region in regions]),
        np.concatenate([region.reach for region in regions]),
        np.searchsorted(rows.segment[sort], np.arange(segments + 1)),
        rows.order[sort], rows.normal[sort], rows.offset[sort], rows.size[sort],
        limits,
    )  # fmt: skip
