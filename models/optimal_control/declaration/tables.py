"""Tables of data as smooth functions of one to three arguments, for declarations.

Between the points of its grid a table is the tensor product of cubic splines with not-a-knot ends (SciPy's
``CubicSpline``), so twice continuously differentiable.
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
#: Numbers in a table at most, and points of a grid at most where there are several: they are operations.
MOST_NUMBERS, MOST_POINTS = 10_000, 100
#: Points through which not-a-knot ends leave one polynomial.
CUBIC = 4
#: Depth to which expressions are compared: what is alike deeper down is a use of its own.
SAME = 20
#: What the results of a table's function are called where its arguments must stay within the grid.
_BOUNDED = ["value", "lower", "upper"]


class Table:
    """A table as a function; made by :func:`table`.

    Parameters
    ----------
    function : casadi.Function
        Scalar arguments to ``value``; with the results ``lower`` and ``upper`` where it is to be checked
        that the arguments stay between them.
    """

    def __init__(self, function: casadi.Function) -> None:
        self.function = function

    def __call__(self, *arguments: Any) -> Any:
        """Return the value at numbers or arrays, or the expression in declared symbols.

        Raises
        ------
        InvalidData
            The arguments are not as many as the grid has axes, or do not fit together.
        """
        count = self.function.n_in()
        try:
            if len(arguments) != count:
                raise ValueError(f"got {len(arguments)}")
            if not any(isinstance(one, casadi.MX) for one in arguments):
                return self._values(*np.broadcast_arrays(*arguments))
            columns = [
                casadi.vec(read_expression("an argument of a table", one)) for one in arguments
            ]
            size = max(one.numel() for one in columns)
            if any(one.numel() not in (1, size) for one in columns):
                raise ValueError(f"got {', '.join(str(one.numel()) for one in columns)} entries")
        except (TypeError, ValueError) as error:
            words = "1 argument" if count == 1 else f"{count} arguments of one size"
            raise InvalidData(
                f"table {self._name!r} takes {words}: {error}", field="table"
            ) from None
        wide: list[Any] = [casadi.repmat(one, size // one.numel()) for one in columns]
        parts = [self.function.call([one[k] for one in wide])[0] for k in range(size)]
        return casadi.vertcat(*parts)

    @property
    def _name(self) -> str:
        return str(self.function.name())

    def _values(self, *arguments: Any) -> Any:
        rows = [np.asarray(one, float).reshape(1, -1) for one in arguments]
        found = np.array(self.function.map(rows[0].size).call(rows)[0], float)
        return found.reshape(np.shape(arguments[0]))[()]

    def __repr__(self) -> str:
        return f"<table {self._name} of {self.function.n_in()} argument(s)>"


def table(grid: Any, values: Any, outside: str = "linear", *, name: str = "table") -> Table:
    """Return a smooth function through tabulated values.

    Parameters
    ----------
    grid : array_like or tuple of array_like
        Increasing points, (n,); or a tuple of one to three such grids, one an argument.
    values : array_like, shape (n, …)
        The values at all points, an axis for each grid.
    outside : str
        What holds outside the grid: ``"linear"`` goes on with value and slope at its edge, ``"hold"``
        with the value, and ``"raise"`` makes it a path constraint of the phase, or a boundary
        constraint, that the arguments stay inside.
    name : str
        Its name in constraints and residuals: letters, digits and single ``_``, a letter first.

    Returns
    -------
    Table
        To be called with numbers, arrays or expressions: ``thrust(mach, altitude)``.

    Raises
    ------
    InvalidData
        Something of it is wrong; the message names it.

    Notes
    -----
    Twice continuously differentiable inside, once at the edge (``"hold"``: continuous). Cubic splines with
    not-a-knot ends; through two points a line, through three a parabola.
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
    axes = grid if isinstance(grid, tuple) and any(np.ndim(one) for one in grid) else (grid,)
    if not 1 <= len(axes) <= 3:
        raise InvalidData(f"grid of {of} must have 1 to 3 axes, got {len(axes)}", field="grid")
    grids = [numbers("grid", one, f"increasing numbers, 2 at least, in {of}") for one in axes]
    for one in grids:
        if (
            one.ndim != 1
            or one.size < 2
            or not (np.isfinite(one).all() and (np.diff(one) > 0).all())
        ):
            raise InvalidData(
                f"grid of {of} must be increasing finite numbers, 2 at least, got {show(one.tolist())}",
                field="grid",
            )
    data, shape = numbers("values", values, f"numbers in {of}"), tuple(one.size for one in grids)
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
        found = _along(arguments[0], grids[0], data[:, None], outside)
    else:
        found = casadi.MX(casadi.DM(data.reshape(-1)))  # the first axis varies slowest
        for symbol, points in zip(arguments, grids, strict=True):
            basis = _along(symbol, points, np.eye(points.size), outside)
            found = casadi.reshape(found, found.numel() // points.size, points.size) @ basis
    results = [found]
    if outside == "raise":
        results += [casadi.DM([one[end] for one in grids]) for end in (0, -1)]
    labels = _BOUNDED[: len(results)]
    return Table(
        casadi.Function(name, arguments, results, [f"x{k}" for k in range(len(grids))], labels)
    )


def _along(x: Any, grid: Floats, values: Floats, outside: str) -> Any:
    """Return cubic splines through `values`, (points, splines), at the scalar `x`, with what is outside."""
    spline = CubicSpline(grid, values)
    low, high = float(grid[0]), float(grid[-1])
    near = casadi.if_else(x > high, high, casadi.if_else(x < low, low, x))
    if grid.size > CUBIC:
        found = casadi.interpolant("spline", "bspline", [grid], values.reshape(-1))(near)
    else:  # one polynomial, which CasADi does not take
        found = casadi.MX.zeros(values.shape[1], 1)
        for power in spline.c:
            found = found * (near - low) + casadi.DM(power[0])
    if outside != "hold":
        below, above = (casadi.DM(spline(edge, 1)) for edge in (low, high))
        found += (x - near) * casadi.if_else(x > high, above, below)
    return found


def domains(
    expressions: Sequence[Symbol], taken: Sequence[str]
) -> list[tuple[Restriction, Symbol]]:
    """Return the constraints that keep the arguments of tables within their grids, where asked for.

    Parameters
    ----------
    expressions : sequence of casadi.MX
        What is declared.
    taken : sequence of str
        Names that other constraints bear.
    """
    whole = casadi.vertcat(*expressions, casadi.MX(0, 1))
    probe = casadi.Function("probe", casadi.symvar(whole), [whole])
    if not any(one.name_out() == _BOUNDED for one in probe.find_functions(0)):
        return []
    found: dict[str, tuple[Restriction, Symbol]] = {}
    seen, left = set(), [whole]
    known: list[tuple[int, Symbol]] = []
    while left:
        node = left.pop()
        if node.__hash__() in seen:
            continue
        seen.add(node.__hash__())
        arguments = [node.dep(k) for k in range(node.n_dep())]
        left += arguments
        if not node.is_call() or node.which_function().name_out() != _BOUNDED:
            continue
        function = node.which_function()
        use = function.__hash__(), casadi.vertcat(*arguments)
        if any(one == use[0] and casadi.is_equal(own, use[1], SAME) for one, own in known):
            continue
        known.append(use)
        _, low, high = (np.array(one).reshape(-1) for one in function.call([0.0] * len(arguments)))
        base = f"table {function.name()} within its grid"
        names = itertools.chain([base], (f"{base} ({k})" for k in itertools.count(2)))
        name = next(one for one in names if one not in found and one not in taken)
        made = restriction((name, "", ""), low.size, low, high, None)
        found[name] = made, use[1]
    return list(found.values())
