"""Properties of a program: counts, ranges of coefficients, kinds of rows and columns, convexity."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from .base import BlockProgram, RowProgram
from .cones import ConeKind, order
from .conic import ConicProgram
from .linear import QuadraticProgram
from .nonlinear import NonlinearProgram

__all__ = ["properties", "warnings_of"]

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Ratio of the largest to the smallest coefficient above which a program is reported as badly scaled.
#: Solvers satisfy rows up to 1e-6 to 1e-9, and double precision has 16 digits.
WIDE = 1e6
#: Magnitude of bounds and right sides above which a tolerance of 1e-6 is below their rounding errors.
LARGE = 1e9


def properties(program: BlockProgram) -> dict[str, Any]:
    """Return the properties of a program as JSON data.

    They are ``rows`` and ``columns`` by kind, ``nonzeros``, ``density``, ``ranges`` of the magnitudes of nonzero
    coefficients as ``[smallest, largest]``, ``structure`` with counts of special rows and columns, and
    ``convexity``: ``"linear"``, ``"convex"``, ``"nonlinear"``, or the reason why the program is not known to be
    convex.
    """
    whole = program.integer_columns
    low, high = program.column_lower, program.column_upper
    binary = whole & (low == 0) & (high == 1)
    ranges = {
        "column bounds": _range(low, high),
        "right sides": _range(program.row_lower, program.row_upper),
    }
    structure = {
        "fixed columns": int((low == high).sum()),
        "free columns": int((np.isinf(low) & np.isinf(high)).sum()),
    }
    convexity, nonzeros, height = "nonlinear", 0, program.row_count
    if isinstance(program, RowProgram):
        nonzeros, convexity = program.matrix.nnz, "linear"
        ranges = {"matrix": _range(program.matrix.data), "cost": _range(program.cost), **ranges}
        structure |= _special_rows(program, binary, whole)
        if isinstance(program, ConicProgram):
            nonzeros += program.cone_matrix.nnz
            ranges["cone rows"] = _range(program.cone_matrix.data, program.cone_offset)
            structure |= _cones(program)
            convexity, height = "convex", height + program.cone_offset.size
        quadratic = program.quadratic if isinstance(program, ConicProgram) else program
        if isinstance(quadratic, QuadraticProgram) and quadratic.hessian.nnz:
            ranges["hessian"] = _range(quadratic.hessian.data)
            try:
                quadratic.require_convex()
                convexity = "convex"
            except InvalidData as error:
                convexity = f"not convex: {error}"
    elif isinstance(program, NonlinearProgram):
        nonzeros = int(program.first_order.nnz_out(1))
        structure["Hessian entries"] = int(program.second_order.nnz_out(0))
    return {
        "rows": _rows(program),
        "columns": {
            "continuous": int((~whole).sum()),
            "binary": int(binary.sum()),
            "other integer": int((whole & ~binary).sum()),
        },
        "nonzeros": nonzeros,
        "density": nonzeros / max(height * program.size, 1),
        "ranges": {name: values for name, values in ranges.items() if values},
        "structure": {name: count for name, count in structure.items() if count},
        "convexity": convexity,
    }


def warnings_of(facts: dict[str, Any]) -> list[str]:
    """Return warnings about the scaling in the result of :func:`properties`."""
    result = []
    for name, (small, large) in facts["ranges"].items():
        if name in ("matrix", "cost", "cone rows", "hessian") and large > WIDE * small:
            ratio = math.log10(large) - math.log10(small)
            result.append(
                f"the coefficients of {name} differ by a factor of 1e{ratio:.0f}: scale rows or columns, "
                "because solvers lose accuracy above 1e6"
            )
        elif large > LARGE:
            result.append(
                f"{name} reach {large:.3g}: rounding errors exceed a tolerance of 1e-6; choose larger units"
            )
    return result


def _range(*parts: Vector) -> list[float]:
    """Return the smallest and the largest magnitude of the finite nonzero entries; empty without any."""
    values = np.abs(np.concatenate([np.ravel(part) for part in parts]))
    values = values[np.isfinite(values) & (values > 0)]
    return [float(values.min()), float(values.max())] if values.size else []


def _rows(program: BlockProgram) -> dict[str, int]:
    low, high = np.isfinite(program.row_lower), np.isfinite(program.row_upper)
    equal = low & high & (program.row_lower == program.row_upper)
    return {
        "equality": int(equal.sum()),
        "inequality": int((low ^ high).sum()),
        "range": int((low & high & ~equal).sum()),
        "free": int((~low & ~high).sum()),
    }


def _special_rows(program: RowProgram, binary: Mask, whole: Mask) -> dict[str, int]:
    """Return the counts of rows of known kinds, as in the classification of MIPLIB."""
    matrix, lower, upper = program.matrix, program.row_lower, program.row_upper
    entries = np.diff(matrix.indptr)
    used = [
        matrix.indices,
        *([program.cone_matrix.indices] if isinstance(program, ConicProgram) else []),
    ]
    uses = np.bincount(np.concatenate(used), minlength=program.size)

    def every(condition: Mask) -> Mask:
        """Return the rows with at least two entries that all satisfy `condition`."""
        failures = np.concatenate([[0], np.cumsum(~condition)])[matrix.indptr]
        return np.asarray((entries > 1) & (np.diff(failures) == 0))

    ones = every((matrix.data == 1) & binary[matrix.indices])
    equal = lower == upper
    at_most = np.isinf(lower) & np.isfinite(upper)
    at_least = np.isfinite(lower) & np.isinf(upper)
    weights = every((matrix.data > 0) & whole[matrix.indices]) & at_most
    signs = every(np.abs(matrix.data) == 1) & equal
    return {
        "empty rows": int((entries == 0).sum()),
        "singleton rows": int((entries == 1).sum()),
        "set partitioning rows": int((ones & equal & (upper == 1)).sum()),
        "set packing rows": int((ones & at_most & (upper == 1)).sum()),
        "set covering rows": int((ones & at_least & (lower == 1)).sum()),
        "cardinality rows": int((ones & (upper != 1) & (equal | at_most)).sum()),
        "knapsack rows": int((weights & ~ones).sum()),
        "network rows": int(_network(matrix, signs).sum()),
        "parallel rows": _parallel(matrix, entries),
        "columns without rows": int((uses == 0).sum()),
    }


def _network(matrix: sp.csr_array, rows: Mask) -> Mask:
    """Return the rows of flow balance: each column has at most one +1 and one -1 among them."""
    # A row without a column that another such row has with the opposite sign is not counted.
    place = np.repeat(np.arange(rows.size), np.diff(matrix.indptr))
    invalid, linked = np.zeros(rows.size, bool), np.ones(matrix.indices.size, bool)
    for sign in (1.0, -1.0):
        used = rows[place] & (matrix.data == sign)
        counts = np.bincount(matrix.indices[used], minlength=matrix.shape[1])[matrix.indices]
        invalid[place[used & (counts > 1)]] = True
        linked &= counts == 1
    shared = np.bincount(place[linked], minlength=rows.size) > 0
    result: Mask = rows & ~invalid & shared
    return result


def _parallel(matrix: sp.csr_array, entries: NDArray[np.intp]) -> int:
    """Return the number of rows that are a multiple of an earlier row."""
    # Rows are divided by their first entry and compared by two random projections, which differ for
    # different rows with probability 1.
    rows = np.flatnonzero(entries > 1)
    first = matrix.data[matrix.indptr[rows]]
    sides = np.random.default_rng(0).uniform(1.0, 2.0, (matrix.shape[1], 2))
    with np.errstate(all="ignore"):
        projected = (matrix[rows] @ sides) / first[:, None]
        size = np.maximum(np.abs(projected), 1e-300)
        digits = np.floor(np.log10(size))
        rounded = np.round(projected / 10.0**digits, 10)
    keys = np.column_stack([matrix.indices[matrix.indptr[rows]], digits, rounded])
    return int(rows.size - np.unique(keys, axis=0).shape[0])


def _cones(program: ConicProgram) -> dict[str, int]:
    """Return the number of cones by kind and size; that of a semidefinite cone is its order."""
    result: Counter[str] = Counter()
    for block in program.cones:
        size = f"size {block.dimension}"
        if block.kind is ConeKind.SEMIDEFINITE:
            size = f"order {order(block.dimension)}"
        result[f"{block.kind} cones of {size}"] += block.count
    return dict(result)
