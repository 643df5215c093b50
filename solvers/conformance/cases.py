"""Conformance cases, and the judgement of an answer by recomputation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.programs.base import BlockProgram, RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Answer, Feature, Limit, Request, Termination
from ..contract.solution import without_rounding
from ..run.running import proven_bound

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

#: Relative slack of comparisons with a known value. Solvers reach 1e-6 at best.
SLACK = 1e-6
#: The same for a bound and a point of an unfinished run. The point satisfies its rows only up to the
#: tolerance, so its objective gains the violations times their multipliers (up to 8e-6).
UNFINISHED = 1e-4
#: Seconds of the processor that a solver may need after its time limit or a stop request, and further seconds
#: of the clock, because a busy machine runs other processes.
GRACE, PATIENCE = 3.0, 30.0

#: Largest reduced cost of a local optimum, relative to the gradient of the objective.
STATIONARY = 1e-3
#: Terminations that claim an optimum.
_OPTIMAL = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Expectation:
    """Known facts about a case.

    Parameters
    ----------
    termination : tuple of Termination
        Correct terminations.
    objective : float, optional
        Optimal objective, if it is known and exists.
    best_known, floor : float, optional
        For programs without a known optimum: the objective of a known plan, which no dual bound may
        exceed, and a proven lower bound on the objective of all plans.
    point : tuple of float, optional
        Optimal column vector, if it is unique.
    duals : tuple of float, optional
        Row multipliers, if they are unique.
    limit : Limit, optional
        Limit that must be named.
    through : bool
        Whether a fast solver may finish before the limit, which it then must not name.
    any_limit : bool
        Whether a limit on iterations is also accepted.
    objectives : tuple of float
        Objectives of all local optima, if there are several.
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
    """One run of a backend on a case, with external measurements.

    Parameters
    ----------
    answer : Answer
        Answer of the backend.
    request : Request
        The request.
    features : frozenset of Feature
        Features that the backend declares.
    incumbents : tuple of (float, float, object)
        Seconds, objective and point of each reported incumbent.
    seconds, cpu : float
        Wall-clock and processor time of the run.
    others : tuple of Answer
        Answers to the further requests of the case.
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
    """Small program with known properties.

    Parameters
    ----------
    name : str
        Property that is tested.
    program : BlockProgram
        The program, whose type determines the backends that run the case.
    expectation : Expectation
        Known facts.
    needs : frozenset of Feature
        Features that a backend must declare for the case to apply.
    arguments : mapping
        Arguments of the :class:`Request`.
    stop_after : float, optional
        Seconds after which the control requests a stop; 0 requests it before the start.
    others : tuple of mapping
        Changed arguments of further requests; an empty mapping repeats the first one.
    further : callable, optional
        Function ``further(case, run)`` with a judgement specific to this case.
    duals : bool
        Whether to judge the multipliers of backends that declare ``DUALS``.
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
        """Return the reason why `run` fails the case; None if it passes.

        Parameters
        ----------
        run : Run
            A run of this case.
        """
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
    verification = case.program.verify(point, tolerance=run.request.tolerance)
    if not verification.ok or verification.objective is None:
        return f"the point fails verification: {verification.summary()}"
    value = verification.objective
    if abs(value - answer.primal_bound) > _slack(value):
        return f"claims the objective {answer.primal_bound!r}, its point has {value!r}"
    lower = expected.objective if expected.objective is not None else expected.floor
    ended = answer.termination in _OPTIMAL
    slack = expected.slack if ended else max(UNFINISHED, expected.slack)
    if lower is not None and value < lower - _slack(lower, slack):
        return f"the point has the objective {value!r}, below the proven bound {lower!r}"
    if not ended:
        return None
    local = answer.termination is Termination.LOCALLY_OPTIMAL
    optima = expected.objectives if local else ()
    if not optima and expected.objective is not None:
        optima = (expected.objective,)
    gap = run.request.gap * abs(value)
    if optima and not any(
        abs(value - known) <= gap + _slack(known, expected.slack) for known in optima
    ):
        return f"called {value!r} {answer.termination}, known are {list(optima)}"
    if expected.point is not None and not _near(case.program, point, expected):
        return f"found {point.tolist()}, the only optimum is {list(expected.point)}"
    return None


