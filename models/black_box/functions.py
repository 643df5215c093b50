"""Functions of black boxes: named test functions, and Python callables."""

from __future__ import annotations

import contextlib
import math
import os
import uuid
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Flag, Optional, Real, Spec, Text, Whole, declared, show
from ..inputs import Field, FloatsOrNone
from ..records import Anything, Member
from .evaluation import Evaluation
from .record import Record

__all__ = ["BlackBoxFunction", "Landscape", "Named", "OnError", "PythonFunction"]

Floats = NDArray[np.float64]

#: Largest number of worker processes.
MOST_WORKERS = 1024


@dataclass(frozen=True, eq=False, repr=False)
class BlackBoxFunction(Declared):
    """Base of the functions of black boxes."""

    #: Name in JSON, as ``{"type": …}``.
    type: ClassVar[str] = ""

    @abstractmethod
    def values(self, points: Floats) -> Floats:
        """Return the values at `points`, shape (m, d), as an array of shape (m,); NaN for no value."""

    def table(self, points: Floats, columns: int) -> Floats:
        """Return objectives, inequalities and equalities at `points`, shape (m, columns)."""
        return np.asarray(self.values(points), np.float64).reshape(len(points), columns)

    @property
    def noise(self) -> float:
        """Standard deviation of the noise on every value that a backend receives."""
        return 0.0

    def check_columns(self, columns: int) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` if the function does not return `columns` numbers."""
        if columns != 1:
            raise InvalidData(
                f"a function of type {self.type!r} returns one number, an objective; inequalities, "
                "equalities and further objectives need a Python function",
                field="function",
            )

    def check_dimension(self, dimension: int) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` if the function has another number of variables."""


class Landscape(StrEnum):
    """Test functions, beginning with those of the paper's section 4."""

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
    result: Floats = -np.cos(x[:, 0]) * np.cos(x[:, 1]) * bump
    return result


def _bohachevsky(x: Floats) -> Floats:
    waves = 0.3 * np.cos(3 * np.pi * x[:, 0]) + 0.4 * np.cos(4 * np.pi * x[:, 1])
    result: Floats = x[:, 0] ** 2 + 2 * x[:, 1] ** 2 - waves + 0.7
    return result


def _ackley(x: Floats) -> Floats:
    far = -20 * np.exp(-0.2 * np.sqrt((x**2).mean(axis=1)))
    result: Floats = far - np.exp(np.cos(2 * np.pi * x).mean(axis=1)) + 20 + np.e
    return result


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
    """Test function, optionally shifted, stretched and noisy: f((x - shift) / stretch) + noise.

    Parameters
    ----------
    name : Landscape or str
        Test function, see :class:`Landscape`.
    shift : ndarray, shape (d,), optional
        Shift of the optimum.
    stretch : float
        Factor of the variables, > 0.
    deviation : float
        Standard deviation of normal noise on every value that a backend receives. The verification
        uses values without noise.
    """

    name: Field[str, Landscape] = declared(Member(Landscape))
    shift: FloatsOrNone = declared(Optional(Array(("d",))), default=None)
    stretch: float = declared(Real(lower=0, strict=True), default=1.0)
    deviation: float = declared(Real(lower=0), default=0.0)

    type: ClassVar[str] = "named"

    @property
    def noise(self) -> float:
        """Standard deviation of the noise on every value that a backend receives."""
        return self.deviation

    def check_dimension(self, dimension: int) -> None:
        """Raise if the formula or the shift has another number of variables."""
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

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is no value
    def values(self, points: Floats) -> Floats:
        """Return the values without noise."""
        shifted = points if self.shift is None else points - self.shift
        result: Floats = _FORMULAS[self.name](shifted / self.stretch)
        return result


@dataclass(frozen=True)
class _Call(Anything):
    """Callable, excluded from the digest because only its address is comparable."""

    def feed(self, value: Any) -> Iterable[bytes]:
        return ()


@dataclass(frozen=True)
class _Token(Spec):
    """Unique identifier of a Python function, because its behaviour cannot be compared."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str:
        return str(value)


class OnError(StrEnum):
    """What happens if a Python function raises an exception at a point."""

    RAISE = "raise"  #: the run ends, and the message names the point
    SKIP = "skip"  #: the point has no value, and the answer contains the number and the first exception


@dataclass(frozen=True)
class _Workers(Spec):
    """Number of processes, or an object with the method ``submit`` of an executor."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        if callable(getattr(value, "submit", None)) and not isinstance(value, type):
            return value
        with contextlib.suppress(InvalidData):
            return Whole(1, MOST_WORKERS).coerce(name, value, sizes)
        raise InvalidData(
            f"{name} must be a number of processes from 1 to {MOST_WORKERS}, or an executor with the method "
            f"submit, got {show(value)}",
            field=name,
        )


