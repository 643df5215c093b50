"""Picture of a front: the trade-off between two objectives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..verification import stated
from . import kit

__all__ = ["draw_front"]

#: Largest number of points that are labelled with numbers.
_MOST_NUMBERS = 10
#: Distance below all points, in heights of the points, beyond which bounds are marked at the foot.
_FAR = 0.6
#: Margin around the points, relative to their extent.
_MARGIN = 0.12
#: Margin to the left of the points, which contains the numbers.
_LEFT = 0.2


@kit.documented
def draw_front(
    front: Any,
    size: tuple[float, float] | None = None,
    title: str | None = None,
    labels: bool | None = None,
    unit: str | None = None,
) -> kit.Figure:
    """Draw the points of a front, the second objective to the right and the objective upward.

    Steps connect the points: the region above and to the right of them is dominated, or below and to
    the right if the objective is maximised. A filled marker
    is proven to be the smallest objective within its limit, a hollow marker is not proven. A short
    line below a point is its proven bound. In a sweep, markers are filled if the answer for the
    value of the field is proven; bounds are omitted, because they apply to another objective.

    All fronts must have the same second objective, and at least one of them a point.

    Parameters
    ----------
    front : Front or mapping of str to Front
        Front of a model, or fronts of several algorithms by name.
    title : str, optional
        Title; by default the name and the size of the model.
    labels : bool, optional
        Whether to write both objectives beside each point, or the value of the field in a sweep. By
        default only for a single front with few points.
    unit : str, optional
        Unit of the second objective; by default that of the objective.
    """
    fronts = dict(front) if isinstance(front, Mapping) else {"": front}
    kit.check_flags(optional=True, labels=labels)
    drawn = {str(name): _rows(front_of, front_of.points) for name, front_of in fronts.items()}
    places = np.concatenate([np.empty((0, 2)), *(rows[:, :2] for rows in drawn.values())])
    if not len(places):
        raise InvalidData("front must have at least one point", field="front")
    if len({front_of.second for front_of in fronts.values()}) > 1:
        raise InvalidData("fronts must have the same second objective", field="front")
    first = next(iter(fronts.values()))
    model = first.model
    removed = np.concatenate([_rows(front_of, front_of.dominated) for front_of in fronts.values()])
    bounds = np.concatenate([rows[:, 2] for rows in drawn.values()])
    low, high = _box(np.concatenate([places, removed[:, :2]]), bounds)
    # Rows and box are of the minimised objective, the picture shows the author's.
    sign = stated(1.0, getattr(model, "maximise", False) and not _is_sweep(first))

    extent = f"a sweep of {first.field}" if _is_sweep(first) else model.outline()
    scene = kit.Scene(kit.title_of(model, [extent], None, title), None, size, (6.6, 4.8))
    axes = scene.axes(0.9, 0.98, 0.16, scene.head)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(*sorted((sign * low[1], sign * high[1])))
    kit.bare(axes)
    unit_of, quantity = model.objective_unit, getattr(model, "objective", None)
    if _is_sweep(first):
        quantity = getattr(first, "first", None)
    quantity = str(quantity) if isinstance(quantity, str) and quantity else "objective"
    across = kit.with_unit(first.second, unit_of if unit is None else unit)
    kit.label_axes(axes, across, kit.with_unit(quantity, unit_of))
    crosses: dict[str, Any] = {"marker": "x", "ms": 5, "color": kit.GREY}
    axes.plot(removed[:, 0], sign * removed[:, 1], ls="", zorder=6, gid="dominated", **crosses)
    colours = [kit.colour_of(k) if len(drawn) > 1 else kit.BLACK for k in range(len(drawn))]
    for k, rows in enumerate(drawn.values()):
        # The first fronts have wider lines, so that identical fronts remain visible.
        _draw_one(axes, rows, colours[k], low[1], high, 1.2 + 1.3 * (len(drawn) - 1 - k), sign)
    if labels if labels is not None else len(drawn) == 1 and len(places) <= _MOST_NUMBERS:
        for front_of, rows in zip(fronts.values(), drawn.values(), strict=True):
            _label_points(axes, front_of, rows, sign)
    every = np.concatenate(list(drawn.values()))
    keys = _keys(drawn, colours, every, len(removed), float(low[1]), sign)
    if _is_sweep(first) and every[:, 3].any():
        keys[len(drawn) if len(drawn) > 1 else 0].set_label(f"proven for its {first.field}")
    scene.legend(keys, 1 + (len(keys) > 5))
    return scene.figure


def _is_sweep(front: Any) -> bool:
    """Return whether the points are answers for values of a field rather than for limits."""
    return getattr(front, "field", "") not in ("", front.model.second_objectives.get(front.second))


def _rows(front: Any, points: Sequence[Any]) -> kit.Floats:
    """Return one row per point: second objective, objective, bound (NaN for none), proven, limit.

    The rows are sorted by the second objective, and points without finite objectives are omitted. A
    sweep's bounds apply to the minimised quantity, which is not drawn, so they are omitted as well.
    """
    swept = _is_sweep(front)
    result = np.array(
        [
            (
                point.second, point.objective, None if swept else point.solution.dual_bound, point.proven,
                point.limit,
            )
            for point in points
        ],
        float,
    ).reshape(-1, 5)  # fmt: skip
    result = result[np.isfinite(result[:, :2]).all(axis=1)]
    return np.asarray(result[np.lexsort((result[:, 1], result[:, 0]))])


def _label_points(axes: Any, front: Any, rows: kit.Floats, sign: float) -> None:
    """Label the points, in a sweep also the dominated ones."""
    if _is_sweep(front):
        rows = np.concatenate([rows, _rows(front, front.dominated)])
    places: dict[tuple[str, str], list[float]] = {}
    for x, y, *_ in rows.tolist():
        places.setdefault((kit.number(x, 5), kit.number(sign * y, 5)), [x, sign * y])
    for pair, (x, y) in places.items():
        text = f"({', '.join(pair)})"
        if _is_sweep(front):
            same = [row for row in rows if (kit.number(row[0], 5), kit.number(row[1], 5)) == pair]
            text = f"{front.field} = {', '.join(kit.number(row[4], 5) for row in same)}"
        # The steps never pass to the left of and below a point, or above it if the objective is maximised.
        axes.annotate(
            text, (x, y), (-5, -5 * sign), textcoords="offset points", ha="right", fontsize=7,
            va="top" if sign > 0 else "bottom", color=kit.DARK, zorder=6, annotation_clip=False,
        )  # fmt: skip


def _box(places: kit.Floats, bounds: kit.Floats) -> tuple[kit.Floats, kit.Floats]:
    """Return the corners of the visible range: all points, and the bounds near them."""
    low, high = places.min(axis=0), places.max(axis=0)
    # Do not magnify differences within rounding.
    size = np.maximum(np.abs(low), np.abs(high))
    span = np.where(high - low > 1e-9 * size, high - low, 0.1 * size)
    span[span == 0.0] = 1.0
    near = bounds[np.isfinite(bounds) & (bounds >= low[1] - _FAR * span[1])]
    low[1] = near.min(initial=low[1])
    span[1] = max(span[1], high[1] - low[1])
    return low - [_LEFT, _MARGIN] * span, high + _MARGIN * span


def _draw_one(
    axes: Any,
    rows: kit.Floats,
    colour: str,
    foot: float,
    high: kit.Floats,
    width: float,
    sign: float,
) -> None:
    """Draw steps, markers and bounds of one front; bounds below `foot` are at the edge."""
    if not len(rows):
        return
    x, y, bound, proven, _ = rows.T
    visible = np.isfinite(bound) & (bound >= foot)
    far = np.isfinite(bound) & ~visible
    y, bound = sign * y, sign * bound
    # The first point is reached from the worst objective, and the last one is left to the right.
    across, upward = [x[0], *x, high[0]], [sign * high[1], *y, y[-1]]
    axes.plot(across, upward, drawstyle="steps-post", color=colour, lw=width, zorder=3, gid="steps")
    for solid, face, wide in ((True, colour, 6.0), (False, "white", 7.0)):
        selected = proven.astype(bool) == solid
        axes.plot(
            x[selected], y[selected], ls="", marker="o", ms=wide, mfc=face, mec=colour, mew=1.3,
            zorder=5.0 + 0.5 * solid, gid="proven" if solid else "not proven",
        )  # fmt: skip
    axes.plot(
        x[visible], bound[visible], ls="", marker="_", ms=11, mew=1.6, color=colour, zorder=4, gid="bound",
    )  # fmt: skip
    rods = np.stack([x, bound, x, y], axis=1)[visible].reshape(-1, 2, 2)
    kit.draw_lines(axes, rods, color=colour, lw=0.7, ls=":", zorder=2.5, gid="gap")
    axes.plot(
        x[far], np.full(int(far.sum()), float(sign < 0)), ls="", marker=_edge(sign), ms=5, color=colour, zorder=4,
        transform=axes.get_xaxis_transform(), clip_on=False, gid="bound out of sight",
    )  # fmt: skip


def _keys(
    drawn: Mapping[str, kit.Floats],
    colours: Sequence[str],
    every: kit.Floats,
    removed: int,
    least: float,
    sign: float,
) -> list[Any]:
    """Return the entries of the legend: names of fronts, and the kinds of marks."""
    named = list(zip(drawn, colours, strict=True)) if len(drawn) > 1 else []
    keys = [kit.key(name, color=colour, lw=1.6) for name, colour in named]
    bound, proven = every[:, 2], every[:, 3].astype(bool)
    round_ = {"marker": "o", "ms": 6, "mec": kit.BLACK, "mew": 1.3}
    keys += [kit.key("proven", **round_, mfc=kit.BLACK)] * bool(proven.any())
    keys += [kit.key("not proven", **round_, mfc="white")] * bool((~proven).any())
    if (bound >= least).any():
        keys.append(kit.key("proven bound", marker="_", ms=11, mew=1.6, color=kit.BLACK))
    if (bound < least).any():
        keys.append(kit.key("bound out of sight", marker=_edge(sign), ms=5, color=kit.BLACK))
    keys += [kit.key("dominated", marker="x", ms=5, color=kit.GREY)] * bool(removed)
    return keys


def _edge(sign: float) -> str:
    """Return the marker of a bound beyond the foot, or beyond the head of a maximised objective."""
    return "v" if sign > 0 else "^"
