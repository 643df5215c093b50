"""Plans of unknown grids: one run per scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ...errors import InvalidData
from ..fields import show

__all__ = ["ACTIONS", "STEPS", "NavigationRuns", "Outcome"]

#: Letters of the actions up, down, left and right, in the order of their numbers 0 … 3.
ACTIONS = "UDLR"
#: Change of row and column per action.
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))


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


@dataclass(frozen=True)
class NavigationRuns:
    """Actions of a policy in every scene.

    Parameters
    ----------
    actions : tuple of str
        One string per scene with the letters U (previous row), D (next row), L (previous column) and
        R (next column). The vehicle does not move if a step leads into an obstacle or off the map.
    outcomes : tuple of Outcome
        End of each run.

    Raises
    ------
    InvalidData
        A letter or an outcome is unknown, or the lengths of the lists differ.
    """

    actions: tuple[str, ...]
    outcomes: tuple[Outcome, ...]

    def __post_init__(self) -> None:
        for name, value in (("actions", self.actions), ("outcomes", self.outcomes)):
            if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
                raise InvalidData(
                    f"{name} must be a list with one entry per scene, got {show(value)}", field=name
                )
        for k, run in enumerate(self.actions):
            if not isinstance(run, str) or run.strip(ACTIONS):
                raise InvalidData(
                    f"actions[{k}] must be a string of the letters U, D, L, R, got {show(run)}",
                    field="actions",
                )
        for k, word in enumerate(self.outcomes):
            if not isinstance(word, str) or word not in tuple(Outcome):
                raise InvalidData(
                    f"outcomes[{k}] must be one of {', '.join(Outcome)}, got {show(word)}",
                    field="outcomes",
                )
        if len(self.actions) != len(self.outcomes):
            raise InvalidData(
                f"outcomes must have {len(self.actions)} entries, as actions, got {len(self.outcomes)}",
                field="outcomes",
            )
        object.__setattr__(self, "actions", tuple(self.actions))
        object.__setattr__(self, "outcomes", tuple(map(Outcome, self.outcomes)))

    @property
    def success(self) -> float:
        """Share of the scenes whose target was reached, percent."""
        reached = sum(outcome is Outcome.REACHED for outcome in self.outcomes)
        return 100.0 * reached / max(len(self.outcomes), 1)

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {
            "actions": list(self.actions),
            "outcomes": [str(outcome) for outcome in self.outcomes],
        }

    @classmethod
    def from_data(cls, data: Any) -> NavigationRuns:
        """Return the plan from the data of :meth:`to_data`.

        Raises
        ------
        InvalidData
            The data is not an object with the keys ``actions`` and ``outcomes``, or a value is invalid.
        """
        if not isinstance(data, Mapping) or set(data) != {"actions", "outcomes"}:
            raise InvalidData(
                f"a plan must be an object with the keys actions and outcomes, got {show(data)}",
                field="plan",
            )
        return cls(data["actions"], data["outcomes"])

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
