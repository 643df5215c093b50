"""One decorator for all compiled loops, so that they are all compiled alike."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

log = logging.getLogger("crosstrack")

__all__ = ["MOST_LABELS", "kernel"]

#: Labels of one search above which it gives up rather than fill the memory: about 3 GB.
MOST_LABELS = 50_000_000

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile `function` when first called; ``.py_func`` stays the plain Python meaning.

    The compiled code is cached on disk, divides as NumPy does, and runs without the interpreter's
    lock, so that a timer or Ctrl-C can set the stop flag meanwhile.
    """
    try:
        return cast(F, numba.njit(cache=True, error_model="numpy", nogil=True)(function))
    except RuntimeError as error:
        # Neither beside the source nor in the user's folder may anything be written.
        log.info("compiled code is not kept: %s", error)
        return cast(F, numba.njit(error_model="numpy", nogil=True)(function))
