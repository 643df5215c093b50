"""Programs from CasADi: ``Opti`` and mappings of expressions."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData, suggestion
from ...fields import Array, show
from ..blocks import Block
from ..compiled import require_casadi
from ..nonlinear import NonlinearProgram
from .link import Source

if TYPE_CHECKING:
    import casadi

__all__ = ["program_of_expressions", "program_of_opti"]

Vector = NDArray[np.float64]

#: Names of the fields of a program in a mapping of expressions.
_NAMES = {
    "column_lower": "lbx",
    "column_upper": "ubx",
    "row_lower": "lbg",
    "row_upper": "ubg",
    "integral": "discrete",
}
_KNOWN = ("x", "f", "g", "p", "lbx", "ubx", "lbg", "ubg", "x0", "p0", "discrete")


def program_of_expressions(problem: Mapping[str, Any]) -> NonlinearProgram:
    """Return the program of CasADi expressions in a mapping, with the column block ``"x"``.

    The keys are those of ``casadi.nlpsol``: the symbols ``x``, the objective ``f``, and optionally the
    constraints ``g`` and the symbols ``p`` of parameters. The bounds ``lbx, ubx, lbg, ubg`` (numbers or vectors;
    infinite by default), the guess ``x0`` (default 0), the values ``p0`` of the parameters and ``discrete``, one
    Boolean per column that must be an integer, complete it. Raise ``InvalidData`` if a name is unknown or
    missing, a shape differs, or the expressions contain other symbols.
    """
    require_casadi("a mapping with the key 'f'")
    import casadi

    for name in problem:
        if name not in _KNOWN:
            raise InvalidData(
                f"unknown key {show(name)} in a program of expressions; {suggestion(str(name), _KNOWN)}"
                f"allowed: {', '.join(_KNOWN)}",
                field=str(name),
            )
    kind = casadi.SX if isinstance(problem.get("x"), casadi.SX) else casadi.MX
    given = {name: value for name, value in problem.items() if value is not None}
    parts: dict[str, Any] = {"g": kind(0, 1), "p": kind.sym("p", 0)}
    for name in ("x", "f", "g", "p"):
        value = given.get(name, parts.get(name))
        if value is None:
            raise InvalidData(
                f"{name} is missing: a program of expressions has x and f", field=name
            )
        if name in ("f", "g") and isinstance(value, int | float | np.number | casadi.DM):
            value = kind(value if isinstance(value, casadi.DM) else float(value))
        if not isinstance(value, kind):
            raise InvalidData(
                f"{name} must be a casadi.{kind.__name__}{' as x' if name != 'x' else ' or SX'}, got "
                f"{show(value)}",
                field=name,
            )
        parts[name] = value
    x, f, g, p = parts["x"], parts["f"], casadi.vec(parts["g"]), parts["p"]
    for name, value in (("x", x), ("p", p)):
        if not value.is_valid_input() or (
            name == "x" and not (value.is_column() and value.is_dense())
        ):
            raise InvalidData(
                f"{name} must consist of symbols{' in a dense column' if name == 'x' else ''}, got "
                f"{value.size1()} x {value.size2()} {show(value)}",
                field=name,
            )
    symbols = casadi.symvar(casadi.vertcat(x, casadi.vec(p)))
    if not x.numel() or sum(symbol.numel() for symbol in symbols) != x.numel() + p.numel():
        raise InvalidData(
            f"x must have a symbol, and x and p must contain each symbol once, got {show(x)} and {show(p)}",
            field="x",
        )
    if not f.is_scalar():
        raise InvalidData(f"f must be a number, got shape {f.shape}", field="f")
    function = casadi.Function(
        "program", [x, p], [casadi.densify(f), casadi.densify(g)], ["x", "p"], ["f", "g"],
        {"allow_free": True},
    )  # fmt: skip
    if function.has_free():
        raise InvalidData(
            f"f and g must depend on x and p only, got {', '.join(function.get_free())}: add it to x or p",
            field="f",
        )
    parameters = _values("p0", problem.get("p0"), p.numel(), None)
    program = _program(
        function, parameters, x.numel(), g.numel(),
        {name: problem.get(name) for name in ("lbx", "ubx", "lbg", "ubg", "x0")},
        (Block("x", "", 0, x.numel()),), problem.get("discrete"),
    )  # fmt: skip
    return program.with_source(Source(problem, lambda plan: {"x": np.array(plan)}))


def _values(name: str, value: Any, size: int, default: float | None, infinity: int = 0) -> Vector:
    """Return a vector of values; a number applies to all entries."""
    import casadi

    if value is None and default is None and size:
        raise InvalidData(f"{name} is missing: {size} parameters need values", field=name)
    value = default or 0.0 if value is None else value
    if isinstance(value, casadi.DM):
        value = np.array(value)
    if not isinstance(value, casadi.MX | casadi.SX):  # rejected below
        with contextlib.suppress(ValueError):  # rows of different lengths: rejected below
            value = np.full(size, value) if np.ndim(value) == 0 else np.ravel(value, order="F")
    result: Vector = Array(("entries",), infinity=infinity).coerce(name, value, {})
    if result.size != size:
        raise InvalidData(f"{name} must have {size} entries, got {result.size}", field=name)
    return result


def _program(
    function: Any,
    parameters: Vector,
    columns: int,
    rows: int,
    data: Mapping[str, Any],
    blocks: tuple[Block, ...],
    discrete: Any,
) -> NonlinearProgram:
    """Return the program of a function of the columns and parameters."""
    import casadi

    symbols = casadi.MX.sym("x", columns)
    f, g = function(symbols, casadi.reshape(casadi.DM(parameters), *function.size_in(1)))
    try:
        return NonlinearProgram(
            function=casadi.Function("program", [symbols], [f, g], ["x"], ["f", "g"]),
            row_lower=_values("lbg", data["lbg"], rows, -np.inf, -1),
            row_upper=_values("ubg", data["ubg"], rows, np.inf, 1),
            column_lower=_values("lbx", data["lbx"], columns, -np.inf, -1),
            column_upper=_values("ubx", data["ubx"], columns, np.inf, 1),
            guess=_values("x0", data["x0"], columns, 0.0),
            columns=blocks,
            integral=discrete,
        )
    except InvalidData as error:
        text = str(error)
        for field, name in _NAMES.items():
            text = text.replace(field, name)
        raise InvalidData(text, field=_NAMES.get(str(error.field), error.field)) from None


def program_of_opti(opti: casadi.Opti) -> NonlinearProgram:
    """Return the program of a ``casadi.Opti``, with the current values of its parameters.

    Its initial values are the guess, and no solver needs to be chosen. The column blocks are the variables in the
    order of their declaration. :meth:`.Solution.assign` sets the initial values of `opti` to the plan, so that
    ``opti.value(expression, opti.initial())`` evaluates it. Raise ``InvalidData`` if the object is not an
    ``Opti``, a parameter has no value, or the problem has no variable.
    """
    import casadi

    if not isinstance(opti, casadi.Opti):
        raise InvalidData(
            f"model must be a casadi.Opti or a mapping of expressions, got {type(opti).__name__}",
            field="model",
        )
    x, p = opti.x, opti.p
    if not x.numel():
        raise InvalidData(
            "the Opti must have a variable in its objective or constraints, but it has none",
            field="model",
        )
    present = opti.debug  # evaluates without a solver
    parameters = np.empty(0)
    for symbol in casadi.symvar(p):
        try:
            given = np.array(present.value(symbol, opti.initial())).ravel(order="F")
        except RuntimeError:  # no value
            given = np.array([np.nan])
        if not np.isfinite(given).all():
            raise InvalidData(
                f"parameter {symbol.name()} of shape {symbol.shape} must have a finite value, got "
                f"{show(given.tolist()) if given.size > 1 else given[0]}: use opti.set_value",
                field="p",
            )
        parameters = np.append(parameters, given)
    guess = np.array(present.value(x, opti.initial())).ravel()
    lower, upper = casadi.Function("bounds", [p], [opti.lbg, opti.ubg])(parameters)
    function = casadi.Function(
        "program", [x, p], [casadi.densify(opti.f), casadi.densify(opti.g)], ["x", "p"], ["f", "g"]
    )
    shapes: dict[str, tuple[int, int]] = {}
    blocks: list[Block] = []
    discrete: list[bool] = []
    for number, symbol in enumerate(casadi.symvar(x)):
        size, name = symbol.numel(), f"variable {number}"
        if size:
            shapes[name] = symbol.shape
            blocks.append(Block(name, "", len(discrete), size))
        discrete += [bool(getattr(present.get_meta(symbol), "domain", 0))] * size
    program = _program(
        function, parameters, x.numel(), opti.g.numel(),
        {"lbg": lower, "ubg": upper, "lbx": None, "ubx": None, "x0": guess},
        tuple(blocks), discrete,
    )  # fmt: skip

    def values(plan: Vector) -> dict[str, Any]:
        return {
            block.name: np.array(plan[block.slice]).reshape(shapes[block.name], order="F")
            for block in blocks
        }

    def assign(plan: Vector, duals: Vector | None, objective: float, termination: str) -> None:
        opti.set_initial(x, plan)
        if duals is not None and duals.size == opti.lam_g.numel():
            opti.set_initial(opti.lam_g, -duals)

    return program.with_source(Source(opti, values, assign))
