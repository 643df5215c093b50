"""Panels over time: curves, what bounds them, and the mesh below; for any optimal control problem."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..verification import Verification
from .curves import Panel, Span
from .options import check_size
from .style import BLACK, GREY, RED, axis_style, bare, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["figure_of", "not_valid"]


#: More nodes than this in a panel are no dots any more, more knots no ticks, more curves have no name.
_MOST_NODES, _MOST_KNOTS, _MOST_NAMES = 240, 100, 6
#: A limit farther away than this many times the height of the curves is told in words.
_FAR = 1.2
_LIMIT = "#404040"
#: Other lines at a height: kind, dashes, and what the legend says.
_OTHERS = (
    ("reserve", ":", "limit, nothing in reserve"),
    ("paper", "-.", "kept by the paper's controller"),
)
#: Height of a panel with its words, and what stands above and below all of them (inch).
_ROW, _HEAD, _FOOT = 1.42, 0.84, 0.50
#: Left of the first column and between two, for labels (inch).
_LEFT = 0.92
_GAP = 1.02
#: Letters of a line beside a panel.
_LETTERS = 18
#: Size of the title, and how wide a character of it is (inch).
_TITLE, _CHARACTER = 11.0, 0.086
#: Decades that a logarithmic panel shows at the most.
_DECADES = 12


def not_valid(found: Verification | None) -> str:
    """Return the line of a title that says what a plan breaks; empty where it holds."""
    if found is None or found.ok:
        return ""
    broken = [check.name for check in found.violated]
    more = f" and {len(broken) - 2} more" if len(broken) > 2 else ""
    return f"\nNOT VALID: {', '.join(broken[:2]) or 'no objective'}{more}"


# -- the sheet -----------------------------------------------------------------------------------


def figure_of(
    panels: Sequence[Panel], spans: Sequence[Span], *, columns: int, title: str, wrong: bool,
    time_unit: str, size: Any = None, dotted: bool = True, guess: bool = False,
) -> Figure:  # fmt: skip
    """Return a sheet of panels, column by column, with one time for all.

    Parameters
    ----------
    panels : sequence of Panel
        What to draw, from the top of the first column on.
    spans : sequence of Span
        The phases; where several follow one another, they are shaded and named.
    columns : int
        Number of columns.
    title : str
        Above all.
    wrong : bool
        Whether the title is a warning.
    time_unit : str
        Unit of time.
    size : (float, float), optional
        Width and height (inch).
    dotted : bool
        Whether nodes and knots are drawn.
    guess : bool
        Whether what is drawn is a guess and no plan.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(panels) // columns)
    head = _HEAD + 0.17 * (title.count("\n") + _sequential(spans))
    default = (4.5 + 4.1 * (columns - 1) + 1.2 * (columns == 1), head + _FOOT + _ROW * rows)
    broad, tall = check_size(size, default)
    figure = Figure(figsize=(broad, tall), dpi=150)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(rows, columns)
    low, high = min(_FOOT / tall, 0.3), max(1 - head / tall, 0.6)
    figure.subplots_adjust(
        left=min(_LEFT / broad, 0.3), right=max(1 - 0.15 / broad, 0.8), bottom=low, top=high,
        hspace=0.3, wspace=_GAP / max((broad - _LEFT - 0.15 - _GAP * (columns - 1)) / columns, 0.1),
    )  # fmt: skip
    places = [figure.add_subplot(grid[k % rows, k // rows]) for k in range(len(panels))]
    named = [k % rows == 0 for k in range(len(panels))]
    for panel, axes, top in zip(panels, places, named, strict=True):
        _draw(panel, axes, spans, dotted=dotted, named=top, guess=guess)
    for column in range(columns):
        own = [places[k] for k in range(len(panels)) if k // rows == column]
        for axes in own[:-1]:
            axes.tick_params(labelbottom=False)
        if own:
            own[-1].set_xlabel(f"time ({time_unit})" if time_unit else "time", fontsize=8.5)
            figure.align_ylabels(own)
    figure.suptitle(title, fontsize=11, y=1 - 0.12 / tall, va="top", color=RED if wrong else BLACK)
    handles = _handles(panels, places, guess)
    if handles:
        figure.legend(
            handles=handles, loc="upper center", ncols=len(handles), fontsize=7.5, frameon=False,
            bbox_to_anchor=(0.5, 1 - (0.34 + 0.17 * title.count("\n")) / tall), handletextpad=0.4,
            columnspacing=1.4,
        )  # fmt: skip
    return figure


def _handles(panels: Sequence[Panel], places: Sequence[Axes], guess: bool) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    drawn = {artist.get_gid() for axes in places for artist in (*axes.lines, *axes.collections)}
    found: list[Any] = []
    if guess:
        found.append(Line2D([], [], color=GREY, lw=1.3, ls=(0, (5, 2)), label="guess"))
    if "limit" in drawn:
        found.append(Line2D([], [], color=_LIMIT, ls="--", lw=1.0, label="limit"))
    for kind, style, label in _OTHERS:
        if kind in drawn:
            found.append(Line2D([], [], color=_LIMIT, ls=style, lw=1.1, label=label))
    if "node" in drawn:
        found.append(Line2D([], [], color=GREY, ls="", marker="o", ms=3.2, label="node"))
    if "knot" in drawn:
        found.append(Line2D([], [], color=BLACK, ls="", marker="|", ms=7, label="knot of the mesh"))
    if any(panel.shades for panel in panels):
        found.append(Patch(facecolor="#E69F00", alpha=0.25, label="saturated"))
    if "violation" in drawn:
        found.append(
            Line2D([], [], ls="", marker="o", ms=8, mfc="none", mec=RED, label="worst violation")
        )
    return found


# -- one panel -----------------------------------------------------------------------------------


def _draw(
    panel: Panel, axes: Axes, spans: Sequence[Span], *, dotted: bool, named: bool, guess: bool
) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    low, high = _range(panel)
    notes = _limits(panel, axes, low, high)
    for begin, end in panel.shades:
        axes.axvspan(begin, end, color="#E69F00", alpha=0.25, lw=0, zorder=0.7, gid="saturated")
    _phases(axes, spans, named)
    dashes: dict[str, Any] = {"ls": (0, (5, 2)), "alpha": 0.8} if guess else {}
    dots = sum(curve.nodes.size for curve in panel.curves)
    for curve in panel.curves:
        style = {**axis_style(curve.colour), **dashes}
        values = np.abs(curve.values) if panel.log else curve.values
        axes.plot(curve.times, values, lw=1.4, zorder=3, gid=f"curve {curve.name}", **style)
        if dotted and not guess and 0 < dots <= _MOST_NODES:
            axes.plot(
                curve.node_times, curve.nodes, ls="", marker="o", ms=2.0, mew=0, zorder=3.5,
                color=style["color"], gid="node",
            )  # fmt: skip
    knots = np.unique(np.concatenate([span.knots for span in spans]))
    if dotted and not guess and 2 < knots.size <= _MOST_KNOTS:
        axes.plot(
            knots, np.zeros(knots.size), ls="", marker="|", ms=7, mew=0.8, color=BLACK, zorder=4,
            transform=axes.get_xaxis_transform(), clip_on=False, gid="knot",
        )  # fmt: skip
    _rings(panel, axes)
    first, last = min(span.start for span in spans), max(span.end for span in spans)
    edge = 0.015 * (last - first)
    axes.set_xlim(first - edge, last + edge)
    if panel.log:
        axes.set_yscale("log")
    axes.set_ylim(low, high)
    if not panel.log:
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
        # As many digits as tell neighbouring ticks apart.
        digits = 3 + max(0, int(np.ceil(np.log10(max(abs(low), abs(high)) / (high - low)))))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, digits)))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 6)))
    wrapped = [part for line in panel.title.split("\n") for part in textwrap.wrap(line, _LETTERS)]
    label = "\n".join([*wrapped, *([f"({panel.unit})"] if panel.unit else [])])
    axes.set_ylabel(label, fontsize=8)
    bare(axes)
    _names(panel, axes)
    if notes:
        axes.set_title("; ".join(notes), fontsize=7, color="#505050", loc="left", pad=2.5)


