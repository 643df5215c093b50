"""Step charts as inline SVG that is legible in light and dark mode, in print and without colour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from ..report.tables import seconds_text

__all__ = ["Series", "draw_steps"]

#: Dash patterns and markers (paths of 8 units around the origin). Their counts are coprime, so that
#: 42 series differ by the pair of them. Colours repeat after 6 and are not needed to tell series apart.
_DASHES = ("", "7 3", "2 3", "9 3 2 3", "4 2", "12 4", "9 3 2 3 2 3")
_MARKERS = (
    "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0Z",
    "M-4 -4h8v8h-8Z",
    "M0 -5L5 4H-5Z",
    "M0 -5L5 0L0 5L-5 0Z",
    "M-4 -4L4 4M-4 4L4 -4",
    "M0 -5V5M-5 0H5",
)
#: Size of the drawing, its margins (left, top, right, bottom), and the height of a label, in pixels.
_WIDE, _TALL = 760, 300
_LEFT, _TOP, _RIGHT, _BOTTOM = 70, 12, 240, 46
_LINE = 15
#: Largest number of points drawn per series.
_MOST = 80
#: Largest number of characters of a label.
_LABEL = 30


class Series(NamedTuple):
    """Step function, constant from each point to the next one on its right.

    Parameters
    ----------
    label : str
        Label at its right end.
    points : sequence of (float, float)
        Finite points by increasing abscissa.
    lone : bool
        Whether it is a bound, drawn without markers.
    """

    label: str
    points: Sequence[tuple[float, float]]
    lone: bool = False


def draw_steps(
    series: Sequence[Series],
    *,
    title: str,
    across: str,
    up: str,
    share: bool = False,
    seconds: bool = False,
) -> str:
    """Return an SVG element with step functions over a logarithmic axis.

    Parameters
    ----------
    series : sequence of Series
        Step functions with abscissae > 0.
    title : str
        Text alternative of the chart.
    across, up : str
        Labels of the axes.
    share : bool
        Whether ordinates are shares from 0 to 1.
    seconds : bool
        Whether abscissae are seconds.

    Returns
    -------
    str
        Empty if there is no point, or if the range of ordinates exceeds floating point.
    """
    drawn = [item._replace(points=_thin(item.points)) for item in series if item.points]
    if not drawn:
        return ""
    xs = [x for item in drawn for x, _ in item.points]
    low, high = math.log10(min(xs)), math.log10(max(xs))
    if high - low < 0.3:
        low, high = low - 0.15, high + 0.15
    ys = [y for item in drawn for _, y in item.points]
    if not math.isfinite(2 * (max(ys) - min(ys))):
        return ""  # the range exceeds floating point
    base, top = (0.0, 1.0) if share else _range(min(ys), max(ys))
    tall = max(_TALL, _TOP + _BOTTOM + _LINE * len(drawn))
    right, foot = _WIDE - _RIGHT, tall - _BOTTOM

    def place(x: float, y: float) -> tuple[float, float]:
        along = (math.log10(x) - low) / (high - low)
        return _LEFT + along * (right - _LEFT), foot - (y - base) / (top - base) * (foot - _TOP)

    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDE} {tall}" role="img" aria-label="{escape(title)}">',
        f'<path class="axis" d="M{_LEFT} {_TOP}V{foot}H{right}"/>',
    ]
    for value in _powers(low, high):
        x, _ = place(value, base)
        text = seconds_text(value) if seconds else f"{value:.6g}"
        parts.append(f'<path class="grid" d="M{x:.1f} {_TOP}V{foot}"/>')
        parts.append(_text(x, foot + 16, text, "middle"))
    for value, text in _shares() if share else _ticks(base, top):
        _, y = place(10**low, value)
        parts.append(f'<path class="grid" d="M{_LEFT} {y:.1f}H{right}"/>')
        parts.append(_text(_LEFT - 6, y + 4, text, "end"))
    parts.append(_text((_LEFT + right) / 2, tall - 8, across, "middle"))
    middle = (_TOP + foot) / 2
    parts.append(
        f'<text x="13" y="{middle:.1f}" text-anchor="middle" transform="rotate(-90 13 {middle:.1f})">'
        f"{escape(up)}</text>"
    )
    ends = []
    for index, item in enumerate(drawn):
        places = [place(x, y) for x, y in item.points]
        path = f"M{places[0][0]:.1f} {places[0][1]:.1f}"
        path += "".join(f"H{x:.1f}V{y:.1f}" for x, y in places[1:]) + f"H{right}"
        look = f'class="s{index % 6}{" bound" if item.lone else ""}"'
        dash = "" if item.lone else _DASHES[index % len(_DASHES)]
        mark = "" if item.lone else _MARKERS[index % len(_MARKERS)]
        parts.append(
            f'<g {look} data-dash="{dash}" data-marker="{index % len(_MARKERS)}">'
            f"<title>{escape(item.label)}</title>"
        )
        parts.append(f'<path class="line" stroke-dasharray="{dash or "none"}" d="{path}"/>')
        if mark:
            spots = sorted({0, len(places) // 2, len(places) - 1})
            parts += [_mark(mark, *places[spot]) for spot in spots]
        parts.append("</g>")
        ends.append((places[-1][1], index, mark, item.label))
    parts += _labels(sorted(ends), right, foot, drawn)
    return "".join(parts) + "</svg>"


def _labels(
    ends: Sequence[tuple[float, int, str, str]], right: float, foot: float, drawn: Sequence[Series]
) -> list[str]:
    """Return the labels at the ends of the lines, shifted so that they do not overlap."""
    heights = [end[0] for end in ends]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + _LINE)
    heights[-1] = min(heights[-1], foot)
    for i in range(len(heights) - 2, -1, -1):
        heights[i] = min(heights[i], heights[i + 1] - _LINE)
    parts = []
    for (y, index, mark, label), height in zip(ends, heights, strict=True):
        short = label if len(label) <= _LABEL else label[: _LABEL - 1] + "…"
        dash = "none" if drawn[index].lone else _DASHES[index % len(_DASHES)] or "none"
        lone = " bound" if drawn[index].lone else ""
        parts.append(
            f'<g class="s{index % 6}{lone}"><path class="lead" d="M{right} {y:.1f}L{right + 10} {height:.1f}"/>'
            f'<path class="line" stroke-dasharray="{dash}" d="M{right + 10} {height:.1f}h24"/>'
            + (_mark(mark, right + 22, height) if mark else "")
            + f"</g>{_text(right + 39, height + 4, short, 'start')}"
        )
    return parts


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _mark(path: str, x: float, y: float) -> str:
    return f'<path class="mark" transform="translate({x:.1f} {y:.1f})" d="{path}"/>'


def _thin(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return at most `_MOST` points, including the first and the last."""
    if len(points) <= _MOST:
        return list(points)
    return [points[round(i * (len(points) - 1) / (_MOST - 1))] for i in range(_MOST)]


