"""Synthetic images of scenes from above: boxes on textured ground through a pinhole camera.

The paper's images come from a simulation platform and are unpublished, so the scenes here are synthetic. Colours,
textures and light depend only on the seed and the position in the world, so a cell has the same appearance in every
view. Only the noise of the sensor differs between images.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .camera import PIXELS, Pinhole, Rendering, crop

__all__ = ["render"]

Floats = NDArray[np.float64]
#: Type of pixels in single precision, whose rounding is smaller than the noise of the sensor.
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Period of textures and colours in cells, and texels along the side of a cell.
_PERIOD, _TEXELS = 32, 16
#: Number of planes between ground and top that sample walls and shadows.
_PLANES = 6
#: Colours of the plain law: ground and obstacle.
_GROUND, _OBSTACLE = (0.55, 0.65, 0.45), (0.45, 0.25, 0.2)


class _Look(NamedTuple):
    """Random appearance of a scene; lengths in cells, and two values per row and column.

    `height` is that of the boxes, and `sun` the vector from the end of a shadow to the top that casts
    it. `shade` and `wall` are the brightness in the shadow and of walls. `ground` and `top` are the mean
    colours, equal in the hard law; `spread` and `grain` are the standard deviations of the colours of
    cells and of the textures. `stripes` and `wave` are the cycles per cell in the texture of tops and in
    the brightness of the light, with `phases` in rad. `offset` is that of the map in the periodic
    fields. `unevenness` is the amplitude of the light, and `noise` the deviation of the sensor's noise.
    """

    height: float
    sun: Floats
    shade: float
    wall: float
    ground: Floats
    top: Floats
    spread: float
    grain: float
    stripes: Floats
    wave: Floats
    phases: Floats
    offset: Ints
    unevenness: float
    noise: float


def render(
    blocked: Truths,
    target: Ints,
    corner: Ints,
    view: Ints,
    rendering: Rendering,
    seed: tuple[int, int, int],
) -> Singles:
    """Return the image of a view: red, green and blue from 0 to 1, shape (256, 256, 3).

    Cells outside the map `blocked` look like obstacles, and the cell `target` is invisible. `corner` is
    the view's first cell, and `view` are its numbers of rows and columns. `seed` has the seed of the
    camera, the index of the scene and the number of the image: the first two determine the world, all
    three the noise.
    """
    look = _draw_look(rendering, np.random.default_rng(seed[:2]))
    pinhole = Pinhole(view, corner)
    boxes = crop(blocked, corner - 1, view + 2)  # with a border of one cell
    ground, top = _axes(pinhole, 0.0), _axes(pinhole, look.height)
    on_top = _hit(boxes, top)
    on_wall = np.zeros_like(on_top)
    dark = np.zeros_like(on_top)
    for part in np.arange(_PLANES) / _PLANES:
        on_wall |= _hit(boxes, _axes(pinhole, part * look.height))
        dark |= _hit(boxes, ground + (1.0 - part) * look.sun[:, None])

    stripes = _wave(corner, top, look.stripes, look.phases[0]) * np.float32(np.sqrt(2.0))
    image = _paint(look.ground, look, corner, ground, _field(_grains(), look, corner, ground))
    np.copyto(image, _paint(look.top, look, corner, top, stripes), where=on_top[..., None])
    light = 1.0 + look.unevenness * _wave(corner, ground, look.wave, look.phases[1])
    light *= np.where(
        on_top, 1.0, np.where(on_wall, look.wall, np.where(dark, look.shade, 1.0))
    ).astype(np.float32)
    image *= light[..., None]
    image += look.noise * np.random.default_rng(seed).standard_normal(image.shape, np.float32)
    return np.clip(image, 0.0, 1.0, out=image)


def _draw_look(rendering: Rendering, rng: np.random.Generator) -> _Look:
    """Draw the appearance of a scene. Both laws consume the same random numbers."""
    hard = rendering == Rendering.HARD
    height, length, azimuth = rng.uniform([0.3, 0.35, 0.0], [0.6, 0.75, 2.0 * np.pi])
    shade, wall = rng.uniform([0.4, 0.5], [0.6, 0.75])
    colour = 0.5 + 0.13 * rng.uniform(-1.0, 1.0, 3)
    spread, grain, unevenness, noise = rng.uniform([0.07, 0.06, 0.1, 0.02], [0.11, 0.1, 0.2, 0.04])
    turn, slow = rng.uniform(0.0, np.pi, 2)
    cycles, period = rng.uniform([2.0, 15.0], [4.0, 40.0])
    return _Look(
        height,
        length * np.array([np.sin(azimuth), np.cos(azimuth)]) if hard else np.zeros(2),
        shade,
        wall,
        colour if hard else np.array(_GROUND),
        colour if hard else np.array(_OBSTACLE),
        spread if hard else 0.0,
        grain if hard else 0.02,
        cycles * np.array([np.sin(turn), np.cos(turn)]),
        np.array([np.sin(slow), np.cos(slow)]) / period,
        rng.uniform(0.0, 2.0 * np.pi, 2),
        rng.integers(0, _PERIOD, 2),
        unevenness if hard else 0.0,
        noise if hard else 0.01,
    )


def _axes(pinhole: Pinhole, elevation: float) -> Floats:
    """Return the rows and columns of the view at the centres of pixels, shape (2, 256)."""
    middles = np.arange(PIXELS) + 0.5
    return pinhole.pixels_to_view(np.column_stack([middles, middles]), elevation).T


def _hit(boxes: Truths, axes: Floats) -> Truths:
    """Return whether each pixel hits a box, shape (256, 256). Shadows are shorter than a cell."""
    return _gather(boxes, np.floor(axes).astype(np.int64) + 1)


def _paint(mean: Floats, look: _Look, corner: Ints, axes: Floats, texture: Singles) -> Singles:
    """Return the colours of a surface, shape (256, 256, 3)."""
    texture *= look.grain
    colours = (mean + look.spread * _patches()).astype(np.float32)
    return np.asarray(_field(colours, look, corner, axes) + texture[..., None])


def _wave(corner: Ints, axes: Floats, cycles: Floats, phase: float) -> Singles:
    """Return a plane wave over the world, shape (256, 256), values from -1 to 1."""
    down, across = 2.0 * np.pi * cycles[:, None] * (axes + corner[:, None])
    down += phase
    return np.asarray(
        np.column_stack([np.cos(down), -np.sin(down)]) @ np.stack([np.cos(across), np.sin(across)]),
        np.float32,
    )


def _field(values: Singles, look: _Look, corner: Ints, axes: Floats) -> Singles:
    """Return the values of a periodic field at the pixels, shape (256, 256, …)."""
    places = (axes + (corner + look.offset)[:, None]) * (len(values) // _PERIOD)
    return _gather(values, np.floor(places).astype(np.int64) % len(values))


def _gather(values: NDArray[Any], places: Ints) -> NDArray[Any]:
    """Return values at all pairs of rows and columns, shape (256, 256, …)."""
    return np.asarray(np.take(values[places[0]], places[1], axis=1))


@cache
def _grains() -> Singles:
    """Return the isotropic texture of the ground with standard deviation 1."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(0).standard_normal((_PERIOD * _TEXELS, _PERIOD * _TEXELS))
    smooth = gaussian_filter(noise, 1.2, mode="wrap")
    return np.asarray(smooth / smooth.std(), np.float32)


@cache
def _patches() -> Floats:
    """Return the deviations of cell colours from the mean, mostly in brightness, partly in hue."""
    rng = np.random.default_rng(1)
    grey = rng.standard_normal((_PERIOD, _PERIOD, 1))
    return np.asarray(0.85 * grey + 0.5 * rng.standard_normal((_PERIOD, _PERIOD, 3)))
