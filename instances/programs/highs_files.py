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
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from .apart import read_apart
from .compressed import read_raw
from .lp_sections import LpScan
from .mps_sections import MpsScan

__all__ = ["arrays_of_file", "read_lp", "read_mps"]


def read_mps(path: Path) -> RowProgram:
    """Return the program in a fixed or free MPS file.

    Readers disagree on parts of the format. An integer column of a marker without bounds is binary
    here, a negative upper bound needs a lower bound, and the right-hand side of the objective is minus
    its constant. Ambiguous or unknown content is refused. Coefficients of at most 1e-12 are refused,
    too, because HiGHS drops them.

    Parameters
    ----------
    path : Path
        The file, which may be compressed.

    Returns
    -------
    MixedIntegerProgram or QuadraticProgram
        The program with the names of rows and columns.

    Raises
    ------
    InvalidData
        The file is damaged, or has a section that no program can express, such as SOS or INDICATORS.
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
    matrix = sp.csc_array((arrays["data"], arrays["indices"], arrays["indptr"]), shape=shape)
    sign = -1.0 if texts["maximise"] else 1.0
    shared: dict[str, Any] = {
        **{key: arrays[key] for key in ("row_lower", "row_upper", "column_lower", "column_upper")},
        "matrix": sp.csr_array(matrix),
        "cost": sign * arrays["cost"],
        "offset": sign * texts["offset"],
        "integral": arrays["integral"],
        "maximise": texts["maximise"],
        "columns": _named("column", texts["columns"]),
        "rows": _named("row", texts["rows"]),
    }
    try:
        if "hessian_data" not in arrays:
            return MixedIntegerProgram(**shared)
        parts = (arrays["hessian_data"], arrays["hessian_indices"], arrays["hessian_indptr"])
        lower = sp.csc_array(parts, shape=(columns, columns))
        hessian = lower + sp.tril(lower, -1).T
        program = QuadraticProgram(**shared, hessian=sign * hessian)
        program.require_convex()
        return program
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def _named(what: str, names: list[str]) -> tuple[Block, ...]:
    """Return one block with the names of the file."""
    return (Block(what, "", 0, len(names), labels=tuple(names)),) if names else ()


def arrays_of_file(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays and names in a file; runs in a separate process.

    Parameters
    ----------
    path : Path
        File whose suffix names the format.

    Raises
    ------
    InvalidData
        HiGHS refuses the file or ignores a part of it.
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
        "data": np.array(matrix.value_, float),
        "indices": np.array(matrix.index_, np.int64),
        "indptr": np.array(matrix.start_, np.int64),
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
    if hessian.dim_:
        arrays["hessian_data"] = np.array(hessian.value_, float)
        arrays["hessian_indices"] = np.array(hessian.index_, np.int64)
        arrays["hessian_indptr"] = np.array(hessian.start_, np.int64)
    texts = {
        "maximise": lp.sense_ == highspy.ObjSense.kMaximize,
        "offset": lp.offset_,
        "columns": list(lp.col_names_),
        "rows": list(lp.row_names_),
    }
    return arrays, texts
