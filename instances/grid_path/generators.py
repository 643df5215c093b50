"""Seeded random maps: irregular polygons and nodes as in the paper, mazes, rooms, random cells.

The functions use only ``Generator.random`` and ``Generator.integers`` and round computed coordinates, so
that a seed yields the same map on every platform.
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

#: Maximum number of polygons.
MOST_POLYGONS = 100_000
#: Limits on the radii of circles around polygons, relative to the side of a square with a polygon's share
#: of the area.
_SIZES = (0.21, 0.48)
#: Limits on the number of corners, and on their distance from the centre, relative to the circle's radius.
_CORNERS, _REACH = (5, 9), (0.35, 1.0)
#: Maximum number of positions per polygon.
_TRIES = 1000
#: Significant digits of corners, relative to the map's size.
_DIGITS = 9


@np.errstate(all="ignore")  # an overflow ends in the error about missing room
def random_polygons(
    count: int = 28,
    seed: int = 0,
    bounds: ArrayLike = (0.0, 0.0, 200.0, 200.0),
    *,
    keep: ArrayLike = (),
    gap: float = 0.0,
    size: float = 1.0,
) -> tuple[Polygon, ...]:
    """Return disjoint irregular polygons, most of them non-convex.

    Parameters
    ----------
    count : int, default 28
        Number of polygons (28 in the paper), at most 100,000.
    seed : int, default 0
        Seed of the polygons.
    bounds : array-like, shape (4,), default (0, 0, 200, 200)
        Lowest x and y, greatest x and y, m.
    keep : array-like, shape (k, 2), default ()
        Points x, y outside all polygons, such as depots, m.
    gap : float, default 0
        Minimum distance between polygons, and between polygons and those points, m.
    size : float, default 1
        Factor on the size of polygons. With 1 they cover about 15 % of the map.

    Returns
    -------
    tuple of Polygon
        Polygons, the largest first.

    Raises
    ------
    InvalidData
        An argument is invalid, or the bounds have no room for the polygons.
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
    polygons = []
    for k in range(count):
        # Large polygons come first, because the room for them shrinks fastest.
        radius = share * (_SIZES[1] - (_SIZES[1] - _SIZES[0]) * k / max(count - 1, 1))
        for _ in range(_TRIES):
            middle = low + radius + rng.random(2) * (extent - 2 * radius)
            apart = np.hypot(*(middles[:k] - middle).T) - radii[:k]
            away = np.hypot(*(points - middle).T)
            free = np.concatenate([apart, away]).min(initial=math.inf) > radius + gap
            if free and 2 * radius < extent.min():
                break
        else:
            raise InvalidData(
                f"count must leave room for every polygon, got {count}: no place found for polygon "
                f"{k} of radius {radius:g} m; size < {factor:g} makes them smaller",
                field="count",
            )
        middles[k], radii[k] = middle, radius
        polygons.append(Polygon(np.round(_star(rng, middle, radius), digits)))
    return tuple(polygons)