@dataclass(frozen=True)
class _Path(Spec):
    """Path of a file."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str:
        path = Text().coerce(
            name, os.fspath(value) if isinstance(value, os.PathLike) else value, sizes
        )
        if "\0" in path:
            raise InvalidData(f"{name} must be a path, got {show(path)}", field=name)
        return path


@dataclass(frozen=True, eq=False, repr=False)
class PythonFunction(BlackBoxFunction):
    """Python callable, which cannot be written to a file.

    By default it is called in the process that holds the model, one call at a time in each run, from a thread
    of the run; parallel runs call it from several threads at once. With `workers` it is called in other
    processes or threads, several calls at a time. A call is never interrupted. A run that must end does not
    wait longer than two seconds for a call once it has a point.

    Parameters
    ----------
    call : callable
        Function from an array of shape (d,) to a number; NaN for no value. If `vectorized`, from
        (m, d) to (m,). With constraints or several objectives it returns `columns` numbers per point,
        shape (columns,) or (m, columns): objectives, inequalities, equalities.
    vectorized : bool
        Whether the function accepts many points at once. A request, such as a generation, is then one call,
        or one call per worker.
    workers : int or Executor
        Number of worker processes, which are new interpreters and end with this object: the function must be
        serialisable by ``cloudpickle``. Or an object with the method ``submit`` of
        ``concurrent.futures.Executor``, such as ``dask.distributed.Client.get_executor()``; it is not part of a
        serialised function.
    on_error : {"raise", "skip"}
        Whether an exception, or the end of a worker process, ends the run or means that the point has no
        value; see :class:`OnError`.
    record : str or path, optional
        File of JSON lines to which each evaluation is appended. The values in an existing file answer equal
        requests, so that a run that was killed continues. It is only used by runs, not by the verification.

    Raises
    ------
    InvalidData
        A value is not allowed, with the name of the field.

    Examples
    --------
    >>> from crosstrack.models.black_box import PythonFunction
    >>> function = PythonFunction(lambda x: 1.0 / x[0], on_error="skip")
    >>> function.workers, str(function.on_error)
    (1, 'skip')
    """

    call: Callable[..., Any] = declared(_Call())
    vectorized: bool = declared(Flag(), default=False)
    workers: Any = declared(_Workers(), default=1)
    on_error: Field[str, OnError] = declared(Member(OnError), default=OnError.RAISE)
    record: Field[str | os.PathLike[str] | None, str | None] = declared(
        Optional(_Path()), default=None
    )
    token: str = declared(_Token(), default_factory=lambda: uuid.uuid4().hex)

    type: ClassVar[str] = "python"

    def check(self) -> None:
        """Raise if the function is not callable."""
        if not callable(self.call):
            raise InvalidData(f"function must be callable, got {show(self.call)}", field="function")

    def _feed(self) -> Iterator[bytes]:
        yield self.token.encode()  # how the function is called is not part of the digest

    def __getstate__(self) -> dict[str, Any]:
        state = super().__getstate__()
        return state if isinstance(self.workers, int) else {**state, "workers": 1}

    def __copy__(self) -> PythonFunction:
        return self  # a copy would lose an executor

    def __deepcopy__(self, memo: Any) -> PythonFunction:
        return self

    def check_columns(self, columns: int) -> None:
        """Accept any number of columns: each value is checked when the function returns it."""

    def values(self, points: Floats) -> Floats:
        """Return the function's values; an exception becomes ``InvalidData`` with the point."""
        return self.table(points, 1)[:, 0]

    def table(self, points: Floats, columns: int) -> Floats:
        """Return the function's values, shape (m, columns); an exception becomes ``InvalidData``."""
        return self.evaluation(columns).all(points)

    def evaluation(
        self, columns: int, dimension: int = 0, header: Mapping[str, Any] | None = None
    ) -> Evaluation:
        """Return new evaluations, with the record for a run.

        Parameters
        ----------
        columns, dimension : int
            Numbers of values per point and of variables.
        header : mapping, optional
            Data of the model that the record must have, for a run.
        """
        record = None
        if self.record is not None and header is not None:
            name = getattr(self.call, "__qualname__", type(self.call).__qualname__)
            record = Record(self.record, {"function": name, **header}, dimension, columns)
        return Evaluation(self, columns, record)

    def failure(self, at: Floats, text: str) -> InvalidData:
        """Return the error for an exception of the function at a point or at the points of a call."""
        return InvalidData(f"function {text}, at {show(at.tolist())}", field="function")

    def numbers(self, at: Floats, result: Any, columns: int) -> Floats:
        """Return a result of the function as an array of shape (m, columns), or raise."""
        if type(result) is float and columns == 1 and at.ndim == 1:
            return np.array([[result]])
        shape = (*at.shape[:-1], *(() if columns == 1 else (columns,)))
        values: Floats | None = None
        with contextlib.suppress(TypeError, ValueError):
            raw = np.asarray(result)
            # NumPy would convert "1.5" to a number, and None to NaN.
            plain = raw.dtype.kind in "biuf"
            if plain or (raw.dtype.kind == "O" and all(value is not None for value in raw.flat)):
                values = raw.astype(np.float64)
        # A vectorised function of several columns must not return their transpose.
        size = math.prod(shape)
        if values is None or values.size != size or (len(shape) > 1 and values.shape != shape):
            what = "a number" if not shape else f"{shape[0]} numbers"
            if len(shape) > 1:
                what = f"an array of shape {shape}"
            raise InvalidData(
                f"function must return {what}, got {show(result)} at {show(at.tolist())}",
                field="function",
            )
        return values.reshape(-1, columns)
