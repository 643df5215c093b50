"""Decorator for loops on plain arrays, which are interpreted at first and compiled later.

Importing Numba takes half a second and compiling takes longer. Small problems need neither, so the
first :data:`BUDGET` seconds that a process spends in kernels are interpreted. The source is the same
and the results are equal bit for bit. A kernel that exhausts the budget restarts compiled. From then
on every kernel is compiled at its first call, or loaded from the cache on disk.

A kernel that takes long to compile is compiled by a background process, for which the run waits
(:mod:`crosstrack.compilation`): Numba would hold the interpreter's lock, so that neither Ctrl-C nor a
limit could end the call. A run with a wall-clock limit (:func:`within`) waits only if the expected time
fits in the time left. Otherwise the kernel is interpreted until the limit, and compiled for later runs.
"""

from __future__ import annotations

import ctypes
import logging
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any, TypeVar, cast, overload

from . import compilation
from .timing import (
    Limit,
    OutOfTime,
    add_compile_time,
    clock,
    current_limit,
    current_watchers,
    watched,
    within,
)

log = logging.getLogger("crosstrack")

__all__ = [
    "BUDGET",
    "MOST_LABELS",
    "Kernel",
    "Limit",
    "OutOfTime",
    "clock",
    "compile_always",
    "end_interpretation",
    "interpreting",
    "kernel",
    "watched",
    "within",
]

#: Largest number of labels in one search, about 3 GB. A search that exceeds it stops.
MOST_LABELS = 50_000_000
#: Interpretation time of a process, in seconds of CPU. It equals the time to import Numba and load compiled
#: code, so a run takes at most about twice the time of the better choice, on a busy machine, too.
BUDGET = 0.5
#: Largest array that is interpreted, in entries. A loop that calls no kernel detects only at its end
#: that the budget is exhausted, and takes about 10 µs per entry.
_MOST = 30_000
#: Measured compile time in seconds per bytecode of a kernel and of the kernels it calls.
_PER_BYTECODE = 1.5e-3
#: Expected compile time in seconds from which on the background process compiles. It starts in 0.7 s.
_APART = 0.5
#: Seconds of compiling after which a warning is logged.
_SILENCE = 1.0
#: Seconds for importing Numba and loading the first compiled code (0.35 measured), and for loading another
#: kernel with all that it calls (at most 0.02 measured, for 46 kernels).
_IMPORT, _LOAD = 0.4, 0.03
#: Largest share of the time left for compiling; other processes may slow it down.
_SHARE = 0.15
#: Seconds that an interpreted kernel may run beyond the limit, to return its current result.
_GRACE = 0.2

F = TypeVar("F", bound=Callable[..., Any])

_left = BUDGET
_compiling = threading.RLock()


class _BudgetUsedUp(Exception):
    """The interpretation budget is exhausted.

    Kernels called by an interpreted kernel raise it, and the outermost kernel catches it.
    """


class _DoesNotFit(Exception):
    """Compiling is expected to take more time than is left."""


class _Here(threading.local):
    """Thread-local state: the kernel being interpreted."""

    #: CPU time of the thread at which the budget ends; 0 outside of interpreted kernels.
    deadline = 0.0
    #: Limit of the kernel that is interpreted because compiling takes too long, and its start time.
    stretched: Limit | None = None
    begun = 0.0


_here = _Here()
#: Threads that a stop request may end: they interpret a kernel, or wait for one to be compiled.
_ending: set[int] = set()


