"""HOW it is answered: backends, the dispatcher that verifies, and the cross-check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import attach, redirect

if TYPE_CHECKING:
    from .contract.backend import (
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
    from .contract.events import Event as Event, EventKind as EventKind
    from .contract.limits import Limits as Limits
    from .contract.registration import register_backend as register_backend
    from .contract.registry import (
        backend_names as backend_names,
        find_backend as find_backend,
    )
    from .contract.repeats import Spread as Spread
    from .contract.solution import (
        Incumbent as Incumbent,
        Solution as Solution,
        relative_gap as relative_gap,
    )
    from .contract.states import BackendState as BackendState, backend_states as backend_states
    from .contract.stopping import (
        AllOf as AllOf,
        AnyOf as AnyOf,
        Criterion as Criterion,
        Evaluations as Evaluations,
        Progress as Progress,
        Seconds as Seconds,
        Stalled as Stalled,
        Target as Target,
    )
    from .contract.verdict import Outcome as Outcome, Verdict as Verdict
    from .processes.isolation import Worker as Worker
    from .run.crosscheck import Comparison as Comparison, compare as compare
    from .run.diagnosis import Diagnosis as Diagnosis, Finding as Finding, diagnose as diagnose
    from .run.dispatch import solve as solve
    from .run.fronts import Front as Front, FrontPoint as FrontPoint
    from .run.pareto import front as front, sweep as sweep
    from .run.probing import probe as probe
    from .run.verification import verify as verify

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)

#: Modules that were in this folder itself before it had rooms, by room.
_ROOMS = {
    "contract": "backend control enums job option registry repeats solution stopping verdict",
    "run": (
        "assembly certification confirmation crosscheck diagnosis dispatch execution "
        "fallback fronts pareto probing refinement running"
    ),
    "processes": "environment interrupts isolation oracles output scheduling worker",
    "learning": "gradient trainer training weights",
    "programs": "attempts casadi_plugins cvxpy_library highs_library scaling",
}
redirect(
    __name__,
    {
        "campaign": "run.recording",
        "looking": "run.starts",
        "nlp.curvature": "nlp.quality",
        "nlp.sqpmethod": "nlp.plugins",
        "restarts": "run.starts",
        **{name: f"{room}.{name}" for room, names in _ROOMS.items() for name in names.split()},
    },
)
