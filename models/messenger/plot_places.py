"""Places of a tour on its map."""

from __future__ import annotations

import numpy as np

from ..plots import kit
from ..verification import Check, Verification
from .checks import UNDECIDABLE, integrated
from .model import MessengerTour
from .plan import TourPlan
from .sampling import outline

__all__ = ["Drawn"]


class Drawn:
    """Places to draw for a plan, in m."""

    def __init__(
        self, model: MessengerTour, plan: TourPlan, result: Verification, uav: int = 0
    ) -> None:
        self.model, self.plan, self.result, self.uav = model, plan, result, uav
        self.path = outline(plan, model.turning_radius, model.drift)
        self.met = np.array(plan.order, int)
        self.meetings = model.positions[self.met] + model.velocities[self.met] * plan.times[:, None]
        self.places = _places(self)
        violations = [
            place for item in result.violated if (place := self.place_of(item)) is not None
        ]
        self.broken = finite(np.array(violations)) if violations else np.empty((0, 2))

    def place_of(self, check: Check) -> kit.Floats | None:
        """Return the place that a check names, None without one or if it is about another UAV."""
        if "(UAV " in check.name and f"(UAV {self.uav})" not in check.name:
            return None
        return self.places.get(check.where.removesuffix(f": {UNDECIDABLE}"))

    @property
    def everything(self) -> kit.Floats:
        """Places that the map must include: path, tracks and discs."""
        reach = self.model.radius[self.met][:, None]
        parts = [
            self.path.poses[:, :2], self.model.positions, self.plan.points, self.meetings - reach,
            self.meetings + reach,
        ]  # fmt: skip
        return finite(np.concatenate(parts))

    @property
    def first_half(self) -> kit.Floats:
        """Places that a map of the first half of the encounters must include."""
        count = max(1, len(self.met) // 2)
        until = float(self.plan.times[:count].max()) if len(self.met) else 0.0
        flown = self.path.flown <= until * self.model.speed
        reach = self.model.radius[self.met[:count]][:, None]
        first = self.meetings[:count]
        return finite(np.concatenate([self.path.poses[flown, :2], first - reach, first + reach]))


def finite(places: kit.Floats) -> kit.Floats:
    """Return the places within the range that can be drawn."""
    visible: kit.Floats = places[(np.abs(places) < kit.FAR).all(axis=1)]
    return visible if len(visible) else np.zeros((1, 2))


def _places(tour: Drawn) -> dict[str, kit.Floats]:
    """Return the places on the map by their text in a check."""
    model, plan = tour.model, tour.plan
    poses = integrated(plan, model.turning_radius)
    flown = np.cumsum([0.0, *(primitive.length for primitive in plan.primitives)])
    poses[:, :2] += flown[:, None] * model.drift
    places = {"start": poses[0, :2], "end": poses[-1, :2]}
    places |= {f"primitive {k}": pose[:2] for k, pose in enumerate(poses[:-1])}
    for k in range(model.size):
        rows = np.flatnonzero(tour.met == k)
        place = plan.points[rows[0]] if rows.size else model.positions[k]
        places[f"vehicle {model.label(k)}"] = place
    return places
