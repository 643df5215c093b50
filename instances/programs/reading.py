"""Files of programs: the format by suffix, and the reader of each."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData
from ...models.problems import resolve, table
from ...models.programs.base import Program, RowProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram

__all__ = ["files", "read_program", "stated_program", "suffix_of"]

#: Formats that no reader supports, with the way around.
_UNREAD = {
    ".osil": "OSiL files have no maintained Python reader: convert the file to .nl or .mps",
    ".sif": "SIF files contain Fortran code: convert the file to .nl or .mps",
}


def files() -> dict[str, Any]:
    """Return the readers by suffix: functions ``(path) -> program``."""
    return table(__package__.rpartition(".")[0], "FILES")


def suffix_of(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file of a program, without ``.gz``; empty for other files."""
    file = Path(path)
    name = file.stem if file.suffix.casefold() == ".gz" else file.name
    suffix = Path(name).suffix.casefold()
    return suffix if suffix in files() or suffix in _UNREAD else ""


def read_program(path: str | os.PathLike[str]) -> Program:
    """Return the program in a file, named after it, with a suffix of :func:`files`, optionally with ``.gz``.

    Raise ``InvalidData`` with line or section if the file cannot be read or has content that no program can
    express, or if no reader supports the format.
    """
    suffix = suffix_of(path)
    if suffix not in files():
        raise InvalidData(_UNREAD.get(suffix, f"{path}: unknown format of programs"), field="path")
    file = Path(path)
    try:
        program: Program = resolve(files()[suffix])(file)
    except InvalidData as error:  # messages of a program's own checks do not name the file
        if str(error).startswith(str(file)):
            raise
        raise InvalidData(f"{file}: {error}", field=error.field) from None
    return program if program.name else program.renamed(file.name.partition(".")[0])


def stated_program(
    *, maximise: bool, cost: Any, offset: float, hessian: Any = None, **fields: Any
) -> RowProgram:
    """Return the linear or convex quadratic program with an objective in the direction of its author.

    The author minimises, or maximises, ``x @ hessian @ x / 2 + cost @ x + offset`` with a symmetric `hessian`,
    shape (n, n), or None. The program is linear if all its entries are 0. `fields` are the other fields of both
    classes. Raise ``InvalidData`` if a field is invalid, or, for the field "hessian", if the objective is not
    convex in a minimisation.
    """
    sign = -1.0 if maximise else 1.0
    fields |= {"cost": sign * np.array(cost, float), "offset": sign * offset, "maximise": maximise}
    if hessian is None or not hessian.count_nonzero():
        return MixedIntegerProgram(**fields)
    program = QuadraticProgram(hessian=sign * sp.csr_array(hessian), **fields)
    program.require_convex()
    return program
