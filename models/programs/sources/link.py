"""Links from programs to the objects of other libraries from which they were made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Source"]

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Source:
    """Object from which a program was made.

    Parameters
    ----------
    origin : object
        The object, such as a ``cvxpy.Problem``.
    values : callable
        Function from a column vector to the values of the object's variables by name.
    assign : callable, optional
        Function ``(plan, duals, objective)`` that sets the values of the object's variables and
        multipliers. `plan` is the column vector, `duals` the row multipliers or None, and `objective` the
        objective in the sense of the object. None if the object stores no values.
    """

    origin: Any
    values: Callable[[Vector], Mapping[str, Any]]
    assign: Callable[[Vector, Vector | None, float], None] | None = None
