"""What a conformance case is, and how an answer is judged: by computing again, not by trust."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.programs.base import BlockProgram, RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Answer, Feature, Limit, Request, Termination
from ..refinement import proven_bound
from ..solution import without_rounding

__all__ = [
    "Case",
    "Expectation",
    "Run",
    "Table",
    "asked_for",
    "bounds",
    "ended",
    "optimum",
    "tabled",
    "unsolvable",
]

#: Relative slack of every comparison with a known value: solvers work to 1e-6 at best.
SLACK = 1e-6
#: The same for a bound and a point that a limit left unfinished: it holds to the tolerance only, and
#: its objective gains the violations times their multipliers (measured: up to 8e-6).
UNFINISHED = 1e-4
#: Seconds that a solver may need beyond its time limit or a stop, on a busy machine.
GRACE = 3.0

#: Largest reduced cost, relative to the objective's gradient, that a local optimum may leave.
STATIONARY = 1e-3
#: How a run ends that claims an optimum.
_OPTIMAL = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Expectation:
    """What is known of a case.

    Parameters
    ----------
    termination : tuple of Termination
        The right ends.
    objective : float, optional
        The optimum, where it is known and exists.
    best_known, floor : float, optional
        For programs nobody solves: the objective of a plan that exists, which no dual bound may
        exceed, and a proven lower bound, below which no plan may lie.
    point : tuple of float, optional
        The optimal column vector, where it is the only one.
    duals : tuple of float, optional
        The row multipliers, where they are the only ones.
    limit : Limit, optional
        The limit that must be named.
    through : bool
        Whether a fast solver may be through before the limit: it then names none.
    any_limit : bool
        Whether a limit on iterations may be named whatever else is expected.
    objectives : tuple of float
        The objectives of all local optima, where there are several.
    slack : float
        Relative slack of comparisons with the known objective.
    """

    termination: tuple[Termination, ...]
    objective: float | None = None
    best_known: float | None = None
    floor: float | None = None
    point: tuple[float, ...] | None = None
    duals: tuple[float, ...] | None = None
    limit: Limit | None = None
    through: bool = False
    any_limit: bool = False
    objectives: tuple[float, ...] = ()
    slack: float = SLACK


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a backend on a case, with what was seen from outside.

    Parameters
    ----------
    answer : Answer
        What the backend returned.
    request : Request
        What it was asked.
    features : frozenset of Feature
        What it declares.
    incumbents : tuple of (float, float, object)
        Seconds, objective and point of each incumbent reported.
    seconds, cpu : float
        Wall-clock and processor time of the run.
    others : tuple of Answer
        The answers to the case's other requests, one each.
    """

    answer: Answer
    request: Request
    features: frozenset[Feature]
    incumbents: tuple[tuple[float, float, Any], ...] = ()
    seconds: float = 0.0
    cpu: float = 0.0
    others: tuple[Answer, ...] = ()


@dataclass(frozen=True, eq=False)
class Case:
    """A small program of which everything that matters is known.

    Parameters
    ----------
    name : str
        What it tries.
    program : BlockProgram
        What is asked; its type decides which backends the case is for.
    expectation : Expectation
        What is known.
    needs : frozenset of Feature
        Features without which the case says nothing of a backend.
    arguments : mapping
        Arguments of the :class:`Request`.
    stop_after : float, optional
        Seconds after which the control asks the run to stop; 0 stops it before it starts.
    others : tuple of mapping
        What further requests change, each asked after the first; nothing, to ask the same again.
    further : callable, optional
        ``further(case, run)`` judges what only this case looks at.
    duals : bool
        Whether the multipliers of a backend that declares ``DUALS`` are judged as well.
    """

    name: str
    program: BlockProgram
    expectation: Expectation
    needs: frozenset[Feature] = frozenset()
    arguments: Mapping[str, Any] = field(default_factory=dict)
    stop_after: float | None = None
    others: tuple[Mapping[str, Any], ...] = ()
    further: Callable[[Case, Run], str | None] | None = None
    duals: bool = False

    def judge(self, run: Run) -> str | None:
        """Return why `run` fails the case, None when it passes."""
        for judge in (_termination, _point, _bounds, _duals, _time):
            reason = judge(self, run)
            if reason is not None:
                return reason
        return None if self.further is None else self.further(self, run)


def _slack(value: float, relative: float = SLACK) -> float:
    return relative * max(1.0, abs(value))


def _termination(case: Case, run: Run) -> str | None:
    answer, expected = run.answer, case.expectation
    if answer.termination not in expected.termination:
        allowed = " or ".join(expected.termination)
        return f"ended {answer.termination}, expected {allowed}; {answer.message}".rstrip("; ")
    if expected.through and answer.termination in _OPTIMAL and answer.limit is None:
        return None
    if expected.any_limit and answer.limit is Limit.ITERATIONS:
        return None
    if answer.limit is not expected.limit:
        return f"named the limit {answer.limit}, expected {expected.limit}"
    return None


