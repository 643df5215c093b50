"""Verification of plans of black boxes by new evaluations of the function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..verification import Check, Verification
from .fronts import hypervolume, non_dominated
from .plan import BlackBoxPoint

__all__ = ["verify"]

Floats = NDArray[np.float64]

#: Largest number of samples whose hypervolumes are computed for the spread.
_SAMPLES = 100


def verify(model: Any, plan: BlackBoxPoint, tolerance: float) -> Verification:
    """Return the objective from new evaluations, and one check per kind of constraint.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model with its function.
    plan : BlackBoxPoint
        Point; with several objectives the points of the front, or `x` without a front.
    tolerance : float
        Tolerance of the bounds, relative to the range of a variable.

    Returns
    -------
    Verification
        The objective is the mean of `samples` evaluations, or minus the hypervolume of such means.

    Raises
    ------
    InvalidData
        The plan has another number of variables, or a front although the model has one objective.
    """
    if len(plan.x) != model.dimension:
        raise InvalidData(f"x must have {model.dimension} entries, got {len(plan.x)}", field="x")
    if plan.front is not None and model.objectives == 1:
        raise InvalidData("front must be None for a model with one objective", field="front")
    points = np.array(plan.front or (plan.x,))

    def place(row: int, k: int) -> str:
        return f"x[{k}]" if plan.front is None else f"front[{row}], x[{k}]"

    checks = [_bounds(model, points, place, tolerance)]
    if model.variables is not None:
        checks += _kinds(model, points, place)
    if plan.front is not None:
        checks.append(Check.count("x is in the front", [] if plan.x in plan.front else ["x"]))
    count = len(points)
    table = model.function.table(np.repeat(points, model.samples, axis=0), model.columns)
    values = np.asarray(table, np.float64).reshape(count, model.samples, model.columns)
    numbers = np.isfinite(values)
    checks.append(Check.count("value is a number", [f"{v:g}" for v in values[~numbers]]))
    checks += _constraints(model, values.mean(axis=1), plan.front is not None)
    if not numbers.all():
        return Verification(None, tuple(checks))
    if count > 1 and model.samples == model.repeats == 1 and not model.function.noise:
        worse = np.flatnonzero(~non_dominated(values[:, 0, : model.objectives])).tolist()
        checks.append(Check.count("dominated by another point", [f"front[{k}]" for k in worse]))
    objective, spread = _objective(model, values[..., : model.objectives])
    return Verification(objective, tuple(checks), spread)


def _bounds(
    model: Any, points: Floats, place: Callable[[int, int], str], tolerance: float
) -> Check:
    excess = np.maximum(model.lows - points, points - model.highs)
    # Relative to the range, or for equal bounds to their digits.
    scale = np.maximum(model.highs - model.lows, 1e-9 * np.abs(model.highs))
    return Check.largest("bounds", excess, scale, "", place, tolerance)


def _kinds(model: Any, points: Floats, place: Callable[[int, int], str]) -> list[Check]:
    """Return the checks of whole numbers, categories and conditions, which hold exactly."""
    fraction = model.layout.discrete & (points != np.rint(points))
    unused = ~model.layout.active(points) & (points != model.lows)

    def places(bad: NDArray[np.bool_]) -> list[str]:
        return [place(*at) for at in np.argwhere(bad).tolist()]

    return [
        Check.count("integers and categories", places(fraction)),
        Check.count("variables whose condition fails", places(unused)),
    ]


def _constraints(model: Any, values: Floats, is_front: bool) -> list[Check]:
    """Return the checks of inequalities, without a tolerance, and of equalities, within their own.

    The scale of a black box is unknown: a tolerance would accept every violation of a function with small
    values.
    """
    first, last = model.objectives, model.objectives + model.inequalities
    checks = []

    def place(row: int, k: int) -> str:
        return f"front[{row}], {symbol}[{k}]" if is_front else f"{symbol}[{k}]"

    if model.inequalities:
        symbol = "g"
        checks.append(Check.largest("inequalities", values[:, first:last], 0.0, "", place, 0.0))
    if model.equalities:
        symbol, accepted = "h", model.equality_tolerance
        worst = Check.largest("equalities", np.abs(values[:, last:]), accepted, "", place, 1.0)
        checks.append(replace(worst, rounding=accepted))
    return checks


def _objective(model: Any, values: Floats) -> tuple[float, float]:
    """Return the objective and twice its standard error, from values of shape (n, samples, objectives)."""
    if model.reference is None:
        objective, samples = float(values.mean()), values[0, :, 0]
    else:
        objective = 0.0 - hypervolume(values.mean(axis=1), model.reference)
        used = range(min(model.samples, _SAMPLES))
        samples = np.array([hypervolume(values[:, k], model.reference) for k in used])
    spread = float(samples.std(ddof=1)) if model.samples > 1 else 0.0
    return objective, 2 * spread / model.samples**0.5
