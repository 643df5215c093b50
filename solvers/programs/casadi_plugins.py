"""Tools shared by the backends over CasADi: loading a plugin and interpreting its status."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendBroken
from ..contract.backend import Limit
from .attempts import Ended

__all__ = ["HIGHS_MARK", "ended_by_words", "last_line", "load_plugin", "status_of", "vector"]

#: Module whose presence shows that the HiGHS library of CasADi is loaded, which conflicts with the
#: HiGHS libraries of highspy and ortools in one process.
HIGHS_MARK = "crosstrack.solvers.qp.casadi_highs"

#: Plugins loaded by this process. CasADi warns if a plugin is loaded again.
_loaded: set[tuple[str, str]] = set()


def load_plugin(backend: str, kind: str, name: str, *, brings_highs: bool = False) -> None:
    """Load CasADi's plugin `name` of `kind` (``"conic"``, ``"nlpsol"``), or raise ``BackendBroken``.

    `brings_highs` is true if the plugin loads CasADi's own HiGHS library.
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
    try:
        getattr(casadi, f"load_{kind}")(name)
        _loaded.add((kind, name))
    except RuntimeError as error:
        raise BackendBroken(
            f"backend {backend!r}: plugin {name!r} does not load: {last_line(error)}"
        ) from error


def status_of(stats: Mapping[str, Any]) -> str:
    """Return the status text of a plugin from the statistics of CasADi, else an empty text."""
    return str(stats.get("return_status", stats.get("unified_return_status", "")))


def ended_by_words(stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
    """Return the ending of a plugin and its limit, from its success flag and its status text."""
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
    """Return a CasADi column vector as an array, shape (n,)."""
    return np.array(values, float).reshape(-1)


def last_line(error: Exception) -> str:
    """Return the last non-empty line of CasADi's message, at most 300 characters."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1][:300] if lines else type(error).__name__
