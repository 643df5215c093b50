"""Links from programs to the objects of other libraries that were converted to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["Source", "named_values"]

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Source:
    """Object that was converted to a program.

    `origin` is the object, and `values` returns the values of its variables by name for a column vector.
    `assign(plan, duals, objective, termination)` sets the values of its variables and multipliers; it is None if
    the object stores no values. `duals` are the row multipliers or None, `objective` is in the sense of the
    object, and `termination` is the status, such as ``"optimal"``. If `ends`, `assign` also stores that the
    program is infeasible or unbounded, with None for the other arguments.
    """

    origin: Any
    values: Callable[[Vector], Mapping[str, Any]]
    assign: Callable[..., None] | None = None
    ends: bool = False


def named_values(values: Mapping[str, Any], *, by_size: bool = True) -> list[tuple[str, Any]]:
    """Return names such as ``"x[1, 2]"`` and numbers of :meth:`.Program.values_of`; complex ones are texts."""
    result: list[tuple[str, Any]] = []
    for name, value in values.items():
        array = np.asarray(value.toarray() if sp.issparse(value) else value)
        for place, entry in zip(np.ndindex(array.shape), array.ravel().tolist(), strict=True):
            result.append((f"{name}[{', '.join(map(str, place))}]" if place else name, entry))
    if by_size:
        result.sort(key=lambda item: -abs(item[1]))
    return [
        (name, str(entry) if isinstance(entry, complex) and entry else entry)
        for name, entry in result
    ]
