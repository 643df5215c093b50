"""Declare planning problems as their papers state them, solve them with any backend, check every answer.

::

    import crosstrack as ct

    model = ct.load("error-correction/7")
    best = ct.solve(model)
    print(best.plan, best.gap, best.verification)
    print(ct.compare([model], ["label-setting", "two-stage", "highs"], time_limit=60))

The models live in :mod:`crosstrack.models`, the backends in :mod:`crosstrack.solvers` and the
catalogue in :mod:`crosstrack.instances`. Nothing heavy is imported before it is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .errors import CrosstrackError
    from .instances import load
    from .models.plots import plot
    from .solvers.crosscheck import Comparison, compare
    from .solvers.diagnosis import Diagnosis, diagnose
    from .solvers.dispatch import solve, verify
    from .solvers.registry import backend_states as backends
    from .solvers.solution import Solution

__version__ = "0.1.0"

__all__ = [
    "Comparison",
    "CrosstrackError",
    "Diagnosis",
    "Solution",
    "__version__",
    "backends",
    "compare",
    "diagnose",
    "load",
    "plot",
    "solve",
    "verify",
]

_HOMES = {
    "Comparison": (".solvers.crosscheck", "Comparison"),
    "CrosstrackError": (".errors", "CrosstrackError"),
    "Diagnosis": (".solvers.diagnosis", "Diagnosis"),
    "Solution": (".solvers.solution", "Solution"),
    "backends": (".solvers.registry", "backend_states"),
    "compare": (".solvers.crosscheck", "compare"),
    "diagnose": (".solvers.diagnosis", "diagnose"),
    "load": (".instances", "load"),
    "plot": (".models.plots", "plot"),
    "solve": (".solvers.dispatch", "solve"),
    "verify": (".solvers.dispatch", "verify"),
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        module, attribute = _HOMES[name]
        return getattr(importlib.import_module(module, __name__), attribute)
    if name in ("errors", "instances", "models", "solvers"):
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
