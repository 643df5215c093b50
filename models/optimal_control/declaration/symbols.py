"""Error messages for symbols that are converted to numbers or truth values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi

from ....errors import InvalidData

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


def explain_symbols() -> None:
    """Make conversions of CasADi symbols to numbers and truth values raise ``InvalidData``.

    The conversion happens in the user's own expression, before this package receives it, so only
    the class of the symbols can explain the error. Convertible values are converted as before.
    """
    for kind in (casadi.MX, casadi.SX):
        for name, text in (("__float__", _NUMBER), ("__int__", _NUMBER), ("__bool__", _TRUTH)):
            convert = getattr(kind, name, None)
            if convert is not None and not hasattr(convert, "explains"):
                setattr(kind, name, _explaining(convert, text))


def _explaining(convert: Callable[[Any], Any], text: str) -> Callable[[Any], Any]:
    def wrapper(self: Any) -> Any:
        try:
            return convert(self)
        except (RuntimeError, TypeError) as error:
            symbol = str(self)
            symbol = symbol if len(symbol) <= 60 else f"{symbol[:57]}..."
            raise InvalidData(text.format(symbol=symbol), field="expression") from error

    wrapper.explains = True  # type: ignore[attr-defined]
    return wrapper
