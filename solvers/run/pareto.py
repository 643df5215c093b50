"""The verbs :func:`front` and :func:`sweep`: the trade-off between two objectives."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from ...errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from ...models.conversion import as_model
from ...models.fields import Flag, Optional, Real, Whole, show
from ...models.model import Model
from ...models.records import given
from ..contract.backend import Backend, Limit, Termination
from ..contract.events import Event, Listener, listener_of
from ..contract.job import GAP, Job
from ..contract.limits import LimitOptions, Limits, limits_of, takes_limits
from ..contract.solution import Solution
from ..processes.interrupts import on_interrupt
from ..processes.output import shown
from .dispatch import run_job
from .fronts import EQUAL, Front, FrontPoint, gathered
from .recording import Record

__all__ = ["front", "sweep"]

#: Default number of runs without given limits, if the second objective is continuous, and the
#: largest allowed number.
POINTS, MOST = 10, 10_000
#: Decrease of the limit from one plan to the next, relative to the first plan's second objective:
#: initial and smallest value. Halved if no plan is found.
STEP, FINEST = 0.05, 1e-3
#: Limit that is never active, to check the limited models before the first run.
_LOOSE = 1e100


@takes_limits(time_limit=60.0)
def front(
    model: Model[Any],
    second: str,
    *,
    backend: str | Backend = "auto",
    limits: Iterable[float] | Limits | None = None,
    points: int | None = None,
    step: float | None = None,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    backend_options: Mapping[str, Any] | None = None,
    isolate: bool | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    on_point: Callable[[Solution[Any]], None] | None = None,
    **options: Unpack[LimitOptions],
) -> Front:
    """Return the Pareto front of the model's objective and a second objective.

    The model is solved repeatedly with decreasing limits on the second objective. Every plan is
    verified, and dominated plans are removed. A point is proven if the backend proves the minimal
    objective within its limit, as exact backends do.

    Parameters
    ----------
    model : Model
        The model, whose type declares ``second_objectives``, or a program with linear rows.
    second : str
        Name of the second objective; for a program the name of a row with an upper bound or without bounds,
        whose value is limited.
    backend, formulation, formulation_options, backend_options, isolate
        As in :func:`crosstrack.solve`.
    limits : sequence of float or Limits, optional
        Limits on the second objective. Without them, the first run has no limit. Each further
        limit is a `step` below the second objective of the last plan; the step is halved
        whenever no plan is found. A :class:`~crosstrack.solvers.contract.limits.Limits` record
        instead applies to each run.
    points : int, optional
        Largest number of runs if `limits` is not given. Default: 10, or as many as necessary if
        the model declares a discrete second objective.
    step : float, optional
        Step relative to the second objective of the first plan. Points within a step may be
        missed. With an exact backend and enough `points`, a step of 1e-6 finds the whole front.
        Default: 0.05; a discrete second objective decreases by its smallest difference.
    time_limit : float, optional
        Seconds per run (default 60).
    memory_limit, evaluations, target, gap, tolerance, seed, threads, stop : optional
        As in :func:`crosstrack.solve`, for each run.
    warm_start, starts, verbose : optional
        As in :func:`crosstrack.solve`, for each run.
    on_event : callable, optional
        Function called with each :class:`~crosstrack.solvers.contract.events.Event`: the end of each
        run with its solution.
    record : path-like, optional
        Name of a JSONL file to which each answer is appended at once.
    resume : bool
        Continue an existing record and run only the missing limits.
    on_point : callable, optional
        Deprecated: use `on_event`.

    Returns
    -------
    Front
        The points; after Ctrl-C, those found so far. ``crosstrack.plot(front)`` draws it.

    Raises
    ------
    UnsupportedFormulation
        The model declares no second objective, or the backend does not support its limit.
    UnknownName
        The model declares no second objective of this name.
    InvalidData
        A limit is not a finite number >= 0, or the record exists or cannot be written.
    UnsupportedOption
        `resume` is given without a record, or the backend does not support an option. Options are
        checked before the first run.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import FleetRouting
    >>> places = [[0, 0], [4, 0], [5, 5], [5, -5], [-1, 1], [-2, -1]]
    >>> found = ct.front(FleetRouting(2, points=places, objective="sum"), "max", step=1e-6)
    >>> [(round(point.objective, 2), round(point.second, 2)) for point in found.points]
    [(30.23, 24.34), (34.92, 18.75), (35.09, 17.72)]
    """
    model = as_model(model)
    field_name = _declared(model, second)
    least = model.second_steps.get(second, 0.0)
    record_of_limits = limits if isinstance(limits, Limits) else None
    values = None if isinstance(limits, Limits) else limits
    limit_list = None if values is None else _limits(values, least)
    count = Optional(Whole(1, MOST)).coerce("points", points, {})
    run_limit = (MOST if least else POINTS) if count is None else count
    share = Optional(Real(lower=0, strict=True, upper=1)).coerce("step", step, {})
    width = (0.0 if least else STEP) if share is None else share
    shared = _shared("front", model, record_of_limits, options)
    listener = listener_of(shared.pop("on_event"), "solution", on_point=on_point)
    ask = partial(
        Job,
        backend=backend, formulation=formulation,
        formulation_options=given("formulation_options", formulation_options),
        backend_options=given("backend_options", backend_options), **shared,
    )  # fmt: skip

    def limited(limit: float | None) -> Model[Any]:
        if limit is None:
            return model
        label = model.name or model.kind
        return model.limited(second, limit).renamed(f"{label}, {second} <= {limit:.10g}")

    for limit in (None, _LOOSE) if limit_list is None else (limit_list[0],):
        _taken(ask(model=limited(limit)))

    with shown(shared["verbose"]), _Runs(record, resume, isolate, listener) as runs:

        def solve(limit: float | None) -> Solution[Any]:
            return runs.solve(ask(model=limited(limit)))

        def value(solution: Solution[Any]) -> float:
            return model.second_objective(second, solution.plan)

        tried: list[tuple[float | None, Solution[Any]]] = []
        if limit_list is not None:
            for limit in limit_list:
                if runs.interrupted:
                    break
                tried.append((limit, solve(limit)))
        else:
            tried.append((None, solve(None)))
            _descend(tried, solve, value, run_limit, width, least, runs)
    result = [
        FrontPoint(float(s.primal_bound), value(s), limit, s, _proves(s, shared["gap"]))
        for limit, s in tried
        if s.plan is not None and s.primal_bound is not None
    ]
    return gathered(model, second, field_name, result, [s for _, s in tried], runs.interrupted)


def _descend(
    tried: list[tuple[float | None, Solution[Any]]],
    solve: Callable[[float | None], Solution[Any]],
    value: Callable[[Solution[Any]], float],
    run_limit: int,
    width: float,
    least: float,
    runs: _Runs,
) -> None:
    """Append runs with decreasing limits to `tried`, which starts with the unlimited run.

    If the second objective is discrete, `least` is its smallest difference, and limits are
    non-negative multiples of it. Otherwise `least` is 0.
    """
    first = tried[0][1]
    if first.plan is None:
        return
    current = whole = value(first)
    step, infeasible_limit = width, -least or -math.inf
    finest = min(FINEST, width)
    while len(tried) < run_limit and not runs.interrupted and 0 < whole < math.inf:
        limit = _rounded(current - max(step * whole, least), least)
        if infeasible_limit < limit and limit >= 0:
            solution = solve(limit)
            tried.append((limit, solution))
            if solution.plan is not None:
                # The plan may exceed the limit by its tolerance.
                current = min(limit, value(solution))
                continue
            infeasible_limit = limit
        # No plan exists below a limit for which none was found.
        step *= 0.5
        if step < finest or current - least <= infeasible_limit:
            return


def _rounded(limit: float, least: float) -> float:
    """Return the largest multiple of `least` up to `limit`, or `limit` if `least` is 0."""
    return least * math.floor(limit / least * (1 + EQUAL)) if least else limit


@takes_limits(time_limit=60.0)
def sweep(
    model: Model[Any],
    name: str,
    values: Iterable[Any],
    first: str,
    second: str,
    *,
    backend: str | Backend = "auto",
    formulation: str | None = None,
    backend_options: Mapping[str, Any] | None = None,
    isolate: bool | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    limits: Limits | None = None,
    on_point: Callable[[Solution[Any]], None] | None = None,
    **options: Unpack[LimitOptions],
) -> Front:
    """Solve the model for each value of a field, and compare two objectives of the plans.

    The field may be a weight, such as q in the deviation of a fleet. Plans of some values may be
    dominated by plans of others, which the front marks.

    Parameters
    ----------
    model : Model
        The model.
    name : str
        Name of the field.
    values : sequence
        Values of the field.
    first, second : str
        Two of the model's ``second_objectives``.
    backend, formulation, backend_options, isolate, limits
        As in :func:`crosstrack.solve`.
    record, resume, on_point, time_limit, memory_limit, evaluations, target, gap, tolerance, seed
        As in :func:`front`.
    threads, stop, warm_start, starts, verbose, on_event
        As in :func:`front`.

    Returns
    -------
    Front
        Points with `first` as their objective and the value of the field as their limit.

    Raises
    ------
    UnsupportedFormulation, UnknownName, InvalidData
        As in :func:`front`; or the model has no such field, or rejects a value.
    """
    model = as_model(model)
    for objective in (first, second):
        _declared(model, objective)
    fields = [
        entry.name for entry in dataclasses.fields(model) if entry.init and entry.name != "name"
    ]
    if name not in fields:
        raise UnknownName(f"field of model {model.kind!r}", name, fields)
    label = model.name or model.kind
    checked_options = given("backend_options", backend_options)
    shared = _shared("sweep", model, limits, options)
    listener = listener_of(shared.pop("on_event"), "solution", on_point=on_point)
    jobs = []
    for value in _listed("values", values):
        changed: dict[str, Any] = {name: value, "name": f"{label}, {name} = {value}"}
        variant = dataclasses.replace(model, **changed)
        job = Job(variant, backend, formulation, backend_options=checked_options, **shared)
        _taken(job)
        jobs.append((value, job))
    points, answers = [], []
    with shown(shared["verbose"]), _Runs(record, resume, isolate, listener) as runs:
        for value, job in jobs:
            if runs.interrupted:
                break
            solution = runs.solve(job)
            answers.append(solution)
            if solution.plan is not None:
                pair = (
                    model.second_objective(first, solution.plan),
                    model.second_objective(second, solution.plan),
                )
                level = float(value) if isinstance(value, numbers.Real) else None
                points.append(FrontPoint(*pair, level, solution, _proves(solution, shared["gap"])))
    return gathered(model, second, name, points, answers, runs.interrupted, first)


@dataclass
class _Runs:
    """Sequence of runs, each appended to the record if there is one.

    The first Ctrl-C sets `interrupted` and stops the current run. It may also arrive between runs.
    """

    record: str | Path | None
    resume: bool
    isolate: bool | None
    listener: Listener | None
    interrupted: bool = False

    def __enter__(self) -> _Runs:
        self.isolate = Optional(Flag()).coerce("isolate", self.isolate, {})
        if self.resume and self.record is None:
            raise UnsupportedOption("resume needs a record to continue")
        with contextlib.ExitStack() as stack:
            self._file = None
            if self.record is not None:
                self._file = stack.enter_context(Record(self.record, resume=self.resume))
            stack.enter_context(on_interrupt(self._interrupt))
            self._stack = stack.pop_all()
        return self

    def _interrupt(self) -> None:
        self.interrupted = True

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def solve(self, job: Job) -> Solution[Any]:
        job = job.resolved()
        solution = None if self._file is None else self._file.find(job, job.model)
        if solution is None:
            solution = run_job(job, self.isolate, None)
            is_cut = solution.limit is Limit.INTERRUPTED
            self.interrupted |= is_cut
            if self._file is not None and not is_cut:
                self._file.add(job, solution)
        if self.listener is not None:
            self.listener(Event.ended(solution))
        return solution


def _shared(
    verb: str, model: Model[Any], limits: Limits | None, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the fields that all jobs share, and the callback of the call."""
    shared = limits_of(verb, limits, options, time_limit=60.0).fields()
    if shared["warm_start"] is not None:
        shared["warm_start"] = model.as_plan(shared["warm_start"])
    return {**shared, "counts_compilation": True}


