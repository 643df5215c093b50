"""Labels of partial tours with optional fields: extension by one stop, dominance, and a lower bound."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .track_tables import ROUNDING, TrackTables

__all__ = ["Labels", "finish", "first_label", "grow", "rest_of", "without_dominated"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of entries of a temporary table of crossings.
ENTRIES = 4_000_000


@dataclass(frozen=True)
class Labels:
    """Partial tours that serve the same number of customers, one per row.

    Parameters
    ----------
    counts : ndarray, shape (s, k)
        Customers served per chain.
    at : ndarray, shape (s, m)
        Place of each vehicle.
    owner : ndarray, shape (s, k)
        Vehicle of each chain, -1 before its first customer; no column for one vehicle.
    load : ndarray, shape (s, m)
        Load of each vehicle; no column without loads.
    cost : ndarray, shape (s,)
        Length in m.
    ready : ndarray, shape (s, ...)
        Time in s: the end of the last service, shape (s,); for several vehicles with windows the earliest
        begin of each open customer by each vehicle, and of the return, shape (s, m, n + 2).
    parent, stop, vehicle : ndarray, shape (s,)
        Row of the previous label, customer served last and its vehicle.
    """

    counts: NDArray[np.int16]
    at: NDArray[np.int32]
    owner: NDArray[np.int16]
    load: Floats
    cost: Floats
    ready: Floats
    parent: Ints
    stop: Ints
    vehicle: Ints

    def take(self, rows: Any) -> Labels:
        """Return the labels in `rows`."""
        fields = dataclasses.fields(self)
        return Labels(*(getattr(self, field.name)[rows] for field in fields))


def first_label(tables: TrackTables) -> Labels:
    """Return the label of the start."""
    model, m, k = tables.model, tables.fleet, len(tables.chains)
    loads = [] if model.loads is None else [float(model.loads[0])] * m
    begin = 0.0 if model.windows is None else float(model.windows[0, 0])
    begin += 0.0 if model.service is None else float(model.service[0])
    ready = np.full(1, begin)
    if m > 1 and model.windows is not None:
        shift = tables.goals - tables.places[tables.homes][:, None, None]
        apart = _apart(shift, np.arange(m) - np.arange(m)[:, None])
        apart[..., -1] *= not tables.free
        ready = (begin + apart / (model.speed or 1.0)).max(axis=0)[None]
    zero = np.zeros(1, np.int64)
    return Labels(
        np.zeros((1, k), np.int16), tables.same[tables.homes][None].astype(np.int32),
        np.full((1, k if m > 1 else 0), -1, np.int16), np.array([loads]), np.zeros(1), ready, zero, zero, zero,
    )  # fmt: skip


def _apart(shift: Floats, vehicles: Ints) -> Floats:
    """Return the way that needs time between two stops, in m, see :mod:`~.guided_path.schedule`.

    `shift` leads from the first stop to the second, shape (..., m, places); `vehicles` is the difference of
    their vehicles, shape (..., m).
    """
    apart = np.where(vehicles[..., None] > 0, -shift, shift)
    return np.where(vehicles[..., None] == 0, np.abs(shift), np.maximum(apart, 0.0))


def grow(tables: TrackTables, labels: Labels) -> Labels:
    """Return all labels with one more customer, without those that violate a constraint."""
    stops = tables.following[tables.start[:-1] + labels.counts]
    may_follow = stops > 0
    for c, needed in tables.requiring:
        served = labels.counts[:, needed] >= tables.need[stops[:, c]][:, needed]
        may_follow[:, c] &= served.all(axis=1)
    parts = []
    for vehicle in range(tables.fleet):
        fits = may_follow
        if tables.fleet > 1:
            fits = may_follow & ((labels.owner < 0) | (labels.owner == vehicle))
        rows, chains = np.nonzero(fits)
        parts.append(_serve(tables, labels, rows, chains, vehicle))
    fields = dataclasses.fields(labels)
    return Labels(
        *(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields)
    )


def _serve(tables: TrackTables, labels: Labels, rows: Ints, chains: Ints, vehicle: int) -> Labels:
    """Return the labels `rows` after the service of the next customer of each of `chains` by `vehicle`."""
    model, old = tables.model, labels.take(rows)
    each = np.arange(len(rows))
    stop = tables.following[tables.start[chains] + old.counts[each, chains]]
    here = tables.same[stop]
    counts, at, load, owner = old.counts.copy(), old.at.copy(), old.load, old.owner
    counts[each, chains] += 1
    if tables.fleet > 1:
        owner = owner.copy()
        owner[each, chains] = vehicle
        x = tables.places
        for other in range(tables.fleet):
            behind, before = x[at[:, other]] > x[here], x[at[:, other]] < x[here]
            pushed = (other <= vehicle) & behind | (other >= vehicle) & before
            at[:, other] = np.where(pushed, here, at[:, other])
    else:
        at[:, 0] = here
    cost = old.cost + tables.ways[old.at, at].sum(axis=1)
    allowed = np.ones(len(rows), bool)
    if model.loads is not None:
        load = load.copy()
        load[:, vehicle] += model.loads[stop]
        slack = ROUNDING * float(np.abs(model.loads).max())
        most = np.inf if model.capacity is None else model.capacity
        allowed &= (load[:, vehicle] >= -slack) & (load[:, vehicle] <= most + slack)
    ready = old.ready
    if model.windows is not None and model.speed is not None:
        several = tables.fleet > 1
        came = ready[each, vehicle, stop] if several else (
            ready + tables.ways[old.at[:, 0], here] / model.speed
        )  # fmt: skip
        begin = np.maximum(came, model.windows[stop, 0])
        allowed &= begin <= tables.latest[stop]
        leave = begin if model.service is None else begin + model.service[stop]
        ready = _ready(tables, ready, stop, vehicle, leave) if several else leave
    new = Labels(counts, at, owner, load, cost, ready, rows, stop, np.full(len(rows), vehicle))
    return new if allowed.all() else new.take(allowed)


def _ready(tables: TrackTables, ready: Floats, stop: Ints, vehicle: int, leave: Floats) -> Floats:
    """Return the earliest begins after a service that ends at `leave`; 0 for customers that are served."""
    model, m = tables.model, tables.fleet
    assert model.speed is not None
    shift = tables.goals - tables.places[stop][:, None, None]
    apart = _apart(shift, np.arange(m) - vehicle)
    waits = (apart > 0) | (np.arange(m) == vehicle)[:, None]
    waits |= np.pad(model.closure[stop], ((0, 0), (0, 1)))[:, None]
    waits[..., -1] = True
    apart[..., -1] *= not tables.free
    ready = np.where(waits, np.maximum(ready, leave[:, None, None] + apart / model.speed), ready)
    ready[np.arange(len(stop)), :, stop] = 0.0
    return ready


def without_dominated(tables: TrackTables, labels: Labels) -> Labels:
    """Return the labels that no other one with the same customers and places dominates.

    A label dominates another one if it is neither longer nor later.
    """
    if not len(labels.cost):
        return labels
    columns = [*labels.counts.T, *labels.at.T, *labels.owner.T]
    tops = [
        *map(len, tables.chains),
        *[len(tables.places)] * tables.fleet,
        *[tables.fleet] * labels.owner.shape[1],
    ]
    words, used = [np.zeros(len(labels.cost), np.int64)], 0
    for column, top in zip(columns, tops, strict=True):
        bits = int(top + 1).bit_length()
        if used + bits > 62:
            words, used = [*words, np.zeros_like(words[0])], 0
        words[-1] = words[-1] << bits | (column + 1).astype(np.int64)
        used += bits
    time = labels.ready
    if time.ndim > 1:  # only equal times of all vehicles and customers are compared
        words += list(time.transpose(1, 2, 0).reshape(-1, len(time)).view(np.int64))
        time = np.zeros(len(time))
    order = np.lexsort((time, labels.cost, *words))
    changed = np.zeros(len(order), bool)
    changed[:1] = True
    for word in words:
        changed[1:] |= np.diff(word[order]) != 0
    group = np.cumsum(changed)
    if tables.model.windows is None:
        return labels.take(order[changed])
    ranks = np.unique(time[order], return_inverse=True)[1].reshape(-1)
    # Ranks of later groups are smaller, so that the minimum starts again in each group.
    ranks = ranks - group * (len(order) + 1)
    least = np.minimum.accumulate(ranks)
    kept = changed.copy()
    kept[1:] |= ranks[1:] < least[:-1]
    return labels.take(order[kept])


def rest_of(
    tables: TrackTables, labels: Labels, stopped: Callable[[], bool] = lambda: False
) -> Floats:
    """Return a lower bound on the rest of each tour, in m.

    The vehicle of a chain crosses each piece of the track at least as often as the rest of the chain does. The
    bound takes the maximum over the chains at each piece. It ignores loads and windows, which only exclude
    tours. With a capacity, the crossings must also carry the loads of all chains, see
    :attr:`.TrackTables.carried`. On a loop the bound is the length of the rest of a chain.
    """
    sides = tables.sides
    result = np.zeros(len(labels.cost))
    pieces = 1 if sides is None else max(len(sides[1]), 1)
    step = max(ENTRIES // (pieces * len(tables.chains)), 1)
    for begin in range(0, len(result), step):
        if stopped():  # the caller discards the result
            break
        best = _crossings(tables, labels.take(slice(begin, begin + step)))
        result[begin : begin + step] = best if sides is None else best @ sides[1]
    if tables.fleet > 1 and not tables.free:
        result = np.maximum(result, tables.ways[labels.at, tables.homes].sum(axis=1))
    return result


def _crossings(tables: TrackTables, labels: Labels) -> Any:
    """Return the least number of crossings of each piece, shape (s, pieces); on a loop a length, shape (s,)."""
    firsts, table = tables.rest
    sides, carried, at = tables.sides, tables.carried, labels.at
    rows = tables.start[:-1] + labels.counts
    first, here = firsts[rows], at[:, :1]
    known = first >= 0
    if tables.fleet > 1:
        known &= labels.owner >= 0
        here = np.take_along_axis(at, np.maximum(labels.owner, 0), axis=1)
    if sides is None:
        return (table[rows] + tables.ways[here, first] * known).max(axis=1)
    ahead, now, known = sides[0][first], sides[0][here], known[..., None]
    best = (table[rows] + ((now != ahead) & known)).max(axis=1)
    if carried is None:
        return best
    loads, flows, limit = carried
    weight = loads[rows][..., None] * known
    forth, back = (
        np.ceil((flow[rows] + weight * way).sum(axis=1) / limit - ROUNDING)
        for flow, way in zip(flows, (~now & ahead, now & ~ahead), strict=True)
    )
    if tables.fleet > 1:
        return np.maximum(best, forth + back)
    # Crossings to both sides alternate; the first and the last side determine their difference.
    start = now[:, 0]
    more = (1 if tables.goal < 0 else sides[0][tables.goal].astype(int)) - start
    less = start if tables.goal < 0 else -more
    return np.maximum(best, np.maximum(2 * forth - more, 2 * back - less))


def finish(tables: TrackTables, labels: Labels) -> Floats:
    """Return the length of each complete tour in m, infinite if its end is too late."""
    model, cost, time = tables.model, labels.cost, labels.ready
    if tables.goal >= 0:
        way = tables.ways[labels.at[:, 0], tables.goal]
        cost = cost + way
        time = time if model.speed is None else time + way / model.speed
    elif not tables.free:
        cost = cost + tables.ways[labels.at, tables.homes].sum(axis=1)
    if model.windows is None:
        return cost
    time = time if time.ndim == 1 else time[..., -1].max(axis=1)
    return np.where(time > tables.limits[0], np.inf, cost)
