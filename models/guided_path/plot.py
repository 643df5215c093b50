"""Plots of guided vehicles' tours: chains, and position over the distance walked."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ..fields import required
from ..plots import kit
from ..verification import Check, Verification
from .data import GuidedPathData
from .model import GuidedPathTour
from .plan import GuidedPathPlan
from .schedule import Walk, walk_of

__all__ = ["animate_tour", "draw"]

Groups = Sequence[Sequence[int]]

#: Largest numbers of customers with names, and with large dots.
_MOST_NAMES, _MOST_LARGE = 40, 120
#: Largest numbers of chains with a panel beside the tour, with row labels, and with lines in it.
_MOST_BESIDE, _MOST_ROWS, _MOST_LINES = 12, 24, 7
#: Largest number of pairs that are drawn as lines.
_MOST_PAIRS = 400
#: Smallest figure (inches) with names, and with the chains beside the tour.
_LARGE = (4.0, 4.5)
#: Share of a row that a chain fills.
_FILL = 0.62
_PARTS = ("chains", "tour")
#: Marker of the start on the map.
_START: dict[str, Any] = {"size": 60, "edge": kit.BLACK, "width": 1.4, "zorder": 5, "gid": "start"}


@kit.documented
def draw(
    model: GuidedPathTour,
    plan: GuidedPathPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    over: str = "walked",
    lines: bool | None = None,
    labels: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the chains of `model`, and below them the position of the vehicle over the distance walked.

    Parameters
    ----------
    model : GuidedPathTour
        The model. If it has pairs and no chains, the minimum chain cover of its relation is drawn.
    plan : GuidedPathPlan, optional
        Plan of the model, feasible or not. Pairs in the wrong order are red lines, and customers
        that are not served exactly once have red rings. None draws only the chains.
    parts : sequence of {"chains", "tour"}, optional
        Panels: the customers of each chain in a row, and the tour. Default: both if the chains are
        few, otherwise the tour.
    over : {"walked", "stops", "time"}
        Vertical axis of the tour: distance walked by all vehicles, number of the stop, or time with the
        windows as bars. Time needs a speed and a single vehicle.
    lines : bool, optional
        Whether to join the customers of a chain in the tour. Default: True if the chains are few.
    labels : bool, optional
        Whether to name the customers. Default: True if they are few.
    """
    groups, owners = groups_of(model), np.full(model.size, -1)
    for k, group in enumerate(groups):
        owners[list(group)] = k
    if parts is None:
        beside = 0 < len(groups) <= _MOST_BESIDE and kit.check_size(size, _LARGE)[1] >= _LARGE[1]
        shown = _PARTS[:1] if plan is None else _PARTS[not beside :]
    else:
        requested = kit.check_words("parts", parts, _PARTS)
        shown = tuple(part for part in _PARTS if part in requested)
    if "tour" in shown and plan is None:
        raise UnsupportedOption("parts can contain 'tour' only if plan is given")
    kit.check_choice("over", over, "walked", "stops", "time")
    if over == "time" and (model.speed is None or model.vehicles is not None):
        raise UnsupportedOption("over can be 'time' only with a speed and a single vehicle")
    kit.check_flags(optional=True, lines=lines, labels=labels)
    result = kit.verified_plan(model, plan, GuidedPathPlan, tolerance)
    words = [model.describe()]
    if result is not None and result.objective is not None:
        words.append(f"{kit.number(result.objective)} m")
    row = 0.3 + 0.004 * min(max(map(len, groups), default=0), 300)
    high = {"chains": float(np.clip(0.5 + row * (len(groups) + 1), 1.3, 6.0)), "tour": 5.0}
    whole = sum(high[part] for part in shown)
    scene = kit.Scene(kit.title_of(model, words, result, title), result, size, (6.6, whole + 1.4))
    # The panels share the remaining height.
    unit = max(scene.tall - scene.head - 0.88, 0.3 * scene.tall) / whole
    keys = [kit.key("start", marker="s", mfc="white", mec=kit.BLACK, mew=1.4, ms=6)]
    top = scene.head
    few = model.size <= _MOST_NAMES and scene.broad >= _LARGE[0]
    names = labels if labels is not None else few
    for part in shown:
        foot = scene.tall - top - high[part] * unit + 0.12
        axes = scene.axes(0.86, foot, 0.16, top)
        top += high[part] * unit
        walk = None if part == "chains" else walk_of(model, required("plan", plan, GuidedPathPlan))
        scale = dress_line(axes, model, walk, labelled=part == shown[-1])
        if walk is None:
            keys += _draw_chains(model, groups, owners, axes, scale, names, result)
        else:
            joined = lines if lines is not None else len(groups) <= _MOST_LINES
            at = dress_walk(axes, walk, scale, over)
            if over == "time" and model.windows is not None:
                keys += _draw_windows(model, walk, axes, at)
            tracks = lines_of(model, walk, at, scale, over)
            keys += _draw_tour(model, groups, owners, walk, axes, at, tracks, scale, joined)
            _pin_tour(model, walk, axes, at, result)
            if names:
                _draw_names(model, walk, at, axes)
        axes.tick_params(labelbottom=part == shown[-1])
    keys += _group_keys(model, groups)
    scene.legend(keys, 1 + (len(keys) > 5), y=0.06)
    return scene.figure


