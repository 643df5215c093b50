"""Panels of the derivatives of a trajectory over time, with their bounds."""

from __future__ import annotations

import numpy as np

from ...plots.curves import Curve, Limit, Mark, Panel, Span
from ...plots.style import MOST_KNOTS, number, pretty_unit
from ..bounds import derivative_name, derivative_unit
from .data import Scene, Violation

__all__ = ["describe_violation", "panel_of", "span_of"]


def panel_of(scene: Scene, order: int, only: tuple[int, ...] = ()) -> Panel:
    """Return the panel of one derivative for the axes `only`, or for all axes."""
    own = list(only) or list(range(scene.dimensions))
    curves: list[Curve] = []
    if scene.plan is not None:
        values = scene.samples(order)
        # Thick lines of a noisy curve would merge into a solid bar.
        width = 0.6 if order and scene.segments > 2 * MOST_KNOTS else 1.4
        curves = [
            Curve(scene.names[axis], axis, scene.sample_times, values[:, axis], width)
            for axis in own
        ]
    marks = _fixed(scene, order, own, "waypoint" if only else "fixed value")
    for mark in scene.marks:
        if mark.order == order and mark.axis in own:
            place = np.array([mark.time]), np.array([mark.value])
            marks.append(Mark("worst violation", *place, note=describe_violation(mark)))
    unit = derivative_unit(order)
    return Panel(derivative_name(order), unit, curves, _limits(scene, order, own), marks)


def span_of(scene: Scene) -> Span:
    """Return the time span of the model and the plan, and the model's knots."""
    ends = np.concatenate([scene.times, scene.flown])
    return Span("", float(ends.min()), float(ends.max()), scene.times)


def describe_violation(mark: Violation) -> str:
    """Return a note such as ``"velocity limit violated by 0.462 m/s at 1.026 s"``."""
    by = f"{number(mark.check.worst, 3)} {pretty_unit(mark.check.unit)}"
    return f"{mark.check.name} violated by {by} at {number(mark.time, 4)} s"


def _fixed(scene: Scene, order: int, own: list[int], kind: str) -> list[Mark]:
    """Return marks of the fixed values at the knots, or no marks if the knots are too many."""
    crowd = scene.plan is not None and len(scene.times) > MOST_KNOTS
    if crowd or order >= scene.conditions.shape[1]:
        return []
    found = []
    for axis in own:
        values = scene.conditions[:, order, axis]
        at = np.isfinite(values)
        if at.any():
            found.append(Mark(kind, scene.times[at], values[at], axis))
    return found


def _limits(scene: Scene, order: int, own: list[int]) -> list[Limit]:
    """Return the bounds on a derivative per segment, merged for axes with equal bounds."""
    times = np.repeat(scene.flown, 2)[1:-1]
    found = []
    for bound in scene.bounds_of(order):
        groups: dict[bytes, list[int]] = {}
        for axis in own:
            same = bound.lower[:, axis].tobytes() + bound.upper[:, axis].tobytes()
            groups.setdefault(same, []).append(axis)
        for group in groups.values():
            lower, upper = (np.repeat(side[:, group[0]], 2) for side in (bound.lower, bound.upper))
            if np.isfinite(lower).any() or np.isfinite(upper).any():
                whose = tuple(group) if len(groups) > 1 else ()
                band = "corridor of an axis" if whose and not order else ""
                found.append(Limit(times, lower, upper, whose, band=band))
    return found
