"""Ctrl-C: the first one asks what runs to stop, the second one raises."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["on_interrupt"]


#: What the first Ctrl-C calls, the innermost last.
_stops: list[Callable[[], object]] = []
_heard = False


@contextmanager
def on_interrupt(stop: Callable[[], object]) -> Iterator[None]:
    """Let the first Ctrl-C call `stop` instead of raising; a second one raises as usual.

    Within another one both are called. In threads, which hear no signals, and where the caller
    handles them, nothing changes.

    Parameters
    ----------
    stop : callable
        Called within the handler, in the main thread: it must take no lock that this thread holds.
    """
    global _heard
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.getsignal(signal.SIGINT)
    if previous is not _handle and previous is not signal.default_int_handler:
        yield  # the caller has a way of its own to stop us
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