def _point(case: Case, run: Run) -> str | None:
    answer, expected = run.answer, case.expectation
    has_plan = answer.termination in (*_OPTIMAL, Termination.FEASIBLE)
    if not has_plan:
        return None if answer.point is None else f"ended {answer.termination}, yet has a point"
    if answer.point is None or answer.primal_bound is None:
        return f"ended {answer.termination} without a point and its objective"
    point = np.asarray(answer.point, float)
    if point.shape != (case.program.size,):
        return f"the point has shape {point.shape}, expected ({case.program.size},)"
    found = case.program.verify(point, tolerance=run.request.tolerance)
    if not found.ok or found.objective is None:
        return f"the point fails verification: {found.summary()}"
    value = found.objective
    if abs(value - answer.primal_bound) > _slack(value):
        return f"claims the objective {answer.primal_bound!r}, its point has {value!r}"
    least = expected.objective if expected.objective is not None else expected.floor
    ended = answer.termination in _OPTIMAL
    slack = expected.slack if ended else max(UNFINISHED, expected.slack)
    if least is not None and value < least - _slack(least, slack):
        return f"the point has the objective {value!r}, below the proven bound {least!r}"
    if not ended:
        return None
    local = answer.termination is Termination.LOCALLY_OPTIMAL
    optima = expected.objectives if local else ()
    if not optima and expected.objective is not None:
        optima = (expected.objective,)
    gap = run.request.gap * abs(value)
    if optima and not any(abs(value - one) <= gap + _slack(one, expected.slack) for one in optima):
        return f"called {value!r} {answer.termination}, known are {list(optima)}"
    if expected.point is not None and not _near(case.program, point, expected):
        return f"found {point.tolist()}, the only optimum is {list(expected.point)}"
    return None


def _near(program: BlockProgram, point: Vector, expected: Expectation) -> bool:
    """Whether `point` is the one expected, as far as its objective's slack decides it."""
    size = program.column_scale if isinstance(program, NonlinearProgram) else 1.0
    # Where the objective is known to s, a point of a curved one is known to the root of s.
    flat = isinstance(program, RowProgram) and not isinstance(program, ConicProgram)
    allowed = 1e-5 if flat else max(np.sqrt(expected.slack), 1e-5)
    return bool((np.abs(point - np.asarray(expected.point)) <= allowed * size).all())


def _bounds(case: Case, run: Run) -> str | None:
    answer, expected = run.answer, case.expectation
    bound = answer.dual_bound
    known = expected.objective if expected.objective is not None else expected.best_known
    if bound is not None:
        if not np.isfinite(bound):
            return f"the dual bound is {bound!r}; None says that there is none"
        if Feature.DUAL_BOUND not in run.features:
            return "claims a dual bound without declaring the feature"
        if answer.termination in (Termination.INFEASIBLE, Termination.UNBOUNDED):
            return f"ended {answer.termination}, yet claims a dual bound"
        if known is not None and bound > known + _slack(known):
            return f"claims the dual bound {bound!r}, yet a plan has {known!r}"
    proven = proven_bound(case.program, answer)
    if proven is not None and answer.point is not None:
        found = case.program.verify(
            np.asarray(answer.point, float), tolerance=run.request.tolerance
        )
        left = without_rounding(proven, found, run.request.tolerance)
        if found.objective is not None and left > found.objective:
            return f"proves the bound {proven!r}, above its own point's {found.objective!r}"
    if answer.termination is Termination.OPTIMAL and Feature.DUAL_BOUND in run.features:
        if bound is None or answer.primal_bound is None:
            return "ended optimal without a dual bound"
        gap = (answer.primal_bound - bound) / max(abs(answer.primal_bound), 1.0)
        if gap > run.request.gap + SLACK:
            return f"ended optimal with a gap of {gap:.3g}, asked for {run.request.gap:g}"
    return None


def _duals(case: Case, run: Run) -> str | None:
    answer, program, expected = run.answer, case.program, case.expectation
    declared = Feature.DUALS in run.features
    if not (case.duals and declared and answer.termination in _OPTIMAL):
        return None
    if answer.duals is None:
        return "declares duals, returned none"
    duals = np.asarray(answer.duals, float)
    rows = program.row_count
    if isinstance(program, ConicProgram):
        rows += program.cone_offset.size
    if duals.shape != (rows,):
        return f"the duals have shape {duals.shape}, expected ({rows},)"
    if isinstance(program, NonlinearProgram):
        return _multipliers(program, duals, answer, expected)
    optimum = expected.objective
    bound = program.dual_bound(duals, np.asarray(answer.point, float))
    if optimum is not None and not abs(bound - optimum) <= _slack(optimum):
        return f"the duals {duals.tolist()} prove the bound {bound!r}, the optimum is {optimum!r}"
    if expected.duals is not None and not np.allclose(duals, expected.duals, rtol=0, atol=1e-5):
        return f"the duals are {duals.tolist()}, the only ones are {list(expected.duals)}"
    return None


