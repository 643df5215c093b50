"""Background process that compiles kernels, for the run that waits for them and for later runs."""

from __future__ import annotations

import atexit
import contextlib
import dis
import gc
import hashlib
import importlib
import logging
import operator
import os
import pickle
import queue
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import IO, Any

log = logging.getLogger("crosstrack")

__all__ = [
    "called",
    "callees",
    "compile_here",
    "expected_seconds",
    "is_cached",
    "make_dispatcher",
    "may_be_cached",
    "name_by_key",
    "request",
    "serve",
    "slowdown",
    "stamp_of",
    "survey",
    "type_of_callee",
    "wait_for",
]

#: Niceness of the background process if no run waits for it: it must not slow the run that it serves.
_NICE = 10
#: Seconds between two looks at the clock and at the process while a run waits.
_POLL = 0.05
#: Seconds between two looks of the background process at its parent.
_LOOK = 0.5
#: Measured compile time in seconds per instruction of a kernel and of the kernels it calls.
_PER_INSTRUCTION = 2.2e-3
#: Errors on reading damaged files. They do not include the end of a run by its limit.
_DAMAGED = (
    pickle.UnpicklingError, EOFError, AttributeError, ImportError, LookupError, TypeError, ValueError, RuntimeError
)  # fmt: skip
#: Numbers from here on may have another compiled type.
_LARGE = 2.0**63

_lock = threading.Lock()
_process: subprocess.Popen[bytes] | None = None
#: Niceness with which it was started.
_niceness = 0
#: Requests that its thread has not written yet.
_bodies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
_writer: threading.Thread | None = None
#: Events of the requests that have not ended, in order.
_events: deque[threading.Event] = deque()
#: Seconds that the end of this process waits for the thread.
_LEAVING = 0.2
#: Events by request, set when the background process has ended the request.
_requested: dict[bytes, threading.Event] = {}
#: True in a process that compiles the kernels itself, such as the background process.
_is_here = False


def may_be_cached(function: Callable[..., Any]) -> bool:
    """Return False if Numba's cache on disk holds nothing of `function`; it is found without importing Numba.

    Parameters
    ----------
    function : callable
        The Python function of a kernel.
    """
    source = Path(function.__code__.co_filename)
    own = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(own) if own else source.parent / "__pycache__"
    name = function.__qualname__
    if "<" in name or not (own or os.access(folder, os.W_OK)):
        return True  # Numba changes the name, or takes a folder of the user
    pattern = f"{source.stem}.{name}-*.nbi"
    return any(folder.glob(f"*/{pattern}" if own else pattern))


def is_cached(dispatcher: Any, arguments: tuple[Any, ...]) -> bool:
    """Return whether Numba's cache on disk contains `dispatcher` compiled for these arguments."""
    cache: Any = getattr(dispatcher, "_cache", None)
    file = getattr(cache, "_cache_file", None)
    if file is None:
        return False
    import numba

    type_of: Any = numba.typeof
    signature = tuple(type_of(value) for value in arguments)
    try:
        key = cache._index_key(signature, dispatcher.targetctx.codegen())
        return key in file._load_index()
    except Exception as error:  # a private interface: without it kernels are compiled again
        log.debug("the cache of compiled code cannot be read", exc_info=error)
        return False


def make_dispatcher(kernel: Any, has_wrapper: bool) -> Any:
    """Return Numba's dispatcher of a kernel; only compiled code can call one without the wrapper for Python."""
    import numba

    # Each wrapper takes a tenth of the compile time. That for calls from C is unused.
    options: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
    options["no_cpython_wrapper"] = not has_wrapper
    if not kernel.allocates:
        options["_nrt"] = False
    try:
        dispatcher = numba.njit(cache=True, **options)(kernel.py_func)
    except RuntimeError as error:
        # Neither the source folder nor the user's cache folder is writable.
        log.info("compiled code is not kept: %s", error)
        return numba.njit(**options)(kernel.py_func)
    # Numba's cache checks this function's file alone, and would call outdated code of a
    # kernel in another file.
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if file is not None:  # None if NUMBA_DISABLE_JIT is set
        name_by_key(file, stamp_of(kernel))
        load_quickly(dispatcher._cache)
        if not has_wrapper:
            mark_keys(dispatcher._cache)
    return dispatcher


