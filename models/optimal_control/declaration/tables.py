"""Tabulated data as smooth functions of one to three arguments, for declarations.

Inside its grid, a table is the tensor product of cubic splines with not-a-knot ends (SciPy's
``CubicSpline``), which is twice continuously differentiable.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ....errors import InvalidData
from ...fields import show
from ..definition import Restriction
from .terms import numbers, read_expression, restriction

__all__ = ["Table", "domains", "table"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX

OUTSIDE = ("linear", "hold", "raise")
#: Largest number of values, and of points per axis of several: each is an operation of the spline.
MOST_NUMBERS, MOST_POINTS = 10_000, 100
#: Number of points up to which not-a-knot ends give a single polynomial.
CUBIC = 4
#: Depth to which expressions are compared; expressions that differ only deeper are distinct uses.
SAME = 20
#: Names of the results of a table's function if its arguments must stay within the grid.
_BOUNDED = ["value", "lower", "upper"]


class Table:
    """Tabulated function, created by :func:`table`.

    Parameters
    ----------
    function : casadi.Function
        Function from scalar arguments to ``value``. Additional results ``lower`` and ``upper`` are
        the bounds of the arguments, if these are enforced.
    """

    def __init__(self, function: casadi.Function) -> None:
        self.function = function

    def __call__(self, *arguments: Any) -> Any:
        """Return the value at numbers or arrays, or the expression in declared symbols.

        Parameters
        ----------
        *arguments : float, array_like or casadi expression
            One argument per axis of the grid, broadcast against one another.

        Raises
        ------
        InvalidData
            The number of arguments differs from the number of axes, or their sizes do not match.
        """
        count = self.function.n_in()
        try:
            if len(arguments) != count:
                raise ValueError(f"got {len(arguments)}")
            if not any(isinstance(argument, casadi.MX) for argument in arguments):
                return self._values(*np.broadcast_arrays(*arguments))
            columns = [casadi.vec(read_expression("an argument of a table", x)) for x in arguments]
            size = max(argument.numel() for argument in columns)
            if any(argument.numel() not in (1, size) for argument in columns):
                raise ValueError(f"got {', '.join(str(x.numel()) for x in columns)} entries")
        except (TypeError, ValueError) as error:
            expected = "1 argument" if count == 1 else f"{count} arguments of one size"
            raise InvalidData(
                f"table {self._name!r} takes {expected}: {error}", field="table"
            ) from None
        repeated: list[Any] = [casadi.repmat(x, size // x.numel()) for x in columns]
        parts = [self.function.call([argument[k] for argument in repeated])[0] for k in range(size)]
        return casadi.vertcat(*parts)

    @property
    def _name(self) -> str:
        return str(self.function.name())

    def _values(self, *arguments: Any) -> Any:
        rows = [np.asarray(argument, float).reshape(1, -1) for argument in arguments]
        values = np.array(self.function.map(rows[0].size).call(rows)[0], float)
        return values.reshape(np.shape(arguments[0]))[()]

    def __repr__(self) -> str:
        return f"<table {self._name} of {self.function.n_in()} argument(s)>"


def table(grid: Any, values: Any, outside: str = "linear", *, name: str = "table") -> Table:
    """Return a smooth function through tabulated values.

    Parameters
    ----------
    grid : array_like or tuple of array_like
        Increasing points, shape (n,); or a tuple of one to three such grids, one per argument.
    values : array_like, shape (n, …)
        Values at all points, with one axis per grid.
    outside : {"linear", "hold", "raise"}
        Extrapolation: ``"linear"`` continues with the value and slope at the edge, ``"hold"`` with the
        value. ``"raise"`` adds a path or boundary constraint that the arguments stay inside.
    name : str
        Name in constraints and residuals: letters, digits and single ``_``, beginning with a letter.

    Returns
    -------
    Table
        Function of numbers, arrays or expressions: ``thrust(mach, altitude)``.

    Raises
    ------
    InvalidData
        An argument is invalid; the message names it.

    Notes
    -----
    The function is twice continuously differentiable inside and once at the edge (``"hold"``:
    continuous). It is a cubic spline with not-a-knot ends; two points give a line, three a parabola.
    """
    if not isinstance(name, str) or not casadi.Function.check_name(name):
        raise InvalidData(
            f"name of a table must be letters, digits and single '_', got {show(name)}",
            field="name",
        )
    of = f"table {name!r}"
    if not isinstance(outside, str) or outside not in OUTSIDE:
        raise InvalidData(
            f"outside of {of} must be one of {', '.join(map(repr, OUTSIDE))}, got {show(outside)}",
            field="outside",
        )
    axes = grid if isinstance(grid, tuple) and any(np.ndim(axis) for axis in grid) else (grid,)
    if not 1 <= len(axes) <= 3:
        raise InvalidData(f"grid of {of} must have 1 to 3 axes, got {len(axes)}", field="grid")
    grids = [numbers("grid", axis, f"increasing numbers, 2 at least, in {of}") for axis in axes]
    for axis in grids:
        is_finite = axis.ndim == 1 and axis.size >= 2 and np.isfinite(axis).all()
        if not is_finite or not (np.diff(axis) > 0).all():
            raise InvalidData(
                f"grid of {of} must be increasing finite numbers, 2 at least, got {show(axis.tolist())}",
                field="grid",
            )
    data, shape = numbers("values", values, f"numbers in {of}"), tuple(axis.size for axis in grids)
    if data.shape != shape or not np.isfinite(data).all():
        raise InvalidData(
            f"values of {of} must be finite, of shape {shape} as the grid is, got shape {data.shape}",
            field="values",
        )
    if data.size > MOST_NUMBERS or (len(grids) > 1 and max(shape) > MOST_POINTS):
        raise InvalidData(
            f"values of {of} must be {MOST_NUMBERS} at most, with {MOST_POINTS} points at most along each "
            f"of several axes, got shape {shape}",
            field="values",
        )
    arguments = [casadi.MX.sym(f"x{k}") for k in range(len(grids))]
    if len(grids) == 1:
        result = _along(arguments[0], grids[0], data[:, None], outside)
    else:
        result = casadi.MX(casadi.DM(data.reshape(-1)))  # the first axis varies slowest
        for symbol, points in zip(arguments, grids, strict=True):
            basis = _along(symbol, points, np.eye(points.size), outside)
            result = casadi.reshape(result, result.numel() // points.size, points.size) @ basis
    results = [result]
    if outside == "raise":
        results += [casadi.DM([axis[end] for axis in grids]) for end in (0, -1)]
    labels = [f"x{k}" for k in range(len(grids))], _BOUNDED[: len(results)]
    return Table(casadi.Function(name, arguments, results, *labels))


def _along(x: Any, grid: Floats, values: Floats, outside: str) -> Any:
    """Return cubic splines through `values`, (points, splines), at the scalar `x`, with extrapolation."""
    spline = CubicSpline(grid, values)
    low, high = float(grid[0]), float(grid[-1])
    near = casadi.if_else(x > high, high, casadi.if_else(x < low, low, x))
    if grid.size > CUBIC:
        result = casadi.interpolant("spline", "bspline", [grid], values.reshape(-1))(near)
    else:  # a single polynomial, which CasADi's splines do not support
        result = casadi.MX.zeros(values.shape[1], 1)
        for power in spline.c:
            result = result * (near - low) + casadi.DM(power[0])
    if outside != "hold":
        below, above = (casadi.DM(spline(edge, 1)) for edge in (low, high))
        result += (x - near) * casadi.if_else(x > high, above, below)
    return result


def domains(
    expressions: Sequence[Symbol], taken: Sequence[str]
) -> list[tuple[Restriction, Symbol]]:
    """Return the constraints that keep the arguments of tables with ``outside="raise"`` in their grids.

    The constraints have columns, and names other than those `taken`.
    """
    stacked = casadi.vertcat(*expressions, casadi.MX(0, 1))
    probe = casadi.Function("probe", casadi.symvar(stacked), [stacked])
    if not any(item.name_out() == _BOUNDED for item in probe.find_functions(0)):
        return []
    result: dict[str, tuple[Restriction, Symbol]] = {}
    visited, left = set(), [stacked]
    known: list[tuple[int, Symbol]] = []
    while left:
        node = left.pop()
        if node.__hash__() in visited:
            continue
        visited.add(node.__hash__())
        arguments = [node.dep(k) for k in range(node.n_dep())]
        left += arguments
        if not node.is_call() or node.which_function().name_out() != _BOUNDED:
            continue
        function = node.which_function()
        use = function.__hash__(), casadi.vertcat(*arguments)
        if any(item == use[0] and casadi.is_equal(other, use[1], SAME) for item, other in known):
            continue
        known.append(use)
        edges = function.call([0.0] * len(arguments))[1:]
        low, high = (np.array(item).reshape(-1) for item in edges)
        base = f"table {function.name()} within its grid"
        names = itertools.chain([base], (f"{base} ({k})" for k in itertools.count(2)))
        name = next(item for item in names if item not in result and item not in taken)
        limits = restriction((name, "", ""), low.size, low, high, None)
        result[name] = limits, use[1]
    return list(result.values())
