"""The picture of a guided vehicle's tour: where it is over what it has walked, and whom it serves."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ..fields import required
from ..plots.labels import write_names
from ..plots.maps import length_unit
from ..plots.options import check_flags, check_list, check_option, check_size
from ..plots.routes import ring
from ..plots.space import dots
from ..plots.style import (
    BLACK,
    DARK,
    GREY,
    RED,
    axis_style,
    headline,
    key,
    legend_row,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .animation import animate_tour
from .drawn import Walk, dress_line, dress_walk, groups_of, look_of, walk_of
from .model import GuidedPathTour
from .plan import GuidedPathPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_tour", "draw"]

Floats = NDArray[np.float64]

#: More customers than this have no names, and more than that have small dots.
_MOST_NAMES, _MOST_LARGE = 40, 120
#: More chains than this have no picture of their own beside the tour, no names, no lines in the tour.
_MOST_BESIDE, _MOST_ROWS, _MOST_LINES = 12, 24, 7
#: More pairs than this are no lines.
_MOST_PAIRS = 400
#: Smaller pictures (inch) have no names, and the tour alone.
_LARGE = (4.0, 4.5)
#: How much of a chain's row it fills.
_FILL = 0.62
_PARTS = ("chains", "tour")


def draw(
    model: GuidedPathTour,
    plan: GuidedPathPlan | None = None,
    *,
    parts: Sequence[str] | None = None,
    over: str = "walked",
    lines: bool | None = None,
    labels: bool | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the chains of `model`, and below them the position of the vehicle over what it walks.

    Parameters
    ----------
    model : GuidedPathTour
        The model. Where it has pairs and no chains, the fewest chains that hold all of its relation
        are drawn.
    plan : GuidedPathPlan, optional
        A plan for it, valid or not; pairs in the wrong order are red lines, and customers that are not
        served once have red rings. None draws the chains only.
    parts : sequence of {"chains", "tour"}, optional
        What to draw: the customers of each chain in a row, the tour, or both, as by default where the
        chains are few.
    over : {"walked", "stops"}
        Whether the tour goes down by the distance walked, or by one for each stop.
    lines : bool, optional
        Whether the customers of a chain are joined in the tour; by default where chains are few.
    labels : bool, optional
        Whether to name the customers; by default where they are few.
    tolerance : float
        Largest violation accepted, relative, for what the title says: that of the solution.
    title : str, optional
        Instead of the name, the size and the length.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        With a panel for each part.

    Raises
    ------
    InvalidData
        The plan names a customer that there is not.
    UnsupportedOption
        An option has a value that is not allowed, or asks for a plan that is not given.
    """
    groups = groups_of(model)
    if parts is None:
        beside = 0 < len(groups) <= _MOST_BESIDE and check_size(size, _LARGE)[1] >= _LARGE[1]
        shown = _PARTS[:1] if plan is None else _PARTS[not beside :]
    else:
        asked = check_list("parts", parts, _PARTS.__contains__, "hold some of 'chains', 'tour'")
        shown = tuple(part for part in _PARTS if part in asked)
    if "tour" in shown and plan is None:
        raise UnsupportedOption("parts can hold 'tour' only where there is a plan")
    check_option("over", over, over in ("walked", "stops"), "be 'walked' or 'stops'")
    check_flags(**{k: v for k, v in (("lines", lines), ("labels", labels)) if v is not None})
    check_tolerance(tolerance)
    found = None
    if plan is not None:
        found = model.verify(required("plan", plan, GuidedPathPlan), tolerance=tolerance)
    text = _title(model, found) if title is None else title
    row = 0.3 + 0.004 * min(max(map(len, groups), default=0), 300)
    high = {"chains": float(np.clip(0.5 + row * (len(groups) + 1), 1.3, 6.0)), "tour": 5.0}
    whole = sum(map(high.__getitem__, shown))
    figure = sheet(size, (6.6, whole + 1.4))
    broad, tall = figure.get_size_inches()
    head, foot, left = 0.46 + 0.17 * text.count("\n"), 0.88, 0.86
    # Small pictures give the panels what is left.
    unit = max(tall - head - foot, 0.3 * tall) / whole
    scale, name = length_unit(float(np.ptp(model.coordinates)))
    keys, top = [key("start", marker="s", mfc="white", mec=BLACK, mew=1.4, ms=6)], tall - head
    for part in shown:
        tallness = high[part] * unit - 0.12
        where = (left, top - tallness, broad - left - 0.16, tallness)
        axes = figure.add_axes(tuple(np.divide(where, (broad, tall, broad, tall)).tolist()))
        top -= high[part] * unit
        dress_line(axes, model, scale)
        few = model.size <= _MOST_NAMES and broad >= _LARGE[0]
        names = labels if labels is not None else few
        if part == "chains":
            keys += _draw_chains(model, groups, axes, scale, names)
        else:
            assert plan is not None
            joined = lines if lines is not None else len(groups) <= _MOST_LINES
            keys += _draw_tour(
                model, groups, walk_of(model, plan), axes, scale, over, joined, names
            )
        axes.tick_params(labelbottom=part == shown[-1])
    axes.set_xlabel(f"position ({name})", fontsize=8.5)
    keys += _group_keys(model, groups)
    legend_row(figure, keys, "lower center", (0.5, 0.06 / tall), rows=1 + (len(keys) > 5))
    headline(figure, text, wrong=found is not None and not found.ok)
    return figure


