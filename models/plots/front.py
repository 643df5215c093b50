"""The picture of a front: how much of one objective must be given for how much of another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from .options import check_flags
from .style import (
    BLACK,
    DARK,
    GREY,
    axis_style,
    bare,
    headline,
    key,
    legend_below,
    number,
    pretty_unit,
    sheet,
    title_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_front"]

Floats = NDArray[np.float64]

#: More points than this have no numbers.
_MOST_NUMBERS = 10
#: Bounds farther below all points than this many times their height are marks at the foot.
_FAR = 1.5
#: Room around the points, as a part of their extent.
_MARGIN = 0.12
#: And to their left, where numbers stand.
_LEFT = 0.2


def draw_front(
    front: Any,
    size: tuple[float, float] | None = None,
    title: str | None = None,
    labels: bool | None = None,
    unit: str | None = None,
) -> Figure:
    """Draw the points of a front, the second objective to the right and the objective upward.

    Steps lead from point to point: what lies above them and to their right is dominated. A filled
    marker is proven to be the least objective within its limit, a hollow one is not; a short line
    below a point is the bound that was proven for it.

    Parameters
    ----------
    front : Front or mapping of str to Front
        The front of a model, or those of several algorithms by their names.
    size : (float, float), optional
        Width and height (inch).
    title : str, optional
        Instead of the model's name and size.
    labels : bool, optional
        Whether to write both objectives beside each point; by default for one front of few points.
    unit : str, optional
        Unit of the second objective, by default that of the objective.

    Returns
    -------
    matplotlib.figure.Figure
        With one panel.

    Raises
    ------
    InvalidData
        No front has a point, or they have different second objectives.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    fronts = dict(front) if isinstance(front, Mapping) else {"": front}
    if labels is not None:
        check_flags(labels=labels)
    drawn = {str(name): _rows(one.points) for name, one in fronts.items()}
    places = np.concatenate([np.empty((0, 2)), *(rows[:, :2] for rows in drawn.values())])
    if not len(places):
        raise InvalidData("front must have at least one point", field="front")
    if len({one.second for one in fronts.values()}) > 1:
        raise InvalidData("fronts must have the same second objective", field="front")
    first = next(iter(fronts.values()))
    model = first.model
    removed = np.concatenate([_rows(one.dominated)[:, :2] for one in fronts.values()])
    bounds = np.concatenate([rows[:, 2] for rows in drawn.values()])
    low, high = _box(np.concatenate([places, removed]), bounds)

    figure = sheet(size, (6.6, 4.8))
    broad, tall = figure.get_size_inches()
    text = title_of(model.name, [model.describe()], None) if title is None else title
    head, foot = 0.44 + 0.17 * text.count("\n"), 0.98
    axes = figure.add_axes((0.9 / broad, foot / tall, 1 - 1.06 / broad, 1 - (foot + head) / tall))
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    bare(axes)
    objective = getattr(model, "objective", None)
    what = str(objective) if isinstance(objective, str) else "objective"
    own = model.objective_unit
    axes.set_xlabel(_named(first.second, own if unit is None else unit), fontsize=8.5)
    axes.set_ylabel(_named(what, own), fontsize=8.5)
    axes.plot(*removed.T, ls="", marker="x", ms=5, color=GREY, zorder=2, gid="dominated")
    colours = [axis_style(k)["color"] if len(drawn) > 1 else BLACK for k in range(len(drawn))]
    for rows, colour in zip(drawn.values(), colours, strict=True):
        _draw_one(axes, rows, colour, high)
    if labels if labels is not None else len(drawn) == 1 and len(places) <= _MOST_NUMBERS:
        for x, y in places:
            # Left of and below a point there are no steps.
            axes.annotate(
                f"({number(x, 5)}, {number(y, 5)})", (x, y), (-5, -5), textcoords="offset points",
                ha="right", va="top", fontsize=7, color=DARK, zorder=6, annotation_clip=False,
            )  # fmt: skip
    every = np.concatenate(list(drawn.values()))
    keys = _keys(drawn, colours, every, len(removed), float(low[1]))
    legend_below(figure, keys, rows=1 + (len(keys) > 5))
    headline(figure, text, wrong=False)
    return figure


