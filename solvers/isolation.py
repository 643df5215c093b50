"""Running jobs in worker processes that can be killed, whatever the native code in them does."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import logging
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import TracebackType
from typing import IO, Any, Self

import cloudpickle

from .. import errors
from ..errors import CrosstrackError
from .assembly import Claim, assemble, claim_from_data
from .backend import Backend, Limit, Termination
from .execution import GRACE, warm_objective
from .job import Job
from .registry import BackendState, rivals
from .solution import Incumbent, Solution

__all__ = ["Worker", "WorkerFailure", "in_worker", "probe"]

#: Seconds that what only a first run needs (compilation) may take before the worker is killed.
PREPARATION = 300.0
#: Seconds for a worker to start and to load a solver's library.
START = 60.0

log = logging.getLogger("crosstrack")

Listener = Callable[[Incumbent[Any]], None]


class WorkerFailure(CrosstrackError, RuntimeError):
    """A function called in a worker raised, killed its process, or passed its deadline."""


class Worker:
    """A process of its own session that runs one job after another.

    It is killed with its process group when a job passes its deadline, and replaced at the next.
    Standard error is kept in a temporary file, whose end explains a crash.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._errors: IO[bytes] | None = None
        self._number = 0
        self._interrupt = threading.Event()
        #: Native modules that backends have loaded in the process.
        self.loaded: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def pid(self) -> int | None:
        """The process, None while there is none."""
        return None if self._process is None else self._process.pid

    def _start(self) -> None:
        self._errors = tempfile.TemporaryFile(prefix="crosstrack-worker-")  # noqa: SIM115 (closed with the worker)
        # -P: a module in the working folder must not stand in for one of the standard library.
        command = [sys.executable, "-P", "-m", "crosstrack.solvers.worker"]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
        )
        self._lines = queue.SimpleQueue()
        self.loaded = set()
        threading.Thread(
            target=_pump,
            args=(self._process.stdout, self._lines),
            name="crosstrack-pump",
            daemon=True,
        ).start()

    def close(self) -> None:
        """Kill the process and everything it started."""
        process, self._process = self._process, None
        if process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):  # unsent bytes for a dead process
                        stream.close()
        if self._errors is not None:
            self._errors.close()
            self._errors = None

    @property
    def interrupted(self) -> bool:
        """Whether the running job has been asked to stop."""
        return self._interrupt.is_set()

    def interrupt(self) -> None:
        """Ask the running job to stop and to return its incumbent; from any thread."""
        self._interrupt.set()
        process = self._process
        if process is not None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)

    def _send(self, verb: str, payload: Any) -> int:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._start()
        assert self._process is not None and self._process.stdin is not None
        self._number += 1
        body = cloudpickle.dumps((verb, payload))
        # The path comes first: unpickling the rest may import what only the parent's path holds.
        message = pickle.dumps((list(sys.path), self._number, body))
        with contextlib.suppress(BrokenPipeError):  # its death is found when its answer is awaited
            self._process.stdin.write(struct.pack("<Q", len(message)) + message)
            self._process.stdin.flush()
        return self._number

    def _next(self, deadline: float) -> dict[str, Any] | None:
        """Return the next event, None at the deadline; a dead process gives ``event: died``."""
        left = deadline - time.monotonic()
        if left <= 0:
            return None
        try:
            event = self._lines.get(timeout=left if left < 1e6 else None)
        except queue.Empty:
            return None
        return {"event": "died"} if event is None else event

    def _epitaph(self) -> str:
        """Return how the process died, with the end of what it wrote to standard error."""
        assert self._process is not None and self._errors is not None
        code = self._process.wait()
        how = f"exit code {code}"
        if code < 0:
            try:
                how = f"signal {-code} ({signal.Signals(-code).name})"
            except ValueError:
                how = f"signal {-code}"
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - 2000))
        lines = [
            line
            for line in self._errors.read().decode(errors="replace").splitlines()
            if line.strip()
        ]
        said = f"; it said: {' | '.join(lines[-4:])}" if lines else ""
        return f"worker died: {how}{said}"

    def call(self, function: Callable[..., Any], *arguments: Any, deadline: float) -> Any:
        """Return what `function` returns in the worker, as JSON carries it.

        Raises
        ------
        WorkerFailure
            It raised, killed the worker, or took more than `deadline` seconds.
        """
        number = self._send("call", (function, arguments))
        end = time.monotonic() + deadline
        while (event := self._next(end)) is not None:
            if event["event"] == "died":
                cause = self._epitaph()
                self.close()
                raise WorkerFailure(cause)
            if event.get("number") == number:
                if event["event"] == "error":
                    raise WorkerFailure(f"{event['type']}: {event['message']}")
                return event["result"]
        self.close()
        raise WorkerFailure(f"no answer within {deadline:g} s; the worker was killed")

    def solve(
        self, job: Job, *, grace: float = GRACE, listener: Listener | None = None
    ) -> Solution[Any]:
        """Run `job` and return its solution; a crash or an overrun costs this job only.

        Parameters
        ----------
        job : Job
            The job, checked by the caller.
        grace : float
            Seconds beyond the time limit, start and build counted, before the worker is killed.
        listener : callable, optional
            Called with every incumbent, in this thread.
        """
        begin = time.monotonic()
        self._interrupt.clear()
        hides = bool(job.model.hidden_fields())
        if hides and job.warm_start is not None:
            warm_objective(job)  # the worker, which lacks the hidden data, cannot verify it
        # What a backend must not see does not even reach its process: the plan is verified here.
        sent = replace(job, model=job.model.blinded()) if hides else job
        number = self._send("solve", sent)
        deadline = begin + job.time_limit + grace if job.time_limit is not None else float("inf")
        incumbents: list[Incumbent[Any]] = []
        best: Any = None
        paused = 0.0
        asked = False
        while True:
            if self._interrupt.is_set() and not asked:
                asked = True
                deadline = min(deadline, time.monotonic() + grace)
            # Short waits, so that an interrupt from another thread moves the deadline in time.
            event = self._next(min(deadline, time.monotonic() + 0.5))
            if event is None:
                if time.monotonic() < deadline:
                    continue
                self.close()
                limit = Limit.INTERRUPTED if asked else Limit.TIME
                why = "killed: did not stop when interrupted" if asked else (
                    f"killed {grace:g} s after its time limit of {job.time_limit:g} s"
                    if job.time_limit is not None else "killed"
                )  # fmt: skip
                return _salvage(job, Termination.NO_SOLUTION, limit, why, incumbents, best, begin)
            kind = event["event"]
            if kind == "died":
                why = self._epitaph()
                self.close()
                return _salvage(job, Termination.FAILED, None, why, incumbents, best, begin)
            if event.get("number") != number:
                continue
            if kind == "preparing":
                paused, deadline = deadline - time.monotonic(), time.monotonic() + PREPARATION
            elif kind == "prepared":
                deadline = time.monotonic() + paused
            elif kind == "incumbent":
                data = event["plan"]
                plan = None if data is None else job.model.plan_from_data(data)
                best = plan if plan is not None else best
                incumbents.append(Incumbent(event["seconds"], event["objective"], plan))
                if listener is not None:
                    listener(incumbents[-1])
            elif kind == "claim":
                solution = assemble(job, claim_from_data(job, event["claim"]))
                total = {"total": time.monotonic() - begin}
                return replace(solution, seconds={**solution.seconds, **total})
            elif kind == "solution":
                return Solution.from_dict(event["solution"], job.model)
            elif kind == "error":
                known = getattr(errors, event["type"], None)
                if isinstance(known, type) and issubclass(known, CrosstrackError):
                    raise _rebuilt(known, event["message"])
                why = f"{event['type']}: {event['message']}"
                return _salvage(job, Termination.FAILED, None, why, incumbents, best, begin)


