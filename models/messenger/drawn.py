"""Data of a tour's picture: path, encounters and places of violations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..plots import kit
from ..verification import Verification
from .checks import integrated
from .model import MessengerTour
from .plan import TourPlan
from .sampling import outline

__all__ = ["Drawn", "together", "within"]

#: Encounters share a place on the map if they are closer than this share of its extent.
_NEAR = 1e-3


class Drawn:
    """Places to draw for a plan, in m."""

    def __init__(self, model: MessengerTour, plan: TourPlan, found: Verification) -> None:
        self.model, self.plan, self.found = model, plan, found
        self.path = outline(plan, model.turning_radius)
        self.met = np.array(plan.order, int)
        self.meetings = model.positions[self.met] + model.velocities[self.met] * plan.times[:, None]
        self.broken = _violation_places(self)

    @property
    def everything(self) -> kit.Floats:
        """Places that the map must include: path, tracks and discs."""
        reach = self.model.radius[self.met][:, None]
        parts = [
            self.path.poses[:, :2], self.model.positions, self.plan.points, self.meetings - reach,
            self.meetings + reach,
        ]  # fmt: skip
        return _finite(np.concatenate(parts))

    @property
    def first_half(self) -> kit.Floats:
        """Places that a map of the first half of the encounters must include."""
        count = max(1, len(self.met) // 2)
        until = float(self.plan.times[:count].max()) if len(self.met) else 0.0
        flown = self.path.flown <= until * self.model.speed
        reach = self.model.radius[self.met[:count]][:, None]
        first = self.meetings[:count]
        return _finite(np.concatenate([self.path.poses[flown, :2], first - reach, first + reach]))


def _finite(places: kit.Floats) -> kit.Floats:
    """Return the places within the range that can be drawn."""
    visible: kit.Floats = places[(np.abs(places) < kit.FAR).all(axis=1)]
    return visible if len(visible) else np.zeros((1, 2))


def _violation_places(tour: Drawn) -> kit.Floats:
    """Return the place of the largest violation of each violated check, shape (k, 2)."""
    model, plan = tour.model, tour.plan
    poses = integrated(plan, model.turning_radius)
    places = {"start": poses[0, :2], "end": poses[-1, :2]}
    places |= {f"primitive {k}": pose[:2] for k, pose in enumerate(poses[:-1])}
    for k in range(model.size):
        rows = np.flatnonzero(tour.met == k)
        places[f"vehicle {model.label(k)}"] = (
            plan.points[rows[0]] if rows.size else model.positions[k]
        )
    violations = [places[check.where] for check in tour.found.violated if check.where in places]
    return _finite(np.array(violations)) if violations else np.empty((0, 2))


def within(places: kit.Floats, least: kit.Floats, most: kit.Floats) -> NDArray[np.bool_]:
    """Return a mask of the places within a box."""
    return np.asarray(((places >= least) & (places <= most)).all(axis=1))


def together(points: kit.Floats, extent: float) -> list[tuple[int, int]]:
    """Return the first and last index of each run of encounters that share a place on the map."""
    runs: list[tuple[int, int]] = []
    for k, point in enumerate(points):
        if runs and np.hypot(*(point - points[runs[-1][0]])) <= _NEAR * extent:
            runs[-1] = (runs[-1][0], k)
        else:
            runs.append((k, k))
    return runs