def _declared(model: Model[Any], second: str) -> str:
    """Return the name of the field that limits a second objective."""
    if not model.second_objectives:
        raise UnsupportedFormulation(f"model {model.kind!r} declares no second objective")
    if not isinstance(second, str) or second not in model.second_objectives:
        raise UnknownName(
            f"second objective of model {model.kind!r}", second, model.second_objectives
        )
    return model.second_objectives[second]


def _taken(job: Job) -> None:
    """Raise an error if the backend cannot run the job, before the first job starts."""
    target = job.resolved().find_target()
    reason = "" if target.formulation is not None else target.backend.refuses(target.model)
    if reason:
        raise UnsupportedFormulation(f"backend {target.backend.name!r}: {reason}")


def _listed(name: str, values: Any) -> list[Any]:
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        raise InvalidData(f"{name} must be a list of numbers, got {show(values)}", field=name)
    entries = list(values)
    if not 0 < len(entries) <= MOST:
        raise InvalidData(f"{name} must hold 1 … {MOST} entries, got {len(entries)}", field=name)
    return entries


def _limits(values: Any, least: float) -> list[float]:
    """Return the limits in decreasing order without duplicates, rounded to multiples of `least`."""
    listed = _listed("limits", values)
    limits = {Real(lower=0).coerce(f"limits[{k}]", limit, {}) for k, limit in enumerate(listed)}
    return sorted({_rounded(limit, least) for limit in limits}, reverse=True)


def _proves(solution: Solution[Any], gap: float | None) -> bool:
    """Return True if the objective is proven minimal up to `gap`."""
    if solution.termination is not Termination.OPTIMAL or solution.gap is None:
        return False
    return solution.gap <= (GAP if gap is None else gap) + EQUAL