def _rebuilt(kind: type[CrosstrackError], message: str) -> CrosstrackError:
    error = kind.__new__(kind)
    Exception.__init__(error, message)
    return error


def _pump(stream: IO[bytes], lines: queue.SimpleQueue[dict[str, Any] | None]) -> None:
    """Move the worker's lines into a queue; None marks its end."""
    with contextlib.suppress(ValueError, OSError):  # the stream was closed with its worker
        for line in stream:
            try:
                lines.put(json.loads(line))
            except json.JSONDecodeError:
                log.warning("worker wrote a line that is no JSON: %r", line[:200])
    lines.put(None)


def _salvage(
    job: Job,
    termination: Termination,
    limit: Limit | None,
    message: str,
    incumbents: list[Incumbent[Any]],
    best: Any,
    begin: float,
) -> Solution[Any]:
    """Return what is left of a run whose worker is gone: its last incumbent, verified here."""
    left = Claim(
        termination,
        limit,
        best,
        formulation=job.formulation,
        seconds={"total": time.monotonic() - begin},
        incumbents=tuple(incumbents),
        messages=(message,),
    )
    return assemble(job, left)


_idle: list[Worker] = []
_lock = threading.Lock()
_MOST_IDLE = 2


@atexit.register
def _close_idle() -> None:
    with _lock:
        while _idle:
            _idle.pop().close()


