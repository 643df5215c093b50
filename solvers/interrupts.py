"""Ctrl-C: the first one asks what runs to stop, the second one raises."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["on_interrupt"]


@contextmanager
def on_interrupt(stop: Callable[[], object]) -> Iterator[None]:
    """Let the first Ctrl-C call `stop` instead of raising; a second one raises as usual.

    In threads, which hear no signals, and where the caller handles them, nothing changes.

    Parameters
    ----------
    stop : callable
        Called within the handler, in the main thread: it must take no lock that this thread holds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.getsignal(signal.SIGINT)
    if previous is not signal.default_int_handler:
        yield  # the caller has a way of its own to stop us
        return
    heard = False

    def handler(number: int, frame: Any) -> None:
        nonlocal heard
        if heard:
            signal.default_int_handler(number, frame)
        heard = True
        stop()

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
