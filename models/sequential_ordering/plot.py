"""Picture of sequential ordering: the length over the stops, and the precedence pairs as arches above them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..plots import kit
from .model import SequentialOrdering
from .plan import SequentialOrderingPlan

__all__ = ["animate_ordering", "draw"]

#: Largest numbers of nodes with names, and of pairs that are drawn.
_MOST_NAMES, _MOST_PAIRS = 60, 600


@kit.documented
def draw(
    model: SequentialOrdering,
    plan: SequentialOrderingPlan | None = None,
    *,
    labels: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the length of `plan` over its stops, and each precedence pair as an arch between two stops.

    Parameters
    ----------
    model : SequentialOrdering
        The model.
    plan : SequentialOrderingPlan, optional
        Plan of the model, feasible or not. Arches of pairs in the wrong order are red. None draws the pairs over a
        topological order of the nodes.
    labels : bool, optional
        Whether to name the nodes. Default: True if they are few.
    """
    result = kit.verified_plan(model, plan, SequentialOrderingPlan, tolerance)
    kit.check_flags(optional=True, labels=labels)
    order = list(model.sorted_nodes if plan is None else plan.order)
    words = [model.describe()]
    if result is not None and result.objective is not None:
        words.append(f"length {kit.number(result.objective)}")
    scene = kit.Scene(kit.title_of(model, words, result, title), result, size, (7.0, 4.6))
    half = 0.4 * scene.tall
    axes = scene.axes(0.9, 0.55 if plan is None else half, 0.2, scene.head)
    place = {node: stop for stop, node in reversed(list(enumerate(order)))}
    keys = _draw_pairs(model, axes, place)
    axes.set_xlim(-0.5, max(len(order) - 0.5, 0.5))
    axes.set_yticks([])
    kit.label_axes(axes, y="precedence")
    foot = axes
    if plan is not None:
        foot = scene.axes(0.9, 0.55, 0.2, scene.tall - half + 0.08)
        axes.tick_params(labelbottom=False)
        look: dict[str, Any] = {"ms": 3, "color": kit.DARK, "lw": 1.3, "gid": "curve length"}
        foot.plot(np.arange(len(order)), lengths_of(model, plan), "o-", **look)
        foot.set_xlim(*axes.get_xlim())
        kit.label_axes(foot, y="length (–)")
    names = [model.label(node) for node in order]
    named = labels if labels is not None else len(order) <= _MOST_NAMES
    kit.label_axes(foot, "node (name)" if named else "stop (number)")
    if named:
        upright = max(map(len, names), default=0) > 3
        foot.set_xticks(range(len(order)), names, fontsize=7, rotation=90 * upright)
    pins = {f"node {name}": np.array([stop, 0.0]) for stop, name in enumerate(names)}
    for a, b in model.precedence.tolist():
        if a in place and b in place:
            middle = np.array([0.5 * (place[a] + place[b]), 0.0])
            pins[f"{model.label(a)} before {model.label(b)}"] = middle
    kit.pin_places(axes, result, pins)
    scene.legend(keys, 1, y=0.02)
    return scene.figure


def lengths_of(model: SequentialOrdering, plan: SequentialOrderingPlan) -> kit.Floats:
    """Return the length of the path up to each stop; NaN after a missing arc."""
    order = list(plan.order)
    legs = np.append(0.0, model.distances[order[:-1], order[1:]])[: len(order)]
    return np.cumsum(np.where(np.isfinite(legs), legs, np.nan))


def _draw_pairs(model: SequentialOrdering, axes: Any, place: dict[int, int]) -> list[Any]:
    """Draw the pairs as arches between stops, and return the entries of the legend."""
    angle = np.linspace(0.0, np.pi, 25)
    pairs = [(place[a], place[b]) for a, b in model.links.tolist() if a in place and b in place]
    keys = []
    for wrong, colour in ((False, kit.GREY), (True, kit.RED)):
        arches = [
            np.column_stack([a + (b - a) * (1 - np.cos(angle)) / 2, abs(b - a) * np.sin(angle)])
            for a, b in pairs
            if (a >= b) == wrong
        ]
        if arches:
            look: dict[str, Any] = {"colors": colour, "lw": 0.8, "alpha": 0.8, "zorder": 3 + wrong}
            kit.draw_lines(axes, arches[:_MOST_PAIRS], gid="pair", **look)
            word = "pair in the wrong order" if wrong else "pair in order"
            keys.append(kit.key(word, color=colour, lw=1.0))
    axes.set_ylim(0.0, 1.05 * max((abs(b - a) for a, b in pairs), default=1))
    return keys


@kit.animated(draw, SequentialOrderingPlan)
def animate_ordering(
    model: SequentialOrdering, plan: SequentialOrderingPlan | Any, figure: Any
) -> Any:
    """Animate the picture of an order: a marker moves from stop to stop.

    The plan needs two stops, and each pair of consecutive nodes an arc.
    """
    whole = len(plan.order) > 1 and bool(np.isfinite(lengths_of(model, plan)).all())
    kit.check_option("plan", plan, whole, "have two stops and an arc between all consecutive nodes")
    return kit.curve_movers(figure), "stop", ""