def in_worker(job: Job, *, listener: Listener | None = None) -> Solution[Any]:
    """Run `job`, checked and with its backend resolved, in a worker that is kept for the next.

    Ctrl-C asks the run for its incumbent; a second one kills it.
    """
    backend = job.backend
    assert isinstance(backend, Backend)
    with _lock:
        fitting = next((worker for worker in _idle if not rivals(backend) & worker.loaded), None)
        if fitting is not None:
            _idle.remove(fitting)
    worker = fitting or Worker()
    # A queue, not a join: a join that Ctrl-C interrupts takes its thread for ended (CPython 3.11).
    box: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def work() -> None:
        try:
            box.put(worker.solve(job, listener=forward))
        except BaseException as error:  # raised again in the waiting thread
            box.put(error)

    def forward(incumbent: Incumbent[Any]) -> None:
        if listener is not None:
            box.put(incumbent)

    try:
        threading.Thread(target=work, name="crosstrack-worker", daemon=True).start()
        while True:
            try:
                outcome = box.get()
                if not isinstance(outcome, Incumbent):
                    break
                assert listener is not None
                listener(outcome)
            except KeyboardInterrupt:
                if worker.interrupted:
                    raise
                worker.interrupt()
    except BaseException:
        worker.close()
        raise
    worker.loaded.update(backend.natives)
    with _lock:
        if len(_idle) < _MOST_IDLE:
            _idle.append(worker)
        else:
            worker.close()
    if isinstance(outcome, BaseException):
        raise outcome
    solution: Solution[Any] = outcome
    return solution


def probe(states: tuple[BackendState, ...]) -> tuple[BackendState, ...]:
    """Load every installed backend in a worker of its own and return the states as found.

    A package that is there but does not load becomes ``"broken"`` with its cause.
    """

    def probed(state: BackendState) -> BackendState:
        if state.state != "installed" or not state.requires:
            return state
        with Worker() as worker:
            try:
                cause = worker.call(_import_all, state.requires, deadline=START)
            except WorkerFailure as failure:
                cause = str(failure)
        return replace(state, state="broken", cause=cause) if cause else state

    with ThreadPoolExecutor(max_workers=2) as pool:
        return tuple(pool.map(probed, states))


def _import_all(requires: tuple[str, ...]) -> str:
    """Import what a backend needs; return why that fails, empty when it does not."""
    for name in requires:
        try:
            importlib.import_module(name)
        except Exception as error:  # whatever a broken library raises is the finding
            return f"{type(error).__name__}: {error}"
    return ""
