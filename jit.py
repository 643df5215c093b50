"""One decorator for all loops on plain arrays: interpreted while that is quick, compiled beyond.

Importing Numba takes half a second and compiling many; small problems need neither. So the first
:data:`BUDGET` seconds that a process spends in kernels are interpreted, by the same source and with
the same results, bit for bit. A kernel that uses the budget up starts again, compiled, and from then
on every kernel compiles at its first call, or is loaded from the cache on disk.

A run with a wall-clock limit (:func:`within`) compiles a kernel only if that is expected to fit in
the time left. Otherwise the kernel is interpreted until the limit, and a background process compiles
it for later runs (:mod:`crosstrack.compilation`).
"""

from __future__ import annotations

import ctypes
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar, cast, overload

from . import compilation

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

#: Labels of one search above which it gives up rather than fill the memory: about 3 GB.
MOST_LABELS = 50_000_000
#: Seconds of interpretation in a process: what importing Numba and loading compiled code takes, so
#: that no run takes much longer than twice what the better choice would have taken.
BUDGET = 0.5
#: Entries of an array above which nothing is interpreted: a loop that calls no kernel notices only at
#: its end that the budget is used up, and takes about 10 µs for each.
_MOST = 30_000
#: Seconds that compiling takes for each bytecode of a kernel and those it calls, as measured.
_PER_BYTECODE = 1.5e-3
#: Seconds of silence, after which a person is told what takes so long.
_SILENCE = 1.0
#: Seconds for importing Numba, and for each kernel that is loaded from the cache, as measured.
_IMPORT, _LOAD = 0.8, 0.03
#: Share of the time left that compiling may be expected to take: other processes may slow it down.
_SHARE = 0.15
#: Seconds that an interpreted kernel may run beyond the limit, to return what it has.
_GRACE = 0.3

F = TypeVar("F", bound=Callable[..., Any])
Watcher = Callable[[], AbstractContextManager[Any]]

_left = BUDGET
_watchers: list[Watcher] = []
#: Seconds spent compiling, in every thread of the process.
_spent = 0.0
_compiling = threading.RLock()


class _BudgetUsedUp(Exception):
    """Raised by the kernels that an interpreted one calls, and caught where that was called."""


class OutOfTime(Exception):
    """An interpreted kernel has reached the wall-clock limit of its run."""


class _DoesNotFit(Exception):
    """Compiling is expected to take more time than is left."""


class _Here(threading.local):
    """State of the thread: the kernel being interpreted, and the limits of the run."""

    #: End of the budget for the kernel that is being interpreted; 0 if none is.
    deadline = 0.0
    #: Limit for the kernel that is interpreted because compiling takes too long, and when it began.
    stretched: Limit | None = None
    begun = 0.0
    #: The limit of the run in this thread.
    limit: Limit | None = None


class Limit:
    """Wall-clock limit of one run.

    Parameters
    ----------
    seconds : float, optional
        Seconds from now; None for no limit.
    share : float
        Share of them that interpreted kernels may use, in 0..1.

    Attributes
    ----------
    interpreted : set of str
        Names of the kernels that were interpreted because compiling does not fit.
    """

    def __init__(self, seconds: float | None, share: float = 1.0) -> None:
        begin = perf_counter()
        whole = float("inf") if seconds is None else seconds
        self.end, self.interpretation_end = begin + whole, begin + share * whole
        self.interpreted: set[str] = set()

    @property
    def is_interpreted_too_long(self) -> bool:
        """Whether kernels have used up the time for interpretation."""
        return bool(self.interpreted) and perf_counter() > self.interpretation_end


_here = _Here()
#: Limits of all runs of the process; a helper thread of a run, which has none itself, takes the last.
_limits: list[Limit] = []
#: Threads in kernels that :data:`_Here.stretched` interprets.
_stretching: set[int] = set()


