"""Worker process: jobs in by cloudpickle, JSON lines out. ``python -m crosstrack.solvers.processes.worker``.

Each input message has eight bytes of length and a pickle of ``(path, number, (verb, payload))``, with
the inner pair pickled separately. Without a pair, the message requests that job `number` stops. Each
output line is an object with ``event``: ``ready``, ``started``, ``preparing``, ``prepared``,
``incumbent``, ``bound``, ``log``, ``solution``, ``claim``, ``result`` or ``error``. Output of native
code goes to standard error, so that it cannot corrupt the lines. Questions about hidden data go
through a socket whose descriptor is the argument (:mod:`crosstrack.solvers.processes.oracles`). The worker ends
when its input ends, even during a run.

On Linux a supervisor runs between the worker and its parent. Processes started by a backend become
children of the supervisor when their own parents die, regardless of their session. When the worker
ends or the parent is gone, the supervisor kills them all and then ends.
"""

from __future__ import annotations

import ctypes
import json
import logging
import os
import pickle
import queue
import select
import signal
import socket
import struct
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from ...jit import renew_budget
from .output import by_lines, flush_native, shown

__all__ = ["main"]

#: Options of Linux's ``prctl`` for this process.
_DIE_WITH_PARENT, _ADOPT_ORPHANS = 1, 36


def _read(stream: BinaryIO) -> bytes | None:
    head = stream.read(8)
    if len(head) < 8:
        return None
    (size,) = struct.unpack("<Q", head)
    body = stream.read(size)
    return body if len(body) == size else None


def main() -> None:
    """Run jobs until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # stop requests arrive with the jobs
    if sys.platform == "linux":
        _supervise()
    _serve()


def _supervise() -> None:
    """Return in a child process. This process ends with it and kills all descendants of both."""
    system = ctypes.CDLL(None).prctl
    system(_ADOPT_ORPHANS, 1, 0, 0, 0)
    supervisor = os.getpid()
    worker = os.fork()
    if not worker:
        system(_DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != supervisor:
            os._exit(1)
        return

    def kill(*_: Any) -> None:
        os.kill(worker, signal.SIGKILL)

    def watch() -> None:
        parent = select.poll()
        parent.register(0, 0)  # for a hang-up only; the worker reads the input
        parent.poll()
        kill()

    signal.signal(signal.SIGTERM, kill)
    threading.Thread(target=watch, daemon=True).start()
    ended, status = 0, 0
    while ended != worker:
        ended, status = os.wait()  # orphans must be waited for, too
    _end(status)


def _end(status: int) -> NoReturn:
    """Kill all children and the orphans they leave; exit with the code of the worker."""
    while True:
        for child in _children():
            os.kill(child, signal.SIGKILL)
        try:
            os.wait()
        except ChildProcessError:
            break
    code = os.waitstatus_to_exitcode(status)
    os._exit(128 - code if code < 0 else code)


def _children() -> list[int]:
    """Return the identifiers of this process's children."""
    identifiers = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state = (entry / "stat").read_text("utf-8", "replace")
            except OSError:
                continue  # it has ended meanwhile
            # The name in parentheses may contain anything. The parent is the second word after it.
            if int(state.rpartition(")")[2].split()[1]) == os.getpid():
                identifiers.append(int(entry.name))
    return identifiers