def _near(program: BlockProgram, point: Vector, expected: Expectation) -> bool:
    """Return True if `point` is the expected one, within the precision that the objective's slack allows."""
    size = program.column_scale if isinstance(program, NonlinearProgram) else 1.0
    # If a curved objective is known up to s, its optimal point is known up to sqrt(s).
    flat = isinstance(program, RowProgram) and not isinstance(program, ConicProgram)
    allowed = 1e-5 if flat else max(np.sqrt(expected.slack), 1e-5)
    return bool((np.abs(point - np.asarray(expected.point)) <= allowed * size).all())


def _bounds(case: Case, run: Run) -> str | None:
    answer, expected = run.answer, case.expectation
    bound = answer.dual_bound
    known = expected.objective if expected.objective is not None else expected.best_known
    if bound is not None:
        if not np.isfinite(bound):
            return f"the dual bound is {bound!r}; use None for no bound"
        if Feature.DUAL_BOUND not in run.features:
            return "claims a dual bound without declaring the feature"
        if answer.termination in (Termination.INFEASIBLE, Termination.UNBOUNDED):
            return f"ended {answer.termination}, yet claims a dual bound"
        if known is not None and bound > known + _slack(known):
            return f"claims the dual bound {bound!r}, yet a plan has {known!r}"
    proven = proven_bound(case.program, answer)
    if proven is not None and answer.point is not None:
        verification = case.program.verify(
            np.asarray(answer.point, float), tolerance=run.request.tolerance
        )
        rounded = without_rounding(proven, verification, run.request.tolerance)
        if verification.objective is not None and rounded > verification.objective:
            return f"proves the bound {proven!r}, above its own point's {verification.objective!r}"
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
    """Return the fault of the multipliers of a local optimum; None if they are correct."""
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
        return f"the dual of {row} is nonzero or has the wrong sign although the row does not bind"
    if expected.duals is not None:
        sizes = program.row_scale / program.objective_scale
        if not (np.abs(duals - np.asarray(expected.duals)) * sizes <= STATIONARY).all():
            return f"the duals are {duals.tolist()}, the only ones are {list(expected.duals)}"
    return None


def _time(case: Case, run: Run) -> str | None:
    limits = [v for v in (run.request.time_limit, case.stop_after) if v is not None]
    if limits and min(run.seconds, max(run.cpu, run.seconds - PATIENCE)) > min(limits) + GRACE:
        return f"took {run.seconds:.2f} s, was to stop after {min(limits):g} s"
    negative = {part: s for part, s in run.answer.seconds.items() if not s >= 0}
    return f"counts negative seconds: {negative}" if negative else None


def optimum(
    objective: float,
    point: tuple[float, ...] | None = None,
    duals: tuple[float, ...] | None = None,
) -> Expectation:
    """Return the expectation of a known optimum that must be proven; `point` and `duals` are given if unique."""
    return Expectation((Termination.OPTIMAL,), objective, point=point, duals=duals)


def bounds(
    rows: int,
    columns: int,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
) -> dict[str, Any]:
    """Return the bounds of a program with so many rows and columns by field name, with scalars broadcast."""
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


#: Programs with their expectations, by name.
Table = Mapping[str, tuple[BlockProgram, Expectation]]
#: Feature that a backend needs to accept an argument of the request.
_NEEDS = {
    "cutoff": Feature.CUTOFF,
    "gap": Feature.GAP,
    "seed": Feature.SEED,
    "warm_start": Feature.WARM_START,
}


def tabled(kind: str, table: Table, **others: Any) -> list[Case]:
    """Return one case per entry of `table`, with the prefix `kind` and further fields of :class:`Case`."""
    return [Case(f"{kind}{name}", *known, **others) for name, known in table.items()]


def ended(
    kind: str, programs: Mapping[str, BlockProgram], *termination: Termination, **known: Any
) -> list[Case]:
    """Return one case per program, with common correct terminations and other fields of :class:`Expectation`."""
    expected = Expectation(termination, **known)
    return tabled(kind, {name: (program, expected) for name, program in programs.items()})


def unsolvable(
    kind: str, infeasible: Mapping[str, BlockProgram], unbounded: Mapping[str, BlockProgram]
) -> list[Case]:
    """Return one case per program, which must be proven infeasible or unbounded; `kind` is a prefix of names."""
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
    """Return one case per request (arguments by name) for the same program; `others` are fields of the cases."""
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
