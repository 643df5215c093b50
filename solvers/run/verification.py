"""The verb :func:`verify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from ...models.model import Model, as_model
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
    """
    model = as_model(model)
    check_tolerance(tolerance)
    checked = model.as_plan(plan)
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
