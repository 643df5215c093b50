"""The picture of runs on unknown grids: the walk on the true map, and how it came about step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots.options import check_list, check_option, check_size, is_whole
from ..plots.style import (
    DARK,
    GREY,
    axis_style,
    bare,
    headline,
    key,
    legend_below,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .animation import animate_run
from .drawn import (
    Box,
    Moment,
    Walk,
    box_around,
    check_scene,
    draw_cells,
    draw_collisions,
    draw_ends,
    keys_of,
    paint,
    walk_of,
)
from .layout import Layout, Place, arrange, is_square
from .model import UnknownGridNavigation
from .plan import NavigationRuns, Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_run", "draw"]

Floats = NDArray[np.float64]

#: Plans beside the first at the most, and the colours of all; the second colour is the UAV's.
_MOST_OTHERS = 5
_COLOURS = (0, 2, 3, 4, 5, 6)
#: Moments at the most.
_MOST_MOMENTS = 24
#: The shortest ways are drawn where all maps together have at most so many cells.
_MOST_CELLS = 10**6
#: Letters of a line of the legend on an inch of the figure.
_LETTERS = 14.0
#: Width of the sheet (inch).
_BROAD = 8.6
_SHORTEST: dict[str, Any] = {"color": GREY, "lw": 1.2, "ls": ":"}


class _Named(NamedTuple):
    """A plan, its name, how it looks, and its run in the scene that is drawn."""

    name: str
    look: dict[str, Any]
    plan: NavigationRuns
    found: Verification
    walk: Walk


def draw(
    model: UnknownGridNavigation,
    plan: NavigationRuns | None = None,
    *,
    scene: int = 0,
    moments: Any = 6,
    others: Mapping[str, Any] | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the run of one scene on its true map, and what was known of it on the way.

    What the UAV has not shown is tinted; the frame is its view. Of maps of more than 60 cells along a side the
    moments show the part around the vehicle. Where there are several scenes, a panel tells in how many the
    target was reached within how many steps.

    Parameters
    ----------
    model : UnknownGridNavigation
        The model, with its true maps.
    plan : NavigationRuns, optional
        A plan for it, valid or not; None draws the map only.
    scene : int
        Which scene.
    moments : int or list of int
        How many moments of the run are shown, 0 to 24, or after which numbers of steps.
    others : dict of str to plan, optional
        Up to 5 further plans by what the legend calls them: plans, their JSON data or solutions.
    tolerance : float
        Largest violation accepted, relative, for what the title says.
    title : str, optional
        Instead of the name and how the run ended.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The map, the moments in their order, and the panel over scenes.

    Raises
    ------
    HiddenData
        The model is as backends see it, without its true maps.
    InvalidData
        A plan is none of this model.
    UnsupportedOption
        An option has a value that is not allowed.

    See Also
    --------
    animate_run : The same in motion.
    """
    check_tolerance(tolerance)
    scene = check_scene(model, scene)
    named = {} if others is None else others
    good = isinstance(named, Mapping) and all(isinstance(name, str) for name in named)
    few = good and len(named) <= _MOST_OTHERS
    check_option("others", others, few, f"be at most {_MOST_OTHERS} plans by their names")
    runs: list[_Named] = []
    given = [] if plan is None else [("run", plan)]
    # The first colour is that of the plan, drawn or not.
    colours = _COLOURS if plan is not None else _COLOURS[1:]
    for (name, value), colour in zip([*given, *named.items()], colours, strict=False):
        one = required("plan", model.as_plan(value), NavigationRuns)
        found = model.verify(one, tolerance=tolerance)
        runs.append(_Named(name, axis_style(colour), one, found, walk_of(model, one, scene)))
    main = None if plan is None else runs[0]
    chosen = _moments(moments, main)
    shortest = model.fewest_steps() if model.blocked.size <= _MOST_CELLS else None
    text = _title(model, scene, main, shortest) if title is None else title
    several = model.scenes > 1 and bool(runs)
    keys = _keys(runs, main, moving=bool(chosen), several=several)
    if several and shortest is not None:
        keys.append(key("shortest ways", **_SHORTEST))
    broad, tall = (_BROAD, None) if size is None else check_size(size, (0, 0))
    letters = sum(6 + len(one.get_label()) for one in keys)
    rows = min(len(keys), 1 + int(letters / (_LETTERS * broad)))
    layout = arrange(
        (broad, tall), Box(model.starts[scene], model.shape), box_around(model, model.starts[scene]),
        len(chosen), head=1 + text.count("\n"), foot=rows, panel=several,
    )  # fmt: skip
    figure = sheet(size, layout.size)
    axes = figure.add_axes(layout.map.share(layout.size))
    _draw_map(axes, model, scene, runs, main, layout.map)
    _draw_moments(figure, model, scene, main, chosen, layout)
    if layout.panel is not None:
        _draw_scenes(figure.add_axes(layout.panel.share(layout.size)), model, runs, shortest)
    legend_below(figure, keys, rows=rows)
    headline(figure, text, wrong=main is not None and not main.found.ok)
    return figure


def _moments(asked: Any, main: _Named | None) -> list[int]:
    """Return after how many steps moments are shown, in rising order."""
    last = 0 if main is None else main.walk.steps
    if is_whole(asked, 0, _MOST_MOMENTS):
        if main is None or not asked:
            return []
        found: list[int] = np.unique(np.linspace(0, last, asked).round().astype(int)).tolist()
        return found
    allowed = f"be a whole number from 0 to {_MOST_MOMENTS}, or as many different numbers of steps from 0 to {last}"
    listed = check_list(
        "moments", asked, lambda one: is_whole(one, 0, last), allowed, most=_MOST_MOMENTS
    )
    return sorted(map(int, listed)) if main is not None else []


