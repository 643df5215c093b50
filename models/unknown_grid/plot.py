"""Plot of runs on unknown grids: the path on the true map, and moments of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..fields import required
from ..plots import kit
from ..verification import Verification
from . import drawn
from .drawn import Box, Moment, Place, Walk, box_around, check_scene, is_square, keys_of, walk_of
from .model import UnknownGridNavigation
from .plan import NavigationRuns, Outcome

__all__ = ["animate_run", "draw"]

#: Maximum number of plans beside the first, and colours of all plans. Colour 1 is the UAV's.
_MOST_OTHERS = 5
_COLOURS = (0, 2, 3, 4, 5, 6)
#: Maximum number of moments.
_MOST_MOMENTS = 24
#: Maximum number of cells of all maps for which shortest paths are computed.
_MOST_CELLS = 10**6
#: Width of the sheet, inches.
_BROAD = 8.6
_SHORTEST: dict[str, Any] = {"color": kit.GREY, "lw": 1.2, "ls": ":"}


class _Run(NamedTuple):
    """Plan with its name, style, verification, and walk in the scene drawn."""

    name: str
    look: dict[str, Any]
    plan: NavigationRuns
    result: Verification
    walk: Walk


@kit.documented
def draw(
    model: UnknownGridNavigation,
    plan: NavigationRuns | None = None,
    *,
    scene: int = 0,
    moments: Any = 6,
    others: Mapping[str, Any] | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the run of one scene on its true map, and moments of the run with the cells seen so far.

    Cells that the UAV has not shown are tinted. A frame marks its view. If a side of the map has more than
    60 cells, the moments show only the part around the vehicle. If the model has several scenes, a panel
    shows the share of scenes reached against the number of steps. :func:`animate_run` animates the run.
    Both raise :class:`HiddenData` for a backend's view of the model, without the true maps.

    Parameters
    ----------
    plan : NavigationRuns, optional
        Plan of the model, valid or not. None draws the map only.
    scene : int, default 0
        Index of the scene.
    moments : int or list of int, default 6
        Number of moments, from 0 to 24, or the numbers of steps after which moments are drawn.
    others : dict of str to plan, optional
        At most 5 further plans, their JSON data or solutions. The keys are the names in the legend.
    """
    scene = check_scene(model, scene)
    plans = kit.name_plans(
        model, plan, others, NavigationRuns, name="run", most=_MOST_OTHERS, tolerance=tolerance
    )
    # The first colour is reserved for `plan`.
    looks = map(kit.axis_style, _COLOURS if plan is not None else _COLOURS[1:])
    runs = [
        _Run(name, look, entry, result, walk_of(model, entry, scene))
        for (name, entry, result), look in zip(plans, looks, strict=False)
    ]
    main = None if plan is None else runs[0]
    chosen = _moments(moments, main)
    shortest = model.fewest_steps() if model.blocked.size <= _MOST_CELLS else None
    result = None if main is None else main.result
    text = kit.title_of(model, _words(model, scene, main, shortest), result, title)
    several = model.scenes > 1 and bool(runs)
    keys = _keys(runs, main, moving=bool(chosen), several=several)
    keys += [kit.key("shortest ways", **_SHORTEST)] * (several and shortest is not None)
    broad, tall = (_BROAD, None) if size is None else kit.check_size(size, (0, 0))
    part = box_around(model, model.starts[scene])
    rows = kit.legend_rows(keys, broad)
    layout = drawn.arrange(
        (broad, tall), Box(model.starts[scene], model.shape), part, len(chosen),
        head=1 + text.count("\n"), foot=rows, panel=several,
    )  # fmt: skip
    sheet = kit.Scene(text, result, size, layout.size)
    axes = _axes(sheet, layout.map)
    _draw_map(axes, model, scene, runs, main, layout.map)
    if main is not None:
        # Every check judges the end of a run.
        end = main.walk.positions[-1, ::-1]
        kit.pin_places(axes, result, {f"scene {scene}": end})
    for step, place in zip(chosen, layout.moments, strict=True):
        assert main is not None
        axes = _axes(sheet, place)
        Moment(axes, model, scene, main.walk, _marker(place, part)).show(step)
        axes.set_aspect("equal" if is_square(part) else "auto")
        axes.set_title(f"step {step}", fontsize=8, pad=3, color=kit.DARK)
    if layout.panel is not None:
        _draw_scenes(_axes(sheet, layout.panel), model, runs, shortest)
    sheet.legend(keys, rows)
    return sheet.figure


