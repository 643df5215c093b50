"""Output of solvers, captured from the file descriptors and sent to the logger ``crosstrack.output``.

Native code bypasses Python and prints to the file descriptor of standard output, which the calling
program may use for its own output. Lines requested by the user (``verbose=True``) are logged as
``INFO``, all others as ``DEBUG``.
"""

from __future__ import annotations

import ctypes
import io
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any

__all__ = ["Diverted", "Lines", "Printed", "by_lines", "captured", "flush_native", "shown"]

log = logging.getLogger("crosstrack.output")

_BLOCK = 1 << 16


class Lines:
    """Reader that logs the lines that others write to a file.

    Parameters
    ----------
    descriptor : int
        Descriptor of the open file. Its position is not changed.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._at = 0

    def forward(self, level: int, *, rest: bool = False) -> None:
        """Log the new lines, and with `rest` also an incomplete last line."""
        if not log.isEnabledFor(level):
            return
        # Read only what exists now: a process that prints endlessly must not block the reader.
        unread = os.fstat(self._descriptor).st_size - self._at
        while unread > 0 and (block := os.pread(self._descriptor, min(_BLOCK, unread), self._at)):
            size = block.rfind(b"\n") + 1
            if not size:
                if not rest and len(block) < _BLOCK:
                    return
                size = len(block)
            self._at += size
            unread -= size
            for line in block[:size].decode(errors="replace").splitlines():
                if line.strip():
                    log.log(level, "%s", line)


@contextmanager
def shown(verbose: bool) -> Iterator[None]:
    """Let ``INFO`` lines pass, and show them on standard error if no handler is configured."""
    if not verbose:
        yield
        return
    level, handler = log.level, logging.StreamHandler()
    quiet = not log.hasHandlers()
    log.setLevel(min(level or logging.INFO, logging.INFO))
    if quiet:
        log.addHandler(handler)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


def by_lines() -> None:
    """Write the output of this process, which its parent reads, line by line.

    A crash then loses no complete line.
    """
    global _read_by_parent
    _read_by_parent = True
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    system, stream = _native_stdout()
    system.setvbuf(stream, None, 1, 0)  # 1 is _IOLBF


def _native_stdout() -> tuple[ctypes.CDLL, ctypes.c_void_p]:
    """Return the C library and its ``FILE`` pointer of standard output."""
    system = ctypes.CDLL(None)
    name = "__stdoutp" if sys.platform == "darwin" else "stdout"
    return system, ctypes.c_void_p.in_dll(system, name)


def flush_native() -> None:
    """Flush the buffer of the C library for standard output."""
    system, stream = _native_stdout()
    system.fflush(stream)


class Diverted:
    """Redirection of file descriptor 1; Python's ``sys.stdout`` keeps its target.

    Parameters
    ----------
    descriptor : int
        Descriptor that receives the output of native code.

    Raises
    ------
    OSError
        Standard output is closed.
    """

    def __init__(self, descriptor: int) -> None:
        flush_native()
        self._place = os.dup(1)
        # The stream objects are kept, because others, such as log handlers, refer to them.
        self._streams = []
        for stream in {id(item): item for item in (sys.stdout, sys.__stdout__)}.values():
            buffer: Any = getattr(stream, "buffer", None)
            raw = getattr(buffer, "raw", buffer)
            if isinstance(raw, io.FileIO) and not raw.closed and raw.fileno() == 1:
                io.FileIO.__init__(raw, self._place, "w", closefd=False)
                self._streams.append(raw)
        os.dup2(descriptor, 1)

    def end(self) -> None:
        """Restore file descriptor 1 and the streams."""
        flush_native()
        os.dup2(self._place, 1)
        for raw in self._streams:
            io.FileIO.__init__(raw, 1, "w", closefd=False)
        os.close(self._place)


class _Split:
    """Standard output that logs the lines of some threads and passes on those of the others."""

    def __init__(self, target: Any, level: Callable[[], int]) -> None:
        self.target = target
        self._level = level
        #: Incomplete line of each logged thread.
        self.threads: dict[int, str] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self.target, name)

    def write(self, text: str) -> int:
        thread = threading.get_ident()
        if thread not in self.threads:
            return int(self.target.write(text))
        *lines, self.threads[thread] = (self.threads[thread] + text).split("\n")
        for line in lines:
            self.say(line)
        return len(text)

    def say(self, line: str) -> None:
        if line.strip():
            log.log(self._level(), "%s", line)

    def flush(self) -> None:
        if threading.get_ident() not in self.threads:
            self.target.flush()


class _Capture:
    """Redirection of standard output to the logger, shared by all concurrent runs."""

    def __init__(self) -> None:
        import tempfile  # a tenth of the start time of the command line

        self.runs = 0
        self.level = logging.DEBUG
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="crosstrack-output-")  # noqa: SIM115 (closed with the last run)
        self._lines = Lines(self._file.fileno())
        self._diverted = Diverted(self._file.fileno())
        self.split = _Split(sys.stdout, lambda: self.level)
        sys.stdout = self.split

    def forward(self) -> None:
        flush_native()
        self._lines.forward(self.level)

    def close(self) -> None:
        if sys.stdout is self.split:  # unless it was replaced meanwhile
            sys.stdout = self.split.target
        self._diverted.end()
        self._lines.forward(self.level, rest=True)
        self._file.close()


_lock = threading.RLock()
_read_by_parent = False
_capture: _Capture | None = None


@dataclass(frozen=True)
class Printed:
    """Captured output of a solver.

    Parameters
    ----------
    shared : _Capture, optional
        The redirection; None if nothing is captured.
    """

    shared: _Capture | None

    def forward(self) -> None:
        """Log the output so far."""
        with _lock:
            if self.shared is not None and self.shared.runs:
                self.shared.forward()

    @contextmanager
    def by_this_thread(self) -> Iterator[None]:
        """Also log the lines that this thread writes to Python's ``sys.stdout``, as some solvers do."""
        if self.shared is None:
            yield
            return
        split, thread = self.shared.split, threading.get_ident()
        split.threads[thread] = ""
        try:
            yield
        finally:
            split.say(split.threads.pop(thread))


@contextmanager
def captured(verbose: bool, *, quiet: bool) -> Iterator[Printed]:
    """Log the output of a solver within the block.

    Parameters
    ----------
    verbose : bool
        Whether to log lines as ``INFO`` instead of ``DEBUG``.
    quiet : bool
        Whether the solver prints nothing, so that nothing is captured. In a worker nothing is
        captured either, because the parent reads its output.
    """
    global _capture
    if quiet or _read_by_parent:
        yield Printed(None)
        return
    shared: _Capture | None = None
    with _lock:
        try:
            shared = _capture = _capture or _Capture()
            shared.runs += 1
            if verbose:
                shared.level = logging.INFO
        except OSError as error:  # standard output is closed, or the disk is full
            log.debug("output of solvers is not captured: %s", error)

    try:
        yield Printed(shared)
    finally:
        with _lock:
            if shared is not None:
                shared.runs -= 1
                if not shared.runs:
                    _capture = None
                    shared.close()
