"""Whole-number data of fleets for the adapters of other solvers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.fleet import FleetRouting

__all__ = [
    "COMMON", "FOREVER", "Scales", "costs_of", "has_shift", "is_fetched", "list_backhauls", "round_down", "round_up",
    "scales_of", "whole_loads", "whole_shift", "whole_spans",
]  # fmt: skip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Rich features of both adapters.
COMMON = frozenset(
    {
        "times", "speed", "service", "windows", "releases", "dimensions", "pickups", "backhauls", "pairs",
        "fixed_cost", "distance_cost", "time_cost", "shifts", "max_duration", "ends", "requires",
        "skills", "prizes", "groups", "reloads", "max_reloads", "cost",
    }
)  # fmt: skip
#: Least whole number of an infinite time.
FOREVER = 2**42
#: Whole number up to which the longest arc of a fleet is scaled, in length, time and cost.
ARC = 2**21
#: Largest whole number for the cost of one arc, and for a fixed cost or the sum of all prizes.
MOST_ARC, MOST_COST = 2**36, 2**48
#: Largest sum of the loads of all dimensions. PyVRP multiplies overloads with at most 2^25, and the sum of these
#: penalties must fit in 63 bits.
LOADS = 2**36
#: Largest relative excess of a capacity by rounding: a tenth of the tolerance of the verification.
EXCESS = 1e-7
#: Relative error of a product that still rounds to the nearest whole number.
NOISE = 1e-12


def round_up(values: ArrayLike, scale: float) -> Ints:
    """Return `values` times `scale`, rounded up: lengths, durations, loads and begins of windows."""
    product = np.asarray(values) * scale
    return np.ceil(product - NOISE * np.abs(product)).astype(np.int64)


def round_down(values: ArrayLike, scale: float) -> Ints:
    """Return `values` times `scale`, rounded down and at most :data:`FOREVER`: limits and ends."""
    product = np.asarray(values) * scale
    return np.floor(np.minimum(product + NOISE * np.abs(product), FOREVER)).astype(np.int64)


def _power(largest: float, bound: float) -> float:
    """Return the largest power of 2 that scales `largest` to at most `bound`; 1 for `largest` 0."""
    if not 0.0 < largest < math.inf:
        return 1.0
    return math.ldexp(1.0, min(math.frexp(bound)[1] - 1 - math.frexp(largest)[1], 1000))


@dataclass(frozen=True)
class Scales:
    """Factors from metres, seconds and costs to whole numbers.

    `origin` is the time in seconds of the whole number 0, and `rates` the cost of each vehicle per whole
    unit of time. Factors are powers of 2 if possible, so that whole numbers stay exact.
    """

    length: float
    time: float
    cost: float
    origin: float
    rates: tuple[int, ...]

    def moment(self, time: float, up: bool) -> int:
        """Return the whole number of a time in seconds, rounded up or down."""
        return int((round_up if up else round_down)(time - self.origin, self.time))

    def release(self, model: FleetRouting, node: int) -> int:
        """Return the release of `node`."""
        return 0 if model.releases is None else self.moment(float(model.releases[node]), True)

    def prize(self, model: FleetRouting, node: int) -> int:
        """Return the prize of `node`, 0 for one that must be visited."""
        if model.prizes is None or not model.optional[node]:
            return 0
        return round(float(model.prizes[node]) * self.cost)

    def fixed(self, model: FleetRouting, k: int) -> int:
        """Return the fixed cost of vehicle `k`."""
        return 0 if model.fixed_cost is None else round(float(model.fixed_cost[k]) * self.cost)


def scales_of(model: FleetRouting) -> Scales:
    """Return the factors of a fleet."""
    longest = float(model.distances.max())
    time, origin = _time_scale(model)
    per_metre, per_second = costs_of(model)
    dear, hourly = float(per_metre.max()) * longest, float(per_second.max())
    fixed = 0.0 if model.fixed_cost is None else float(model.fixed_cost.max())
    once = max(fixed, float(np.nansum(model.prizes)) if model.prizes is not None else 0.0)
    cost = _power(dear or once, ARC)
    if hourly > 0.0:
        # The cost of a unit of time must be a whole number, exact for rates with small ratios.
        ratios = per_second / hourly
        tries = np.arange(1, 65)[:, None]
        exact = np.isclose(np.rint(tries * ratios), tries * ratios, rtol=0.0, atol=1e-9).all(axis=1)
        step = int(np.argmax(exact)) + 1 if exact.any() else 1024
        units = step * max(1, math.ceil(cost * hourly / (time * step))) if dear > 0.0 else step
        cost = units * time / hourly
    for value, most in ((dear, MOST_ARC), (once, MOST_COST)):
        cost = _power(value, most) if value * cost > most else cost
    rates = np.rint(per_second * cost / time).astype(int)
    return Scales(_power(longest, ARC), time, cost, origin, tuple(rates.tolist()))


def _time_scale(model: FleetRouting) -> tuple[float, float]:
    """Return the factor of times, and the time in seconds of the whole number 0."""
    if not model.has_times:
        return 1.0, 0.0
    begins = [0.0, *(span[0] for spans in model.windows or () for span in spans or ())]
    begins += [] if model.shifts is None else model.shifts[:, 0].tolist()
    begins += [] if model.releases is None else model.releases.tolist()
    origin = min(begins)
    horizon = max(begins) - origin
    step = float(model.base_times.max()) / float(model.speeds.min())
    service = 0.0 if model.service is None else float(model.service.max())
    # Otherwise units of length and time are equal, as PyVRP's neighbourhoods add both.
    if service > 64 * step or model.times is not None or model.speed is not None:
        step = max(step, service)
    scale = _power(step or horizon, ARC)
    return (min(scale, _power(horizon, FOREVER / 8)) if horizon > 0.0 else scale), origin


def costs_of(model: FleetRouting) -> tuple[Floats, Floats]:
    """Return the costs per metre and per second of each vehicle in the objective, shape (vehicles,)."""
    ones, none = np.ones(model.vehicles), np.zeros(model.vehicles)
    metre = ones if model.distance_cost is None else model.distance_cost
    return metre, none if model.time_cost is None else model.time_cost


def whole_spans(model: FleetRouting, node: int, scales: Scales) -> list[tuple[int, int]]:
    """Return the windows of `node`; one without limits if it has none, or is -1.

    A window shorter than one unit becomes the first unit after its begin.
    """
    spans = None if model.windows is None or node < 0 else model.windows[node]
    return [_whole_span(scales, *span) for span in spans or [(scales.origin, math.inf)]]


def whole_shift(model: FleetRouting, k: int, scales: Scales) -> tuple[int, int]:
    """Return the earliest departure and the latest return of vehicle `k`."""
    return _whole_span(scales, *((0.0, math.inf) if model.shifts is None else model.shifts[k]))


def has_shift(model: FleetRouting, k: int, scales: Scales) -> bool:
    """Return whether the shift of vehicle `k` overlaps a window of each of its depots."""
    early, late = whole_shift(model, k, scales)
    depots = int(model.homes[k]), int(model.finishes[k])
    return all(
        any(early <= end and begin <= late for begin, end in whole_spans(model, node, scales))
        for node in depots
    )


def _whole_span(scales: Scales, begin: float, end: float) -> tuple[int, int]:
    early, late = scales.moment(begin, True), scales.moment(end, False)
    return early, max(early, late)


def is_fetched(model: FleetRouting) -> NDArray[np.bool_]:
    """Return whether each node is in a pair, shape (n,): its goods never see a depot."""
    result = np.zeros(model.size, bool)
    if model.pairs is not None:
        result[model.pairs.ravel()] = True
    return result


def list_backhauls(model: FleetRouting) -> tuple[Ints, Ints]:
    """Return the other nodes to visit, and those with pickups only, which come last in their trip."""
    loads = (model.pickups, model.demands)
    back, front = (
        np.zeros(model.size, bool) if rows is None else rows.reshape(model.size, -1).any(axis=1)
        for rows in loads
    )
    last = np.logical_and(back, ~front)[model.customers]
    return model.customers[~last], model.customers[last]


def _decimal_scale(values: Floats, total: float, most: float) -> float | None:
    """Return the least power of 10 that makes `values` whole numbers with a sum of at most `most`, or None.

    It has at most six digits.
    """
    for factor in 10.0 ** np.arange(7):
        whole = np.rint(values * factor)
        if total * factor <= most and np.allclose(whole, values * factor, rtol=1e-12, atol=0.0):
            return float(factor)
    return None


def whole_loads(model: FleetRouting) -> tuple[Ints, Ints, Ints, Ints]:
    """Return whole-number deliveries, pickups, amounts of pairs, and capacities of the vehicles.

    Loads are rounded up, and capacities down to at most the sum of all amounts. Loads without a common unit
    are scaled to the sum :data:`LOADS` divided by the number of dimensions; a capacity then has one more unit for each load that fits, if this
    exceeds the capacity by at most :data:`EXCESS`. Each row has one number per dimension. Deliveries and
    pickups are from and to the depot, and 0 at the nodes of pairs.
    """
    size, pairs = model.size, np.zeros((0, 2), int) if model.pairs is None else model.pairs
    if model.capacity is None:
        return np.zeros((size, 0), int), np.zeros((size, 0), int), np.zeros((len(pairs), 0), int), np.zeros(
            (model.vehicles, 0), int
        )  # fmt: skip
    capacity = model.capacity.reshape(model.vehicles, -1)
    nothing = np.zeros((size, capacity.shape[1]))
    given = [
        nothing if rows is None else rows.reshape(size, -1)
        for rows in (model.demands, model.pickups)
    ]
    amounts = given[1][pairs[:, 0]]
    loads = np.vstack(
        [*(np.where(is_fetched(model)[:, None], 0.0, rows) for rows in given), amounts]
    )
    whole, limits = np.zeros(loads.shape, np.int64), np.zeros(capacity.shape, np.int64)
    most = LOADS / capacity.shape[1]
    for column in range(capacity.shape[1]):
        total = float(loads[:, column].sum())
        # Loads without few decimals may be multiples of the least one, such as thirds.
        least = float(loads[:, column].min(initial=np.inf, where=loads[:, column] > 0))
        unit = 1.0 if math.isinf(least) else max(least, 1e-290)
        multiple = _decimal_scale(loads[:, column] / unit, total / unit, most)
        exact = _decimal_scale(loads[:, column], total, most)
        exact = exact or (multiple / unit if multiple else None)
        scale = exact or most / max(total, 1e-290)
        whole[:, column] = round_up(loads[:, column], scale)
        limits[:, column] = round_down(capacity[:, column], scale)
        if exact is None:
            # A unit for each load that fits, so that loads that fill a vehicle exactly still fit.
            sums = np.cumsum(np.sort(loads[loads[:, column] > 0.0, column]))
            units = np.searchsorted(sums, capacity[:, column] * (1.0 + NOISE), side="right")
            limits[:, column] += np.where(units <= EXCESS * limits[:, column], units, 0)
        # The sum of the rounded loads may exceed the rounded total.
        has_room = capacity[:, column] >= total * (1.0 - NOISE)
        limits[has_room, column] = whole[:, column].sum()
    return whole[:size], whole[size : 2 * size], whole[2 * size :], limits
