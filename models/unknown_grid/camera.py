"""Camera of the UAV, and transformations between pixels, view, map and world."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..declaration import Declared
from ..fields import Array, Real, Whole, declared
from ..inputs import Field, Numbers
from ..records import Member

__all__ = ["PIXELS", "Camera", "Pinhole", "Rendering", "crop", "overlaps"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Rows and columns of an image.
PIXELS = 256
#: Height of the lens divided by the longer side of the view. The field of view is 28°.
RISE = 2.0


class Rendering(StrEnum):
    """Appearance of scenes in images."""

    PLAIN = "plain"  #: Obstacles have a distinct colour, so a threshold on colour detects them.
    #: Obstacles have the colour of the ground. Detection needs texture, height and shadow.
    HARD = "hard"


@dataclass(frozen=True, eq=False)
class Camera(Declared):
    """Camera of the UAV, which looks straight down. Its image covers exactly the view.

    Parameters
    ----------
    rendering : {"plain", "hard"}, default "plain"
        Appearance of the scenes, see :class:`Rendering`.
    seed : int, default 0
        Seed of textures and noise, from 0 to 2**32 - 1.

    Raises
    ------
    InvalidData
        A field is outside its allowed range.
    """

    rendering: Field[str, Rendering] = declared(Member(Rendering), default=Rendering.PLAIN)
    seed: int = declared(Whole(0, 2**32 - 1), default=0)


@dataclass(frozen=True, eq=False)
class Pinhole(Declared):
    """Pinhole camera: transformations between world, camera, pixels, view and map.

    The camera looks straight down above the middle of the view. Its height makes the cells of the
    view fill the image. Pixels are not square if the view is not square. The five frames are:

    - world, m: x along the columns of the map, y against its rows, z up from the ground; the origin is
      the outer corner of the map's first cell,
    - camera, m: z down from the lens; x against the columns of the image, y against its rows,
    - pixels: row and column, real; the centre of pixel (i, j) is (i + 1/2, j + 1/2),
    - view: row and column in cells of the view, real; the centre of cell (i, j) is (i + 1/2, j + 1/2),
    - map: row and column in cells of the map, with the same convention.

    World, camera and map are related by the paper's equations 5 to 9; the step from camera to pixels is that of a
    pinhole (R. Hartley, A. Zisserman, "Multiple View Geometry in Computer Vision", 2004, chapter 6).

    Parameters
    ----------
    view : ndarray of int, shape (2,)
        Rows and columns of the view.
    corner : ndarray of int, shape (2,)
        Row and column of the view's first cell in the map, possibly outside the map.
    side : float, default 1
        Side of a cell, m.

    Notes
    -----
    If the view has odd rows and columns, the centre of a pixel is never on the border of two cells:
    its distance from the first border is an odd multiple of m/512 cells. Rounding therefore never
    moves a pixel to another cell.
    """

    view: Field[Numbers, Ints] = declared(Array((2,), int, lower=1))
    corner: Field[Numbers, Ints] = declared(Array((2,), int), default=(0, 0))
    side: float = declared(Real(0.0, strict=True, unit="m"), default=1.0)

    @property
    def height(self) -> float:
        """Height of the lens above the ground, m."""
        return RISE * float(self.view.max()) * self.side

    @property
    def focal(self) -> Floats:
        """Focal length in pixels along rows and along columns, shape (2,)."""
        return np.asarray(PIXELS * self.height / (self.view * self.side), float)

    @property
    def lens(self) -> Floats:
        """Position of the lens in the world, shape (3,), m."""
        row, column = self.corner + self.view / 2.0
        return np.array([column * self.side, -row * self.side, self.height])

    @property
    def camera_from_world(self) -> Floats:
        """Pose of equation 6, shape (4, 4): rotation by pi about y, and the world's origin in the camera frame.

        The paper's text calls the last column the camera's origin in the world. The lens would then have the
        camera coordinates (0, 2y, 0) instead of 0. The paper's symbols denote the inverse, which is used here.
        """
        pose = np.diag([-1.0, 1.0, -1.0, 1.0])
        pose[:3, 3] = -pose[:3, :3] @ self.lens
        return pose

    @property
    def map_from_camera(self) -> Floats:
        """Pose of equation 8, shape (4, 4), m: rows, columns and height from camera coordinates."""
        pose = np.zeros((4, 4))
        pose[[0, 1, 2, 3], [1, 0, 2, 3]] = -1.0, -1.0, -1.0, 1.0
        pose[:3, 3] = self.lens[[1, 0, 2]] * (-1.0, 1.0, 1.0)
        return pose

    @property
    def map_from_world(self) -> Floats:
        """Product of the two poses in equation 9, shape (4, 4), m."""
        return self.map_from_camera @ self.camera_from_world

    def world_to_camera(self, points: ArrayLike) -> Floats:
        """Return points of the world, shape (…, 3), in the camera frame, m (equation 5)."""
        return (np.asarray(points, float) - self.lens) * (-1.0, 1.0, -1.0)

    def camera_to_world(self, points: ArrayLike) -> Floats:
        """Return points of the camera frame, shape (…, 3), in the world, m."""
        return np.asarray(points, float) * (-1.0, 1.0, -1.0) + self.lens

    def camera_to_pixels(self, points: ArrayLike) -> Floats:
        """Return the pixels, shape (…, 2), of points in the camera frame, shape (…, 3)."""
        points = np.asarray(points, float)
        return np.asarray(PIXELS / 2.0 - self.focal * points[..., 1::-1] / points[..., 2:])

    def pixels_to_camera(self, pixels: ArrayLike, depth: float) -> Floats:
        """Return the points `depth` m below the lens, shape (…, 3), of pixels, shape (…, 2)."""
        away = (PIXELS / 2.0 - np.asarray(pixels, float)) * depth / self.focal
        return np.concatenate([away[..., ::-1], np.full_like(away[..., :1], depth)], axis=-1)

    def world_to_map(self, points: ArrayLike) -> Floats:
        """Return rows and columns of the map, shape (…, 2), of points of the world, shape (…, 3) (equation 9)."""
        return np.asarray(points, float)[..., 1::-1] * (-1.0, 1.0) / self.side

    def map_to_world(self, points: ArrayLike, elevation: float = 0.0) -> Floats:
        """Return the points `elevation` m above the ground, shape (…, 3), of rows and columns of the map."""
        flat = np.asarray(points, float)[..., ::-1] * (self.side, -self.side)
        return np.concatenate([flat, np.full_like(flat[..., :1], elevation)], axis=-1)

    def map_to_view(self, points: ArrayLike) -> Any:
        """Return rows and columns of the view, shape (…, 2), from those of the map, with the same dtype."""
        return np.asarray(points) - self.corner

    def view_to_map(self, points: ArrayLike) -> Any:
        """Return rows and columns of the map, shape (…, 2), from those of the view, with the same dtype."""
        return np.asarray(points) + self.corner

    def pixels_to_view(self, pixels: ArrayLike, elevation: float = 0.0) -> Floats:
        """Return the points of the view, shape (…, 2), that pixels show `elevation` m above the ground."""
        points = self.camera_to_world(self.pixels_to_camera(pixels, self.height - elevation))
        return np.asarray(self.map_to_view(self.world_to_map(points)))

    def view_to_pixels(self, points: ArrayLike, elevation: float = 0.0) -> Floats:
        """Return the pixels, shape (…, 2), of points of the view `elevation` m above the ground."""
        world = self.map_to_world(self.view_to_map(points), elevation)
        return self.camera_to_pixels(self.world_to_camera(world))


def crop(blocked: NDArray[np.bool_], corner: Ints, size: Ints) -> NDArray[np.bool_]:
    """Return the cells of a map from `corner` on, shape `size`; cells outside the map are blocked."""
    cells = np.ones(size, bool)
    low, high = np.maximum(corner, 0), np.minimum(corner + size, blocked.shape)
    if (low < high).all():
        first, last = low - corner, high - corner
        part = blocked[low[0] : high[0], low[1] : high[1]]
        cells[first[0] : last[0], first[1] : last[1]] = part
    return cells


def overlaps(parts: int, pixels: int = PIXELS) -> Floats:
    """Return the share of each cell along an axis that every pixel covers, shape (parts, pixels).

    Rows sum to 1, so ``overlaps(m) @ image @ overlaps(n).T`` is the mean of an image over each cell of a
    view, even if a pixel spans two cells or is larger than a cell.
    """
    borders = np.arange(parts + 1)[:, None] * (pixels / parts)
    edges = np.arange(pixels + 1)
    low = np.maximum(borders[:-1], edges[:-1])
    high = np.minimum(borders[1:], edges[1:])
    return np.asarray(np.maximum(high - low, 0.0) * (parts / pixels))
