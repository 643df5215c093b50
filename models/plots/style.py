"""Common style of all pictures: figures and titles, colours, legends, numbers and units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..verification import Verification
from .options import check_size

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "BLACK", "DARK", "GREY", "LABEL", "LINE", "MOST_KNOTS", "RED", "RING", "axis_style", "bare",
    "colour_of", "headline", "inches", "key", "label_axes", "legend_row", "legend_rows", "log_ticks",
    "many", "number", "pretty_unit", "sheet", "title_of", "with_unit",
]  # fmt: skip

# Colours of Okabe and Ito, which are distinguishable with colour blindness and as greys in print.
BLACK, DARK, GREY, RED = "#1a1a1a", "#404040", "#8c8c8c", "#C8102E"
_LINES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#7F6000", "#1a1a1a")
#: Marker of the worst violation.
RING: dict[str, Any] = {"marker": "o", "ms": 8, "mfc": "none", "mec": RED}
#: Largest number of knots drawn as lines or with numbers.
MOST_KNOTS = 60
#: Size of a title, of the label of an axis and of a legend (point), and width of a character of a title (inch).
_TITLE, LABEL, _KEYS, _CHARACTER = 11.0, 8.5, 7.5, 0.086
#: Height of a line of a title or of a legend, and letters of a legend per inch.
LINE, _LETTERS = 0.17, 14.0

_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def sheet(size: Any, default: tuple[float, float]) -> Figure:
    """Return an empty figure of `size` (inch), or `default` for None, without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=check_size(size, default), dpi=150)
    FigureCanvasAgg(figure)
    return figure


def inches(figure: Any) -> tuple[float, float]:
    """Return width and height of a figure or of a part of one (inch)."""
    return float(figure.bbox.width / figure.dpi), float(figure.bbox.height / figure.dpi)


def headline(figure: Figure, text: str, *, wrong: bool) -> None:
    """Write the title, in red if the plan is `wrong`, and smaller if it is too wide."""
    broad, tall = inches(figure)
    longest = max(map(len, text.split("\n")), default=0) or 1
    figure.suptitle(
        text, fontsize=_TITLE * max(0.4, min(1.0, (broad - 0.2) / (_CHARACTER * longest))),
        y=1 - 0.12 / tall, va="top", color=RED if wrong else BLACK,
    )  # fmt: skip


def title_of(
    model: Any, parts: Sequence[str], result: Verification | None, title: str | None = None
) -> str:
    """Return `title`, or the name with `parts`, and a second line with the violations of the plan."""
    if title is not None:
        return title
    name, text = getattr(model, "name", ""), ", ".join(parts)
    text = f"{name}  ·  {text}" if name else text
    if result is None or result.ok:
        return text
    violated = [check.name for check in result.violated]
    rest = f" and {len(violated) - 2} more" if len(violated) > 2 else ""
    return f"{text}\nNOT VALID: {', '.join(violated[:2]) or 'no objective'}{rest}"


def axis_style(axis: int) -> dict[str, Any]:
    """Return colour and dashes of an index; they repeat after 21 indices."""
    dashes = ("-", "-.", ":")[axis // len(_LINES) % 3]
    return {"color": colour_of(axis), "ls": dashes}


def colour_of(index: int) -> str:
    """Return the colour of an index."""
    return _LINES[index % len(_LINES)]


def bare(axes: Axes) -> None:
    """Remove the top and right spines, and draw a faint grid."""
    axes.tick_params(labelsize=8)
    axes.grid(color="#ececec", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def label_axes(axes: Any, x: str | None = None, y: str | None = None) -> None:
    """Write the labels of the axes, None leaves a label unchanged."""
    for label, write in ((x, axes.set_xlabel), (y, axes.set_ylabel)):
        if label is not None:
            write(label, fontsize=LABEL)


def key(label: str, **look: Any) -> Any:
    """Return an entry of a legend: a marker if `look` has one, otherwise a line."""
    from matplotlib.lines import Line2D

    if "marker" in look:
        look.setdefault("ls", "")
    return Line2D([], [], label=label, **look)


def legend_row(
    where: Any, keys: Sequence[Any], loc: str, place: tuple[float, float], *, rows: int = 1,
    **look: Any,
) -> None:  # fmt: skip
    """Write a legend in `rows` rows in a figure, a part of one or axes; nothing without `keys`.

    `loc` is the corner of the legend at `place`, with matplotlib's names. A legend that is too wide for the
    figure, or the part of it, is written smaller.
    """
    if not keys:
        return
    settings = {"handletextpad": 0.4, "columnspacing": 1.2, "frameon": False, **look}
    settings |= {"loc": loc, "bbox_to_anchor": place, "ncols": -(-len(keys) // rows)}
    legend = where.legend(handles=keys, fontsize=_KEYS, **settings)
    scale = _room(legend, loc)
    if scale < 1:
        legend.remove()
        where.legend(handles=keys, fontsize=_KEYS * scale, markerscale=scale, **settings)


def _room(legend: Any, loc: str) -> float:
    """Return the available width relative to that of a legend, at most 1."""
    inside = (legend.parent.figure if legend.isaxes else legend.parent).bbox
    box = legend.get_window_extent()
    middle = (box.x0 + box.x1) / 2
    room = {
        "center": 2 * min(middle - inside.x0, inside.x1 - middle),
        "right": box.x1 - inside.x0,
        "left": inside.x1 - box.x0,
    }[loc.split()[1]]
    # Text is up to 8 % wider in a coarser picture.
    return float(np.clip(room / (1.08 * box.width), 0.3, 1.0))


def legend_rows(keys: Sequence[Any], broad: float) -> int:
    """Return the smallest number of rows of a legend that fits a figure `broad` inches wide."""
    widths = [6 + len(entry.get_label()) for entry in keys]
    for rows in range(1, len(keys)):
        # Matplotlib fills the columns one after another, the first ones with one entry more.
        columns = np.array_split(widths, -(-len(keys) // rows))
        if sum(column.max() for column in columns) <= _LETTERS * broad:
            return rows
    return len(keys)


def log_ticks(axis: Any, low: float, high: float) -> None:
    """Set legible ticks on a logarithmic axis from `low` to `high`."""
    from matplotlib.ticker import LogLocator, NullFormatter

    few = bool(high < 30 * low)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=5))
    axis.set_minor_formatter(NullFormatter())
    if few:
        axis.set_major_formatter(lambda value, _: number(value, 3))


def number(value: float, digits: int = 6) -> str:
    """Return ``"6566.48"``, or ``"1.23457×10⁹"`` for numbers with many zeros."""
    mantissa, mark, power = f"{value:.{digits}g}".partition("e")
    raised = f"×10{str(int(power)).translate(_SUPERSCRIPTS)}" if mark else ""
    return mantissa.replace("-", "−") + raised


def many(count: int, noun: str) -> str:
    """Return ``"1 vehicle"`` or ``"3 vehicles"``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def pretty_unit(unit: str) -> str:
    """Return ``"m/s²"`` for ``"m/s^2"``."""
    base, mark, power = unit.partition("^")
    return base + power.translate(_SUPERSCRIPTS) if mark else unit


def with_unit(name: str, unit: str) -> str:
    """Return a label with its unit, ``"–"`` for a number without one."""
    return f"{name} ({pretty_unit(unit) or '–'})"
