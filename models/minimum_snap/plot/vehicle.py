"""Panels of the quantities of a vehicle over time with their limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...plots import kit
from ...verification import Check
from ..vehicle_checks import yaw_of
from .data import Scene

__all__ = ["pin_limits", "vehicle_panels"]

#: Keys of the quantities of vehicles with a panel each, and the names of their curves.
_KEYS = {
    "thrust": (),
    "tilt": (),
    "body_rate": (),
    "yaw_rate": (),
    "speed": (),
    "acceleration": (),
    "wheel_speeds": ("left", "right"),
    "wheel_accelerations": ("left", "right"),
}


def vehicle_panels(scene: Scene) -> list[kit.Panel]:
    """Return one panel per limited quantity; empty without a vehicle or a plan."""
    vehicle = getattr(scene.model, "vehicle", None)
    if vehicle is None or scene.plan is None:
        return []
    times = np.unique(scene.sample_times)
    values = vehicle.quantities(scene.plan, times, yaw_of(scene.model, scene.plan))
    limits = {measure.name: measure for measure in vehicle.measures}
    panels = []
    for key, sides in _KEYS.items():
        title = key.replace("_", " ").removesuffix("s") if sides else key.replace("_", " ")
        limit = limits.get(f"{sides[0]} {title}" if sides else title)
        if limit is None or key not in values:
            continue
        table = values[key].reshape(len(times), -1)
        curves = [
            kit.Curve(name, k, times, table[:, k], 1.4) for k, name in enumerate(sides or (title,))
        ]
        signed = bool(sides) or key == "yaw_rate"
        low = limits.get(f"lowest {title}")
        lower = low.limit if low else -limit.limit if signed else -math.inf
        ends = times[[0, -1]]
        marks = [
            kit.Mark(
                "worst violation", np.array([time]), np.array([_at(times, table, side, time)]),
                note=f"{check.name} violated by {kit.number(check.worst, 3)} {check.unit} at "
                f"{kit.number(time, 4)} s",
            )
            for check, time, side in _checks(scene, title, sides)
            if not check.ok and math.isfinite(check.worst)
        ]  # fmt: skip
        bounds = [kit.Limit(ends, lower, limit.limit)]
        panels.append(kit.Panel(title, limit.unit, curves, bounds, marks))
    return panels


def pin_limits(scene: Scene, panels: list[kit.Panel], places: list[Any]) -> None:
    """Pin the checks of the limits to their instants in the last panels."""
    for panel, place in zip(panels, places[len(places) - len(panels) :], strict=True):
        sides = tuple(curve.name for curve in panel.curves) if len(panel.curves) > 1 else ()
        for check, time, side in _checks(scene, panel.title, sides):
            curve = panel.curves[side]
            kit.pin(place, check, time, float(np.interp(time, curve.times, curve.values)))


def _checks(scene: Scene, title: str, sides: tuple[str, ...]) -> list[tuple[Check, float, int]]:
    """Return the checks of a quantity with their instants and the indices of their curves."""
    names = [f"{side} {title} limit" for side in sides] or [
        f"{title} limit",
        f"lowest {title} limit",
    ]
    checks = () if scene.verification is None else scene.verification.checks
    return [
        (check, float(check.where.split()[2]), names.index(check.name) if sides else 0)
        for check in checks
        if check.name in names
    ]


def _at(times: kit.Floats, table: kit.Floats, side: int, time: float) -> float:
    return float(np.interp(time, times, table[:, side]))
