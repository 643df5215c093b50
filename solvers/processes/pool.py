"""Idle worker processes that wait for the next call of this process."""

from __future__ import annotations

import atexit
import os
import queue
import threading
from typing import Any

from ..contract.backend import Backend
from ..contract.events import Event, Listener
from ..contract.job import Job
from ..contract.registry import rivals
from ..contract.solution import Solution
from .interrupts import on_interrupt
from .isolation import Worker

__all__ = ["in_worker"]

_idle: list[Worker] = []
_lock = threading.Lock()
#: Largest number of idle workers.
_MOST_IDLE = 2

#: Workers of the process that this one was forked from.
_parents: list[Worker] = []


@atexit.register
def _close_idle() -> None:
    with _lock:
        while _idle:
            _idle.pop().close()


def _leave_idle() -> None:
    """Detach the parent's workers after a fork; references are kept so that their pipes stay open."""
    global _lock
    _lock = threading.Lock()  # a thread of the parent may hold the old lock
    _parents.extend(_idle)
    _idle.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_idle)


def in_worker(job: Job, *, listener: Listener | None = None) -> Solution[Any]:
    """Run `job`, validated and with its backend resolved, in a worker that is reused for later jobs.

    `listener` is called with every incumbent and bound, in this thread. The first Ctrl-C requests
    the incumbent, a second one kills the worker.
    """
    backend = job.backend
    assert isinstance(backend, Backend)
    with _lock:
        fitting = next((worker for worker in _idle if not rivals(backend) & worker.loaded), None)
        if fitting is not None:
            _idle.remove(fitting)
    worker = fitting or Worker()
    # A queue instead of a join: after an interrupted join, CPython 3.11 treats its thread as ended.
    box: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def work() -> None:
        try:
            box.put(worker.solve(job, listener=None if listener is None else box.put))
        except BaseException as error:  # raised again in the waiting thread
            box.put(error)

    try:
        threading.Thread(target=work, name="crosstrack-worker", daemon=True).start()
        with on_interrupt(worker.interrupt):
            while isinstance(outcome := box.get(), Event):
                assert listener is not None
                listener(outcome)
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