def _title(model: GuidedPathTour, found: Verification | None) -> str:
    parts = [model.describe()]
    if found is not None and found.objective is not None:
        parts.append(f"{number(found.objective)} m")
    return title_of(model.name, parts, found)


def _group_keys(model: GuidedPathTour, groups: Sequence[Sequence[int]]) -> list[Any]:
    """Return the entries of a legend that tell chains apart."""
    few = range(min(len(groups), _MOST_LINES))
    keys = [key(f"chain {k}", ms=5, **look_of(k)) for k in few]
    if len(groups) > _MOST_LINES:
        keys.append(key(f"… {len(groups)} chains in all", ls=""))
    if sum(map(len, groups)) < model.size - 1:
        keys.append(key("in no chain", ms=5, **look_of(-1)))
    return keys


def _owners(model: GuidedPathTour, groups: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Return the chain of each customer, -1 where it is in none."""
    owners = np.full(model.size, -1)
    for k, group in enumerate(groups):
        owners[list(group)] = k
    return owners


def _mark(axes: Any, customers: NDArray[np.int64], at: Floats, owners: NDArray[np.int64]) -> None:
    """Draw customers at places of the axes, each as its chain is drawn."""
    big = 24 if len(customers) <= _MOST_LARGE else 9
    held = owners[customers]
    for group in np.unique(held).tolist():
        look = look_of(group)
        dots(
            axes, at[held == group], look["marker"], look["color"], size=big, edge="white", width=0.5,
            zorder=7, gid="customer",
        )  # fmt: skip


def _join(axes: Any, ends: Any, gid: str, **look: Any) -> None:
    """Draw lines between pairs of places."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(ends), gid=gid, **look), autolim=False)


# -- the chains ----------------------------------------------------------------------------------


def _draw_chains(
    model: GuidedPathTour, groups: Sequence[Sequence[int]], axes: Any, scale: float, labels: bool
) -> list[Any]:
    """Draw a row for each chain, which goes down within it, and return entries of the legend."""
    owners = _owners(model, groups)
    heights = np.full(model.size, float(len(groups)))
    for k, group in enumerate(groups):
        heights[list(group)] = k + _FILL * (np.linspace(0.0, 1.0, len(group)) - 0.5)
    at = np.column_stack([model.coordinates * scale, heights])
    for k, group in enumerate(groups):
        colour = axis_style(k)["color"]
        axes.plot(*at[list(group)].T, color=colour, lw=1.0, alpha=0.7, zorder=3, gid="chain")
    links = {pair for group in groups for pair in itertools.pairwise(group)}
    others = [list(pair) for pair in model.pairs if pair not in links]
    keys = []
    if 0 < len(others) <= _MOST_PAIRS:
        _join(axes, at[others], "pair", colors=GREY, lw=0.7, alpha=0.7, zorder=2)
        keys.append(key("further pair", color=GREY, lw=0.9))
    _mark(axes, np.arange(1, model.size), at[1:], owners)
    alone = bool((owners[1:] < 0).any())
    axes.set_ylim(len(groups) - 0.5 + alone, -0.5)
    axes.axvline(float(at[0, 0]), color=BLACK, lw=0.8, ls=":", zorder=1)
    home = np.array([[at[0, 0], -0.5]])
    dots(axes, home, "s", "white", size=60, edge=BLACK, width=1.4, zorder=5, gid="start").set_clip_on(False)  # fmt: skip
    if len(groups) + alone <= _MOST_ROWS:
        names = [f"chain {k}" for k in range(len(groups))] + ["no chain"] * alone
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(axis="y", length=0)
    else:
        axes.set_ylabel("chain", fontsize=8.5)
    axes.grid(visible=False, axis="y")
    if labels:
        names = [model.label(customer) for customer in range(1, model.size)]
        write_names(axes, at[1:], names, size=7.0, colour=BLACK, route=False)
    return keys


# -- the tour ------------------------------------------------------------------------------------


def _draw_tour(
    model: GuidedPathTour, groups: Sequence[Sequence[int]], walk: Walk, axes: Any, scale: float,
    over: str, joined: bool, labels: bool,
) -> list[Any]:  # fmt: skip
    """Draw the position of the vehicle and whom it serves, and return entries of the legend."""
    at = dress_walk(axes, walk, scale, over)
    axes.plot(*at.T, color=DARK, lw=1.3 if len(at) <= _MOST_LARGE else 0.8, zorder=4, gid="vehicle")
    keys = [key("vehicle", color=DARK, lw=1.3)]
    first: dict[int, int] = {}
    for stop, customer in enumerate(walk.stops[1:-1], 1):
        first.setdefault(customer, stop)
    if joined:
        for k, group in enumerate(groups):
            served = [first[customer] for customer in group if customer in first]
            look: dict[str, Any] = {"color": axis_style(k)["color"], "lw": 0.9, "alpha": 0.45}
            axes.plot(*at[served].T, ls="--", zorder=3, gid="chain", **look)
    broken = [
        (first[before], first[after])
        for before, after in model.pairs
        if before in first and after in first and first[before] >= first[after]
    ]
    if broken:
        _join(axes, at[np.array(broken)], "wrong order", colors=RED, lw=1.6, zorder=6)
        keys.append(key("wrong order", color=RED, lw=1.6))
    _mark(axes, np.array(walk.stops[1:-1], int), at[1:-1], _owners(model, groups))
    dots(axes, at[[0, -1]], "s", "white", size=60, edge=BLACK, width=1.4, zorder=5, gid="start")
    times = np.bincount(np.array(walk.stops[1:-1], int), minlength=model.size)
    many = at[1:-1][times[walk.stops[1:-1]] > 1]
    never = np.flatnonzero(times[1:] == 0) + 1
    missed = np.column_stack([model.coordinates[never] * scale, np.zeros(len(never))])
    _mark(axes, never, missed, _owners(model, groups))
    keys += ring(axes, np.concatenate([many, missed]), "not served once")
    if labels:
        _draw_names(model, walk, at, axes)
    return keys


def _draw_names(model: GuidedPathTour, walk: Walk, at: Floats, axes: Any) -> None:
    """Name the customers; those that are served at one place in a row have one name."""
    names = [""] * len(at)
    moved = (np.diff(at[1:-1], axis=0) != 0).any(axis=1)
    runs = np.split(np.arange(1, len(at) - 1), np.flatnonzero(moved) + 1)
    for run in filter(len, runs):
        held = [model.label(walk.stops[stop]) for stop in run]
        more = [f"{len(held) - 2} more"] * (len(held) > 4)
        names[run[0]] = ", ".join(held[: 2 if more else None] + more)
    write_names(axes, at, names, size=7.0, colour=BLACK)
