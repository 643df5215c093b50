"""Detection of obstacles: cells of a view from the camera's image."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendMissing, InvalidData, show
from ...models.fields import Array
from ...models.unknown_grid.camera import PIXELS, overlaps

__all__ = ["METHODS", "perceive"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Methods of detection.
METHODS = ("k-means", "gmgn")
#: Stride in rows and columns between the pixels that k-means uses.
_STRIDE = 4
#: Maximum number of iterations of k-means.
_ROUNDS = 10
#: Minimum share of the variance that two clusters must explain. Below it, all cells are of one kind. Two clusters
#: explain 2/π of a normal distribution's variance along its longest axis.
_APART = 0.8
#: Number of images per batch of the network.
_TOGETHER = 16


def perceive(
    images: ArrayLike, view: tuple[int, int], method: str = "k-means", weights: str | None = None
) -> Truths:
    """Return whether each cell of the views is an obstacle, shape (n, m, n'). The result is deterministic.

    ``"k-means"`` (not in the paper) clusters the pixels of an image by colour. The majority of its
    pixels decides on each cell. The cell in the middle is free, because the vehicle is or was there. All
    cells are free if one cluster suffices. ``"gmgn"`` is the paper's network, see :mod:`~.gmgn`;
    `weights` is its file, by default the shipped weights.

    The images, shape (n, 256, 256, 3), have red, green and blue from 0 to 1, and the sides of the view
    are odd; otherwise :class:`InvalidData` names the location. The method ``"gmgn"`` raises
    :class:`BackendMissing` without PyTorch.
    """
    if method not in METHODS:
        raise InvalidData(
            f"perception must be one of {', '.join(METHODS)}, got {show(method)}",
            field="perception",
        )
    rows, columns = Array((2,), int, lower=1).coerce("view", view, {}).tolist()
    if not (rows % 2 and columns % 2):
        raise InvalidData(f"view must be two odd numbers of cells, got {show(view)}", field="view")
    shape = ("n", PIXELS, PIXELS, 3)
    colours = Array(shape, lower=0.0, upper=1.0).coerce("images", images, {})
    if method == "k-means":
        cells = [_vote(_split(image, (rows, columns)), (rows, columns)) for image in colours]
        return np.array(cells, bool).reshape(len(colours), rows, columns)
    return _classify(colours, (rows, columns), weights)


def _split(image: Floats, view: tuple[int, int]) -> Truths:
    """Return whether each pixel differs in cluster from the middle cell, shape (256, 256), by k-means."""
    from scipy.cluster.vq import kmeans2

    colours = image[::_STRIDE, ::_STRIDE].reshape(-1, 3)
    mean = colours.mean(axis=0)
    spread, axes = np.linalg.eigh((colours - mean).T @ (colours - mean) / len(colours))
    if spread[-1] <= np.finfo(float).eps:
        return np.zeros(image.shape[:2], bool)
    # Means that start on both sides of the longest axis keep pixels, and need no random numbers.
    away = np.sqrt(spread[-1]) * axes[:, -1]
    means, labels = kmeans2(colours, np.array([mean - away, mean + away]), _ROUNDS, minit="matrix")
    share = labels.mean()
    explained = share * (1.0 - share) * ((means[1] - means[0]) ** 2).sum()
    if explained < _APART * spread.sum():
        return np.zeros(image.shape[:2], bool)
    nearer: Truths = image @ (means[1] - means[0]) > (means**2).sum(axis=1) @ (-0.5, 0.5)
    middle = tuple(side // 2 for side in view)
    return ~nearer if _vote(nearer, view)[middle] else nearer


def _vote(pixels: Truths, view: tuple[int, int]) -> Truths:
    """Return whether most pixels of each cell are true. Pixels on borders are weighted by their overlap."""
    down, across = (_shares(side) for side in view)
    majority: Truths = down @ pixels.astype(float) @ across.T > 0.5
    return majority


_shares = cache(overlaps)


@cache
def _network(weights: str | None, written: int) -> Any:
    """Return the network of a file. The time of its last change, `written`, is part of the cache key."""
    from .networks import load_network

    return load_network("gmgn", weights)


def _classify(colours: Floats, view: tuple[int, int], weights: str | None) -> Truths:
    """Return whether each cell is an obstacle by the network, shape (n, m, n')."""
    if importlib.util.find_spec("torch") is None:
        raise BackendMissing("perception 'gmgn' needs torch: pip install 'crosstrack[learn]'")
    import torch

    from ..learning.trainer import one_thread
    from .gmgn import to_tensor

    written = 0 if weights is None else Path(weights).stat().st_mtime_ns
    network = _network(weights, written)
    cells = np.empty((len(colours), *view), bool)
    with one_thread(), torch.inference_mode():
        for first in range(0, len(colours), _TOGETHER):
            batch = slice(first, first + _TOGETHER)
            cells[batch] = (network(to_tensor(colours[batch]), view)[0] > 0).numpy()
    return cells
