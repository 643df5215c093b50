"""The threads of the linear algebra that CasADi's wheel brings."""

from __future__ import annotations

import ctypes
import logging
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["use_threads"]

log = logging.getLogger("crosstrack")


@cache
def _library() -> Any:
    """Return CasADi's OpenBLAS, None where the wheel has none under its usual name."""
    import casadi

    for file in sorted(Path(casadi.__file__).parent.glob("libcasadi-tp-openblas.so*")):
        try:
            found = ctypes.CDLL(str(file))
            found.openblas_set_num_threads.argtypes = [ctypes.c_int]
        except (OSError, AttributeError) as error:
            log.debug("threads of %s cannot be set: %s", file.name, error)
            continue
        return found
    return None


def use_threads(count: int) -> None:
    """Let the linear algebra of this process's CasADi use `count` threads.

    On fronts as small as those of a transcribed problem, more than one thread was measured to take
    twice as long: OpenBLAS's threads wait for one another by spinning.
    """
    library = _library()
    if library is not None:
        library.openblas_set_num_threads(int(count))
