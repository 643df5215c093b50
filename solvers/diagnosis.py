"""The verb :func:`diagnose`: why a model has no plan, in the paper's words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..errors import UnsupportedFormulation
from ..models.formulation import Formulation
from ..models.model import Model, as_model
from ..models.problems import resolve, table
from ..models.programs.base import RowProgram
from ..models.programs.conic import ConicProgram
from ..models.programs.linear import QuadraticProgram
from ..models.verification import TOLERANCE, check_number
from .backend import Backend, Guarantee, Termination
from .dispatch import solve
from .isolation import Worker
from .job import check_memory
from .registry import find_backend, recommended
from .solution import Solution

__all__ = ["Diagnosis", "Finding", "diagnose", "filtered"]

#: Findings that a printed diagnosis shows.
_SHOWN = 12


@dataclass(frozen=True)
class Finding:
    """One reason.

    Parameters
    ----------
    text : str
        The reason in words.
    equation : str
        The paper's equation, empty where it has none.
    where : str
        The place.
    data : mapping
        The same for programs, with the model's indices and figures.
    """

    text: str
    equation: str = ""
    where: str = ""
    data: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as JSON data."""
        return {
            "text": self.text,
            "equation": self.equation,
            "where": self.where,
            **(self.data or {}),
        }


@dataclass(frozen=True)
class Diagnosis:
    """Why a model has no plan, or that it has one.

    Parameters
    ----------
    instance : str
        The model's name.
    feasible : bool, optional
        Whether there is a plan; None where neither was shown.
    method : str
        How it was found.
    summary : str
        One sentence.
    findings : tuple of Finding
        The reasons, the nearest miss first.
    """

    instance: str
    feasible: bool | None
    method: str
    summary: str
    findings: tuple[Finding, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the diagnosis as JSON data."""
        return {
            "instance": self.instance,
            "feasible": self.feasible,
            "method": self.method,
            "summary": self.summary,
            "findings": [finding.to_dict() for finding in self.findings],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis that :meth:`to_dict` wrote."""
        words = ("text", "equation", "where")
        findings = tuple(
            Finding(
                one["text"],
                one["equation"],
                one["where"],
                {key: value for key, value in one.items() if key not in words} or None,
            )
            for one in data["findings"]
        )
        return cls(**{**data, "findings": findings})

    def __str__(self) -> str:
        head = f"{self.instance}: {self.summary}" if self.instance else self.summary
        shown = [f"  - {finding.text}" for finding in self.findings[:_SHOWN]]
        if len(self.findings) > _SHOWN:
            shown.append(f"  … and {len(self.findings) - _SHOWN} more (all in the findings)")
        return "\n".join([head, *shown])


def diagnose(
    model: Model[Any],
    backend: str | Backend | None = None,
    *,
    formulation: str | None = None,
    time_limit: float | None = 60.0,
    memory_limit: float | None = None,
) -> Diagnosis:
    """Say why `model` has no plan, in the paper's words.

    Without a backend or formulation, the model's own search names the place where every extension
    dies. With one, a deletion filter over the blocks of the program's rows finds a set of equations
    that no point satisfies together, while it would without any one of them.

    Parameters
    ----------
    model : Model
        What is asked.
    backend : str or Backend, optional
        An exact backend for programs, or ``"auto"``; the deletion filter is used.
    formulation : str, optional
        The formulation to filter; ``"paper"`` unless another is named.
    time_limit : float, optional
        Seconds for each search, or program that the filter solves.
    memory_limit : float, optional
        MiB that the diagnosis may hold in memory, at least 64; Linux only. It then runs in a worker
        process.

    Returns
    -------
    Diagnosis
        The reasons, or that there is a plan.

    Raises
    ------
    UnsupportedFormulation
        The backend is not exact, or takes no program.
    WorkerFailure
        The memory limit is reached.
    """
    model = as_model(model)
    if time_limit is not None:
        check_number("time_limit", time_limit)
    if memory_limit is not None:

        def work() -> dict[str, Any]:
            options: dict[str, Any] = {"formulation": formulation, "time_limit": time_limit}
            return diagnose(model, backend, **options).to_dict()

        with Worker() as worker:
            return Diagnosis.from_dict(
                worker.call(work, deadline=math.inf, memory_limit=check_memory(memory_limit))
            )
    searches = table(__package__, "DIAGNOSES")
    if backend is None and formulation is None and model.kind in searches:
        native: Callable[[Any, float | None], Diagnosis] = resolve(searches[model.kind])
        return native(model, time_limit)
    return filtered(model, backend, formulation, time_limit)


def filtered(
    model: Model[Any],
    backend: str | Backend | None,
    formulation: str | None,
    time_limit: float | None,
) -> Diagnosis:
    """Return blocks of rows that no point satisfies together, by a deletion filter.

    The parameters are those of :func:`diagnose`.
    """
    written: Formulation[Any, Any] | None = None
    if isinstance(model, RowProgram):
        program = model
    else:
        written = model.formulate(formulation or _covering(model))
        if not isinstance(written.program, RowProgram):
            raise UnsupportedFormulation(f"formulation {written.name!r} has no linear rows")
        program = written.program
    if backend is None or (isinstance(backend, str) and backend == "auto"):
        solver = recommended(program)
    else:
        solver = find_backend(backend, program)
    if solver.guarantee is not Guarantee.EXACT or not isinstance(program, solver.accepts):
        raise UnsupportedFormulation(
            f"the deletion filter needs an exact backend for a {program.kind}; "
            f"{solver.name!r} is none"
        )

    def ends(candidate: RowProgram) -> Solution[Any]:
        return solve(candidate, solver, time_limit=time_limit)

    method = f"deletion filter over the rows of {program.name or 'the program'} with {solver.name}"
    while True:
        asked = _feasibility(program)
        answer = ends(asked)
        finer = None
        if answer.plan is not None and written is not None:
            # A relaxation that has a point proves nothing before it is refined.
            finer = written.refined(answer.plan, TOLERANCE)
        if finer is None:
            break
        written, refined = finer, finer.program
        assert isinstance(refined, RowProgram)
        program = refined
    if answer.plan is not None:
        return Diagnosis(model.name, True, method, "a plan exists: nothing to explain")
    if answer.termination is not Termination.INFEASIBLE:
        return Diagnosis(
            model.name, None, method, f"not settled: {solver.name} ended with {answer.termination}"
        )
    needed = [block.name for block in asked.conditions]
    unsure = []
    for name in list(needed):
        kept = [other for other in needed if other != name]
        dropped = [block.name for block in asked.conditions if block.name not in kept]
        outcome = ends(asked.without_rows(dropped)).termination
        if outcome is Termination.INFEASIBLE:
            needed = kept
        elif outcome not in (Termination.OPTIMAL, Termination.FEASIBLE):
            unsure.append(name)
    blocks = [block for block in asked.conditions if block.name in needed]
    findings = tuple(
        Finding(
            f"{block.title} ({block.size} rows)"
            + (": not settled within the time limit" if block.name in unsure else ""),
            block.equation,
            block.name,
            {"block": block.name, "rows": block.size, "settled": block.name not in unsure},
        )
        for block in blocks
    )
    summary = (
        "no plan: these rows cannot hold together, and leaving out any one block of them gives a plan"
        if findings
        else "no plan: the bounds of the columns alone exclude it"
    )
    return Diagnosis(model.name, False, method, summary, findings)


def _feasibility(program: RowProgram) -> RowProgram:
    """Return `program` without its objective: any first point will do."""
    objective: dict[str, Any] = {"cost": program.cost * 0.0, "offset": 0.0}
    if isinstance(program, QuadraticProgram | ConicProgram):
        objective["hessian"] = program.hessian * 0.0
    return replace(program, **objective)


def _covering(model: Model[Any]) -> str | None:
    """Return ``"paper"`` where the paper's formulation covers the model, None for the default."""
    if "paper" not in model.formulations:
        return None
    try:
        model.formulate("paper")
    except UnsupportedFormulation:
        return None
    return "paper"
