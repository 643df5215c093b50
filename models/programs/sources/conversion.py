"""Conversion of objects of other libraries and of arrays to programs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from ....errors import InvalidData
from ...problems import resolve, table
from ..base import Program

__all__ = ["converted", "objects", "program_of"]


@cache
def objects() -> dict[str, Any]:
    """Return the functions that convert objects, by the library that defines their types."""
    root = __name__.partition(".")[0]
    return {**table(f"{root}.models", "OBJECTS"), **table(f"{root}.instances", "OBJECTS")}


def converted(value: Any) -> Program | None:
    """Return the program of an object if its type is known to :func:`program_of`, else None."""
    return program_of(value) if _root(value) or isinstance(value, Mapping | tuple) else None


def program_of(value: Any) -> Program:
    """Return the program of an object of another library, or of arrays.

    Parameters
    ----------
    value : object
        One of

        - ``cvxpy.Problem`` that follows the rules of disciplined convex programming, with the current
          values of its parameters;
        - ``qpsolvers.Problem``;
        - ``casadi.Opti``;
        - model of Pyomo, PuLP, linopy, gurobipy or ``ortools.math_opt``;
        - mapping or tuple of arrays; see ``sources.arrays.program_of_arrays``;
        - mapping ``{"x", "f", "g"}`` of CasADi expressions with the bounds ``lbx, ubx, lbg, ubg`` and
          the guess ``x0``.

    Returns
    -------
    Program
        The program, linked to `value`; see :attr:`.Program.source`.

    Raises
    ------
    InvalidData
        The object is of another type, or its data are invalid.
    UnsupportedFormulation
        A constraint or expression has no equivalent here; the message names it.
    """
    root = _root(value)
    if root:
        convert = resolve(objects()[root])
    elif isinstance(value, Mapping) and "f" in value:
        convert = resolve(".models.programs.sources.casadi_problem:program_of_expressions")
    elif isinstance(value, Mapping | tuple):
        convert = resolve(".models.programs.sources.arrays:program_of_arrays")
    else:
        raise InvalidData(
            f"no program can be made from an object of type {type(value).__qualname__}; known are objects "
            f"of {', '.join(sorted(objects()))}, mappings and tuples of arrays, and files",
            field="model",
        )
    result: Program = convert(value)
    return result


def _root(value: Any) -> str:
    """Return the library that defines the type of `value`, or a base of it."""
    roots = (base.__module__.partition(".")[0] for base in type(value).__mro__)
    return next((name for name in roots if name in objects()), "")
