"""Files in the format of QPLIB."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation, show
from ...models.programs.base import RowProgram
from ...models.programs.blocks import Block
from .lines import Lines
from .reading import stated_program

__all__ = ["read_qplib"]

Vector = NDArray[np.float64]


def read_qplib(path: Path) -> RowProgram:
    """Return the program in a file of QPLIB (Furini et al. 2019, appendix of the supplement).

    It is quadratic if the objective has quadratic terms. The starting values of variables and of multipliers are
    read and ignored, because no answer depends on them. Comments start with ``#``, ``!`` or ``%``. Raise
    ``InvalidData`` with the line if the file is damaged or contradicts its problem type, and
    ``UnsupportedFormulation`` if a constraint is quadratic or the objective is not convex.
    """
    lines = Lines(path, "#!%")
    name = " ".join(lines.next())
    objective, variables, constraints = tuple(_kind(lines))
    sense = lines.fields("sense", 1)[0].casefold()
    if sense not in ("minimize", "maximize"):
        raise lines.error(f"sense must be minimize or maximize, got {show(sense)}")
    size = lines.count("variables", 1)
    rows = lines.count("constraints") if constraints == "L" else 0
    hessian = sp.csr_array((size, size)) if objective == "L" else _hessian(lines, objective, size)
    shared: dict[str, Any] = {
        "cost": _vector(lines, "linear coefficient", size),
        "offset": lines.number("constant of the objective"),
        "maximise": sense == "maximize",
        "name": name,
    }
    matrix = sp.csr_array((rows, size))
    if constraints == "L":
        entries = lines.entries("constraint matrix", (rows, size), base=1)
        matrix = sp.csr_array(
            sp.coo_array((entries.values, tuple(entries.index.T)), shape=(rows, size))
        )
    infinity = lines.number("value for infinity", infinite=True)
    if infinity <= 0:
        raise lines.error(f"value for infinity must be positive, got {infinity:g}")
    row_bounds = _bounds(lines, "constraint", rows, infinity) if constraints == "L" else ([], [])
    if variables == "B":
        bounds, integral = (np.zeros(size), np.ones(size)), np.ones(size, bool)
    else:
        bounds = _bounds(lines, "variable", size, infinity)
        integral = _integral(lines, variables, bounds)
    _vector(lines, "starting value", size)
    if constraints == "L":
        _vector(lines, "starting multiplier of a constraint", rows)
    _vector(lines, "starting multiplier of a bound", size)
    columns = _names(lines, "x", size)
    # Files without constraints may omit the number of their names.
    names = _names(lines, "c", rows) if constraints == "L" else _no_names(lines)
    lines.end()
    shared |= {
        "matrix": matrix, "row_lower": row_bounds[0], "row_upper": row_bounds[1],
        "column_lower": bounds[0], "column_upper": bounds[1], "integral": integral,
        "columns": columns, "rows": names,
    }  # fmt: skip
    try:
        return stated_program(hessian=hessian, **shared)
    except InvalidData as error:
        if error.field != "hessian":
            raise
        kind = "concave" if shared["maximise"] else "convex"
        raise UnsupportedFormulation(f"{path}: the objective is not {kind}: {error}") from None


def _kind(lines: Lines) -> str:
    """Return the problem type: letters for the objective, the variables and the constraints."""
    kind = lines.fields("problem type", 1)[0]
    if len(kind) != 3 or any(
        letter not in known for letter, known in zip(kind, ("LDCQ", "CBMIG", "NBLDCQ"), strict=True)
    ):
        raise lines.error(
            "problem type must consist of one of L, D, C, Q for the objective, one of C, B, M, I, G for the "
            f"variables, and one of N, B, L, D, C, Q for the constraints, got {show(kind)}"
        )
    if kind[2] in "DCQ":
        raise UnsupportedFormulation(
            f"{lines.place()}: problem type {kind} has quadratic constraints, which no program can express: "
            "pose convex ones as second-order cones, such as in CVXPY, and others as CasADi expressions"
        )
    return kind


def _hessian(lines: Lines, objective: str, size: int) -> sp.csr_array:
    """Return the symmetric Hessian from one triangle."""
    entries = lines.entries("quadratic term", (size, size), base=1, symmetric=True)
    row, column = entries.index.T
    outside = np.flatnonzero((row != column) & (entries.values != 0))
    if objective == "D" and outside.size:
        raise lines.error(
            "problem type D needs a diagonal Hessian, got an entry beside the diagonal",
            int(entries.lines[outside[0]]),
        )
    lower = sp.coo_array((entries.values, (row, column)), shape=(size, size))
    return sp.csr_array(lower + sp.tril(lower, -1).T)


def _vector(lines: Lines, what: str, size: int, infinite: bool = False) -> Vector:
    """Return a vector: its default value, and a list of other entries."""
    result = np.full(size, lines.number(f"default {what}", infinite))
    entries = lines.entries(what, (size,), base=1, infinite=infinite)
    result[entries.index[:, 0]] = entries.values
    return result


def _bounds(lines: Lines, what: str, size: int, infinity: float) -> tuple[Vector, Vector]:
    """Return the lower and upper bounds; a magnitude of at least `infinity` is infinite."""
    low, high = (
        _vector(lines, f"{side} bound of a {what}", size, infinite=True)
        for side in ("lower", "upper")
    )
    for bound in (low, high):
        bound[:] = np.where(np.abs(bound) >= infinity, np.copysign(np.inf, bound), bound)
    return low, high


def _integral(lines: Lines, variables: str, bounds: tuple[Vector, Vector]) -> NDArray[np.bool_]:
    """Return which variables are integers, and set the bounds of binary variables to 0 and 1.

    Files of QPLIB declare binary variables as type 2, or as integers (type 1) with bounds.
    """
    low, high = bounds
    if variables in "CI":
        return np.full(low.size, variables == "I")
    types = _vector(lines, "variable type", low.size)
    for invalid, reason in (
        (~np.isin(types, (0, 1, 2)), "variable type must be 0, 1 or 2"),
        (
            (types == 1) & ~((low >= 0) & (high <= 1)) & (variables == "M"),
            "problem type M has no integers with bounds other than 0 and 1",
        ),
        # The format replaces these bounds; another reader may keep them.
        (
            (types == 2) & ((low > 0) | (high < 1)),
            "bounds of binary variables must contain 0 and 1",
        ),
    ):
        if invalid.any():
            raise lines.error(f"{reason}: variable {int(np.flatnonzero(invalid)[0]) + 1}")
    low[types == 2], high[types == 2] = 0.0, 1.0
    result: NDArray[np.bool_] = types > 0
    return result


def _names(lines: Lines, letter: str, size: int) -> tuple[Block, ...]:
    """Return the block of all columns or rows with its names, by default the letter and a number."""
    what = f"names of {letter}"
    labels: dict[int, str] = {}
    for _ in range(lines.count(what)):
        number, name = lines.fields(what, 2)
        place = lines.whole(f"index of {what}", number, 1, size)
        if place in labels:
            raise lines.error(f"{letter}{place} has two names")
        labels[place] = name
    if not labels:
        index = np.arange(1, size + 1)[:, None]
        return (Block(letter, "", 0, size, f"{letter}{{0}}", index),) if size else ()
    names = tuple(labels.get(k, f"{letter}{k}") for k in range(1, size + 1))
    if len(set(names)) < size:
        raise lines.error(f"{what} must differ")
    return (Block(letter, "", 0, size, labels=names),)


def _no_names(lines: Lines) -> tuple[Block, ...]:
    """Check that nothing but a number 0 of names follows."""
    fields = lines.next()
    if fields not in ([], ["0"]):
        raise lines.error(f"number of names of constraints must be 0, got {show(' '.join(fields))}")
    return ()
