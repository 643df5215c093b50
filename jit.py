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
import os
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cached_property, partial, update_wrapper
from time import perf_counter, thread_time
from typing import Any, TypeVar, cast, overload

from . import compilation, interpretation
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
    "kernel",
    "renew_budget",
    "start_compiling",
    "tick",
    "watched",
    "within",
]

#: Largest number of labels in one search, about 3 GB. A search that exceeds it stops.
MOST_LABELS = 50_000_000
#: Interpretation time of a process, in seconds of CPU. It equals the time to import Numba and load compiled
#: code, so a run takes at most about twice the time of the better choice, on a busy machine, too.
BUDGET = 0.5
#: Jobs of a process that begin with the whole budget, so that the order of short jobs does not matter. Many
#: jobs would waste more time than compiling takes.
RENEWALS = 8
#: Further interpretation time of kernels that are in no cache, in seconds of CPU.
AHEAD = 1.2
#: Least expected compile time of a kernel that the background process compiles, in seconds. It starts in 0.7 s.
_APART = 0.5
#: Seconds of compiling after which a warning is logged.
_SILENCE = 1.0
#: Seconds for importing Numba and loading the first compiled code (0.35 measured), and for loading another
#: kernel with all that it calls (at most 0.02 measured, for 46 kernels).
_IMPORT, _LOAD = 0.4, 0.03
#: Largest share of the time left for compiling; other processes may slow it down. A run with a limit compiles
#: nothing more after compiling has taken more than the second number times the expected seconds.
_SHARE, _SLOW = 0.15, 2.0
#: Largest share of the time left for waiting until another process has compiled a kernel, and seconds without
#: a limit, after which the kernel is compiled here: the process may be stopped, or busy with other kernels.
_PATIENCE, _LONGEST = 0.25, 60.0
#: Seconds between two looks at a kernel that is being compiled meanwhile.
_POLL = 0.01
#: Seconds that an interpreted kernel may run beyond the limit, to return its current result.
_GRACE = 0.2

F = TypeVar("F", bound=Callable[..., Any])

_left, _ahead, _renewals = BUDGET, AHEAD, RENEWALS
#: Held while Numba works, because its registries are not safe for threads.
_compiling = threading.RLock()
#: Held while Numba is imported: two threads that import it at once can leave LLVM's lock held forever.
_importing = threading.Lock()
#: Held by a run without limit until its kernel is compiled. Runs with a limit do not wait for it.
_patient = threading.RLock()


class _BudgetUsedUp(Exception):
    """The interpretation budget is exhausted; the outermost kernel catches it."""


class _DoesNotFit(Exception):
    """Compiling is expected to take more time than is left."""


#: State of the present thread.
_here = interpretation.State()
#: Threads that a stop request may end: they interpret a kernel, or wait for one to be compiled.
_ending: set[int] = set()


