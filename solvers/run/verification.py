"""The verb :func:`verify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from ...models.conversion import as_model
from ...models.fields import Flag
from ...models.model import Model
from ...models.records import given
from ...models.verification import TOLERANCE, Verification, check_tolerance
from ..contract.solution import Solution

__all__ = ["verify"]

PlanT = TypeVar("PlanT")


def verify(
    model: Model[PlanT],
    plan: PlanT | Solution[PlanT] | Any,
    *,
    tolerance: float = TOLERANCE,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    exact: bool = False,
) -> Verification:
    """Check a plan against the raw data of a model.

    Parameters
    ----------
    model : Model
        The model.
    plan : plan, Solution or JSON data
        The plan, from any source.
    tolerance : float
        Largest accepted violation, relative to the scale that each check names; > 0 and < 1.
    formulation : str, optional
        Encode the plan into this formulation as well, and check every row of the program.
    formulation_options : mapping, optional
        Options of the formulation.
    exact : bool
        Whether to evaluate the rows, bounds and objective of a mixed-integer or quadratic program in
        rational arithmetic. If the plan is a solution with multipliers, a bound on the objective is proven
        as well, in rational arithmetic or with all rounding errors bounded.

    Returns
    -------
    Verification
        One check per constraint, and one per block of rows if a formulation is given.

    Raises
    ------
    InvalidData
        The plan does not belong to this model, or cannot be encoded.
    UnsupportedOption
        The tolerance is not a number > 0 and < 1.
    UnsupportedFormulation
        `exact` is true, and the model is neither a mixed-integer nor a quadratic program.
    """
    model = as_model(model)
    check_tolerance(tolerance)
    checked = model.as_plan(plan)
    if Flag().coerce("exact", exact, {}):
        from .proofs import verify_exactly

        duals = plan.duals if isinstance(plan, Solution) else None
        point: Any = checked
        verification = verify_exactly(model, point, duals, tolerance)
    else:
        verification = model.verify(checked, tolerance=tolerance)
    if formulation is None:
        return verification
    step: Model[Any] | None = model
    if not isinstance(formulation, str):
        type(model).formulation_type(formulation)  # raises UnknownName with what there is
    while step is not None and formulation not in step.formulations:
        step = step.lower()  # its plans are the model's own
    options = given("formulation_options", formulation_options)
    written = (model if step is None else step).formulate(formulation, **options)
    if not options:
        written = written.fitted(checked)
    rows = written.program.verify(written.encode(checked), tolerance=tolerance)
    return replace(verification, checks=(*verification.checks, *rows.checks))
