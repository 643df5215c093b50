"""Plan of a black box: a point."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, declared

__all__ = ["BlackBoxPoint"]


@dataclass(frozen=True, eq=False)
class BlackBoxPoint(Plan):
    """Point at which the function is evaluated.

    Parameters
    ----------
    x : tuple of float
        Value of each variable.
    """

    x: tuple[float, ...] = declared(NumberTuple(("d",)))

    def __str__(self) -> str:
        shown = ", ".join(f"{value:.6g}" for value in self.x[:6])
        rest = f", … ({len(self.x)} in all)" if len(self.x) > 6 else ""
        return f"({shown}{rest})"
