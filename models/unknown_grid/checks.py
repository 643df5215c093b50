"""Verification of runs: replay each run cell by cell on the true map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..verification import Check, Verification
from .plan import NavigationRuns, Outcome
from .scenes import Scenes

__all__ = ["Replay", "has_way", "replay", "verify_runs"]

Truths = NDArray[np.bool_]

#: Change of row and column per letter.
_MOVES = {"U": (-1, 0), "D": (1, 0), "L": (0, -1), "R": (0, 1)}


class Replay(NamedTuple):
    """Replay of a run of n actions on the true map.

    `positions`, shape (n + 1, 2), are the row and column before and after each action, and `collided`,
    shape (n,), marks the actions that led into an obstacle or off the map.
    """

    positions: NDArray[np.int64]
    collided: Truths


def replay(blocked: Truths, start: tuple[int, int], actions: str) -> Replay:
    """Return the positions and collisions that `actions` (letters U, D, L, R) cause on a map, true if blocked."""
    rows, columns = blocked.shape
    row, column = start
    positions, collided = [(row, column)], []
    for letter in actions:
        down, across = _MOVES[letter]
        next_row, next_column = row + down, column + across
        hit = not (0 <= next_row < rows and 0 <= next_column < columns) or bool(
            blocked[next_row, next_column]
        )
        if not hit:
            row, column = next_row, next_column
        collided.append(hit)
        positions.append((row, column))
    return Replay(np.array(positions, np.int64), np.array(collided, bool))


def has_way(blocked: Truths, start: tuple[int, int], target: tuple[int, int]) -> bool:
    """Return whether a path over free cells of a map, true if blocked, connects two free cells."""
    from scipy.ndimage import label

    parts, _ = label(~blocked)
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
    for k, (actions, outcome) in enumerate(zip(plan.actions, plan.outcomes, strict=True)):
        start, target = tuple(model.starts[k].tolist()), tuple(model.targets[k].tolist())
        run = replay(model.blocked[k], start, actions)
        there = (run.positions == model.targets[k]).all(axis=1)
        reached = bool(there[-1])
        if there[:-1].any():
            overrun.append(f"scene {k}")
        if len(actions) > longest:
            longest, at_longest = len(actions), k
        valid = {
            Outcome.REACHED: reached,
            Outcome.NO_WAY: not reached and not has_way(model.blocked[k], start, target),
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
