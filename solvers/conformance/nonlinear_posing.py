"""How the nonlinear conformance cases are written down: expressions of columns, and what is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Termination
from .cases import Expectation

__all__ = ["ENDS", "known", "nonlinear"]

#: How a search that finds a local optimum may end; a global solver proves it the best.
ENDS = (Termination.LOCALLY_OPTIMAL, Termination.OPTIMAL)


def nonlinear(
    pose: Callable[[Any], tuple[Any, Sequence[Any]]],
    guess: ArrayLike,
    row_lower: ArrayLike = -np.inf,
    row_upper: ArrayLike = np.inf,
    *,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    **fields: Any,
) -> NonlinearProgram:
    """Return the program that `pose` states: it gives the objective and the rows of symbols x.

    Bounds given once count for all; `fields` are further ones of the program.
    """
    import casadi

    start = np.asarray(guess, float)
    x = casadi.SX.sym("x", start.size)
    objective, rows = pose(x)
    symbols = casadi.vertcat(*rows) if len(rows) else casadi.SX(0, 1)
    count = int(symbols.numel())

    def full(value: ArrayLike, size: int) -> NDArray[np.float64]:
        return np.broadcast_to(np.asarray(value, float), (size,)).copy()

    return NonlinearProgram(
        function=casadi.Function(
            "program", [x], [casadi.densify(objective), casadi.densify(symbols)], ["x"], ["f", "g"]
        ),
        row_lower=full(row_lower, count),
        row_upper=full(row_upper, count),
        column_lower=full(lower, start.size),
        column_upper=full(upper, start.size),
        guess=start,
        **fields,
    )


def known(
    objective: float,
    point: tuple[float, ...] | None = None,
    duals: tuple[float, ...] | None = None,
    slack: float = 1e-6,
) -> Expectation:
    """Return what is expected where one local optimum is known, the best there is."""
    return Expectation(ENDS, objective, point=point, duals=duals, slack=slack)
