"""Cells of a view from the camera's image of it."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendMissing, InvalidData, show
from ...models.unknown_grid.camera import PIXELS, overlaps

__all__ = ["METHODS", "perceive"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: How cells are read.
METHODS = ("k-means", "gmgn")
#: Every how many rows and columns there is a pixel that the means are found from.
_STRIDE = 4
#: Rounds of k-means at the most.
_ROUNDS = 10
#: Share of the variance that two means must explain, lest there be one kind of cell only. They explain 2/π along
#: the longest axis of what is spread like a normal distribution.
_APART = 0.8
#: Images that the network reads at once.
_TOGETHER = 16


def perceive(
    images: ArrayLike,
    view: tuple[int, int],
    method: str = "k-means",
    weights: str | None = None,
) -> Truths:
    """Return which cells look like obstacles.

    Parameters
    ----------
    images : array-like, shape (n, 256, 256, 3)
        Red, green and blue from 0 to 1, one image a view.
    view : tuple of int
        Rows and columns of the view, odd.
    method : {"k-means", "gmgn"}
        ``"k-means"`` (ours) splits the pixels of an image by colour in two clusters, and the pixels of a cell vote.
        The cell in the middle is free, as the vehicle stands or stood there; all cells are free if the colours are
        of one kind. ``"gmgn"`` is the paper's network, see :mod:`~.gmgn`.
    weights : str, optional
        A file of weights for the network; those that are shipped.

    Returns
    -------
    ndarray of bool, shape (n, m, n')
        True where blocked. Images of noise get an answer, too; the same images the same one.

    Raises
    ------
    InvalidData
        Naming the place: an image of another shape, a value that is no number from 0 to 1; a view that is even.
    BackendMissing
        PyTorch is not installed, which ``"gmgn"`` needs.
    """
    if method not in METHODS:
        raise InvalidData(
            f"perception must be one of {', '.join(METHODS)}, got {show(method)}",
            field="perception",
        )
    rows, columns = (_odd(side) for side in _pair(view))
    colours = _checked(images)
    if method == "k-means":
        found = [_vote(_split(image, (rows, columns)), (rows, columns)) for image in colours]
        return np.array(found, bool).reshape(len(colours), rows, columns)
    return _ask(colours, (rows, columns), weights)


def _pair(view: Any) -> tuple[Any, Any]:
    if np.shape(view) != (2,):
        raise InvalidData(f"view must be rows and columns, got {show(view)}", field="view")
    return view[0], view[1]


def _odd(side: Any) -> int:
    if not isinstance(side, int | np.integer) or side < 1 or not side % 2:
        raise InvalidData(
            f"view must be two odd numbers of cells >= 1, got {show(side)}", field="view"
        )
    return int(side)


def _checked(images: ArrayLike) -> Floats:
    """Return the images as an array; refuse what is none."""
    try:
        colours = np.asarray(images, float)
    except (TypeError, ValueError):
        raise InvalidData(f"images must hold numbers, got {show(images)}", field="images") from None
    if colours.ndim != 4 or colours.shape[1:] != (PIXELS, PIXELS, 3):
        raise InvalidData(
            f"images must have shape (n, {PIXELS}, {PIXELS}, 3), got {colours.shape}",
            field="images",
        )
    # What is no number fails both comparisons.
    if colours.size and not (colours.min() >= 0.0 and colours.max() <= 1.0):
        wrong = ~((colours >= 0.0) & (colours <= 1.0))
        k, row, column, colour = np.unravel_index(int(wrong.argmax()), colours.shape)
        raise InvalidData(
            f"images[{k}], row {row}, column {column}, {('red', 'green', 'blue')[colour]} must be a number "
            f"from 0 to 1, got {show(float(colours[k, row, column, colour]))}",
            field="images",
        )
    return colours


def _split(image: Floats, view: tuple[int, int]) -> Truths:
    """Return which pixels are of the colour that is not the middle's, shape (256, 256), by k-means."""
    from scipy.cluster.vq import kmeans2

    colours = image[::_STRIDE, ::_STRIDE].reshape(-1, 3)
    mean = colours.mean(axis=0)
    spread, axes = np.linalg.eigh((colours - mean).T @ (colours - mean) / len(colours))
    if spread[-1] <= np.finfo(float).eps:
        return np.zeros(image.shape[:2], bool)
    # Begun on both sides along the longest axis, neither mean ever loses all of its pixels; nothing is drawn.
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
    """Return in which cells most pixels are true; one in two cells counts for both as far as it lies there."""
    down, across = (_shares(side) for side in view)
    most: Truths = down @ pixels.astype(float) @ across.T > 0.5
    return most


_shares = cache(overlaps)


@cache
def _network(weights: str | None, written: int) -> Any:
    """Return the network of a file, read again when it was written anew."""
    from . import gmgn
    from .networks import load_network

    return load_network("gmgn", gmgn, weights)


def _ask(colours: Floats, view: tuple[int, int], weights: str | None) -> Truths:
    """Return what the network says."""
    if importlib.util.find_spec("torch") is None:
        raise BackendMissing("perception 'gmgn' needs torch: pip install 'crosstrack[learn]'")
    import torch

    from ..trainer import one_thread
    from .gmgn import to_tensor

    written = 0 if weights is None else Path(weights).stat().st_mtime_ns
    network = _network(weights, written)
    found = np.empty((len(colours), *view), bool)
    with one_thread(), torch.inference_mode():
        for first in range(0, len(colours), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            found[some] = (network(to_tensor(colours[some]), view)[0] > 0).numpy()
    return found
