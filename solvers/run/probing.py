"""Probing of backends: each is loaded in a worker of its own."""

from __future__ import annotations

import importlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from ...errors import WorkerFailure
from ..contract.states import BackendState
from ..processes.isolation import Worker

__all__ = ["probe"]

#: Seconds for a worker to start and load the library of a solver.
START = 60.0


def probe(states: tuple[BackendState, ...]) -> tuple[BackendState, ...]:
    """Load every installed backend in a worker of its own and return the updated states.

    Parameters
    ----------
    states : tuple of BackendState
        States from :func:`backend_states`.

    Returns
    -------
    tuple of BackendState
        The same states; a backend that is installed but does not load is ``"broken"``, with the
        cause.
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
    """Import the packages that a backend requires; return the error, or an empty text."""
    for name in requires:
        try:
            importlib.import_module(name)
        except Exception as error:  # any error of a broken library is the result
            return f"{type(error).__name__}: {error}"
    return ""
