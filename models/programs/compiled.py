"""Fields that hold a ``casadi.Function``: what is stored, sent and digested of declared symbols."""

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
    """Raise :class:`BackendMissing`, saying what to install, where CasADi is not there."""
    try:
        import casadi  # noqa: F401
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"{what} needs CasADi, which is not installed ({error}): pip install casadi"
        ) from error


def canonical_text(encoded: Any) -> str:
    """Return what digests hash for a function in a file: CasADi's own text of it."""
    return encoded if isinstance(encoded, str) else read(encoded).serialize()


def scalar_form(function: casadi.Function) -> casadi.Function:
    """Return `function` in scalar operations, or as it is where it has no such form."""
    try:
        return function.expand()
    except RuntimeError:
        # An interpolant or an external function has no scalar form; it works as it is.
        return function


@dataclass(frozen=True)
class Compiled(Spec):
    """A ``casadi.Function`` with canonical names of its arguments and results.

    JSON holds a graph of named operations (:mod:`.expressions`). What has none, such as a call of a
    library, is stored as CasADi's own text, which is read for a caller who trusts it alone.

    Parameters
    ----------
    arguments, results : tuple of str
        The names that it must have, in this order.
    content : bool
        Whether it is part of the content; what can be derived from another function is not.
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
        for what, have, want in (
            ("arguments", value.name_in(), self.arguments),
            ("results", value.name_out(), self.results),
        ):
            if tuple(have) != want:
                raise InvalidData(
                    f"{name} must have the {what} {', '.join(want)}, got {', '.join(have)}",
                    field=name,
                )
        return value

    def encode(self, value: casadi.Function) -> Any:
        return readable(value)[0]

    def feed(self, value: casadi.Function) -> Iterable[bytes]:
        yield readable(value)[1].serialize().encode()
