"""Fields that contain a ``casadi.Function``: storage, transfer and digest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...errors import BackendMissing, InvalidData
from ..fields import Spec, show
from .interpreter import read, readable
from .trusted import read_trusted

if TYPE_CHECKING:
    import casadi

__all__ = ["Compiled", "canonical_text", "require_casadi", "scalar_form"]


def require_casadi(what: str) -> None:
    """Raise :class:`BackendMissing` with an installation hint if CasADi is not installed."""
    try:
        import casadi  # noqa: F401
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"{what} needs CasADi, which is not installed ({error}): pip install casadi"
        ) from error


def canonical_text(encoded: Any) -> str:
    """Return CasADi's text of a stored function, which digests hash."""
    return encoded if isinstance(encoded, str) else read(encoded).serialize()


def scalar_form(function: casadi.Function) -> casadi.Function:
    """Return `function` expanded to scalar operations, or unchanged if that is not possible."""
    try:
        return function.expand()
    except RuntimeError:
        # Interpolants and external functions have no scalar form.
        return function


@dataclass(frozen=True)
class Compiled(Spec):
    """Field that contains a ``casadi.Function`` with the names `arguments` and `results`, in this order.

    JSON contains a graph of named operations (:mod:`.expressions`). A function without such a graph, such as a
    call of a library, is stored in CasADi's text format and read only for callers who trust its author. `content`
    is False if the function can be derived from another field.
    """

    arguments: tuple[str, ...]
    results: tuple[str, ...]
    content: bool = True

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> casadi.Function:
        require_casadi(f"field {name!r}")
        import casadi

        if isinstance(value, Mapping):
            value = read(value, name)
        elif isinstance(value, str):
            value = read_trusted(value, name)
        if not isinstance(value, casadi.Function):
            raise InvalidData(f"{name} must be a casadi.Function, got {show(value)}", field=name)
        for what, actual, expected in (
            ("arguments", value.name_in(), self.arguments),
            ("results", value.name_out(), self.results),
        ):
            if tuple(actual) != expected:
                raise InvalidData(
                    f"{name} must have the {what} {', '.join(expected)}, got {', '.join(actual)}",
                    field=name,
                )
        return value

    def encode(self, value: casadi.Function) -> Any:
        return readable(value)[0]

    def feed(self, value: casadi.Function) -> Iterable[bytes]:
        yield readable(value)[1].serialize().encode()
