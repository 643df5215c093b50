"""Covariance of estimated parameters, from the residuals of measurements at the optimum.

For residuals r with independent errors of equal variance, the least-squares estimate has to first order
the covariance σ² (Jᵀ J)⁻¹ with the derivatives J of the residuals along the directions that the
equations leave. It is a block of the inverse of the KKT matrix with the Gauss-Newton term Jᵀ J (Bock,
Kostina and Schlöder, "Numerical methods for parameter estimation in nonlinear differential algebraic
equations", GAMM-Mitteilungen 30, 2007, section 4).
"""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from ...errors import InvalidData, show
from ..estimates import Estimate
from ..programs.nonlinear import NonlinearProgram
from .declaration.problem import ControlProblemBuilder
from .declaration.terms import column, compile_function
from .plan import ControlPlan
from .transcription.methods import Gauss

__all__ = ["Estimate", "covariance"]

Floats = NDArray[np.float64]

#: Distance from a bound at which it is active, relative to the size of the bounded quantity.
ACTIVE = 1e-6
#: Largest error of a solution of the KKT system, whose right-hand side has the size 1.
SOLVED = 1e-6


class _Declared(Gauss):
    """Gauss collocation of the problem as declared: rows of an epigraph form would be active constraints."""

    _epigraph = None


def covariance(problem: Any, plan: ControlPlan, residuals: Any) -> Estimate:
    """Return the parameters of a least-squares estimate with their covariance.

    The assumptions are: the objective was the sum of the squared residuals; their errors are
    independent with mean 0 and the same variance, which is estimated from them; and the problem is
    nearly linear within the uncertainty (Gauss-Newton: second derivatives of the residuals are
    omitted). Divide residuals of different accuracy by their standard deviations.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem as declared, with its symbols.
    plan : ControlPlan
        Optimal plan, as in ``solution.plan``.
    residuals : casadi expression, or sequence of them
        Residuals, such as ``[phase.at(t, x) - y for t, y in data]``, in values at instants and ends,
        integrals, times and parameters.

    Returns
    -------
    Estimate
        Estimates, their covariance and the variance of the measurements.

    Raises
    ------
    InvalidData
        The problem has no symbols or no parameters, the residuals are fewer than the estimated
        quantities or do not determine them, or the plan does not fit the problem.
    """
    if not isinstance(problem, ControlProblemBuilder):
        raise InvalidData(
            "problem must be declared in this process, because residuals are expressions of its "
            f"symbols, got {show(problem)}",
            field="problem",
        )
    expressions = column("residuals", residuals)
    model = problem.build()
    model.attach(plan)
    arguments = {
        "e": problem.end_symbols(),
        "p": [symbol for _, symbol in problem.parameters.values()],
    }
    function = compile_function(
        "residuals", arguments, {"residual": [expressions]}, problem.explain
    )
    transcription = _Declared(model, refine=False).fitted(plan)
    program, layout = transcription.program, transcription.layout
    assert isinstance(program, NonlinearProgram)
    point = transcription.encode(plan)
    columns = layout.end_columns
    ends = point[columns[: function.size1_in(0)]], point[layout.parameter_columns]
    values = function(*ends).full()[:, 0]
    tables = function.factory("slope", ["e", "p"], ["jac:residual:e", "jac:residual:p"])(*ends)
    table = casadi.horzcat(*tables)
    slopes = sp.coo_array(sp.csc_array(table.sparse()))
    shape = (values.size, program.size)
    slopes = sp.csc_array((slopes.data, (slopes.row, columns[slopes.col])), shape=shape)
    free, active = _active(program, point)
    rows = sp.csr_array(sp.csc_array(program.first_order(point)[1].sparse()))[active][:, free]
    scale = sp.diags_array(program.column_scale[free])
    rows = sp.diags_array(1.0 / program.row_scale[active]) @ rows @ scale
    names = layout.definition.parameter_names
    marks = [np.full(item.size, not item.given) for item in layout.definition.parameters]
    chosen = np.flatnonzero(np.concatenate([*marks, np.zeros(0, bool)]))
    if not chosen.size:
        raise InvalidData("problem must have parameters to estimate, got none", field="problem")
    freedom = values.size - (free.size - active.size)
    if freedom < 1:
        raise InvalidData(
            f"residuals must be more than the {free.size - active.size} estimated quantities, got "
            f"{values.size}",
            field="residuals",
        )
    places = layout.parameter_columns[chosen]
    inside = np.isin(places, free)
    wanted = np.searchsorted(free, places[inside])
    block = np.zeros((places.size, places.size))
    block[np.ix_(inside, inside)] = _inverse(slopes[:, free] @ scale, rows, wanted)
    sizes = program.column_scale[places]
    variance = float(values @ values) / freedom
    return Estimate(
        names=tuple(names[k] for k in chosen), values=point[places],
        covariance=variance * block * np.outer(sizes, sizes), variance=variance, freedom=freedom,
    )  # fmt: skip


def _active(program: NonlinearProgram, point: Floats) -> tuple[Any, Any]:
    """Return the columns that are not at a bound, and the rows that are equations or at a bound."""
    values = np.array(program.function(point)[1], float).reshape(-1)
    results = []
    for what, value, scale in (
        ("column", point, program.column_scale), ("row", values, program.row_scale)
    ):  # fmt: skip
        low, high = getattr(program, f"{what}_lower"), getattr(program, f"{what}_upper")
        with np.errstate(invalid="ignore"):
            near = np.minimum(value - low, high - value) <= ACTIVE * scale
        results.append(near | (low == high))
    return np.flatnonzero(~results[0]), np.flatnonzero(results[1])


def _inverse(slopes: Any, rows: Any, wanted: Any) -> Floats:
    """Return the block of the wanted columns in the inverse KKT matrix, or raise if it is singular."""
    norm = float(np.abs(slopes.data).max(initial=0.0)) or 1.0
    slopes = slopes / norm
    # With s = J z as further unknowns, J is not squared, and the matrix stays sparse.
    one = sp.eye_array(slopes.shape[0])
    matrix = sp.block_array(
        [[None, slopes.T, rows.T], [slopes, -one, None], [rows, None, None]], format="csc"
    )
    right = np.zeros((matrix.shape[0], wanted.size))
    right[wanted, np.arange(wanted.size)] = 1.0
    try:
        solution = splu(matrix).solve(right)
    except RuntimeError:  # exactly singular
        solution = np.full_like(right, np.nan)
    block = 0.5 * (solution[wanted] + solution[wanted].T)
    # The rounding errors of a nearly singular matrix are as large as its solution.
    off = np.abs(matrix @ solution - right).max(initial=0.0)
    regular = off <= SOLVED and np.abs(solution).max(initial=0.0) * np.finfo(float).eps < SOLVED
    if not (regular and (np.diag(block) >= 0.0).all()):
        raise InvalidData(
            "residuals do not determine all parameters, free initial states and controls: their "
            "derivatives are linearly dependent",
            field="residuals",
        )
    result: Floats = block / norm**2
    return result