class Kernel:
    """Function on plain arrays, interpreted or compiled.

    Parameters
    ----------
    function : callable
        The loop in Python, available as ``.py_func``.
    interpretable : bool
        Whether calls from outside of kernels may be interpreted; see :func:`kernel`.
    """

    def __init__(self, function: Callable[..., Any], interpretable: bool) -> None:
        self.py_func = function
        self.interpretable = interpretable
        self._ready = False
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the loop; kernels called by a kernel run in the mode of their caller."""
        global _left
        deadline = _here.deadline
        if deadline:
            if thread_time() > deadline:
                raise _BudgetUsedUp
            return self.py_func(*arguments)
        if _here.stretched is not None:
            if perf_counter() > max(_here.stretched.interpretation_end, _here.begun) + _GRACE:
                raise OutOfTime
            return self.py_func(*arguments)
        if not self._ready:
            if self.interpretable and _left > 0.0 and _is_small(arguments):
                _here.deadline = (begin := thread_time()) + _left
                try:
                    return self._interpret(arguments)
                except _BudgetUsedUp:
                    log.debug("%s starts again, compiled", self.py_func.__name__)
                finally:
                    _here.deadline = 0.0
                    _left -= thread_time() - begin
        try:
            if not self._ready:
                self._compile(arguments)
            return self.dispatcher(*arguments)
        except _DoesNotFit:
            return self._stretch(arguments)

    def _stretch(self, arguments: tuple[Any, ...]) -> Any:
        """Interpret the loop until the limit of the run, and compile it in the background."""
        limit = current_limit()
        limit.interpreted.add(self.py_func.__name__)
        compilation.request(self.py_func.__module__, self.py_func.__qualname__, arguments)
        _here.stretched, _here.begun = limit, perf_counter()
        try:
            return self._interpret(arguments)
        finally:
            _here.stretched = None

    def _interpret(self, arguments: tuple[Any, ...]) -> Any:
        import numpy as np

        thread = threading.get_ident()
        _ending.add(thread)
        try:
            with np.errstate(all="ignore"):
                return self.py_func(*arguments)
        finally:
            _ending.discard(thread)

    def _require_time(self, arguments: tuple[Any, ...] | None) -> None:
        """Raise unless the time left suffices to compile for `arguments` or to load compiled code."""
        left = current_limit().end - perf_counter()
        if left == float("inf"):
            return
        seconds = 0.0 if "numba" in sys.modules else _IMPORT
        if left <= seconds + _LOAD:
            raise _DoesNotFit
        if seconds + self._compile_seconds <= _SHARE * left:
            return
        if "numba" not in sys.modules and not compilation.may_be_cached(self.py_func):
            raise _DoesNotFit  # and the import of Numba is saved
        with _compiling:  # Numba's registries are not safe for threads
            known = arguments is not None and compilation.is_cached(self.dispatcher, arguments)
        if not known:
            raise _DoesNotFit

    @cached_property
    def _compile_seconds(self) -> float:
        """Expected compile time of the kernel and of those that it calls, in seconds."""
        return _PER_BYTECODE * sum(len(it.py_func.__code__.co_code) // 2 for it in _callees(self))

    def _compile_apart(self, arguments: tuple[Any, ...], timer: threading.Timer) -> None:
        """Start the timer and wait for the background process, if compiling the kernel takes long."""
        has_cache = hasattr(getattr(self.dispatcher, "_cache", None), "_cache_file")
        is_long = has_cache and self._compile_seconds >= _APART
        if not is_long or compilation.is_cached(self.dispatcher, arguments):
            return
        name, thread = (self.py_func.__module__, self.py_func.__qualname__), threading.get_ident()
        timer.start()
        _ending.add(thread)  # so that a stop request ends the wait
        try:
            if not compilation.wait_for(*name, arguments, current_limit().end):
                raise _DoesNotFit
        finally:
            _ending.discard(thread)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's dispatcher, which compiles for the types of a call and caches on disk.

        Division follows NumPy. The compiled code releases the interpreter lock, so that a timer or
        Ctrl-C can set the stop flag while it runs.
        """
        import numba

        # The wrapper for calls from C is unused and takes a tenth of the compile time.
        options: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
        try:
            dispatcher = numba.njit(cache=True, **options)(self.py_func)
            # Numba's cache checks this function's file alone, and would call outdated code of a
            # kernel in another file.
            file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
            if file is not None:  # None if NUMBA_DISABLE_JIT is set
                compilation.name_by_key(file, _stamp(self))
        except RuntimeError as error:
            # Neither the source folder nor the user's cache folder is writable.
            log.info("compiled code is not kept: %s", error)
            dispatcher = numba.njit(**options)(self.py_func)
        compile_new = getattr(dispatcher, "_compile_for_args", None)
        if compile_new is not None:  # Numba calls it for arguments of new types

            def compile_for(*arguments: Any, **keywords: Any) -> Any:
                self._require_time(None if keywords else arguments)

                apart = None if keywords else arguments
                return self._timed(partial(compile_new, *arguments, **keywords), apart)

            dispatcher._compile_for_args = compile_for
        return dispatcher

    @cached_property
    def _numba_type_(self) -> Any:
        """Numba type of the kernel if compiled code calls it."""
        return _type_of_callee()(self.dispatcher)

    def compile_for(self, arguments: tuple[Any, ...]) -> None:
        """Compile for the types of `arguments` without running the loop."""
        compile_always()
        self._compile(arguments)

    def _compile(self, arguments: tuple[Any, ...]) -> None:
        """Compile for the types of `arguments`, or load compiled code, inside the watchers."""
        self._require_time(arguments)

        def work() -> None:
            import numba

            if hasattr(self.dispatcher, "compile"):  # absent if NUMBA_DISABLE_JIT is set
                self.dispatcher.compile(tuple(map(cast(Any, numba.typeof), arguments)))

        self._timed(work, arguments)
        self._ready = True

    def _timed(self, work: Callable[[], Any], arguments: tuple[Any, ...] | None) -> Any:
        """Return the result of `work`, which compiles for `arguments`, run inside the watchers."""
        with ExitStack() as stack:
            stack.enter_context(_compiling)
            begin = perf_counter()
            for watcher in current_watchers():
                stack.enter_context(watcher())
            from numba.core import event

            timer = threading.Timer(_SILENCE, self._announce)
            timer.daemon = True
            stack.callback(timer.cancel)

            class CompileListener(event.Listener):
                """Starts the timer when Numba compiles rather than loads from disk."""

                def on_start(self, event: Any) -> None:
                    if timer.ident is None:
                        timer.start()

                def on_end(self, event: Any) -> None:
                    pass

            stack.enter_context(event.install_listener("numba:compile", CompileListener()))
            if arguments is not None:
                self._compile_apart(arguments, timer)
            result = work()
            add_compile_time(perf_counter() - begin)
        return result

    def _announce(self) -> None:
        text, seconds = "compiling once, about %d s (%s)", max(1, round(self._compile_seconds))
        log.warning(text, seconds, self.py_func.__name__)


