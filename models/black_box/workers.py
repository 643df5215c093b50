"""Executors of a Python function: worker processes of crosstrack, or an executor of the user."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from ...errors import InvalidData
from ...timing import clock

__all__ = ["Outcome", "Pool", "pool_of", "serve"]

#: Result of a call, text of its error or "", and its seconds if known.
Outcome = tuple[Any, str, float | None]

#: Program of a worker process. Unlike one of ``multiprocessing``, it does not import the script of the user.
_PROGRAM = """
import sys
from multiprocessing.connection import Connection
channel = Connection(int(sys.argv[1]))
sys.path[:] = channel.recv()
from crosstrack.models.black_box.workers import serve
serve(channel)
"""


class _Process:
    """Worker process with a serialised function, which ends with its parent or when it is killed."""

    def __init__(self, body: bytes) -> None:
        self._channel, theirs = Pipe()
        command = [sys.executable, "-c", _PROGRAM, str(theirs.fileno())]
        with theirs:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        with contextlib.suppress(OSError):  # the next call detects a process that has ended
            self._channel.send(sys.path)
            self._channel.send_bytes(body)

    def call(self, at: Any) -> Outcome | InvalidData:
        """Return the outcome of a call, or why the process cannot run the function; ``EOFError`` if it ends."""
        self._channel.send(at)
        result: Outcome | InvalidData = self._channel.recv()
        return result

    def end(self) -> str:
        """Return how a process has ended."""
        code = self.process.wait()
        self._channel.close()
        return (
            f"ended its worker process ({f'exit code {code}' if code >= 0 else f'signal {-code}'})"
        )


class _Processes:
    """Worker processes that start when they are needed, each with one call at a time.

    A call that ends its process is therefore identified.
    """

    def __init__(self, body: bytes, count: int) -> None:
        self._body, self._max_workers, self._busy = body, count, 0
        self._lock = threading.Lock()
        self._waiting: deque[tuple[Future[Any], Any]] = deque()
        self._idle: list[_Process] = []
        self._all: set[subprocess.Popen[bytes]] = set()
        weakref.finalize(self, _kill, self._all)

    def submit(self, at: Any) -> Future[Any]:
        """Return the future of a call."""
        future: Future[Any] = Future()
        with self._lock:
            self._waiting.append((future, at))
            is_new = self._busy < self._max_workers
            self._busy += is_new
        if is_new:
            # Unlike the threads of an executor, it does not delay the end of the interpreter.
            threading.Thread(target=self._work, daemon=True).start()
        return future

    def _work(self) -> None:
        """Run calls until none is waiting."""
        while True:
            with self._lock:
                if not self._waiting:
                    self._busy -= 1
                    return
                future, at = self._waiting.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                outcome = self._outcome(at)
            except Exception as error:  # such as too many processes
                outcome = InvalidData(f"workers: {type(error).__name__}: {error}", field="workers")
            if isinstance(outcome, InvalidData):
                future.set_exception(outcome)
            else:
                future.set_result(outcome)

    def _outcome(self, at: Any) -> Outcome | InvalidData:
        with self._lock:
            process = self._idle.pop() if self._idle else None
        if process is None or process.process.poll() is not None:
            process = _Process(self._body)
            self._all.add(process.process)
        try:
            outcome = process.call(at)
        except (EOFError, OSError):
            self._all.discard(process.process)
            return None, process.end(), None
        with self._lock:
            self._idle.append(process)
        return outcome


def _kill(processes: set[subprocess.Popen[bytes]]) -> None:
    for process in tuple(processes):
        process.kill()
        process.wait()


class Pool:
    """Executor that calls one function: so many worker processes, or an executor of the user.

    `parallel` calls run at once, as many as processors if the executor does not reveal it.
    """

    def __init__(self, call: Callable[..., Any], workers: Any) -> None:
        own = isinstance(workers, int)
        self._call: tuple[Any, ...] = (call,)
        if own or isinstance(workers, ProcessPoolExecutor):
            import cloudpickle

            try:
                body = cloudpickle.dumps(call)
            except Exception as error:
                raise InvalidData(
                    "function cannot be sent to worker processes "
                    f"({type(error).__name__}: {error}): it must not refer to open files, locks or connections; "
                    "otherwise pass workers=ThreadPoolExecutor(n)",
                    field="workers",
                ) from None
            self._call = () if own else (_evaluate, body)
        self._executor: Any = _Processes(body, workers) if own else workers
        parallel = getattr(self._executor, "_max_workers", None)
        self.parallel = parallel if isinstance(parallel, int) else os.cpu_count() or 1

    def submit(self, at: Any, done: Callable[[Future[Any]], None]) -> Future[Any]:
        """Start a call and return its future, which is passed to `done` when the call ends."""
        try:
            future: Future[Any] = self._executor.submit(*self._call, at)
        except Exception as error:
            future = Future()
            future.set_exception(BrokenExecutor(str(error)))
        future.add_done_callback(done)
        return future

    def outcome(self, future: Future[Any]) -> Outcome:
        """Return result, error text and seconds of a call that has ended.

        A broken executor, and processes that cannot run the function, raise ``InvalidData``.
        """
        error = future.exception()
        if error is None:
            result = future.result()
            return (result, "", None) if len(self._call) == 1 else result
        text = f"{type(error).__name__}: {error}"
        if isinstance(error, BrokenExecutor):
            raise InvalidData(
                f"workers: the executor is broken or shut down ({text}); pass a new one",
                field="workers",
            )
        if len(self._call) != 1 or "pickle" in text.lower():
            raise error if isinstance(error, InvalidData) else _unsuitable(error)
        return None, f"raised {text}", None


def _unsuitable(error: BaseException) -> InvalidData:
    return InvalidData(
        f"function cannot run in a worker process ({type(error).__name__}: {error}): define it in a module that "
        "the process can import",
        field="function",
    )


#: Pool of each function; the processes end with the function.
_pools: weakref.WeakKeyDictionary[Any, Pool] = weakref.WeakKeyDictionary()


def pool_of(function: Any) -> Pool | None:
    """Return the pool of a Python function; None if it is called in this process."""
    if isinstance(function.workers, int) and function.workers == 1:
        return None
    if function not in _pools:
        _pools[function] = Pool(function.call, function.workers)
    return _pools[function]


@lru_cache(maxsize=8)
def _loaded(body: bytes) -> Callable[..., Any]:
    import cloudpickle

    result: Callable[..., Any] = cloudpickle.loads(body)
    return result


def _evaluate(body: bytes, at: Any) -> Outcome:
    """Return the outcome of a call in a worker process."""
    call, begin = _loaded(body), clock()
    try:
        return call(at), "", clock() - begin
    except (Exception, SystemExit) as error:
        return None, f"raised {type(error).__name__}: {error}", None


def serve(channel: Connection) -> None:
    """Run calls in a worker process until its parent closes the channel."""
    with contextlib.suppress(EOFError, OSError):
        body = channel.recv_bytes()
        while True:
            at = channel.recv()
            outcome: Outcome | InvalidData
            try:
                outcome = _evaluate(body, at)
            except Exception as error:
                outcome = _unsuitable(error)
            try:
                channel.send(outcome)
            except (TypeError, ValueError, AttributeError) as error:
                channel.send(_unsuitable(error))
