"""Plans of unknown grids: one run per scene."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import Spec, declared, show
from ..records import Member, Several

__all__ = ["ACTIONS", "LETTERS", "MOVES", "STEPS", "WAIT", "NavigationRuns", "Outcome"]

#: Letters of the actions up, down, left and right, in the order of their numbers 0 … 3.
ACTIONS = "UDLR"
#: Change of row and column per action.
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))
#: The same of all actions: 4 … 7 are the diagonals, with the letters around S on a keyboard, and 8 waits.
LETTERS = ACTIONS + "QEZCW"
MOVES = (*STEPS, (-1, -1), (-1, 1), (1, -1), (1, 1), (0, 0))
#: Number of the action that waits.
WAIT = 8


class Outcome(StrEnum):
    """End of a run."""

    REACHED = "reached"  #: The run ends at the target. Its cost is its number of steps.
    #: The policy claims that no path exists. If the check on the true map confirms it, the cost is
    #: the number of steps; otherwise the plan is invalid.
    NO_WAY = "no way"
    #: The policy had no further action, or was stopped. The cost is the limit on the steps plus 1.
    GAVE_UP = "gave up"
    #: All steps were used before the target was reached. The cost is the limit on the steps plus 1.
    OUT_OF_STEPS = "out of steps"


class _Actions(Spec):
    """String of the letters of the actions."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str:
        if not isinstance(value, str) or value.strip(LETTERS):
            raise InvalidData(
                f"{name} must be a string of the letters {', '.join(LETTERS)}, got {show(value)}",
                field=name,
            )
        return value


@dataclass(frozen=True, eq=False)
class NavigationRuns(Plan):
    """Actions of a policy in every scene.

    Parameters
    ----------
    actions : tuple of str
        One string per scene with the letters U (previous row), D (next row), L (previous column) and
        R (next column). With eight neighbours, Q, E, Z and C are the diagonals UL, UR, DL and DR. With moving
        obstacles, W waits. The vehicle does not move if a step leads into an obstacle or off the map.
    outcomes : tuple of Outcome
        End of each run.

    Raises
    ------
    InvalidData
        A letter or an outcome is unknown, or the lengths of the lists differ.
    """

    actions: tuple[str, ...] = declared(Several(_Actions(), "scenes"))
    outcomes: tuple[Outcome, ...] = declared(Several(Member(Outcome), "scenes"))

    @property
    def success(self) -> float:
        """Share of the scenes whose target was reached, percent."""
        reached = sum(outcome is Outcome.REACHED for outcome in self.outcomes)
        return 100.0 * reached / max(len(self.outcomes), 1)

    def __len__(self) -> int:
        return len(self.actions)

    def __str__(self) -> str:
        if len(self) == 1:
            run = self.actions[0]
            letters = run if len(run) <= 60 else f"{run[:60]}…"
            return (
                f"{self.outcomes[0]} after {len(run)} steps: {letters}" if run else self.outcomes[0]
            )
        counts = {outcome: self.outcomes.count(outcome) for outcome in Outcome}
        words = ", ".join(f"{outcome} {count}" for outcome, count in counts.items() if count)
        return f"{len(self)} scenes: {words}"
