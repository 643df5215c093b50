"""Search for routes within the limits on the lengths, from routes that satisfy the other constraints; ours.

PyVRP and OR-Tools do not support a budget beside other costs, or limits on the range and the deviation. Random
moves reduce the excess over these limits, with threshold accepting (G. Dueck, T. Scheuer, Journal of
Computational Physics 90, 1990).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...models.fleet import FleetPlan, FleetRouting
from ...models.fleet.checks import LIMITS, loads_of, measure_of

__all__ = ["excess_of", "repair"]

#: First threshold relative to the excess of the first routes.
THRESHOLD = 0.3
RULES = [rule for rule in LIMITS if rule.field != "battery"]


def excess_of(model: FleetRouting, plan: FleetPlan, tolerance: float) -> float:
    """Return the total excess over the limits on the lengths; infinite if another constraint is violated."""
    names = {rule.name for rule in RULES}
    if any(
        not check.ok
        for check in model.verify(plan, tolerance=tolerance).checks
        if check.name not in names
    ):
        return math.inf
    loads, excess = loads_of(model, plan), 0.0
    for rule in RULES:
        limit = getattr(model, rule.field)
        if limit is not None:
            excess += max(measure_of(model, rule.measure, loads) - limit, 0.0)
    return excess


def repair(
    model: FleetRouting, routes: Sequence[Sequence[int]], tolerance: float, seed: int, trials: int,
    stopped: Callable[[], bool],
) -> list[list[int]] | None:  # fmt: skip
    """Return routes within all limits from `routes`, or None after `trials` moves or a stop."""
    current = [list(route) for route in routes]
    excess = first = excess_of(model, model.with_schedule(current), tolerance)
    if math.isinf(first):
        return None
    draw = np.random.default_rng(seed)
    for trial in range(trials):
        if excess <= 0.0:
            return current
        if stopped():
            return None
        moved = _move(model, current, draw)
        value = excess_of(model, model.with_schedule(moved), tolerance)
        if value < excess + THRESHOLD * first * (1.0 - trial / trials):
            current, excess = moved, value
    return current if excess <= 0.0 else None


def _move(
    model: FleetRouting, routes: list[list[int]], draw: np.random.Generator
) -> list[list[int]]:
    """Return the routes after a random move: another place or node of a stop, an exchange or a reversal."""
    moved = [list(route) for route in routes]
    places = [(k, i) for k, route in enumerate(moved) for i in range(len(route))]
    kind = draw.integers(5) if places else 4
    if kind == 4:
        route = moved[draw.integers(len(moved))]
        route.insert(draw.integers(len(route) + 1), int(draw.integers(model.size)))
        return moved
    k, i = places[draw.integers(len(places))]
    other, j = places[draw.integers(len(places))]
    if kind == 0:
        moved[k][i], moved[other][j] = moved[other][j], moved[k][i]
    elif kind == 1:
        end = draw.integers(i, len(moved[k])) + 1
        moved[k][i:end] = moved[k][i:end][::-1]
    elif kind == 2:
        moved[k][i] = int(draw.integers(model.size))
    else:
        node, route = moved[k].pop(i), moved[draw.integers(len(moved))]
        if draw.integers(4):
            route.insert(draw.integers(len(route) + 1), node)
    return moved
