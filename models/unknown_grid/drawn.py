"""Parts of plots and animations of runs: cells, walks, markers, and the layout of a figure in inches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..plots import kit
from .checks import replay
from .moving import obstacle_tracks
from .plan import LETTERS, MOVES, NavigationRuns, Outcome
from .scenes import Aspect, aspects_of
from .sight import first_seen, uav_cells, wrong_readings

if TYPE_CHECKING:
    from .model import UnknownGridNavigation

__all__ = [
    "Box", "Layout", "Moment", "Place", "Walk", "arrange", "box_around", "check_scene", "draw_cells",
    "draw_collisions", "draw_ends", "is_square", "keys_of", "paint", "proportion", "walk_of",
]  # fmt: skip

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Colours of free and blocked cells, after and before the UAV has shown them, and of lines.
SEEN, WALL, HIDDEN, HIDDEN_WALL, LINES = "#ffffff", "#4d4d4d", "#dbe0e8", "#a9b3c3", "#9a9a9a"
_SHADES = np.array(
    [list(bytes.fromhex(code[1:] + "ff")) for code in (SEEN, WALL, HIDDEN, HIDDEN_WALL)], np.uint8
)
#: Colours of the vehicle, and of the UAV and the edge of its view.
VEHICLE, UAV = kit.colour_of(0), kit.colour_of(1)
#: Colour of moving obstacles and of wrong readings.
OTHER = "#8c2d04"
#: Maximum number of cells along a side with lines between them.
_MOST_LINES = 60
#: Maximum number of cells along a side that a moment draws one by one.
_MOST_PIXELS = 400
#: Minimum number of cells along a side of the part of a large map that a moment shows.
_PART = 41
#: Lengths in inches: outer margin, gap between moments, tick labels of rows and of columns, caption above
#: a map, line of a title or a legend, and height of the panel of scenes.
_MARGIN, _GAP, _ROWS, _COLUMNS, _WORDS, _LINE, _SCENES = 0.2, 0.12, 0.5, 0.48, 0.24, 0.17, 1.5
#: Height of the map divided by the width of the sheet.
_MAP = 0.42
#: Limits on the ratio of width to height of a drawn map.
_NARROWEST, _BROADEST = 0.2, 12.0
#: Ratio of width to height above which the moments are placed below the map.
_BROAD = 1.35


class Walk(NamedTuple):
    """Run of n actions of one scene on its true map; all positions are rows and columns.

    `positions` and `uav` have the shape (n + 1, 2), `hits` are the edges that the vehicle ran into in the actions
    `hit_after`, counted from 1, and `seen` is the number of actions before each cell was first seen; n + 1 if it
    was never seen. `outcome` is that of the plan. `others`, shape (m, n + 1, 2), are the moving obstacles,
    and `noisy` is true if readings may be wrong.
    """

    positions: Ints
    hits: kit.Floats
    hit_after: Ints
    uav: Ints
    seen: Ints
    outcome: Outcome
    others: Ints
    noisy: bool

    @property
    def steps(self) -> int:
        """Number of actions."""
        return len(self.positions) - 1

    @property
    def hovers_after(self) -> int:
        """Number of actions before the UAV stayed behind; `steps` + 1 if it never did."""
        behind = (self.positions != self.uav).any(axis=1)
        return int(behind.argmax()) if behind.any() else len(self.positions)

    def describe(self) -> str:
        """Return a summary such as ``"reached after 12 steps, 1 collision"``."""
        hits = f", {kit.many(len(self.hits), 'collision')}" if len(self.hits) else ""
        return f"{self.outcome} after {kit.many(self.steps, 'step')}{hits}"


def walk_of(model: UnknownGridNavigation, plan: NavigationRuns, scene: int) -> Walk:
    """Return the positions, collisions and cells seen of the run in one scene."""
    actions = plan.actions[scene]
    row, column = model.starts[scene].tolist()
    tracks = obstacle_tracks(model)[scene]
    positions, collided = replay(
        model.blocked[scene], (row, column), actions, model.corners, tracks
    )
    uav = uav_cells(model, scene, positions)
    moves = np.array([MOVES[LETTERS.index(letter)] for letter in actions]).reshape(-1, 2)
    return Walk(
        positions, positions[:-1][collided] + 0.5 * moves[collided], np.flatnonzero(collided) + 1,
        uav, first_seen(model, scene, positions, uav),
        plan.outcomes[scene], tracks[:, np.minimum(np.arange(len(actions) + 1), model.steps)],
        Aspect.NOISE in aspects_of(model),
    )  # fmt: skip


def check_scene(model: UnknownGridNavigation, scene: Any) -> int:
    """Return the index of the scene to draw, or raise if it is out of range."""
    last = model.scenes - 1
    allowed = f"be the number of a scene, from 0 to {last}" if last else "be 0, the only scene"
    kit.check_option("scene", scene, kit.is_whole(scene, 0, last), allowed)
    return int(scene)


def paint(blocked: Truths, seen: Truths) -> NDArray[np.uint8]:
    """Return an RGBA image of cells, from masks of blocked cells and of those the UAV has shown."""
    return np.take(_SHADES, blocked | (~seen).view(np.uint8) << 1, axis=0)


class Box(NamedTuple):
    """Rectangular part of a map: first row and column, and numbers of rows and columns."""

    low: Ints
    size: Ints

    @property
    def part(self) -> tuple[slice, slice]:
        """Index of the part in arrays of the map."""
        (row, column), (rows, columns) = self.low.tolist(), self.size.tolist()
        return slice(row, row + rows), slice(column, column + columns)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of an image with row 0 on top."""
        (top, left), (bottom, right) = self.low - 0.5, self.low + self.size - 0.5
        return float(left), float(right), float(bottom), float(top)


