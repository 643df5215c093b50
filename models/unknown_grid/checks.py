"""Verification of runs: replay each run cell by cell on the true map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .moving import obstacle_tracks
from .plan import NavigationRuns, Outcome
from .scenes import Corners, Scenes

__all__ = ["Replay", "has_way", "replay", "verify_runs"]

Truths = NDArray[np.bool_]

#: Change of row and column per letter.
_MOVES = {
    "U": (-1, 0), "D": (1, 0), "L": (0, -1), "R": (0, 1), "W": (0, 0),
    "Q": (-1, -1), "E": (-1, 1), "Z": (1, -1), "C": (1, 1),
}  # fmt: skip


class Replay(NamedTuple):
    """Replay of a run of n actions on the true map.

    `positions`, shape (n + 1, 2), are the row and column before and after each action, and `collided`,
    shape (n,), marks the actions that led into an obstacle or off the map.
    """

    positions: NDArray[np.int64]
    collided: Truths


def replay(
    blocked: Truths,
    start: tuple[int, int],
    actions: str,
    corners: Corners = Corners.FREE,
    tracks: NDArray[np.int64] | None = None,
) -> Replay:
    """Return the positions and collisions that `actions` cause on a map, true if blocked.

    `tracks`, shape (m, n, 2), are the cells of the moving obstacles after 0 … n - 1 actions.
    """
    rows, columns = blocked.shape

    def is_wall(r: int, c: int) -> bool:
        return not (0 <= r < rows and 0 <= c < columns) or bool(blocked[r, c])

    row, column = start
    positions, collided = [(row, column)], []
    others: list[list[tuple[int, int]]] = (
        [] if tracks is None else tracks[:, : len(actions) + 1].tolist()
    )
    for step, letter in enumerate(actions, start=1):
        down, across = _MOVES[letter]
        next_row, next_column = row + down, column + across
        hit = is_wall(next_row, next_column)
        if down and across:
            sides = is_wall(next_row, column) + is_wall(row, next_column)
            hit = hit or sides > {Corners.FREE: 0, Corners.ONE: 1, Corners.ANY: 2}[corners]
        # The obstacles stop at the end of their tracks if a run has too many actions, which is a violation.
        moved = [
            (track[min(step, len(track)) - 1], track[min(step, len(track) - 1)]) for track in others
        ]
        for (r, c), (new_r, new_c) in moved:
            same_end = (new_r, new_c) == (next_row, next_column)
            same_middle = (r + new_r, c + new_c) == (row + next_row, column + next_column)
            hit = hit or same_end or same_middle
        if not hit:
            row, column = next_row, next_column
        collided.append(hit)
        positions.append((row, column))
    return Replay(np.array(positions, np.int64), np.array(collided, bool))


def has_way(
    blocked: Truths,
    start: tuple[int, int],
    target: tuple[int, int],
    corners: Corners = Corners.FREE,
) -> bool:
    """Return whether a path over free cells of a map, true if blocked, connects two free cells.

    A diagonal step past a free cell can be replaced by two others, so only corners ``"any"`` add paths.
    """
    from scipy.ndimage import label

    parts, _ = label(~blocked, np.ones((3, 3)) if corners is Corners.ANY else None)
    return bool(parts[start] == parts[target])


def verify_runs(model: Scenes, plan: NavigationRuns, tolerance: float) -> Verification:
    """Return the mean cost of the runs in steps, and one check per kind of outcome.

    The cost of a run is its number of steps if it reached the target, or if its outcome is
    ``NO_WAY`` and no path exists. Otherwise it is the limit on the steps plus 1.
    """
    costs: list[int] = []
    wrong: dict[Outcome, list[str]] = {outcome: [] for outcome in Outcome}
    wrong[Outcome.OUT_OF_STEPS] = wrong[Outcome.GAVE_UP]
    overrun: list[str] = []
    longest, at_longest = 0, 0
    tracks = obstacle_tracks(model)
    for k, (actions, outcome) in enumerate(zip(plan.actions, plan.outcomes, strict=True)):
        start, target = tuple(model.starts[k].tolist()), tuple(model.targets[k].tolist())
        run = replay(model.blocked[k], start, actions, model.corners, tracks[k])
        there = (run.positions == model.targets[k]).all(axis=1)
        reached = bool(there[-1])
        if there[:-1].any():
            overrun.append(f"scene {k}")
        if len(actions) > longest:
            longest, at_longest = len(actions), k
        valid = {
            Outcome.REACHED: reached,
            Outcome.NO_WAY: not reached
            and not has_way(model.blocked[k], start, target, model.corners),
            Outcome.GAVE_UP: not reached,
            Outcome.OUT_OF_STEPS: not reached and len(actions) >= model.steps,
        }[outcome]
        if not valid:
            wrong[outcome].append(f"scene {k}")
        done = valid and outcome in (Outcome.REACHED, Outcome.NO_WAY)
        costs.append(len(actions) if done else model.steps + 1)

    over = [f"scene {at_longest}"] * max(longest - model.steps, 0)
    checks = (
        Check.count("at most as many steps as allowed", over),
        Check.count("a run ends at the target", overrun),
        Check.count("the target is where the run ends", wrong[Outcome.REACHED]),
        Check.count("there is no way", wrong[Outcome.NO_WAY]),
        Check.count("the target was not reached", wrong[Outcome.GAVE_UP]),
    )
    return Verification(float(np.mean(costs)), checks)
