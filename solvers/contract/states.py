"""States of all backends, for lists: installed, missing or broken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ...errors import BackendBroken
from ...models.conversion import as_model
from .registry import Declaration, declarations
from .selection import refusals

__all__ = ["BackendState", "backend_states", "backends"]


@dataclass(frozen=True)
class BackendState:
    """Description of a backend, available without importing its solver.

    Parameters
    ----------
    name : str
        Name of the backend.
    state : str
        ``"installed"``, ``"missing"``, ``"broken"`` or, for a model, ``"refused"``. Whether an installed backend really loads
        is tested by :func:`crosstrack.solvers.run.probing.probe`.
    cause : str
        Reason if it is not installed, such as the command that installs it, or if it refuses the model.
    version : str, optional
        Version of the solver.
    accepts, guarantee, features, summary, problem, requires
        As in :class:`Backend`.
    options : mapping of str to str, optional
        Help text of each option.
    extra : str
        Extra of ``pip install 'crosstrack[extra]'`` that installs it; empty for none.
    """

    name: str
    state: str
    cause: str = ""
    version: str | None = None
    accepts: str = ""
    guarantee: str = ""
    features: tuple[str, ...] = ()
    options: Mapping[str, str] | None = None
    summary: str = ""
    problem: str = ""
    requires: tuple[str, ...] = ()
    extra: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        return {
            "name": self.name,
            "problem": self.problem,
            "state": self.state,
            "installed": self.state == "installed",
            "cause": self.cause,
            "version": self.version,
            "accepts": self.accepts,
            "guarantee": self.guarantee,
            "features": list(self.features),
            "options": dict(self.options or {}),
            "summary": self.summary,
        }


def backend_states(model: Any = None) -> tuple[BackendState, ...]:
    """Return the state of every backend. Missing and broken backends are included.

    Parameters
    ----------
    model : Model or object, optional
        Model, or an object that describes one, such as a ``cvxpy.Problem``. Only the backends of its
        problem and the solvers of programs are then returned. Those that cannot solve it have the state
        ``"refused"`` with the reason, whether they are installed or not. Default: all backends.

    Returns
    -------
    tuple of BackendState
        In the order of preference, for a model the installed ones first and the refused ones last.

    Raises
    ------
    InvalidData
        `model` is neither a model nor describes one.
    """
    if model is None:
        return tuple(map(_state, declarations()))
    states = []
    for declared, reason in refusals(as_model(model)):
        state = _state(declared)
        states.append(replace(state, state="refused", cause=reason) if reason else state)
    order = ("installed", "missing", "broken", "refused")
    return tuple(sorted(states, key=lambda state: order.index(state.state)))


# The root package exports the function under this name.
backends = backend_states


def _state(declared: Declaration) -> BackendState:
    name = declared.name
    try:
        backend = declared.load()
        missing = backend.missing()
        backend_version = backend.version()
    except (BackendBroken, ImportError) as error:
        return BackendState(name, "broken", str(error), problem=declared.problem)
    how = f"crosstrack[{backend.extra}]" if backend.extra else " ".join(missing)
    return BackendState(
        name=name,
        state="missing" if missing else "installed",
        cause=f"pip install '{how}'" if missing else "",
        version=backend_version,
        accepts=backend.accepted_kinds(),
        guarantee=str(backend.guarantee),
        features=tuple(sorted(str(feature) for feature in backend.features)),
        options={key: option.help for key, option in backend.options.items()},
        summary=backend.summary,
        problem=declared.problem,
        requires=tuple(backend.requires),
        extra=backend.extra,
    )