def _group_keys(model: GuidedPathTour, groups: Groups) -> list[Any]:
    """Return the legend entries of the chains."""
    few = range(min(len(groups), _MOST_LINES))
    keys = [kit.key(f"chain {k}", ms=5, **look_of(k)) for k in few]
    if len(groups) > _MOST_LINES:
        keys.append(kit.key(f"… {len(groups)} chains in all", ls=""))
    if sum(map(len, groups)) < model.size - 1:
        keys.append(kit.key("in no chain", ms=5, **look_of(-1)))
    return keys


def _mark(
    axes: Any, customers: NDArray[np.int64], at: kit.Floats, owners: NDArray[np.int64]
) -> None:
    """Draw customers at places of the axes, with the marker and colour of their chains."""
    large = 24 if len(customers) <= _MOST_LARGE else 9
    for k in np.unique(owners[customers]).tolist():
        marker, colour = look_of(k).values()
        look: dict[str, Any] = {"edge": "white", "width": 0.5, "zorder": 7, "gid": "customer"}
        kit.dots(axes, at[owners[customers] == k], marker, colour, size=large, **look)


# -- the chains ----------------------------------------------------------------------------------


def _draw_chains(
    model: GuidedPathTour, groups: Groups, owners: NDArray[np.int64], axes: Any, scale: float,
    labels: bool, result: Verification | None,
) -> list[Any]:  # fmt: skip
    """Draw each chain in a row, in which it descends; return entries of the legend."""
    heights = np.full(model.size, float(len(groups)))
    for k, group in enumerate(groups):
        heights[list(group)] = k + _FILL * (np.linspace(0.0, 1.0, len(group)) - 0.5)
    at = np.column_stack([model.positions * scale, heights])
    for k, group in enumerate(groups):
        look: dict[str, Any] = {"color": kit.colour_of(k), "lw": 1.0, "alpha": 0.7, "zorder": 3}
        axes.plot(*at[list(group)].T, gid="chain", **look)
    links = {pair for group in groups for pair in itertools.pairwise(group)}
    others = [list(pair) for pair in model.pairs if pair not in links]
    keys = []
    if 0 < len(others) <= _MOST_PAIRS:
        kit.draw_lines(axes, at[others], gid="pair", colors=kit.GREY, lw=0.7, alpha=0.7, zorder=2)
        keys.append(kit.key("further pair", color=kit.GREY, lw=0.9))
    _mark(axes, np.arange(1, model.size), at[1:], owners)
    alone = sum(map(len, groups)) < model.size - 1
    axes.set_ylim(len(groups) - 0.5 + alone, -0.5)
    axes.axvline(float(at[0, 0]), color=kit.BLACK, lw=0.8, ls=":", zorder=1)
    kit.dots(axes, np.array([[at[0, 0], -0.5]]), "s", "white", **_START).set_clip_on(False)
    if len(groups) + alone <= _MOST_ROWS:
        names = [f"chain {k}" for k in range(len(groups))] + ["no chain"] * alone
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(axis="y", length=0)
    else:
        kit.label_axes(axes, y="chain (number)")
    axes.grid(visible=False, axis="y")
    names = [model.label(customer) for customer in range(1, model.size)]
    kit.pin_places(axes, result, {f"customer {n}": p for n, p in zip(names, at[1:], strict=True)})
    if labels:
        kit.write_names(axes, at[1:], names, size=7.0, colour=kit.BLACK, route=False)
    return keys


# -- the tour ------------------------------------------------------------------------------------


