"""Gates: discs, balls and planar polygons that a trajectory passes at a knot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Optional, Real, Whole, declared, frozen
from ..inputs import FloatsOrNone

__all__ = ["Gate"]

Floats = NDArray[np.float64]

#: Distance of a vertex from the plane or from the convex side of an edge that is rounding, relative
#: to the size of the polygon.
_ROUNDING = 1e-9


class Frame(NamedTuple):
    """Flat set around a gate: centre, axes in it, shape (m, D), and normals of it, shape (D - m, D)."""

    centre: Floats
    axes: Floats
    normals: Floats


def _frame(centre: Floats, vectors: Floats, count: int | None, *, along: bool) -> Frame:
    """Return the frame spanned by (`along`) or normal to `vectors`; `count` is the rank if known."""
    _, sizes, rows = np.linalg.svd(vectors)
    rank = int((sizes > _ROUNDING * sizes.max(initial=0.0)).sum()) if count is None else count
    first, rest = rows[:rank], rows[rank:]
    axes, normals = (first, rest) if along else (rest, first)
    return Frame(frozen(centre.copy()), frozen(axes.copy()), frozen(normals.copy()))


@dataclass(frozen=True, eq=False)
class Gate(Declared):
    """Disc, ball or planar convex polygon that contains the position at a knot.

    Parameters
    ----------
    knot : int
        Index of the knot. Its waypoint must be free.
    centre : ndarray, shape (dimensions,), optional
        Centre of the disc or ball in metres.
    radius : float, optional
        Radius of the disc or ball in metres, positive.
    normal : ndarray, shape (dimensions,), optional
        Normal of the disc, of any positive length. Without it, the gate is a ball.
    polygon : ndarray, shape (vertices, dimensions), optional
        Vertices of a convex polygon in metres, in order along its edge, instead of centre and radius.
        In 3-D they are in one plane. Two vertices are a straight gate.

    Raises
    ------
    InvalidData
        Neither or both of radius and polygon are given, the normal is 0, or the polygon is not planar
        or not convex.

    Examples
    --------
    >>> from crosstrack.models import Gate
    >>> Gate(1, centre=[2, 0, 1], radius=0.5, normal=[1, 0, 0]).excess([2.0, 0.3, 1.6]).round(3)
    array([0.   , 0.171])
    """

    knot: int = declared(Whole(0))
    centre: FloatsOrNone = declared(Optional(Array(("dimensions",), unit="m")), default=None)
    radius: float | None = declared(Optional(Real(0.0, strict=True, unit="m")), default=None)
    normal: FloatsOrNone = declared(Optional(Array(("dimensions",))), default=None)
    polygon: FloatsOrNone = declared(
        Optional(Array(("vertices", "dimensions"), unit="m")), default=None
    )

    def check(self) -> None:
        """Reject gates without a shape or with two, and polygons that are not planar or convex."""
        if (self.radius is None) == (self.polygon is None):
            raise InvalidData("a gate must have either radius or polygon", field="radius")
        if self.polygon is None:
            if self.centre is None:
                raise InvalidData("centre is missing: a disc or a ball needs it", field="centre")
            if self.normal is not None and not np.linalg.norm(self.normal) > 0.0:
                raise InvalidData("normal must not be zero", field="normal")
            return
        if self.centre is not None or self.normal is not None:
            raise InvalidData(
                "centre and normal follow from the polygon: leave them out", field="centre"
            )
        count, rank = len(self.polygon), len(self.frame.axes)
        if count < 2 or rank == 0 or (rank == 1 and count > 2) or rank > 2:
            raise InvalidData(
                f"polygon must have 2 different vertices, or more in one plane and not on one line, got "
                f"{self.polygon.tolist()}",
                field="polygon",
            )
        normals, offsets = self.edges
        over = self._flat(self.polygon) @ normals.T - offsets
        if over.max() > _ROUNDING * np.abs(self._flat(self.polygon)).max():
            vertex = int(over.max(axis=1).argmax())
            raise InvalidData(
                f"polygon must be convex with its vertices in order: vertex {vertex} "
                f"{self.polygon[vertex].tolist()} is outside an edge",
                field="polygon",
            )

    @cached_property
    def frame(self) -> Frame:
        """Flat set that contains the gate: a plane, a line, or the space."""
        if self.polygon is not None:
            centre = self.polygon.mean(axis=0)
            return _frame(centre, self.polygon - centre, None, along=True)
        assert self.centre is not None
        if self.normal is None:
            return _frame(self.centre, np.eye(self.centre.size), self.centre.size, along=True)
        return _frame(self.centre, self.normal[None], 1, along=False)

    def _flat(self, points: Floats) -> Floats:
        """Return coordinates in the axes of the frame."""
        flat: Floats = (points - self.frame.centre) @ self.frame.axes.T
        return flat

    @cached_property
    def edges(self) -> tuple[Floats, Floats]:
        """Half-spaces ``normals @ y <= offsets`` of a polygon in the axes of the frame, unit normals."""
        assert self.polygon is not None
        flat = self._flat(self.polygon)
        if flat.shape[1] == 1:
            return frozen(np.array([[1.0], [-1.0]])), frozen(np.array([flat.max(), -flat.min()]))
        along = np.roll(flat, -1, axis=0) - flat
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(length > 0.0, length, 1.0)
        # The centre is inside for both directions of the vertices.
        offsets = np.einsum("ij,ij->i", normals, flat)
        turn = np.where(offsets.sum() < 0.0, -1.0, 1.0)
        return frozen(turn * normals), frozen(turn * offsets)

    def in_unit(self, length: float) -> Gate:
        """Return the gate with lengths in units of `length` m."""
        shape = {name: getattr(self, name) for name in ("centre", "radius", "polygon")}
        return replace(self, **{k: v / length for k, v in shape.items() if v is not None})

    def outlines(self) -> list[Floats]:
        """Return closed lines for pictures, shape (points, dimensions): the edge, or circles of a ball."""
        if self.polygon is not None:
            return [np.concatenate([self.polygon, self.polygon[:1]])]
        assert self.radius is not None
        axes = self.radius * self.frame.axes
        if len(axes) == 1:
            return [self.frame.centre + np.array([[-1.0], [1.0]]) @ axes]
        angle = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        pairs = [(i, j) for j in range(len(axes)) for i in range(j)]
        return [self.frame.centre + circle @ axes[list(pair)] for pair in pairs]

    def excess(self, point: Floats) -> Floats:
        """Return the distance of a point from the plane of the gate, and outside of it in the plane.

        Parameters
        ----------
        point : ndarray, shape (dimensions,)
            Position, m.

        Returns
        -------
        ndarray, shape (2,)
            Distances in metres. The second one is negative inside.
        """
        away = np.asarray(point, float) - self.frame.centre
        off = float(np.linalg.norm(self.frame.normals @ away))
        flat = self.frame.axes @ away
        if self.radius is not None:
            return np.array([off, float(np.linalg.norm(flat)) - self.radius])
        assert self.polygon is not None
        normals, offsets = self.edges
        outside = float((normals @ flat - offsets).max())
        if outside > 0.0:
            begin = self._flat(self.polygon)
            along = np.roll(begin, -1, axis=0) - begin
            size = np.maximum((along**2).sum(axis=1), 1e-300)
            share = np.clip(((flat - begin) * along).sum(axis=1) / size, 0.0, 1.0)
            outside = float(np.linalg.norm(begin + share[:, None] * along - flat, axis=1).min())
        return np.array([off, outside])
