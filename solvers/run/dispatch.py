"""The verb :func:`solve`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, Unpack

from ...errors import UnsupportedOption
from ...lazy import moved
from ...models.conversion import as_model
from ...models.fields import Flag, Optional
from ...models.model import Model
from ...models.records import given
from ..contract.backend import Backend, Control, Guarantee
from ..contract.job import Job
from ..contract.limits import LimitOptions, Limits, check_listener, merge_limits, takes_limits
from ..contract.registry import is_ours, rivals, shares_process
from ..contract.solution import Incumbent, Solution
from .execution import execute

if TYPE_CHECKING:
    from ..contract.events import Listener

__all__ = ["run_job", "solve"]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(__name__, {".verification": "verify"})

PlanT = TypeVar("PlanT")


@takes_limits()
def solve(
    model: Model[PlanT],
    backend: str | Backend = "auto",
    *,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    backend_options: Mapping[str, Any] | None = None,
    isolate: bool | None = None,
    limits: Limits | None = None,
    on_incumbent: Callable[[Incumbent[PlanT]], None] | None = None,
    **options: Unpack[LimitOptions],
) -> Solution[PlanT]:
    """Solve `model` and verify the answer.

    An answer that fails verification is never returned as a plan: its termination is ``rejected``.
    A limit does not raise, and after Ctrl-C the incumbent is returned. An option that the backend
    or formulation does not support raises.

    Parameters
    ----------
    model : Model
        The model to solve.
    backend : str or Backend
        A name from :func:`crosstrack.backends`, or ``"auto"``: the first installed exact backend,
        native algorithms before programs, else one that also proves a bound. If it fails, the next
        exact backends continue for the rest of the time. Under a time limit, a native heuristic
        precedes a local solver of programs. The statistics list the backends tried.
    formulation : str, optional
        Name of the formulation, for a backend that solves programs. Default: that of the model.
    formulation_options, backend_options : mapping, optional
        Options of the formulation and of the backend. Backend options override the common ones.
    isolate : bool, optional
        Whether to run in a worker process. Default: only if the backend cannot be interrupted, if
        the model hides data from it, or if a conflicting library is loaded.
    limits : Limits, optional
        Limits of the run as a whole, see :class:`~crosstrack.solvers.contract.limits.Limits`.
    on_incumbent : callable, optional
        Deprecated: use `on_event`.
    time_limit : float, optional
        Wall-clock seconds for the call, with building, loading and compiling. A run gets at least half
        of them, so a slow start of a worker or slow imports can exceed the limit, as does the
        verification of the answer, which follows. Kernels that cannot be compiled in time are
        interpreted, the message names them, and a background process compiles them for later calls.
    memory_limit, evaluations, target, gap, tolerance, seed, threads, stop : optional
        Fields of `limits`, which override it.
    warm_start, starts, verbose, on_event : optional
        Fields of `limits`. The callback receives each improved plan and bound.

    Returns
    -------
    Solution
        The verified plan with its bounds, or the termination of a run without a plan.

    Raises
    ------
    BackendMissing, BackendBroken
        The backend is not installed, or fails for a reason unrelated to the model.
    UnknownName, UnsupportedOption, UnsupportedFormulation, InvalidData
        An option, name or formulation is not available.
    """
    begin = time.perf_counter()
    model = as_model(model)
    isolate = Optional(Flag()).coerce("isolate", isolate, {})
    fields = merge_limits("solve", limits, options)
    listener: Listener | None = fields.pop("on_event", None)
    check_listener(listener)
    if on_incumbent is not None:
        from ..contract.events import listener_of

        listener = listener_of(listener, "incumbent", on_incumbent=on_incumbent)
    if fields.get("warm_start") is not None:
        fields["warm_start"] = model.as_plan(fields["warm_start"])
    job = Job(
        model,
        backend,
        formulation,
        given("formulation_options", formulation_options),
        given("backend_options", backend_options),
        counts_compilation=True,
        **fields,
    )
    is_automatic = job.is_automatic
    job = job.resolved()
    assert isinstance(job.backend, Backend)
    if is_automatic and job.backend.guarantee is Guarantee.EXACT:
        job = replace(job, has_fallback=True)

    def remaining() -> Job:
        return job.after(time.perf_counter() - begin)

    def run(part: Job) -> Solution[Any]:
        return run_job(part, isolate, listener)

    with _shown(job.verbose):
        if is_automatic:
            from .fallback import run_automatic

            solution = run_automatic(job, remaining, run)
        else:
            solution = run(remaining())
    solution = replace(solution, options=job.options())
    return solution.lasting(time.perf_counter() - begin)


def _shown(verbose: bool) -> AbstractContextManager[None]:
    """Show the output of the solver within a block if `verbose`."""
    if not verbose:
        return nullcontext()
    from ..processes.output import shown

    return shown(verbose)


def run_job(job: Job, isolate: bool | None, listener: Listener | None) -> Solution[Any]:
    """Run `job`, whose backend is resolved, in this process or in a worker."""
    model = job.model
    assert isinstance(job.backend, Backend)
    hides = job.backend.hides(model) and not shares_process(job.backend)
    if hides and isolate is False:
        raise UnsupportedOption(
            f"model {model.kind!r} hides data from backends, which run in a worker: isolate=False"
        )
    if job.memory_limit is not None:
        if isolate is False:
            raise UnsupportedOption("memory_limit is kept in a worker process only: isolate=False")
        isolate = True
    apart = hides or (needs_worker(job) if isolate is None else isolate)
    if not apart and job.starts == 1:
        return execute(job, listener=listener)
    # Imported here, because most runs need no worker.
    from ..processes.pool import in_worker
    from ..processes.scheduling import run_together
    from .multistart import multistart

    if job.starts > 1 and not hides and isolate is None and listener is None:

        def alone(part: Job, control: Control | None = None) -> Solution[Any]:
            return in_worker(part) if apart else execute(part, control=control)

        return multistart(job, alone, together=run_together)
    if not apart:
        return execute(job, listener=listener)
    job.find_target()  # unsupported options raise here, before a process starts
    if job.starts > 1 and (hides or not is_ours(job.backend)):
        # Each start is judged in this process.
        return multistart(job, lambda part, **_: in_worker(part, listener=listener))
    return in_worker(job, listener=listener)


def needs_worker(job: Job) -> bool:
    """Return True if `job` needs a worker: it cannot be interrupted, or a rival library is loaded."""
    backend = job.backend
    assert isinstance(backend, Backend)
    if backend.requires and not backend.interrupts(job.find_target().kind):
        return True
    return any(module in sys.modules for module in rivals(backend))