def name_by_key(file: Any, stamp: object) -> None:
    """Make Numba's cache name compiled code by its types and `stamp`, and write its index last.

    Numba numbers the code of a kernel in the order of the index that it has read. Two processes
    that compile one kernel for different types at the same time choose the same number, and a later
    run loads the code for the other types.

    Parameters
    ----------
    file : numba.core.caching.IndexDataCacheFile
        The cache of one kernel; it is changed in place.
    stamp : object
        Value that changes when the kernel's code does.
    """

    def save(key: Any, data: Any) -> None:
        digest = hashlib.sha256(pickle.dumps((stamp, key))).hexdigest()
        name = file._data_name(int(digest[:15], 16))
        file._save_data(name, data)
        file._save_index({**file._load_index(), key: name})

    file._source_stamp = stamp
    file.save = save


def load_quickly(cache: Any) -> None:
    """Make `cache` load compiled code without Numba's tables for compiling, whose import takes longer.

    Files that cannot be read, such as truncated ones, are replaced.
    """
    from numba.core.runtime.nrt import rtsys

    load_index = cache._cache_file._load_index

    def load(signature: Any, context: Any) -> Any:
        rtsys.initialize(context)
        try:
            with cache._guard_against_spurious_io_errors():
                return cache._load_overload(signature, context)
        except _DAMAGED as error:
            log.info("compiled code cannot be read, and is compiled again", exc_info=error)
            return None

    def read_index() -> Any:
        try:
            return load_index()
        except _DAMAGED as error:
            log.info("the index of compiled code cannot be read", exc_info=error)
            return {}

    cache.load_overload, cache._cache_file._load_index = load, read_index


def mark_keys(cache: Any) -> None:
    """Give the compiled code of `cache` other keys than that of the same kernel with a wrapper."""
    key_of = cache._index_key
    cache._index_key = lambda *arguments: (*key_of(*arguments), "no wrapper")


def request(
    module: str, name: str, arguments: tuple[Any, ...], *, nice: int = _NICE
) -> threading.Event | None:
    """Compile the kernel `name` of `module` for the types of `arguments` in the background.

    The first request starts the background process. It ends after the last request, once this
    process has ended.

    Parameters
    ----------
    module : str
        Name of the module that defines the kernel.
    name : str
        Qualified name of the kernel in the module.
    arguments : tuple
        Arguments of a call; numbers, lists and arrays are described by type, not by value, so that
        calls with other values are no further requests.
    nice : int
        Largest niceness of the background process. A process with a larger one, which a busy machine may not
        run, ends after its requests, and another one is started.

    Returns
    -------
    threading.Event or None
        The event is set when the request has ended, with or without success. None if another process
        cannot compile the kernel.
    """
    global _process, _niceness, _bodies, _events, _writer
    if not sys.executable or getattr(sys, "frozen", False):  # an application without an interpreter
        return None
    try:
        body = pickle.dumps((module, name, [_describe(value) for value in arguments]))
    except Exception as error:  # a class that other processes cannot import
        log.debug("%s.%s cannot be compiled elsewhere", module, name, exc_info=error)
        return None
    with _lock:
        if not is_running():
            for waiting in _requested.values():
                waiting.set()
        is_running_slowly = is_running() and _niceness > nice
        event = _requested.get(body)
        if event is not None and (event.is_set() or not is_running_slowly):
            return event
        if is_running_slowly:
            _bodies.put(None)
            for other in [key for key, value in _requested.items() if not value.is_set()]:
                del _requested[other]  # later requests must not wait for it
        if is_running_slowly or not is_running():
            _bodies, _events = queue.SimpleQueue(), deque()
            command = f"from crosstrack.compilation import serve; serve({nice}, {os.getpid()})"
            try:
                _process = subprocess.Popen(
                    [sys.executable, "-P", "-c", command],
                    bufsize=0,  # a fork must not copy half a request
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                )
            except OSError as error:  # processes are not allowed, or memory is short
                log.debug("no process can be started", exc_info=error)
                return None
            _niceness = nice if hasattr(os, "nice") else 0
            log.info("kernels are being compiled in the background")
            # A thread writes, because the pipe of a process that compiles can be full for seconds.
            _writer = threading.Thread(target=_send, args=(_process.stdin, _bodies), daemon=True)
            _writer.start()
            read = (_process.stdout, _events, _process)
            threading.Thread(target=_receive, args=read, daemon=True).start()
        event = event or threading.Event()  # the first of two processes sets it
        _requested[body] = event
        _events.append(event)
        _bodies.put(body)
        return event


