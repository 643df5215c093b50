"""Solvers for flights: path, corridor, curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .planning import plan_flight as plan_flight
    from .replanning import PreparedFlight as PreparedFlight, Replan as Replan

BACKENDS = {"minco": ".minco:Minco", "staged": ".staged:Staged"}
DIAGNOSES = {"flight": ".diagnosis:diagnose_flight"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
