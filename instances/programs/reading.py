"""Files of programs: the format by suffix, and the reader of each."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ...errors import InvalidData
from ...models.problems import resolve, table
from ...models.programs.base import Program

__all__ = ["files", "read_program", "suffix_of"]

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
    """Return the program in a file, named after the file.

    Parameters
    ----------
    path : str or path-like
        File with a suffix that :func:`files` lists, optionally followed by ``.gz``.

    Raises
    ------
    InvalidData
        The file cannot be read, or has content that no program can express; the message names the
        line or section.
    UnsupportedFormulation
        No reader supports the format.
    """
    suffix = suffix_of(path)
    if suffix not in files():
        raise InvalidData(_UNREAD.get(suffix, f"{path}: unknown format of programs"), field="path")
    file = Path(path)
    program: Program = resolve(files()[suffix])(file)
    return program if program.name else program.renamed(file.name.partition(".")[0])
