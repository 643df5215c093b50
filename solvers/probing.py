"""Which backends load: each is tried in a worker of its own."""

from __future__ import annotations

import importlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from ..errors import WorkerFailure
from .isolation import Worker
from .registry import BackendState

__all__ = ["probe"]

#: Seconds for a worker to start and to load a solver's library.
START = 60.0


def probe(states: tuple[BackendState, ...]) -> tuple[BackendState, ...]:
    """Load every installed backend in a worker of its own and return the states as found.

    A package that is there but does not load becomes ``"broken"`` with its cause.
    """

    def probed(state: BackendState) -> BackendState:
        if state.state != "installed" or not state.requires:
            return state
        with Worker() as worker:
            try:
                cause = worker.call(_import_all, state.requires, deadline=START)
            except WorkerFailure as failure:
                cause = str(failure)
        return replace(state, state="broken", cause=cause) if cause else state

    with ThreadPoolExecutor(max_workers=2) as pool:
        return tuple(pool.map(probed, states))


def _import_all(requires: tuple[str, ...]) -> str:
    """Import what a backend needs; return why that fails, empty when it does not."""
    for name in requires:
        try:
            importlib.import_module(name)
        except Exception as error:  # whatever a broken library raises is the finding
            return f"{type(error).__name__}: {error}"
    return ""
