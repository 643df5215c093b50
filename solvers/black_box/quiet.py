"""Suppression of the warnings of libraries during a search."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

__all__ = ["quiet"]

#: Modules whose warnings are suppressed during a search. The function may use others.
_QUIET = r"(cma|pymoo|scipy\.optimize|crosstrack\.solvers\.black_box)\b"
_quiet_runs = 0
_quiet_lock = threading.Lock()
_quiet_filters = warnings.catch_warnings()


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings of the libraries of searches, such as those about substituted values.

    Other modules still warn. The filters of the process are restored after the last of several runs.
    """
    global _quiet_runs, _quiet_filters
    with _quiet_lock:
        _quiet_runs += 1
        if _quiet_runs == 1:
            _quiet_filters = warnings.catch_warnings()
            _quiet_filters.__enter__()
            warnings.filterwarnings("ignore", module=_QUIET)
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        with _quiet_lock:
            _quiet_runs -= 1
            if not _quiet_runs:
                _quiet_filters.__exit__(None, None, None)
