"""Distributions (laws) of random scenes: the paper's law, and harder laws.

The paper draws obstacles of different sizes, and start and target at random, and rejects scenes without a path. It does
not print the sizes. The other laws place obstacles of a few shapes, with start and target far apart. All random numbers
come from ``Generator.integers``, so a seed yields the same scenes on every platform.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Whole, required, show
from ...models.records import Member
from ...models.unknown_grid.checks import has_way
from ...models.unknown_grid.model import UnknownGridNavigation
from ..storage import joined

__all__ = ["SceneArrays", "SceneLaw", "draw_scene_arrays", "draw_scenes", "training_generator"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Maximum number of draws per scene, and of positions per obstacle.
_TRIES, _PLACES = 1000, 50
#: Spawn keys that separate the random streams of catalogued scenes and of training.
_DRAWN, _TRAINING = 0, 1


class SceneLaw(StrEnum):
    """Shape of the obstacles. A side is the side of the map parallel to the length."""

    #: Straight walls, one cell thick, vertical or horizontal, 1/4 to 3/4 of the side long.
    WALLS = "walls"
    #: Two walls that form a corner, each 1/4 to 1/2 of the side long.
    L_SHAPES = "l-shapes"
    #: Three walls around a pocket, each 1/4 to 1/2 of the side long, two of them equal.
    U_TRAPS = "u-traps"
    #: Solid blocks with sides of 1/8 to 1/3 of the map's side.
    RECTANGLES = "rectangles"
    #: Obstacles of the shapes above, with equal probabilities.
    MIXED = "mixed"
    #: The paper's law: blocks with sides from one cell to 1/3 of the map's side. Start and target are any two free
    #: cells.
    PAPER = "paper"


class SceneArrays(NamedTuple):
    """Scenes as arrays.

    Parameters
    ----------
    blocked : ndarray of bool, shape (k, rows, columns)
        Maps, true if blocked.
    starts, targets : ndarray of int, shape (k, 2)
        Row and column in each scene.
    """

    blocked: Truths
    starts: Ints
    targets: Ints

    def pose(self, /, *, name: str = "", **fields: Any) -> UnknownGridNavigation:
        """Return the model of the scenes; `fields` are its further fields, such as `view`."""
        contents = {**self._asdict(), "shape": self.blocked.shape[1:]}
        return UnknownGridNavigation.from_data(joined(contents, fields), name=name)


def draw_scenes(
    law: SceneLaw | str = SceneLaw.WALLS,
    *,
    shape: ArrayLike = (17, 17),
    obstacles: ArrayLike = 3,
    scenes: int = 400,
    seed: int = 0,
    clear: int | None = None,
    **fields: Any,
) -> UnknownGridNavigation:
    """Return solvable random scenes of a law.

    In the law ``"paper"``, start and target are any two cells. In the other laws, their Manhattan distance is at least
    half the sum of both sides. The obstacles follow one after the other at random positions and may touch and cross. An
    obstacle that would cover the start or the open ground around the target is drawn again, at most 50 times. If no
    position or no path is left, the whole scene is drawn again.

    Lengths are whole cells with equal probabilities. Shares of a side are rounded up at the lower end and down at the
    upper end, and the open ground is rounded up. On 17 × 17 cells, walls are 5 to 12 cells long, and 5 cells in each
    direction from the target are free.

    Parameters
    ----------
    law : {"walls", "l-shapes", "u-traps", "rectangles", "mixed", "paper"}, default "walls"
        See :class:`SceneLaw`.
    shape : array-like of int, shape (2,), default (17, 17)
        Numbers of rows and columns.
    obstacles : int or (int, int), default 3
        Number of obstacles per scene, or its minimum and maximum for uniform random numbers.
    scenes : int, default 400
        Number of scenes. Every scene is independent of this number.
    seed : int, default 0
        Seed. Equal law, shape, obstacles, clear and seed yield equal scenes.
    clear : int, optional
        Width of the open ground around the target in each direction, cells. The default is a quarter of the shorter
        side, and 0 in the law ``"paper"``. If it is below half the view, a hovering UAV may not show a path to the
        target.
    **fields
        Further fields of the model, such as `view`.

    Returns
    -------
    UnknownGridNavigation
        Model with the random scenes.

    Raises
    ------
    InvalidData
        No solvable scene exists among the draws, for example because the obstacles leave no room, or an argument is
        invalid.

    Notes
    -----
    If the view reaches no farther than the open ground, a path is visible as soon as the target is in the view. A
    hovering UAV then shows all that the vehicle needs.
    """
    kind, sides, numbers, open_ground = _checked(law, shape, obstacles, clear)
    scenes = Whole(1).coerce("scenes", scenes, {})
    seed = Whole(0).coerce("seed", seed, {})
    words = [list(SceneLaw).index(kind), *sides, *numbers, open_ground, seed]
    drawn = []
    for k in range(scenes):
        stream = np.random.SeedSequence(words, spawn_key=(_DRAWN, k))
        drawn.append(_draw(kind, sides, numbers, open_ground, np.random.default_rng(stream)))
    return SceneArrays(*map(np.array, zip(*drawn, strict=True))).pose(**fields)


def draw_scene_arrays(
    law: SceneLaw | str,
    shape: ArrayLike,
    obstacles: ArrayLike,
    scenes: int,
    generator: np.random.Generator,
    *,
    clear: int | None = None,
) -> SceneArrays:
    """Return random scenes of a law as arrays.

    Parameters
    ----------
    law, shape, obstacles, scenes, clear
        See :func:`draw_scenes`.
    generator : numpy.random.Generator
        Source of random numbers, such as :func:`training_generator`.

    Returns
    -------
    SceneArrays
        Maps, starts and targets.

    Raises
    ------
    InvalidData
        See :func:`draw_scenes`.
    """
    kind, sides, numbers, open_ground = _checked(law, shape, obstacles, clear)
    required("generator", generator, np.random.Generator)
    scenes = Whole(1).coerce("scenes", scenes, {})
    drawn = [_draw(kind, sides, numbers, open_ground, generator) for _ in range(scenes)]
    return SceneArrays(*map(np.array, zip(*drawn, strict=True)))


def training_generator(seed: int = 0) -> np.random.Generator:
    """Return a generator for training scenes, independent of all streams of :func:`draw_scenes`.

    Parameters
    ----------
    seed : int, default 0
        Seed, from 0 to 2**32 - 1.
    """
    seed = Whole(0, 2**32 - 1).coerce("seed", seed, {})
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_TRAINING,)))


def _checked(
    law: Any, shape: Any, obstacles: Any, clear: Any
) -> tuple[SceneLaw, tuple[int, int], tuple[int, int], int]:
    kind = SceneLaw(Member(SceneLaw).coerce("law", law, {}))
    rows, columns = Array((2,), int, lower=1).coerce("shape", shape, {}).tolist()
    if rows + columns < 4:
        raise InvalidData(
            f"shape must be rows and columns whose sum is >= 4, got {rows} and {columns}",
            field="shape",
        )
    several = [obstacles] * 2 if np.ndim(obstacles) == 0 else obstacles
    low, high = Array((2,), int, lower=0).coerce("obstacles", several, {}).tolist()
    if low > high:
        raise InvalidData(
            f"obstacles must rise from least to greatest, got {show([low, high])}",
            field="obstacles",
        )
    if clear is None:
        clear = 0 if kind is SceneLaw.PAPER else -(-min(rows, columns) // 4)
    return kind, (rows, columns), (low, high), Whole(0).coerce("clear", clear, {})


def _draw(
    law: SceneLaw,
    sides: tuple[int, int],
    numbers: tuple[int, int],
    clear: int,
    rng: np.random.Generator,
) -> tuple[Truths, list[int], list[int]]:
    """Return the map, start and target of one scene."""
    for _ in range(_TRIES):
        r, c, row, column = rng.integers(0, sides + sides).tolist()
        apart = abs(r - row) + abs(c - column)
        if apart == 0 or (law is not SceneLaw.PAPER and 2 * apart < sum(sides)):
            continue
        reserved = np.zeros(sides, bool)
        reserved[
            max(row - clear, 0) : row + clear + 1, max(column - clear, 0) : column + clear + 1
        ] = 1
        reserved[r, c] = True
        blocked = np.zeros(sides, bool)
        number = int(rng.integers(numbers[0], numbers[1] + 1))
        if not all(_place(law, blocked, reserved, rng) for _ in range(number)):
            continue
        if has_way(blocked, (r, c), (row, column)):
            return blocked, [r, c], [row, column]
    raise InvalidData(
        f"obstacles must leave room for a way, got {numbers[0]} to {numbers[1]} of the law {law} on "
        f"{sides[0]} × {sides[1]} cells: none in {_TRIES} scenes",
        field="obstacles",
    )


def _place(law: SceneLaw, blocked: Truths, reserved: Truths, rng: np.random.Generator) -> bool:
    """Place an obstacle on a map outside the cells `reserved`; return whether a position was found."""
    sides = blocked.shape
    for _ in range(_PLACES):
        form = law
        if law is SceneLaw.MIXED:
            form = list(SceneLaw)[rng.integers(0, 4)]
        cells = _FORMS[form](sides, rng)
        corner = rng.integers(0, np.subtract(sides, cells.shape) + 1).tolist()
        window = (
            slice(corner[0], corner[0] + cells.shape[0]),
            slice(corner[1], corner[1] + cells.shape[1]),
        )
        if not (reserved[window] & cells).any():
            blocked[window] |= cells
            return True
    return False


def _length(
    side: int, low: tuple[int, int], high: tuple[int, int], rng: np.random.Generator
) -> int:
    """Return a random number of cells between the fractions `low` and `high` of a side."""
    shortest = -(-low[0] * side // low[1])
    return int(rng.integers(shortest, max(high[0] * side // high[1], shortest) + 1))


def _wall(sides: tuple[int, ...], rng: np.random.Generator) -> Truths:
    axis = int(rng.integers(0, 2))
    size = [1, 1]
    size[axis] = _length(sides[axis], (1, 4), (3, 4), rng)
    return np.ones(size, bool)


def _corner(sides: tuple[int, ...], rng: np.random.Generator) -> Truths:
    cells = np.zeros([_length(side, (1, 4), (1, 2), rng) for side in sides], bool)
    row, column = (-rng.integers(0, 2, 2)).tolist()
    cells[row], cells[:, column] = True, True
    return cells


def _trap(sides: tuple[int, ...], rng: np.random.Generator) -> Truths:
    cells = np.ones([_length(side, (1, 4), (1, 2), rng) for side in sides], bool)
    pocket = [slice(1, -1), slice(1, -1)]
    axis, end = rng.integers(0, 2, 2).tolist()
    pocket[axis] = slice(1, None) if end else slice(None, -1)
    cells[tuple(pocket)] = False
    return cells


def _block(sides: tuple[int, ...], rng: np.random.Generator) -> Truths:
    return np.ones([_length(side, (1, 8), (1, 3), rng) for side in sides], bool)


def _any_block(sides: tuple[int, ...], rng: np.random.Generator) -> Truths:
    return np.ones([_length(side, (1, side), (1, 3), rng) for side in sides], bool)


_FORMS: dict[SceneLaw, Callable[[tuple[int, ...], np.random.Generator], Truths]] = {
    SceneLaw.WALLS: _wall,
    SceneLaw.L_SHAPES: _corner,
    SceneLaw.U_TRAPS: _trap,
    SceneLaw.RECTANGLES: _block,
    SceneLaw.PAPER: _any_block,
}
