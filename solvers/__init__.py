"""HOW it is answered: backends, the dispatcher that verifies, and the cross-check."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .backend import (
        Answer,
        Backend,
        Control,
        Feature,
        Guarantee,
        Limit,
        Option,
        Request,
        Termination,
    )
    from .crosscheck import Comparison, compare
    from .diagnosis import Diagnosis, Finding, diagnose
    from .dispatch import solve, verify
    from .isolation import Worker, probe
    from .registry import (
        BackendState,
        backend_names,
        backend_states,
        find_backend,
        register_backend,
    )
    from .solution import Incumbent, Solution, relative_gap
    from .verdict import Outcome, Verdict

__all__ = [
    "Answer",
    "Backend",
    "BackendState",
    "Comparison",
    "Control",
    "Diagnosis",
    "Feature",
    "Finding",
    "Guarantee",
    "Incumbent",
    "Limit",
    "Option",
    "Outcome",
    "Request",
    "Solution",
    "Termination",
    "Verdict",
    "Worker",
    "backend_names",
    "backend_states",
    "compare",
    "diagnose",
    "find_backend",
    "probe",
    "register_backend",
    "relative_gap",
    "solve",
    "verify",
]

_HOMES = {
    "Answer": "backend",
    "Backend": "backend",
    "BackendState": "registry",
    "Comparison": "crosscheck",
    "Control": "backend",
    "Diagnosis": "diagnosis",
    "Feature": "backend",
    "Finding": "diagnosis",
    "Guarantee": "backend",
    "Incumbent": "solution",
    "Limit": "backend",
    "Option": "backend",
    "Outcome": "verdict",
    "Request": "backend",
    "Solution": "solution",
    "Termination": "backend",
    "Verdict": "verdict",
    "Worker": "isolation",
    "backend_names": "registry",
    "backend_states": "registry",
    "compare": "crosscheck",
    "diagnose": "diagnosis",
    "find_backend": "registry",
    "probe": "isolation",
    "register_backend": "registry",
    "relative_gap": "solution",
    "solve": "dispatch",
    "verify": "dispatch",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
