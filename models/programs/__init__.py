"""Solver-neutral programs in standard form, whose rows and columns carry the paper's equations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .base import BlockProgram as BlockProgram, Program as Program, RowProgram as RowProgram
    from .blocks import Block as Block
    from .builder import ProgramBuilder as ProgramBuilder
    from .cones import ConeBlock as ConeBlock, ConeKind as ConeKind
    from .conic import ConicProgram as ConicProgram
    from .linear import (
        MixedIntegerProgram as MixedIntegerProgram,
        QuadraticProgram as QuadraticProgram,
    )
    from .nonlinear import NonlinearProgram as NonlinearProgram

MODELS = {
    "conic-program": ".conic:ConicProgram",
    "mixed-integer-program": ".linear:MixedIntegerProgram",
    "nonlinear-program": ".nonlinear:NonlinearProgram",
    "quadratic-program": ".linear:QuadraticProgram",
}

#: Functions that return the program of an object, by the library that defines its type.
OBJECTS = {
    "casadi": ".sources.casadi_problem:program_of_opti",
    "cvxpy": ".sources.cvxpy_problem:program_of_problem",
    "qpsolvers": ".sources.arrays:program_of_qpsolvers",
}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