def box_around(model: UnknownGridNavigation, cell: Ints) -> Box:
    """Return the part of the map that a moment shows: all of it, or the surroundings of `cell`."""
    smallest = np.maximum(_PART, 2 * model.view + 1)
    size = np.where(model.shape <= _MOST_LINES, model.shape, np.minimum(model.shape, smallest))
    return Box(np.clip(cell - size // 2, 0, model.shape - size), size)


def draw_cells(axes: Any, image: NDArray[np.uint8], box: Box) -> Any:
    """Draw an image of the cells in `box`, row 0 on top, and return the artist."""
    artist = axes.imshow(
        image, extent=box.extent, zorder=0.5, gid="cells", aspect="auto",
        interpolation="none" if max(image.shape) <= 500 else "auto",
    )  # fmt: skip
    draw_grid(axes, box)
    for side in axes.spines.values():
        side.set_color(LINES)
    return artist


def draw_grid(axes: Any, box: Box) -> None:
    """Replace the lines between the cells, none for large boxes, and show the box."""
    for lines in [artist for artist in axes.collections if artist.get_gid() == "lines"]:
        lines.remove()
    left, right, bottom, top = box.extent
    if box.size.max() <= _MOST_LINES:
        look: dict[str, Any] = {"color": LINES, "lw": 0.3, "zorder": 0.6, "gid": "lines"}
        axes.vlines(np.arange(left, right + 1), top, bottom, **look)
        axes.hlines(np.arange(top, bottom + 1), left, right, **look)
    axes.axis(box.extent)


def draw_ends(
    axes: Any, model: UnknownGridNavigation, scene: int, size: float, **look: Any
) -> None:
    """Draw start and target as markers of `size` points; `look` applies to both."""
    target, start = model.targets[scene][None, ::-1], model.starts[scene][None, ::-1]
    look = {"edge": kit.BLACK, "width": 0.9, **look}
    kit.dots(axes, target, "*", "white", size=(1.5 * size) ** 2, zorder=8, gid="target", **look)
    kit.dots(axes, start, "s", "white", size=(0.8 * size) ** 2, zorder=7, gid="start", **look)


def draw_collisions(axes: Any, hits: kit.Floats, size: float, **look: Any) -> Any:
    """Draw the collisions and return the artist of their markers."""
    look = {"mec": kit.RED, "mew": 1.5, "ms": 0.8 * size, **look}
    return axes.plot(*hits[:, ::-1].T, "x", zorder=9, gid="collision", **look)[0]


class Moment:
    """Drawing of one moment of a run: cells seen, path, vehicle and UAV, with markers of `size` points."""

    def __init__(
        self, axes: Any, model: UnknownGridNavigation, scene: int, walk: Walk, size: float
    ) -> None:
        from matplotlib.patches import Rectangle

        self.axes, self.model, self.walk = axes, model, walk
        self._blocked, self._scene = model.blocked[scene], scene
        self._image: Any = None
        axes.set_xticks([])
        axes.set_yticks([])
        # Markers at the edge of the map stay whole; those outside the visible part are clipped.
        part = box_around(model, walk.positions[0]).size
        clip: dict[str, Any] = {"clip_on": bool((part < model.shape).any())}
        draw_ends(axes, model, scene, size, **clip)
        self._hits = draw_collisions(axes, np.empty((0, 2)), size, **clip)
        line = {"lw": max(1.0, 0.2 * size), "solid_capstyle": "round"}
        vehicle: dict[str, Any] = {"mfc": VEHICLE, "mec": "white", "mew": 0.6, "ms": 0.9 * size}
        uav: dict[str, Any] = {"mfc": "none", "mec": UAV, "mew": 1.4, "ms": 1.1 * size}
        self._way, self._vehicle, self._uav = (
            axes.plot([], [], marks, zorder=zorder, gid=gid, **look)[0]
            for marks, zorder, gid, look in (
                ("-", 5, "way", {"color": VEHICLE, **line}),
                ("o", 10, "vehicle", vehicle | clip),
                ("D", 11, "UAV", uav | clip),
            )
        )
        square: dict[str, Any] = {"mfc": OTHER, "mec": "white", "mew": 0.6, "ms": 0.9 * size}
        self._others = axes.plot([], [], "s", zorder=4, gid="moving", **square, **clip)[0]
        wrong: dict[str, Any] = {"mec": OTHER, "mew": 1.0, "ms": 0.5 * size}
        self._wrong = axes.plot([], [], "+", zorder=3, gid="wrong", **wrong, **clip)[0]
        view = Rectangle((0, 0), 0, 0, fc="none", ec=UAV, lw=1.4, zorder=6, gid="view")
        self._view = axes.add_patch(view)

    def show(self, step: int) -> None:
        """Show the run after `step` actions."""
        walk, box = self.walk, box_around(self.model, self.walk.positions[step])
        # A subset of the cells suffices if they are too small to distinguish.
        stride = (slice(None, None, 1 + int(box.size.max()) // _MOST_PIXELS),) * 2
        image = paint(self._blocked[box.part][stride], walk.seen[box.part][stride] <= step)
        if self._image is None:
            self._image = draw_cells(self.axes, image, box)
        else:
            self._image.set(data=image, extent=box.extent)
            draw_grid(self.axes, box)
        self._way.set_data(*walk.positions[: step + 1, ::-1].T)
        self._hits.set_data(*walk.hits[walk.hit_after <= step, ::-1].T)
        self._others.set_data(*walk.others[:, step, ::-1].T)
        uav = walk.uav[step]
        wrong = wrong_readings(
            self.model, self._scene, walk.positions[step], uav, walk.others[:, step], step
        )
        self._wrong.set_data(*wrong[:, ::-1].T)
        self._vehicle.set_data(*walk.positions[[step], ::-1].T)
        self._uav.set_data(*walk.uav[[step], ::-1].T)
        rows, columns = self.model.view.tolist()
        row, column = uav.tolist()
        self._view.set_bounds(column - 0.5 * columns, row - 0.5 * rows, columns, rows)
        self._view.set_linestyle("--" if step >= walk.hovers_after else "-")


def keys_of(walk: Walk | None, *, moving: bool) -> list[Any]:
    """Return the legend entries of the cells, of the collisions and, if `moving`, of the vehicles."""
    keys = [
        kit.key("start", marker="s", mfc="white", mec=kit.BLACK, ms=5),
        kit.key("target", marker="*", mfc="white", mec=kit.BLACK, ms=9),
        kit.key("obstacle", marker="s", mfc=WALL, mec=WALL, ms=7),
    ]
    if walk is None:
        return keys
    keys.append(kit.key("not seen: free", marker="s", mfc=HIDDEN, mec=LINES, mew=0.4, ms=7))
    keys.append(kit.key("not seen: obstacle", marker="s", mfc=HIDDEN_WALL, mec=HIDDEN_WALL, ms=7))
    if moving:
        keys.append(kit.key("vehicle", marker="o", mfc=VEHICLE, mec="white", ms=6))
        keys.append(kit.key("UAV and its view", marker="D", mfc="none", mec=UAV, mew=1.4, ms=6))
        hovers = walk.hovers_after <= walk.steps
        keys += [kit.key("the UAV hovers", color=UAV, lw=1.4, ls="--")] * hovers
        square = kit.key("moving obstacle", marker="s", mfc=OTHER, mec="white", ms=6)
        keys += [square] * bool(len(walk.others))
        keys += [kit.key("wrong reading", marker="+", mec=OTHER, ms=5)] * walk.noisy
    keys += [kit.key("collision", marker="x", mec=kit.RED, mew=1.6, ms=5)] * bool(len(walk.hits))
    return keys


# -- the layout ------------------------------------------------------------------------------------


class Place(NamedTuple):
    """Rectangle on a sheet: distances from the left and upper edges, width and height."""

    left: float
    top: float
    broad: float
    tall: float


class Layout(NamedTuple):
    """Size of a sheet, and the rectangles of the map, the moments and the panel of scenes."""

    size: tuple[float, float]
    map: Place
    moments: list[Place]
    panel: Place | None


def proportion(box: Box) -> float:
    """Return the ratio of width to height of a part of a map as drawn."""
    rows, columns = box.size.tolist()
    return float(np.clip(columns / rows, _NARROWEST, _BROADEST))


def is_square(box: Box) -> bool:
    """Return whether the cells of a part of a map appear as squares."""
    rows, columns = box.size.tolist()
    return bool(proportion(box) == columns / rows)


def arrange(
    size: tuple[float, float | None], whole: Box, part: Box, count: int, *, head: int, foot: int,
    panel: bool,
) -> Layout:  # fmt: skip
    """Return the layout of the map, its `count` moments and the panel of scenes.

    `size` is width and height of the sheet, None computes the height. The map shows the part `whole`, each moment
    `part`. `head` and `foot` are the numbers of lines of the title and of the legend.
    """
    broad, limit = size
    words = (broad, head, foot)
    for share in np.linspace(_MAP, 0.05, 1 if limit is None else 40):
        layout = _arranged(words, whole, part, count, share=float(share), panel=panel)
        if limit is None or layout.size[1] <= limit:
            break
    return layout if limit is None else layout._replace(size=(broad, limit))


def _arranged(
    words: tuple[float, int, int], whole: Box, part: Box, count: int, *, share: float, panel: bool
) -> Layout:
    """Return the layout with a map of at most `share` of the width in height."""
    broad, head, foot = words
    top = 0.2 + _LINE * head + _WORDS
    room = broad - 2 * _MARGIN - _ROWS
    ratio = proportion(whole)
    beside = ratio <= _BROAD and count > 0
    wide = min(share * broad * ratio, 0.52 * broad if beside else room)
    tall = wide / ratio
    left = _MARGIN + _ROWS + (0.0 if beside else (room - wide) / 2)
    first = Place(left, top, wide, tall)
    bottom = top + tall + _COLUMNS
    area = Place(_MARGIN, bottom + _WORDS, broad - 2 * _MARGIN, share * broad)
    if beside:
        right = left + wide + 0.2
        area = Place(right, top, broad - _MARGIN - right, tall)
    moments = _tiles(area, count, proportion(part)) if count else []
    if moments:
        shift = 0.5 * (broad - _MARGIN - max(tile.left + tile.broad for tile in moments))
        moments = [tile._replace(left=tile.left + shift) for tile in moments]
        first = first._replace(left=first.left + shift * beside)
    bottom = max([bottom, *(tile.top + tile.tall + _GAP for tile in moments)])
    scenes = Place(0.75, bottom + 0.1, broad - 1.0, _SCENES) if panel else None
    if scenes is not None:
        bottom += 0.1 + _SCENES + _COLUMNS
    return Layout((broad, bottom + 0.12 + _LINE * foot), first, moments, scenes)


def _tiles(area: Place, count: int, ratio: float) -> list[Place]:
    """Return rectangles of equal, maximum size, each with a caption above."""
    best = (0.0, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        tall = (area.tall + _WORDS) / rows - _WORDS - _GAP
        best = max(best, (min((area.broad + _GAP) / columns - _GAP, tall * ratio), columns))
    wide, columns = best
    tall = wide / ratio
    cells = (divmod(k, columns) for k in range(count))
    return [
        Place(area.left + k * (wide + _GAP), area.top + row * (tall + _WORDS + _GAP), wide, tall)
        for row, k in cells
    ]