def _star(rng: np.random.Generator, middle: Floats, radius: float) -> Floats:
    """Return the corners of a star-shaped polygon around `middle`, in the order of their directions."""
    number = int(rng.integers(_CORNERS[0], _CORNERS[1] + 1))
    # Consecutive directions differ by less than pi, so the ring cannot cross itself.
    turn = 2 * np.pi * (np.arange(number) + 0.7 * rng.random(number)) / number
    # Slightly less than the radius, so that rounded corners stay within the circle.
    reach = 0.999 * radius * (_REACH[0] + (_REACH[1] - _REACH[0]) * rng.random(number))
    return np.asarray(middle + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def random_nodes(grid: GridMap, depot: ArrayLike, count: int = 75, seed: int = 0) -> Floats:
    """Return the centres of distinct random cells that are reachable from a depot.

    Parameters
    ----------
    grid : GridMap
        Map of free and blocked cells.
    depot : array-like, shape (2,)
        Point x, y in a free cell, m. This cell is excluded.
    count : int, default 75
        Number of nodes (75 in the paper).
    seed : int, default 0
        Seed of the nodes.

    Returns
    -------
    ndarray, shape (count, 2)
        Points x, y, m.

    Raises
    ------
    InvalidData
        The depot is not in a free cell, or fewer than `count` cells are reachable.
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
    # Diagonal steps without cutting corners reach no further cells, so four neighbours suffice.
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
    """Return a maze with exactly one path between any two cells.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least `corridor` + 2. Walls are one cell thick. Cells after the last full
        corridor are blocked.
    seed : int, default 0
        Seed of the maze.
    corridor : int, default 1
        Width of the corridors, cells.

    Returns
    -------
    GridMap
        Map with cells of 1 m.

    Raises
    ------
    InvalidData
        An argument is outside its allowed range.
    """
    corridor = Whole(1).coerce("corridor", corridor, {})
    rows, columns = _sides(rows, columns, corridor + 2)
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    return GridMap(_walled(rows, columns, corridor, *_tree(rows, columns, corridor, rng)))


def rooms(rows: int, columns: int, seed: int = 0, *, size: int = 7, doors: float = 0.6) -> GridMap:
    """Return square rooms with doors of one cell at random positions in their walls.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least `size` + 2, see :func:`maze`.
    seed : int, default 0
        Seed of the rooms.
    size : int, default 7
        Inner side of a room, cells.
    doors : float, default 0.6
        Probability of a door in each wall, 0 to 1, in addition to the doors that connect all rooms.

    Returns
    -------
    GridMap
        Map with cells of 1 m.

    Raises
    ------
    InvalidData
        An argument is outside its allowed range.
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
        # First cell of the wall after a room, then the position along the wall.
        cells = places * (size + 1) + 1 + np.multiply(step, size)
        cells += along[:, None] * np.array(step[::-1])
        blocked[cells[:, 0], cells[:, 1]] = False
    return GridMap(blocked)


def random_cells(rows: int, columns: int, density: float, seed: int = 0) -> GridMap:
    """Return a map with independent random cells.

    Parameters
    ----------
    rows, columns : int
        Numbers of cells, at least 1.
    density : float
        Probability that a cell is blocked, 0 to 1.
    seed : int, default 0
        Seed of the map.

    Returns
    -------
    GridMap
        Map with cells of 1 m.

    Raises
    ------
    InvalidData
        No cell is free, or an argument is outside its allowed range.
    """
    share = Real(0, 1).coerce("density", density, {})
    rows, columns = _sides(rows, columns, 1)
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    return GridMap(rng.random((rows, columns)) < share)


def _sides(rows: int, columns: int, lower: int) -> tuple[int, int]:
    """Return the numbers of cells after validation."""
    allowed = Whole(lower, MOST)
    sides = allowed.coerce("rows", rows, {}), allowed.coerce("columns", columns, {})
    if sides[0] * sides[1] > MOST:
        raise InvalidData(
            f"rows × columns must be at most {MOST}, got {sides[0]} × {sides[1]}", field="rows"
        )
    return sides


def _tree(rows: int, columns: int, size: int, rng: np.random.Generator) -> tuple[Truths, Truths]:
    """Return whether a random spanning tree connects each room to the right, and downwards."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    shape = ((rows - 1) // (size + 1), (columns - 1) // (size + 1))
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    tails = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    heads = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    # Weights are at least 1, because SciPy treats 0 as a missing edge.
    weights = 1.0 + rng.random(len(tails))
    graph = coo_array((weights, (tails, heads)), (number.size, number.size))
    tree = minimum_spanning_tree(graph.tocsr()).tocoo()
    low, high = np.minimum(tree.row, tree.col), np.maximum(tree.row, tree.col)
    right, down = np.zeros(shape, bool), np.zeros(shape, bool)
    # With one column of rooms, the next number is the room below.
    beside = (high - low == 1) & (low // shape[1] == high // shape[1])
    right.ravel()[low[beside]] = True
    down.ravel()[low[~beside]] = True
    return right[:, :-1], down[:-1]


def _walled(rows: int, columns: int, size: int, right: Truths, down: Truths) -> Truths:
    """Return the cells of square rooms without walls between connected rooms."""
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