def _names(panel: Panel, axes: Axes) -> None:
    """Name the curves in a row above the panel, where they hide nothing."""
    from matplotlib.lines import Line2D

    first = {curve.name: curve.colour for curve in reversed(panel.curves)}
    names = list(dict.fromkeys(curve.name for curve in panel.curves))
    if len(names) < 2:
        return
    handles = [
        Line2D([], [], lw=1.6, label=name, **axis_style(first[name]))
        for name in names[:_MOST_NAMES]
    ]
    if len(names) > _MOST_NAMES:
        handles.append(Line2D([], [], ls="", label=f"… {len(names)} in all"))
    axes.legend(
        handles=handles, loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=len(handles),
        fontsize=7.5, frameon=False, handlelength=1.3, handletextpad=0.4, columnspacing=1.0,
        borderaxespad=0.0,
    )  # fmt: skip


def _sequential(spans: Sequence[Span]) -> bool:
    """Return whether there are several phases, each after the one before."""
    return len(spans) > 1 and all(
        later.start >= earlier.end - 1e-9 * max(1.0, abs(earlier.end))
        for earlier, later in itertools.pairwise(spans)
    )


def _phases(axes: Axes, spans: Sequence[Span], named: bool) -> None:
    """Shade every other phase, and write their names above the first panel of a column."""
    if not _sequential(spans):
        return
    for k, span in enumerate(spans):
        if k % 2:
            axes.axvspan(span.start, span.end, color="#eef1f4", lw=0, zorder=0.4, gid="phase")
        if k:
            axes.axvline(span.start, color="#b9c2cb", lw=0.8, zorder=0.9)
        if named:
            # Above the row in which curves are named.
            axes.annotate(
                span.name, (0.5 * (span.start + span.end), 1.0), (0, 13), fontsize=7.5,
                xycoords=axes.get_xaxis_transform(), textcoords="offset points", ha="center",
                va="bottom", color="#505050", annotation_clip=False,
            )  # fmt: skip


