"""Upper bound on the number of turns of a shortest tour."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .gaps import Gaps

__all__ = ["enough_sweeps", "some_length", "turning"]


#: Maximum number of customers for the heuristic search, and its total work: beam width times size².
_MOST, _WORK = 300, 30_000
#: Length beyond every tour, in units of the longest gap: 5000 turns, each past 5000 gaps.
_FAR = 1e9
#: Margin for the rounding error of the linear program's optimum.
_ROUNDING = 1e-4


def turning(gaps: Gaps, side: int) -> Iterator[int]:
    """Yield the customers at which a shortest tour may turn after a sweep to one side.

    Let a tour turn at a place x after a sweep to the right (the left is its mirror image), and let
    C be the set of customers that it serves there. Between this visit of x and the previous and
    next ones, the tour is left of x. Serve those members of C without a predecessor served since
    the previous visit at that visit. Serve the others, if they have no successor served before the
    next visit, at the next visit. If this serves all of C, the tour can turn before x and becomes
    shorter. So in a shortest tour some c of C has both

    * a predecessor served since the previous visit, therefore left of x, or no previous visit exists;
    * a successor served before the next visit, therefore left of x, or no next visit exists.

    Relations within C transfer these to a member with a direct predecessor left of x, or without
    any, and a direct successor not right of x, or without any. Before the first visit, and after
    the last one, the tour is left of x, and so is the start. Each customer is served once, so the
    turns have distinct customers.

    `side` is 1 for sweeps to the right, and -1 for sweeps to the left.
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
    """Return a number of alternating sweeps that a shortest tour does not exceed.

    A tour that begins to the left has an empty first sweep to the right.

    With c_g crossings of gap g to the right, and as many to the left, c_p-1 of them reach place p
    from the left and c_p leave it to the right. Those that do not turn there are common to both. So
    R turns to the left and L turns to the right satisfy R - L = c_p-1 - c_p; at the start, at which
    the tour begins and ends, up to one more or less. Each c_g is at least the number that chains
    require, R and L are at most the number of customers of :func:`turning` at p, and the length of
    all crossings is at most `length`, that of a known tour in m, or inf. A linear program maximises the number
    of turns.
    """
    from scipy.optimize import linprog
    from scipy.sparse import bmat, diags_array, eye_array

    size = gaps.lengths.size
    if not size:
        return 1
    start = int(gaps.at[0])
    limits = [
        np.bincount(gaps.at[list(turning(gaps, side))], minlength=size + 1) for side in (1, -1)
    ]
    change = diags_array([np.ones(size), -np.ones(size)], offsets=[0, -1], shape=(size + 1, size))
    entry = eye_array(size + 1)
    slack = (np.arange(size + 1) == start).astype(float)
    rows = bmat([[change, entry, -entry], [-change, -entry, entry]])
    turns = np.repeat([0.0, 1.0, -1.0], [size, size + 1, size + 1])
    unit = float(gaps.lengths.max())
    total = np.concatenate([2 * gaps.lengths / unit, np.zeros(2 * size + 2)])
    # Sweeps alternate, so the turns of both sides differ by at most one.
    answer = linprog(
        -np.abs(turns), bmat([[rows], [turns[None]], [-turns[None]], [total[None]]]).tocsr(),
        np.concatenate([slack, slack, [1.0, 1.0], [min(length / unit, _FAR) * (1 + 1e-9)]]),
        bounds=[
            *((int(c), None) for c in gaps.crossings), *((0, int(m)) for m in np.concatenate(limits))
        ],
    )  # fmt: skip
    right, left = (int(m.sum()) for m in limits)
    objective = -answer.fun if answer.success else np.inf
    # The first turn ends the first sweep, which goes left only if a place is left of the start.
    either = [min(2 * right, 2 * left + 1) + 1]
    if start > 0:
        either.append(min(2 * left, 2 * right + 1) + 2)
        objective += 1
    return int(min(max(either), np.floor(objective + 1 + _ROUNDING)))


def some_length(gaps: Gaps) -> float:
    """Return the length of a good tour, in m; inf for more than 300 customers.

    Beam search by the number of customers served. Each state is extended to the nearest available
    customer on either side. States are ranked by their length plus the crossings still required.
    """
    model, at, lengths = gaps.model, gaps.at, gaps.lengths
    size = model.size
    if size > _MOST + 1:
        return np.inf
    customers = range(1, size)
    needs = [sum(1 << entry for entry in came if entry) for came in gaps.before]
    # Crossings in both directions from each customer on, up to the return to the start.
    onwards = np.zeros((size, lengths.size))
    for c in reversed(model.sorted_customers):
        for other in gaps.after[c]:
            onwards[c] = np.maximum(onwards[c], onwards[other] + gaps.between(at[c], at[other]))
    width = max(_WORK // size**2, 1)
    # Per number of customers served: length by place and set of customers served (bit mask).
    levels: list[dict[tuple[int, int], float]] = [{} for _ in range(size)]
    levels[0][int(at[0]), 0] = 0.0
    for level in levels[:-1]:
        ranked = []
        for (here, done), length in level.items():
            ready = [c for c in customers if not done >> c & 1 and needs[c] & done == needs[c]]
            away = np.stack([gaps.between(here, at[c]) for c in ready])
            left = float(lengths @ (away + onwards[ready]).max(axis=0))
            ranked.append((length + left, length, here, done, ready))
        for _, length, here, done, ready in sorted(ranked)[:width]:
            places = {int(at[c]) for c in ready}
            aims = {
                max((p for p in places if p <= here), default=-1),
                min((p for p in places if p >= here), default=-1),
            } - {-1}
            for aim in aims:
                now, there = done, [c for c in ready if at[c] == aim]
                while there:  # serve all available customers at this place
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
