"""Functions that a black box can hold: test functions by name, and whatever Python can call."""

from __future__ import annotations

import contextlib
import uuid
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, suggestion
from ..declaration import Declared, Nested
from ..fields import Array, Flag, Optional, Real, Spec, declared, show
from ..problems import resolve
from ..records import Anything, Member

__all__ = ["BlackBoxFunction", "FunctionSpec", "Landscape", "Named", "PythonFunction"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class BlackBoxFunction(Declared):
    """What a black box computes; a subclass says how."""

    #: What JSON calls it, as ``{"type": …}``.
    type: ClassVar[str] = ""

    @abstractmethod
    def values(self, points: Floats) -> Floats:
        """Return the values at `points`, shape (m, d), as an array of shape (m,); NaN where there is none."""

    @property
    def noise(self) -> float:
        """Standard deviation of what is added to every value that a backend sees."""
        return 0.0

    def check_dimension(self, dimension: int) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` where it has no values for so many variables."""


class Landscape(StrEnum):
    """Test functions; those of the paper's section 4 first."""

    RASTRIGIN = "rastrigin"  #: Σ x² - 10 cos 2πx + 10: many local minima, 0 at the origin
    EASOM = "easom"  #: two variables, flat but for a narrow well of -1 at (π, π)
    BOOTH = "booth"  #: two variables, a valley, 0 at (1, 3)
    BOHACHEVSKY = "bohachevsky"  #: two variables, a bowl with ripples, 0 at the origin
    SUM_SQUARES = "sum-squares"  #: Σ i x_i²: 0 at the origin
    SPHERE = "sphere"  #: Σ x²: 0 at the origin
    ROSENBROCK = "rosenbrock"  #: a curved valley, 0 at (1, …, 1)
    ACKLEY = "ackley"  #: nearly flat outside, many ripples, 0 at the origin
    STEP = "step"  #: Σ floor(x + 1/2)²: terraces, 0 around the origin
    CONSTANT = "constant"  #: 0 everywhere


def _easom(x: Floats) -> Floats:
    bump = np.exp(-((x[:, 0] - np.pi) ** 2) - (x[:, 1] - np.pi) ** 2)
    found: Floats = -np.cos(x[:, 0]) * np.cos(x[:, 1]) * bump
    return found


def _bohachevsky(x: Floats) -> Floats:
    waves = 0.3 * np.cos(3 * np.pi * x[:, 0]) + 0.4 * np.cos(4 * np.pi * x[:, 1])
    found: Floats = x[:, 0] ** 2 + 2 * x[:, 1] ** 2 - waves + 0.7
    return found


def _ackley(x: Floats) -> Floats:
    far = -20 * np.exp(-0.2 * np.sqrt((x**2).mean(axis=1)))
    found: Floats = far - np.exp(np.cos(2 * np.pi * x).mean(axis=1)) + 20 + np.e
    return found


_FORMULAS: dict[Landscape, Callable[[Floats], Floats]] = {
    Landscape.RASTRIGIN: lambda x: (x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum(axis=1),
    Landscape.EASOM: _easom,
    Landscape.BOOTH: lambda x: (x[:, 0] + 2 * x[:, 1] - 7) ** 2 + (2 * x[:, 0] + x[:, 1] - 5) ** 2,
    Landscape.BOHACHEVSKY: _bohachevsky,
    Landscape.SUM_SQUARES: lambda x: x**2 @ np.arange(1.0, x.shape[1] + 1),
    Landscape.SPHERE: lambda x: (x**2).sum(axis=1),
    Landscape.ROSENBROCK: lambda x: (
        100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2
    ).sum(axis=1),
    Landscape.ACKLEY: _ackley,
    Landscape.STEP: lambda x: (np.floor(x + 0.5) ** 2).sum(axis=1),
    Landscape.CONSTANT: lambda x: np.zeros(len(x)),
}
_TWO = (Landscape.EASOM, Landscape.BOOTH, Landscape.BOHACHEVSKY)


@dataclass(frozen=True, eq=False, repr=False)
class Named(BlackBoxFunction):
    """A test function, perhaps moved, stretched and noisy: f((x - shift) / stretch) + noise.

    Parameters
    ----------
    name : Landscape or str
        Which one, see :class:`Landscape`.
    shift : ndarray, shape (d,), optional
        How far its optimum is moved.
    stretch : float
        By what its variables are multiplied, > 0.
    deviation : float
        Standard deviation of normal noise that is added to every value that a backend sees; the
        verification knows the value without it.
    """

    name: Landscape = declared(Member(Landscape))
    shift: Floats | None = declared(Optional(Array(("d",))), default=None)
    stretch: float = declared(Real(lower=0, strict=True), default=1.0)
    deviation: float = declared(Real(lower=0), default=0.0)

    type: ClassVar[str] = "named"

    @property
    def noise(self) -> float:
        """Standard deviation of what is added to every value that a backend sees."""
        return self.deviation

    def check_dimension(self, dimension: int) -> None:
        """Refuse other dimensions than those of the formula and of the shift."""
        if self.name in _TWO and dimension != 2:
            raise InvalidData(
                f"function {str(self.name)!r} has 2 variables, got bounds of {dimension}",
                field="function",
            )
        if self.name is Landscape.ROSENBROCK and dimension < 2:
            raise InvalidData(
                f"function 'rosenbrock' has at least 2 variables, got bounds of {dimension}",
                field="function",
            )
        if self.shift is not None and len(self.shift) != dimension:
            raise InvalidData(
                f"shift must have {dimension} entries as the bounds, got {len(self.shift)}",
                field="function",
            )

    @np.errstate(all="ignore")  # what overflows is no number
    def values(self, points: Floats) -> Floats:
        """Return the values without noise."""
        moved = points if self.shift is None else points - self.shift
        found: Floats = _FORMULAS[self.name](moved / self.stretch)
        return found


@dataclass(frozen=True)
class _Call(Anything):
    """What is called: no part of a digest, as all that it shows of itself is an address."""

    def feed(self, value: Any) -> Iterable[bytes]:
        return ()


@dataclass(frozen=True)
class _Token(Spec):
    """What tells one Python function from all others, as nothing of it can be compared."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str:
        return str(value)


@dataclass(frozen=True, eq=False, repr=False)
class PythonFunction(BlackBoxFunction):
    """Whatever Python can call. It runs in the process that holds the model; no file can hold it.

    A run calls it from a thread of its own, several runs at a time from several threads at once, and
    nothing stops it in the middle of a call: a run that must end is given up instead, with what is known.

    Parameters
    ----------
    call : callable
        Takes an array of shape (d,) and returns a number; NaN where there is none. With `vectorized`,
        it takes (m, d) and returns (m,).
    vectorized : bool
        Whether it takes many points at once.
    """

    call: Callable[..., Any] = declared(_Call())
    vectorized: bool = declared(Flag(), default=False)
    token: str = declared(_Token(), default_factory=lambda: uuid.uuid4().hex)

    type: ClassVar[str] = "python"

    def check(self) -> None:
        """Refuse what cannot be called."""
        if not callable(self.call):
            raise InvalidData(f"function must be callable, got {show(self.call)}", field="function")

    def values(self, points: Floats) -> Floats:
        """Call the function; what it raises becomes ``InvalidData`` with the point."""
        if self.vectorized:
            found: Floats = self._numbers(points, self._called(points), points.shape[:1])
            return found
        rows = (self._numbers(x, self._called(x), ()) for x in points)
        return np.fromiter(rows, np.float64, len(points))

    def _called(self, at: Floats) -> Any:
        try:
            return self.call(at.copy())  # a function that changes its argument changes nothing else
        except Exception as error:
            raise InvalidData(
                f"function raised {type(error).__name__}: {error}, at {show(at.tolist())}",
                field="function",
            ) from error

    def _numbers(self, at: Floats, found: Any, shape: tuple[int, ...]) -> Any:
        values: Floats | None = None
        with contextlib.suppress(TypeError, ValueError):
            raw = np.asarray(found)
            # NumPy would take "1.5" for a number, and None for NaN.
            plain = raw.dtype.kind in "biuf"
            if plain or (raw.dtype.kind == "O" and all(value is not None for value in raw.flat)):
                values = raw.astype(np.float64)
        if values is None or values.size != int(np.prod(shape)):
            what = "a number" if not shape else f"{shape[0]} numbers"
            raise InvalidData(
                f"function must return {what}, got {show(found)} at {show(at.tolist())}",
                field="function",
            )
        return values.reshape(shape)


#: The functions that JSON can hold, by type; loaded when one is asked for.
_TYPES: Mapping[str, Any] = {
    "named": Named,
    "waypoints": ".models.black_box.waypoints:WaypointPath",
}


@dataclass(frozen=True)
class FunctionSpec(Spec):
    """A function, its JSON data, or anything that can be called."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> BlackBoxFunction:
        if isinstance(value, BlackBoxFunction):
            return value
        if isinstance(value, str):
            return Named(value)  # type: ignore[arg-type]  # coerced
        if isinstance(value, Mapping):
            data = {**value}
            kind = data.pop("type", "named")
            if not isinstance(kind, str) or kind not in _TYPES:
                hint = suggestion(kind, _TYPES) if isinstance(kind, str) else ""
                raise InvalidData(
                    f"unknown type {show(kind)} of {name}; {hint}allowed: {', '.join(_TYPES)}",
                    field=name,
                )
            found: BlackBoxFunction = resolve(_TYPES[kind]).from_data(data)
            return found
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
