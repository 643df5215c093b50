"""Errors that explain what a symbol is, instead of CasADi's about its own classes."""

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
    """Have conversions of CasADi's symbols to numbers and truth values raise ``InvalidData``.

    The expression is the caller's own code, which runs before anything of ours sees it: only the
    class of the symbols can explain it. Values that CasADi can convert are converted as before.
    """
    for kind in (casadi.MX, casadi.SX):
        for name, text in (("__float__", _NUMBER), ("__int__", _NUMBER), ("__bool__", _TRUTH)):
            convert = getattr(kind, name, None)
            if convert is not None and not hasattr(convert, "explains"):
                setattr(kind, name, _explaining(convert, text))


def _explaining(convert: Callable[[Any], Any], text: str) -> Callable[[Any], Any]:
    def explained(self: Any) -> Any:
        try:
            return convert(self)
        except (RuntimeError, TypeError) as error:
            symbol = str(self)
            symbol = symbol if len(symbol) <= 60 else f"{symbol[:57]}..."
            raise InvalidData(text.format(symbol=symbol), field="expression") from error

    explained.explains = True  # type: ignore[attr-defined]
    return explained
