"""Customers that a tour along a path serves without additional length, because it passes them.

By Property 1 of the paper, only the outermost two customers without any relation matter. This
generalises to each customer located between all its predecessors and all its successors: every tour
passes it between the last predecessor and the first successor.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from heapq import heapify, heappop, heappush
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ...timing import stop_if
from ..fields import required
from .data import GuidedPathData
from .extensions import name_unsupported
from .plan import GuidedPathPlan

__all__ = ["Flag", "kept_order", "length_of", "passed", "reduced", "served"]

#: Stop flag of a run, nonzero to stop; None for computations that nothing stops.
Flag = NDArray[np.int8] | None

#: Cache of :func:`reduced` per model and value of `passing`: a call takes 0.1 to 0.3 s for 5,000
#: customers.
_REDUCED: WeakKeyDictionary[GuidedPathData, dict[bool, tuple[GuidedPathData, tuple[int, ...]]]]
_REDUCED = WeakKeyDictionary()


def reduced(
    model: GuidedPathData, *, passing: bool = True, flag: Flag = None
) -> tuple[GuidedPathData, tuple[int, ...]]:
    """Return a smaller model of the customers that affect the length of a tour, and their numbers.

    Both models have the same optimum: :func:`served` converts a tour of either one to the other. If
    no customer affects the length, the smaller model contains one customer.

    Parameters
    ----------
    model : GuidedPathData
        The model.
    passing : bool
        Whether to omit every customer that any tour passes in time. If False, only the customers of
        Property 1 are omitted.
    flag : ndarray of int8, shape (1,), optional
        Stop flag, nonzero to stop.

    Returns
    -------
    GuidedPathData, tuple of int
        The smaller model, whose relation is given by precedence; and the number in `model` of its
        start and of each of its customers, in increasing order. Results are cached per model.

    Raises
    ------
    UnsupportedFormulation
        The model has optional fields, with which passing a customer without service may be better.
    OutOfTime
        `flag` stopped it.
    """
    if reason := name_unsupported(model):
        raise UnsupportedFormulation(f"the smaller model does not cover {reason}")
    results = _REDUCED.setdefault(model, {})
    if passing not in results:
        results[passing] = _reduced(model, passing, flag)
    return results[passing]


def _reduced(
    model: GuidedPathData, passing: bool, flag: Flag
) -> tuple[GuidedPathData, tuple[int, ...]]:
    x = model.coordinates.tolist()
    before, after = (list(map(set, lists)) for lists in (model.before, model.after))
    relevant = set(range(1, model.size))
    last = model.sorted_customers[-1]
    todo = list(reversed(model.sorted_customers)) if passing else []
    while todo:
        stop_if(flag)
        c = todo.pop()
        # Skip a customer whose removal would increase the number of pairs, which slows down later
        # steps.
        many = len(before[c]) * len(after[c]) > len(before[c]) + len(after[c])
        if many or c not in relevant:
            continue
        here = x[c]
        came, goes = [x[k] for k in before[c] or (0,)], [x[k] for k in after[c] or (0,)]
        if (
            max(came) <= here <= min(goes)
            or max(goes) <= here <= min(came)
            or min(came) == here == max(came)
            or min(goes) == here == max(goes)
        ):
            relevant.discard(c)
            todo += [*before[c], *after[c]]
            for entry in before[c]:
                after[entry] = (after[entry] - {c}) | after[c]
            for other in after[c]:
                before[other] = (before[other] - {c}) | before[c]
    free = sorted((x[c], c) for c in relevant if not before[c] and not after[c])
    relevant.difference_update(c for _, c in free)
    ends = [x[0], *(x[c] for c in relevant)]
    if free and free[0][0] < min(ends):
        relevant.add(free[0][1])
    if free and free[-1][0] > max(ends):
        relevant.add(min(c for there, c in free if there == free[-1][0]))
    numbers = (0, *sorted(relevant or {last}))
    stop_if(flag)
    firsts = np.repeat(numbers, [len(after[c]) if c in relevant else 0 for c in numbers])
    seconds = np.array([c for first in sorted(relevant) for c in after[first]], np.int64)
    relation = np.searchsorted(numbers, np.column_stack([firsts, seconds]))
    return type(model)(model.coordinates[list(numbers)], precedence=relation), numbers


def served(model: GuidedPathData, stops: Iterable[int]) -> tuple[int, ...]:
    """Return the order of service if every available customer is served when it is passed.

    No other service order along the same walk has served more customers at any time. The order
    therefore serves every customer if any order does, and it is at most as long as the walk.

    Parameters
    ----------
    model : GuidedPathData
        The model.
    stops : iterable of int
        Customers to walk to in sequence, from the start and finally back to it. Customers may be
        missing or repeated.

    Returns
    -------
    tuple of int
        All customers; among those available at the same place, the smaller number first.

    Raises
    ------
    InvalidData
        The walk does not pass a customer after all its predecessors are served.
    """
    x = model.coordinates.tolist()
    after, missing = model.after, list(map(len, model.before))
    ready = [c for c in range(1, model.size) if not missing[c]]
    # Heaps of available customers on each side, nearest first, as pairs of signed place and number.
    ahead = {side: [(side * x[c], c) for c in ready] for side in (1, -1)}
    ahead = {
        side: [entry for entry in heap if entry[0] >= side * x[0]] for side, heap in ahead.items()
    }
    for heap in ahead.values():
        heapify(heap)
    order: list[int] = []
    done = [False] * model.size
    at = x[0]
    for stop in (0, *stops, 0):
        side = 1 if x[stop] >= at else -1
        heap = ahead[side]
        while heap and heap[0][0] <= side * x[stop]:
            _, c = heappop(heap)
            if done[c]:
                continue
            at = x[c]
            order.append(c)
            done[c] = True
            for other in after[c]:
                missing[other] -= 1
                if not missing[other]:
                    for way in (1, -1):
                        if way * x[other] >= way * at:
                            heappush(ahead[way], (way * x[other], other))
        at = x[stop]
    if len(order) < model.size - 1:
        left = next(c for c in model.sorted_customers if not done[c])
        raise InvalidData(
            f"stops must lead past customer {model.label(left)} once it may be served",
            field="stops",
        )
    return tuple(order)


def passed(model: GuidedPathData, stops: Sequence[int]) -> tuple[int, ...]:
    """Return the order of service with the other customers inserted between the stops.

    The other customers are served when the vehicle passes them (Algorithm 1). They must have no relation, and
    the path between the stops must pass them.
    """
    x = model.coordinates.tolist()
    left = sorted(set(range(1, model.size)).difference(stops), key=lambda c: (x[c], c))
    places = [x[c] for c in left]
    order: list[int] = []
    at = x[0]
    for stop in (*stops, 0):
        low, high = sorted((at, x[stop]))
        passing = slice(bisect_left(places, low), bisect_right(places, high))
        way = left[passing]
        if way:
            del left[passing], places[passing]
            order += way if at <= x[stop] else way[::-1]
        order.append(stop)
        at = x[stop]
    return tuple(order[:-1])


def kept_order(model: GuidedPathData, numbers: Sequence[int], plan: GuidedPathPlan) -> list[int]:
    """Return the order of service of a plan in the smaller model of :func:`reduced`, which gave `numbers`.

    Raise :class:`InvalidData` if `plan` does not contain each customer once.
    """
    required("plan", plan, GuidedPathPlan)
    if sorted(plan.order) != list(range(1, model.size)):
        raise InvalidData("order must contain each customer once", field="order")
    number = {c: k for k, c in enumerate(numbers)}
    return [number[c] for c in plan.order if c in number]


def length_of(model: GuidedPathData, order: Sequence[int]) -> float:
    """Return the length (m) of the tour that serves customers in the given order."""
    stops = model.coordinates[[0, *order, 0]]
    return float(np.abs(np.diff(stops)).sum())
