"""The verb :func:`front`: what must be given of one objective for how much of another."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from ..models.fields import Flag, Optional, Real, Whole, show
from ..models.model import Model, as_model
from ..models.records import given
from .backend import Backend, Limit, Termination
from .campaign import Record
from .dispatch import run_job
from .fronts import EQUAL, Front, FrontPoint, gathered
from .interrupts import on_interrupt
from .job import GAP, Job
from .solution import Solution

__all__ = ["front", "sweep"]

#: Points of a front where no limits are given and the second objective is not whole, and the most
#: that are allowed.
POINTS, MOST = 10, 10_000
#: By how much a limit is less than what the last plan has, relative to the first plan's: at first, and
#: at the least. Halved where no plan is found.
STEP, FINEST = 0.05, 1e-3
#: A limit that binds nothing, for what must be known of all limited models before the first run.
_LOOSE = 1e100


def front(
    model: Model[Any],
    second: str,
    *,
    backend: str | Backend = "auto",
    limits: Iterable[float] | None = None,
    points: int | None = None,
    step: float | None = None,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    time_limit: float | None = 60.0,
    memory_limit: float | None = None,
    gap: float | None = None,
    tolerance: float | None = None,
    seed: int | None = None,
    threads: int | None = None,
    backend_options: Mapping[str, Any] | None = None,
    isolate: bool | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    on_point: Callable[[Solution[Any]], None] | None = None,
) -> Front:
    """Return the Pareto set of the model's objective and a second one that it declares.

    The model is solved again and again with a limit on the second objective. Every plan is verified;
    what another plan dominates is taken out. A point is proven where the backend proves the least
    objective within its limit, as exact ones do.

    Parameters
    ----------
    model : Model
        What is asked; its type declares ``second_objectives``.
    second : str
        The name of the second objective.
    backend, formulation, formulation_options, gap, tolerance, seed, threads, backend_options, isolate
        As in :func:`crosstrack.solve`.
    limits : sequence of float, optional
        Limits on the second objective. Without them the model is solved without any first, and each
        limit is then a `step` less than what the last plan has, and half of that whenever no plan is
        found.
    points : int, optional
        Runs at the most, where no limits are given. By default 10, and all that are needed where the
        model declares that the second objective is whole.
    step : float, optional
        Relative to what the first plan has of the second objective. What lies within a step may be
        missed; a step of 1e-6 finds all there is, where the backend is exact and `points` are enough.
        By default 0.05; a second objective that is whole descends one by one.
    time_limit : float, optional
        Seconds for each run.
    memory_limit : float, optional
        MiB that each run may hold in memory, as in :func:`crosstrack.solve`.
    record : path-like, optional
        A JSONL file to which each answer is added as soon as it is there.
    resume : bool
        Go on with a record that exists, and run only what it lacks.
    on_point : callable, optional
        Called with each :class:`~crosstrack.solvers.solution.Solution`.

    Returns
    -------
    Front
        The points, also of what was interrupted. ``crosstrack.plot(front)`` draws it.

    Raises
    ------
    UnsupportedFormulation
        The model declares no second objective, or the backend does not take its limit.
    UnknownName
        It declares none of this name.
    InvalidData
        Limits that are no finite numbers >= 0, or a record that exists or cannot be written.
    UnsupportedOption
        `resume` without a record, or an option that the backend does not take. What the backend does
        not take raises before the first run.

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
    chosen = None if limits is None else _limits(limits, least)
    count = Optional(Whole(1, MOST)).coerce("points", points, {})
    most = (MOST if least else POINTS) if count is None else count
    share = Optional(Real(lower=0, strict=True, upper=1)).coerce("step", step, {})
    width = (0.0 if least else STEP) if share is None else share
    ask = partial(
        Job,
        backend=backend, formulation=formulation,
        formulation_options=given("formulation_options", formulation_options),
        time_limit=time_limit, memory_limit=memory_limit, gap=gap, tolerance=tolerance, seed=seed, threads=threads,
        backend_options=given("backend_options", backend_options), counts_compilation=True,
    )  # fmt: skip

    def limited(limit: float | None) -> Model[Any]:
        if limit is None:
            return model
        label = model.name or model.kind
        return model.limited(second, limit).renamed(f"{label}, {second} <= {limit:.10g}")

    for limit in (None, _LOOSE) if chosen is None else (chosen[0],):
        _taken(ask(model=limited(limit)))

    with _Runs(record, resume, isolate, on_point) as runs:

        def solve(limit: float | None) -> Solution[Any]:
            return runs.solve(ask(model=limited(limit)))

        def value(solution: Solution[Any]) -> float:
            return model.second_objective(second, solution.plan)

        tried: list[tuple[float | None, Solution[Any]]] = []
        if chosen is not None:
            for limit in chosen:
                if runs.interrupted:
                    break
                tried.append((limit, solve(limit)))
        else:
            tried.append((None, solve(None)))
            _descend(tried, solve, value, most, width, least, runs)
    found = [
        FrontPoint(float(s.primal_bound), value(s), limit, s, _proves(s, gap))
        for limit, s in tried
        if s.plan is not None and s.primal_bound is not None
    ]
    return gathered(model, second, field_name, found, [s for _, s in tried], runs.interrupted)


