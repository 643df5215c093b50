"""Runner of the suite in worker processes: a crash or a hang fails its own case only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...errors import BackendMissing, WorkerFailure
from ..contract.backend import Backend
from ..contract.registry import find_backend
from ..processes.isolation import Worker
from .suite import CaseResult, Matrix, Status, cases_for, run_case

__all__ = ["run_suite"]

#: Seconds per case, for its own limit and for loading the solver's library.
_DEADLINE = 90.0


def run_suite(
    backends: Sequence[str | Backend],
    *,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    expected: Sequence[str] = (),
) -> Matrix:
    """Run every case of every backend, each backend in a worker process.

    Parameters
    ----------
    backends : sequence of str or Backend
        The backends.
    options : mapping of str to mapping, optional
        Options by name of the backend.
    expected : sequence of str
        Names of backends that must be installed.

    Returns
    -------
    Matrix
        Results; printed as a table. Its ``failures`` hold the failures with their reasons. Backends
        that are not installed are omitted.

    Raises
    ------
    BackendMissing
        A backend of `expected` is not among `backends`, or not installed.
    """
    candidates = [find_backend(backend) for backend in backends]
    present = [backend for backend in candidates if not backend.missing()]
    for name in expected:
        if name not in {backend.name for backend in present}:
            raise BackendMissing(
                f"backend {name!r} is expected, but it was skipped: not installed or not named"
            )
    results: list[CaseResult] = []
    for backend in present:
        own = dict((options or {}).get(backend.name, {}))
        with Worker() as worker:
            for case in cases_for(backend):
                try:
                    data = worker.call(_judged, backend, case, own, deadline=_DEADLINE)
                    results.append(CaseResult.from_dict(data))
                except WorkerFailure as error:
                    results.append(CaseResult(backend.name, case, Status.FAIL, str(error)))
    return Matrix.of(results)


def _judged(backend: Backend, case: str, options: Mapping[str, Any]) -> dict[str, Any]:
    return run_case(backend, case, options).to_dict()
