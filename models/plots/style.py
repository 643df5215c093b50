"""Colours and small helpers that both halves of a trajectory's picture share."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import ListedColormap

__all__ = [
    "BLACK", "CORRIDOR", "CORRIDOR_EDGE", "GREY", "MOST_KNOTS", "RED", "axis_style", "bare",
    "number", "speed_map",
]  # fmt: skip

# Okabe and Ito's colours, which all eyes tell apart and whose greys differ in print.
BLACK, GREY, RED = "#1a1a1a", "#8c8c8c", "#C8102E"
_LINES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#7F6000", "#1a1a1a")
CORRIDOR, CORRIDOR_EDGE = "#dfe9f1", "#8fabc2"

#: More knots than this are not told apart: no lines, no numbers.
MOST_KNOTS = 60


def axis_style(axis: int) -> dict[str, Any]:
    """Return colour and dashes of an axis's line; they repeat only after 21 axes."""
    dashes = ("-", "-.", ":")[axis // len(_LINES) % 3]
    return {"color": _LINES[axis % len(_LINES)], "ls": dashes}


@cache
def speed_map() -> ListedColormap:
    """Return the colours of speeds: viridis without its end, which is too pale on white paper."""
    import matplotlib
    from matplotlib.colors import ListedColormap

    whole = matplotlib.colormaps["viridis"]
    return ListedColormap([whole(k / 280) for k in range(256)], name="speed")


def bare(axes: Axes) -> None:
    """Take away what frames a graph without telling anything."""
    axes.tick_params(labelsize=8)
    axes.grid(color="#ececec", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def number(value: float, digits: int = 6) -> str:
    """Return ``"6566.48"``, or ``"1.23457×10⁹"`` where zeros would not be counted."""
    text = f"{value:.{digits}g}"
    mantissa, mark, power = text.partition("e")
    if not mark:
        return text.replace("-", "−")
    raised = str(int(power)).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))
    return f"{mantissa}×10{raised}".replace("-", "−")
