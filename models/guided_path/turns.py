"""How often a shortest tour may turn: where turning can pay, and what turns cost."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .gaps import Gaps

__all__ = ["enough_sweeps", "some_length", "turning"]

Floats = NDArray[np.float64]

#: Customers up to which some tour is searched for, and the states then kept, times their square.
_MOST, _WORK = 300, 30_000
#: Length that bounds no tour, in units of the longest gap: 5000 turns, each past 5000 gaps.
_FAR = 1e9
#: What the linear program's optimum may lack by rounding.
_ROUNDING = 1e-4


def turning(gaps: Gaps, side: int) -> Iterator[int]:
    """Yield the customers at which a shortest tour may turn after a sweep to one side.

    Let a tour turn at a place x after a sweep to the right (the left is its mirror image), and C be
    whom it serves there then. Between this visit of x and the ones before and after, it is left of x.
    Of C, serve at the visit before whoever follows nobody served since then, and the others, if they
    precede nobody who is served until then, at the visit after. If that served all of C, the tour could
    turn before x and would be shorter. So in a shortest tour some c of C has both

    * a predecessor served since the last visit, thus left of x, or there was no visit yet, and
    * a successor served before the next visit, thus left of x, or there is no next visit.

    Relations within C pass these on to a member with a direct predecessor left of x, or without any,
    and a direct successor not right of x, or without any. Before the first visit, and after the last
    one, the tour is left of x, and so is the start. As everybody is served once, each turn has such a
    customer of its own.

    Parameters
    ----------
    gaps : Gaps
    side : int
        1 for sweeps to the right, -1 for sweeps to the left.
    """
    x = side * gaps.at
    for c in range(1, gaps.model.size):
        beyond = bool(x[c] > x[0])
        came, goes = gaps.before[c], gaps.after[c]
        first = beyond if came == [0] else bool((x[came] < x[c]).any())
        last = beyond if goes == [0] else bool((x[goes] <= x[c]).any())
        if first and last:
            yield c


def enough_sweeps(gaps: Gaps, length: float) -> int:
    """Return a number of sweeps, right and left in turn, that a shortest tour does not exceed.

    A tour that sets out to the left has an empty sweep to the right before.

    With c_g crossings of gap g to the right, and as many to the left, c_p-1 of them come to place p from
    the left and c_p leave it to the right. Those that do not turn there are the same, so R turns to the
    left and L turns to the right have R - L = c_p-1 - c_p; at the start, where the tour begins and ends,
    one more or less. Each c_g is what chains ask at least, R and L are at most the customers of
    :func:`turning` at p, and all crossings together are no longer than the tour. A linear program says
    how many turns this leaves.

    Parameters
    ----------
    gaps : Gaps
    length : float
        Of any tour, m; infinity where none is known.
    """
    from scipy.optimize import linprog
    from scipy.sparse import bmat, diags_array, eye_array

    size = gaps.lengths.size
    if not size:
        return 1
    start = int(gaps.at[0])
    most = [np.bincount(gaps.at[list(turning(gaps, side))], minlength=size + 1) for side in (1, -1)]
    change = diags_array([np.ones(size), -np.ones(size)], offsets=[0, -1], shape=(size + 1, size))
    one = eye_array(size + 1)
    slack = (np.arange(size + 1) == start).astype(float)
    rows = bmat([[change, one, -one], [-change, -one, one]])
    turns = np.repeat([0.0, 1.0, -1.0], [size, size + 1, size + 1])
    unit = float(gaps.lengths.max())
    total = np.concatenate([2 * gaps.lengths / unit, np.zeros(2 * size + 2)])
    # Sweeps alternate, so the turns of both sides differ by one at the most.
    answer = linprog(
        -np.abs(turns), bmat([[rows], [turns[None]], [-turns[None]], [total[None]]]).tocsr(),
        np.concatenate([slack, slack, [1.0, 1.0], [min(length / unit, _FAR) * (1 + 1e-9)]]),
        bounds=[
            *((int(c), None) for c in gaps.crossings), *((0, int(m)) for m in np.concatenate(most))
        ],
    )  # fmt: skip
    right, left = (int(m.sum()) for m in most)
    found = -answer.fun if answer.success else np.inf
    # The first turn is that of the first sweep, which goes left only if something is there.
    either = [min(2 * right, 2 * left + 1) + 1]
    if start > 0:
        either.append(min(2 * left, 2 * right + 1) + 2)
        found += 1
    return int(min(max(either), np.floor(found + 1 + _ROUNDING)))


def some_length(gaps: Gaps) -> float:
    """Return the length of a tour that is no bad one, m; infinity for more than 300 customers.

    A search of few states a number of customers served: from each, to the nearest customer on either
    side that may be served. Those are kept that the crossings still needed leave the shortest.
    """
    model, at, lengths = gaps.model, gaps.at, gaps.lengths
    size = model.size
    if size > _MOST + 1:
        return np.inf
    customers = range(1, size)
    needs = [sum(1 << one for one in came if one) for came in gaps.before]
    # Crossings either way from each customer on until the tour is back.
    onwards = np.zeros((size, lengths.size))
    for c in reversed(model.sorted_customers):
        for other in gaps.after[c]:
            onwards[c] = np.maximum(onwards[c], onwards[other] + gaps.between(at[c], at[other]))
    kept = max(_WORK // size**2, 1)
    # By the customers served: the length so far by where the tour is and whom it has served.
    levels: list[dict[tuple[int, int], float]] = [{} for _ in range(size)]
    levels[0][int(at[0]), 0] = 0.0
    for level in levels[:-1]:
        ranked = []
        for (here, done), length in level.items():
            ready = [c for c in customers if not done >> c & 1 and needs[c] & done == needs[c]]
            away = np.stack([gaps.between(here, at[c]) for c in ready])
            left = float(lengths @ (away + onwards[ready]).max(axis=0))
            ranked.append((length + left, length, here, done, ready))
        for _, length, here, done, ready in sorted(ranked)[:kept]:
            places = {int(at[c]) for c in ready}
            aims = {
                max((p for p in places if p <= here), default=-1),
                min((p for p in places if p >= here), default=-1),
            } - {-1}
            for aim in aims:
                now, there = done, [c for c in ready if at[c] == aim]
                while there:  # who may be served there only now, is
                    now |= sum(1 << c for c in there)
                    there = [
                        c for c in customers
                        if at[c] == aim and not now >> c & 1 and needs[c] & now == needs[c]
                    ]  # fmt: skip
                way = length + float(lengths @ gaps.between(here, aim))
                states = levels[now.bit_count()]
                if way < states.get((aim, now), np.inf):
                    states[aim, now] = way
    return min(
        way + float(lengths @ gaps.between(here, at[0])) for (here, _), way in levels[-1].items()
    )
