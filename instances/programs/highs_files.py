"""Files in MPS and LP format, which HiGHS reads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData
from ...models.programs.base import RowProgram
from ...models.programs.blocks import Block
from .apart import read_apart
from .compressed import read_raw
from .lp_sections import LpScan
from .mps_sections import MpsScan
from .reading import stated_program

__all__ = ["arrays_of_file", "read_lp", "read_mps"]

#: Parts of a sparse matrix.
_PARTS = ("data", "indices", "indptr")


def read_mps(path: Path) -> RowProgram:
    """Return the program in a fixed or free MPS file, with the names of rows and columns.

    Readers disagree on parts of the format. An integer column of a marker without bounds is binary here, a
    negative upper bound needs a lower bound, and the right-hand side of the objective is minus its constant.
    ``InvalidData`` is raised for ambiguous or unknown content, and for sections that no program can express, such
    as SOS or INDICATORS. Coefficients of at most 1e-12 are refused, too, because HiGHS drops them.
    """
    raw = read_raw(path)
    MpsScan.check(path, raw)
    return _program(path, raw, ".mps")


def read_lp(path: Path) -> RowProgram:
    """Return the program in a file in LP format; see :func:`read_mps`.

    Refused are ambiguous parts such as constants in rows, ranges of rows, names with brackets as
    Gurobi writes them, and names that start with ``inf`` or ``nan``, which HiGHS reads as numbers.
    """
    raw = read_raw(path)
    LpScan.check(path, raw)
    return _program(path, raw, ".lp")


def _program(path: Path, raw: bytes, suffix: str) -> RowProgram:
    arrays, texts = read_apart("highs", path, raw, suffix)
    rows, columns = arrays["row_lower"].size, arrays["cost"].size
    shape = rows, columns
    parts = tuple(arrays.pop(f"matrix_{part}") for part in _PARTS)
    matrix = sp.csc_array(parts, shape=shape)
    if "hessian_data" in arrays:
        parts = tuple(arrays.pop(f"hessian_{part}") for part in _PARTS)
        lower = sp.csc_array(parts, shape=(columns, columns))
        arrays["hessian"] = lower + sp.tril(lower, -1).T
    return stated_program(
        **arrays,
        matrix=sp.csr_array(matrix),
        offset=texts["offset"],
        maximise=texts["maximise"],
        columns=_named("column", texts["columns"]),
        rows=_named("row", texts["rows"]),
    )


def _named(what: str, names: list[str]) -> tuple[Block, ...]:
    """Return one block with the names of the file."""
    return (Block(what, "", 0, len(names), labels=tuple(names)),) if names else ()


def arrays_of_file(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays and names in a file whose suffix names the format; runs in a separate process.

    Raise ``InvalidData`` if HiGHS refuses the file or ignores a part of it.
    """
    import highspy

    log: list[str] = []
    solver = highspy.Highs()
    solver.setOptionValue("log_to_console", False)
    # HiGHS drops smaller coefficients with a warning, which refuses the file, and larger ones fail.
    solver.setOptionValue("small_matrix_value", 1e-12)
    solver.setOptionValue("large_matrix_value", 1e100)
    solver.setOptionValue("infinite_cost", highspy.kHighsInf)
    solver.cbLogging += lambda event: log.append(event.message)
    status = solver.readModel(str(path))
    if status != highspy.HighsStatus.kOk:
        found = re.search(r"(?:WARNING|ERROR): *(.*)", " ".join(" ".join(log).split()))
        raise InvalidData(found[1] if found else "HiGHS cannot read it")
    lp, hessian = solver.getLp(), solver.getModel().hessian_
    kinds = [int(kind) for kind in lp.integrality_] or [0] * lp.num_col_
    if any(kind > 1 for kind in kinds):
        first = next(k for k, kind in enumerate(kinds) if kind > 1)
        raise InvalidData(
            f"column {lp.col_names_[first]} is semi-continuous, which no program can express"
        )
    matrix = lp.a_matrix_
    assert matrix.format_ == highspy.MatrixFormat.kColwise  # as after every reading
    infinity = highspy.kHighsInf
    arrays: dict[str, Any] = {
        "cost": np.array(lp.col_cost_, float),
        "integral": np.array(kinds, int) == 1,
    }
    for key, values in (
        ("row_lower", lp.row_lower_),
        ("row_upper", lp.row_upper_),
        ("column_lower", lp.col_lower_),
        ("column_upper", lp.col_upper_),
    ):
        bounds = np.array(values, float)
        arrays[key] = np.where(np.abs(bounds) >= infinity, np.copysign(np.inf, bounds), bounds)
    parts: dict[str, Any] = {"matrix": matrix, "hessian": hessian}
    for key, part in parts.items():
        if key == "matrix" or hessian.dim_:
            arrays[f"{key}_data"] = np.array(part.value_, float)
            arrays[f"{key}_indices"] = np.array(part.index_, np.int64)
            arrays[f"{key}_indptr"] = np.array(part.start_, np.int64)
    texts = {
        "maximise": lp.sense_ == highspy.ObjSense.kMaximize,
        "offset": lp.offset_,
        "columns": list(lp.col_names_),
        "rows": list(lp.row_names_),
    }
    return arrays, texts