def _after_fork() -> None:
    """Forget the background process of the parent in a forked process."""
    global _process, _lock
    _lock = threading.Lock()  # another thread of the parent may have held it
    _requested.clear()
    if _process is not None:
        _process.returncode = 0
        for stream in (_process.stdin, _process.stdout):
            if stream is not None:
                stream.close()
        _process = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def is_running() -> bool:
    """Return whether the background process runs."""
    return _process is not None and _process.poll() is None


def wait_for(module: str, name: str, arguments: tuple[Any, ...], end: float) -> bool:
    """Compile a kernel in the background, and wait for it.

    Parameters
    ----------
    module, name, arguments
        As in :func:`request`.
    end : float
        Time of ``time.perf_counter()`` at which the wait ends, in seconds.

    Returns
    -------
    bool
        False if the time is over. True also if the kernel cannot be compiled in another process.
    """
    event = None if _is_here else request(module, name, arguments, nice=0)
    while event is not None and not event.wait(_POLL) and is_running():
        if time.perf_counter() > end:
            return False
    return True


def slowdown() -> float:
    """Return how many processes share a processor, at least 1, from the load average of the last minute."""
    try:
        return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    except (AttributeError, OSError):  # Windows has no load average
        return 1.0


@cache
def type_of_callee() -> Any:
    """Return the class of Numba types of kernels that compiled code calls."""
    from numba import types
    from numba.extending import models, register_model

    plain: Any = types.unliteral

    class Callee(types.Dispatcher):
        """Kernel called by kernels; constant arguments are compiled as variables of their type."""

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            return super().get_call_type(context, tuple(plain(argument) for argument in args), kws)

    register_model(Callee)(models.OpaqueModel)
    return Callee


@cache
def survey(function: Callable[..., Any]) -> tuple[frozenset[str], int, bool]:
    """Return the global names in the bytecode of `function`, its number of instructions, and whether it loops."""
    # Attributes are no global names, and the entries of the inline cache differ from version to version.
    code = [(part.opname, part.argval) for part in dis.get_instructions(function)]
    names = frozenset(value for name, value in code if name == "LOAD_GLOBAL")
    return names, len(code), any("JUMP_BACKWARD" in name for name, _ in code)


def called(kernel: Any) -> dict[str, Any]:
    """Return the kernels that `kernel` calls directly, by name."""
    names = kernel.py_func.__globals__
    parts = {name: names.get(name) for name in survey(kernel.py_func)[0]}
    return {name: part for name, part in parts.items() if isinstance(part, type(kernel))}


def callees(kernel: Any) -> set[Any]:
    """Return `kernel` and the kernels that it calls, directly or through others."""
    result: set[Any] = set()
    todo = [kernel]
    while todo:
        item = todo.pop()
        if item not in result:
            result.add(item)
            todo += called(item).values()
    return result


def expected_seconds(kernel: Any) -> float:
    """Return the expected compile time of `kernel` and of the kernels that it calls, in seconds."""
    return _PER_INSTRUCTION * sum(survey(part.py_func)[1] for part in callees(kernel))


def stamp_of(kernel: Any) -> tuple[object, ...]:
    """Return the state of the code of `kernel` and its callees.

    It consists of name, time and size of all Python files in their folders, and whether each kernel allocates.
    """
    parts = callees(kernel)
    folders = {Path(item.py_func.__code__.co_filename).parent for item in parts}
    files = sorted(path for folder in folders for path in folder.glob("*.py"))
    # An editor's lock file may be a dangling link, for which stat() raises.
    stamps = ((path.name, path.lstat()) for path in files)
    flags = sorted((item.py_func.__name__, item.allocates) for item in parts)
    return *((name, stamp.st_mtime_ns, stamp.st_size) for name, stamp in stamps), *flags


