"""Replanning in a batch of scenes: the evidence of cells, and the first action of a shortest path on the known map.

Maps and numbers of cells are those of :mod:`.dstar_kernels`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.unknown_grid.moving import FAR, Grid, descend, spread
from ...models.unknown_grid.world import BLOCKED, TARGET, UNKNOWN
from .dstar_kernels import STUCK, Search, repair, search

__all__ = ["ACTION", "EXPECTED", "GOAL", "LAST", "TIME", "WAITS", "Known", "Rules", "plan"]

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


class Rules(NamedTuple):
    """Properties of a policy and its model.

    `width`, `moves` and `sides` are those of a :class:`Grid`. The flags are whether D* Lite repairs the previous
    search, whether obstacles move, whether readings are uncertain and whether cells come from images. A cell is forgotten
    after `forget` steps, or never if it is -1. `weights` are the evidence of a free and of a blocked reading, the
    limit of the evidence, and the evidence of a collision.
    """

    width: int
    moves: Ints
    sides: int
    repairs: bool
    moving: bool
    uncertain: bool
    images: bool
    forget: int
    weights: Floats


class Known(NamedTuple):
    """Knowledge of a scene, or of several scenes along a first axis.

    `evidence` and `walls` are those of the cells, and `stamps` the numbers of decisions before they were last seen, -1
    for unseen cells. `changed` lists the cells blocked or freed since the last search, which `marks` marks.
    """

    evidence: Floats
    walls: Bytes
    stamps: Steps
    changed: Steps
    marks: Bytes
    tally: Ints


@kernel(allocates=False)
def assess(known: Known, cell: int, value: float) -> None:
    """Store the evidence of a cell, and list the cell if it becomes blocked or free."""
    known.evidence[cell] = value
    blocked = 1 if value > 0.0 else 0
    if known.walls[cell] != blocked:
        known.walls[cell] = blocked
        if known.marks[cell] == 0:
            known.marks[cell] = 1
            known.changed[known.tally[CHANGED]] = cell
            known.tally[CHANGED] += 1


@kernel(allocates=False)
def note_view(known: Known, corner: Ints, view: Floats, rules: Rules) -> None:
    """Add the readings of a view to the evidence, and note the target if the view shows it. Certain cells stay."""
    width, weights, tally = rules.width, rules.weights, known.tally
    rows = known.walls.size // width
    for i in range(max(-corner[0], 0), min(view.shape[0], rows - 2 - corner[0])):
        for j in range(max(-corner[1], 0), min(view.shape[1], width - 2 - corner[1])):
            reading, cell = view[i, j], (corner[0] + 1 + i) * width + corner[1] + 1 + j
            if reading == UNKNOWN:
                continue
            if reading == TARGET:
                tally[GOAL] = cell
            known.stamps[cell] = tally[TIME]
            if abs(known.evidence[cell]) < math.inf:
                gained = known.evidence[cell] + weights[1 if reading == BLOCKED else 0]
                assess(known, cell, min(max(gained, -weights[2]), weights[2]))


@kernel(allocates=False)
def expire(known: Known, forget: int, start: int, target: int) -> None:
    """Forget the cells that were not seen for more than `forget` steps; `start` and `target` stay free."""
    for cell in range(len(known.stamps)):
        if 0 <= known.stamps[cell] < known.tally[TIME] - forget:
            assess(known, cell, -math.inf if cell in (start, target) else 0.0)
            known.stamps[cell] = -1


@kernel
def lead(known: Known, grid: Grid, cell: int, repairs: bool, state: Search, flag: Flag) -> int:
    """Return the first action of a shortest path to the target or to the nearest unseen cell, or :data:`STUCK`."""
    walls, changed, tally = known.walls, known.changed, known.tally
    target = tally[GOAL]
    if target >= 0 and walls[target] != 0:  # an obstacle may be on the target
        return STUCK
    if repairs and target >= 0:
        count = tally[CHANGED]
        tally[CHANGED] = 0
        for k in range(count):
            known.marks[changed[k]] = 0
        if state.rhs[target] == FAR:  # the first search
            changed[count] = target
            count += 1
        repair(grid, cell, target, changed[:count], state, flag)
        return int(descend(grid, state.g, cell))
    if target >= 0 and len(grid.moves) == 4:
        return int(descend(grid, search(grid, cell, target, flag), cell))
    goals, count = np.empty(walls.size, np.int64), 0
    if target >= 0:
        goals[0], count = target, 1
    else:
        for other in range(walls.size):
            if known.stamps[other] < 0 and walls[other] == 0:
                goals[count] = other
                count += 1
    return int(descend(grid, spread(grid, goals[:count]), cell))


@kernel(interpretable=True, in_place=True)
def plan(
    rows: Ints, cells: Ints, corners: Ints, views: Floats, rules: Rules, ends: Ints, memory: Known,
    searches: Search, actions: Ints, flag: Flag,
) -> None:  # fmt: skip
    """Compute the `actions` of several scenes, :data:`STUCK` without a path.

    `rows` are the indices of the scenes in `ends`, `memory` and `searches`. `cells`, `corners` and `views` are their
    observations.
    """
    moves, certain = rules.moves, rules.weights[3]
    for index in range(len(rows)):
        row, cell, corner, view = rows[index], cells[index], corners[index], views[index]
        tally = memory.tally[row]
        known = Known(
            memory.evidence[row], memory.walls[row], memory.stamps[row], memory.changed[row],
            memory.marks[row], tally,
        )  # fmt: skip
        old = row if rules.repairs else 0
        state = Search(
            searches.g[old], searches.rhs[old], searches.heap[old], searches.where[old],
            searches.keys[old], tally,
        )  # fmt: skip
        expected, last, start, target = tally[EXPECTED], tally[ACTION], ends[row, 0], ends[row, 1]
        hit = cell != expected
        # The obstacle of a diagonal step may be beside it. A straight step tells.
        straight = hit and 4 <= last < WAITS and rules.sides < 2
        if hit and not straight:
            assess(known, expected, certain)
            known.stamps[expected] = tally[TIME]
        assess(known, cell, -certain)
        known.stamps[cell] = tally[TIME]
        if rules.forget >= 0 and rules.images:  # no image changes cells that are certain
            expire(known, rules.forget, start, target)
        note_view(known, corner, view, rules)
        if rules.forget >= 0 and not rules.images:
            expire(known, rules.forget, -1, -1)
        grid = Grid(known.walls, rules.width, moves[:4] if straight else moves, rules.sides)
        action = STUCK
        for attempt in range(2):
            if attempt == 1:  # discard what is not certain
                for other in range(len(known.stamps)):
                    if known.evidence[other] != 0.0 and abs(known.evidence[other]) < math.inf:
                        assess(known, other, 0.0)
                if rules.moving:
                    note_view(known, corner, view, rules)
            action = lead(known, grid, cell, rules.repairs and not straight, state, flag)
            if action != STUCK or not rules.uncertain:
                break
        if action == STUCK and rules.moving:
            action = WAITS
        actions[index] = tally[ACTION] = action
        tally[TIME] += 1
        if action != STUCK:
            tally[EXPECTED] = cell if action == WAITS else cell + moves[action]
