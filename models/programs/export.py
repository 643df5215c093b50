"""Export of programs to other tools: free MPS, LP format, CVXPY, qpsolvers and C code.

Numbers are written with all digits, so that another tool reads the same program. The functions
accept any object with the fields of a program, because programs import this module.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidData, UnsupportedFormulation, show

if TYPE_CHECKING:
    import cvxpy
    import qpsolvers

__all__ = ["c_code", "cvxpy_problem", "lp_lines", "mps_lines", "qpsolvers_problem"]


def mps_lines(program: Any) -> Iterator[str]:
    """Yield the lines of `program` in free MPS; a row with two bounds is a G row with a range."""
    finite = np.where(
        np.isfinite(program.row_lower), "G", np.where(np.isfinite(program.row_upper), "L", "N")
    )
    senses = np.where(program.row_lower == program.row_upper, "E", finite).tolist()
    low, high = program.row_lower.tolist(), program.row_upper.tolist()
    yield "NAME crosstrack"
    yield "ROWS"
    yield " N cost"
    for row, sense in enumerate(senses):
        yield f" {sense} r{row}"
    yield "COLUMNS"
    by_column = program.matrix.tocsc()
    parts = by_column.indptr, by_column.indices, by_column.data
    indptr, indices, data = (part.tolist() for part in parts)
    cost, integral = program.cost.tolist(), program.integral.tolist()
    marked = False
    for column in range(program.size):
        if integral[column] != marked:
            marked = integral[column]
            yield f" MARKER 'MARKER' '{'INTORG' if marked else 'INTEND'}'"
        # The objective is written even if 0, so that a column without rows exists.
        yield f" x{column} cost {cost[column]!r}"
        for k in range(indptr[column], indptr[column + 1]):
            yield f" x{column} r{indices[k]} {data[k]!r}"
    if marked:
        yield " MARKER 'MARKER' 'INTEND'"
    yield "RHS"
    if program.offset:
        yield f" rhs cost {-program.offset!r}"
    for row, sense in enumerate(senses):
        value = high[row] if sense == "L" else low[row]
        if sense != "N" and value:
            yield f" rhs r{row} {value!r}"
    yield "RANGES"
    for row, sense in enumerate(senses):
        if sense == "G" and high[row] < np.inf:
            yield f" range r{row} {high[row] - low[row]!r}"
    yield "BOUNDS"
    for column, lower, upper in _numbered(program.column_lower, program.column_upper):
        if lower == -np.inf and upper == np.inf:
            yield f" FR bound x{column}"
            continue
        yield f" MI bound x{column}" if lower == -np.inf else f" LO bound x{column} {lower!r}"
        yield f" PL bound x{column}" if upper == np.inf else f" UP bound x{column} {upper!r}"
    yield "ENDATA"


def _numbered(lower: Any, upper: Any) -> Iterator[tuple[int, float, float]]:
    return zip(range(lower.size), lower.tolist(), upper.tolist(), strict=True)


def _sum(columns: list[int], values: list[float]) -> str:
    terms = [
        f"{'-' if v < 0 else '+'} {abs(v)!r} x{c}" for c, v in zip(columns, values, strict=True)
    ]
    # Readers of the format limit a line's length.
    return "\n  ".join(" ".join(terms[k : k + 8]) for k in range(0, len(terms), 8)) or "0 x0"


def lp_lines(program: Any) -> Iterator[str]:
    """Yield the lines of `program` in LP format."""
    yield "Minimize"
    objective = _sum(list(range(program.size)), program.cost.tolist())
    sign = "-" if program.offset < 0 else "+"
    constant = f" {sign} {abs(program.offset)!r}" if program.offset else ""
    yield f" cost: {objective}{constant}"
    yield "Subject To"
    matrix = program.matrix
    for row, low, high in _numbered(program.row_lower, program.row_upper):
        part = slice(matrix.indptr[row], matrix.indptr[row + 1])
        terms = _sum(matrix.indices[part].tolist(), matrix.data[part].tolist())
        if low == high:
            yield f" r{row}: {terms} = {low!r}"
            continue
        # A range becomes two rows, because some readers do not support ranges.
        if low > -np.inf:
            yield f" r{row}{'l' if high < np.inf else ''}: {terms} >= {low!r}"
        if high < np.inf:
            yield f" r{row}{'u' if low > -np.inf else ''}: {terms} <= {high!r}"
    yield "Bounds"
    for column, lower, upper in _numbered(program.column_lower, program.column_upper):
        if lower == -np.inf and upper == np.inf:
            yield f" x{column} free"
        else:
            left = "-inf" if lower == -np.inf else repr(lower)
            right = "+inf" if upper == np.inf else repr(upper)
            yield f" {left} <= x{column} <= {right}"
    if program.integral.any():
        yield "General"
        yield from (f" x{column}" for column in np.flatnonzero(program.integral))
    yield "End"


def cvxpy_problem(program: Any) -> tuple[cvxpy.Problem, cvxpy.Variable]:
    """Return `program` as a ``cvxpy.Problem`` with its variable.

    The constraints are the equality rows, the lower and upper row bounds, and the lower and upper
    column bounds, in this order and without empty groups.
    """
    import cvxpy

    cp: Any = cvxpy  # its functions have no types
    integral = np.flatnonzero(program.integer_columns)
    x = cp.Variable(program.size, name="x", **({"integer": [integral]} if integral.size else {}))
    constraints: list[Any] = []
    compare: dict[str, Any] = {"=": operator.eq, ">": operator.ge, "<": operator.le}
    for sense, which, side in program.sides():
        constraints.append(compare[sense](program.matrix[which] @ x, side))
    for bound, sign in ((program.column_lower, 1), (program.column_upper, -1)):
        take = np.isfinite(bound)
        if take.any():
            constraints.append(sign * x[np.flatnonzero(take)] >= sign * bound[take])
    objective = program.cost @ x + program.offset
    if hasattr(program, "hessian"):
        # The class requires a semidefinite Hessian; CVXPY's own test of it fails by rounding.
        objective = objective + cp.quad_form(x, program.hessian, assume_PSD=True) / 2
    return cp.Problem(cp.Minimize(objective), constraints), x


def qpsolvers_problem(program: Any) -> qpsolvers.Problem:
    """Return `program` as a ``qpsolvers.Problem`` without the constant of the objective."""
    import qpsolvers
    import scipy.sparse as sp

    matrix, low, high = program.matrix, program.row_lower, program.row_upper
    equal = low == high
    above, below = ~equal & np.isfinite(high), ~equal & np.isfinite(low)
    inequalities = bool((above | below).any())
    stacked = sp.vstack([matrix[np.flatnonzero(above)], -matrix[np.flatnonzero(below)]])
    bounded = np.isfinite(program.column_lower).any() or np.isfinite(program.column_upper).any()
    # Copies, because the program's arrays are read-only, which some solvers reject.
    return qpsolvers.Problem(
        P=sp.csc_matrix(program.hessian, copy=True),
        q=program.cost.copy(),
        G=sp.csc_matrix(stacked) if inequalities else None,
        h=np.concatenate([high[above], -low[below]]) if inequalities else None,
        A=sp.csc_matrix(matrix[np.flatnonzero(equal)]) if equal.any() else None,
        b=low[equal].copy() if equal.any() else None,
        lb=program.column_lower.copy() if bounded else None,
        ub=program.column_upper.copy() if bounded else None,
    )


def c_code(program: Any, name: str) -> str:
    """Return C code of a nonlinear program; see ``NonlinearProgram.to_c``."""
    import casadi

    if not isinstance(name, str) or not casadi.Function.check_name(name):
        raise InvalidData(
            f"name must be a valid name of a C function, such as 'program', got {show(name)}",
            field="name",
        )
    arguments = program.casadi_arguments()
    x, weight = casadi.MX.sym("x", program.size), casadi.MX.sym("lam_f")
    duals, call = casadi.MX.sym("lam_g", program.row_count), casadi.Function
    values = [*map(casadi.DM, arguments.values())]
    code = casadi.CodeGenerator(name)
    try:
        for end, function, inputs in (
            ("", program.function, [x]),
            ("_first", program.first_order, [x]),
            ("_second", program.second_order, [x, weight, duals]),
        ):
            names = function.name_in(), function.name_out()
            code.add(call(name + end, inputs, function.call(inputs), *names))
        code.add(call(f"{name}_arguments", [], values, [], [*arguments]))
        return str(code.dump())
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise UnsupportedFormulation(f"no C code can be written: {reason}") from error
