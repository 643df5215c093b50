"""The verb :func:`diagnose`: the reasons why a model has no plan, in the terms of its paper."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Unpack

from ...errors import UnsupportedFormulation
from ...models.formulation import Formulation
from ...models.model import Model, as_model
from ...models.problems import resolve, table
from ...models.programs.base import RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ...models.verification import TOLERANCE
from ..contract.backend import Backend, Guarantee, Termination
from ..contract.limits import LimitOptions, Limits, limits_of, takes_limits
from ..contract.registry import find_backend
from ..contract.selection import recommended
from ..contract.solution import Solution
from ..processes.isolation import Worker
from ..processes.output import shown
from .dispatch import solve

__all__ = ["Diagnosis", "Finding", "diagnose", "filtered"]

#: Largest number of findings in a printed diagnosis.
_SHOWN = 12
#: Limits that native searches and the deletion filter support.
_SEARCH = ("time_limit", "memory_limit")
_FILTER = (*_SEARCH, "tolerance", "gap", "seed", "threads", "verbose", "on_event")


@dataclass(frozen=True)
class Finding:
    """One reason why a model has no plan.

    Parameters
    ----------
    text : str
        The reason as a sentence.
    equation : str
        Number of the paper's equation; empty if it has none.
    where : str
        Place in the model or program.
    data : mapping, optional
        The same as JSON data, with the model's indices and values.
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
    """Reasons why a model has no plan, or the statement that it has one.

    Parameters
    ----------
    instance : str
        Name of the model.
    feasible : bool, optional
        True if a plan exists, False if none does, None if neither was proven.
    method : str
        Name of the method.
    summary : str
        Result in one sentence.
    findings : tuple of Finding
        The reasons, sorted by how closely they are missed.
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
        """Return the diagnosis written by :meth:`to_dict`."""
        words = ("text", "equation", "where")
        findings = tuple(
            Finding(
                item["text"],
                item["equation"],
                item["where"],
                {key: value for key, value in item.items() if key not in words} or None,
            )
            for item in data["findings"]
        )
        return cls(**{**data, "findings": findings})

    def __str__(self) -> str:
        head = f"{self.instance}: {self.summary}" if self.instance else self.summary
        shown = [f"  - {finding.text}" for finding in self.findings[:_SHOWN]]
        if len(self.findings) > _SHOWN:
            shown.append(f"  … and {len(self.findings) - _SHOWN} more (all in the findings)")
        return "\n".join([head, *shown])


@takes_limits(time_limit=60.0)
def diagnose(
    model: Model[Any],
    backend: str | Backend | None = None,
    *,
    formulation: str | None = None,
    limits: Limits | None = None,
    **options: Unpack[LimitOptions],
) -> Diagnosis:
    """Return the reasons why `model` has no plan, in the terms of its paper.

    Without a backend or formulation, the native search of the model reports where every extension
    of a partial plan is infeasible. With one of them, a deletion filter over the row blocks of the
    program returns an irreducible infeasible set of blocks: no point satisfies all of them, but
    some point satisfies all but any one.

    Parameters
    ----------
    model : Model
        The model to explain.
    backend : str or Backend, optional
        Exact backend for programs, or ``"auto"``. Selects the deletion filter.
    formulation : str, optional
        Formulation to filter. Default: ``"paper"``.
    limits : Limits, optional
        Limits as a whole, see :class:`~crosstrack.solvers.contract.limits.Limits`.
    time_limit : float, optional
        Seconds per search, or per program that the filter solves (default 60).
    memory_limit : float, optional
        Memory limit in MiB, at least 64; Linux only. The diagnosis then runs in a worker process.
    tolerance, gap, seed, threads, verbose, on_event : optional
        As in :func:`crosstrack.solve`, for each program that the filter solves.
    evaluations, target, stop, warm_start, starts : optional
        No search and no filter supports them.

    Returns
    -------
    Diagnosis
        The reasons, or the statement that a plan exists.

    Raises
    ------
    UnsupportedFormulation
        The backend is not exact, or does not solve programs.
    UnsupportedOption
        The search or the filter does not support a limit.
    WorkerFailure
        The memory limit was reached.
    """
    model = as_model(model)
    limits = limits_of("diagnose", limits, options, time_limit=60.0)
    searches = table(__package__.rpartition(".")[0], "DIAGNOSES")
    searches_natively = backend is None and formulation is None and model.kind in searches
    supported: tuple[str, ...] = _SEARCH if searches_natively else _FILTER
    if limits.memory_limit is not None:  # a worker process reports no events
        supported = tuple(name for name in supported if name != "on_event")
    limits.require_only(f"diagnose of model {model.kind!r}", supported)
    if limits.memory_limit is not None:
        apart = replace(limits, memory_limit=None)

        def work() -> dict[str, Any]:
            return diagnose(model, backend, formulation=formulation, limits=apart).to_dict()

        with shown(limits.verbose), Worker() as worker:
            result = worker.call(work, deadline=math.inf, memory_limit=limits.memory_limit)
            return Diagnosis.from_dict(result)
    if searches_natively:
        native: Callable[[Any, float | None], Diagnosis] = resolve(searches[model.kind])
        return native(model, limits.time_limit)
    return filtered(model, backend, formulation, limits)


def filtered(
    model: Model[Any],
    backend: str | Backend | None,
    formulation: str | None,
    limits: Limits,
) -> Diagnosis:
    """Return an infeasible set of row blocks, computed with a deletion filter.

    Parameters
    ----------
    model, backend, formulation, limits
        As in :func:`diagnose`.

    Returns
    -------
    Diagnosis
        Removing any one block of the set makes the program feasible, except blocks reported as
        not settled within the time limit.
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
            f"{solver.name!r} is not"
        )

    def solved(candidate: RowProgram) -> Solution[Any]:
        return solve(candidate, solver, limits=limits)

    method = f"deletion filter over the rows of {program.name or 'the program'} with {solver.name}"
    while True:
        candidate = _feasibility(program)
        answer = solved(candidate)
        finer = None
        if answer.plan is not None and written is not None:
            # A point of a relaxation proves nothing until the relaxation is tight enough.
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
    needed = [block.name for block in candidate.conditions]
    unsure = []
    for name in list(needed):
        remaining = [other for other in needed if other != name]
        dropped = [block.name for block in candidate.conditions if block.name not in remaining]
        outcome = solved(candidate.without_rows(dropped)).termination
        if outcome is Termination.INFEASIBLE:
            needed = remaining
        elif outcome not in (Termination.OPTIMAL, Termination.FEASIBLE):
            unsure.append(name)
    blocks = [block for block in candidate.conditions if block.name in needed]
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
        "no plan: no point satisfies these rows, and without any one of the blocks there is a plan"
        if findings
        else "no plan: the bounds of the columns alone exclude it"
    )
    return Diagnosis(model.name, False, method, summary, findings)


def _feasibility(program: RowProgram) -> RowProgram:
    """Return `program` with a zero objective, because any feasible point is sufficient."""
    objective: dict[str, Any] = {"cost": program.cost * 0.0, "offset": 0.0}
    if isinstance(program, QuadraticProgram | ConicProgram):
        objective["hessian"] = program.hessian * 0.0
    return replace(program, **objective)


def _covering(model: Model[Any]) -> str | None:
    """Return ``"paper"`` if the paper's formulation covers the model, None for the default."""
    if "paper" not in model.formulations:
        return None
    try:
        model.formulate("paper")
    except UnsupportedFormulation:
        return None
    return "paper"
