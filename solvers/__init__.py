"""HOW it is answered: backends, the dispatcher that verifies, and the cross-check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .backend import (
        Answer as Answer,
        Backend as Backend,
        Control as Control,
        Feature as Feature,
        Guarantee as Guarantee,
        Limit as Limit,
        Option as Option,
        Request as Request,
        Termination as Termination,
    )
    from .crosscheck import Comparison as Comparison, compare as compare
    from .diagnosis import Diagnosis as Diagnosis, Finding as Finding, diagnose as diagnose
    from .dispatch import solve as solve, verify as verify
    from .fronts import Front as Front, FrontPoint as FrontPoint
    from .isolation import Worker as Worker
    from .pareto import front as front, sweep as sweep
    from .probing import probe as probe
    from .registry import (
        BackendState as BackendState,
        backend_names as backend_names,
        backend_states as backend_states,
        find_backend as find_backend,
        register_backend as register_backend,
    )
    from .repeats import Spread as Spread
    from .solution import Incumbent as Incumbent, Solution as Solution, relative_gap as relative_gap
    from .stopping import (
        AllOf as AllOf,
        AnyOf as AnyOf,
        Criterion as Criterion,
        Evaluations as Evaluations,
        Progress as Progress,
        Seconds as Seconds,
        Stalled as Stalled,
        Target as Target,
    )
    from .verdict import Outcome as Outcome, Verdict as Verdict

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "backend": (
            "Answer",
            "Backend",
            "Control",
            "Feature",
            "Guarantee",
            "Limit",
            "Option",
            "Request",
            "Termination",
        ),
        "registry": (
            "BackendState",
            "backend_names",
            "backend_states",
            "find_backend",
            "register_backend",
        ),
        "stopping": (
            "AllOf",
            "AnyOf",
            "Criterion",
            "Evaluations",
            "Progress",
            "Seconds",
            "Stalled",
            "Target",
        ),
        "repeats": ("Spread",),
        "crosscheck": (
            "Comparison",
            "compare",
        ),
        "diagnosis": (
            "Diagnosis",
            "Finding",
            "diagnose",
        ),
        "solution": (
            "Incumbent",
            "Solution",
            "relative_gap",
        ),
        "verdict": (
            "Outcome",
            "Verdict",
        ),
        "fronts": ("Front", "FrontPoint"),
        "pareto": ("front", "sweep"),
        "isolation": ("Worker",),
        "probing": ("probe",),
        "dispatch": (
            "solve",
            "verify",
        ),
    },
)
