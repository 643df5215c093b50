"""State, functions and arguments of kernels that are interpreted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any

from .compilation import called, callees, survey
from .timing import Limit

__all__ = ["State", "call_directly", "copies_of", "is_small", "restore"]

#: Largest array that is interpreted, in entries. A loop that calls no kernel detects only at its end
#: that the budget is exhausted, and takes about 10 µs per entry.
_MOST = 30_000


class State(threading.local):
    """Thread-local state: the kernel being interpreted."""

    #: CPU time of the thread at which the budget ends; 0 outside of interpreted kernels.
    deadline = 0.0
    #: Time of ``perf_counter()``, which is read faster, at which the budget is checked again.
    look = 0.0
    #: Event that ends the budget earlier, because the kernel has been compiled.
    event: threading.Event | None = None
    #: Number of times that the budget has been extended.
    stage = 0
    #: The kernel being interpreted, and its arguments.
    call: tuple[Any, tuple[Any, ...]] | None = None
    #: Limit of the kernel that is interpreted because compiling takes too long, and its start time.
    stretched: Limit | None = None
    begun = 0.0


def is_small(arguments: tuple[Any, ...]) -> bool:
    """Return whether all arrays among the arguments are small enough for interpretation."""
    parts = (
        part for value in arguments for part in (value if isinstance(value, tuple) else (value,))
    )
    return all(getattr(array, "size", 0) <= _MOST for array in parts)


def copies_of(arguments: tuple[Any, ...]) -> list[tuple[Any, Any]]:
    """Return pairs of each array or random generator that a kernel may update and its present state."""
    import numpy as np

    result: list[tuple[Any, Any]] = []
    for value in arguments:
        if isinstance(value, tuple):
            result += copies_of(value)
        elif isinstance(value, np.random.Generator):
            result.append((value, value.bit_generator.state))
        elif isinstance(value, np.ndarray) and value.flags.writeable:
            if value.dtype != np.int8 or value.size != 1:  # not the stop flag
                result.append((value, value.copy()))
    return result


def restore(copies: list[tuple[Any, Any]]) -> None:
    """Give arrays and random generators the state that :func:`copies_of` returned."""
    for value, state in copies:
        if hasattr(value, "bit_generator"):
            value.bit_generator.state = state
        else:
            value[...] = state


def call_directly(kernel: Any) -> Callable[..., Any]:
    """Return the Python function of `kernel`, which calls kernels without loops as plain functions.

    No limit is checked before such calls, as they end soon. The outermost kernel checks it before each call,
    and a kernel without arguments has no other purpose.
    """
    function: FunctionType = kernel.py_func
    plain = {
        name: value._interpreted
        for name, value in called(kernel).items()
        if value.py_func.__code__.co_argcount and not any(map(has_loop, callees(value)))
    }
    if not plain:
        return function
    names = {**function.__globals__, **plain}
    return FunctionType(
        function.__code__, names, function.__name__, function.__defaults__, function.__closure__
    )


def has_loop(kernel: Any) -> bool:
    """Return whether the Python function of `kernel` contains a loop, or calls itself."""
    is_recursive = any(kernel in callees(part) for part in called(kernel).values())
    return is_recursive or survey(kernel.py_func)[2]
