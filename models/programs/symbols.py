"""NumPy functions of symbols, and error messages for operations that need numbers or truth values."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import casadi

from ...errors import InvalidData

__all__ = ["explain_symbols"]

_NUMBER = (
    "{symbol} is a symbol without a value, and Python's math functions, float() and int() need a "
    "number: use NumPy's or CasADi's functions, such as numpy.sin(x) or casadi.sin(x)"
)
_TRUTH = (
    "{symbol} is a symbol without a value, so it cannot decide an if, and, or, in, min, max or a "
    "chained comparison: use casadi.if_else(condition, a, b), casadi.fmin, casadi.fmax, "
    "casadi.logic_and, or a table (crosstrack.table)"
)
_ITERATION = (
    "{symbol} is a symbol, and Python's iteration, sum() and unpacking need a list: use "
    "casadi.vertsplit(x) for the entries, casadi.sum1(x) for their sum, or x[0], x[1]"
)
_PRODUCT = (
    "{symbol} of shape {shape} has no matrix product with this operand: vectors are columns, so "
    "write A @ x, x.T @ A, or casadi.dot(a, b) for the product of two vectors"
)
_FUNCTION = (
    "numpy.{function} is not available for symbols with these arguments ({reason}): use CasADi's "
    "functions, such as casadi.dot(a, b), casadi.mtimes(A, x), casadi.sum1(x), casadi.if_else "
    "or a table (crosstrack.table)"
)


def explain_symbols() -> None:
    """Accept symbols in NumPy functions, and explain operations that are impossible for symbols.

    Conversions to numbers and truth values raise ``InvalidData``. They happen in the user's own
    expression, before this package receives it, so only the class of the symbols can explain
    the error. Convertible values are converted as before.
    """
    # CasADi 3.8 warns about a future change of its rule for NumPy functions of symbols.
    with contextlib.suppress(AttributeError):  # before CasADi 3.8
        if casadi.GlobalOptions.getNumpyMode() == 0:
            casadi.GlobalOptions.setNumpyMode(-1)
    for kind in (casadi.MX, casadi.SX):
        for name, explain in _EXPLANATIONS.items():
            method = getattr(kind, name, None)
            if name == "__int__":  # CasADi's classes lack it
                method = method or (lambda value: int(float(value)))
            if method is not None and not hasattr(method, "explains"):
                setattr(kind, name, _explaining(method, explain))


def _explaining(method: Callable[..., Any], explain: Callable[..., str]) -> Callable[..., Any]:
    def wrapper(self: Any, *args: Any, **options: Any) -> Any:
        reason: Any = "no equivalent"
        try:
            result = method(self, *args, **options)
            if result is not NotImplemented or explain is not _of_function:
                return result
        except (RuntimeError, TypeError) as error:  # CasADi raises both for unsupported functions
            reason = error
        cause = reason if isinstance(reason, Exception) else None
        raise InvalidData(explain(self, reason, *args), field="expression") from cause

    wrapper.explains = True  # type: ignore[attr-defined]
    return wrapper


def _shortened(text: Any, most: int = 60) -> str:
    """Return the last line of a text, shortened."""
    line = (str(text).strip().splitlines() or [""])[-1]
    return line if len(line) <= most else f"{line[: most - 3]}..."


def _of_function(_: Any, reason: Any, function: Any, *__: Any) -> str:
    return _FUNCTION.format(function=function.__name__, reason=_shortened(reason, 100))


def _about(text: str) -> Callable[..., str]:
    return lambda symbol, *_: text.format(symbol=_shortened(symbol), shape=symbol.shape)


_EXPLANATIONS: dict[str, Callable[..., str]] = {
    "__float__": _about(_NUMBER),
    "__int__": _about(_NUMBER),
    "__bool__": _about(_TRUTH),
    "__iter__": _about(_ITERATION),
    "__matmul__": _about(_PRODUCT),
    "__rmatmul__": _about(_PRODUCT),
    "__array_ufunc__": _of_function,
    "__array_function__": _of_function,
}
