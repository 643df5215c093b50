"""What vehicles did on unknown grids: one run a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ...errors import InvalidData
from ..fields import show

__all__ = ["ACTIONS", "STEPS", "NavigationRuns", "Outcome"]

#: The letters of the actions up, down, left and right, in the order of their numbers 0 … 3.
ACTIONS = "UDLR"
#: The change of row and column by each action.
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))


class Outcome(StrEnum):
    """How a run ended."""

    REACHED = "reached"  #: at the target
    NO_WAY = "no way"  #: the policy says that the target cannot be reached; it is checked
    GAVE_UP = "gave up"  #: the policy had no further action, or was stopped
    OUT_OF_STEPS = "out of steps"  #: the steps were used up before


@dataclass(frozen=True)
class NavigationRuns:
    """The actions of a policy in every scene.

    Parameters
    ----------
    actions : tuple of str
        One a scene: the letters U, D, L, R for up (to the row before), down, left (to the column
        before) and right. A step into an obstacle or off the map leaves the vehicle where it is.
    outcomes : tuple of Outcome
        How each run ended.

    Raises
    ------
    InvalidData
        Other letters, unknown outcomes, or lists of different lengths.
    """

    actions: tuple[str, ...]
    outcomes: tuple[Outcome, ...]

    def __post_init__(self) -> None:
        for name, given in (("actions", self.actions), ("outcomes", self.outcomes)):
            if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
                raise InvalidData(
                    f"{name} must be a list with an entry a scene, got {show(given)}", field=name
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
                f"outcomes has {len(self.outcomes)} entries where actions has {len(self.actions)}",
                field="outcomes",
            )
        object.__setattr__(self, "actions", tuple(self.actions))
        object.__setattr__(self, "outcomes", tuple(map(Outcome, self.outcomes)))

    @property
    def success(self) -> float:
        """The share of scenes whose target was reached, percent."""
        reached = sum(one is Outcome.REACHED for one in self.outcomes)
        return 100.0 * reached / max(len(self.outcomes), 1)

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"actions": list(self.actions), "outcomes": [str(one) for one in self.outcomes]}

    @classmethod
    def from_data(cls, data: Any) -> NavigationRuns:
        """Return the plan that :meth:`to_data` wrote; bad data raises ``InvalidData``."""
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
            shown = run if len(run) <= 60 else f"{run[:60]}…"
            return (
                f"{self.outcomes[0]} after {len(run)} steps: {shown}" if run else self.outcomes[0]
            )
        counts = {one: self.outcomes.count(one) for one in Outcome}
        words = ", ".join(f"{one} {count}" for one, count in counts.items() if count)
        return f"{len(self)} scenes: {words}"
