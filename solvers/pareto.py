"""The verb :func:`front`: what must be given of one objective for how much of another."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import InvalidData, UnknownName, UnsupportedFormulation
from ..models.fields import Real, Whole, show
from ..models.model import Model, as_model
from ..models.records import given
from .backend import Backend, Limit, Termination
from .campaign import Record
from .dispatch import run_job
from .job import GAP, Job
from .report.tables import FittedTable, markup, number, render, seconds_text, table
from .solution import Solution

__all__ = ["Front", "FrontPoint", "front", "sweep"]

#: Points of a front where no limits are given, and the most that are allowed.
POINTS, MOST = 10, 10_000
#: By how much a limit is less than what the last plan has, relative to the first plan's: at first, and
#: at the least. Halved where no plan is found.
STEP, FINEST = 0.05, 1e-3
#: What counts as equal, relative.
EQUAL = 1e-9


@dataclass(frozen=True)
class FrontPoint:
    """One plan of a front.

    Parameters
    ----------
    objective : float
        The model's objective, or the first of two that a sweep compares.
    second : float
        The second objective.
    limit : float, optional
        The limit on the second objective under which the plan was sought; None for none. In a sweep
        the value of the field.
    solution : Solution
        The verified answer.
    proven : bool
        Whether the objective is proven to be the least within the limit, up to the gap asked for.
    """

    objective: float
    second: float
    limit: float | None
    solution: Solution[Any] = field(repr=False)
    proven: bool

    def dominates(self, other: FrontPoint) -> bool:
        """Return whether this is no worse in either objective, and better in one."""
        slack = EQUAL * max(abs(self.objective), abs(other.objective))
        room = EQUAL * max(abs(self.second), abs(other.second))
        no_worse = self.objective <= other.objective + slack and self.second <= other.second + room
        return no_worse and (
            self.objective < other.objective - slack or self.second < other.second - room
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the point as JSON data."""
        return {
            "objective": self.objective,
            "second": self.second,
            "limit": self.limit,
            "proven": self.proven,
            "solution": self.solution.to_dict(),
        }


@dataclass(frozen=True)
class Front:
    """What :func:`front` found; printed, a table.

    Parameters
    ----------
    model : Model
        What was asked.
    second : str
        The second objective.
    points : tuple of FrontPoint
        Plans of which none dominates another, by the second objective from large to small.
    dominated : tuple of FrontPoint
        Plans that were found and are dominated.
    unsolved : tuple of Solution
        How the runs under the other limits ended, without a plan.
    field : str
        The field that was limited, or varied by a sweep.
    interrupted : bool
        Whether Ctrl-C ended it; what had been found is there.
    """

    model: Model[Any]
    second: str
    points: tuple[FrontPoint, ...]
    dominated: tuple[FrontPoint, ...] = ()
    unsolved: tuple[Solution[Any], ...] = ()
    field: str = ""
    interrupted: bool = False

    @property
    def solutions(self) -> tuple[Solution[Any], ...]:
        """The answers of all points."""
        return tuple(point.solution for point in self.points)

    def to_dict(self) -> dict[str, Any]:
        """Return the front as JSON data."""
        return {
            "model": self.model.kind,
            "instance": self.model.name,
            "digest": self.model.digest,
            "second": self.second,
            "field": self.field,
            "points": [point.to_dict() for point in self.points],
            "dominated": [point.to_dict() for point in self.dominated],
            "unsolved": [solution.to_dict() for solution in self.unsolved],
            "interrupted": self.interrupted,
        }

    def parts(self) -> list[Any]:
        """Return what to print: the points, and how the other runs ended."""
        shown = sorted(
            [*((one, "") for one in self.points), *((one, "dominated") for one in self.dominated)],
            key=lambda pair: (-pair[0].second, pair[0].objective),
        )
        title = f"{self.model.name or self.model.kind}: objective and {self.second}"
        parts: list[Any] = [_table(title, self.field, self.second, shown)]
        for one in self.unsolved:
            parts.append(
                f"{one.instance}: {one.termination}{f', {one.limit}' if one.limit else ''}"
            )
        if self.interrupted:
            parts.append("interrupted: what is missing was not run")
        return parts

    def summary(self) -> str:
        """Return the points as a table of text."""
        return render(*self.parts(), width=140)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return markup(*self.parts())