@cache
def _type_of_callee() -> Any:
    from numba import types
    from numba.extending import models, register_model

    plain: Any = types.unliteral

    class Callee(types.Dispatcher):
        """Kernel called by kernels; constant arguments are compiled as variables of their type."""

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            return super().get_call_type(context, tuple(plain(argument) for argument in args), kws)

    register_model(Callee)(models.OpaqueModel)
    return Callee


def _is_small(arguments: tuple[Any, ...]) -> bool:
    arrays = (
        part
        for argument in arguments
        for part in (argument if isinstance(argument, tuple) else (argument,))
    )
    return all(getattr(array, "size", 0) <= _MOST for array in arrays)


def _callees(kernel: Kernel) -> set[Kernel]:
    """Return `kernel` and the kernels that it calls, directly or through others."""
    result: set[Kernel] = set()
    todo = [kernel]
    while todo:
        item = todo.pop()
        if item not in result:
            result.add(item)
            names = item.py_func.__code__.co_names
            values = (item.py_func.__globals__.get(name) for name in names)
            todo += [value for value in values if isinstance(value, Kernel)]
    return result


def _stamp(kernel: Kernel) -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of all Python files in the folders of `kernel` and its callees."""
    folders = {Path(item.py_func.__code__.co_filename).parent for item in _callees(kernel)}
    files = sorted(path for folder in folders for path in folder.glob("*.py"))
    # An editor's lock file may be a dangling link, for which stat() raises.
    stamps = ((path.name, path.lstat()) for path in files)
    return tuple((name, stamp.st_mtime_ns, stamp.st_size) for name, stamp in stamps)


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, interpretable: bool) -> Callable[[F], F]: ...
def kernel(function: Callable[..., Any] | None = None, *, interpretable: bool = False) -> Any:
    """Return a :class:`Kernel` for `function`, a loop over arrays and numbers.

    Parameters
    ----------
    function : callable
        The loop, in the subset of Python that Numba compiles. Kernels that it calls run in its mode.
    interpretable : bool
        Whether calls from outside of kernels may be interpreted. The loop must be restartable, so it
        may fill arguments but not update them. It must not sum arrays with NumPy, which adds in
        another order than compiled code.

    Returns
    -------
    Kernel
        The callable, or a decorator if `function` is None.
    """
    if function is None:
        return lambda function: Kernel(function, interpretable)
    return Kernel(function, interpretable)


def interpreting() -> bool:
    """Return whether the interpretation budget has time left, so that calls compile nothing yet."""
    return _left > 0.0


def compile_always() -> None:
    """Compile every kernel at its first call from now on, for measurements and tests."""
    global _left
    _left = 0.0


def end_interpretation(thread: int) -> None:
    """Raise :class:`OutOfTime` in a thread that interprets a kernel or waits until one is compiled.

    Of the interpreted loops, only those need it that neither call a kernel nor poll the stop flag.
    """
    if thread in _ending:
        error = ctypes.py_object(OutOfTime)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), error)