def _range(low: float, high: float) -> tuple[float, float]:
    """Return the range of ordinates with a margin, of positive height even if all are equal."""
    # With a smaller height, the labels of the axis would be equal.
    smallest = 1e-5 * max(abs(low), abs(high)) or 1.0
    margin = max(0.06 * (high - low), smallest)
    return low - margin, high + margin


def _shares() -> list[tuple[float, str]]:
    return [(share / 100, f"{share} %") for share in (0, 25, 50, 75, 100)]


def _ticks(base: float, top: float) -> list[tuple[float, str]]:
    """Return round values between two numbers, with enough digits to distinguish them."""
    raw = (top - base) / 5
    power = math.floor(math.log10(raw))
    step = min(f * 10.0**power for f in (1, 2, 5, 10) if f * 10.0**power >= raw)
    values = [i * step for i in range(math.ceil(base / step), math.floor(top / step) + 1)]
    largest = max(map(abs, values), default=1.0)
    if largest < 1e9 and step > 1e-5:
        digits = max(0, -math.floor(math.log10(step)))
        return [(value, f"{value:.{digits}f}") for value in values]
    digits = max(1, math.ceil(math.log10(largest / step)) + 1) if largest else 1
    return [(value, f"{value:.{digits}g}") for value in values]


def _powers(low: float, high: float) -> list[float]:
    """Return at most 8 round numbers between two powers of ten."""
    factors = (1, 2, 5) if high - low < 2 else (1,)
    span = range(math.floor(low), math.ceil(high) + 1)
    values = [
        f * 10.0**p for p in span for f in factors if low - 1e-9 <= math.log10(f) + p <= high + 1e-9
    ]
    return values[:: -(-len(values) // 8)] if values else [10**low]
