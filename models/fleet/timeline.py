"""Timeline of a rich fleet: travel, waiting and services of each vehicle, with the windows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..plots import kit
from .model import FleetRouting
from .plan import FleetPlan
from .rich_checks import nearest_window

__all__ = ["draw_timeline", "places_in_time"]

#: Heights of the bars in rows.
_HEIGHTS = {"window": 0.03, "service": 0.4, "travel": 0.12, "wait": 0.12}
#: Distance of the first windows from the middle of a row, and of further windows from it.
_BELOW, _APART = 0.25, 0.06
#: Largest number of stops that are named by default.
_MOST_NAMES = 40


def draw_timeline(
    model: FleetRouting, plan: FleetPlan, axes: Any, labels: bool | None
) -> list[Any]:
    """Draw one row per vehicle from the top, and return the entries of the legend.

    Services outside of their windows are marked in red. Services without a duration are lines.
    """
    from matplotlib.collections import PolyCollection

    spans = list(_spans(model, plan))
    used = [times for times in plan.starts or () if times]
    low = min((times[0] for times in used), default=0.0)
    high = max((times[-1] for times in used), default=1.0)
    slack = 1e-6 * (high - low)
    late: list[tuple[float, float]] = []
    for kind, height in _HEIGHTS.items():
        rows = [span for span in spans if span.kind == kind]
        boxes = []
        for span in rows:
            begin, end = max(span.begin, low), min(span.end, high)
            bottom, top = span.level - 0.5 * height, span.level + 0.5 * height
            boxes.append([(begin, bottom), (end, bottom), (end, top), (begin, top)])
        colours = [kit.colour_of(span.vehicle) for span in rows]
        bars = PolyCollection(
            boxes, facecolors="none" if kind == "wait" else colours, edgecolors=colours, linewidths=0.9,
            gid=kind, zorder=3,
        )  # fmt: skip
        axes.add_collection(bars, autolim=False)
    for k, (route, times) in enumerate(zip(plan.routes, plan.starts or (), strict=True)):
        for node, time in zip(route, times[1:], strict=False):
            begin, end = nearest_window((model.windows or {node: None})[node], time)
            if not begin - slack <= time <= end + slack:
                late.append((time, k))
            if labels if labels is not None else sum(map(len, plan.routes)) <= _MOST_NAMES:
                axes.text(
                    time, k - 0.24, model.label(node), size=7.5, color=kit.BLACK, ha="left", va="bottom"
                )  # fmt: skip
    keys = [
        kit.key("service", marker="s", color=kit.BLACK, ms=7),
        kit.key("travel", color=kit.BLACK, lw=3),
    ]
    if any(span.kind == "wait" for span in spans):
        keys.append(kit.key("waiting", marker="s", color=kit.BLACK, mfc="none", ms=6))
    if model.windows is not None:
        keys.append(kit.key("window", color=kit.BLACK, lw=1))
    if late:
        axes.plot(*np.array(late).T, "x", color=kit.RED, ms=8, mew=2, zorder=6, gid="late")
        keys.append(kit.key("outside of its window", marker="x", color=kit.RED, ms=8))
    margin = 0.03 * (high - low or 1.0)
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(len(plan.routes) - 0.45, -0.6)
    axes.set_yticks(range(len(plan.routes)), [f"vehicle {k}" for k in range(len(plan.routes))])
    kit.label_axes(axes, kit.with_unit("time", "s"))
    kit.bare(axes)
    axes.grid(visible=False, axis="y")
    return keys


class _Span(NamedTuple):
    """One bar: its kind, vehicle, place in the direction of the rows, and begin and end in s."""

    kind: str
    vehicle: int
    level: float
    begin: float
    end: float


def _spans(model: FleetRouting, plan: FleetPlan) -> Iterator[_Span]:
    """Yield all bars; the window of a service is the nearest one, and may be infinite."""
    for k, (route, times) in enumerate(zip(plan.routes, plan.starts or (), strict=True)):
        if not route:
            continue
        path = model.path_of(k, route)
        for place, (tail, head) in enumerate(itertools.pairwise(path)):
            leaves = times[place]
            if place and model.service is not None:
                leaves += float(model.service[tail])
            if place:
                yield _Span("service", k, k, times[place], leaves)
            arrives = leaves + model.travel_time(k, tail, head)
            yield _Span("travel", k, k, leaves, arrives)
            if times[place + 1] > arrives:
                yield _Span("wait", k, k, arrives, times[place + 1])
        if model.finishes[k] < 0:
            yield _Span("service", k, k, times[-2], times[-1])
        for place, node in enumerate(route if model.windows is not None else ()):
            time = times[place + 1]
            begin, end = nearest_window((model.windows or {node: None})[node], time)
            if begin > -math.inf:
                level = k + _BELOW + _APART * (place % 3)
                yield _Span("window", k, level, begin, end)


def places_in_time(model: FleetRouting, plan: FleetPlan) -> dict[str, tuple[float, float]]:
    """Return the place of each name that a check of times gives: its time and row."""
    places = {}
    for k, (route, times) in enumerate(zip(plan.routes, plan.starts or (), strict=True)):
        for node, time in zip(route, times[1:], strict=False):
            places[f"vehicle {k}, node {model.label(node)}"] = (time, float(k))
            places[f"vehicle {k}, to node {model.label(node)}"] = (time, float(k))
        if times:
            places[f"vehicle {k}, departure"] = (times[0], float(k))
            places[f"vehicle {k}, return"] = (times[-1], float(k))
    return places