def _moments(option: Any, main: _Run | None) -> list[int]:
    """Return the numbers of steps after which moments are drawn, in ascending order."""
    last = 0 if main is None else main.walk.steps
    if kit.is_whole(option, 0, _MOST_MOMENTS):
        if main is None or not option:
            return []
        steps: list[int] = np.unique(np.linspace(0, last, option).round().astype(int)).tolist()
        return steps
    allowed = f"be a whole number from 0 to {_MOST_MOMENTS}, or as many different numbers of steps from 0 to {last}"
    listed = kit.check_list(
        "moments", option, lambda step: kit.is_whole(step, 0, last), allowed, most=_MOST_MOMENTS
    )
    return sorted(map(int, listed)) if main is not None else []


def _axes(sheet: kit.Frame, place: Place) -> Any:
    low = sheet.tall - place.top - place.tall
    return sheet.box(place.left, low, place.broad, place.tall)


def _draw_map(
    axes: Any, model: UnknownGridNavigation, scene: int, runs: Sequence[_Run], main: _Run | None,
    place: Place,
) -> None:  # fmt: skip
    """Draw the true map and the paths of all runs."""
    from matplotlib.ticker import MaxNLocator

    whole = Box(np.zeros(2, np.int64), model.shape)
    blocked = model.blocked[scene]
    seen = np.ones_like(blocked) if main is None else main.walk.seen <= main.walk.steps
    drawn.draw_cells(axes, drawn.paint(blocked, seen), whole)
    axes.set_aspect("equal" if is_square(whole) else "auto")
    axes.tick_params(labelsize=8, length=2)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator("auto", integer=True, min_n_ticks=1))
    kit.label_axes(axes, "column (index)", "row (index, downward)")
    size = max(6.0, _marker(place, whole))
    for track in () if main is None else main.walk.others:
        axes.plot(
            *track[:, ::-1].T, "-", lw=1.0, color=drawn.OTHER, alpha=0.6, zorder=3, gid="track"
        )
    if main is not None:
        axes.set_title("the whole run", fontsize=8, pad=3, color=kit.DARK)
        drawn.draw_collisions(axes, main.walk.hits, size, clip_on=False)
    for k, run in reversed(list(enumerate(runs))):
        # An offset separates paths through the same cells.
        shift = 0.14 * (-1) ** k * -(-k // 2)
        axes.plot(
            *(run.walk.positions[:, ::-1].T + shift), lw=max(1.0, 0.22 * size), zorder=6 - 0.1 * k,
            solid_capstyle="round", gid="other way" if k or main is None else "way", **run.look,
        )  # fmt: skip
    drawn.draw_ends(axes, model, scene, size, clip_on=False)


def _marker(place: Place, box: Box) -> float:
    """Return the size of markers that fits into a cell, points."""
    return float(np.clip(0.62 * 72 * place.tall / float(box.size[0]), 3.5, 8.0))


def _draw_scenes(
    axes: Any, model: UnknownGridNavigation, runs: Sequence[_Run], shortest: kit.Floats | None
) -> None:
    """Draw the share of scenes reached within each number of steps."""
    lines = [
        (
            [len(run) for run, end in zip(entry.plan.actions, entry.plan.outcomes, strict=True)
             if end is Outcome.REACHED],
            {**entry.look, "lw": 1.8 if k == 0 else 1.3, "zorder": 6 - 0.1 * k, "gid": "reached"},
        )
        for k, entry in enumerate(runs)
    ]  # fmt: skip
    if shortest is not None:
        lines.append((shortest.tolist(), {**_SHORTEST, "gid": "shortest"}))
    last = model.steps
    for counts, look in lines:
        steps = np.sort([count for count in counts if count <= last])
        share = 100.0 * np.arange(len(steps) + 1) / model.scenes
        axes.step(
            np.concatenate([[0], steps, [last]]), np.append(share, share[-1]), where="post", **look
        )
    kit.bare(axes)
    axes.set_xlim(0, last)
    axes.set_ylim(0, 103)
    kit.label_axes(axes, "within (steps)", "scenes reached (%)")


def _words(
    model: UnknownGridNavigation, scene: int, main: _Run | None, shortest: kit.Floats | None
) -> list[str]:
    """Return the parts of the title."""
    if main is None:
        return [model.describe()] + [f"here scene {scene}"] * (model.scenes > 1)
    text = main.walk.describe()
    if shortest is not None:
        fewest = shortest[scene]
        text += f", at best {fewest:.0f}" if np.isfinite(fewest) else ", there is no way"
    if model.scenes == 1:
        return [text]
    cost = main.result.objective
    share = f"{kit.number(main.plan.success, 4)} % reached"
    parts = [f"scene {scene} of {model.scenes}: {text}; {share}"]
    return parts if cost is None else [*parts, f"mean cost {kit.number(cost, 4)} steps"]


def _keys(runs: Sequence[_Run], main: _Run | None, *, moving: bool, several: bool) -> list[Any]:
    """Return the legend entries of the map and the runs."""
    keys = keys_of(None if main is None else main.walk, moving=moving)
    alone = len(runs) == 1 and main is not None
    for run in runs:
        words = run.name if alone else f"{run.name}: {run.walk.describe()}"
        if several and not alone:
            words += f"; {kit.number(run.plan.success, 4)} % reached"
        wrong = "" if alone or run.result.ok else ", NOT VALID"
        keys.append(kit.key(words + wrong, lw=1.8, **run.look))
    return keys


@kit.documented
def animate_run(
    model: UnknownGridNavigation,
    plan: NavigationRuns | Any,
    *,
    scene: int = 0,
    frames: int = 120,
    interval: float = 150.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Animate the run of one scene: vehicle, UAV, its view, and the cells seen so far.

    If a side of the map has more than 60 cells, only the part around the vehicle is shown.

    Parameters
    ----------
    scene : int, default 0
        Index of the scene.
    frames : int, default 120
        Maximum number of frames, at least 2. Longer runs skip steps.
    """
    scene = check_scene(model, scene)
    box = box_around(model, model.starts[scene])
    ratio = drawn.proportion(box)
    wide = min(4.2, 4.2 * ratio)
    default = max(wide, 4.2) + 0.4, wide / ratio + 1.35
    stage = kit.Stage(model, title, size, frames, interval, default, clock=0.68)
    runs = required("plan", model.as_plan(plan), NavigationRuns)
    model.verify(runs)  # raises if the numbers of runs and scenes differ
    walk = walk_of(model, runs, scene)
    steps = np.unique(np.linspace(0, walk.steps, frames).round().astype(int)).tolist()
    height = max(stage.tall - 1.3, 0.5 * stage.tall)
    axes = stage.box(0.2, 0.88, stage.broad - 0.4, height)
    axes.set_aspect("equal" if is_square(box) else "auto")
    stage.legend(keys_of(walk, moving=True), 3)
    cell = min((stage.broad - 0.4) / float(box.size[1]), height / float(box.size[0]))
    moment = Moment(axes, model, scene, walk, float(np.clip(0.62 * 72 * cell, 3.5, 9.0)))

    def show(frame: int) -> str:
        step = steps[min(frame, len(steps) - 1)]
        moment.show(step)
        return f"step {step} of {walk.steps}{f': {walk.outcome}' if step == walk.steps else ''}"

    return stage.play(show, len(steps))
