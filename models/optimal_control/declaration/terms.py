"""What declarations are made of: checked names, numbers, bounds and expressions."""

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
from ..definition import Restriction

__all__ = [
    "between",
    "checked_size",
    "column",
    "compile_function",
    "constraint",
    "entries",
    "free_name",
    "middle",
    "numbers",
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

#: Entries that one state, control or parameter may have.
MOST_ENTRIES = 10_000

#: What programs and verifications call rows and columns of their own.
_OWN = re.compile(
    r"motion|continuity of states|times|(initial|final) values|bounds of (states|controls|parameters)"
    r"|objective|dynamics of .*|definition of integral .*|time goes forward|calm controls"
    r"|(start|end) time|integral \d+|parameter .*"
)

_RELATIONS = (casadi.OP_LE, casadi.OP_LT, casadi.OP_EQ)
_NO_RELATIONS = (casadi.OP_NE, casadi.OP_AND, casadi.OP_OR, casadi.OP_NOT)


# -- names and numbers -------------------------------------------------------------------------------


def entries(count: int) -> str:
    """Return ``"1 entry"`` or ``"2 entries"``."""
    return f"{count} {'entry' if count == 1 else 'entries'}"


def free_name(kind: str, name: Any, taken: Sequence[str]) -> None:
    """Raise where `name` is none, or stands for another one of its `kind` already."""
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
    """Return `value`, a word for people such as a unit, or raise."""
    if not isinstance(value, str) or unwritable(value):
        raise InvalidData(f"{what} of {of} must be a string, got {show(value)}", field=what)
    return value


def checked_size(name: str, size: Any) -> int:
    """Return the number of entries of a quantity."""
    whole = isinstance(size, int | np.integer) and not isinstance(size, bool)
    if not whole or not 1 <= size <= MOST_ENTRIES:
        raise InvalidData(
            f"size of {name!r} must be a whole number from 1 to {MOST_ENTRIES}, got {show(size)}",
            field="size",
        )
    return int(size)


def numbers(name: str, value: Any, allowed: str, must: str = "must be") -> Floats:
    """Return `value` as an array of numbers; strings, truths and NaN are none."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            # Numbers of other libraries, such as CasADi's constants, are objects to NumPy.
            flat = raw.reshape(-1).tolist() if raw.dtype.kind == "O" else [None]
            if any(one is None or isinstance(one, str | bytes | bool) for one in flat):
                raise TypeError
        # A list such as [True, 1.0] is cast without a word.
        if isinstance(value, list | tuple) and any(isinstance(one, bool) for one in value):
            raise TypeError
        if np.ma.is_masked(value):
            raise TypeError
        found = np.asarray(value, float)
    except Exception:  # whatever a stranger's conversion raises
        raise InvalidData(f"{name} {must} {allowed}, got {show(value)}", field=name) from None
    if np.isnan(found).any():
        raise InvalidData(f"{name} {must} {allowed}, got {show(value)}", field=name)
    return found


def vector(name: str, value: Any, size: int, default: float) -> Floats:
    """Return `value` as a vector of `size`: a number counts for every entry, None is `default`."""
    if value is None:
        return np.full(size, default)
    allowed = "a number" if size == 1 else f"a number or {size} of them"
    found = numbers(name, value, allowed)
    if found.ndim > 1 or (found.ndim == 1 and found.size != size):
        raise InvalidData(f"{name} must be {allowed}, got shape {found.shape}", field=name)
    return np.broadcast_to(found, (size,)).copy()


def bound(name: str, value: Any, size: int, sign: int) -> Floats:
    """Return a lower (sign -1) or upper (1) bound; none is infinite."""
    found = vector(name, value, size, sign * np.inf)
    if (found == -sign * np.inf).any():
        raise InvalidData(
            f"{name} must be finite or {sign * math.inf:g}, got {show(value)}", field=name
        )
    return found


def bounds(name: str, lower: Any, upper: Any, size: int) -> tuple[Floats, Floats]:
    """Return both bounds of what is called `name`."""
    low = bound(f"lower bound of {name!r}", lower, size, -1)
    high = bound(f"upper bound of {name!r}", upper, size, 1)
    between(f"bounds of {name!r}", low, high)
    return low, high


def range_of(name: str, value: Any, size: int) -> tuple[Floats, Floats]:
    """Return the bounds that `value` means: None is free, a tuple of two a range, else fixed."""
    if isinstance(value, tuple) and len(value) == 2:
        if size == 2 and all(np.ndim(part) == 0 for part in value):
            raise InvalidData(
                f"{name} = {value!r} may mean two values or a range: write a list for values, "
                "([low, low], [high, high]) for a range",
                field=name,
            )
        low = bound(f"lower end of {name}", value[0], size, -1)
        high = bound(f"upper end of {name}", value[1], size, 1)
        between(name, low, high)
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


def between(name: str, low: Floats, high: Floats) -> None:
    """Raise where a lower bound exceeds an upper one."""
    bad = np.flatnonzero(~(low <= high))
    if bad.size:
        raise InvalidData(
            f"{name}: lower {low[bad[0]]:g} exceeds upper {high[bad[0]]:g}", field=name
        )


def middle(low: Floats, high: Floats) -> Floats:
    """Return the middle of bounds, or 0 moved between them where one is infinite."""
    both = np.isfinite(low) & np.isfinite(high)
    with np.errstate(invalid="ignore"):
        found = np.where(both, 0.5 * (low + high), 0.0)
    return np.clip(found, low, high)


def typical(name: str, given: Any, size: int, *sizes: Floats) -> Floats:
    """Return the typical size of each entry: what is given, or the largest finite bound, or 1."""
    if given is not None:
        found = vector(f"scale of {name}", given, size, 1.0)
        if not (np.isfinite(found) & (found > 0)).all():
            raise InvalidData(
                f"scale of {name} must be finite and > 0, got {show(given)}", field="scale"
            )
        return found
    table = np.abs(np.array(sizes))
    largest: Floats = np.where(np.isfinite(table), table, 0.0).max(axis=0)
    return np.where(largest > 0, largest, 1.0)


# -- expressions -------------------------------------------------------------------------------------


def read_expression(what: str, expression: Any) -> Symbol:
    """Return `expression` as CasADi's MX; lists and arrays of expressions become columns."""
    try:
        if isinstance(expression, str | bytes | bool | np.bool_) or expression is None:
            raise TypeError
        if isinstance(expression, np.ndarray):
            numeric = expression.dtype.kind in "iuf"
            if not numeric and (expression.ndim > 1 or expression.dtype.kind != "O"):
                raise TypeError
            if expression.dtype.itemsize > 8:  # CasADi crashes on longer numbers
                raise TypeError
            found = casadi.MX(casadi.DM(expression)) if numeric else expression.tolist()
        else:
            found = expression
        if isinstance(found, list | tuple):
            found = casadi.vertcat(*(read_expression(what, one) for one in found), casadi.MX(0, 1))
        found = casadi.MX(found)
    except (NotImplementedError, TypeError, RuntimeError):
        raise InvalidData(
            f"{what} must be a CasADi expression of declared symbols (MX) or a number, got "
            f"{show(expression)}",
            field=what,
        ) from None
    if not casadi.symvar(found) and np.isnan(casadi.evalf(found).full()).any():
        raise InvalidData(f"{what} must be a number, got nan", field=what)
    return found


def column(what: str, expression: Any) -> Symbol:
    """Return `expression` as a column of CasADi's MX, one entry at least."""
    found = casadi.vec(casadi.densify(read_expression(what, expression)))
    if not found.numel():
        raise InvalidData(f"{what} must have 1 entry at least, got 0", field=what)
    return found


def read_relation(
    what: str, expression: Any, lower: Any, upper: Any, equals: Any
) -> tuple[Any, ...]:
    """Return (column, lower, upper) of an expression and its bounds, or of a relation."""
    bare = read_expression(what, expression)
    given = not (lower is None and upper is None and equals is None)
    if bare.n_dep() == 2 and bare.op() in _RELATIONS:
        if given:
            raise InvalidData(
                f"{what}: a relation has its bounds in itself; leave out lower, upper and equals",
                field=what,
            )
        return _sides(what, bare)
    if bare.n_dep() and bare.op() in _NO_RELATIONS:
        raise InvalidData(f"{what}: a relation is <=, >= or ==, got {show(expression)}", field=what)
    if equals is not None:
        if lower is not None or upper is not None:
            raise InvalidData(f"{what}: give equals, or lower and upper", field=what)
        return column(what, bare), equals, equals
    if lower is None and upper is None:
        known = casadi.symvar(bare)
        raise InvalidData(
            f"{what} needs a bound: lower, upper or equals, or a relation such as x <= 1"
            + ("" if known else f"; got the constant {show(expression)}"),
            field=what,
        )
    return column(what, bare), lower, upper


def _sides(what: str, relation: Symbol) -> tuple[Any, ...]:
    """Return what a relation bounds: one side, where the other is a number, else the difference."""
    left, right = relation.dep(0), relation.dep(1)
    whole = column(what, left - right)
    equal = relation.op() == casadi.OP_EQ
    for side, number, sign in ((left, right, 1), (right, left, -1)):
        if casadi.symvar(number):
            continue
        value = casadi.evalf(number).full().reshape(-1, order="F")
        value = np.broadcast_to(value, (whole.numel(),)).copy()
        own = casadi.vec(casadi.densify(side))
        if own.numel() == 1:
            own = casadi.repmat(own, whole.numel())
        refused = ~np.isfinite(value) if equal else value == -sign * np.inf
        if np.isnan(value).any() or refused.any():
            raise InvalidData(
                f"{what}: a relation needs finite numbers, got {show(value.tolist())}", field=what
            )
        return own, value if equal or sign < 0 else None, value if equal or sign > 0 else None
    return whole, (0.0 if equal else None), 0.0


def constraint(
    kind: str,
    words: tuple[str, str, str],
    taken: Sequence[str],
    expression: Any,
    sides: tuple[Any, Any, Any],
    scale: Any,
) -> tuple[Restriction, Symbol]:
    """Return a constraint of its `kind` and its column; sides are lower, upper and equals."""
    free_name(f"a {kind} constraint", words[0], taken)
    bounded, low, high = read_relation(f"{kind} constraint {words[0]!r}", expression, *sides)
    return restriction(words, bounded.numel(), low, high, scale), bounded


def restriction(
    words: tuple[str, str, str], size: int, lower: Any, upper: Any, scale: Any
) -> Restriction:
    """Return checked bounds of an expression of `size` entries; words are name, equation and unit."""
    name = words[0]
    low, high = bounds(name, lower, upper, size)
    return Restriction(
        name=name,
        equation=text("equation", words[1], repr(name)),
        unit=text("unit", words[2], repr(name)),
        lower=low,
        upper=high,
        scale=typical(repr(name), scale, size, low, high),
    )


# -- functions ---------------------------------------------------------------------------------------


def stack(columns: Sequence[Symbol]) -> Symbol:
    """Return the columns as one; CasADi's own ``vertcat`` of none is no expression."""
    return casadi.vertcat(*columns, casadi.MX(0, 1))


def compile_function(
    name: str,
    arguments: Mapping[str, Sequence[Symbol]],
    results: Mapping[str, Sequence[Symbol]],
    explain: Callable[[str, Symbol], str],
) -> casadi.Function:
    """Return a function of stacked symbols; made of scalar operations where CasADi can.

    Where a result uses another symbol, the message is what `explain` says of the two.
    """
    known = [symbol for symbols in arguments.values() for symbol in symbols]
    marks = {symbol.__hash__() for symbol in known}
    for what, columns in results.items():
        for symbol in casadi.symvar(stack(columns)):
            if symbol.__hash__() not in marks:
                raise InvalidData(explain(what, symbol), field=what)
    # CasADi does not take stacks as inputs: each symbol becomes a part of a new one.
    parts: list[Symbol] = []
    fresh: dict[str, Symbol] = {}
    for label, symbols in arguments.items():
        fresh[label] = casadi.MX.sym(label, stack(symbols).numel())
        at = 0
        for symbol in symbols:
            parts.append(casadi.reshape(fresh[label][at : at + symbol.numel()], symbol.shape))
            at += symbol.numel()
    new = casadi.substitute([stack(columns) for columns in results.values()], known, parts)
    found = casadi.Function(name, list(fresh.values()), new, list(fresh), list(results))
    with contextlib.suppress(RuntimeError):
        # A function from elsewhere may have no scalar form; it works as it is.
        found = found.expand()
    _refuse_nan(name, found, ", ".join(results))
    return found


def _refuse_nan(name: str, function: casadi.Function, what: str) -> None:
    """Raise where NaN stands among the scalar operations of `function`."""
    if not function.is_a("SXFunction"):
        return
    for k in range(function.n_instructions()):
        constant = function.instruction_id(k) == casadi.OP_CONST
        if constant and math.isnan(function.instruction_constant(k)):
            raise InvalidData(f"{what}: an expression holds nan, which is no number", field=name)