def _rows(points: Sequence[Any]) -> Floats:
    """Return second objective, objective, bound (NaN for none) and whether proven, a row a point.

    In the order of the second objective; what has no finite objectives is left out.
    """
    found = np.array(
        [
            (one.second, one.objective, getattr(one.solution, "dual_bound", None), one.proven)
            for one in points
        ],
        float,
    ).reshape(-1, 4)
    found = found[np.isfinite(found[:, :2]).all(axis=1)]
    return np.asarray(found[np.lexsort((found[:, 1], found[:, 0]))])


def _box(places: Floats, bounds: Floats) -> tuple[Floats, Floats]:
    """Return the corners of what the axes show: all points, and the bounds that are near them."""
    low, high = places.min(axis=0), places.max(axis=0)
    # What differs by rounding only is not blown up.
    size = np.maximum(np.abs(low), np.abs(high))
    span = np.where(high - low > 1e-9 * size, high - low, 0.1 * size)
    span[span == 0.0] = 1.0
    near = bounds[np.isfinite(bounds) & (bounds >= low[1] - _FAR * span[1])]
    low[1] = near.min(initial=low[1])
    span[1] = max(span[1], high[1] - low[1])
    return low - [_LEFT, _MARGIN] * span, high + _MARGIN * span


def _named(what: str, unit: str) -> str:
    return f"{what} ({pretty_unit(unit)})" if unit else what


def _draw_one(axes: Any, rows: Floats, colour: str, high: Floats) -> None:
    """Draw steps, markers and bounds of one front."""
    from matplotlib.collections import LineCollection

    if not len(rows):
        return
    x, y, bound, proven = rows.T
    # The first point is reached from above, the last one left to the right.
    steps = np.concatenate([[[x[0], high[1]]], rows[:, :2], [[high[0], y[-1]]]])
    axes.plot(*steps.T, drawstyle="steps-post", color=colour, lw=1.2, zorder=3, gid="steps")
    for solid, face in ((True, colour), (False, "white")):
        mine = proven.astype(bool) == solid
        axes.plot(
            x[mine], y[mine], ls="", marker="o", ms=6, mfc=face, mec=colour, mew=1.3, zorder=5,
            gid="proven" if solid else "not proven",
        )  # fmt: skip
    least = axes.get_ylim()[0]
    seen = np.isfinite(bound) & (bound >= least)
    axes.plot(
        x[seen], bound[seen], ls="", marker="_", ms=11, mew=1.6, color=colour, zorder=4, gid="bound",
    )  # fmt: skip
    rods = np.stack([x, bound, x, y], axis=1)[seen].reshape(-1, 2, 2)
    axes.add_collection(
        LineCollection(list(rods), color=colour, lw=0.7, ls=":", zorder=2.5, gid="gap"),
        autolim=False,
    )
    far = np.isfinite(bound) & ~seen
    axes.plot(
        x[far], np.zeros(int(far.sum())), ls="", marker="v", ms=5, color=colour, zorder=4,
        transform=axes.get_xaxis_transform(), clip_on=False, gid="bound out of sight",
    )  # fmt: skip


def _keys(
    drawn: Mapping[str, Floats], colours: Sequence[str], every: Floats, removed: int, least: float
) -> list[Any]:
    """Return the entries of the legend: names of fronts, and of what is drawn."""
    keys = [key(name, color=colour, lw=1.6) for name, colour in zip(drawn, colours, strict=True)]
    keys = keys if len(drawn) > 1 else []
    bound, proven = every[:, 2], every[:, 3].astype(bool)
    round_ = {"marker": "o", "ms": 6, "mec": BLACK, "mew": 1.3}
    keys += [key("proven", **round_, mfc=BLACK)] * bool(proven.any())
    keys += [key("not proven", **round_, mfc="white")] * bool((~proven).any())
    keys += [key("proven bound", marker="_", ms=11, mew=1.6, color=BLACK)] * bool(
        (bound >= least).any()
    )
    keys += [key("bound out of sight", marker="v", ms=5, color=BLACK)] * bool((bound < least).any())
    keys += [key("dominated", marker="x", ms=5, color=GREY)] * bool(removed)
    return keys
