"""Field that contains the function of a black box."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, suggestion
from ..declaration import Nested
from ..fields import Spec, show
from ..problems import resolve
from .functions import BlackBoxFunction, Named, PythonFunction

__all__ = ["FunctionSpec", "NoFunction"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class NoFunction(BlackBoxFunction):
    """No function: its values are passed to :meth:`crosstrack.solvers.black_box.AskTell.tell`."""

    type: ClassVar[str] = "none"

    def check_columns(self, columns: int) -> None:
        """Accept any number of columns."""

    def values(self, points: Floats) -> Floats:
        """Raise :class:`~crosstrack.errors.InvalidData`."""
        raise InvalidData(
            "function is None: such a model serves ask and tell (crosstrack.prepare) only, and cannot be solved "
            "or verified",
            field="function",
        )

    def table(self, points: Floats, columns: int) -> Floats:
        """Raise :class:`~crosstrack.errors.InvalidData`."""
        return self.values(points)


#: Functions that can be written to JSON, by type; imported at first use.
_TYPES: Mapping[str, Any] = {
    "named": Named,
    "waypoints": ".models.black_box.waypoints:WaypointPath",
    "none": NoFunction,
}


@dataclass(frozen=True)
class FunctionSpec(Spec):
    """Field that contains a function, given by name, as JSON data or as a callable."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> BlackBoxFunction:
        if isinstance(value, BlackBoxFunction):
            return value
        if value is None:
            return NoFunction()
        if isinstance(value, str):
            return Named(value)
        if isinstance(value, Mapping):
            data = {**value}
            kind = data.pop("type", "named")
            if not isinstance(kind, str) or kind not in _TYPES:
                hint = suggestion(kind, _TYPES) if isinstance(kind, str) else ""
                raise InvalidData(
                    f"unknown type {show(kind)} of {name}; {hint}allowed: {', '.join(_TYPES)}",
                    field=name,
                )
            result: BlackBoxFunction = resolve(_TYPES[kind]).from_data(data)
            return result
        if callable(value):
            return PythonFunction(value)
        raise InvalidData(
            f"{name} must be the name of a function, its data, or callable, got {show(value)}",
            field=name,
        )

    def encode(self, value: BlackBoxFunction) -> Any:
        if value.type not in _TYPES:
            raise InvalidData(
                "function is Python's, which no file can hold: only functions with a name can be "
                "written",
                field="function",
            )
        return {"type": value.type, **value.data()}

    def feed(self, value: BlackBoxFunction) -> Iterable[bytes]:
        yield f"{value.type}\0".encode()
        yield from Nested(type(value)).feed(value)
