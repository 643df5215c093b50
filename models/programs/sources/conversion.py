"""Conversion of objects of other libraries and of arrays to programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ....errors import InvalidData
from ...problems import resolve
from ..base import Program

__all__ = ["OBJECTS", "converted", "program_of"]

#: Functions that return the program of an object, by the first part of its type's module.
OBJECTS = {
    "casadi": ".models.programs.sources.casadi_problem:program_of_opti",
    "cvxpy": ".models.programs.sources.cvxpy_problem:program_of_problem",
    "gurobipy": ".instances.programs.libraries:program_of_gurobi",
    "linopy": ".instances.programs.libraries:program_of_linopy",
    "ortools": ".instances.programs.libraries:program_of_mathopt",
    "pulp": ".instances.programs.libraries:program_of_pulp",
    "pyomo": ".instances.programs.libraries:program_of_pyomo",
    "qpsolvers": ".models.programs.sources.arrays:program_of_qpsolvers",
}


def converted(value: Any) -> Program | None:
    """Return the program of an object if its type is known to :func:`program_of`, else None."""
    known = _root(value) in OBJECTS or isinstance(value, Mapping | tuple)
    return program_of(value) if known else None


def program_of(value: Any) -> Program:
    """Return the program of an object of another library, or of arrays.

    Parameters
    ----------
    value : object
        One of

        - ``cvxpy.Problem`` that follows the rules of disciplined convex programming, with the present
          values of its parameters;
        - ``qpsolvers.Problem``;
        - ``casadi.Opti``;
        - model of Pyomo, PuLP, linopy, gurobipy or ``ortools.math_opt``;
        - mapping or tuple of arrays; see :func:`crosstrack.models.programs.sources.arrays.program_of_arrays`;
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
    if _root(value) in OBJECTS:
        convert = resolve(OBJECTS[_root(value)])
    elif isinstance(value, Mapping) and "f" in value:
        convert = resolve(".models.programs.sources.casadi_problem:program_of_expressions")
    elif isinstance(value, Mapping | tuple):
        convert = resolve(".models.programs.sources.arrays:program_of_arrays")
    else:
        raise InvalidData(
            f"no program can be made from an object of type {type(value).__qualname__}; known are objects "
            f"of {', '.join(sorted(OBJECTS))}, mappings and tuples of arrays, and files",
            field="model",
        )
    result: Program = convert(value)
    return result


def _root(value: Any) -> str:
    """Return the library that defines the type of `value`, or a base of it."""
    for base in type(value).__mro__:
        name = base.__module__.partition(".")[0]
        if name in OBJECTS:
            return name
    return ""
