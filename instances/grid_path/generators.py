"""Seeded maps: irregular polygons and nodes in the paper's manner, mazes, rooms, random cells.

Only ``Generator.random`` and ``Generator.integers`` are drawn from, and what is computed of it is
rounded, so that a seed means the same map wherever it is used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, Whole, required, show
from ...models.grid_path.gridmap import MOST, GridMap
from ...models.grid_path.polygons import Polygon

__all__ = ["maze", "random_cells", "random_nodes", "random_polygons", "rooms"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Polygons that are drawn at the most.
MOST_POLYGONS = 100_000
#: Radii of the circles around polygons, by the side of a square in which each has its share of the
#: area.
_SIZES = (0.21, 0.48)
#: Corners of a polygon, and how far they lie from its middle by the circle's radius.
_CORNERS, _REACH = (5, 9), (0.35, 1.0)
#: Places that are tried for a polygon before there is said to be no room.
_TRIES = 1000
#: Digits of corners, counted from the first of the map's size.
_DIGITS = 9


@np.errstate(all="ignore")  # what overflows leaves no room
def random_polygons(
    count: int = 28,
    seed: int = 0,
    bounds: ArrayLike = (0.0, 0.0, 200.0, 200.0),
    *,
    keep: ArrayLike = (),
    gap: float = 0.0,
    size: float = 1.0,
) -> tuple[Polygon, ...]:
    """Return irregular polygons apart from each other, most of them not convex.

    Parameters
    ----------
    count : int
        Their number (paper: 28).
    seed : int
        Same seed, same polygons.
    bounds : array-like, shape (4,)
        Least x and y, greatest x and y, m.
    keep : array-like, shape (k, 2)
        Points, such as depots, that stay out of the polygons, x, y (m).
    gap : float
        The least distance between polygons, and to those points, m.
    size : float
        Factor on the size of polygons, which otherwise cover about 15 % of the map.

    Raises
    ------
    InvalidData
        There is no room for so many of this size.
    """
    count = Whole(0, MOST_POLYGONS).coerce("count", count, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    corners = Array((4,)).coerce("bounds", bounds, {})
    points = Array(("k", 2)).coerce("keep", keep, {})
    gap = Real(lower=0, unit="m").coerce("gap", gap, {})
    factor = Real(lower=0, strict=True).coerce("size", size, {})
    low, extent = corners[:2], corners[2:] - corners[:2]
    if not (extent > 0).all() or not np.isfinite(extent).all():
        raise InvalidData(
            f"bounds must be least x, least y, greatest x, greatest y, got {show(corners.tolist())}",
            field="bounds",
        )
    share = factor * math.sqrt(float(extent.prod()) / max(count, 1))
    digits = _DIGITS - 1 - math.floor(math.log10(max(np.abs(corners).max(), extent.max())))
    middles, radii = np.empty((count, 2)), np.empty(count)
    found = []
    for k in range(count):
        # Large ones first, as those find no room among many.
        radius = share * (_SIZES[1] - (_SIZES[1] - _SIZES[0]) * k / max(count - 1, 1))
        for _ in range(_TRIES):
            middle = low + radius + rng.random(2) * (extent - 2 * radius)
            apart = np.hypot(*(middles[:k] - middle).T) - radii[:k]
            kept = np.hypot(*(points - middle).T)
            free = np.concatenate([apart, kept]).min(initial=math.inf) > radius + gap
            if free and 2 * radius < extent.min():
                break
        else:
            raise InvalidData(
                f"count must leave room for every polygon, got {count}: no place found for polygon "
                f"{k} of radius {radius:g} m; size < {factor:g} makes them smaller",
                field="count",
            )
        middles[k], radii[k] = middle, radius
        found.append(Polygon(np.round(_star(rng, middle, radius), digits)))
    return tuple(found)


def _star(rng: np.random.Generator, middle: Floats, radius: float) -> Floats:
    """Return corners around `middle`, in the order of their directions."""
    number = int(rng.integers(_CORNERS[0], _CORNERS[1] + 1))
    # Directions less than half a turn apart, so that the ring cannot cross itself.
    turn = 2 * np.pi * (np.arange(number) + 0.7 * rng.random(number)) / number
    # Not quite the whole radius: what is rounded stays within the circle.
    reach = 0.999 * radius * (_REACH[0] + (_REACH[1] - _REACH[0]) * rng.random(number))
    return np.asarray(middle + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def random_nodes(grid: GridMap, depot: ArrayLike, count: int = 75, seed: int = 0) -> Floats:
    """Return the centres of different cells that can be reached from a depot.

    Parameters
    ----------
    grid : GridMap
        The map.
    depot : array-like, shape (2,)
        x, y (m), in a free cell, which holds no node.
    count : int
        Number of nodes (paper: 75).
    seed : int
        Same seed, same nodes.

    Returns
    -------
    ndarray, shape (count, 2)
        x, y (m).

    Raises
    ------
    InvalidData
        The depot is in no free cell, or too few cells can be reached.
    """
    from scipy.ndimage import label

    required("grid", grid, GridMap)
    place = Array((2,)).coerce("depot", depot, {})
    count = Whole(0).coerce("count", count, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    row, column = grid.cells_of(place).tolist()
    if not grid.holds((row, column)):
        raise InvalidData(
            f"depot must lie in a free cell, got {show(place.tolist())}", field="depot"
        )
    # What can be reached by diagonal steps that cut no corner can be reached without.
    regions, _ = label(~grid.blocked)
    reached = regions == regions[row, column]
    reached[row, column] = False
    cells = np.argwhere(reached)
    if count > len(cells):
        raise InvalidData(
            f"count must be at most {len(cells)}, the cells that can be reached, got {count}",
            field="count",
        )
    order = np.argsort(rng.random(len(cells)), kind="stable")
    return grid.centres(cells[order[:count]])


def maze(rows: int, columns: int, seed: int = 0, *, corridor: int = 1) -> GridMap:
    """Return a maze with exactly one way between any two places.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least `corridor` + 2. Walls have the width of one cell; what is left over
        beside the last wall is blocked.
    seed : int
        Same seed, same maze.
    corridor : int
        Width of the corridors, in cells.
    """
    corridor = Whole(1).coerce("corridor", corridor, {})
    rows, columns = _sides(rows, columns, corridor + 2)
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    return GridMap(_walled(rows, columns, corridor, *_tree(rows, columns, corridor, rng)))


def rooms(rows: int, columns: int, seed: int = 0, *, size: int = 7, doors: float = 0.6) -> GridMap:
    """Return square rooms with doors of one cell, at random places of their walls.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least `size` + 2, as for :func:`maze`.
    seed : int
        Same seed, same rooms.
    size : int
        Side of a room within, in cells.
    doors : float
        Share of the walls with a door, beside those without which a room would be cut off; 0 to 1.
    """
    size = Whole(1).coerce("size", size, {})
    share = Real(0, 1).coerce("doors", doors, {})
    rows, columns = _sides(rows, columns, size + 2)
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    right, down = _tree(rows, columns, size, rng)
    right |= rng.random(right.shape) < share
    down |= rng.random(down.shape) < share
    blocked = _walled(rows, columns, size, np.zeros_like(right), np.zeros_like(down))
    for doorways, step in ((right, (0, 1)), (down, (1, 0))):
        places = np.argwhere(doorways)
        along = rng.integers(0, size, len(places))
        # The wall after a room, and along it.
        at = places * (size + 1) + 1 + np.multiply(step, size)
        at += along[:, None] * np.array(step[::-1])
        blocked[at[:, 0], at[:, 1]] = False
    return GridMap(blocked)


def random_cells(rows: int, columns: int, density: float, seed: int = 0) -> GridMap:
    """Return a map whose cells are blocked with the probability `density`, each by itself.

    Raises
    ------
    InvalidData
        No cell is left free.
    """
    share = Real(0, 1).coerce("density", density, {})
    rows, columns = _sides(rows, columns, 1)
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    return GridMap(rng.random((rows, columns)) < share)


def _sides(rows: int, columns: int, least: int) -> tuple[int, int]:
    """Return the numbers of cells, checked."""
    sides = (
        Whole(least, MOST).coerce("rows", rows, {}),
        Whole(least, MOST).coerce("columns", columns, {}),
    )
    if sides[0] * sides[1] > MOST:
        raise InvalidData(
            f"rows × columns must be at most {MOST}, got {sides[0]} × {sides[1]}", field="rows"
        )
    return sides


def _tree(rows: int, columns: int, size: int, rng: np.random.Generator) -> tuple[Truths, Truths]:
    """Return which rooms are joined to the one at their right, and to the one below, by a random tree."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    shape = ((rows - 1) // (size + 1), (columns - 1) // (size + 1))
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    tails = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    heads = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    # No weight is 0, which would mean that there is no edge.
    weights = 1.0 + rng.random(len(tails))
    graph = coo_array((weights, (tails, heads)), (number.size, number.size))
    tree = minimum_spanning_tree(graph.tocsr()).tocoo()
    low, high = np.minimum(tree.row, tree.col), np.maximum(tree.row, tree.col)
    right, down = np.zeros(shape, bool), np.zeros(shape, bool)
    # In maps of one column of rooms the next room is the one below.
    beside = (high - low == 1) & (low // shape[1] == high // shape[1])
    right.ravel()[low[beside]] = True
    down.ravel()[low[~beside]] = True
    return right[:, :-1], down[:-1]


def _walled(rows: int, columns: int, size: int, right: Truths, down: Truths) -> Truths:
    """Return the cells of square rooms, where the walls between joined ones are left out."""
    blocked = np.ones((rows, columns), bool)
    across = (right.shape[0], right.shape[1] + 1)
    step = size + 1
    for row in range(size):
        for column in range(size):
            blocked[1 + row :: step, 1 + column :: step][: across[0], : across[1]] = False
    for k in range(size):
        wall = blocked[1 + k :: step, 1 + size :: step][: right.shape[0], : right.shape[1]]
        wall &= ~right
        wall = blocked[1 + size :: step, 1 + k :: step][: down.shape[0], : down.shape[1]]
        wall &= ~down
    return blocked
