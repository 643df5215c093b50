"""Kernel of the shortest merge of two chains.

It is the dynamic program of :mod:`.table_kernels` for two chains, with the same ties. It keeps one row of
lengths and one byte per state, so that a merge of two chains of 10,000 customers needs 0.1 GB.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["merge_two"]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@kernel
def merge_two(
    start: float, end: float, base: NDArray[Any], chain: NDArray[Any], before_base: Ints,
    before_chain: Ints, far: float, moves: Bytes, merged: Bytes, flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Merge two chains into a shortest path from `start` to `end`; return whether it finished.

    `start`, `end`: coordinates of the places before and after both chains. `base`, `chain`, shapes (p,) and
    (q,): coordinates of the customers of both chains. `before_base`, shape (p,): number of customers of `chain`
    that must be served before each customer of `base`. `before_chain`, shape (q,): number of customers of
    `base` that must be served before each customer of `chain`. `far`: length of an infeasible path. `moves`,
    shape (m,): scratch space for at least (p + 1)(q + 1) states. `merged`, shape (p + q,): overwritten: 1 for a
    customer of `chain`, 0 for one of `base`, in the order of service. Ties are resolved from the end of the
    path, in favour of `base`.
    """
    p, q = base.size, chain.size
    # Least lengths through the states with i customers of `base`, by the last customer: in `lasts` one of
    # `base`, in `others` one of `chain`.
    lasts, others = np.full(q + 1, far, base.dtype), np.full(q + 1, far, base.dtype)
    steps = np.empty(q + 1, base.dtype)
    for j in range(1, q + 1):
        steps[j] = abs(chain[j - 1] - (chain[j - 2] if j > 1 else start))
        if before_chain[j - 1] == 0:
            others[j] = steps[1] if j == 1 else min(others[j - 1] + steps[j], far)
        moves[j] = 2
    for i in range(1, p + 1):
        if flag[0] != 0:
            return False
        here, first, row = base[i - 1], before_base[i - 1], i * (q + 1)
        step = abs(here - (base[i - 2] if i > 1 else start))
        before = far
        if first == 0:
            before = step if i == 1 else min(lasts[0] + step, far)
        lasts[0], other = before, far
        moves[row] = 0
        for j in range(1, q + 1):
            there = chain[j - 1]
            across = abs(here - there)
            way, turn = lasts[j] + step, others[j] + across
            last, move = way, 0
            if turn < way:
                last, move = turn, 1
            if first > j or last > far:
                last = far
            way, turn = before + across, other + steps[j]
            if turn < way:
                way, move = turn, move | 2
            if before_chain[j - 1] > i or way > far:
                way = far
            moves[row + j] = move
            lasts[j], others[j] = last, way
            before, other = last, way
    i, j = p, q
    chosen = 1
    if q == 0 or (
        p > 0 and lasts[q] + abs(base[p - 1] - end) <= others[q] + abs(chain[q - 1] - end)
    ):
        chosen = 0
    for stop in range(p + q - 1, -1, -1):
        merged[stop] = chosen
        move = moves[i * (q + 1) + j]
        if chosen == 0:
            i -= 1
            chosen = move & 1
        else:
            j -= 1
            chosen = move >> 1
    return True