def _descend(
    tried: list[tuple[float | None, Solution[Any]]],
    solve: Callable[[float | None], Solution[Any]],
    value: Callable[[Solution[Any]], float],
    most: int,
    width: float,
    least: float,
    runs: _Runs,
) -> None:
    """Add runs under ever smaller limits to `tried`, which holds the one without.

    What is a multiple of `least`, unless that is 0, has limits that are, and none below 0.
    """
    first = tried[0][1]
    if first.plan is None:
        return
    now = whole = value(first)
    step, closed = width, -least or -math.inf
    finest = min(FINEST, width)
    while len(tried) < most and not runs.interrupted and 0 < whole < math.inf:
        limit = _rounded(now - max(step * whole, least), least)
        if closed < limit and limit >= 0:
            solution = solve(limit)
            tried.append((limit, solution))
            if solution.plan is not None:
                # A plan that uses its tolerance up may have more than the limit.
                now = min(limit, value(solution))
                continue
            closed = limit
        # Below the least limit under which there was no plan there is none.
        step *= 0.5
        if step < finest or now - least <= closed:
            return


def _rounded(limit: float, least: float) -> float:
    """Return the largest multiple of `least` up to `limit`, rounding aside; `limit` where it is 0."""
    return least * math.floor(limit / least * (1 + EQUAL)) if least else limit