def compile_here() -> None:
    """Compile every kernel in this process from now on."""
    global _is_here
    _is_here = True


def _receive(
    stream: IO[bytes], events: deque[threading.Event], process: subprocess.Popen[bytes]
) -> None:
    """Set the event of each request that has ended; the background process writes a byte for each."""
    with stream:
        while stream.read(1):
            events.popleft().set()
    process.wait()


def _send(stream: IO[bytes], bodies: queue.SimpleQueue[bytes | None]) -> None:
    """Write the requests until None, and close the pipe."""
    # If the process was killed, the next run compiles.
    with contextlib.suppress(OSError), stream:
        for body in iter(bodies.get, None):
            data = struct.pack("<Q", len(body)) + body
            while data:
                data = data[stream.write(data) :]


@atexit.register
def _leave() -> None:
    """Detach the background process without Python's warning that it still runs."""
    if _process is not None and _writer is not None:
        _bodies.put(None)
        _writer.join(_LEAVING)  # the end of this process closes the pipe otherwise
        _process.returncode = 0


def _yield_at_end(parent: int, nice: int) -> None:
    """Raise the niceness of this process when its parent has ended, and no run waits for it."""
    while os.getppid() == parent:
        time.sleep(_LOOK)
    process = os.PRIO_PROCESS, os.getpid()
    os.setpriority(*process, os.getpriority(*process) + _NICE - nice)


def serve(nice: int, parent: int) -> None:
    """Compile the kernels requested on standard input until its end.

    Parameters
    ----------
    nice : int
        Niceness while the process `parent` runs.
    parent : int
        Identifier of the process that sends the requests.
    """
    compile_here()
    gc.set_threshold(50_000, 20, 50)  # saves 5 % of the time of compiling, for 20 MB
    if hasattr(os, "nice"):
        os.nice(nice)
        if nice < _NICE:
            threading.Thread(target=_yield_at_end, args=(parent, nice), daemon=True).start()
    stream, answers = sys.stdin.buffer, os.dup(1)
    os.dup2(2, 1)  # output of a compiler is not an answer
    while len(head := stream.read(8)) == 8:
        module, name, description = pickle.loads(stream.read(struct.unpack("<Q", head)[0]))
        with contextlib.suppress(Exception):  # the run that needs the kernel reports the error
            kernel = operator.attrgetter(name)(importlib.import_module(module))
            kernel.compile_for(tuple(_sample(part) for part in description))
        with contextlib.suppress(OSError):  # the run has ended; its requests are compiled anyway
            os.write(answers, b".")


def _describe(value: Any) -> Any:
    """Return a description of the compiled type of `value`, without numbers and entries of arrays."""
    import numpy as np

    is_real = isinstance(value, int | float | np.integer | np.floating | np.bool_)
    if is_real and abs(float(value)) < _LARGE:
        return "value", type(value)(0)
    if isinstance(value, list) and value:
        return "list", _describe(value[0])
    if isinstance(value, np.ndarray):
        order = "C" if value.flags.c_contiguous else "F" if value.flags.f_contiguous else "A"
        return "array", value.dtype, value.ndim, order, value.flags.writeable
    if isinstance(value, tuple):
        kind = type(value) if hasattr(value, "_fields") else None
        return "tuple", kind, [_describe(part) for part in value]
    return "value", value


def _sample(description: Any) -> Any:
    """Return a value with the types in `description`."""
    import numpy as np

    if description[0] == "value":
        return description[1]
    if description[0] == "list":
        return [_sample(description[1])]
    if description[0] == "tuple":
        parts = [_sample(part) for part in description[2]]
        return tuple(parts) if description[1] is None else description[1](*parts)
    _, dtype, dimensions, order, writeable = description
    array = np.zeros((4,) * dimensions, dtype, order="F" if order == "F" else "C")
    if order == "A":
        array = array[(slice(None, None, 2),) * dimensions]
    array.flags.writeable = writeable
    return array
