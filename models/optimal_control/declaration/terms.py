"""Checks and conversions for declarations: names, numbers, bounds and expressions."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import show, unwritable
from ..definition import SIDES, Quantity, Restriction, check_order

__all__ = [
    "checked_size",
    "column",
    "compile_function",
    "constraint",
    "entries",
    "free_name",
    "middle",
    "numbers",
    "quantity",
    "range_of",
    "read_relation",
    "restriction",
    "stack",
    "text",
    "typical",
    "vector",
]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX

#: Largest number of entries of a state, control or parameter.
MOST_ENTRIES = 10_000

#: Names that programs and verifications use for their own rows and columns.
_OWN = re.compile(
    r"motion|continuity of states|times|algebraic variables|(initial|final) values|bounds of (states|controls|parameters)"
    r"|objective|dynamics of .*|definition of (integral|states) .*|time goes forward|(calm|ends of) controls"
    r"|(start|end) time|integral \d+|parameter .*"
)

_RELATIONS = (casadi.OP_LE, casadi.OP_LT, casadi.OP_EQ)
_NO_RELATIONS = (casadi.OP_NE, casadi.OP_AND, casadi.OP_OR, casadi.OP_NOT)


# -- names and numbers -------------------------------------------------------------------------------


def entries(count: int) -> str:
    """Return ``"1 entry"`` or ``"2 entries"``."""
    return f"{count} {'entry' if count == 1 else 'entries'}"


def free_name(kind: str, name: Any, taken: Sequence[str]) -> None:
    """Raise if `name` is not a valid name, or is taken or reserved; `kind` describes it."""
    named = isinstance(name, str) and name and not unwritable(name)
    if not named or any(c in name for c in "[]"):
        raise InvalidData(
            f"{kind} must have a name without brackets, got {show(name)}", field="name"
        )
    if name in taken:
        raise InvalidData(f"{kind} {name!r} is declared already", field="name")
    if _OWN.fullmatch(name):
        raise InvalidData(
            f"{kind} cannot be called {name!r}: the name has a meaning of its own", field="name"
        )


def text(what: str, value: Any, of: str) -> str:
    """Return `value`, a text for display such as a unit, or raise if it is not a string."""
    if not isinstance(value, str) or unwritable(value):
        raise InvalidData(f"{what} of {of} must be a string, got {show(value)}", field=what)
    return value


def checked_size(name: str, size: Any) -> int:
    """Return the number of entries of a quantity, or raise if it is not allowed."""
    whole = isinstance(size, int | np.integer) and not isinstance(size, bool)
    if not whole or not 1 <= size <= MOST_ENTRIES:
        raise InvalidData(
            f"size of {name!r} must be a whole number from 1 to {MOST_ENTRIES}, got {show(size)}",
            field="size",
        )
    return int(size)


def numbers(name: str, value: Any, allowed: str, must: str = "must be") -> Floats:
    """Return `value` as an array of numbers; strings, Booleans and NaN are rejected."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            # Numbers of other libraries, such as CasADi constants, are objects to NumPy.
            flat = raw.reshape(-1).tolist() if raw.dtype.kind == "O" else [None]
            if any(item is None or isinstance(item, str | bytes | bool) for item in flat):
                raise TypeError
        # NumPy would silently convert a list such as [True, 1.0].
        if isinstance(value, list | tuple) and any(isinstance(item, bool) for item in value):
            raise TypeError
        if np.ma.is_masked(value):
            raise TypeError
        result = np.asarray(value, float)
    except Exception:  # custom conversions may raise anything
        raise InvalidData(f"{name} {must} {allowed}, got {show(value)}", field=name) from None
    if np.isnan(result).any():
        raise InvalidData(f"{name} {must} {allowed}, got {show(value)}", field=name)
    return result


def vector(name: str, value: Any, size: int, default: float) -> Floats:
    """Return `value` as a vector of `size`; a number is broadcast, and None gives `default`."""
    if value is None:
        return np.full(size, default)
    allowed = "a number" if size == 1 else f"a number or {size} of them"
    result = numbers(name, value, allowed)
    if result.ndim > 1 or (result.ndim == 1 and result.size != size):
        raise InvalidData(f"{name} must be {allowed}, got shape {result.shape}", field=name)
    return np.broadcast_to(result, (size,)).copy()


def bound(name: str, value: Any, size: int, sign: int) -> Floats:
    """Return a lower (sign -1) or upper (1) bound; None gives an infinite one."""
    result = vector(name, value, size, sign * np.inf)
    if (result == -sign * np.inf).any():
        raise InvalidData(
            f"{name} must be finite or {sign * math.inf:g}, got {show(value)}", field=name
        )
    return result


