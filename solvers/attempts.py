"""What every backend for programs shares: the clock, the stop, and how a solver's run ended.

A backend only translates; what its solver's end proves is decided by the base class of its kind
(:mod:`.mip.base`, :mod:`.qp.base`) in terms of what stands here.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..models.programs.base import RowProgram
from .backend import Answer, Control, Limit, Request, Termination

__all__ = [
    "Clock",
    "Ended",
    "Ending",
    "above_cutoff",
    "allowed",
    "holds",
    "limited",
    "obvious",
    "over",
    "own_options",
    "solver_tolerance",
    "stopped",
    "watched",
]

Vector = NDArray[np.float64]

#: How far, relatively, a cutoff is loosened, so that the plan it stems from stays allowed: solvers
#: compare objectives with tolerances of their own, and 1e-9 was seen to lose the plan in SCIP.
LOOSENED = 1e-6
#: Seconds between two looks at a stop request.
POLL = 0.02


class Ended(StrEnum):
    """How a solver ended, before anybody asks what that proves."""

    #: With an optimum within the gap.
    PROVEN = "proven"
    #: With a claim that no point satisfies the rows.
    INFEASIBLE = "infeasible"
    #: With a claim that the objective falls without end.
    UNBOUNDED = "unbounded"
    #: With a claim of one of both; presolve does not say which.
    UNCLEAR = "infeasible or unbounded"
    #: At a limit, or because it was asked to.
    STOPPED = "stopped"
    #: With an error, or with a point that it does not vouch for.
    FAILED = "failed"


@dataclass(frozen=True)
class Ending:
    """What a solver reports of one run.

    Parameters
    ----------
    ended : Ended
        Its status; ``PROVEN`` is an optimum within the gap.
    point : ndarray, optional
        Its best column vector; of an ``UNBOUNDED`` end, a direction along which the objective should
        fall forever, where it gives one.
    bound : float, optional
        Its lower bound on the objective; None or infinite where it has none.
    duals : ndarray, optional
        Row multipliers, signed as the program's ``dual_bound`` wants them; of an ``INFEASIBLE`` end,
        those that should prove it.
    limit : Limit, optional
        What stopped it, for ``STOPPED``.
    statistics : mapping
        Its counts.
    message : str
        Its own status, where a person should see it.
    absolute : bool
        Whether ``INFEASIBLE`` was proven without the cutoff.
    """

    ended: Ended
    point: Vector | None = None
    bound: float | None = None
    duals: Vector | None = None
    limit: Limit | None = None
    statistics: Mapping[str, float | int | str] = field(default_factory=dict)
    message: str = ""
    absolute: bool = False

    @classmethod
    def read(
        cls,
        solver: str,
        status: Any,
        meanings: Mapping[Any, Meaning],
        words: Any = None,
        **parts: Any,
    ) -> Ending:
        """Return the end that `status` means, with `parts`; ``FAILED`` with its words where it means none.

        Parameters
        ----------
        solver : str
            The solver's name, for the message of a failure.
        status : object
            What the solver returned.
        meanings : mapping
            What each of its statuses means; an :class:`Ended` alone, or with the limit named.
        words : object, optional
            The status for people, where it is a number.
        **parts
            Other fields of the ending.
        """
        meaning = meanings.get(status, Ended.FAILED)
        ended, limit = meaning if isinstance(meaning, tuple) else (meaning, None)
        message = f"{solver}: {status if words is None else words}"
        return cls(ended, limit=limit, message=message if ended is Ended.FAILED else "", **parts)


#: How a status ends a run, and the limit that it names, if any.
Meaning = Ended | tuple[Ended, Limit | None]


class Clock:
    """Counts the seconds of a run: what is left of the limit, and what each part took."""

    def __init__(self, limit: float | None) -> None:
        self._limit = limit
        self._started = self._mark = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def left(self) -> float | None:
        """Return the seconds left, at least 0; None where there is no limit."""
        if self._limit is None:
            return None
        return max(self._limit - (time.perf_counter() - self._started), 0.0)

    def lap(self, part: str) -> None:
        """Count the time since the last lap as `part`."""
        now = time.perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._mark
        self._mark = now


def allowed(cutoff: float) -> float:
    """Return `cutoff` loosened, so that its own plan stays allowed."""
    return cutoff + LOOSENED * max(1.0, abs(cutoff))


def solver_tolerance(tolerance: float, least: float, most: float = 1e-3) -> float:
    """Return the tolerance to give a solver, within the range it knows.

    A tenth of the request's: solvers measure in their own scaling and before postsolve, and what
    they let pass at the very edge would fail the verification.
    """
    return float(min(max(tolerance / 10, least), most))


def limited(control: Control, otherwise: Limit = Limit.INTERRUPTED) -> Limit:
    """Return the limit that stopped a run: the control's reason, else `otherwise`."""
    return control.reason if control.stopped and control.reason is not None else otherwise


