"""Parts of pictures of black boxes: values on a grid, infeasible regions, and fronts."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..plots import kit
from .plan import BlackBoxPoint

__all__ = ["draw_fronts", "levels_of", "sampled", "shade_infeasible"]

#: Number of levels of a contour map, and their smallest difference relative to the range of values.
_LEVELS, _APART = 14, 1e-3


def sampled(model: Any, points: kit.Floats) -> tuple[kit.Floats, NDArray[np.bool_]]:
    """Return the objective at `points`, NaN for no value or an exception, and whether they are feasible.

    Points are rounded to values of their variables.
    """
    table = _table(model, model.layout.canonical(points))
    first, last = model.objectives, model.objectives + model.inequalities
    accepted = np.abs(table[:, last:]) <= model.equality_tolerance
    feasible = (table[:, first:last] <= 0).all(axis=1) & accepted.all(axis=1)
    missing = ~np.isfinite(table).all(axis=1)
    return np.where(missing, np.nan, table[:, 0]), feasible | missing


def _table(model: Any, points: kit.Floats) -> kit.Floats:
    try:
        result: kit.Floats = model.function.table(points, model.columns)
    except InvalidData:
        if len(points) == 1:  # becomes a gap in the picture
            return np.full((1, model.columns), np.nan)
        result = np.concatenate([_table(model, point[None]) for point in points])
    return result


def levels_of(values: kit.Floats) -> kit.Floats:
    """Return the increasing ends of the levels: equal shares of the values, or equal steps."""
    if not values.size or values.min() == values.max():
        return np.empty(0)
    low, high = float(values.min()), float(values.max())
    shares = np.quantile(values, np.linspace(0, 1, _LEVELS + 1))
    bounds = [low]
    for level in shares[1:-1].tolist():
        if min(level - bounds[-1], high - level) > _APART * (high - low):
            bounds.append(level)
    # Equal shares are uninformative for flat functions with a narrow well or spike.
    if len(bounds) <= _LEVELS // 2:
        bounds = np.linspace(low, high, _LEVELS // 2 + 1).tolist()
    return np.unique([*bounds, high])


def shade_infeasible(
    axes: Any, along: kit.Floats, across: kit.Floats, feasible: NDArray[np.bool_]
) -> Any:
    """Shade the points that are not `feasible`, shape (n, n), and return their entry of the legend."""
    violated = np.where(feasible, 0.0, 1.0)
    axes.contourf(
        along, across, violated, [0.5, 1.5], colors=["white"], alpha=0.7, zorder=0.85
    ).set_gid("infeasible")
    axes.contour(along, across, violated, [0.5], colors=[kit.RED], linewidths=1.1, zorder=0.9)
    return kit.key("infeasible", marker="s", mfc="white", mec=kit.RED, ms=7)


def draw_fronts(
    scene: Any,
    model: Any,
    plans: Sequence[BlackBoxPoint],
    labels: Sequence[str],
    looks: Sequence[dict[str, Any]],
) -> kit.Figure:
    """Draw the objectives of fronts, with one panel per pair of objectives and the reference point."""
    pairs = list(itertools.combinations(range(model.objectives), 2))
    columns = min(len(pairs), 3)
    rows = -(-len(pairs) // columns)
    tables = [_table(model, np.array(plan.front or (plan.x,))) for plan in plans]
    places = []
    for place, (a, b) in enumerate(pairs):
        axes: Any = scene.figure.add_subplot(rows, columns, place + 1)
        axes.plot(*model.reference[[a, b]], ls="", marker="x", color=kit.DARK, gid="reference")
        for label, table, look in zip(labels, tables, looks, strict=True):
            order = np.argsort(table[:, a])
            x, y = table[order][:, [a, b]].T
            if model.objectives == 2:
                axes.step(x, y, where="post", color=kit.GREY, lw=0.8, zorder=2)
            axes.plot(x, y, ls="", zorder=3, gid=label, **{**look, "ms": 4.5})
        kit.label_axes(axes, f"objective {a} (–)", f"objective {b} (–)")
        places.append(axes)
    broad, tall = scene.broad, scene.tall
    scene.figure.subplots_adjust(
        left=min(0.85 / broad, 0.3), right=0.96, wspace=0.5, hspace=0.5,
        bottom=min(0.95 / tall, 0.4), top=max(1 - 0.7 / tall, 0.6),
    )  # fmt: skip
    keys = [kit.key("reference", marker="x", color=kit.DARK)]
    keys += [kit.key(label, **look) for label, look in zip(labels, looks, strict=True)]
    scene.legend(keys)
    figure: kit.Figure = scene.figure
    return figure