def bounds(name: str, lower: Any, upper: Any, size: int) -> tuple[Floats, Floats]:
    """Return lower and upper bounds of the quantity called `name`."""
    low = bound(f"lower bound of {name!r}", lower, size, -1)
    high = bound(f"upper bound of {name!r}", upper, size, 1)
    check_order(f"bounds of {name!r}", low, high)
    return low, high


def range_of(name: str, value: Any, size: int) -> tuple[Floats, Floats]:
    """Return `value` as bounds: free for None, a range for a tuple of two, otherwise fixed."""
    if isinstance(value, tuple) and len(value) == 2:
        if size == 2 and all(np.ndim(part) == 0 for part in value):
            raise InvalidData(
                f"{name} = {value!r} may mean two values or a range: write a list for values, "
                "([low, low], [high, high]) for a range",
                field=name,
            )
        low = bound(f"lower end of {name}", value[0], size, -1)
        high = bound(f"upper end of {name}", value[1], size, 1)
        check_order(name, low, high)
        return low, high
    if value is None:
        return np.full(size, -np.inf), np.full(size, np.inf)
    if isinstance(value, tuple) and size == 1:
        raise InvalidData(
            f"{name} must be a number or a range (lower, upper), got {show(value)}", field=name
        )
    fixed = vector(name, value, size, 0.0)
    if not np.isfinite(fixed).all():
        raise InvalidData(f"{name} must be finite, got {show(value)}", field=name)
    return fixed, fixed


def middle(low: Floats, high: Floats) -> Floats:
    """Return the middle of the bounds, or 0 moved between them if one is infinite."""
    both = np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore"):
        result = np.where(both, 0.5 * (low + high), 0.0)
    return np.clip(result, low, high)


def typical(name: str, given: Any, size: int, *sizes: Floats) -> Floats:
    """Return the typical size of each entry: the given one, or the largest finite bound, or 1."""
    if given is not None:
        result = vector(f"scale of {name}", given, size, 1.0)
        if not (np.isfinite(result) & (result > 0)).all():
            raise InvalidData(
                f"scale of {name} must be finite and > 0, got {show(given)}", field="scale"
            )
        return result
    table = np.abs(np.array(sizes))
    largest: Floats = np.where(np.isfinite(table), table, 0.0).max(axis=0)
    return np.where(largest > 0, largest, 1.0)


def quantity(name: str, scale: Any, unit: Any, edges: Sequence[Floats], **marks: bool) -> Quantity:
    """Return a quantity with the bounds `edges` at every instant, at the start and at the end."""
    fields: dict[str, Any] = {**dict(zip(SIDES, edges, strict=True)), **marks}
    sizes = typical(repr(name), scale, edges[0].size, *edges)
    return Quantity(name, scale=sizes, unit=text("unit", unit, repr(name)), **fields)


# -- expressions -------------------------------------------------------------------------------------


def read_expression(what: str, expression: Any) -> Symbol:
    """Return `expression` as a CasADi MX; lists and arrays of expressions become columns."""
    try:
        if isinstance(expression, str | bytes | bool | np.bool_) or expression is None:
            raise TypeError
        if isinstance(expression, np.ndarray):
            numeric = expression.dtype.kind in "iuf"
            if not numeric and (expression.ndim > 1 or expression.dtype.kind != "O"):
                raise TypeError
            if expression.dtype.itemsize > 8:  # CasADi crashes on longer numbers
                raise TypeError
            result = casadi.MX(casadi.DM(expression)) if numeric else expression.tolist()
        else:
            result = expression
        if isinstance(result, list | tuple):
            result = casadi.vertcat(
                *(read_expression(what, item) for item in result), casadi.MX(0, 1)
            )
        result = casadi.MX(result)
    except (NotImplementedError, TypeError, RuntimeError):
        raise InvalidData(
            f"{what} must be a CasADi expression of declared symbols (MX) or a number, got "
            f"{show(expression)}",
            field=what,
        ) from None
    if not casadi.symvar(result) and np.isnan(casadi.evalf(result).full()).any():
        raise InvalidData(f"{what} must be a number, got nan", field=what)
    return result


def column(what: str, expression: Any) -> Symbol:
    """Return `expression` as an MX column with at least one entry."""
    result = casadi.vec(casadi.densify(read_expression(what, expression)))
    if not result.numel():
        raise InvalidData(f"{what} must have 1 entry at least, got 0", field=what)
    return result