def _draw_tour(
    model: GuidedPathTour, groups: Groups, owners: NDArray[np.int64], walk: Walk, axes: Any,
    at: kit.Floats, lines: list[kit.Floats], scale: float, joined: bool,
) -> list[Any]:  # fmt: skip
    """Draw the position of the vehicle and the customers served; return entries of the legend."""
    width = 1.3 if len(at) <= _MOST_LARGE else 0.8
    for line in lines:
        axes.plot(*line.T, color=kit.DARK, lw=width, zorder=4, gid="vehicle")
    keys = [kit.key("vehicle", color=kit.DARK, lw=1.3)]
    served = np.array(walk.stops[1:-1], int)
    first: dict[int, int] = {}
    for stop, customer in enumerate(served.tolist(), 1):
        first.setdefault(customer, stop)
    for k, group in enumerate(groups if joined else ()):
        stops = [first[customer] for customer in group if customer in first]
        look: dict[str, Any] = {"color": kit.colour_of(k), "lw": 0.9, "alpha": 0.45, "ls": "--"}
        axes.plot(*at[stops].T, zorder=3, gid="chain", **look)
    broken = [
        (first[before], first[after])
        for before, after in model.pairs
        if before in first and after in first and first[before] >= first[after]
    ]
    if broken:
        red = {"color": kit.RED, "lw": 1.6}
        kit.draw_lines(axes, at[np.array(broken)], gid="wrong order", zorder=6, **red)
        keys.append(kit.key("wrong order", **red))
    _mark(axes, served, at[1:-1], owners)
    kit.dots(axes, np.concatenate([line[[0, -1]] for line in lines]), "s", "white", **_START)
    times = np.bincount(served, minlength=model.size)
    never = np.flatnonzero(times[1:] == 0) + 1
    missed = np.column_stack([model.positions[never] * scale, np.full(len(never), at[0, 1])])
    _mark(axes, never, missed, owners)
    repeated = at[1:-1][times[served] > 1]
    return keys + kit.ring(axes, np.concatenate([repeated, missed]), "not served once")


def _draw_windows(model: GuidedPathTour, walk: Walk, axes: Any, at: kit.Floats) -> list[Any]:
    """Draw the time window of each stop as a bar; return the entry of the legend."""
    assert model.windows is not None
    high, low = axes.get_ylim()
    for (x, _), (earliest, latest) in zip(at[:-1], model.windows[walk.stops[:-1]], strict=True):
        times = np.clip([earliest, latest], low, high)
        axes.plot([x, x], times, color=kit.GREY, lw=4, alpha=0.35, zorder=2, gid="window")
    return [kit.key("time window", color=kit.GREY, lw=4, alpha=0.35)]


def _pin_tour(
    model: GuidedPathTour, walk: Walk, axes: Any, at: kit.Floats, result: Verification | None
) -> None:
    """Pin a customer at its first stop, else at the start of the tour; pin a pair at its late customer."""
    stops = {model.label(customer): k for k, customer in reversed(list(enumerate(walk.stops)))}

    def place(check: Check) -> Any:
        words = check.where.removeprefix("customer ")
        name = next((n for n in stops if words == n or words.startswith(f"{n} before ")), None)
        if name is not None:
            return at[stops[name]]
        if check.where == "end of the tour":
            return at[-1]
        labels = [f"customer {model.label(customer)}" for customer in range(model.size)]
        return at[0] if check.where in labels else None

    kit.pin_places(axes, result, place)


def _draw_names(model: GuidedPathTour, walk: Walk, at: kit.Floats, axes: Any) -> None:
    """Name the customers; consecutive customers at one place share a label."""
    names = [""] * len(at)
    moved = (np.diff(at[1:-1], axis=0) != 0).any(axis=1)
    runs = np.split(np.arange(1, len(at) - 1), np.flatnonzero(moved) + 1)
    for run in filter(len, runs):
        labels = [model.label(walk.stops[stop]) for stop in run]
        more = [f"{len(labels) - 2} more"] * (len(labels) > 4)
        names[run[0]] = ", ".join(labels[: 2 if more else None] + more)
    kit.write_names(axes, at, names, size=7.0, colour=kit.BLACK)


# -- in motion -------------------------------------------------------------------------------------

#: Colour of customers that are not served yet.
_WAITING = "#d9d9d9"


