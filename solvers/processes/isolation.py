"""Execution of jobs in worker processes that can be killed regardless of the native code in them."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import pickle
import queue
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import IO, Any, Self

import cloudpickle

from ...errors import WorkerFailure
from ..contract.backend import Backend, Limit, Termination
from ..contract.events import Event, EventKind, Listener
from ..contract.job import Job
from ..contract.solution import Incumbent, Solution
from ..run.assembly import Claim, assemble
from ..run.execution import GRACE, warm_objective
from ..run.running import PATIENCE
from .claims import claim_from_data
from .environment import MIB, require_accounts, resident
from .oracles import end_oracle, raised, serve
from .output import Lines

__all__ = ["Worker"]

#: Seconds for work of the first run only (compilation) before the worker is killed.
PREPARATION = 300.0
#: Seconds between two reads of a worker's output.
POLL = 0.2
#: Seconds for a worker's supervisor to kill its processes.
KILLED = 5.0

log = logging.getLogger("crosstrack")


class Worker:
    """Process in a session of its own that runs one job at a time.

    If a job exceeds its deadline, the process is killed with its descendants (on Linux also those
    outside its process group) and replaced for the next job. Its output goes to the logger
    ``crosstrack.output``, and the last lines explain a crash.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._errors: IO[bytes] | None = None
        self._printed: Lines | None = None
        self._number = 0
        self._level = logging.DEBUG
        self._interrupt = threading.Event()
        self._closing = threading.RLock()
        self._channel: socket.socket | None = None
        #: Oracle that answers questions of the running job about hidden data.
        self._oracle: Callable[[Any], Any] | None = None
        #: Native modules that backends have loaded into the process.
        self.loaded: set[str] = set()
        #: Process identifier and kind of job that the worker has been warmed up for.
        self.warm: tuple[int | None, Any] = (None, None)
        #: Memory limit in bytes of the process and its descendants.
        self._memory: float | None = None
        #: Time of the next memory measurement, and the measurement that exceeded the limit.
        self._look = self._held = 0.0

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
        """Identifier of the process whose end is the end of the worker; None without a process."""
        return None if self._process is None else self._process.pid

    def _start(self) -> None:
        self._errors = tempfile.TemporaryFile(prefix="crosstrack-worker-")  # noqa: SIM115 (closed with the worker)
        self._printed = Lines(self._errors.fileno())
        # -P: a module in the working folder must not replace one of the standard library.
        self._channel, theirs = socket.socketpair()
        command = [
            sys.executable,
            "-P",
            "-m",
            "crosstrack.solvers.processes.worker",
            str(theirs.fileno()),
        ]
        with theirs:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                start_new_session=True,
                pass_fds=(theirs.fileno(),),
            )
        threading.Thread(
            target=serve,
            args=(self._channel, lambda: self._oracle),
            name="crosstrack-oracle",
            daemon=True,
        ).start()
        self._lines = queue.SimpleQueue()
        self.loaded = set()
        threading.Thread(
            target=_pump,
            args=(self._process.stdout, self._lines),
            name="crosstrack-pump",
            daemon=True,
        ).start()

    def close(self) -> None:
        """Kill the process and its descendants. Thread-safe."""
        with self._closing:
            self._close()

    def _close(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            if sys.platform == "linux":
                # The supervisor of the worker kills all descendants and ends last.
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(KILLED)
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):  # unsent bytes for a dead process
                        stream.close()
        if self._channel is not None:
            with contextlib.suppress(OSError):  # the other end is gone
                self._channel.shutdown(socket.SHUT_RDWR)
            self._channel.close()
            self._channel = None
        if self._errors is not None and self._printed is not None:
            self._printed.forward(self._level, rest=True)
            self._errors.close()
            self._errors = self._printed = None

    @property
    def interrupted(self) -> bool:
        """Whether a stop of the running job was requested."""
        return self._interrupt.is_set()

    def interrupt(self) -> None:
        """Request that the running job stops and returns its incumbent. Thread-safe."""
        self._interrupt.set()
        self._lines.put({"event": "interrupt"})  # wakes the thread waiting for the answer

    def _send(self, verb: str, payload: Any) -> int:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._start()
        self._number += 1
        body = cloudpickle.dumps((verb, payload))
        self._write(self._number, body)
        return self._number

    def _write(self, number: int, body: bytes | None) -> None:
        """Send a job. With `body` None, send the request to stop job `number`."""
        process = self._process
        if process is None or process.stdin is None:
            return  # closed by another thread
        # The path comes first: unpickling the rest may import what only the parent's path holds.
        # The path comes first: unpickling the body may import modules found only on this path.
        message = pickle.dumps((list(sys.path), number, body))
        # A dead or closed process is detected when its answer is awaited.
        with contextlib.suppress(BrokenPipeError, ValueError):
            process.stdin.write(struct.pack("<Q", len(message)) + message)
            process.stdin.flush()

    def _next(self, deadline: float) -> dict[str, Any] | None:
        """Return the next event; None at the deadline, ``event: died`` for a dead process."""
        while (left := deadline - time.monotonic()) > 0:
            try:
                event = self._lines.get(timeout=min(left, POLL))
            except queue.Empty:
                event = {"event": "nothing"}
            with self._closing:
                if self._printed is not None:
                    self._printed.forward(self._level)
            # At fixed times instead of on silence, because a backend may report continuously.
            now = time.monotonic()
            if self._memory is not None and self.pid is not None and now >= self._look:
                self._look = now + POLL
                size = resident(self.pid)
                if size > self._memory:
                    self._held = size
                    self.close()  # events sent before are still read
            if event is None:
                return {"event": "memory" if self._held else "died", "held": self._held}
            if event["event"] == "log":
                logging.getLogger(event["name"]).log(event["level"], "%s", event["text"])
            elif event["event"] != "nothing":
                return event
        return None

    def _close_dead(self) -> str:
        """Close a dead process and return the cause of its death."""
        with self._closing:
            cause = self._cause_of_death()
            self._close()
        return cause

    def _cause_of_death(self) -> str:
        """Return the exit code or signal of the process, with its last lines of standard error."""
        if self._process is None or self._errors is None:
            return "worker closed"
        code = self._process.wait()
        how = f"exit code {code}"
        number = -code if code < 0 else code - 128  # the supervisor reports a signal as 128 + n
        if number > 0:
            how = f"signal {number}"
            with contextlib.suppress(ValueError):
                how += f" ({signal.Signals(number).name})"
        size = os.fstat(self._errors.fileno()).st_size
        end = os.pread(self._errors.fileno(), 2000, max(0, size - 2000))
        lines = [line for line in end.decode(errors="replace").splitlines() if line.strip()]
        said = f"; it said: {' | '.join(lines[-4:])}" if lines else ""
        return f"worker died: {how}{said}"

    def call(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        deadline: float,
        memory_limit: float | None = None,
    ) -> Any:
        """Call `function` in the worker and return its result after a round trip through JSON.

        Parameters
        ----------
        function, *arguments
            Function and positional arguments, serialised with cloudpickle.
        deadline : float
            Seconds before the worker is killed.
        memory_limit : float, optional
            Memory limit in MiB; Linux only.

        Raises
        ------
        WorkerFailure
            The function raised, crashed the worker, or exceeded a limit. A
            :class:`~crosstrack.errors.CrosstrackError` of the function is raised unchanged.
        """
        self._limit_memory(memory_limit)
        number = self._send("call", (function, arguments))
        end = time.monotonic() + deadline
        while (event := self._next(end)) is not None:
            if event["event"] == "died":
                raise WorkerFailure(self._close_dead())
            if event["event"] == "memory":
                raise WorkerFailure(_too_large(event["held"], memory_limit))
            if event.get("number") == number:
                if event["event"] == "error":
                    raise raised(event) or WorkerFailure(f"{event['type']}: {event['message']}")
                return event["result"]
        self.close()
        raise WorkerFailure(f"no answer within {deadline:g} s; the worker was killed")

    def _limit_memory(self, limit: float | None) -> None:
        """Limit the memory of the process to `limit` MiB from now on; None for no limit."""
        if limit is not None:
            require_accounts()
        self._memory = None if limit is None else limit * MIB
        self._held = 0.0

    def solve(
        self, job: Job, *, grace: float = GRACE, listener: Listener | None = None
    ) -> Solution[Any]:
        """Run `job` and return its solution. A crash or a missed deadline affects this job only.

        Parameters
        ----------
        job : Job
            The job, validated by the caller.
        grace : float
            Seconds after the time limit, which includes start and build, before the worker is killed.
        listener : callable, optional
            Function called with every incumbent and bound, in this thread.
        """
        try:
            return self._solve(job, grace, listener)
        finally:
            self._interrupt.clear()
            end_oracle(self._oracle)
            self._oracle = self._memory = None
            self._held = 0.0

    def _solve(self, job: Job, grace: float, listener: Listener | None) -> Solution[Any]:
        begin = time.monotonic()
        self._level = logging.INFO if job.verbose else logging.DEBUG
        job = job.resolved()
        backend = job.backend
        assert isinstance(backend, Backend)
        hides = backend.hides(job.model)
        if hides and job.warm_start is not None:
            warm_objective(job)  # the worker cannot verify it without the hidden data
        # Hidden data are not sent to the process of the backend; the plan is verified here.
        sent = replace(job, model=job.model.blinded()) if hides else job
        self._oracle = job.model.oracle() if hides else None
        self._limit_memory(job.memory_limit)
        number = self._send("solve", (sent, time.monotonic()))
        deadline = begin + job.time_limit + grace if job.time_limit is not None else float("inf")
        left = Claim(Termination.NO_SOLUTION)
        paused = 0.0
        stop_requested = False
        while True:
            if self._interrupt.is_set() and not stop_requested:
                stop_requested = True
                deadline = min(deadline, time.monotonic() + min(grace, 2 * PATIENCE))
                self._write(number, None)
            event = self._next(deadline)
            if event is None or event["event"] in ("died", "memory", "claim", "error"):
                end_oracle(self._oracle)  # before the verification, which may need the same workers
            if event is None:
                self.close()
                limit = Limit.INTERRUPTED if stop_requested else Limit.TIME
                why = "killed: did not stop when interrupted" if stop_requested else (
                    f"killed {time.monotonic() - begin - job.time_limit:.2g} s after its time limit "
                    f"of {job.time_limit:g} s"
                    if job.time_limit is not None else "killed"
                )  # fmt: skip
                return _salvage(job, replace(left, limit=limit), why, begin)
            kind = event["event"]
            if kind == "died":
                why = self._close_dead()
                return _salvage(job, replace(left, termination=Termination.FAILED), why, begin)
            if kind == "memory":
                self.close()
                why = _too_large(event["held"], job.memory_limit)
                return _salvage(job, replace(left, limit=Limit.MEMORY), why, begin)
            if event.get("number") != number:
                continue
            if kind == "preparing" and not stop_requested:
                paused, deadline = deadline - time.monotonic(), time.monotonic() + PREPARATION
            elif kind == "prepared" and not stop_requested:
                deadline = time.monotonic() + paused
            elif kind == "incumbent":
                data = event["plan"]
                plan = None if data is None else job.model.plan_from_data(data)
                incumbent = Incumbent(
                    event["seconds"], event["objective"], plan, event["evaluations"]
                )
                left = replace(
                    left,
                    plan=left.plan if plan is None else plan,
                    incumbents=(*left.incumbents, incumbent),
                )
                if listener is not None:
                    listener(Event(EventKind.INCUMBENT, job.model.name, backend.name, incumbent))
            elif kind == "started" and job.time_limit is not None and not stop_requested:
                # The backend stops by itself, unless native code blocks all threads.
                extra = min(grace, backend.patience(job.find_target().kind) + PATIENCE)
                deadline = min(deadline, time.monotonic() + job.time_limit + extra)
            elif kind == "bound":
                left = replace(left, dual_bound=event["bound"])
                if listener is not None:
                    bound = event["bound"]
                    listener(Event(EventKind.BOUND, job.model.name, backend.name, bound=bound))
            elif kind in ("claim", "solution"):
                with self._closing:
                    if self._printed is not None:
                        self._printed.forward(self._level, rest=True)
                if event["last"]:
                    self.close()
                if kind == "claim":
                    solution = assemble(job, claim_from_data(job, event["claim"]), self._oracle)
                else:
                    solution = Solution.from_dict(event["solution"], job.model)
                    solution = replace(solution, options=job.options())
                total = {"total": time.monotonic() - begin}
                return replace(solution, seconds={**solution.seconds, **total})
            elif kind == "error":
                if event["last"]:
                    self.close()
                error = raised(event)
                if error is not None:
                    raise error
                why = f"{event['type']}: {event['message']}"
                return _salvage(job, replace(left, termination=Termination.FAILED), why, begin)


def _too_large(size: float, limit: float | None) -> str:
    return f"killed: {size / MIB:.0f} MiB in memory, memory_limit is {limit:g} MiB"


def _pump(stream: IO[bytes], lines: queue.SimpleQueue[dict[str, Any] | None]) -> None:
    """Move the lines of a worker into a queue; None marks their end."""
    with contextlib.suppress(ValueError, OSError):  # the stream was closed with its worker
        for line in stream:
            try:
                lines.put(json.loads(line))
            except json.JSONDecodeError:
                log.warning("worker wrote a line that is no JSON: %r", line[:200])
    lines.put(None)


def _salvage(job: Job, left: Claim, message: str, begin: float) -> Solution[Any]:
    """Return the solution of a run whose worker is gone: its last incumbent, verified here."""
    target = job.find_target()
    return assemble(
        job,
        replace(
            left,
            proves=target.proves,
            formulation=None if target.formulation is None else target.formulation.name,
            seconds={"total": time.monotonic() - begin},
            messages=(message,),
        ),
    )
