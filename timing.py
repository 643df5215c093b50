"""Clock and wall-clock limits of runs, without the time that kernels take to compile.

The dispatcher uses this module. :mod:`crosstrack.jit`, which only kernels need, reads the limits and
reports the compiling.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from time import perf_counter
from typing import Any

__all__ = [
    "Limit",
    "OutOfTime",
    "Watcher",
    "add_compile_time",
    "clock",
    "current_limit",
    "current_watchers",
    "stop_if",
    "watched",
    "within",
]

Watcher = Callable[[], AbstractContextManager[object]]

_watchers: list[Watcher] = []
#: Seconds spent compiling, in every thread of the process.
_spent = 0.0


class OutOfTime(Exception):
    """A computation was stopped by the limit of its run."""


def stop_if(flag: Any) -> None:
    """Raise :class:`OutOfTime` if the stop flag of a run, an array with one entry, is set; None is no flag."""
    if flag is not None and flag[0]:
        raise OutOfTime


class Limit:
    """Wall-clock limit of one run.

    Parameters
    ----------
    seconds : float, optional
        Seconds from now; None for no limit.
    share : float
        Share of `seconds` that interpreted kernels may use, in 0..1.
    allows_trial : bool
        Whether kernels may be interpreted while the background process compiles them. The seconds that
        this takes reduce what a run with a time limit or a stopping criterion achieves.

    Attributes
    ----------
    interpreted : set of str
        Names of the kernels that were interpreted because compiling does not fit.
    may_compile : bool
        False after compiling has taken far longer than expected, as on a busy machine. Kernels are then loaded
        from the cache or interpreted.
    """

    def __init__(
        self, seconds: float | None, share: float = 1.0, allows_trial: bool = True
    ) -> None:
        begin = perf_counter()
        whole = float("inf") if seconds is None else seconds
        self.end, self.interpretation_end = begin + whole, begin + share * whole
        self.interpreted: set[str] = set()
        self.allows_trial, self.may_compile = allows_trial, True

    def extend_interpretation(self, until: float) -> None:
        """Allow interpreted kernels until the time `until`, at most until the limit."""
        self.interpretation_end = max(self.interpretation_end, min(self.end, until))

    @property
    def is_interpreted_too_long(self) -> bool:
        """Whether interpreted kernels have exhausted their share of the time."""
        return bool(self.interpreted) and perf_counter() > self.interpretation_end


class _Here(threading.local):
    """Limit of the run in this thread."""

    limit: Limit | None = None


_here = _Here()
#: Limits of all runs of the process. A helper thread without a limit of its own uses the last.
_limits: list[Limit] = []


def clock() -> float:
    """Return ``time.perf_counter()`` minus the time spent compiling so far, in seconds."""
    return perf_counter() - _spent


def add_compile_time(seconds: float) -> None:
    """Subtract `seconds` of compiling from :func:`clock`."""
    global _spent
    _spent += seconds


def current_watchers() -> tuple[Watcher, ...]:
    """Return the functions to enter around a compilation."""
    return tuple(_watchers)


def current_limit() -> Limit:
    """Return the limit of the run that this thread belongs to."""
    limit = _here.limit or (_limits[-1] if _limits else None)
    return _UNLIMITED if limit is None else limit


_UNLIMITED = Limit(None)


@contextmanager
def within(limit: Limit) -> Iterator[None]:
    """Apply `limit` to the kernels called by this thread and by the helper threads of its run."""
    former, _here.limit = _here.limit, limit
    _limits.append(limit)
    try:
        yield
    finally:
        _limits.remove(limit)
        _here.limit = former


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Enter ``watcher()`` around each compilation in any thread of the process."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)