class _Stops:
    """Number and control of the current job, and the last stop request."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number, self._asked = -1, -1
        self._control: Any = None
        self._trusted = True

    def begin(self, number: int, control: Any, trusted: bool) -> None:
        """Connect `control` to the stop requests for job `number`, including earlier ones."""
        with self._lock:
            self._number, self._control, self._trusted = number, control, trusted
        self.ask(self._asked)

    @property
    def last(self) -> bool:
        """Whether the process must end after this job.

        An abandoned run continues in a thread, and an external backend may have changed the classes
        that judge.
        """
        return not self._trusted or (self._control is not None and self._control.abandoned)

    def ask(self, number: int) -> None:
        """Stop job `number`, now or when it starts."""
        from ..contract.enums import Limit

        with self._lock:
            self._asked = number
            if number == self._number and self._control is not None:
                self._control.stop(Limit.INTERRUPTED)


class _Send(logging.Handler):
    """Writer of the output lines, and log handler that sends log records."""

    def __init__(self, lines: Any) -> None:
        super().__init__()
        self._lines = lines

    def __call__(self, message: dict[str, Any]) -> None:
        with self.lock:  # type: ignore[union-attr]
            self._lines.write(json.dumps(message, ensure_ascii=False) + "\n")
            self._lines.flush()

    def emit(self, record: logging.LogRecord) -> None:
        """Send a log record to the parent, whose handlers process it."""
        text = record.getMessage()
        if record.exc_info:
            text += "\n" + "".join(traceback.format_exception(*record.exc_info)).rstrip()
        self({"event": "log", "name": record.name, "level": record.levelno, "text": text})


def _serve() -> None:
    """Run jobs one after another."""
    send = _Send(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)
    by_lines()
    log = logging.getLogger("crosstrack")
    log.addHandler(send)
    log.propagate = False
    jobs: queue.SimpleQueue[tuple[int, list[str], bytes]] = queue.SimpleQueue()
    stops = _Stops()
    channel = socket.socket(fileno=int(sys.argv[1]))

    def listen() -> None:
        while (message := _read(sys.stdin.buffer)) is not None:
            path, number, body = pickle.loads(message)
            if body is None:
                stops.ask(number)
            else:
                jobs.put((number, path, body))
        # The parent is gone or needs no more answers.
        os._exit(0)

    threading.Thread(target=listen, name="crosstrack-listen", daemon=True).start()
    send({"event": "ready"})
    while True:
        number, path, body = jobs.get()
        renew_budget()
        try:
            sys.path[:] = list(dict.fromkeys([*path, *sys.path]))
            verb, payload = pickle.loads(body)
            if verb == "call":
                function, arguments = payload
                send({"event": "result", "number": number, "result": function(*arguments)})
            else:
                _solve(number, payload, send, stops, channel)
        except Exception as error:
            from .oracles import carried

            send(
                {
                    "event": "error",
                    "number": number,
                    **carried(error),
                    "trace": traceback.format_exc(),
                    "last": stops.last,
                }
            )


def _solve(number: int, payload: Any, send: Any, stops: _Stops, channel: socket.socket) -> None:
    from ..contract.backend import Control
    from ..contract.registry import is_ours
    from ..run.execution import claim, execute
    from ..run.running import PATIENCE
    from .claims import claim_to_data
    from .oracles import Asking

    job, sent = payload
    if job.counts_compilation:
        # The clock is shared by all processes of a machine: the limit includes the start of this one.
        job = job.after(max(time.monotonic() - sent, 0.0))
    model = job.model
    asking = Asking(channel) if model.is_blinded else None

    def proven(bound: float) -> None:
        # At once, in the thread of the backend, because native code may block all others.
        send({"event": "bound", "number": number, "bound": bound})

    control = Control(patience=PATIENCE, oracle=asking, proven=proven)
    ours = is_ours(job.backend)
    stops.begin(number, control, ours)
    send({"event": "started", "number": number})

    def forward(event: Any) -> None:
        incumbent = event.incumbent
        if incumbent is None:
            return
        plan = None if incumbent.plan is None else model.plan_to_data(incumbent.plan)
        send(
            {
                "event": "incumbent",
                "number": number,
                "seconds": incumbent.seconds,
                "objective": incumbent.objective,
                "evaluations": incumbent.evaluations,
                "plan": plan,
            }
        )

    def preparing(begins: bool) -> None:
        send({"event": "preparing" if begins else "prepared", "number": number})

    hooks: dict[str, Any] = {"listener": forward, "on_prepare": preparing, "control": control}
    try:
        with shown(job.verbose):
            # The parent judges the plans of external backends.
            if model.is_blinded or (job.starts == 1 and not ours):
                message = {"event": "claim", "claim": claim_to_data(job, claim(job, **hooks))}
            else:
                message = {"event": "solution", "solution": execute(job, **hooks).to_dict()}
    finally:
        if asking is not None and not asking.close():
            control.abandon()
    # An incomplete line would not be read after the answer.
    sys.stdout.flush()
    flush_native()
    send({**message, "number": number, "last": stops.last})


if __name__ == "__main__":
    main()
