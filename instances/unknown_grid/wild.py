"""Extreme scenes: mazes, spirals, clutter and unreachable targets."""

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
    """Return a maze with exactly one path between any two cells, from its first cell to its last.

    Parameters
    ----------
    rows, columns : int, default 17
        Numbers of cells, at least 3, and one of them at least 5.
    seed : int, default 0
        Seed of the maze.
    **fields
        Further fields of the model. The default of `steps` is the number of cells.
    """
    blocked = draw_maze(rows, columns, seed).blocked
    row, column = np.argwhere(~blocked)[-1].tolist()
    return _posed(blocked, (1, 1), (row, column), fields)


def spiral(size: int = 17, **fields: Any) -> UnknownGridNavigation:
    """Return a spiral corridor from a corner of a square map to the target in its middle.

    Parameters
    ----------
    size : int, default 17
        Number of rows and of columns, at least 5.
    **fields
        See :func:`maze`.
    """
    size = Whole(5, 8192).coerce("size", size, {})
    blocked = np.ones((size, size), bool)
    cell, step = np.zeros(2, int), np.array([0, 1])
    blocked[0, 0] = False
    # Lengths n - 1, n - 1, n - 1, n - 3, n - 3, n - 5, …; a last leg of length 1 has no room for its pair.
    legs = [size - 1, *np.repeat(np.arange(size - 1, 0, -2), 2)]
    if size % 2 == 0:
        del legs[-1]
    for leg in legs:
        for _ in range(leg):
            cell = cell + step
            blocked[tuple(cell)] = False
        step = np.array([step[1], -step[0]])
    return _posed(blocked, (0, 0), tuple(cell.tolist()), fields)


def clutter(
    shape: ArrayLike = (17, 17),
    share: float = 0.6,
    seed: int = 0,
    *,
    way: bool = True,
    **fields: Any,
) -> UnknownGridNavigation:
    """Return a map with independent random blocked cells.

    Parameters
    ----------
    shape : array-like of int, shape (2,), default (17, 17)
        Numbers of rows and columns.
    share : float, default 0.6
        Share of blocked cells, 0 to 1. The number of cells is rounded.
    seed : int, default 0
        Seed of the map.
    way : bool, default True
        Whether the target is reachable. If true, start and target are the first and last cell, by the sum of row
        and column, of the largest connected part. Otherwise the target is the last cell outside this part.
    **fields
        See :func:`maze`.

    Raises
    ------
    InvalidData
        The map has no free cells for start and target.
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
    """Return a map with the target in the middle of a closed ring of obstacles.

    Parameters
    ----------
    shape : array-like of int, shape (2,), default (17, 17)
        Numbers of rows and columns, at least 2 · `distance` + 2.
    distance : int, default 2
        Distance from the target to the ring, cells.
    **fields
        See :func:`maze`.
    """
    distance = Whole(1).coerce("distance", distance, {})
    sides = Array((2,), int, lower=2 * distance + 2).coerce("shape", shape, {})
    row, column = (sides // 2).tolist()
    away = np.maximum(
        abs(np.arange(sides[0]) - row)[:, None], abs(np.arange(sides[1]) - column)[None]
    )
    blocked = away == distance
    # Cell (0, 0) is outside the ring, because it is the corner farthest from the middle.
    return _posed(blocked, (0, 0), (row, column), fields)


def _posed(
    blocked: Truths, start: tuple[int, int], target: tuple[int, int], fields: dict[str, Any]
) -> UnknownGridNavigation:
    """Return the model of one scene. The default of `steps` is the number of cells."""
    return UnknownGridNavigation(
        blocked[None],
        np.array([start]),
        np.array([target]),
        np.array(blocked.shape),
        **{"steps": blocked.size, **fields},
    )
