"""Panels over time for any problem: curves, limits, violations and the mesh.

A picture collects its data and passes them on::

    speed = Panel("speed", "m/s", [Curve("v", 0, times, v)], [Limit(times[[0, -1]], 0.0, 5.0)])
    panel_sheet([speed], [Span("", 0.0, 9.0, knots)], title=title_of(model.name, [], found),
                wrong=not found.ok, columns=1, label="time (s)")
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .curves import Floats, Mark, Panel, Span, range_of, worst_of
from .style import (
    BLACK,
    DARK,
    GREY,
    LINE,
    MOST_KNOTS,
    RED,
    RING,
    axis_style,
    bare,
    colour_of,
    headline,
    inches,
    key,
    label_axes,
    legend_row,
    number,
    sheet,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_panel", "draw_panels", "keys_of", "panel_sheet"]

#: Largest numbers of nodes drawn as dots, of knots drawn as ticks, and of curves with a name.
_MOST_NODES, _MOST_TICKS, _MOST_NAMES = 240, 100, 6
_SHADED = "#E69F00"
#: Markers by label in the legend, in addition to their colour.
_MARKS: dict[str, dict[str, Any]] = {
    "node": {"ms": 2.0, "mew": 0, "zorder": 3.5},
    "fixed value": {"ms": 3.2, "mfc": "white", "mew": 0.9},
    "waypoint": {"ms": 4.5, "mfc": "white", "mec": BLACK, "mew": 0.9},
    "worst violation": {**RING, "mew": 1.5, "zorder": 7, "clip_on": False},
}
#: Height of a panel with its labels, and of the space above and below all panels (inch).
_ROW, _HEAD, _FOOT = 1.42, 0.84, 0.50
#: Width of a legend key and of its letters (inch).
_KEY, _LETTER = 0.43, 0.06
#: Space to the left of the first column, between columns, and to the right of the last (inch).
_LEFT, _GAP, _RIGHT = 0.92, 1.02, 0.15
#: Number of letters per line beside a panel.
_LETTERS = 18


def panel_sheet(
    panels: Sequence[Panel], spans: Sequence[Span], *, title: str, wrong: bool, columns: int,
    size: Any = None, **how: Any,
) -> Figure:  # fmt: skip
    """Return a figure that consists of panels; `how` are options of :func:`draw_panels`.

    `size` is width and height (inch), by default as required by the panels.
    """
    rows = -(-len(panels) // columns)
    high = _head(title, spans) + _FOOT + _ROW * rows
    figure = sheet(size, (4.5 + 4.1 * (columns - 1) + 1.2 * (columns == 1), high))
    draw_panels(figure, panels, spans, title=title, wrong=wrong, columns=columns, **how)
    headline(figure, title, wrong=wrong)
    return figure


def draw_panels(
    figure: Any, panels: Sequence[Panel], spans: Sequence[Span], *, title: str, wrong: bool,
    label: str, columns: int = 1, mesh: bool = True, ruled: bool = False, guess: bool = False,
    keys: Sequence[Any] = (),
) -> list[Axes]:  # fmt: skip
    """Draw panels with a common time axis, column by column, below a legend, and return their axes.

    Consecutive phases `spans` are shaded and named. Space is reserved for the `title` of the figure, and `label`
    is written below each column. The worst places are ringed if the plan is `wrong`. `mesh` draws nodes and knots,
    `ruled` knots as lines through the panel rather than ticks at its foot. The curves of a `guess` are dashed, and
    `keys` are additional entries of the legend, see :func:`.style.key`.
    """
    rows = -(-len(panels) // columns)
    broad, tall = inches(figure)
    wide = (broad - _LEFT - _RIGHT - _GAP * (columns - 1)) / columns
    figure.subplots_adjust(
        left=min(_LEFT / broad, 0.3), right=max(1 - _RIGHT / broad, 0.8), hspace=0.3,
        bottom=min(_FOOT / tall, 0.3), top=max(1 - _head(title, spans) / tall, 0.6),
        wspace=_GAP / max(wide, 0.1),
    )  # fmt: skip
    names = {tuple(dict.fromkeys(curve.name for curve in panel.curves)) for panel in panels}
    shared = len(panels) > 1 and len(names) == 1
    grid = figure.add_gridspec(rows, columns)
    places: list[Axes] = []
    for k, panel in enumerate(panels):
        row, column = k % rows, k // rows
        axes = figure.add_subplot(grid[row, column])
        draw_panel(panel, axes, spans, wrong=wrong, mesh=mesh, ruled=ruled, guess=guess)
        if row == 0:
            _name_phases(axes, spans)
        curve_keys = _curve_keys(panel)
        if not shared and len(curve_keys) > 1:
            # In a row above the panel, so that the names hide nothing.
            tight: dict[str, Any] = {"handlelength": 1.3, "columnspacing": 1.0, "borderaxespad": 0}
            legend_row(axes, curve_keys, "lower right", (1.0, 0.97), **tight)
        if row + 1 < rows and k + 1 < len(panels):
            axes.tick_params(labelbottom=False)
        else:
            label_axes(axes, label)
        places.append(axes)
    for column in range(columns):
        figure.align_ylabels(places[column * rows : (column + 1) * rows])
    curve_keys = _curve_keys(panels[0]) if shared else []
    entries = [*curve_keys, *keys_of(panels, places, guess=guess), *keys]
    # In two rows if one row is too narrow.
    rows = 1 + (sum(_KEY + _LETTER * len(entry.get_label()) for entry in entries) > broad)
    place = (0.5, 1 - (0.34 + LINE * title.count("\n")) / tall)
    legend_row(figure, entries, "upper center", place, rows=rows)
    return places


def keys_of(panels: Sequence[Panel], places: Sequence[Axes], *, guess: bool = False) -> list[Any]:
    """Return the legend entries for the artists of `panels` in `places`."""
    from matplotlib.patches import Patch

    drawn = {artist.get_gid() for axes in places for artist in (*axes.lines, *axes.collections)}
    entries = [key("guess", color=GREY, lw=1.3, ls=(0, (5, 2)))] if guess else []
    limits = [limit for panel in panels for limit in panel.limits]
    for label, dashes in {limit.label: limit.dashes for limit in limits}.items():
        if label in drawn:
            entries.append(key(label, color=DARK, ls=dashes, lw=1.0))
    if "forbidden" in drawn:
        entries.append(Patch(facecolor=RED, alpha=0.08, label="forbidden"))
    for band in dict.fromkeys(limit.band for limit in limits if limit.band in drawn):
        entries.append(Patch(facecolor=DARK, alpha=0.13, label=band))
    marks = {mark.label: mark for panel in panels for mark in panel.marks}
    for label in dict.fromkeys([*marks, "worst violation"]):
        if label in drawn:
            marker = _MARKS.get(label) or axis_style(marks[label].colour) | dict(marks[label].look)
            look = {"marker": "o", "color": GREY, "mec": GREY, **marker}
            entries.append(key(label, **look | {"ms": max(3.2, look.get("ms", 5.0)), "ls": ""}))
    if "knot" in drawn:
        entries.append(key("knot of the mesh", color=BLACK, marker="|", ms=7))
    for shade in dict.fromkeys(word for panel in panels for word in panel.shades):
        entries.append(Patch(facecolor=_SHADED, alpha=0.25, label=shade))
    return entries


# -- one panel -----------------------------------------------------------------------------------


def draw_panel(
    panel: Panel, axes: Axes, spans: Sequence[Span], *, wrong: bool, mesh: bool = True,
    ruled: bool = False, guess: bool = False,
) -> None:  # fmt: skip
    """Draw one panel; the options are those of :func:`draw_panels`."""
    low, high = range_of(panel)
    notes = _draw_limits(panel, axes, low, high)
    for begin, end in itertools.chain.from_iterable(panel.shades.values()):
        axes.axvspan(begin, end, color=_SHADED, alpha=0.25, lw=0, zorder=0.7, gid="shade")
    if _sequential(spans):
        for span in spans[1::2]:
            axes.axvspan(span.start, span.end, color="#eef1f4", lw=0, zorder=0.4, gid="phase")
        for span in spans[1:]:
            axes.axvline(span.start, color="#b9c2cb", lw=0.8, zorder=0.9)
    for curve in panel.curves:
        style = {**axis_style(curve.colour), **({"ls": (0, (5, 2)), "alpha": 0.8} if guess else {})}
        values = np.abs(curve.values) if panel.log else curve.values
        axes.plot(curve.times, values, lw=curve.width, zorder=3, gid=f"curve {curve.name}", **style)
    _draw_marks(panel, axes, wrong=wrong, mesh=mesh and not guess)
    if mesh and not guess:
        _draw_knots(axes, spans, ruled=ruled)
    first, last = min(span.start for span in spans), max(span.end for span in spans)
    edge = 0.015 * (last - first)
    axes.set_xlim(first - edge, last + edge)
    axes.set_ylim(low, high)
    _scale(panel, axes, low, high)
    wrapped = [part for line in panel.title.split("\n") for part in textwrap.wrap(line, _LETTERS)]
    lines = [*wrapped, with_unit("", panel.unit).strip()]
    # A label may use the gap to the next panel, but not that panel.
    tall = 1.25 * axes.get_position().height * inches(axes.figure)[1]
    least = max(map(len, lines), default=0) * _LETTER
    axes.set_ylabel("\n".join(lines), fontsize=8 * min(1.0, max(0.6, tall / max(least, 0.1))))
    bare(axes)
    if ruled:
        axes.grid(visible=False, axis="x")
    if notes:
        axes.set_title("; ".join(notes), fontsize=7, color="#505050", loc="left", pad=2.5)


def _scale(panel: Panel, axes: Axes, low: float, high: float) -> None:
    from matplotlib.ticker import MaxNLocator

    broad, tall = np.array(axes.get_position().size) * inches(axes.figure)
    ticks = int(np.clip(2.1 * broad, 4, 9))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=ticks, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(lambda value, _: number(value))
    if panel.log:
        axes.set_yscale("log")
        axes.set_ylim(low, high)
        return
    ticks = int(np.clip(3 * tall, 4, 6))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=ticks, steps=[1, 2, 5, 10]))
    # Enough digits to distinguish neighbouring ticks.
    digits = max(6, 3 + int(np.ceil(np.log10(max(abs(low), abs(high)) / (high - low)))))
    axes.yaxis.set_major_formatter(lambda value, _: number(value, digits))


# -- limits and marks ----------------------------------------------------------------------------


def _draw_limits(panel: Panel, axes: Axes, low: float, high: float) -> list[str]:
    """Draw the limits, and return a description of those out of sight."""
    notes: list[str] = []
    several = len({curve.colour for curve in panel.curves}) > 1
    for limit in panel.limits:
        bounded = [curve.name for curve in panel.curves if curve.colour in limit.colours]
        whose = ", ".join(dict.fromkeys(bounded))
        colour = DARK
        if len(limit.colours) == 1 and several:
            colour = colour_of(limit.colours[0])
        line: dict[str, Any] = {"ls": limit.dashes, "lw": 1.0}
        if limit.colours and len(limit.times) > 2 * MOST_KNOTS:
            line = {"ls": "-", "lw": 0.5}
        lower, upper = limit.sides
        hidden: list[tuple[str, Floats]] = []
        for edge, beyond, sign in ((lower, low, "≥"), (upper, high, "≤")):
            finite = edge[np.isfinite(edge)]
            if not finite.size:
                continue
            if not ((finite >= low) & (finite <= high)).any():
                hidden.append((sign, finite))
                continue
            shown = np.where(np.isfinite(edge), edge, np.nan)
            axes.plot(limit.times, shown, color=colour, zorder=2, gid=limit.label, **line)
            if limit.shaded and not limit.colours and (lower < upper).any():
                axes.fill_between(
                    limit.times, np.clip(edge, low, high), beyond, where=list(lower < upper), lw=0,
                    color=RED, alpha=0.08, zorder=0.6, gid="forbidden",
                )  # fmt: skip
            if len(limit.colours) > 1 and np.isfinite(shown[-1]):
                axes.annotate(
                    whose, (1.0, shown[-1]), xycoords=axes.get_yaxis_transform(), fontsize=6.5,
                    color=colour, ha="right", va="bottom", annotation_clip=True,
                )  # fmt: skip
        if limit.band:
            axes.fill_between(
                limit.times, np.clip(lower, low, high), np.clip(upper, low, high), color=colour,
                alpha=0.13, lw=0, zorder=0.6, gid=limit.band,
            )  # fmt: skip
        if len(hidden) == 2 and np.array_equal(-hidden[0][1], hidden[1][1]):
            hidden = [(f"{limit.label} ±", hidden[1][1])]
        for sign, finite in hidden:
            ends = dict.fromkeys(number(float(end), 4) for end in (finite.min(), finite.max()))
            text = f"{sign}{'' if '±' in sign else ' '}{' … '.join(ends)}"
            notes.append(f"{whose} {text}" if whose else text)
    return list(dict.fromkeys(notes))


def _draw_marks(panel: Panel, axes: Axes, *, wrong: bool, mesh: bool) -> None:
    dots = sum(mark.values.size for mark in panel.marks if mark.label == "node")
    marks = list(panel.marks)
    worst = worst_of(panel) if wrong else None
    if worst is not None:
        marks.append(Mark("worst violation", *worst))
    for mark in marks:
        if mark.label != "node" or (mesh and dots <= _MOST_NODES):
            look: dict[str, Any] = {"marker": "o", "color": colour_of(mark.colour), "zorder": 4}
            look |= {**_MARKS.get(mark.label, {}), **mark.look}
            axes.plot(mark.times, mark.values, ls="", gid=mark.label, **look)
    notes = [mark.note for mark in panel.marks if mark.note]
    if notes:
        rest = f" (and {len(notes) - 1} more)" if len(notes) > 1 else ""
        axes.set_title(notes[0] + rest, fontsize=7.5, color=RED, loc="right", pad=2.5)


def _draw_knots(axes: Axes, spans: Sequence[Span], *, ruled: bool) -> None:
    knots = np.unique(np.concatenate([span.knots for span in spans]))
    across = axes.get_xaxis_transform()
    if ruled and knots.size <= MOST_KNOTS:
        axes.vlines(knots, 0, 1, transform=across, color="#dcdcdc", lw=0.6, zorder=0.8)
    elif not ruled and 2 < knots.size <= _MOST_TICKS:
        axes.plot(
            knots, np.zeros(knots.size), ls="", marker="|", ms=7, mew=0.8, color=BLACK, zorder=4,
            transform=across, clip_on=False, gid="knot",
        )  # fmt: skip


# -- names ---------------------------------------------------------------------------------------


def _curve_keys(panel: Panel) -> list[Any]:
    first = {curve.name: curve.colour for curve in reversed(panel.curves)}
    names = list(dict.fromkeys(curve.name for curve in panel.curves))
    keys = [key(name, lw=1.6, **axis_style(first[name])) for name in names[:_MOST_NAMES]]
    return keys + [key(f"… {len(names)} in all", ls="")] * (len(names) > _MOST_NAMES)


def _name_phases(axes: Axes, spans: Sequence[Span]) -> None:
    """Write the names of phases above a column, and above the row of curve names."""
    for span in spans if _sequential(spans) else ():
        axes.annotate(
            span.name, (0.5 * (span.start + span.end), 1.0), (0, 13), fontsize=7.5,
            xycoords=axes.get_xaxis_transform(), textcoords="offset points", ha="center",
            va="bottom", color="#505050", annotation_clip=False,
        )  # fmt: skip


def _sequential(spans: Sequence[Span]) -> bool:
    """Return whether there are several phases, each after the one before."""
    return len(spans) > 1 and all(
        later.start >= earlier.end - 1e-9 * max(1.0, abs(earlier.end))
        for earlier, later in itertools.pairwise(spans)
    )


def _head(title: str, spans: Sequence[Span]) -> float:
    """Return the height of the space above the panels (inch)."""
    return _HEAD + LINE * (title.count("\n") + _sequential(spans))