def sweep(
    model: Model[Any],
    name: str,
    values: Iterable[Any],
    first: str,
    second: str,
    *,
    backend: str | Backend = "auto",
    formulation: str | None = None,
    time_limit: float | None = 60.0,
    memory_limit: float | None = None,
    gap: float | None = None,
    tolerance: float | None = None,
    seed: int | None = None,
    threads: int | None = None,
    backend_options: Mapping[str, Any] | None = None,
    isolate: bool | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    on_point: Callable[[Solution[Any]], None] | None = None,
) -> Front:
    """Solve the model for each value of a field, and compare two objectives of the plans.

    For a weight such as q of a fleet's deviation: the plans of some weights may be dominated by those
    of others, which are named as such.

    Parameters
    ----------
    model : Model
        What is asked.
    name : str
        The field that is varied.
    values : sequence
        Its values.
    first, second : str
        Two of the model's ``second_objectives``.
    backend, formulation, time_limit, memory_limit, gap, tolerance, seed, threads, backend_options, isolate
        As in :func:`crosstrack.solve`.
    record, resume, on_point
        As in :func:`front`.

    Returns
    -------
    Front
        Points with `first` as their objective and the field's value as their limit.

    Raises
    ------
    UnsupportedFormulation, UnknownName, InvalidData
        As :func:`front`; the model has no such field, or refuses a value.
    """
    model = as_model(model)
    for one in (first, second):
        _declared(model, one)
    fields = [one.name for one in dataclasses.fields(model) if one.init and one.name != "name"]
    if name not in fields:
        raise UnknownName(f"field of model {model.kind!r}", name, fields)
    label = model.name or model.kind
    own = given("backend_options", backend_options)
    jobs = []
    for value in _listed("values", values):
        changed: dict[str, Any] = {name: value, "name": f"{label}, {name} = {value}"}
        asked = dataclasses.replace(model, **changed)
        job = Job(
            asked, backend, formulation, time_limit=time_limit, memory_limit=memory_limit, gap=gap, tolerance=tolerance, seed=seed,
            threads=threads, backend_options=own, counts_compilation=True,
        )  # fmt: skip
        _taken(job)
        jobs.append((value, job))
    found, answers = [], []
    with _Runs(record, resume, isolate, on_point) as runs:
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
                found.append(FrontPoint(*pair, level, solution, _proves(solution, gap)))
    return gathered(model, second, name, found, answers, runs.interrupted, first)


@dataclass
class _Runs:
    """Runs one after another, each added to a record where there is one.

    The first Ctrl-C, also one between two runs, sets `interrupted` and ends the run at work.
    """

    record: str | Path | None
    resume: bool
    isolate: bool | None
    listener: Callable[[Solution[Any]], None] | None
    interrupted: bool = False

    def __enter__(self) -> _Runs:
        self.isolate = Optional(Flag()).coerce("isolate", self.isolate, {})
        if self.resume and self.record is None:
            raise UnsupportedOption("resume needs a record to go on with")
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
        found = None if self._file is None else self._file.find(job, job.model)
        if found is None:
            found = run_job(job, self.isolate, None)
            cut = found.limit is Limit.INTERRUPTED
            self.interrupted |= cut
            if self._file is not None and not cut:
                self._file.add(job, found)
        if self.listener is not None:
            self.listener(found)
        return found


def _declared(model: Model[Any], second: str) -> str:
    """Return the field that limits the second objective of this name."""
    if not model.second_objectives:
        raise UnsupportedFormulation(f"model {model.kind!r} declares no second objective")
    if not isinstance(second, str) or second not in model.second_objectives:
        raise UnknownName(
            f"second objective of model {model.kind!r}", second, model.second_objectives
        )
    return model.second_objectives[second]


def _taken(job: Job) -> None:
    """Raise where the backend does not take the job, which is better known before others have run."""
    target = job.resolved().target()
    reason = "" if target.formulation is not None else target.backend.refuses(target.model)
    if reason:
        raise UnsupportedFormulation(f"backend {target.backend.name!r}: {reason}")


def _listed(name: str, values: Any) -> list[Any]:
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        raise InvalidData(f"{name} must be a list of numbers, got {show(values)}", field=name)
    found = list(values)
    if not 0 < len(found) <= MOST:
        raise InvalidData(f"{name} must hold 1 … {MOST} entries, got {len(found)}", field=name)
    return found


def _limits(values: Any, least: float) -> list[float]:
    """Return the limits from large to small, each once, as multiples of `least`."""
    listed = _listed("limits", values)
    limits = {Real(lower=0).coerce(f"limits[{k}]", one, {}) for k, one in enumerate(listed)}
    return sorted({_rounded(limit, least) for limit in limits}, reverse=True)


def _proves(solution: Solution[Any], gap: float | None) -> bool:
    """Return whether the objective is proven to be the least, up to `gap`."""
    if solution.termination is not Termination.OPTIMAL or solution.gap is None:
        return False
    return solution.gap <= (GAP if gap is None else gap) + EQUAL
