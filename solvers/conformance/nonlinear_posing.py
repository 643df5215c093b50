"""How the nonlinear conformance cases are written down: expressions of columns, and what is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Termination
from .cases import Expectation, bounds

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
    return NonlinearProgram(
        function=casadi.Function(
            "program", [x], [casadi.densify(objective), casadi.densify(symbols)], ["x"], ["f", "g"]
        ),
        **bounds(int(symbols.numel()), start.size, row_lower, row_upper, lower, upper),
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
