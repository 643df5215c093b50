"""Optional data of rich fleets: times, windows, loads, costs, skills, prizes, reloads and stations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from .data import FleetData, Objective
from .features import TIMED, features_of

__all__ = ["RichData"]

Floats = NDArray[np.float64]

#: Largest service time and release, s: times up to it have a resolution of 1 ms.
LATEST = 1e12


class RichData(FleetData):
    """Derived values and validation of the fields for rich fleets."""

    def check(self) -> None:
        """Fill in defaults and validate constraints between fields."""
        super().check()
        self._check_loads()
        self._check_times()
        self._check_costs()
        self._check_choices()

    def _check_distances(self) -> None:
        super()._check_distances()
        # Before the customers are computed, which are the remaining nodes.
        for name in ("ends", "reloads", "stations", "pairs"):
            value = getattr(self, name)
            largest = int(np.max(value, initial=-1)) if value is not None else -1
            if largest >= self.size:
                raise InvalidData(
                    f"{name} must be nodes 0 … {self.size - 1}, got {largest}", field=name
                )
        for name in ("reloads", "stations"):
            nodes = getattr(self, name) or ()
            if len(set(nodes)) < len(nodes):
                raise InvalidData(
                    f"{name} must name each node once, got {show(list(nodes))}", field=name
                )

    def _check_loads(self) -> None:
        arrays = {"demands": self.demands, "pickups": self.pickups, "capacity": self.capacity}
        present = {name: array for name, array in arrays.items() if array is not None}
        if present and (self.capacity is None or len(present) == 1):
            name, other = "demands", "capacity"
            if self.capacity is None:
                name, other = "capacity", next(iter(present))
            raise InvalidData(f"{name} must be given together with {other}", field=name)
        shapes = {array.ndim for array in present.values()}
        if len(shapes) > 1:
            shown = ", ".join(f"{name} {array.shape}" for name, array in present.items())
            raise InvalidData(
                f"capacity must have as many dimensions as the loads, got the shapes {shown}",
                field="capacity",
            )
        for name in ("backhauls", "pairs"):
            if name in features_of(self) and self.pickups is None:
                raise InvalidData(f"{name} must be given together with pickups", field=name)
        if self.stations and self.battery is None:
            raise InvalidData("stations must be given together with battery", field="stations")
        if self.max_reloads is not None and not self.reloads:
            raise InvalidData(
                "max_reloads must be given together with reloads", field="max_reloads"
            )

    def _check_times(self) -> None:
        if self.speed is not None and not (self.speed > 0).all():
            raise InvalidData(f"speed must be > 0, got {float(self.speed.min()):g}", field="speed")
        if self.times is not None and (np.diagonal(self.times) != 0).any():
            row = int(np.flatnonzero(np.diagonal(self.times))[0])
            raise InvalidData(
                f"times[{row}, {row}] must be 0, got {self.times[row, row]:g}", field="times"
            )
        longest = float(self.base_times.max()) / float(self.speeds.min()) if self.has_times else 0.0
        if not math.isfinite(longest * 4.0 * self.size):
            raise InvalidData(
                f"times must be small enough to add up, got {longest:g} s",
                field="times" if self.speed is None else "speed",
            )
        for name in ("service", "releases"):
            value = getattr(self, name)
            if value is not None and float(np.abs(value).max()) > LATEST:
                raise InvalidData(
                    f"{name} must be at most {LATEST:g} s, got {float(np.abs(value).max()):g}",
                    field=name,
                )
        for k, (begin, end) in enumerate([] if self.shifts is None else self.shifts.tolist()):
            if not math.isfinite(begin) or end < begin:
                raise InvalidData(
                    f"shifts[{k}] must begin at a finite time and end no earlier, got ({begin:g}, {end:g})",
                    field="shifts",
                )

    def _check_costs(self) -> None:
        if self.objective is Objective.COST:
            return
        for name in ("fixed_cost", "distance_cost", "time_cost", "prizes"):
            if getattr(self, name) is not None:
                raise InvalidData(
                    f"{name} must not be given unless the objective is 'cost', got objective "
                    f"{str(self.objective)!r}",
                    field=name,
                )

    def _check_choices(self) -> None:
        self._check_customers("pairs", [] if self.pairs is None else self.pairs.tolist())
        self._check_customers("groups", self.groups or ())
        for k, group in enumerate(self.groups or ()):
            free = self.optional[list(group)]
            if free.any() and not free.all():
                raise InvalidData(
                    f"groups[{k}] must hold nodes that all have prizes or all have none, got "
                    f"{show(list(group))}",
                    field="groups",
                )
        if self.requires is not None and self.skills is None and any(self.requires):
            raise InvalidData("requires must be given together with skills", field="requires")

    def _check_customers(self, name: str, rows: Iterable[Sequence[int]]) -> None:
        """Raise if a row of `name` is empty or has a node that is no customer or is in two places."""
        known, used = set(self.customers.tolist()), set[int]()
        for k, row in enumerate(rows):
            for node in row:
                if node not in known or node in used:
                    rule = "name each node once" if node in known else "name nodes to visit"
                    raise InvalidData(f"{name}[{k}] must {rule}, got {node}", field=name)
                used.add(node)
            if not row:
                raise InvalidData(f"{name}[{k}] must not be empty", field=name)

    @property
    def is_rich(self) -> bool:
        """Whether the model has a feature of ``FEATURES`` in ``models.fleet.features``."""
        return bool(features_of(self))

    @cached_property
    def has_times(self) -> bool:
        """Whether plans need times."""
        return not features_of(self).isdisjoint(TIMED)

    @cached_property
    def is_customer(self) -> NDArray[np.bool_]:
        """Whether each node is one of `customers`, shape (n,)."""
        return np.isin(np.arange(self.size), self.customers)

    @cached_property
    def optional(self) -> NDArray[np.bool_]:
        """Whether each node has a prize, so that it may be skipped, shape (n,)."""
        if self.prizes is None:
            return np.zeros(self.size, bool)
        return np.isfinite(self.prizes)

    @cached_property
    def base_times(self) -> Floats:
        """Travel times at speed 1, shape (n, n), s: `times`, or the distances."""
        return self.distances if self.times is None else self.times

    @cached_property
    def speeds(self) -> Floats:
        """Speed of each vehicle, shape (vehicles,): the divisor of `base_times`."""
        return np.ones(self.vehicles) if self.speed is None else self.speed

    def travel_time(self, vehicle: int, tail: int, head: int) -> float:
        """Return the travel time of `vehicle` from node `tail` to node `head`, s."""
        return float(self.base_times[tail, head] / self.speeds[vehicle])
