"""A worker process: jobs in by cloudpickle, JSON lines out. ``python -m crosstrack.solvers.worker``.

Each message in is eight bytes of length and a pickle of ``(path, number, (verb, payload))``, the
inner pair pickled by itself; each line out is an object with ``event``: ``ready``, ``preparing``, ``prepared``, ``incumbent``,
``solution``, ``result`` or ``error``. Whatever native code prints goes to standard error, so that
it cannot garble the lines. The worker ends when its input does, even in the middle of a run.
"""

from __future__ import annotations

import json
import os
import pickle
import queue
import signal
import struct
import sys
import threading
import traceback
from typing import Any, BinaryIO

__all__ = ["main"]


def _read(stream: BinaryIO) -> bytes | None:
    head = stream.read(8)
    if len(head) < 8:
        return None
    (size,) = struct.unpack("<Q", head)
    body = stream.read(size)
    return body if len(body) == size else None


def main() -> None:
    """Serve jobs until the input ends."""
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    jobs: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    lock = threading.Lock()

    def send(message: dict[str, Any]) -> None:
        with lock:
            lines.write(json.dumps(message, ensure_ascii=False) + "\n")
            lines.flush()

    def listen() -> None:
        while (body := _read(sys.stdin.buffer)) is not None:
            jobs.put(body)
        # The parent is gone or wants no more: nobody is left to hear an answer.
        os._exit(0)

    threading.Thread(target=listen, name="crosstrack-listen", daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    send({"event": "ready", "pid": os.getpid()})
    while True:
        body = jobs.get()
        number = -1
        try:
            path, number, body = pickle.loads(body)
            sys.path[:] = list(dict.fromkeys([*path, *sys.path]))
            verb, payload = pickle.loads(body)
            if verb == "call":
                function, arguments = payload
                send({"event": "result", "number": number, "result": function(*arguments)})
            else:
                _solve(number, payload, send)
        except Exception as error:
            send(
                {
                    "event": "error",
                    "number": number,
                    "type": type(error).__name__,
                    "message": str(error),
                    "trace": traceback.format_exc(),
                }
            )


def _solve(number: int, job: Any, send: Any) -> None:
    from .assembly import claim_to_data
    from .backend import Control, Limit
    from .execution import claim, execute

    model = job.model
    control = Control()
    signal.signal(signal.SIGINT, lambda *_: control.stop(Limit.INTERRUPTED))

    def heard(incumbent: Any) -> None:
        plan = None if incumbent.plan is None else model.plan_to_data(incumbent.plan)
        send(
            {
                "event": "incumbent",
                "number": number,
                "seconds": incumbent.seconds,
                "objective": incumbent.objective,
                "plan": plan,
            }
        )

    def preparing(begins: bool) -> None:
        send({"event": "preparing" if begins else "prepared", "number": number})

    how: dict[str, Any] = {"listener": heard, "on_prepare": preparing, "control": control}
    message: dict[str, Any]
    try:
        if model.is_blinded:
            data = claim_to_data(job, claim(job, **how))
            message = {"event": "claim", "number": number, "claim": data}
        else:
            data = execute(job, **how).to_dict()
            message = {"event": "solution", "number": number, "solution": data}
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    send(message)


if __name__ == "__main__":
    main()
