"""The laws that scenes are drawn from: the paper's, and harder ones of our own.

The paper draws obstacles of different sizes, and start and target at random, and drops scenes without a way; it does not
print the sizes. Our laws have obstacles of a few forms between a start and a target far from it. All randomness comes
from ``Generator.integers``, so that a seed means the same scenes wherever it is used.
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

__all__ = ["SceneArrays", "SceneLaw", "draw_scene_arrays", "draw_scenes", "training_generator"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Scenes that are tried for one that is solvable, and places for an obstacle in each.
_TRIES, _PLACES = 1000, 50
#: The last of the words that streams are seeded with: those of catalogued scenes and of training differ.
_DRAWN, _TRAINING = 0, 1


class SceneLaw(StrEnum):
    """The form of the obstacles; a side is that of the map along which a length lies."""

    #: Straight walls, one cell thick, upright or level, from a quarter to three quarters of the side long.
    WALLS = "walls"
    #: Two walls that meet in a corner, each from a quarter to a half of the side long.
    L_SHAPES = "l-shapes"
    #: Three walls around a pocket: each from a quarter to a half of the side long, two of them equal.
    U_TRAPS = "u-traps"
    #: Solid blocks, each side from an eighth to a third of that of the map.
    RECTANGLES = "rectangles"
    #: Each obstacle is of one of the forms above, all equally likely.
    MIXED = "mixed"
    #: The paper's: blocks of different sizes, each side from one cell to a third of the map's; start and target are
    #: any two free cells.
    PAPER = "paper"


class SceneArrays(NamedTuple):
    """Scenes as arrays.

    Parameters
    ----------
    blocked : ndarray of bool, shape (k, rows, columns)
        The maps.
    starts, targets : ndarray of int, shape (k, 2)
        Row and column.
    """

    blocked: Truths
    starts: Ints
    targets: Ints

    def pose(self, **fields: Any) -> UnknownGridNavigation:
        """Return the model of the scenes; `fields` are its other ones, such as `view`."""
        shape = np.array(self.blocked.shape[1:])
        return UnknownGridNavigation(self.blocked, self.starts, self.targets, shape, **fields)


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
    """Return scenes that are drawn from a law, all of them solvable.

    By the law ``"paper"`` start and target are any two cells. Otherwise they are at least half the sum of both sides
    apart, in steps on an empty map. Then come the obstacles, one after the other, each anywhere on the map; they may touch and cross. An
    obstacle that would cover the start, or come within a quarter of the shorter side of the target in rows and in
    columns, is drawn again, up to 50 times. The whole scene is drawn again where no place or no way is left.

    Lengths are whole cells, all equally likely; shares of a side are rounded up at the lower end and down at the
    upper one, the open ground around the target up: on 17 × 17 cells walls are 5 to 12 long, and 5 cells in each
    direction from the target are free.

    Parameters
    ----------
    law : {"walls", "l-shapes", "u-traps", "rectangles", "mixed", "paper"}
        See :class:`SceneLaw`.
    shape : array-like of int, shape (2,)
        Rows and columns.
    obstacles : int or (int, int)
        Their number, or its least and greatest, all equally likely.
    scenes : int
        Their number. A scene is the same however many are drawn.
    seed : int
        Same law, shape, obstacles, clear and seed: same scenes.
    clear : int, optional
        Cells of open ground around the target in each direction, by default a quarter of the side, and none by the
        law ``"paper"``. With less than half the view, a UAV that stays once it has seen the target may stay at a cell without a way to it in
        sight.
    **fields
        The other fields of the model, such as `view`.

    Raises
    ------
    InvalidData
        No solvable scene is found, as where obstacles leave no room.

    Notes
    -----
    The open ground is there so that the way is in sight when the target comes into a view that reaches no farther than
    that ground, and a UAV that hovers from then on misses nothing.
    """
    kind, sides, numbers, open_ground = _checked(law, shape, obstacles, clear)
    scenes = Whole(1).coerce("scenes", scenes, {})
    seed = Whole(0).coerce("seed", seed, {})
    words = [list(SceneLaw).index(kind), *sides, *numbers, open_ground, seed]
    found = []
    for k in range(scenes):
        stream = np.random.SeedSequence(words, spawn_key=(_DRAWN, k))
        found.append(_draw(kind, sides, numbers, open_ground, np.random.default_rng(stream)))
    return SceneArrays(*map(np.array, zip(*found, strict=True))).pose(**fields)


def draw_scene_arrays(
    law: SceneLaw | str,
    shape: ArrayLike,
    obstacles: ArrayLike,
    scenes: int,
    generator: np.random.Generator,
    *,
    clear: int | None = None,
) -> SceneArrays:
    """Return scenes of the same laws as arrays, drawn from a generator, such as :func:`training_generator`.

    The parameters are those of :func:`draw_scenes`.
    """
    kind, sides, numbers, open_ground = _checked(law, shape, obstacles, clear)
    required("generator", generator, np.random.Generator)
    scenes = Whole(1).coerce("scenes", scenes, {})
    found = [_draw(kind, sides, numbers, open_ground, generator) for _ in range(scenes)]
    return SceneArrays(*map(np.array, zip(*found, strict=True)))


def training_generator(seed: int = 0) -> np.random.Generator:
    """Return a generator of scenes to learn from, whose stream is none that :func:`draw_scenes` uses."""
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
        kept = np.zeros(sides, bool)
        kept[max(row - clear, 0) : row + clear + 1, max(column - clear, 0) : column + clear + 1] = 1
        kept[r, c] = True
        blocked = np.zeros(sides, bool)
        number = int(rng.integers(numbers[0], numbers[1] + 1))
        if not all(_place(law, blocked, kept, rng) for _ in range(number)):
            continue
        if has_way(blocked, (r, c), (row, column)):
            return blocked, [r, c], [row, column]
    raise InvalidData(
        f"obstacles must leave room for a way, got {numbers[0]} to {numbers[1]} of the law {law} on "
        f"{sides[0]} × {sides[1]} cells: none in {_TRIES} scenes",
        field="obstacles",
    )


def _place(law: SceneLaw, blocked: Truths, kept: Truths, rng: np.random.Generator) -> bool:
    """Put an obstacle on a map, off the cells that are `kept`; return whether there was a place."""
    sides = blocked.shape
    for _ in range(_PLACES):
        form = law
        if law is SceneLaw.MIXED:
            form = list(SceneLaw)[rng.integers(0, 4)]
        cells = _FORMS[form](sides, rng)
        at = rng.integers(0, np.subtract(sides, cells.shape) + 1).tolist()
        here = slice(at[0], at[0] + cells.shape[0]), slice(at[1], at[1] + cells.shape[1])
        if not (kept[here] & cells).any():
            blocked[here] |= cells
            return True
    return False


def _length(
    side: int, low: tuple[int, int], high: tuple[int, int], rng: np.random.Generator
) -> int:
    """Return a whole number of cells between two shares of a side, which are fractions."""
    least = -(-low[0] * side // low[1])
    return int(rng.integers(least, max(high[0] * side // high[1], least) + 1))


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
