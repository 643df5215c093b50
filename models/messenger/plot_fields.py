"""Marks of the extended fields of a tour on its map, and their keys in the legend."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..plots import kit
from .model import MessengerTour
from .plan import TourPlan

__all__ = ["draw_fields", "field_keys", "zone_places"]

_WIND, _ZONE = kit.colour_of(2), kit.GREY
#: Length of the arrow of the wind, as a share of the map.
_ARROW = 0.1


def draw_fields(model: MessengerTour, plan: TourPlan | None, axes: Any, scale: float) -> None:
    """Draw the zones, the wind as an arrow at the start, and the track of each home during `plan`."""
    look: dict[str, Any] = {
        "facecolor": _ZONE, "edgecolor": _ZONE, "alpha": 0.3, "zorder": 1, "gid": "no-fly",
    }  # fmt: skip
    for zone in model.no_fly or ():
        if zone.ndim == 1:
            kit.draw_circles(axes, zone[None, :2] * scale, zone[2:] * scale, **look)
        else:
            axes.fill(*(zone * scale).T, **look)
    if model.wind is not None and model.start is not None:
        span = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
        arrow = model.wind * (_ARROW * span / np.hypot(*model.wind))
        axes.quiver(
            *(model.start[:2] * scale), *arrow, color=_WIND, angles="xy", scale_units="xy", scale=1,
            width=0.006, zorder=6, gid="wind",
        )  # fmt: skip
    if model.home_velocity is not None and plan is not None:
        tracks = np.array([
            [part.start[:2], part.start[:2] + model.home_velocity * (part.length / model.speed)]
            for part in plan.parts()
        ])  # fmt: skip
        kit.draw_lines(
            axes, tracks * scale, linewidths=0.9, color=kit.BLACK, ls="--", zorder=3, gid="home"
        )


def zone_places(model: MessengerTour) -> kit.Floats:
    """Return the corners of the boxes of the zones, in m, which the map must include."""
    boxes = [
        np.add.outer([-1.0, 1.0], [0.0, 0.0]) * zone[2] + zone[:2] if zone.ndim == 1 else zone
        for zone in model.no_fly or ()
    ]
    return np.concatenate(boxes) if boxes else np.empty((0, 2))


def field_keys(model: MessengerTour, plan: TourPlan | None) -> list[Any]:
    """Return the entries of the legend for the marks of :func:`draw_fields`."""
    keys = []
    if model.no_fly is not None:
        keys.append(kit.key("no-fly zone", marker="s", ms=8, mfc=_ZONE, mec=_ZONE, alpha=0.35))
    if model.wind is not None and model.start is not None:
        keys.append(kit.key("wind", color=_WIND, lw=2.2))
    if model.home_velocity is not None and plan is not None:
        keys.append(kit.key("track of the home", color=kit.BLACK, lw=0.9, ls="--"))
    return keys
