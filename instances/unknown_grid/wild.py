"""Scenes wilder than the paper's: mazes, spirals, clutter, targets that cannot be reached."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, Whole
from ...models.unknown_grid.model import UnknownGridNavigation
from ..grid_path.generators import maze as draw_maze

__all__ = ["clutter", "enclosed", "maze", "spiral"]

Truths = NDArray[np.bool_]


def maze(rows: int = 17, columns: int = 17, seed: int = 0, **fields: Any) -> UnknownGridNavigation:
    """Return a maze with one way between any two places, from its first cell to its last.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least 3, and one of them at least 5.
    seed : int
        Same seed, same maze.
    **fields
        The other fields of the model. There are as many steps as cells unless it is given.
    """
    blocked = draw_maze(rows, columns, seed).blocked
    row, column = np.argwhere(~blocked)[-1].tolist()
    return _posed(blocked, (1, 1), (row, column), fields)


def spiral(size: int = 17, **fields: Any) -> UnknownGridNavigation:
    """Return a corridor that winds from a corner of a square map to its middle, where the target lies.

    Parameters
    ----------
    size : int
        Rows and columns, at least 5.
    **fields
        As for :func:`maze`.
    """
    size = Whole(5, 8192).coerce("size", size, {})
    blocked = np.ones((size, size), bool)
    at, step = np.zeros(2, int), np.array([0, 1])
    blocked[0, 0] = False
    # Legs of the lengths n - 1, n - 1, n - 1, n - 3, n - 3, n - 5, …; a last one of 1 has no room for its pair.
    legs = [size - 1, *np.repeat(np.arange(size - 1, 0, -2), 2)]
    if size % 2 == 0:
        del legs[-1]
    for leg in legs:
        for _ in range(leg):
            at = at + step
            blocked[tuple(at)] = False
        step = np.array([step[1], -step[0]])
    return _posed(blocked, (0, 0), tuple(at.tolist()), fields)


def clutter(
    shape: ArrayLike = (17, 17),
    share: float = 0.6,
    seed: int = 0,
    *,
    way: bool = True,
    **fields: Any,
) -> UnknownGridNavigation:
    """Return a map of single blocked cells anywhere.

    Parameters
    ----------
    shape : array-like of int, shape (2,)
        Rows and columns.
    share : float
        Of the cells that are blocked, 0 to 1, rounded.
    seed : int
        Same seed, same map.
    way : bool
        Whether the target can be reached: then start and target are the first and the last cell, by the sum of
        row and column, of the largest part whose cells are joined; else the target is the last cell of all others.
    **fields
        As for :func:`maze`.

    Raises
    ------
    InvalidData
        There are no such cells.
    """
    from scipy.ndimage import label

    rows, columns = Array((2,), int, lower=1).coerce("shape", shape, {}).tolist()
    share = Real(0, 1).coerce("share", share, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    blocked = np.zeros(rows * columns, bool)
    order = np.argsort(rng.random(rows * columns), kind="stable")
    blocked[order[: round(share * rows * columns)]] = True
    blocked = blocked.reshape(rows, columns)
    parts, _ = label(~blocked)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    largest = parts == sizes.argmax()
    starts = np.argwhere(largest & ~blocked)
    targets = starts if way else np.argwhere(~largest & ~blocked)
    if min(len(starts), len(targets)) < 1 + way:
        raise InvalidData(
            f"share must leave cells for start and target, got {share:g}", field="share"
        )
    start = starts[starts.sum(axis=1).argmin()]
    target = targets[targets.sum(axis=1).argmax()]
    return _posed(blocked, tuple(start.tolist()), tuple(target.tolist()), fields)


def enclosed(
    shape: ArrayLike = (17, 17), distance: int = 2, **fields: Any
) -> UnknownGridNavigation:
    """Return a map whose target, in the middle, lies within a closed ring of obstacles.

    Parameters
    ----------
    shape : array-like of int, shape (2,)
        Rows and columns, at least 2 · `distance` + 2.
    distance : int
        From the target to the ring, in cells.
    **fields
        As for :func:`maze`.
    """
    distance = Whole(1).coerce("distance", distance, {})
    sides = Array((2,), int, lower=2 * distance + 2).coerce("shape", shape, {})
    row, column = (sides // 2).tolist()
    away = np.maximum(
        abs(np.arange(sides[0]) - row)[:, None], abs(np.arange(sides[1]) - column)[None]
    )
    blocked = away == distance
    # The corner that is farthest from the middle lies off the ring.
    return _posed(blocked, (0, 0), (row, column), fields)


def _posed(
    blocked: Truths, start: tuple[int, int], target: tuple[int, int], fields: dict[str, Any]
) -> UnknownGridNavigation:
    """Return the model of one scene, with as many steps as cells unless told."""
    return UnknownGridNavigation(
        blocked[None],
        np.array([start]),
        np.array([target]),
        np.array(blocked.shape),
        **{"steps": blocked.size, **fields},
    )
