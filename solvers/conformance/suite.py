"""Run of a conformance case on a backend, and the matrix of results."""

from __future__ import annotations

import functools
import importlib.util
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from ...errors import UnknownName, UnsupportedFormulation, UnsupportedOption
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Answer, Backend, Control, Feature, Limit, Request
from ..contract.registry import fits_integrality, is_plain
from ..processes.output import captured
from .cases import Case, Run
from .conic import conic_cases
from .convex import conic_limit_cases, quadratic_limit_cases
from .integral import integer_nonlinear_cases, integer_quadratic_cases
from .limits import limit_cases
from .linear import linear_cases
from .mixed_integer import integer_cases
from .nonlinear import nonlinear_cases
from .quadratic import quadratic_cases

__all__ = ["CaseResult", "Matrix", "Status", "all_cases", "cases_for", "run_case"]


class Status(StrEnum):
    """Result of a backend in a case."""

    #: The answer is correct.
    PASS = "pass"
    #: The answer is wrong, or the backend raised an error.
    FAIL = "fail"
    #: The backend does not declare a feature that the case needs, so that nothing is tested.
    UNSUPPORTED = "unsupported"


@dataclass(frozen=True)
class CaseResult:
    """Result of one backend in one case.

    Parameters
    ----------
    backend, case : str
        Names of the backend and the case.
    status : Status
        ``UNSUPPORTED`` if the case does not apply to the backend, which is not a pass.
    reason : str
        Reason of a failure, or the missing feature.
    seconds : float
        Wall-clock time of the run.
    """

    backend: str
    case: str
    status: Status
    reason: str = ""
    seconds: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON data."""
        return {**asdict(self), "status": self.status.value}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CaseResult:
        """Return the result written by :meth:`to_dict`."""
        return cls(**{**data, "status": Status(data["status"])})


def all_cases() -> Mapping[str, Case]:
    """Return all cases by name; those of nonlinear programs only if CasADi is installed."""
    return {**_row_cases(), **_nonlinear_cases()}


@functools.cache
def _row_cases() -> Mapping[str, Case]:
    cases = (
        *linear_cases(),
        *integer_cases(),
        *limit_cases(),
        *quadratic_cases(),
        *quadratic_limit_cases(),
        *integer_quadratic_cases(),
        *conic_cases(),
        *conic_limit_cases(),
    )
    return {case.name: case for case in cases}


@functools.cache
def _nonlinear_cases() -> Mapping[str, Case]:
    """Return the cases that require CasADi, apart so that the others do not load it."""
    if importlib.util.find_spec("casadi") is None:
        return {}
    return {case.name: case for case in (*nonlinear_cases(), *integer_nonlinear_cases())}


def cases_for(backend: Backend) -> tuple[str, ...]:
    """Return the names of the cases for a backend: those with a program that it accepts.

    Parameters
    ----------
    backend : Backend
        The backend.
    """
    known = dict(_row_cases())
    if issubclass(NonlinearProgram, backend.accepts):
        known.update(_nonlinear_cases())
    return tuple(
        name
        for name, case in known.items()
        if isinstance(case.program, backend.accepts) and fits_integrality(case.program, backend)
    )


def run_case(backend: Backend, case: str, options: Mapping[str, Any] | None = None) -> CaseResult:
    """Run `backend` on the case called `case` and judge its answer.

    Parameters
    ----------
    backend : Backend
        The backend. :meth:`Backend.run` is called in this process.
    case : str
        A name from :func:`cases_for`.
    options : mapping, optional
        Options of the backend.

    Returns
    -------
    CaseResult
        An exception of the backend is a failure with its text as the reason.

    Raises
    ------
    UnknownName
        No case has the name.
    """
    declared = _row_cases().get(case) or _nonlinear_cases().get(case)
    if declared is None:
        raise UnknownName("conformance case", case, all_cases())
    missing = declared.needs - backend.features
    if missing:
        return CaseResult(
            backend.name, case, Status.UNSUPPORTED, f"declares no {', '.join(sorted(missing))}"
        )
    started = time.perf_counter()
    try:
        # As in a dispatched run, the output of the solver is captured.
        with captured(False, quiet=is_plain(backend)) as printed, printed.by_this_thread():
            run = _run(backend, declared, options or {})
    except (UnsupportedFormulation, UnsupportedOption) as error:
        status, reason = Status.UNSUPPORTED, str(error)
    except Exception as error:  # any exception of a backend is a failure of the case
        status, reason = Status.FAIL, f"{type(error).__name__}: {error}"
    else:
        fault = declared.judge(run)
        status, reason = (Status.PASS, "") if fault is None else (Status.FAIL, fault)
    return CaseResult(backend.name, case, status, reason, time.perf_counter() - started)


def _run(backend: Backend, case: Case, options: Mapping[str, Any]) -> Run:
    request = _request(backend, case, options)
    timer = None
    if case.stop_after == 0.0:
        request.control.stop(Limit.INTERRUPTED)
    elif case.stop_after is not None:
        timer = threading.Timer(case.stop_after, request.control.stop, (Limit.INTERRUPTED,))
        timer.daemon = True
    started, cpu = time.perf_counter(), time.process_time()
    if timer is not None:
        timer.start()
    try:
        answer = backend.run(case.program, request)
    finally:
        if timer is not None:
            timer.cancel()
    seconds, cpu = time.perf_counter() - started, time.process_time() - cpu
    if not isinstance(answer, Answer):
        raise TypeError(f"run must return an Answer, got {type(answer).__name__}")
    incumbents = []
    while not request.control.events.empty():
        event = request.control.events.get()
        if isinstance(event, tuple):
            incumbents.append(event[:3])
    others = [
        backend.run(case.program, replace(request, control=Control(), **other))
        for other in case.others
    ]
    return Run(answer, request, backend.features, tuple(incumbents), seconds, cpu, tuple(others))


def _request(backend: Backend, case: Case, options: Mapping[str, Any]) -> Request:
    arguments = {"time_limit": 30.0, **case.arguments}
    if case.others and Feature.THREADS in backend.features:
        # A seed determines the run on a single thread only.
        arguments["threads"] = 1
    return Request(options=backend.checked_options(options), control=Control(), **arguments)


@dataclass(frozen=True)
class Matrix:
    """Results of several backends in several cases. Printing it shows a table.

    Parameters
    ----------
    results : tuple of CaseResult
        At most one per backend and case.
    """

    results: tuple[CaseResult, ...]

    @classmethod
    def of(cls, results: Iterable[CaseResult]) -> Matrix:
        """Return the matrix of `results`.

        Parameters
        ----------
        results : iterable of CaseResult
            At most one per backend and case.
        """
        return cls(tuple(results))

    @property
    def backends(self) -> tuple[str, ...]:
        """Names of the backends, in order of appearance."""
        return tuple(dict.fromkeys(result.backend for result in self.results))

    @property
    def cases(self) -> tuple[str, ...]:
        """Names of the cases, in order of appearance."""
        return tuple(dict.fromkeys(result.case for result in self.results))

    @property
    def failures(self) -> tuple[CaseResult, ...]:
        """Results with status ``FAIL``."""
        return tuple(result for result in self.results if result.status is Status.FAIL)

    def __str__(self) -> str:
        marks = {Status.PASS: "pass", Status.FAIL: "FAIL", Status.UNSUPPORTED: "-"}
        texts = {(r.case, r.backend): marks[r.status] for r in self.results}
        width = max((len(case) for case in self.cases), default=4)
        columns = [(name, max(len(name), 4)) for name in self.backends]
        lines = [" ".join(["case".ljust(width), *(name.rjust(size) for name, size in columns)])]
        for case in self.cases:
            row = (texts.get((case, name), "").rjust(size) for name, size in columns)
            lines.append(" ".join([case.ljust(width), *row]))
        passed = sum(result.status is Status.PASS for result in self.results)
        unsupported = len(self.results) - passed - len(self.failures)
        lines.append(f"{passed} pass, {len(self.failures)} fail, {unsupported} unsupported")
        lines += [f"{r.backend}, {r.case}: {r.reason}" for r in self.failures]
        return "\n".join(lines)
