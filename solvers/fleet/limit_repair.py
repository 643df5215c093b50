"""Search for routes within the limits on the lengths, from routes that satisfy the other constraints; ours.

PyVRP and OR-Tools do not support a budget beside other costs, or limits on the range and the deviation. Random
moves reduce the excess over these limits, with threshold accepting (G. Dueck, T. Scheuer, Journal of
Computational Physics 90, 1990).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...models.fleet import FleetPlan, FleetRouting
from ...models.fleet.checks import LIMITS, loads_of, measure_of

__all__ = ["RULES", "excess_of", "repair"]

#: First threshold relative to the excess of the first routes.
THRESHOLD = 0.3
#: Limits that solvers do not support; their checks come after those of all other constraints.
RULES = [rule for rule in LIMITS if rule.field != "battery"]


def excess_of(model: FleetRouting, routes: Sequence[Sequence[int]]) -> float:
    """Return the total excess of the routes over the limits on the lengths."""
    loads, excess = loads_of(model, FleetPlan(tuple(map(tuple, routes)))), 0.0
    for rule in RULES:
        limit = getattr(model, rule.field)
        if limit is not None:
            excess += max(measure_of(model, rule.measure, loads) - limit, 0.0)
    return excess


def _keeps_the_rest(model: FleetRouting, routes: Sequence[Sequence[int]], tolerance: float) -> bool:
    """Return whether the routes satisfy all constraints but the limits on the lengths."""
    names = {rule.name for rule in RULES}
    checks = model.verify(model.with_schedule(routes), tolerance=tolerance).checks
    return all(check.ok or check.name in names for check in checks)


def repair(
    model: FleetRouting, routes: Sequence[Sequence[int]], tolerance: float, seed: int, trials: int,
    stopped: Callable[[], bool],
) -> list[list[int]] | None:  # fmt: skip
    """Return routes within all limits from `routes`, or None after `trials` moves or a stop."""
    current = [list(route) for route in routes]
    excess = first = excess_of(model, current)
    if not _keeps_the_rest(model, current, tolerance):
        return None
    draw = np.random.default_rng(seed)
    for trial in range(trials):
        if excess <= 0.0:
            return current
        if stopped():
            return None
        moved = _move(model, current, draw)
        value = excess_of(model, moved)
        # The checks of the other constraints take over ten times as long (0.8 ms for 15 nodes).
        is_close = value < excess + THRESHOLD * first * (1.0 - trial / trials)
        if is_close and _keeps_the_rest(model, moved, tolerance):
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