@contextmanager
def watched(control: Control, stop: Callable[[], Any]) -> Iterator[None]:
    """Call `stop` from a thread once the control asks to, again and again until the run ends.

    Again, because most solvers forget a stop that reaches them before they have started. Needs a
    solver that releases the interpreter's lock, and a `stop` that any thread may call.
    """
    over = threading.Event()

    def watch() -> None:
        while not over.wait(POLL):
            if control.stopped:
                stop()

    thread = threading.Thread(target=watch, name="crosstrack-stop", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def over(request: Request, clock: Clock) -> Limit | None:
    """Return the limit that says stop, None while the run may go on."""
    if request.control.stopped:
        return limited(request.control)
    return Limit.TIME if clock.left() == 0.0 else None


def stopped(request: Request, clock: Clock) -> Ending | None:
    """Return the end of a run that may not go on, None while it may."""
    limit = over(request, clock)
    return None if limit is None else Ending(Ended.STOPPED, limit=limit)


def own_options(request: Request, *without: str) -> dict[str, Any]:
    """Return the backend's own options that go to its solver: those that have a value.

    ``polish`` is left out, which no solver knows: it is what :mod:`.qp.polishing` does afterwards.
    """
    skip = {"polish", *without}
    return {n: v for n, v in request.options.items() if n not in skip and v is not None}


def obvious(program: RowProgram, request: Request) -> Ending | None:
    """Answer what some solvers refuse as malformed: crossed bounds, no columns, empty rows."""
    for lower, upper, name in (
        (program.column_lower, program.column_upper, program.column_name),
        (program.row_lower, program.row_upper, program.row_name),
    ):
        crossed = np.flatnonzero(lower > upper)
        if crossed.size:
            at = int(crossed[0])
            return Ending(
                Ended.INFEASIBLE,
                message=f"{name(at)}: the lower bound {lower[at]:g} exceeds the upper {upper[at]:g}",
                absolute=True,
            )
    slack = request.tolerance
    wrong = (program.row_lower > slack) | (program.row_upper < -slack)
    wrong &= np.diff(program.matrix.indptr) == 0
    if wrong.any():
        row = program.row_name(int(np.flatnonzero(wrong)[0]))
        message = f"{row}: no column enters, and 0 does not satisfy it"
        return Ending(Ended.INFEASIBLE, message=message, absolute=True)
    if not program.size:
        return Ending(Ended.PROVEN, np.zeros(0), program.offset, np.zeros(program.row_count))
    return None


def above_cutoff(answer: Answer, cutoff: float) -> Answer:
    """Return what a search below the cutoff proves when it finds nothing: the cutoff is a bound."""
    return replace(
        answer,
        termination=Termination.NO_SOLUTION,
        point=None,
        primal_bound=None,
        duals=None,
        dual_bound=cutoff,
        message="no plan better than the cutoff",
    )


def holds(program: RowProgram, point: Vector, tolerance: float) -> bool:
    """Return whether `point` is finite and satisfies `program` within `tolerance`."""
    return bool(np.isfinite(point).all()) and program.verify(point, tolerance=tolerance).ok
