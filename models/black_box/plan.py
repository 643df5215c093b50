"""Plan of a black box: a point, or the points of a front."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import NumberTuple, Optional, declared, show
from ..records import Several

__all__ = ["BlackBoxPoint"]


@dataclass(frozen=True, eq=False)
class BlackBoxPoint(Plan):
    """Point at which the function is evaluated, and the front of a model with several objectives.

    Parameters
    ----------
    x : tuple of float
        Value of each variable. With a front, one of its points: a compromise between the objectives.
    front : tuple of tuple of float, optional
        Points that do not dominate one another; None for one objective.

    Raises
    ------
    InvalidData
        The front is empty, or its points have another number of variables than `x`.
    """

    x: tuple[float, ...] = declared(NumberTuple(("d",)))
    front: tuple[tuple[float, ...], ...] | None = declared(
        Optional(Several(NumberTuple(("d",)))), default=None, added=True
    )

    def check(self) -> None:
        """Raise if the front is empty or has points of another dimension."""
        if self.front is None:
            return
        if not self.front:
            raise InvalidData("front must hold at least one point, got []", field="front")
        for k, point in enumerate(self.front):
            if len(point) != len(self.x):
                raise InvalidData(
                    f"front[{k}] must have {len(self.x)} entries as x, got {show(list(point))}",
                    field="front",
                )

    def __str__(self) -> str:
        shown = ", ".join(f"{value:.6g}" for value in self.x[:6])
        rest = f", … ({len(self.x)} in all)" if len(self.x) > 6 else ""
        front = f", one of a front of {len(self.front)}" if self.front else ""
        return f"({shown}{rest}){front}"