class Kernel:
    """A function on plain arrays, interpreted or compiled; ``.py_func`` is its Python meaning."""

    def __init__(self, function: Callable[..., Any], interpretable: bool) -> None:
        self.py_func = function
        self.interpretable = interpretable
        self._ready = False
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the loop; only from outside of kernels is there a choice how."""
        global _left
        deadline = _here.deadline
        if deadline:
            if perf_counter() > deadline:
                raise _BudgetUsedUp
            return self.py_func(*arguments)
        if _here.stretched is not None:
            if perf_counter() > max(_here.stretched.interpretation_end, _here.begun) + _GRACE:
                raise OutOfTime
            return self.py_func(*arguments)
        if not self._ready:
            if self.interpretable and _left > 0.0 and _is_small(arguments):
                import numpy as np

                begin = perf_counter()
                _here.deadline = begin + _left
                try:
                    with np.errstate(all="ignore"):
                        return self.py_func(*arguments)
                except _BudgetUsedUp:
                    log.debug("%s starts again, compiled", self.py_func.__name__)
                finally:
                    _here.deadline = 0.0
                    _left -= perf_counter() - begin
        try:
            if not self._ready:
                self._compile(arguments)
            return self.dispatcher(*arguments)
        except _DoesNotFit:
            return self._stretch(arguments)

    def _stretch(self, arguments: tuple[Any, ...]) -> Any:
        """Interpret the loop until the limit of the run, and have it compiled in the background."""
        limit = _limit()
        limit.interpreted.add(self.py_func.__name__)
        compilation.request(self.py_func.__module__, self.py_func.__qualname__, arguments)
        import numpy as np

        thread = threading.get_ident()
        _stretching.add(thread)
        _here.stretched, _here.begun = limit, perf_counter()
        try:
            with np.errstate(all="ignore"):
                return self.py_func(*arguments)
        finally:
            _here.stretched = None
            _stretching.discard(thread)

    def _require_time(self, arguments: tuple[Any, ...] | None) -> None:
        """Raise unless the time left is enough to compile for `arguments`, or to load what was."""
        left = _limit().end - perf_counter()
        if left == float("inf"):
            return
        called = _called(self)
        size = sum(len(kernel.py_func.__code__.co_code) // 2 for kernel in called)
        seconds = 0.0 if "numba" in sys.modules else _IMPORT
        if left <= seconds + _LOAD * len(called):
            raise _DoesNotFit
        if seconds + _PER_BYTECODE * size <= _SHARE * left:
            return
        if "numba" not in sys.modules and not compilation.may_be_cached(self.py_func):
            raise _DoesNotFit  # and the import of Numba, about half a second, is saved
        with _compiling:  # Numba's registries are not safe for threads
            known = arguments is not None and compilation.is_cached(self.dispatcher, arguments)
        if not known:
            raise _DoesNotFit

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's function: compiled for the types of a call, and kept on disk.

        It divides as NumPy does, and runs without the interpreter's lock, so that a timer or Ctrl-C
        can set the stop flag meanwhile.
        """
        import numba

        # Nobody calls kernels from C, and a wrapper for that takes a tenth of the compiling.
        how: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
        try:
            made = numba.njit(cache=True, **how)(self.py_func)
            # Numba looks at this function's file alone, and would call what a kernel of another file
            # was when this one was compiled.
            file = getattr(getattr(made, "_cache", None), "_cache_file", None)
            if file is not None:  # None if NUMBA_DISABLE_JIT is set
                compilation.name_by_key(file, _stamp(self))
        except RuntimeError as error:
            # Neither beside the source nor in the user's folder may anything be written.
            log.info("compiled code is not kept: %s", error)
            made = numba.njit(**how)(self.py_func)
        later = getattr(made, "_compile_for_args", None)
        if later is not None:  # what Numba calls for arguments of other types than those met before

            def compile_for(*arguments: Any, **keywords: Any) -> Any:
                self._require_time(None if keywords else arguments)
                return self._timed(partial(later, *arguments, **keywords))

            made._compile_for_args = compile_for
        return made

    @cached_property
    def _numba_type_(self) -> Any:
        """What Numba asks of a name that compiled code calls."""
        return _type_of_callee()(self.dispatcher)

    def compile_for(self, arguments: tuple[Any, ...]) -> None:
        """Compile for the types of `arguments` without running the loop."""
        compile_always()
        self._compile(arguments)

    def _compile(self, arguments: tuple[Any, ...]) -> None:
        """Compile for the types of `arguments`, or load what was, while the watchers wait."""
        self._require_time(arguments)

        def work() -> None:
            import numba

            if hasattr(self.dispatcher, "compile"):  # not where NUMBA_DISABLE_JIT is set
                self.dispatcher.compile(tuple(map(cast(Any, numba.typeof), arguments)))

        self._timed(work)
        self._ready = True

    def _timed(self, work: Callable[[], Any]) -> Any:
        """Return what `work` does, which compiles, while the watchers wait."""
        global _spent
        with ExitStack() as stack:
            stack.enter_context(_compiling)
            begin = perf_counter()
            for watcher in tuple(_watchers):
                stack.enter_context(watcher())
            from numba.core import event

            timer = threading.Timer(_SILENCE, self._announce)
            timer.daemon = True
            stack.callback(timer.cancel)

            class Begun(event.Listener):
                """Told when something is compiled, rather than loaded from disk."""

                def on_start(self, event: Any) -> None:
                    if timer.ident is None:
                        timer.start()

                def on_end(self, event: Any) -> None:
                    pass

            stack.enter_context(event.install_listener("numba:compile", Begun()))
            found = work()
            _spent += perf_counter() - begin
        return found

    def _announce(self) -> None:
        size = sum(len(one.py_func.__code__.co_code) // 2 for one in _called(self))
        seconds = max(1, round(_PER_BYTECODE * size))
        log.warning("compiling once, about %d s (%s)", seconds, self.py_func.__name__)


@cache
def _type_of_callee() -> Any:
    from numba import types
    from numba.extending import models, register_model

    plain: Any = types.unliteral

    class Callee(types.Dispatcher):
        """A kernel that kernels call: constants among its arguments get no code of their own."""

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            return super().get_call_type(context, tuple(plain(one) for one in args), kws)

    register_model(Callee)(models.OpaqueModel)
    return Callee


def _is_small(arguments: tuple[Any, ...]) -> bool:
    arrays = (part for one in arguments for part in (one if isinstance(one, tuple) else (one,)))
    return all(getattr(array, "size", 0) <= _MOST for array in arrays)


def _called(kernel: Kernel) -> set[Kernel]:
    """Return `kernel` and the kernels that it calls, directly or through others."""
    found: set[Kernel] = set()
    todo = [kernel]
    while todo:
        one = todo.pop()
        if one not in found:
            found.add(one)
            names = one.py_func.__code__.co_names
            values = (one.py_func.__globals__.get(name) for name in names)
            todo += [value for value in values if isinstance(value, Kernel)]
    return found


def _stamp(kernel: Kernel) -> tuple[tuple[str, int, int], ...]:
    """Return what changes when a file does beside which `kernel`, or one that it calls, is written."""
    folders = {Path(one.py_func.__code__.co_filename).parent for one in _called(kernel)}
    files = sorted(path for folder in folders for path in folder.glob("*.py"))
    # An editor's lock may be a link to nothing.
    stamps = ((path.name, path.lstat()) for path in files)
    return tuple((name, stamp.st_mtime_ns, stamp.st_size) for name, stamp in stamps)


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, interpretable: bool) -> Callable[[F], F]: ...
def kernel(function: Callable[..., Any] | None = None, *, interpretable: bool = False) -> Any:
    """Make a :class:`Kernel` of `function`, a loop over arrays and numbers that Numba compiles.

    Parameters
    ----------
    function : callable
        The loop. Kernels that it calls run as it does.
    interpretable : bool
        Whether it may be interpreted when it is called from outside of kernels. It must be able to
        start again, so it may fill arguments but not update them; and it must not sum arrays with
        NumPy, which adds in another order than compiled code.
    """
    if function is None:
        return lambda function: Kernel(function, interpretable)
    return Kernel(function, interpretable)