@kit.documented
def animate_tour(
    model: GuidedPathTour,
    plan: GuidedPathPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Return an animation of the tour: the vehicle on its line, its path, and the customers served."""
    stage = kit.Stage(model, title, size, frames, interval, (6.0, 5.0))
    plan = required("plan", model.as_plan(plan), GuidedPathPlan)
    model.verify(plan)  # rejects an unknown customer
    walk = walk_of(model, plan)
    axes = stage.axes(0.8, 1.0, 0.2, stage.head)
    scale = dress_line(axes, model, walk, labelled=True)
    at = dress_walk(axes, walk, scale)
    lines = lines_of(model, walk, at, scale)
    colours = np.full(model.size, look_of(-1)["color"], object)
    for k, group in enumerate(groups_of(model)):
        colours[list(group)] = look_of(k)["color"]
    served = colours[walk.stops[1:-1]]
    for line in lines:
        axes.plot(*line.T, lw=0.7, ls=":", color=kit.GREY, zorder=2)
    ways = [axes.plot([], [], lw=1.6, color=kit.DARK, zorder=4, gid="way")[0] for _ in lines]
    look: dict[str, Any] = {"marker": "s", "mfc": "white", "mec": kit.BLACK, "mew": 1.4}
    (vehicle,) = axes.plot([], [], ls="", ms=8, zorder=8, gid="vehicle", **look)
    customers = kit.dots(axes, at[1:-1], "o", _WAITING, size=22, zorder=6, gid="customer")
    waiting = kit.key("to be served", marker="o", color=_WAITING, ms=5)
    stage.legend([kit.key("vehicle", ms=6, **look), waiting], 1, y=0.28)
    ends = np.linspace(0.0, walk.walked[-1], frames)

    def show(frame: int) -> str:
        # The tolerance covers the rounding of the distance walked.
        done = walk.walked <= ends[frame] * (1 + 1e-12)
        here = [
            [np.interp(ends[frame], walk.walked, column) for column in line.T]
            if not done.all() else line[-1].tolist() for line in lines
        ]  # fmt: skip
        for way, line, place in zip(ways, lines, here, strict=True):
            way.set_data(*np.concatenate([line[done], [place]]).T)
        vehicle.set_data(*zip(*here, strict=True))
        customers.set_facecolors(list(np.where(done[1:-1], served, _WAITING)))
        count = f"{int(done[1:-1].sum())} of {len(served)} served"
        walked, last = kit.number(float(ends[frame]), 4), kit.number(float(walk.walked[-1]))
        return f"{walked} m of {last} m, {count}"

    return stage.play(show)


# -- the line --------------------------------------------------------------------------------------

#: Markers of chains, one per cycle through the colours.
_MARKERS = ("o", "^", "D", "v", "P")


def groups_of(model: GuidedPathData) -> tuple[tuple[int, ...], ...]:
    """Return the chains to draw: those of the model, or the minimum chain cover of its relation."""
    chains = [tuple(x for x in chain if x) for chain in model.chains] or model.cover
    return tuple(chain for chain in chains if len(chain) > 1)


def look_of(group: int) -> dict[str, Any]:
    """Return marker and colour of the customers of a chain; -1 selects those without a chain."""
    if group < 0:
        return {"marker": "o", "color": kit.DARK}
    return {"marker": _MARKERS[group // 7 % len(_MARKERS)], "color": kit.colour_of(group)}


def lines_of(
    model: GuidedPathData, walk: Walk, at: kit.Floats, scale: float, over: str = "walked"
) -> list[kit.Floats]:
    """Return the line of each vehicle over the vertical axis of `at`; over time with waiting and service."""
    if over != "time" or model.speed is None:
        return [np.column_stack([column * scale, at[:, 1]]) for column in walk.positions.T]
    takes = np.zeros(model.size) if model.service is None else model.service
    leave = walk.begin + takes[walk.stops]
    came = leave[:-1] + np.diff(walk.walked) / model.speed
    x, times = np.repeat(at[:, 0], 3)[1:-1], [walk.begin[0], leave[0]]
    for row, time in enumerate(came, 1):
        times += [time, walk.begin[row], leave[row]]
    return [np.column_stack([x, times[: len(x)]])]


def dress_line(axes: Any, model: GuidedPathData, walk: Walk | None, *, labelled: bool) -> float:
    """Set the limits of the position axis, and return the factor from metres to its unit."""
    places = model.positions if walk is None else [*model.positions, *walk.positions.ravel()]
    low, high = float(np.min(places)), float(np.max(places))
    scale, unit = kit.length_unit(high - low)
    # A line of length 0 determines no scale.
    around = 0.08 * (high - low) or max(1.0, 0.1 * abs(low))
    axes.set_xlim((low - around) * scale, (high + around) * scale)
    kit.bare(axes)
    # Without a common factor of all ticks.
    axes.xaxis.set_major_formatter(lambda value, _: kit.number(value, 7))
    kit.label_axes(axes, f"position ({unit})" if labelled else None)
    return scale


def dress_walk(axes: Any, walk: Walk, scale: float, over: str = "walked") -> kit.Floats:
    """Set the limits of the axis of the distance; return the stops' positions, shape (stops, 2)."""
    if over == "time":
        down, words = walk.begin, "time (s)"
    elif over == "walked":
        size, unit = kit.length_unit(float(walk.walked[-1]))
        down, words = walk.walked * size, f"walked ({unit})"
    else:
        down, words = np.arange(len(walk.stops), dtype=float), "stops (number)"
    around = 0.03 * float(down[-1] - down[0]) or 0.5
    axes.set_ylim(float(down[-1]) + around, float(down[0]) - around)
    kit.label_axes(axes, y=words)
    axes.yaxis.set_major_formatter(lambda value, _: kit.number(value, 7))
    return np.column_stack([walk.places * scale, down])