# -- parts ---------------------------------------------------------------------------------------


def _draw_map(
    axes: Any, model: UnknownGridNavigation, scene: int, runs: Sequence[_Named], main: _Named | None,
    place: Place,
) -> None:  # fmt: skip
    """Draw the true map, and the walks of all runs on it."""
    from matplotlib.ticker import MaxNLocator

    whole = Box(np.zeros(2, np.int64), model.shape)
    blocked = model.blocked[scene]
    seen = np.ones_like(blocked) if main is None else main.walk.seen <= main.walk.steps
    draw_cells(axes, paint(blocked, seen), whole)
    axes.set_aspect("equal" if is_square(whole) else "auto")
    axes.tick_params(labelsize=8, length=2)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator("auto", integer=True, min_n_ticks=1))
    axes.set_xlabel("column", fontsize=8.5)
    axes.set_ylabel("row", fontsize=8.5)
    size = max(6.0, _marker(place, whole))
    if main is not None:
        axes.set_title("the whole run", fontsize=8, pad=3, color=DARK)
        draw_collisions(axes, main.walk.hits, size, clip_on=False)
    for k, one in reversed(list(enumerate(runs))):
        # Ways through the same cells lie beside one another.
        shift = 0.14 * (-1) ** k * -(-k // 2)
        axes.plot(
            *(one.walk.positions[:, ::-1].T + shift), lw=max(1.0, 0.22 * size), zorder=6 - 0.1 * k,
            solid_capstyle="round", gid="other way" if k or main is None else "way", **one.look,
        )  # fmt: skip
    draw_ends(axes, model, scene, size, clip_on=False)


def _draw_moments(
    figure: Figure, model: UnknownGridNavigation, scene: int, main: _Named | None,
    chosen: Sequence[int], layout: Layout,
) -> None:  # fmt: skip
    """Draw what the first run had come to after some numbers of steps."""
    if main is None:
        return
    part = box_around(model, model.starts[scene])
    for step, place in zip(chosen, layout.moments, strict=True):
        axes = figure.add_axes(place.share(layout.size))
        Moment(axes, model, scene, main.walk, _marker(place, part)).show(step)
        axes.set_aspect("equal" if is_square(part) else "auto")
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_title(f"step {step}", fontsize=8, pad=3, color=DARK)


def _marker(place: Place, box: Box) -> float:
    """Return the size of markers (point) that a cell is large enough for."""
    return float(np.clip(0.62 * 72 * place.tall / float(box.size[0]), 3.5, 8.0))


def _draw_scenes(
    axes: Any, model: UnknownGridNavigation, runs: Sequence[_Named], shortest: Floats | None
) -> None:
    """Draw in what share of the scenes the target was reached within how many steps."""
    lines = [
        (
            [len(run) for run, how in zip(one.plan.actions, one.plan.outcomes, strict=True)
             if how is Outcome.REACHED],
            {**one.look, "lw": 1.8 if k == 0 else 1.3, "zorder": 6 - 0.1 * k, "gid": "reached"},
        )
        for k, one in enumerate(runs)
    ]  # fmt: skip
    if shortest is not None:
        lines.append((shortest.tolist(), {**_SHORTEST, "gid": "shortest"}))
    last = model.steps
    for counts, look in lines:
        steps = np.sort([one for one in counts if one <= last])
        share = 100.0 * np.arange(len(steps) + 1) / model.scenes
        axes.step(
            np.concatenate([[0], steps, [last]]), np.append(share, share[-1]), where="post", **look
        )
    bare(axes)
    axes.set_xlim(0, last)
    axes.set_ylim(0, 103)
    axes.set_xlabel("within steps", fontsize=8.5)
    axes.set_ylabel("scenes reached (%)", fontsize=8.5)


# -- words ---------------------------------------------------------------------------------------


def _title(
    model: UnknownGridNavigation, scene: int, main: _Named | None, shortest: Floats | None
) -> str:
    if main is None:
        parts = [model.describe()]
        if model.scenes > 1:
            parts.append(f"here scene {scene}")
        return title_of(model.name, parts, None)
    walk = main.walk
    told = walk.describe()
    if shortest is not None:
        fewest = shortest[scene]
        told += f", at best {fewest:.0f}" if np.isfinite(fewest) else ", there is no way"
    if model.scenes == 1:
        return title_of(model.name, [told], main.found)
    cost = main.found.objective
    parts = [f"scene {scene} of {model.scenes}: {told}; {number(main.plan.success, 4)} % reached"]
    if cost is not None:
        parts.append(f"mean cost {number(cost, 4)} steps")
    return title_of(model.name, parts, main.found)


def _keys(runs: Sequence[_Named], main: _Named | None, *, moving: bool, several: bool) -> list[Any]:
    """Return the entries of the legend: what the map shows, and the runs."""
    keys = keys_of(None if main is None else main.walk, moving=moving)
    alone = len(runs) == 1 and main is not None
    for one in runs:
        words = one.name if alone else f"{one.name}: {one.walk.describe()}"
        if several and not alone:
            words += f"; {number(one.plan.success, 4)} % reached"
        wrong = "" if alone or one.found.ok else ", NOT VALID"
        keys.append(key(words + wrong, lw=1.8, **one.look))
    return keys