def clock() -> float:
    """Return seconds as ``time.perf_counter`` counts them, without those spent compiling so far."""
    return perf_counter() - _spent


def interpreting() -> bool:
    """Return whether kernels are still interpreted, so that there is nothing to compile yet."""
    return _left > 0.0


def compile_always() -> None:
    """Compile every kernel at its first call from now on, for whoever measures."""
    global _left
    _left = 0.0


def _limit() -> Limit:
    """Return the limit of the run that this thread works for."""
    limit = _here.limit or (_limits[-1] if _limits else None)
    return _UNLIMITED if limit is None else limit


_UNLIMITED = Limit(None)


@contextmanager
def within(limit: Limit) -> Iterator[None]:
    """Apply `limit` to the kernels that this thread calls, and the helper threads of its run."""
    former, _here.limit = _here.limit, limit
    _limits.append(limit)
    try:
        yield
    finally:
        _limits.remove(limit)
        _here.limit = former


def end_interpretation(thread: int) -> None:
    """Raise :class:`OutOfTime` in a thread that interprets a kernel beyond its limit.

    Only a loop that calls no other kernel and polls no flag needs it.
    """
    if thread in _stretching:
        error = ctypes.py_object(OutOfTime)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), error)


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Enter ``watcher()`` around whatever is compiled meanwhile, by any thread of the process."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)
