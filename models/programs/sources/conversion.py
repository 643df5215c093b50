"""Conversion of objects of other libraries, of arrays and of files to programs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....errors import InvalidData
from ...problems import resolve
from ..base import Program

__all__ = ["FILES", "OBJECTS", "is_convertible", "program_of", "read_program"]

#: Functions that return the program of an object, by the first part of its type's module.
OBJECTS = {
    "casadi": ".models.programs.sources.casadi_problem:program_of_opti",
    "cvxpy": ".models.programs.sources.cvxpy_problem:program_of_problem",
    "gurobipy": ".models.programs.sources.libraries:program_of_gurobi",
    "linopy": ".models.programs.sources.libraries:program_of_linopy",
    "ortools": ".models.programs.sources.libraries:program_of_mathopt",
    "pulp": ".models.programs.sources.libraries:program_of_pulp",
    "pyomo": ".models.programs.sources.libraries:program_of_pyomo",
    "qpsolvers": ".models.programs.sources.arrays:program_of_qpsolvers",
}

#: Functions that return the program in a file, by suffix; each may be followed by ``.gz``.
FILES = {
    ".cbf": ".models.programs.sources.cbf:read_cbf",
    ".lp": ".models.programs.sources.highs_files:read_lp",
    ".mat": ".models.programs.sources.arrays:read_mat",
    ".mps": ".models.programs.sources.highs_files:read_mps",
    ".nl": ".models.programs.sources.nl_file:read_nl",
    ".npz": ".models.programs.sources.arrays:read_npz",
    ".qplib": ".models.programs.sources.qplib:read_qplib",
}

#: Formats that no reader supports, with the way around.
_UNREAD = {
    ".osil": "OSiL files have no maintained Python reader: convert the file to .nl or .mps",
    ".sif": "SIF files contain Fortran code: convert the file to .nl or .mps",
}


def is_convertible(value: Any) -> bool:
    """Return True if :func:`program_of` may convert `value`, without importing another library."""
    return _root(value) in OBJECTS or isinstance(value, Mapping | tuple)


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


def suffix_of(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file of a program, without ``.gz``; empty for other files."""
    file = Path(path)
    name = file.stem if file.suffix.casefold() == ".gz" else file.name
    suffix = Path(name).suffix.casefold()
    return suffix if suffix in FILES or suffix in _UNREAD else ""


def read_program(path: str | os.PathLike[str]) -> Program:
    """Return the program in a file, named after the file.

    Parameters
    ----------
    path : str or path-like
        File with a suffix in :data:`FILES`, optionally followed by ``.gz``.

    Raises
    ------
    InvalidData
        The file cannot be read, or has content that no program can express; the message names the
        line or section.
    UnsupportedFormulation
        No reader supports the format.
    """
    suffix = suffix_of(path)
    if suffix not in FILES:
        raise InvalidData(_UNREAD.get(suffix, f"{path}: unknown format of programs"), field="path")
    file = Path(path)
    program: Program = resolve(FILES[suffix])(file)
    return program if program.name else program.renamed(file.name.partition(".")[0])
