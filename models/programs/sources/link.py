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

    Parameters
    ----------
    origin : object
        The object, such as a ``cvxpy.Problem``.
    values : callable
        Function from a column vector to the values of the object's variables by name.
    assign : callable, optional
        Function ``(plan, duals, objective, termination)`` that sets the values of the object's variables
        and multipliers. `plan` is the column vector, `duals` the row multipliers or None, `objective` the
        objective in the sense of the object, and `termination` the status, such as ``"optimal"``. None
        if the object stores no values.
    ends : bool
        Whether `assign` also stores that the program is infeasible or unbounded, with None for `plan`,
        `duals` and `objective`. False by default.
    """

    origin: Any
    values: Callable[[Vector], Mapping[str, Any]]
    assign: Callable[..., None] | None = None
    ends: bool = False


def named_values(values: Mapping[str, Any], *, by_size: bool = True) -> list[tuple[str, Any]]:
    """Return the numbers in the result of :meth:`.Program.values_of`.

    Parameters
    ----------
    values : mapping
        Numbers and arrays by name.
    by_size : bool
        Whether the largest magnitudes come first; otherwise in the order of the variables.

    Returns
    -------
    list of (str, float)
        Names such as ``"x[1, 2]"`` for the entries of arrays, with the values; complex numbers are
        texts.
    """
    result: list[tuple[str, Any, float]] = []
    for name, value in values.items():
        array = np.asarray(value.toarray() if sp.issparse(value) else value)
        for place, entry in zip(np.ndindex(array.shape), array.ravel().tolist(), strict=True):
            label = f"{name}[{', '.join(map(str, place))}]" if place else name
            shown = str(entry) if isinstance(entry, complex) and entry else entry
            result.append((label, shown, abs(entry)))
    if by_size:
        result.sort(key=lambda item: -item[2])
    return [(name, value) for name, value, _ in result]
