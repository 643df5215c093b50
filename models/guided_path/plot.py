"""Plots of guided vehicles' tours: chains, and position over the distance walked."""

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

#: Largest numbers of customers with names, and with large dots.
_MOST_NAMES, _MOST_LARGE = 40, 120
#: Largest numbers of chains with a panel beside the tour, with row labels, and with lines in the
#: tour.
_MOST_BESIDE, _MOST_ROWS, _MOST_LINES = 12, 24, 7
#: Largest number of pairs that are drawn as lines.
_MOST_PAIRS = 400
#: Smallest figure (inches) with names, and with the chains beside the tour.
_LARGE = (4.0, 4.5)
#: Share of a row that a chain fills.
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
    over : {"walked", "stops"}
        Vertical axis of the tour: distance walked, or number of the stop.
    lines : bool, optional
        Whether to join the customers of a chain in the tour. Default: True if the chains are few.
    labels : bool, optional
        Whether to name the customers. Default: True if they are few.
    tolerance : float
        Largest relative violation accepted, for the title. Use the tolerance of the solution.
    title : str, optional
        Title. Default: the name, the size and the length.
    size : (float, float), optional
        Width and height, in inches.

    Returns
    -------
    matplotlib.figure.Figure
        Figure with one panel per part.

    Raises
    ------
    InvalidData
        The plan contains an unknown customer.
    UnsupportedOption
        An option has a value that is not allowed, or `parts` contains ``"tour"`` without a plan.
    """
    groups = groups_of(model)
    if parts is None:
        beside = 0 < len(groups) <= _MOST_BESIDE and check_size(size, _LARGE)[1] >= _LARGE[1]
        shown = _PARTS[:1] if plan is None else _PARTS[not beside :]
    else:
        requested = check_list("parts", parts, _PARTS.__contains__, "hold some of 'chains', 'tour'")
        shown = tuple(part for part in _PARTS if part in requested)
    if "tour" in shown and plan is None:
        raise UnsupportedOption("parts can contain 'tour' only if plan is given")
    check_option("over", over, over in ("walked", "stops"), "be 'walked' or 'stops'")
    check_flags(**{k: v for k, v in (("lines", lines), ("labels", labels)) if v is not None})
    check_tolerance(tolerance)
    verification = None
    if plan is not None:
        verification = model.verify(required("plan", plan, GuidedPathPlan), tolerance=tolerance)
    text = _title(model, verification) if title is None else title
    row = 0.3 + 0.004 * min(max(map(len, groups), default=0), 300)
    high = {"chains": float(np.clip(0.5 + row * (len(groups) + 1), 1.3, 6.0)), "tour": 5.0}
    whole = sum(map(high.__getitem__, shown))
    figure = sheet(size, (6.6, whole + 1.4))
    broad, tall = figure.get_size_inches()
    head, foot, left = 0.46 + 0.17 * text.count("\n"), 0.88, 0.86
    # The panels share the remaining height.
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
    headline(figure, text, wrong=verification is not None and not verification.ok)
    return figure


def _title(model: GuidedPathTour, verification: Verification | None) -> str:
    parts = [model.describe()]
    if verification is not None and verification.objective is not None:
        parts.append(f"{number(verification.objective)} m")
    return title_of(model.name, parts, verification)


def _group_keys(model: GuidedPathTour, groups: Sequence[Sequence[int]]) -> list[Any]:
    """Return the legend entries of the chains."""
    few = range(min(len(groups), _MOST_LINES))
    keys = [key(f"chain {k}", ms=5, **look_of(k)) for k in few]
    if len(groups) > _MOST_LINES:
        keys.append(key(f"… {len(groups)} chains in all", ls=""))
    if sum(map(len, groups)) < model.size - 1:
        keys.append(key("in no chain", ms=5, **look_of(-1)))
    return keys


def _owners(model: GuidedPathTour, groups: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Return the index of each customer's chain, or -1 if it is in no chain."""
    owners = np.full(model.size, -1)
    for k, group in enumerate(groups):
        owners[list(group)] = k
    return owners


def _mark(axes: Any, customers: NDArray[np.int64], at: Floats, owners: NDArray[np.int64]) -> None:
    """Draw customers at places of the axes, with the marker and colour of their chains."""
    big = 24 if len(customers) <= _MOST_LARGE else 9
    groups = owners[customers]
    for group in np.unique(groups).tolist():
        look = look_of(group)
        dots(
            axes, at[groups == group], look["marker"], look["color"], size=big, edge="white", width=0.5,
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
    """Draw each chain in a row, in which it descends; return entries of the legend."""
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
    """Draw the position of the vehicle and the customers served; return entries of the legend."""
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
    """Name the customers; consecutive customers at one place share a label."""
    names = [""] * len(at)
    moved = (np.diff(at[1:-1], axis=0) != 0).any(axis=1)
    runs = np.split(np.arange(1, len(at) - 1), np.flatnonzero(moved) + 1)
    for run in filter(len, runs):
        labels = [model.label(walk.stops[stop]) for stop in run]
        more = [f"{len(labels) - 2} more"] * (len(labels) > 4)
        names[run[0]] = ", ".join(labels[: 2 if more else None] + more)
    write_names(axes, at, names, size=7.0, colour=BLACK)