def read_relation(
    what: str, expression: Any, lower: Any, upper: Any, equals: Any
) -> tuple[Any, ...]:
    """Return (column, lower, upper) of an expression with bounds, or of a relation."""
    plain = read_expression(what, expression)
    has_bounds = not (lower is None and upper is None and equals is None)
    if plain.n_dep() == 2 and plain.op() in _RELATIONS:
        if has_bounds:
            raise InvalidData(
                f"{what}: a relation has its bounds in itself; leave out lower, upper and equals",
                field=what,
            )
        return _sides(what, plain)
    if plain.n_dep() and plain.op() in _NO_RELATIONS:
        raise InvalidData(f"{what}: a relation is <=, >= or ==, got {show(expression)}", field=what)
    if equals is not None:
        if lower is not None or upper is not None:
            raise InvalidData(f"{what}: give equals, or lower and upper", field=what)
        return column(what, plain), equals, equals
    if lower is None and upper is None:
        known = casadi.symvar(plain)
        raise InvalidData(
            f"{what} needs a bound: lower, upper or equals, or a relation such as x <= 1"
            + ("" if known else f"; got the constant {show(expression)}"),
            field=what,
        )
    return column(what, plain), lower, upper


def _sides(what: str, relation: Symbol) -> tuple[Any, ...]:
    """Return the bounded column of a relation: one side if the other is constant, else the difference."""
    left, right = relation.dep(0), relation.dep(1)
    difference = column(what, left - right)
    equal = relation.op() == casadi.OP_EQ
    for side, number, sign in ((left, right, 1), (right, left, -1)):
        if casadi.symvar(number):
            continue
        value = casadi.evalf(number).full().reshape(-1, order="F")
        value = np.broadcast_to(value, (difference.numel(),)).copy()
        bounded = casadi.vec(casadi.densify(side))
        if bounded.numel() == 1:
            bounded = casadi.repmat(bounded, difference.numel())
        invalid = ~np.isfinite(value) if equal else value == -sign * np.inf
        if np.isnan(value).any() or invalid.any():
            raise InvalidData(
                f"{what}: a relation needs finite numbers, got {show(value.tolist())}", field=what
            )
        return bounded, value if equal or sign < 0 else None, value if equal or sign > 0 else None
    return difference, (0.0 if equal else None), 0.0


def constraint(
    kind: str,
    words: tuple[str, str, str],
    taken: Sequence[str],
    expression: Any,
    sides: tuple[Any, Any, Any],
    scale: Any,
) -> tuple[Restriction, Symbol]:
    """Return a constraint and its column; `sides` are lower, upper and equals."""
    free_name(f"a {kind} constraint", words[0], taken)
    bounded, low, high = read_relation(f"{kind} constraint {words[0]!r}", expression, *sides)
    return restriction(words, bounded.numel(), low, high, scale), bounded


def restriction(
    words: tuple[str, str, str], size: int, lower: Any, upper: Any, scale: Any
) -> Restriction:
    """Return checked bounds of an expression with `size` entries; `words` are name, equation and unit."""
    name = words[0]
    low, high = bounds(name, lower, upper, size)
    return Restriction(
        name=name, equation=text("equation", words[1], repr(name)),
        unit=text("unit", words[2], repr(name)), lower=low, upper=high,
        scale=typical(repr(name), scale, size, low, high),
    )  # fmt: skip


# -- functions ---------------------------------------------------------------------------------------


def stack(columns: Sequence[Symbol]) -> Symbol:
    """Return the columns as one; ``vertcat`` without arguments would not be an expression."""
    return casadi.vertcat(*columns, casadi.MX(0, 1))


def compile_function(
    name: str,
    arguments: Mapping[str, Sequence[Symbol]],
    results: Mapping[str, Sequence[Symbol]],
    explain: Callable[[str, Symbol], str],
) -> casadi.Function:
    """Return a function of stacked symbols, in scalar operations if CasADi supports it.

    If a result uses another symbol, the error message is that of `explain`.
    """
    known = [symbol for symbols in arguments.values() for symbol in symbols]
    marks = {symbol.__hash__() for symbol in known}
    for what, columns in results.items():
        for symbol in casadi.symvar(stack(columns)):
            if symbol.__hash__() not in marks:
                raise InvalidData(explain(what, symbol), field=what)
    # CasADi accepts no stacks as inputs, so each symbol becomes a part of a new one.
    parts: list[Symbol] = []
    inputs: dict[str, Symbol] = {}
    for label, symbols in arguments.items():
        inputs[label] = casadi.MX.sym(label, stack(symbols).numel())
        start = 0
        for symbol in symbols:
            parts.append(
                casadi.reshape(inputs[label][start : start + symbol.numel()], symbol.shape)
            )
            start += symbol.numel()
    new = casadi.substitute([stack(columns) for columns in results.values()], known, parts)
    result = casadi.Function(name, list(inputs.values()), new, list(inputs), list(results))
    with contextlib.suppress(RuntimeError):
        # Functions from other sources may have no scalar form.
        result = result.expand()
    for k in range(result.n_instructions() if result.is_a("SXFunction") else 0):
        constant = result.instruction_id(k) == casadi.OP_CONST
        if constant and math.isnan(result.instruction_constant(k)):
            words = "an expression holds nan, which is no number"
            raise InvalidData(f"{', '.join(results)}: {words}", field=name)
    return result
