"""Files in AMPL's NL format, which CasADi reads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...models.programs.blocks import Block
from ...models.programs.interpreter import read, readable
from ...models.programs.nonlinear import NonlinearProgram
from .apart import read_apart
from .compressed import read_raw
from .nl_sections import NlScan

__all__ = ["arrays_of_file", "read_nl"]


def read_nl(path: Path) -> NonlinearProgram:
    """Return the program in a file in AMPL's NL format, in text form.

    The names of columns and rows are those in the files with the suffixes ``.col`` and ``.row`` beside it, if
    they exist. Raise ``InvalidData`` if the file is damaged or binary, or CasADi does not support a part of it.
    """
    raw = read_raw(path)
    # CasADi negates the objective of a maximisation.
    maximise = NlScan.check(path, raw).maximise
    # CasADi does not support the comments that some writers add.
    raw = re.sub(rb"[ \t]*#[^\n]*", b"", raw)
    arrays, texts = read_apart("nl", path, raw, ".nl")
    return NonlinearProgram(
        function=read(texts["function"]),
        columns=_blocks(path, "column", ".col", arrays["guess"].size),
        rows=_blocks(path, "row", ".row", arrays["row_lower"].size),
        maximise=maximise,
        **arrays,
    )


def _blocks(path: Path, what: str, suffix: str, count: int) -> tuple[Block, ...]:
    """Return the block of all rows or columns, with their names if a file contains them."""
    names = path.with_name(path.name.removesuffix(".gz")).with_suffix(suffix)
    labels: tuple[str, ...] = ()
    if names.is_file():
        labels = tuple(read_raw(names).decode("utf-8", "replace").split("\n")[:count])
    if len(labels) != count or not all(labels):
        labels = ()
    return (Block(what, "", 0, count, labels=labels),) if count else ()


def arrays_of_file(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays and the functions in a file; runs in a separate process."""
    import casadi

    builder = casadi.NlpBuilder()
    builder.import_nl(str(path), {})
    x, f = casadi.vertcat(*builder.x), builder.f if builder.f.numel() else casadi.MX(0)
    g = casadi.vertcat(*builder.g) if builder.g else casadi.MX(0, 1)
    function = casadi.Function("program", [x], [f, g], ["x"], ["f", "g"])
    data, _ = readable(function)
    if isinstance(data, str):
        raise InvalidData("it contains functions that cannot be stored")
    arrays: dict[str, Any] = {
        "row_lower": np.array(builder.g_lb, float),
        "row_upper": np.array(builder.g_ub, float),
        "column_lower": np.array(builder.x_lb, float),
        "column_upper": np.array(builder.x_ub, float),
        "guess": np.array(builder.x_init, float),
        "integral": np.array(builder.discrete, bool),
    }
    return arrays, {"function": data}
