"""Kernels of the search by levels: children of states, with the bound of an assignment problem.

A state is the set of visited nodes and the last of them. Every unvisited node needs one predecessor among the last
node and the other unvisited ones: an assignment problem, whose value is a lower bound on the rest of the path. The
assignment of a child differs from that of its parent in one row and one column, so that one or two shortest
augmenting paths solve it (R. Jonker, A. Volgenant, "A shortest augmenting path algorithm for dense and sparse linear
assignment problems", Computing 38, 1987).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["BITS", "States", "assign_root", "expand", "new_states"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Nodes per word of a set.
BITS = 62


class States(NamedTuple):
    """States of one level.

    Parameters
    ----------
    sets : ndarray of int, shape (states, words)
        Visited nodes, :data:`BITS` per word.
    last, parent : ndarray of int32, shape (states,)
        Last node, and number of the parent in the level above.
    length, rest : ndarray, shape (states,)
        Length of the path, and bound on the rest.
    row, column : ndarray, shape (states, n)
        Dual values of the assignment: leaving and entering a node.
    tail : ndarray of int16, shape (states, n)
        Node before each unvisited node in the assignment.
    """

    sets: Ints
    last: NDArray[np.int32]
    parent: NDArray[np.int32]
    length: Floats
    rest: Floats
    row: Floats
    column: Floats
    tail: NDArray[np.int16]


class _Scratch(NamedTuple):
    """Assignment of one state and the scratch space of its augmenting paths, per node."""

    row: Floats
    column: Floats
    tail: Ints
    head: Ints
    heads: Ints
    reach: Floats
    via: Ints
    scanned: Ints
    waits: NDArray[np.bool_]


@kernel
def _scratch(size: int) -> _Scratch:
    """Return the arrays without an assignment."""
    numbers = np.full((5, size), -1, np.int64)
    floats, waits = np.zeros((3, size)), np.zeros(size, np.bool_)
    tail, head, heads, via, scanned = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    return _Scratch(floats[0], floats[1], tail, head, heads, floats[2], via, scanned, waits)


@kernel
def _augment(
    cost: Floats, missing: float, last: int, at: _Scratch, count: int, start: int
) -> float:
    """Assign row `start` by a shortest augmenting path, and return the increase of the value.

    The first `count` of `heads` are the columns. The last node cannot precede a node that `waits`.
    """
    row, column, tail, head, heads, reach, via, scanned, waits = at
    for m in range(count):
        reach[heads[m]] = np.inf
    done, far, node = 0, 0.0, start
    # The first `done` entries of `scanned` are final, the others are open.
    for m in range(count):
        scanned[m] = heads[m]
    while True:
        best, place = np.inf, -1
        for m in range(done, count):
            j = scanned[m]
            arc = missing if node == last and waits[j] else cost[node, j]
            way = far + arc - row[node] - column[j]
            if way < reach[j]:
                reach[j], via[j] = way, node
            if reach[j] < best:
                best, place = reach[j], m
        j = scanned[place]
        scanned[place], scanned[done] = scanned[done], j
        done += 1
        far = best
        if tail[j] < 0:
            break
        node = tail[j]
    row[start] += far
    for m in range(done - 1):
        other = scanned[m]
        row[tail[other]] += far - reach[other]
        column[other] -= far - reach[other]
    while True:
        node = via[j]
        former = head[node]
        tail[j], head[node] = node, j
        if node == start:
            return far
        j = former


def new_states(size: int, room: int) -> States:
    """Return empty states of a problem with `size` nodes."""
    return States(
        np.empty((room, -(-size // BITS)), np.int64), np.empty(room, np.int32), np.empty(room, np.int32),
        np.empty(room), np.empty(room), np.empty((room, size)), np.empty((room, size)),
        np.empty((room, size), np.int16),
    )  # fmt: skip


@kernel(interpretable=True, in_place=True)
def assign_root(
    cost: Floats, missing: float, waits: NDArray[np.bool_], states: States, flag: NDArray[np.int8]
) -> bool:
    """Fill in state 0: node 0 is visited. Return False if it was stopped."""
    size = len(cost)
    at, total = _scratch(size), 0.0
    for node in range(size):
        at.waits[node] = waits[node]
    for node in range(size - 1):
        at.heads[node] = node + 1
    for node in range(size - 1):
        if flag[0]:
            return False
        total += _augment(cost, missing, 0, at, size - 1, node)
    states.sets[0, :] = 0
    states.sets[0, 0] = 1
    states.last[0], states.parent[0], states.length[0], states.rest[0] = 0, -1, 0.0, total
    for j in range(size):
        states.row[0, j], states.column[0, j] = at.row[j], at.column[j]
        states.tail[0, j] = at.tail[j]
    return True


@kernel
def _slot(states: States, key: Ints, node: int, table: NDArray[np.int32]) -> int:
    """Return the slot of the table with this state, or an empty one."""
    mask, words = len(table) - 1, len(key)
    code = node * 40503 + 1
    for w in range(words):
        code = (code ^ (key[w] & 0x7FFFFFFF) ^ (key[w] >> 31)) * 0x9E3779B1 & 0x7FFFFFFF
        code ^= code >> 15
    slot = code & mask
    while table[slot] >= 0:
        entry = table[slot]
        same = states.last[entry] == node
        for w in range(words):
            same = same and states.sets[entry, w] == key[w]
        if same:
            return slot
        slot = (slot + 1) & mask
    return slot


@kernel(interpretable=True, in_place=True)
def expand(
    cost: Floats, missing: float, before: Ints, parents: States, count: int, children: States,
    table: NDArray[np.int32], upper: float, flag: NDArray[np.int8],
) -> tuple[int, int]:  # fmt: skip
    """Generate the children of the first `count` parents whose bounds are below `upper`.

    Of two children with the same nodes and the same last node only the one with the shorter path is kept.

    `cost`, shape (n, n): distances, with `missing` for arcs that do not exist. `missing`: length of a missing
    arc. `before`, shape (n, words): predecessors of each node, :data:`BITS` per word. `parents`, `children`:
    states of two levels; the children are overwritten. `count`: number of parents. `table`, shape (power of
    two,): scratch space of the hash table, larger than the number of children. `upper`: bound above which
    states are omitted. Result: number of parents that were expanded completely, and of children.
    """
    size, words = before.shape
    room, made = len(children.last), 0
    table[:] = -1
    at, heads, key = _scratch(size), np.zeros(size, np.int64), np.zeros(words, np.int64)
    row, column, tail, head, columns = at.row, at.column, at.tail, at.head, at.heads
    for p in range(count):
        if flag[0]:
            return p, made
        last, length, rest = parents.last[p], parents.length[p], parents.rest[p]
        if length + rest >= upper:
            continue
        left = 0
        for j in range(1, size):
            if not parents.sets[p, j // BITS] >> (j % BITS) & 1:
                heads[left] = j
                left += 1
        for m in range(left):
            child = heads[m]
            ready = True
            for w in range(words):
                ready = ready and before[child, w] & ~parents.sets[p, w] == 0
            arc = cost[last, child]
            slack = arc - parents.row[p, last] - parents.column[p, child]
            if not ready or arc >= missing or length + rest + slack >= upper:
                continue
            for w in range(words):
                key[w] = parents.sets[p, w]
            key[child // BITS] |= 1 << (child % BITS)
            slot = _slot(children, key, child, table)
            entry = table[slot]
            if entry >= 0:
                if length + arc < children.length[entry]:
                    children.length[entry], children.parent[entry] = length + arc, p
                continue
            # The assignment without the row of the last node and the column of the child.
            others = 0
            for q in range(left):
                if q != m:
                    columns[others] = heads[q]
                    others += 1
            for j in range(size):
                row[j], column[j] = parents.row[p, j], parents.column[p, j]
                tail[j], head[j] = -1, -1
            for q in range(others):
                j = columns[q]
                ready = True
                for w in range(words):
                    ready = ready and before[j, w] & ~key[w] == 0
                at.waits[j] = not ready
                node = parents.tail[p, j]
                if node != last and not (node == child and at.waits[j]):
                    tail[j], head[node] = node, j
            bound = rest - row[last] - column[child]
            for q in range(-1, others):
                # The rows are the child and the unvisited nodes except for the last node of the path.
                node = child if q < 0 else columns[q]
                if node != size - 1 and head[node] < 0 and length + arc + bound < upper:
                    bound += _augment(cost, missing, child, at, others, node)
            if length + arc + bound >= upper:
                continue
            if made == room:
                return p, made
            for w in range(words):
                children.sets[made, w] = key[w]
            children.last[made], children.parent[made] = child, p
            children.length[made], children.rest[made] = length + arc, bound
            for j in range(size):
                children.row[made, j], children.column[made, j] = row[j], column[j]
                children.tail[made, j] = tail[j]
            table[slot] = made
            made += 1
    return count, made
