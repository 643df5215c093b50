"""Tools shared by the backends for programs: clock, stop requests and the ending of a solver run.

A backend translates between a program and its solver. The base class of its kind
(:mod:`.mip.base`, :mod:`.qp.base`) decides what the ending of the solver proves.
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

from ...models.programs.base import RowProgram
from ..contract.backend import Answer, Control, Limit, Request, Termination

__all__ = [
    "Clock",
    "Ended",
    "Ending",
    "above_cutoff",
    "ending_if_stopped",
    "forward_stop",
    "is_satisfied",
    "limit_reached",
    "loosened_cutoff",
    "solver_options",
    "solver_tolerance",
    "stop_reason",
    "trivial_ending",
]

Vector = NDArray[np.float64]

#: Relative margin added to a cutoff, so that the plan it comes from stays feasible. Solvers compare
#: objectives with tolerances of their own: with 1e-9, SCIP lost the plan.
LOOSENED = 1e-6
#: Seconds between two checks for a stop request.
POLL = 0.02


class Ended(StrEnum):
    """Status of a solver at the end of its run, before proofs are checked."""

    #: The solver claims an optimum within the gap.
    PROVEN = "proven"
    #: The solver claims that no point satisfies the rows.
    INFEASIBLE = "infeasible"
    #: The solver claims that the objective is unbounded below.
    UNBOUNDED = "unbounded"
    #: The solver claims one of the two without distinguishing them, as presolve often does.
    UNCLEAR = "infeasible or unbounded"
    #: The solver reached a limit or followed a stop request; its point may be usable.
    STOPPED = "stopped"
    #: The solver raised an error or returned a point that it does not guarantee.
    FAILED = "failed"


@dataclass(frozen=True)
class Ending:
    """Report of a solver about one run.

    Parameters
    ----------
    ended : Ended
        Status of the solver; ``PROVEN`` is an optimum within the gap.
    point : ndarray, optional
        Best column vector, shape (columns,). For ``UNBOUNDED``, a direction of recession if the
        solver returns one.
    bound : float, optional
        Lower bound on the objective; None or infinite if the solver has none.
    duals : ndarray, optional
        Row multipliers, with the signs of the program's ``dual_bound``. For ``INFEASIBLE``, a
        certificate of infeasibility.
    limit : Limit, optional
        The limit that stopped the solver, for ``STOPPED``.
    statistics : mapping
        Counts of the solver, such as iterations.
    message : str
        Status text of the solver that the user should see.
    absolute : bool
        Whether ``INFEASIBLE`` was proven without using the cutoff.
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
        """Return the ending for a solver's `status`; an unknown status gives ``FAILED``, with `solver` in its message.

        Each known status means an :class:`Ended`, or a pair (:class:`Ended`, :class:`Limit`). `words` is the text of a
        status that is a number, and `parts` are other fields.
        """
        meaning = meanings.get(status, Ended.FAILED)
        ended, limit = meaning if isinstance(meaning, tuple) else (meaning, None)
        message = f"{solver}: {status if words is None else words}"
        return cls(ended, limit=limit, message=message if ended is Ended.FAILED else "", **parts)


#: Ending that a status of a solver means, with the limit if the status names one.
Meaning = Ended | tuple[Ended, Limit | None]


class Clock:
    """Stopwatch of a run: seconds left of the time limit (s, or None), and `seconds` per part, see :meth:`lap`."""

    def __init__(self, limit: float | None) -> None:
        self._limit = limit
        self._started = self._mark = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def left(self) -> float | None:
        """Return the seconds left, at least 0; None if the run has no time limit."""
        passed = time.perf_counter() - self._started
        return None if self._limit is None else max(self._limit - passed, 0.0)

    def lap(self, part: str) -> None:
        """Add the seconds since the previous lap to `part`."""
        now = time.perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._mark
        self._mark = now


def loosened_cutoff(cutoff: float) -> float:
    """Return `cutoff` plus a relative margin, so that the plan it comes from stays feasible."""
    return cutoff + LOOSENED * max(1.0, abs(cutoff))


def solver_tolerance(
    request: Request, least: float, most: float = 1e-3, *, share: float = 1.0
) -> float:
    """Return a tenth of the tolerance times `share`, clipped to the range that the solver accepts.

    Solvers measure violations in a scaled space and before postsolve, so that a point at the limit of the full
    tolerance would fail the verification. `share` is for solvers that need more digits than the request.
    """
    return float(min(max(request.tolerance * share / 10, least), most))


def stop_reason(control: Control, otherwise: Limit = Limit.INTERRUPTED) -> Limit:
    """Return the limit that stopped a run: the control's reason if it has one, else `otherwise`."""
    return control.reason if control.stopped and control.reason is not None else otherwise


@contextmanager
def forward_stop(control: Control, stop: Callable[[], Any]) -> Iterator[None]:
    """Call `stop` repeatedly from a thread once the control requests a stop, until the block ends.

    The solver must release the interpreter's lock, and `stop` must be thread-safe.
    """
    ended = threading.Event()

    def watch() -> None:
        # Most solvers ignore a stop request that arrives before they have started.
        while not ended.wait(POLL):
            if control.stopped:
                stop()

    thread = threading.Thread(target=watch, name="crosstrack-stop", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def limit_reached(request: Request, clock: Clock) -> Limit | None:
    """Return the limit that ends the run now; None if the run may continue."""
    if request.control.stopped:
        return stop_reason(request.control)
    return Limit.TIME if clock.left() == 0.0 else None


def ending_if_stopped(request: Request, clock: Clock) -> Ending | None:
    """Return the ending of a run that must stop now; None if the run may continue."""
    limit = limit_reached(request, clock)
    return None if limit is None else Ending(Ended.STOPPED, limit=limit)


def solver_options(request: Request, *without: str) -> dict[str, Any]:
    """Return the backend's options that are passed to its solver: those that are not None.

    ``polish`` is omitted, because :mod:`.qp.polishing` handles it after the solver.
    """
    given = ((name, value) for name, value in request.options.items() if value is not None)
    return {name: value for name, value in given if name not in ("polish", *without)}


def trivial_ending(program: RowProgram, request: Request) -> Ending | None:
    """Return the ending of a trivial program, which some solvers reject as malformed; else None."""
    for lower, upper, name in (
        (program.column_lower, program.column_upper, program.column_name),
        (program.row_lower, program.row_upper, program.row_name),
    ):
        crossed = np.flatnonzero(lower > upper)
        if crossed.size:
            k = int(crossed[0])
            message = f"{name(k)}: the lower bound {lower[k]:g} exceeds the upper {upper[k]:g}"
            return Ending(Ended.INFEASIBLE, message=message, absolute=True)
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
    """Return the answer of a search below `cutoff` that found no plan: the cutoff is a dual bound."""
    return replace(
        answer,
        termination=Termination.NO_SOLUTION,
        point=None,
        primal_bound=None,
        duals=None,
        dual_bound=cutoff,
        message="no plan better than the cutoff",
    )


def is_satisfied(program: RowProgram, point: Vector, tolerance: float) -> bool:
    """Return True if `point` is finite and satisfies `program` within `tolerance`."""
    return bool(np.isfinite(point).all()) and program.verify(point, tolerance=tolerance).ok
