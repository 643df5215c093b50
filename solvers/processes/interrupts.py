"""Ctrl-C handling: the first one requests a stop, the second one raises."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["on_interrupt"]


#: Stop functions that the first Ctrl-C calls, the innermost last.
_stops: list[Callable[[], object]] = []
_heard = False


@contextmanager
def on_interrupt(stop: Callable[[], object]) -> Iterator[None]:
    """Call `stop` on the first Ctrl-C instead of raising; a second Ctrl-C raises.

    Nested blocks call all their functions. The handling does not change in threads other than the
    main thread, which receive no signals, or if the caller has installed a handler.

    Parameters
    ----------
    stop : callable
        Function called within the signal handler, in the main thread. It must not take a lock
        that this thread may hold.
    """
    global _heard
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.getsignal(signal.SIGINT)
    if previous is not _handle and previous is not signal.default_int_handler:
        yield  # the caller's handler stops the run
        return
    if previous is not _handle:
        _heard = False
    signal.signal(signal.SIGINT, _handle)
    _stops.append(stop)
    try:
        yield
    finally:
        _stops.pop()
        signal.signal(signal.SIGINT, previous)


def _handle(number: int, frame: Any) -> None:
    global _heard
    if _heard:
        signal.default_int_handler(number, frame)
    _heard = True
    for stop in reversed(_stops):
        stop()
