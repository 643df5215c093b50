"""Plan of a black box: a point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..fields import Array, show

__all__ = ["BlackBoxPoint"]


@dataclass(frozen=True)
class BlackBoxPoint:
    """Point at which the function is evaluated.

    Parameters
    ----------
    x : tuple of float
        Value of each variable.
    """

    x: tuple[float, ...]

    def __post_init__(self) -> None:
        point = Array(("d",)).coerce("x", self.x, {})
        object.__setattr__(self, "x", tuple(point.tolist()))

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"x": list(self.x)}

    @classmethod
    def from_data(cls, data: Any) -> BlackBoxPoint:
        """Return the plan that :meth:`to_data` wrote; invalid data raise ``InvalidData``."""
        if not isinstance(data, Mapping) or set(data) != {"x"}:
            raise InvalidData(
                f"a plan must be an object with the key x, got {show(data)}", field="plan"
            )
        return cls(data["x"])

    def __str__(self) -> str:
        shown = ", ".join(f"{value:.6g}" for value in self.x[:6])
        rest = f", … ({len(self.x)} in all)" if len(self.x) > 6 else ""
        return f"({shown}{rest})"