def _range(panel: Panel) -> tuple[float, float]:
    """Return the limits of the panel: of the curves, and of the bounds that are near them."""
    values = np.concatenate([np.empty(0), *(curve.values for curve in panel.curves)])
    values = values[np.isfinite(values)]
    edges = [
        edge for limit in panel.limits for edge in (limit.lower, limit.upper) if np.isfinite(edge)
    ]
    if panel.log:
        sizes = np.abs(np.append(values, edges))
        sizes = sizes[sizes > 0.0]
        top = float(sizes.max()) if sizes.size else 1.0
        return max(float(sizes.min()) if sizes.size else 0.1, top * 10.0**-_DECADES) / 3, 3 * top
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    span = high - low
    if span <= 1e-9 * max(1.0, abs(low), abs(high)):
        span = 0.0
    reach = _FAR * (span or max([abs(edge) for edge in edges], default=1.0) or 1.0)
    near = [edge for edge in edges if panel.whole or low - reach <= edge <= high + reach]
    low, high = min([low, *near]), max([high, *near])
    margin = 0.08 * (high - low)
    if not margin > 1e-9 * max(1.0, abs(low), abs(high)):
        margin = 0.5 * (abs(high) or 1.0)
    return low - margin, high + margin


def _limits(panel: Panel, axes: Axes, low: float, high: float) -> list[str]:
    """Draw the limits, and return those out of sight in words."""
    notes: list[str] = []
    for limit in panel.limits:
        whose = [curve.name for curve in panel.curves if curve.colour in limit.colours]
        colour = _LIMIT
        if len(limit.colours) == 1 and len({curve.colour for curve in panel.curves}) > 1:
            colour = axis_style(limit.colours[0])["color"]
        style = next((dash for kind, dash, _ in _OTHERS if kind == limit.kind), "--")
        for edge, beyond, sign in ((limit.lower, low, "≥"), (limit.upper, high, "≤")):
            if not np.isfinite(edge):
                continue
            if not low <= edge <= high:
                head = f"{', '.join(dict.fromkeys(whose))} " if whose and limit.colours else ""
                told = f"{head}{sign} {number(edge, 4)}"
                notes += [told] if told not in notes else []
                continue
            span = [limit.start, limit.end]
            axes.plot(
                span, [edge, edge], color=colour, ls=style, lw=1.0, zorder=2,
                gid=limit.kind,
            )  # fmt: skip
            if limit.kind == "limit" and not limit.colours and limit.lower < limit.upper:
                axes.fill_between(
                    span, edge, beyond, color=RED, alpha=0.08, lw=0, zorder=0.6, gid="forbidden"
                )
    return notes


def _rings(panel: Panel, axes: Axes) -> None:
    """Ring the place where each limit is exceeded most, where it is by more than its tolerance."""
    best: tuple[float, float, float] | None = None
    for limit in panel.limits:
        for curve in panel.curves:
            if limit.colours and curve.colour not in limit.colours:
                continue
            inside = (curve.times >= limit.start) & (curve.times <= limit.end)
            over = np.maximum(curve.values - limit.upper, limit.lower - curve.values)
            over = np.where(inside & np.isfinite(over), over, -np.inf)
            if not over.size:
                continue
            row = int(over.argmax())
            share = float(over[row]) / limit.tolerance if limit.tolerance > 0 else np.inf
            if over[row] > limit.tolerance and (best is None or share > best[0]):
                best = (share, float(curve.times[row]), float(curve.values[row]))
    if best is not None:
        axes.plot(
            best[1], best[2], ls="", marker="o", ms=9, mfc="none", mec=RED, mew=1.5, zorder=7,
            clip_on=False, gid="violation",
        )  # fmt: skip
