"""Programs from arrays under the names of SciPy, OSQP and qpsolvers."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ....errors import InvalidData, suggestion
from ...fields import Array, show
from ..base import RowProgram
from ..blocks import Block, Sparse
from ..linear import MixedIntegerProgram, QuadraticProgram
from .link import Source

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["program_of_arrays", "program_of_qpsolvers"]

Vector = NDArray[np.float64]

#: Smallest magnitude of infinite bounds in OSQP's convention. Files of the Maros-Meszaros set contain
#: 9.99e19, because rows with infinite bounds of 1e20 were shifted by constants.
OSQP_INFINITY = 9e19

#: Names of arrays that identify each convention, and all names that it knows.
_CONVENTIONS: dict[str, tuple[set[str], set[str]]] = {
    "scipy.optimize.milp": ({"constraints"}, {"c", "constraints", "bounds", "integrality"}),
    "OSQP": ({"A", "l", "u"}, {"P", "q", "A", "l", "u", "r"}),
    "qpsolvers": ({"q"}, {"P", "q", "G", "h", "A", "b", "lb", "ub"}),
    "scipy.optimize.linprog": (
        {"c"},
        {"c", "A_ub", "b_ub", "A_eq", "b_eq", "bounds", "integrality"},
    ),
}


def program_of_arrays(arrays: Any) -> RowProgram:
    """Return the program of arrays.

    Parameters
    ----------
    arrays : mapping or tuple
        Arrays under the names of one convention:

        - ``scipy.optimize.linprog``: ``c``, ``A_ub``, ``b_ub``, ``A_eq``, ``b_eq``, ``bounds``,
          ``integrality``. As there, columns are non-negative without `bounds`. A tuple contains the first
          of them in this order.
        - ``scipy.optimize.milp``: ``c``, ``constraints``, ``bounds``, ``integrality``, with
          ``LinearConstraint`` and ``Bounds``. Columns are non-negative without `bounds`.
        - OSQP: ``P``, ``q``, ``A``, ``l``, ``u``, and the constant ``r`` of the objective; bounds of
          magnitude 9e19 or more are infinite.
        - qpsolvers: ``P``, ``q``, ``G``, ``h``, ``A``, ``b``, ``lb``, ``ub``.

    Returns
    -------
    MixedIntegerProgram or QuadraticProgram
        A program with the column block ``"x"``.

    Raises
    ------
    InvalidData
        A name is unknown or missing, or an array has another shape or is not finite.
    """
    if isinstance(arrays, tuple):
        arrays = _of_tuple(arrays)
    if not isinstance(arrays, Mapping):
        raise InvalidData(
            f"model must be a mapping or a tuple of arrays, got {show(arrays)}", field="model"
        )
    content = {name: value for name, value in arrays.items() if value is not None}
    for convention, (needed, known) in _CONVENTIONS.items():
        if not needed <= content.keys():
            continue
        for name in content:
            if name not in known:
                raise InvalidData(
                    f"unknown array {show(name)} beside {', '.join(sorted(needed))} in the convention of "
                    f"{convention}; {suggestion(str(name), known)}allowed: {', '.join(sorted(known))}",
                    field=str(name),
                )
        program = _READERS[convention](content)
        if not program.size:
            raise InvalidData("model must have a column, but its objective has none", field="model")
        return program.with_source(Source(arrays, lambda plan: {"x": np.array(plan)}))
    conventions = "; ".join(
        f"{name}: {', '.join(sorted(known))}" for name, (_, known) in _CONVENTIONS.items()
    )
    raise InvalidData(
        f"arrays must follow one convention, got the names {', '.join(map(str, content)) or 'of none'}; known: {conventions}",
        field="model",
    )


def _of_tuple(arrays: tuple[Any, ...]) -> dict[str, Any]:
    """Return positional arguments of ``linprog`` or ``milp`` by name."""
    names = ("c", "A_ub", "b_ub", "A_eq", "b_eq", "bounds")
    if not 1 <= len(arrays) <= len(names):
        raise InvalidData(
            f"a tuple must contain {', '.join(names)} in this order, as the arguments of linprog; got "
            f"{len(arrays)} entries",
            field="model",
        )
    if len(arrays) > 1 and any(_is_constraint(part) for part in arrays[1:]):
        raise InvalidData(
            "a tuple contains arrays: pass LinearConstraint and Bounds by name, as in "
            '{"c": c, "constraints": LinearConstraint(A, l, u), "bounds": Bounds(lb, ub)}',
            field="model",
        )
    return dict(zip(names, arrays, strict=False))


def _is_constraint(value: Any) -> bool:
    return hasattr(value, "lb") and hasattr(value, "ub")


def _vector(name: str, value: Any, size: int | None = None, infinity: int = 0) -> Vector:
    """Return a vector; `infinity` as in :class:`Array`."""
    value = value.toarray() if sp.issparse(value) else value
    flat = np.asarray(value, dtype=object if isinstance(value, list | tuple) else None)
    if (flat.ndim == 2 and 1 in flat.shape) or (flat.ndim == 0 and size is not None):
        value = flat.reshape(-1)  # a column, a row, or a number for all entries
    result: Vector = Array(("entries",), infinity=infinity).coerce(name, value, {})
    if size is not None and result.size == 1 and size != 1:
        result = np.full(size, result[0])
    if size is not None and result.size != size:
        raise InvalidData(f"{name} must have {size} entries, got {result.size}", field=name)
    return result


def _matrix(name: str, value: Any, columns: int | None) -> sp.csr_array:
    """Return a sparse matrix with the given number of columns; a vector is one row."""
    if not sp.issparse(value) and not isinstance(value, Mapping):
        with contextlib.suppress(ValueError):  # rows of different lengths: rejected below
            value = np.atleast_2d(value)
    result = Sparse(("rows", "columns")).coerce(name, value, {})
    if columns is not None and result.shape[1] != columns:
        raise InvalidData(f"{name} must have {columns} columns, got {result.shape[1]}", field=name)
    return result


class _Rows:
    """Rows collected group by group, each group a block: names, matrices, lower and upper bounds."""

    def __init__(self, columns: int) -> None:
        self.columns = columns
        empty = np.empty(0)
        self.groups = [("", sp.csr_array((0, columns)), empty, empty)]

    def add(self, name: str, matrix: sp.csr_array, lower: Vector, upper: Vector) -> None:
        self.groups.append((name, matrix, lower, upper))

    def pair(self, content: Mapping[str, Any], left: str, right: str, equal: bool) -> None:
        """Add the rows ``left @ x <= right``, or with ``=``, if they are given."""
        if (left in content) != (right in content):
            missing = right if left in content else left
            raise InvalidData(
                f"{missing} is missing: {left} and {right} belong together", field=missing
            )
        if left not in content:
            return
        matrix = _matrix(left, content[left], self.columns)
        side = _vector(right, content[right], matrix.shape[0], infinity=0 if equal else 1)
        self.add(left, matrix, side if equal else np.full(side.size, -np.inf), side)

    def fields(self) -> dict[str, Any]:
        """Return the fields of a program."""
        names, matrices, lower, upper = zip(*self.groups, strict=True)
        ends = list(itertools.accumulate(side.size for side in lower))
        return {
            "matrix": sp.csr_array(sp.vstack(matrices)),
            "row_lower": np.concatenate(lower),
            "row_upper": np.concatenate(upper),
            "rows": tuple(
                Block(name, "", end - side.size, side.size)
                for name, end, side in zip(names, ends, lower, strict=True)
                if side.size
            ),
            "columns": (Block("x", "", 0, self.columns),),
        }


def _bounds(value: Any, columns: int) -> tuple[Vector, Vector]:
    """Return column bounds in any form that ``linprog`` or ``milp`` accepts."""
    if value is None or (isinstance(value, list | tuple | np.ndarray) and not len(value)):
        return np.zeros(columns), np.full(columns, np.inf)
    if _is_constraint(value):
        return (
            _vector("bounds.lb", value.lb, columns, infinity=-1),
            _vector("bounds.ub", value.ub, columns, infinity=1),
        )
    try:
        pairs = [tuple(pair) for pair in value] if np.ndim(value[0]) else [tuple(value)]
    except (TypeError, LookupError, ValueError):
        pairs = []
    if len(pairs) == 1:
        pairs = pairs * columns
    if len(pairs) != columns or any(len(pair) != 2 for pair in pairs):
        raise InvalidData(
            f"bounds must be Bounds, a pair, or {columns} pairs (lower, upper), got {show(value)}",
            field="bounds",
        )
    low, high = zip(*pairs, strict=True)
    return (
        _vector("bounds", [-np.inf if entry is None else entry for entry in low], infinity=-1),
        _vector("bounds", [np.inf if entry is None else entry for entry in high], infinity=1),
    )


def _of_scipy(content: Mapping[str, Any]) -> RowProgram:
    """Return the program of the arguments of ``linprog`` or ``milp``."""
    if "c" not in content:
        raise InvalidData("c is missing: the objective needs it", field="c")
    cost = _vector("c", content["c"])
    rows = _Rows(cost.size)
    if "constraints" in content:
        given = content["constraints"]
        several = isinstance(given, list | tuple)
        if several and len(given) == 3:  # one constraint (A, lower, upper), or three
            several = isinstance(given[0], tuple) or _is_constraint(given[0])
        for number, entry in enumerate(given if several else [given]):
            name = f"constraints[{number}]"
            is_object = _is_constraint(entry) and hasattr(entry, "A")
            parts = (entry.A, entry.lb, entry.ub) if is_object else entry
            if not isinstance(parts, list | tuple) or len(parts) != 3:
                raise InvalidData(
                    f"{name} must be a LinearConstraint or (A, lower, upper), got {show(entry)}",
                    field=name,
                )
            matrix = _matrix(f"{name}.A", parts[0], cost.size)
            count = matrix.shape[0]
            rows.add(
                name, matrix, _vector(f"{name}.lb", parts[1], count, infinity=-1),
                _vector(f"{name}.ub", parts[2], count, infinity=1),
            )  # fmt: skip
    rows.pair(content, "A_ub", "b_ub", equal=False)
    rows.pair(content, "A_eq", "b_eq", equal=True)
    low, high = _bounds(content.get("bounds"), cost.size)
    given = np.asarray(content.get("integrality", 0), dtype=object).ravel()
    whole = [int(kind) if isinstance(kind, bool | np.bool_) else kind for kind in given]
    kinds = _vector("integrality", whole, cost.size)
    if not np.isin(kinds, (0, 1)).all():
        entry = int(np.flatnonzero(~np.isin(kinds, (0, 1)))[0])
        raise InvalidData(
            f"integrality[{entry}] must be 0 or 1, got {kinds[entry]:g}: no program has semi-continuous columns",
            field="integrality",
        )
    return MixedIntegerProgram(
        cost=cost, column_lower=low, column_upper=high, integral=kinds == 1, **rows.fields()
    )


def _of_osqp(content: Mapping[str, Any]) -> RowProgram:
    """Return the program of ``P, q, A, l, u, r``."""
    cost = _vector("q", content["q"]) if "q" in content else None
    body = _matrix("A", content["A"], None if cost is None else cost.size)
    cost = np.zeros(body.shape[1]) if cost is None else cost
    rows = _Rows(cost.size)
    low = _vector("l", content["l"], body.shape[0], infinity=-1)
    high = _vector("u", content["u"], body.shape[0], infinity=1)
    low = np.where(low <= -OSQP_INFINITY, -np.inf, low)
    rows.add("A", body, low, np.where(high >= OSQP_INFINITY, np.inf, high))
    offset = float(_vector("r", np.ravel(content.get("r", 0.0)), 1)[0])
    return _quadratic(
        content, cost, rows, np.full(cost.size, -np.inf), np.full(cost.size, np.inf), offset
    )


def _of_qpsolvers(content: Mapping[str, Any]) -> RowProgram:
    """Return the program of ``P, q, G, h, A, b, lb, ub``."""
    cost = _vector("q", content["q"])
    rows = _Rows(cost.size)
    rows.pair(content, "G", "h", equal=False)
    rows.pair(content, "A", "b", equal=True)
    low = _vector("lb", content.get("lb", np.full(cost.size, -np.inf)), cost.size, infinity=-1)
    high = _vector("ub", content.get("ub", np.full(cost.size, np.inf)), cost.size, infinity=1)
    return _quadratic(content, cost, rows, low, high, 0.0)


def _quadratic(
    content: Mapping[str, Any], cost: Vector, rows: _Rows, low: Vector, high: Vector, offset: float
) -> RowProgram:
    """Return a quadratic program, or a linear one without a Hessian."""
    shared: dict[str, Any] = {
        "cost": cost, "column_lower": low, "column_upper": high, "offset": offset, **rows.fields()
    }  # fmt: skip
    hessian = _matrix("P", content["P"], cost.size) if "P" in content else None
    if hessian is None or not hessian.nnz:
        return MixedIntegerProgram(**shared, integral=np.zeros(cost.size, bool))
    if hessian.shape != (cost.size, cost.size):
        raise InvalidData(
            f"P must have shape {(cost.size, cost.size)}, got {hessian.shape}", field="P"
        )
    if "l" in content and not sp.tril(hessian, -1).nnz:  # OSQP stores the upper triangle
        hessian = hessian + sp.triu(hessian, 1).T
    try:
        program = QuadraticProgram(**shared, hessian=hessian)
        program.require_convex()
    except InvalidData as error:
        if error.field != "hessian":
            raise
        raise InvalidData(str(error).replace("hessian", "P"), field="P") from None
    return program


_READERS = {
    "scipy.optimize.milp": _of_scipy,
    "scipy.optimize.linprog": _of_scipy,
    "OSQP": _of_osqp,
    "qpsolvers": _of_qpsolvers,
}


def program_of_qpsolvers(problem: qpsolvers.Problem) -> RowProgram:
    """Return the program of a ``qpsolvers.Problem``, a linear one if the Hessian is zero.

    Raise ``InvalidData`` if an array has another shape, is not finite, or the Hessian is not positive
    semidefinite.
    """
    names = ("P", "q", "G", "h", "A", "b", "lb", "ub")
    missing = [name for name in names if not hasattr(problem, name)]
    if missing:
        raise InvalidData(
            f"model must be a qpsolvers.Problem, got {type(problem).__name__} without {', '.join(missing)}",
            field="model",
        )
    program = program_of_arrays({name: getattr(problem, name) for name in names})
    return program.with_source(Source(problem, lambda plan: {"x": np.array(plan)}))
