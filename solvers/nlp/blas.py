"""Number of threads of the linear algebra library in CasADi's wheel."""

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
    """Return CasADi's OpenBLAS library; None if the wheel has none under its usual name."""
    import casadi

    for file in sorted(Path(casadi.__file__).parent.glob("libcasadi-tp-openblas.so*")):
        try:
            library = ctypes.CDLL(str(file))
            library.openblas_set_num_threads.argtypes = [ctypes.c_int]
        except (OSError, AttributeError) as error:
            log.debug("threads of %s cannot be set: %s", file.name, error)
            continue
        return library
    return None


def use_threads(count: int) -> None:
    """Set the number of threads of CasADi's linear algebra in this process.

    For the small fronts of a transcribed problem, several threads took twice as long as one, because
    the threads of OpenBLAS wait actively for each other.

    Parameters
    ----------
    count : int
        Number of threads.
    """
    library = _library()
    if library is not None:
        library.openblas_set_num_threads(int(count))
