"""Running the conformance cases: one backend, one case at a time, and the matrix of both."""

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
from ..backend import Answer, Backend, Control, Feature, Limit, Request
from ..output import captured
from ..registry import is_plain
from .cases import Case, Run
from .conic import conic_cases
from .convex import conic_limit_cases, quadratic_limit_cases
from .limits import limit_cases
from .linear import linear_cases
from .mixed_integer import integer_cases
from .nonlinear import nonlinear_cases
from .quadratic import quadratic_cases

__all__ = ["CaseResult", "Matrix", "Status", "all_cases", "cases_for", "run_case"]


class Status(StrEnum):
    """How a backend fared in a case."""

    #: It answered as it must.
    PASS = "pass"
    #: It answered otherwise, or failed.
    FAIL = "fail"
    #: It declares that it does not take what the case asks for.
    UNSUPPORTED = "unsupported"


@dataclass(frozen=True)
class CaseResult:
    """How one backend fared in one case.

    Parameters
    ----------
    backend, case : str
        Their names.
    status : Status
        ``UNSUPPORTED`` where the backend declares that the case is not for it: never a pass.
    reason : str
        Why it failed, or what it does not support.
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
        """Return the result that :meth:`to_dict` wrote."""
        return cls(**{**data, "status": Status(data["status"])})


def all_cases() -> Mapping[str, Case]:
    """Return all cases by name; those of nonlinear programs only where CasADi is installed."""
    return {**_row_cases(), **_nonlinear_cases()}


@functools.cache
def _row_cases() -> Mapping[str, Case]:
    cases = (
        *linear_cases(),
        *integer_cases(),
        *limit_cases(),
        *quadratic_cases(),
        *quadratic_limit_cases(),
        *conic_cases(),
        *conic_limit_cases(),
    )
    return {case.name: case for case in cases}


@functools.cache
def _nonlinear_cases() -> Mapping[str, Case]:
    """Return what only CasADi can state: apart, so that nothing else has to load it."""
    if importlib.util.find_spec("casadi") is None:
        return {}
    return {case.name: case for case in nonlinear_cases()}


def cases_for(backend: Backend) -> tuple[str, ...]:
    """Return the names of the cases that a backend must run: those of the programs it accepts."""
    known = dict(_row_cases())
    if issubclass(NonlinearProgram, backend.accepts):
        known.update(_nonlinear_cases())
    return tuple(name for name, case in known.items() if isinstance(case.program, backend.accepts))


def run_case(backend: Backend, case: str, options: Mapping[str, Any] | None = None) -> CaseResult:
    """Run `backend` on the case called `case` and judge its answer.

    Parameters
    ----------
    backend : Backend
        What is tried; :meth:`Backend.run` is called in this process.
    case : str
        One of :func:`cases_for`.
    options : mapping, optional
        The backend's own options.

    Returns
    -------
    CaseResult
        An exception of the backend's is a failure and its reason, so that the suite goes on.

    Raises
    ------
    UnknownName
        No case bears the name.
    """
    asked = _row_cases().get(case) or _nonlinear_cases().get(case)
    if asked is None:
        raise UnknownName("conformance case", case, all_cases())
    lacking = asked.needs - backend.features
    if lacking:
        return CaseResult(
            backend.name, case, Status.UNSUPPORTED, f"declares no {', '.join(sorted(lacking))}"
        )
    started = time.perf_counter()
    try:
        # As in a run that is dispatched, what the solver prints is nobody's answer.
        with captured(False, quiet=is_plain(backend)) as printed, printed.by_this_thread():
            run = _run(backend, asked, options or {})
    except (UnsupportedFormulation, UnsupportedOption) as error:
        status, reason = Status.UNSUPPORTED, str(error)
    except Exception as error:  # whatever a backend raises is its failure, not the suite's
        status, reason = Status.FAIL, f"{type(error).__name__}: {error}"
    else:
        found = asked.judge(run)
        status, reason = (Status.PASS, "") if found is None else (Status.FAIL, found)
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
        if event is not None:
            incumbents.append(event[:3])
    others = [
        backend.run(case.program, replace(request, control=Control(), **other))
        for other in case.others
    ]
    return Run(answer, request, backend.features, tuple(incumbents), seconds, cpu, tuple(others))


def _request(backend: Backend, case: Case, options: Mapping[str, Any]) -> Request:
    arguments = {"time_limit": 30.0, **case.arguments}
    if case.others and Feature.THREADS in backend.features:
        # Only on one thread does a seed decide everything.
        arguments["threads"] = 1
    return Request(options=backend.checked_options(options), control=Control(), **arguments)


@dataclass(frozen=True)
class Matrix:
    """Results of several backends in several cases.

    Parameters
    ----------
    results : tuple of CaseResult
        At most one for each backend and case.
    """

    results: tuple[CaseResult, ...]

    @classmethod
    def of(cls, results: Iterable[CaseResult]) -> Matrix:
        """Return the matrix of `results`."""
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
        """The results that are failures."""
        return tuple(result for result in self.results if result.status is Status.FAIL)

    def __str__(self) -> str:
        marks = {Status.PASS: "pass", Status.FAIL: "FAIL", Status.UNSUPPORTED: "-"}
        found = {(r.case, r.backend): marks[r.status] for r in self.results}
        width = max((len(case) for case in self.cases), default=4)
        columns = [(name, max(len(name), 4)) for name in self.backends]
        lines = [" ".join(["case".ljust(width), *(name.rjust(size) for name, size in columns)])]
        for case in self.cases:
            row = (found.get((case, name), "").rjust(size) for name, size in columns)
            lines.append(" ".join([case.ljust(width), *row]))
        passed = sum(result.status is Status.PASS for result in self.results)
        unsupported = len(self.results) - passed - len(self.failures)
        lines.append(f"{passed} pass, {len(self.failures)} fail, {unsupported} unsupported")
        lines += [f"{r.backend}, {r.case}: {r.reason}" for r in self.failures]
        return "\n".join(lines)
