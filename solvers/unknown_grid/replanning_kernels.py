"""Replanning in a batch of scenes: the evidence of cells, and the first action of a shortest path on the known map.

Maps and numbers of cells are those of :mod:`.dstar_kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.unknown_grid.moving import FAR, descend, spread
from ...models.unknown_grid.world import BLOCKED, TARGET, UNKNOWN
from .dstar_kernels import STUCK, repair, search

__all__ = ["ACTION", "CHANGED", "EXPECTED", "GOAL", "LAST", "TIME", "WAITS", "plan"]

Bytes = NDArray[np.uint8]
Flag = NDArray[np.int8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Steps = NDArray[np.int32]

#: Indices in the tally: `LAST` is the last one of :func:`~.dstar_kernels.repair`. Then follow the number of changed cells, cell of the
#: target or -1, number of decisions, cell of the vehicle if its last step causes no collision, and last action.
LAST, CHANGED, GOAL, TIME, EXPECTED, ACTION = range(2, 8)
#: Action that waits.
WAITS = 8


@kernel
def assess(
    cell: int,
    value: float,
    evidence: Floats,
    walls: Bytes,
    changed: Steps,
    marks: Bytes,
    tally: Ints,
) -> None:
    """Store the evidence of a cell, and list the cell if it becomes blocked or free."""
    evidence[cell] = value
    blocked = 1 if value > 0.0 else 0
    if walls[cell] != blocked:
        walls[cell] = blocked
        if marks[cell] == 0:
            marks[cell] = 1
            changed[tally[CHANGED]] = cell
            tally[CHANGED] += 1


@kernel
def note_view(
    corner: Ints,
    view: Floats,
    width: int,
    weights: Floats,
    evidence: Floats,
    walls: Bytes,
    stamps: Steps,
    changed: Steps,
    marks: Bytes,
    tally: Ints,
) -> None:
    """Add the readings of a view to the evidence, and note the target if the view shows it.

    `weights` are the evidence of a free and of a blocked reading, and the limit of the evidence. Certain cells stay.
    """
    rows = walls.size // width
    for i in range(max(-corner[0], 0), min(view.shape[0], rows - 2 - corner[0])):
        for j in range(max(-corner[1], 0), min(view.shape[1], width - 2 - corner[1])):
            reading, cell = view[i, j], (corner[0] + 1 + i) * width + corner[1] + 1 + j
            if reading == UNKNOWN:
                continue
            if reading == TARGET:
                tally[GOAL] = cell
            stamps[cell] = tally[TIME]
            if abs(evidence[cell]) < math.inf:
                gained = evidence[cell] + weights[1 if reading == BLOCKED else 0]
                gained = min(max(gained, -weights[2]), weights[2])
                assess(cell, gained, evidence, walls, changed, marks, tally)


@kernel
def expire(
    forget: int,
    start: int,
    target: int,
    evidence: Floats,
    walls: Bytes,
    stamps: Steps,
    changed: Steps,
    marks: Bytes,
    tally: Ints,
) -> None:
    """Forget the cells that were not seen for more than `forget` steps; `start` and `target` stay free."""
    for cell in range(len(stamps)):
        if 0 <= stamps[cell] < tally[TIME] - forget:
            value = -math.inf if cell in (start, target) else 0.0
            assess(cell, value, evidence, walls, changed, marks, tally)
            stamps[cell] = -1


@kernel
def lead(
    cell: int,
    walls: Bytes,
    width: int,
    moves: Ints,
    sides: int,
    repairs: bool,
    stamps: Steps,
    changed: Steps,
    marks: Bytes,
    tally: Ints,
    flag: Flag,
    g: Steps,
    rhs: Steps,
    heap: Ints,
    where: Steps,
    keys: Ints,
) -> int:
    """Return the first action of a shortest path to the target or to the nearest unseen cell, or :data:`STUCK`."""
    target = tally[GOAL]
    if target >= 0 and walls[target] != 0:  # an obstacle may be on the target
        return STUCK
    if repairs and target >= 0:
        count = tally[CHANGED]
        tally[CHANGED] = 0
        for k in range(count):
            marks[changed[k]] = 0
        if rhs[target] == FAR:  # the first search
            changed[count] = target
            count += 1
        repair(
            walls,
            width,
            cell,
            target,
            changed[:count],
            g,
            rhs,
            heap,
            where,
            keys,
            tally,
            flag,
            moves,
            sides,
        )
        return int(descend(walls, width, moves, sides, g, cell))
    if target >= 0 and len(moves) == 4:
        return int(
            descend(walls, width, moves, sides, search(walls, width, cell, target, flag), cell)
        )
    goals, count = np.empty(walls.size, np.int64), 0
    if target >= 0:
        goals[0], count = target, 1
    else:
        for other in range(walls.size):
            if stamps[other] < 0 and walls[other] == 0:
                goals[count] = other
                count += 1
    steps = spread(walls, width, moves, sides, goals[:count])
    return int(descend(walls, width, moves, sides, steps, cell))


@kernel(interpretable=True, in_place=True)
def plan(
    rows: Ints,
    cells: Ints,
    corners: Ints,
    views: Floats,
    width: int,
    moves: Ints,
    sides: int,
    rules: Ints,
    weights: Floats,
    ends: Ints,
    evidence: Floats,
    walls: Bytes,
    stamps: Steps,
    changed: Steps,
    marks: Bytes,
    tally: Ints,
    actions: Ints,
    flag: Flag,
    g: Steps,
    rhs: Steps,
    heap: Ints,
    where: Steps,
    keys: Ints,
) -> None:
    """Compute the `actions` of several scenes, :data:`STUCK` without a path.

    `rows` are the indices of the scenes in `ends` and in the arrays from `evidence` to `tally` and from `g` to `keys`.
    `cells`, `corners` and `views` are their observations. The `rules` are whether D* Lite repairs the previous search,
    whether obstacles move, whether readings are uncertain, whether cells come from images, and the number of steps after which
    a cell is forgotten, or -1. `weights` are those of :func:`note_view` and the evidence of a collision.
    """
    repairs, moving, uncertain, images = rules[0] != 0, rules[1] != 0, rules[2] != 0, rules[3] != 0
    forget = rules[4]
    for index in range(len(rows)):
        row, cell = rows[index], cells[index]
        known, wall, seen, state = evidence[row], walls[row], stamps[row], tally[row]
        listed, mark = changed[row], marks[row]
        old = row if repairs else 0
        expected, last, start, target = state[EXPECTED], state[ACTION], ends[row, 0], ends[row, 1]
        hit = cell != expected
        # The obstacle of a diagonal step may be beside it. A straight step tells.
        straight = hit and 4 <= last < WAITS and sides < 2
        if hit and not straight:
            assess(expected, weights[3], known, wall, listed, mark, state)
            seen[expected] = state[TIME]
        assess(cell, -weights[3], known, wall, listed, mark, state)
        seen[cell] = state[TIME]
        if forget >= 0 and images:  # no image changes cells that are certain
            expire(forget, start, target, known, wall, seen, listed, mark, state)
        note_view(
            corners[index], views[index], width, weights, known, wall, seen, listed, mark, state
        )
        if forget >= 0 and not images:
            expire(forget, -1, -1, known, wall, seen, listed, mark, state)
        allowed = moves[:4] if straight else moves
        action = STUCK
        for attempt in range(2):
            if attempt == 1:  # discard what is not certain
                for other in range(len(seen)):
                    if known[other] != 0.0 and abs(known[other]) < math.inf:
                        assess(other, 0.0, known, wall, listed, mark, state)
                if moving:
                    note_view(
                        corners[index],
                        views[index],
                        width,
                        weights,
                        known,
                        wall,
                        seen,
                        listed,
                        mark,
                        state,
                    )
            action = lead(
                cell,
                wall,
                width,
                allowed,
                sides,
                repairs and not straight,
                seen,
                listed,
                mark,
                state,
                flag,
                g[old],
                rhs[old],
                heap[old],
                where[old],
                keys[old],
            )
            if action != STUCK or not uncertain:
                break
        if action == STUCK and moving:
            action = WAITS
        actions[index] = state[ACTION] = action
        state[TIME] += 1
        if action != STUCK:
            state[EXPECTED] = cell if action == WAITS else cell + moves[action]
