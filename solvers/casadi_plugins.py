"""What the backends over CasADi share: loading a plugin, and what CasADi says where it does not load."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import BackendBroken
from .attempts import Ended
from .backend import Limit

__all__ = [
    "HIGHS_MARK",
    "ended_by_words",
    "last_line",
    "load_plugin",
    "status_of",
    "vector",
]

#: The module whose presence means that CasADi's own HiGHS is loaded, which breaks those of highspy
#: and ortools in a process and is broken by them.
HIGHS_MARK = "crosstrack.solvers.qp.casadi_highs"

#: Plugins that this process has loaded; CasADi warns when asked again.
_loaded: set[tuple[str, str]] = set()


def load_plugin(backend: str, kind: str, name: str, *, brings_highs: bool = False) -> None:
    """Load CasADi's plugin `name` of `kind` (``"conic"``, ``"nlpsol"``) for `backend`.

    Parameters
    ----------
    backend : str
        Whose name stands in messages.
    kind, name : str
        CasADi's names.
    brings_highs : bool
        Whether CasADi's own HiGHS comes with it.

    Raises
    ------
    BackendBroken
        The plugin does not load, with CasADi's own words, or would meet another HiGHS.
    """
    import casadi

    if brings_highs:
        clashing = [module for module in ("highspy", "ortools.init") if module in sys.modules]
        if clashing:
            raise BackendBroken(
                f"backend {backend!r}: plugin {name!r} cannot run beside {clashing[0]} in one "
                "process; let the run have a worker (isolate=True)"
            )
        importlib.import_module(HIGHS_MARK)
    if (kind, name) in _loaded:
        return
    call: Any = casadi
    try:
        getattr(call, f"load_{kind}")(name)
        _loaded.add((kind, name))
    except RuntimeError as error:
        raise BackendBroken(
            f"backend {backend!r}: plugin {name!r} does not load: {last_line(error)}"
        ) from error


def status_of(stats: Mapping[str, Any]) -> str:
    """Return what a plugin calls its end."""
    return str(stats.get("return_status", stats.get("unified_return_status", "")))


def ended_by_words(stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
    """Return how a plugin ended, by its success and by the words of its status."""
    if stats.get("success"):
        return Ended.PROVEN, None
    words = status_of(stats).lower().replace("_", " ")
    if any(word in words for word in ("unbounded", "dual infeasible", "diverging")):
        return Ended.UNBOUNDED, None
    if "infeasib" in words:
        return Ended.INFEASIBLE, None
    if "user" in words:
        return Ended.STOPPED, Limit.INTERRUPTED
    if "time" in words:
        return Ended.STOPPED, Limit.TIME
    if "iter" in words or stats.get("unified_return_status") == "SOLVER_RET_LIMITED":
        return Ended.STOPPED, Limit.ITERATIONS
    return Ended.FAILED, None


def vector(values: Any) -> NDArray[np.float64]:
    """Return CasADi's column of numbers as an array."""
    return np.array(values, float).reshape(-1)


def last_line(error: Exception) -> str:
    """Return the last line of CasADi's message that says something."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1][:300] if lines else type(error).__name__