class Kernel:
    """Function on plain arrays, interpreted or compiled.

    Parameters
    ----------
    function : callable
        The loop in Python, available as ``.py_func``.
    interpretable, in_place, allocates, shared : bool
        See :func:`kernel`.
    """

    def __init__(
        self, function: Callable[..., Any], interpretable: bool, in_place: bool, allocates: bool, shared: bool
    ) -> None:  # fmt: skip
        self.py_func = function
        self.interpretable, self.in_place, self.allocates = interpretable, in_place, allocates
        self.shared = shared or interpretable
        self._ready = False
        #: CPU seconds of the last interpreted call if nothing can end it early.
        self._last = 0.0
        update_wrapper(self, function)

    @property
    def is_compiled(self) -> bool:
        """Whether the next call runs compiled."""
        return self._ready

    def __call__(self, *arguments: Any) -> Any:
        """Run the loop; kernels called by a kernel run in the mode of their caller."""
        if _here.deadline:
            if perf_counter() > _here.look:
                _look()
            return self._interpreted(*arguments)
        if _here.stretched is not None:
            if perf_counter() > max(_here.stretched.interpretation_end, _here.begun) + _GRACE:
                raise OutOfTime
            return self._interpreted(*arguments)
        if not self._ready and self._may_interpret(arguments):
            with suppress(_BudgetUsedUp):
                return self._try(arguments)
            log.debug("%s starts again, compiled", self.py_func.__name__)
        try:
            if not self._ready:
                self._compile(arguments)
            return self.dispatcher(*arguments)
        except _DoesNotFit:
            return self._stretch(arguments)

    def _may_interpret(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether a call may be interpreted within a budget and start again after it."""
        if not self.interpretable or not interpretation.is_small(arguments):
            return False
        return not self.in_place or (self._is_new and current_limit().allows_trial)

    @cached_property
    def _is_new(self) -> bool:
        """Whether the cache on disk holds nothing of the kernel."""
        return not compilation.may_be_cached(self.py_func)

    @cached_property
    def _interpreted(self) -> Callable[..., Any]:
        return interpretation.call_directly(self)

    @cached_property
    def _calls_kernels(self) -> bool:
        """Whether the loop calls kernels, at which an interpreted call can end."""
        return len(compilation.callees(self)) > 1

    @property
    def _may_wait(self) -> bool:
        """Whether the kernel is still in no cache, and the run may interpret longer."""
        return current_limit().allows_trial and not compilation.may_be_cached(self.py_func)

    def _try(self, arguments: tuple[Any, ...]) -> Any:
        """Interpret within the budget; restore the arguments if it does not suffice."""
        global _left, _ahead
        former = interpretation.copies_of(arguments) if self.in_place else []
        begin = thread_time()
        _here.call, _here.deadline, _here.look = (self, arguments), begin + _left, 0.0
        try:
            if _left <= self._last:
                _extend_budget()
            return self._interpret(arguments)
        except _BudgetUsedUp:
            interpretation.restore(former)
            raise
        finally:
            _here.call, _here.event, _here.deadline, _here.stage = None, None, 0.0, 0
            spent = thread_time() - begin
            self._last = 0.0 if self._calls_kernels else spent
            _left, _ahead = max(_left - spent, 0.0), _ahead - max(spent - _left, 0.0)

    def _stretch(self, arguments: tuple[Any, ...]) -> Any:
        """Interpret the loop until the limit of the run, and compile it in the background."""
        limit, begin = current_limit(), perf_counter()
        if not limit.interpreted and begin > limit.interpretation_end:
            # Compiling other kernels has used the share of the interpreted ones.
            limit.may_compile = False
            limit.extend_interpretation(begin + _SHARE * (limit.end - begin))
        limit.interpreted.add(self.py_func.__name__)
        compilation.request(self.py_func.__module__, self.py_func.__qualname__, arguments)
        _here.stretched, _here.begun = limit, begin
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
        expected = (seconds + self._compile_seconds) * compilation.slowdown()
        if expected <= _SHARE * left and current_limit().may_compile:
            return
        if "numba" not in sys.modules and not compilation.may_be_cached(self.py_func):
            raise _DoesNotFit  # and the import of Numba is saved
        with _compiling:
            known = arguments is not None and compilation.is_cached(self.dispatcher, arguments)
        if not known:
            raise _DoesNotFit

    @cached_property
    def _compile_seconds(self) -> float:
        return compilation.expected_seconds(self)

    def _compile_apart(self, arguments: tuple[Any, ...], timer: threading.Timer) -> None:
        """Start the timer and wait for the background process, if compiling the kernel takes long."""
        is_limited = current_limit().end < float("inf")
        if self._compile_seconds < _APART and (is_limited or not compilation.is_running()):
            return
        with _compiling:
            has_cache = hasattr(getattr(self.dispatcher, "_cache", None), "_cache_file")
            if not has_cache or compilation.is_cached(self.dispatcher, arguments):
                return
        name, thread = (self.py_func.__module__, self.py_func.__qualname__), threading.get_ident()
        timer.start()
        _ending.add(thread)  # so that a stop request ends the wait
        try:
            limit, begin = current_limit(), perf_counter()
            # Under load, the process may take far longer than expected.
            patience = _PATIENCE * (limit.end - begin) if is_limited else _LONGEST
            if is_limited:  # the kernel is interpreted after a vain wait
                limit.extend_interpretation(begin + (_PATIENCE + _SHARE) * (limit.end - begin))
            is_ready = compilation.wait_for(*name, arguments, begin + patience)
            if is_limited and not is_ready:
                limit.may_compile = False
                raise _DoesNotFit
        finally:
            _ending.discard(thread)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's dispatcher, which compiles for the types of a call and caches on disk.

        Division follows NumPy. The compiled code releases the interpreter lock, so that a timer or
        Ctrl-C can set the stop flag while it runs.
        """
        return self._make_dispatcher(has_wrapper=True)

    def _make_dispatcher(self, has_wrapper: bool) -> Any:
        """Return a dispatcher that compiles inside the watchers."""
        _import_numba()
        dispatcher = compilation.make_dispatcher(self, has_wrapper)
        compile_new = getattr(dispatcher, "_compile_for_args", None)
        if compile_new is not None:  # Numba calls it for arguments of new types

            def compile_for(*arguments: Any, **keywords: Any) -> Any:
                positional = None if keywords else arguments
                self._require_time(positional)
                return self._timed(partial(compile_new, *arguments, **keywords), positional)

            dispatcher._compile_for_args = compile_for
        return dispatcher

    @cached_property
    def _numba_type_(self) -> Any:
        """Numba type of the kernel if compiled code calls it."""
        return compilation.type_of_callee()(self.dispatcher if self.shared else self._callee)

    @cached_property
    def _callee(self) -> Any:
        """Numba's dispatcher of a kernel that mostly kernels call; it is kept here, as Numba's type does not."""
        return self._make_dispatcher(has_wrapper=False)

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
            if current_limit().end == float("inf"):
                stack.enter_context(_patient)
            begin = perf_counter()
            for watcher in current_watchers():
                stack.enter_context(watcher())
            _import_numba()
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

            if arguments is not None:
                self._compile_apart(arguments, timer)
            stack.enter_context(_compiling)
            stack.enter_context(event.install_listener("numba:compile", CompileListener()))
            result = work()
            spent = perf_counter() - begin
            add_compile_time(spent)
            if spent > _SLOW * (_IMPORT + self._compile_seconds):
                current_limit().may_compile = False
        return result

    def _announce(self) -> None:
        text, seconds = "compiling once, about %d s (%s)", max(1, round(self._compile_seconds))
        log.warning(text, seconds, self.py_func.__name__)


def _import_numba() -> None:
    """Import Numba and its module of events, in one thread at a time."""
    with _importing:
        import numba.core.event  # noqa: F401


def _after_fork() -> None:
    """Release in a forked process what other threads of its parent held."""
    global _compiling, _importing, _patient
    _compiling, _importing, _patient = threading.RLock(), threading.Lock(), threading.RLock()
    _ending.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(
    *, interpretable: bool = False, in_place: bool = False, allocates: bool = True, shared: bool = False
) -> Callable[[F], F]: ...  # fmt: skip
def kernel(
    function: Callable[..., Any] | None = None,
    *,
    interpretable: bool = False,
    in_place: bool = False,
    allocates: bool = True,
    shared: bool = False,
) -> Any:
    """Return a :class:`Kernel` for `function`, a loop over arrays and numbers.

    Parameters
    ----------
    function : callable
        The loop, in the subset of Python that Numba compiles. Kernels that it calls run in its mode.
    interpretable : bool
        Whether calls from outside of kernels may be interpreted. The loop must be restartable, so it
        may fill arguments but not update them. It must not sum arrays with NumPy, which adds in
        another order than compiled code, nor use other powers than squares.
    in_place : bool
        Whether the loop updates arguments. They are copied and restored for a restart, except for a
        stop flag. Runs with a time limit do not interpret it on trial.
    allocates : bool
        Whether the loop or a kernel that it calls makes arrays. Otherwise Numba counts no references, which
        doubles the speed of short loops on named tuples.
    shared : bool
        Whether Python and kernels call the loop, so that it is compiled once for both. Interpretable ones are.

    Returns
    -------
    Kernel
        The callable, or a decorator if `function` is None.
    """
    if function is None:
        return lambda function: Kernel(function, interpretable, in_place, allocates, shared)
    return Kernel(function, interpretable, in_place, allocates, shared)


@kernel
def tick() -> None:
    """End the interpretation of the calling loop if its budget or limit is exhausted; compiled code does nothing."""


def _look() -> None:
    """Extend the budget or raise ``_BudgetUsedUp`` if it is exhausted; set the time of the next look."""
    left = _here.deadline - thread_time()
    if left < 0.0 or (_here.event is not None and _here.event.is_set()):
        _extend_budget()
        left = _here.deadline - thread_time()
    # The event may be set at any time.
    _here.look = perf_counter() + (left if _here.event is None else min(left, _POLL))


def _extend_budget() -> None:
    """Extend the budget of a kernel that is in no cache, or raise ``_BudgetUsedUp``.

    The background process compiles a long kernel during the second half of :data:`AHEAD`.
    """
    if _here.call is None or _here.stage == 2 or _ahead <= 0.0:
        raise _BudgetUsedUp
    kernel, arguments = _here.call
    if not kernel._may_wait or kernel._last > _ahead:
        raise _BudgetUsedUp
    first = _ahead - 0.5 * AHEAD if _here.stage == 0 else 0.0
    if first <= 0.0:
        _here.event = start_compiling(kernel, *arguments)
    if _here.event is not None and _here.event.is_set():
        raise _BudgetUsedUp
    _here.stage = 1 if first > 0.0 else 2
    _here.deadline = thread_time() + (first if first > 0.0 else min(_ahead, 0.5 * AHEAD))


def start_compiling(function: Callable[..., Any], *arguments: Any) -> threading.Event | None:
    """Start to compile a kernel for the types of `arguments` in the background, if that is useful."""
    kernel = cast(Kernel, function)
    if not kernel._may_wait or kernel._compile_seconds < _APART:
        return None
    name = kernel.py_func.__module__, kernel.py_func.__qualname__
    return compilation.request(*name, arguments, nice=0)


def compile_always() -> None:
    """Compile every kernel at its first call from now on, for measurements and tests."""
    global _left, _ahead
    _left = _ahead = 0.0


def renew_budget() -> None:
    """Give the next job of this process the whole budget, unless Numba is loaded or too many jobs had it."""
    global _left, _renewals
    if _renewals > 0 and _ahead > 0.0 and "numba" not in sys.modules:
        _left, _renewals = BUDGET, _renewals - 1


def end_interpretation(thread: int) -> None:
    """Raise :class:`OutOfTime` in a thread that interprets a kernel or waits until one is compiled.

    Of the interpreted loops, only those need it that neither call a kernel nor poll the stop flag.
    """
    if thread in _ending:
        error = ctypes.py_object(OutOfTime)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), error)