def _multipliers(
    program: NonlinearProgram, duals: Vector, answer: Answer, expected: Expectation
) -> str | None:
    """Return what is wrong with the multipliers of a local optimum."""
    point = np.asarray(answer.point, float)
    unit = float(np.abs(program.gradient(point) * program.column_scale).max(initial=0.0))
    left = program.stationarity(point, duals) / max(1.0, unit / program.objective_scale)
    if not left <= STATIONARY:
        return f"the duals {duals.tolist()} leave a reduced cost of {left:.2g} unexplained"
    rows = program.values(point)[1]
    slack = np.where(duals > 0, rows - program.row_lower, program.row_upper - rows)
    with np.errstate(invalid="ignore"):
        idle = np.where(duals == 0, 0.0, np.abs(duals) * slack) / program.objective_scale
    if not (idle <= STATIONARY).all():
        row = program.row_name(int(idle.argmax()))
        return f"the dual of {row} is not zero, or of the wrong sign, where the row does not bind"
    if expected.duals is not None:
        sizes = program.row_scale / program.objective_scale
        if not (np.abs(duals - np.asarray(expected.duals)) * sizes <= STATIONARY).all():
            return f"the duals are {duals.tolist()}, the only ones are {list(expected.duals)}"
    return None


def _time(case: Case, run: Run) -> str | None:
    limits = [v for v in (run.request.time_limit, case.stop_after) if v is not None]
    if limits and run.seconds > min(limits) + GRACE:
        return f"took {run.seconds:.2f} s, was to stop after {min(limits):g} s"
    negative = {part: s for part, s in run.answer.seconds.items() if not s >= 0}
    return f"counts negative seconds: {negative}" if negative else None


def optimum(
    objective: float,
    point: tuple[float, ...] | None = None,
    duals: tuple[float, ...] | None = None,
) -> Expectation:
    """Return what is expected where the optimum is known and must be proven."""
    return Expectation((Termination.OPTIMAL,), objective, point=point, duals=duals)


def bounds(
    rows: int,
    columns: int,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
) -> dict[str, Any]:
    """Return the bounds of a program by the names of its fields; those given once count for all."""
    given = {
        "row_lower": (row_lower, rows),
        "row_upper": (row_upper, rows),
        "column_lower": (lower, columns),
        "column_upper": (upper, columns),
    }
    return {
        name: np.broadcast_to(np.asarray(value, float), (size,)).copy()
        for name, (value, size) in given.items()
    }


#: Programs by name, each with what is known of it.
Table = Mapping[str, tuple[BlockProgram, Expectation]]
#: The feature without which a backend does not take an argument of the request.
_NEEDS = {
    "cutoff": Feature.CUTOFF,
    "gap": Feature.GAP,
    "seed": Feature.SEED,
    "warm_start": Feature.WARM_START,
}


def tabled(kind: str, table: Table, **others: Any) -> list[Case]:
    """Return a case for each entry of `table`, its name after `kind`, with `others` of its fields."""
    return [Case(f"{kind}{name}", *known, **others) for name, known in table.items()]


def ended(
    kind: str, programs: Mapping[str, BlockProgram], *termination: Termination, **known: Any
) -> list[Case]:
    """Return a case for each of `programs`, of which the right ends are known, and `known`."""
    expected = Expectation(termination, **known)
    return tabled(kind, {name: (program, expected) for name, program in programs.items()})


def unsolvable(
    kind: str, infeasible: Mapping[str, BlockProgram], unbounded: Mapping[str, BlockProgram]
) -> list[Case]:
    """Return a case for each program, which must be proven to have no solution."""
    return [
        *ended(kind, infeasible, Termination.INFEASIBLE),
        *ended(kind, unbounded, Termination.UNBOUNDED),
    ]


def asked_for(
    kind: str,
    program: BlockProgram,
    known: Expectation,
    requests: Mapping[str, Mapping[str, Any]],
    **others: Any,
) -> list[Case]:
    """Return a case for each of `requests`: by name, the arguments with which `program` is asked."""
    return [
        Case(
            f"{kind}{name}",
            program,
            known,
            frozenset(_NEEDS[key] for key in arguments if key in _NEEDS),
            arguments,
            **others,
        )
        for name, arguments in requests.items()
    ]
