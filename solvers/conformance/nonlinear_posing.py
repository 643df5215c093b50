"""Tools to state the nonlinear conformance cases: programs from expressions, and expectations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Termination
from .cases import Expectation, bounds

__all__ = ["ENDS", "known", "nonlinear"]

#: Terminations of a search that finds a local optimum; a global solver proves it optimal.
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
    """Return the program with the objective and rows that `pose` returns for symbols x.

    Parameters
    ----------
    pose : callable
        Function ``x -> (objective, rows)`` on CasADi symbols.
    guess : array_like, shape (columns,)
        Initial point.
    row_lower, row_upper, lower, upper : array_like
        Bounds of rows and columns; a scalar applies to all.
    **fields
        Further fields of the program.
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
    """Return the expectation for a known optimum that a local search must find.

    Parameters
    ----------
    objective : float
        Optimal objective.
    point, duals : tuple of float, optional
        Optimal point and multipliers, if they are unique.
    slack : float
        Relative slack of comparisons with `objective`.
    """
    return Expectation(ENDS, objective, point=point, duals=duals, slack=slack)
