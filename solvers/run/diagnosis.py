"""The verb :func:`diagnose`: the reasons why a model has no plan, in the terms of its paper."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.conversion import as_model
from ...models.formulation import Formulation
from ...models.model import Model
from ...models.problems import resolve, table
from ...models.programs.base import Program, RowProgram
from ...models.programs.linear import MixedIntegerProgram
from ...models.verification import TOLERANCE
from ..contract.backend import Backend, Guarantee, Termination
from ..contract.limits import LimitOptions, Limits, limits_of, takes_limits
from ..contract.registry import find_backend
from ..contract.selection import recommended
from ..contract.solution import Solution
from ..processes.isolation import Worker
from ..processes.output import shown
from .conflicts import Conflict, feasibility, find_conflict, with_blocks
from .dispatch import solve

__all__ = ["Diagnosis", "Finding", "diagnose", "filtered"]

#: Largest number of findings in a printed diagnosis.
_SHOWN = 12
#: Limits that native searches and the deletion filter support.
_SEARCH = ("time_limit", "memory_limit")
_FILTER = (*_SEARCH, "tolerance", "gap", "seed", "threads", "verbose", "on_event")

#: Terminations that state whether a program without an objective has a point.
SETTLED = (Termination.OPTIMAL, Termination.FEASIBLE, Termination.INFEASIBLE)


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

    For a program with linear rows, such as one made from a file or a ``cvxpy.Problem``, the rows of
    these blocks and the column bounds are reduced to an irreducible set as well. The findings have the
    names of its author: constraints first, then their rows, then the bounds. At most
    400 programs are solved for it, within `time_limit` seconds
    in all; the summary states if the set was not reduced completely.

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
        The backend is not exact, or does not solve programs, or the program is nonlinear.
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
    model: Model[Any], backend: str | Backend | None, formulation: str | None, limits: Limits
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
    automatic = backend is None or (isinstance(backend, str) and backend == "auto")
    if isinstance(model, RowProgram):
        program = _linear_part(model, limits) if automatic else model
    elif isinstance(model, Program):
        raise UnsupportedFormulation(
            f"diagnose supports programs with linear rows and cones, got a {model.kind}: its backends are "
            "local and prove no infeasibility"
        )
    else:
        written = model.formulate(formulation or _covering(model))
        if not isinstance(written.program, RowProgram):
            raise UnsupportedFormulation(f"formulation {written.name!r} has no linear rows")
        program = written.program
    if automatic:
        solver = recommended(program)
    else:
        assert backend is not None
        solver = find_backend(backend, program)
    if solver.guarantee is not Guarantee.EXACT or not isinstance(program, solver.accepts):
        raise UnsupportedFormulation(
            f"the deletion filter needs an exact backend for a {program.kind}; "
            f"{solver.name!r} is not"
        )

    def solved(candidate: RowProgram, limits: Limits = limits) -> Solution[Any]:
        return solve(candidate, solver, limits=limits)

    method = f"deletion filter over the rows of {program.name or 'the program'} with {solver.name}"
    while True:
        candidate = feasibility(program)
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
    if written is None:
        candidate = with_blocks(candidate)
    needed = [block.name for block in candidate.conditions]
    unsure = []
    for name in list(needed):
        remaining = [other for other in needed if other != name]
        dropped = [block.name for block in candidate.conditions if block.name not in remaining]
        outcome = solved(candidate.without_rows(dropped)).termination
        if outcome is Termination.INFEASIBLE:
            needed = remaining
        elif outcome not in SETTLED:
            unsure.append(name)
    blocks = [block for block in candidate.conditions if block.name in needed]
    if written is None:
        return _explained(model, candidate, needed, unsure, method, solved, limits)
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


def _linear_part(program: RowProgram, limits: Limits) -> RowProgram:
    """Return the rows and columns of `program` as a linear one if they alone decide whether it has a point.

    That is the case without cones, or if the rows and bounds exclude every point. Solvers of linear
    programs prove infeasibility more reliably than those of quadratic and conic ones.
    """
    integral = getattr(program, "integral", None)
    if isinstance(program, MixedIntegerProgram):
        return program
    if integral is None:
        integral = np.zeros(program.size, bool)
    linear = MixedIntegerProgram(integral=integral, **program.shared())
    if not getattr(program, "cones", ()):
        return linear
    ending = solve(feasibility(linear), limits=limits).termination
    return linear if ending is Termination.INFEASIBLE else program


def _explained(
    model: Model[Any], candidate: RowProgram, needed: Sequence[str], unsure: Sequence[str],
    method: str, solved: Callable[[RowProgram, Limits], Solution[Any]], limits: Limits,
) -> Diagnosis:  # fmt: skip
    """Return the diagnosis of a program whose blocks `needed` exclude every point."""
    dropped = [block.name for block in candidate.conditions if block.name not in needed]
    deadline = time.monotonic() + (math.inf if limits.time_limit is None else limits.time_limit)
    open_parts = len(unsure)

    def infeasible(part: RowProgram) -> bool:
        nonlocal open_parts
        left = max(deadline - time.monotonic(), 1e-3)
        try:
            within = replace(limits, time_limit=None if math.isinf(left) else left)
            ending = solved(part, within).termination
        except UnsupportedFormulation:  # CP-SAT solves no relaxation and no column without bounds
            ending = Termination.NO_SOLUTION
        open_parts += ending not in SETTLED
        return ending is Termination.INFEASIBLE

    conflict = find_conflict(
        candidate.without_rows(dropped), infeasible, lambda: time.monotonic() < deadline
    )
    what = [
        *(["rows"] if conflict.rows else []),
        *(["cones"] if getattr(conflict.program, "cones", ()) else []),
        *(["column bounds"] if conflict.lower or conflict.upper else []),
    ]
    whole = " with integer columns" if conflict.integral else ""
    summary = f"no plan: no point{whole} satisfies these {' and '.join(what)}"
    summary += (
        ", but removing any one of them makes a point possible"
        if conflict.irreducible and not open_parts
        else "; the reduction was not completed, so that some may not be needed"
    )
    return Diagnosis(model.name, False, method, summary, tuple(_findings(conflict, unsure)))


def _findings(conflict: Conflict, unsure: Sequence[str]) -> Iterator[Finding]:
    """Yield the constraints of a conflict, then their rows, then the column bounds."""
    program = conflict.program
    blocks = [*program.rows, *getattr(program, "cones", ())]
    rows_of = {
        block.name: [row for row in conflict.rows if block.start <= row < block.start + block.size]
        for block in program.rows
    }
    parts: list[Finding] = []
    labels = program.row_labels
    for block in blocks:
        rows = rows_of.get(block.name) if block in program.rows else None
        if rows == []:
            continue
        note = ": not settled within the time limit" if block.name in unsure else ""
        size = block.size if rows is None else len(rows)
        data = {"block": block.name, "rows": size, "settled": block.name not in unsure}
        text = f"{block.title} ({size} of {block.size} rows)"
        if rows is not None and block.size == 1:
            text = f"{block.title}: {conflict.row_text(rows[0])}"
        if len(blocks) > 1 or block.size == 1 or rows is None:
            yield Finding(text + note, block.equation, block.name, data)
        if rows is not None and block.size > 1:
            parts += [
                Finding(
                    f"row {labels[row]}: {conflict.row_text(row)}",
                    where=labels[row], data={"row": labels[row], "block": block.name},
                )
                for row in rows
            ]  # fmt: skip
    yield from parts
    names = conflict.names
    for sign, columns, bounds in (
        (">=", conflict.lower, program.column_lower),
        ("<=", conflict.upper, program.column_upper),
    ):
        for column in columns:
            value = float(bounds[column])
            data = {"column": names[column], "bound": sign, "value": value}
            text = f"bound {names[column]} {sign} {value:.6g}"
            yield Finding(text, where=names[column], data=data)


def _covering(model: Model[Any]) -> str | None:
    """Return ``"paper"`` if the paper's formulation covers the model, None for the default."""
    if "paper" not in model.formulations:
        return None
    try:
        model.formulate("paper")
    except UnsupportedFormulation:
        return None
    return "paper"
