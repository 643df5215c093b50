"""States of all backends, for lists: installed, missing or broken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import BackendBroken
from .registry import Declaration, declarations

__all__ = ["BackendState", "backend_states"]


@dataclass(frozen=True)
class BackendState:
    """Description of a backend, available without importing its solver.

    Parameters
    ----------
    name : str
        Name of the backend.
    state : str
        ``"installed"``, ``"missing"`` or ``"broken"``. Whether an installed backend really loads
        is tested by :func:`crosstrack.solvers.run.probing.probe`.
    cause : str
        Reason if it is not installed, such as the command that installs it.
    version : str, optional
        Version of the solver.
    accepts, guarantee, features, summary, problem, requires
        As in :class:`Backend`.
    options : mapping of str to str, optional
        Help text of each option.
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


def backend_states() -> tuple[BackendState, ...]:
    """Return the state of every backend. Missing and broken backends are included."""
    return tuple(map(_state, declarations()))


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
    )
