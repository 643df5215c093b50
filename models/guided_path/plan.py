"""Plan of a guided vehicle's tour: the order of service."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..fields import Array, show

__all__ = ["GuidedPathPlan"]


@dataclass(frozen=True)
class GuidedPathPlan:
    """Order of service of the customers, from the start and back to it.

    Parameters
    ----------
    order : tuple of int
        The customers 1 … n, each once, without the start.

    Raises
    ------
    InvalidData
        `order` is not a sequence of integers.
    """

    order: tuple[int, ...]

    def __post_init__(self) -> None:
        order = Array(("n",), int).coerce("order", self.order, {})
        object.__setattr__(self, "order", tuple(order.tolist()))

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"order": list(self.order)}

    @classmethod
    def from_data(cls, data: Any) -> GuidedPathPlan:
        """Return the plan that :meth:`to_data` wrote; raise ``InvalidData`` if the data is malformed."""
        if not isinstance(data, Mapping) or set(data) != {"order"}:
            raise InvalidData(
                f"a plan must be an object with the key order, got {show(data)}", field="plan"
            )
        return cls(data["order"])

    def __str__(self) -> str:
        return "-".join(map(str, (0, *self.order, 0)))