def _table(
    title: str, name: str, second: str, rows: Iterable[tuple[FrontPoint, str]]
) -> FittedTable:
    cells = [
        (
            "" if one.limit is None else number(one.limit),
            number(one.objective),
            number(one.second),
            ""
            if one.solution.gap is None
            else f"{one.solution.gap:.1e}"
            if one.solution.gap
            else "0",
            one.solution.backend,
            seconds_text(one.solution.seconds.get("total")),
            ", ".join(word for word in ("proven" if one.proven else "", state) if word),
        )
        for one, state in rows
    ]
    columns = (name, "objective", second, "gap", "backend", "total", "state")
    return table(title, columns, cells, right=(name, "objective", second, "gap", "total"))


def front(
    model: Model[Any],
    second: str,
    *,
    backend: str | Backend = "auto",
    limits: Iterable[float] | None = None,
    points: int = POINTS,
    step: float = STEP,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    time_limit: float | None = 60.0,
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
    points : int
        Runs at the most, where no limits are given.
    step : float
        Relative to what the first plan has of the second objective. What lies within a step may be
        missed; a step of 1e-6 finds all there is, where the backend is exact.
    time_limit : float, optional
        Seconds for each run.
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
        The model declares no second objective.
    UnknownName
        It declares none of this name.
    InvalidData
        Limits that are no finite numbers >= 0, or a record that exists or cannot be written.

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
    chosen = None if limits is None else _limits(limits)
    most = Whole(1, MOST).coerce("points", points, {})
    width = Real(lower=0, strict=True, upper=1).coerce("step", step, {})
    ask = partial(
        Job,
        backend=backend, formulation=formulation,
        formulation_options=given("formulation_options", formulation_options),
        time_limit=time_limit, gap=gap, tolerance=tolerance, seed=seed, threads=threads,
        backend_options=given("backend_options", backend_options),
    )  # fmt: skip

    def limited(limit: float | None) -> Model[Any]:
        if limit is None:
            return model
        label = model.name or model.kind
        return model.limited(second, limit).renamed(f"{label}, {second} <= {limit:.10g}")

    with _Runs(record, resume, isolate, on_point) as runs:

        def solve(limit: float | None) -> Solution[Any]:
            return runs.solve(ask(model=limited(limit)))

        def value(solution: Solution[Any]) -> float:
            return model.second_objective(second, solution.plan)

        tried: list[tuple[float | None, Solution[Any]]] = []
        if chosen is not None:
            for limit in chosen:
                tried.append((limit, solve(limit)))
                if runs.interrupted:
                    break
        else:
            tried.append((None, solve(None)))
            _descend(tried, solve, value, most, width, runs)
    found = [
        FrontPoint(float(s.primal_bound), value(s), limit, s, _proves(s, gap))
        for limit, s in tried
        if s.plan is not None and s.primal_bound is not None
    ]
    return _made(model, second, field_name, found, [s for _, s in tried], runs.interrupted)


def _descend(
    tried: list[tuple[float | None, Solution[Any]]],
    solve: Callable[[float | None], Solution[Any]],
    value: Callable[[Solution[Any]], float],
    most: int,
    width: float,
    runs: _Runs,
) -> None:
    """Add runs under ever smaller limits to `tried`, which holds the one without."""
    first = tried[0][1]
    if first.plan is None:
        return
    now = whole = value(first)
    step, closed = width, -math.inf
    finest = min(FINEST, width)
    while len(tried) < most and not runs.interrupted and whole > 0:
        limit = now - step * whole
        if limit <= closed or limit < 0:
            # Below the least limit under which there was no plan there is none.
            step *= 0.5
            if step < finest:
                return
            continue
        solution = solve(limit)
        tried.append((limit, solution))
        if solution.plan is None:
            closed = limit
            step *= 0.5
            if step < finest:
                return
        else:
            # A plan that uses its tolerance up may have more than the limit.
            now = min(limit, value(solution))


def sweep(
    model: Model[Any],
    name: str,
    values: Iterable[Any],
    first: str,
    second: str,
    *,
    backend: str | Backend = "auto",
    time_limit: float | None = 60.0,
    seed: int | None = None,
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
    backend, time_limit, seed, backend_options, isolate, record, resume, on_point
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
    models = []
    for value in _listed("values", values):
        changed: dict[str, Any] = {name: value}
        models.append(
            (value, dataclasses.replace(model, **changed).renamed(f"{label}, {name} = {value}"))
        )
    found, answers = [], []
    with _Runs(record, resume, isolate, on_point) as runs:
        for value, one in models:
            solution = runs.solve(
                Job(
                    model=one, backend=backend, time_limit=time_limit, seed=seed,
                    backend_options=given("backend_options", backend_options),
                )
            )  # fmt: skip
            answers.append(solution)
            if solution.plan is not None:
                pair = (
                    model.second_objective(first, solution.plan),
                    model.second_objective(second, solution.plan),
                )
                number_ = float(value) if isinstance(value, int | float) else None
                found.append(FrontPoint(*pair, number_, solution, _proves(solution, None)))
            if runs.interrupted:
                break
    return _made(model, second, name, found, answers, runs.interrupted)


@dataclass
class _Runs:
    """Runs one after another, each added to a record where there is one."""

    record: str | Path | None
    resume: bool
    isolate: bool | None
    listener: Callable[[Solution[Any]], None] | None
    interrupted: bool = False

    def __enter__(self) -> _Runs:
        if self.resume and self.record is None:
            raise InvalidData("resume needs a record, got none", field="record")
        self._stack = contextlib.ExitStack()
        self._file = None
        if self.record is not None:
            self._file = self._stack.enter_context(Record(self.record, resume=self.resume))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def solve(self, job: Job) -> Solution[Any]:
        job = job.resolved()
        found = None if self._file is None else self._file.find(job, job.model)
        if found is None:
            found = run_job(job, self.isolate, None)
            self.interrupted = found.limit is Limit.INTERRUPTED
            if self._file is not None and not self.interrupted:
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


def _listed(name: str, values: Any) -> list[Any]:
    if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
        raise InvalidData(f"{name} must be a list of numbers, got {show(values)}", field=name)
    found = list(values)
    if not 0 < len(found) <= MOST:
        raise InvalidData(f"{name} must hold 1 … {MOST} entries, got {len(found)}", field=name)
    return found


def _limits(values: Any) -> list[float]:
    """Return the limits from large to small, each once."""
    listed = _listed("limits", values)
    return sorted(
        {Real(lower=0).coerce(f"limits[{k}]", one, {}) for k, one in enumerate(listed)},
        reverse=True,
    )


def _proves(solution: Solution[Any], gap: float | None) -> bool:
    """Return whether the objective is proven to be the least, up to `gap`."""
    if solution.termination is not Termination.OPTIMAL or solution.gap is None:
        return False
    return solution.gap <= (GAP if gap is None else gap) + EQUAL


def _made(
    model: Model[Any], second: str, name: str, found: list[FrontPoint], answers: list[Solution[Any]],
    interrupted: bool,
) -> Front:  # fmt: skip
    """Return the front of all plans that were found."""
    kept: list[FrontPoint] = []
    removed: list[FrontPoint] = []
    ordered = sorted(found, key=lambda one: (-one.second, one.objective))
    for k, one in enumerate(ordered):
        same = any(
            not (one.dominates(other) or other.dominates(one))
            and math.isclose(one.objective, other.objective, rel_tol=EQUAL)
            and math.isclose(one.second, other.second, rel_tol=EQUAL)
            for other in ordered[:k]
        )
        worse = any(other.dominates(one) for other in ordered)
        (removed if worse or same else kept).append(one)
    unsolved = tuple(one for one in answers if one.plan is None)
    return Front(model, second, tuple(kept), tuple(removed), unsolved, name, interrupted)
