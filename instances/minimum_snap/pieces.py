"""Exact numbers of a poly7 file, and their rounding to 4-byte floats."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Array, Real, frozen, show
from ...models.minimum_snap.polynomials import factorials
from ...models.minimum_snap.trajectory import Trajectory
from ..tables import numbers, table_rows
from .tables import numeric_rows

__all__ = ["Poly7", "Precision"]

Floats = NDArray[np.float64]

#: Precision of the numbers in a file.
Precision = Literal["float32", "float64"]

_AXES = ("x", "y", "z", "yaw")
_COLUMNS = ("duration", *(f"{axis}^{power}" for axis in _AXES for power in range(8)))


@dataclass(frozen=True, eq=False)
class Poly7:
    """Exact numbers of a poly7 file.

    Parameters
    ----------
    durations : ndarray, shape (pieces,)
        Duration of each piece, s, positive.
    coefficients : ndarray, shape (pieces, 4, 8)
        Coefficients of x, y, z (m) and yaw (rad), in ascending powers of seconds since the start of
        the piece.

    Raises
    ------
    InvalidData
        Shapes differ, there is no piece, numbers are not finite, or durations are not positive.
    """

    durations: Floats
    coefficients: Floats

    def __post_init__(self) -> None:
        sizes: dict[str, tuple[int, str]] = {}
        durations = Array(("pieces",)).coerce("durations", self.durations, sizes)
        coefficients = Array(("pieces", 4, 8)).coerce("coefficients", self.coefficients, sizes)
        if not durations.size:
            raise InvalidData("durations must hold at least 1 entry, got 0", field="durations")
        short = np.flatnonzero(durations <= 0)
        if short.size:
            at = int(short[0])
            raise InvalidData(
                f"durations[{at}] must be > 0, got {durations[at]:g}", field="durations"
            )
        object.__setattr__(self, "durations", durations)
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return int(self.durations.size)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Poly7:
        """Read the exact numbers of a file. Raises the errors of :func:`read_poly7`."""
        return _parsed(as_path(path))

    @classmethod
    def of(cls, trajectory: Trajectory, yaw: float | Trajectory | None = None) -> Poly7:
        """Convert a trajectory of degree <= 7 in 1 to 4 dimensions to pieces.

        Parameters
        ----------
        trajectory : Trajectory
            Trajectory with axes x, y, z, yaw in this order. Missing axes are 0.
        yaw : float or Trajectory, optional
            Constant (rad), or a 1-dimensional trajectory with the same knots. Default: the yaw of the
            trajectory, if any.

        Raises
        ------
        InvalidData
            The degree, the dimensions or `yaw` are not allowed, or a coefficient is not finite.
        """
        if not isinstance(trajectory, Trajectory):
            raise InvalidData(
                f"trajectory must be a Trajectory, got {type(trajectory).__name__}",
                field="trajectory",
            )
        if trajectory.dimensions > 4:
            raise InvalidData(
                f"trajectory must have 1 to 4 dimensions (x, y, z, yaw), got "
                f"{trajectory.dimensions}",
                field="trajectory",
            )
        table = np.zeros((trajectory.segments, 4, 8))
        table[:, : trajectory.dimensions] = _seconds("trajectory", trajectory)
        yaw = trajectory.yaw if yaw is None else yaw
        if yaw is not None and trajectory.dimensions == 4:
            raise InvalidData(
                "yaw must not be given: the trajectory's fourth axis is yaw", field="yaw"
            )
        if isinstance(yaw, Trajectory):
            if yaw.dimensions != 1 or not np.array_equal(yaw.times, trajectory.times):
                raise InvalidData(
                    f"yaw must be 1-dimensional and have the knots of the trajectory, got {yaw!r}",
                    field="yaw",
                )
            table[:, 3] = _seconds("yaw", yaw)[:, 0]
        elif yaw is not None:
            table[:, 3, 0] = Real(unit="rad").coerce("yaw", yaw, {})
        return cls(trajectory.durations, table)

    def trajectory(self, start: float = 0.0) -> Trajectory:
        """Return the 4-dimensional trajectory (x, y, z, yaw) that starts at time `start` (s)."""
        begin = Real(unit="s").coerce("start", start, {})
        times = begin + np.concatenate([[0.0], np.cumsum(self.durations)])
        # Scale with the rounded durations between the knots, so that the powers of seconds, which
        # the firmware evaluates, equal those of the file.
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            scale = np.diff(times)[:, None] ** np.arange(8.0)
            return Trajectory(times, np.moveaxis(self.coefficients * scale[:, None, :], 1, 2))

    def rounded(self) -> Poly7:
        """Return the pieces as the firmware stores them, with all numbers rounded to 4 bytes.

        Raises
        ------
        InvalidData
            A number is outside the range of a 4-byte float, or a duration is rounded to 0.
        """
        with np.errstate(over="ignore", under="ignore"):
            durations = self.durations.astype(np.float32).astype(float)
            table = self.coefficients.astype(np.float32).astype(float)
        beyond = np.argwhere(~np.isfinite(table))
        if beyond.size:
            piece, axis, power = (int(k) for k in beyond[0])
            raise InvalidData(
                f"{_AXES[axis]}^{power} of piece {piece} must be within ±3.4e38, the range of a "
                f"4-byte float, got {self.coefficients[piece, axis, power]:g}: the piece lasts "
                f"{self.durations[piece]:g} s",
                field="trajectory",
            )
        off = np.flatnonzero(~np.isfinite(durations) | (durations <= 0))
        if off.size:
            at = int(off[0])
            raise InvalidData(
                f"the duration of piece {at} must be within 1.5e-45 … 3.4e38 s, the range of a "
                f"4-byte float, got {self.durations[at]:g}",
                field="trajectory",
            )
        return Poly7(durations, table)

    def at_ends(self, derivative: int) -> tuple[Floats, Floats]:
        """Return a derivative (0 … 7) at the start and the end of every piece, shape (pieces, 4)."""
        inner = self.coefficients[:, :, derivative:] * factorials(7, derivative)
        powers = self.durations[:, None] ** np.arange(8.0 - derivative)
        return inner[:, :, 0], np.einsum("kap,kp->ka", inner, powers)

    def jumps(self, derivative: int) -> Floats:
        """Return the jump of a derivative at every inner knot, shape (pieces - 1, 4)."""
        begin, end = self.at_ends(derivative)
        return begin[1:] - end[:-1]

    def text(self, precision: Precision = "float32") -> str:
        """Return the content of the file, with the fewest digits that reproduce each number.

        With ``"float32"`` the digits reproduce the 4-byte float. Use :meth:`rounded` after reading.
        """
        if not isinstance(precision, str) or precision not in get_args(Precision):
            raise InvalidData(
                f"precision must be one of {', '.join(get_args(Precision))}, got {show(precision)}",
                field="precision",
            )
        rows = np.column_stack([self.durations, self.coefficients.reshape(-1, 32)]) + 0.0
        kept = rows.astype(precision)
        lines = (",".join(map(str, row)) for row in kept)
        return "\n".join([",".join(_COLUMNS), *lines]) + "\n"


def _seconds(name: str, trajectory: Trajectory) -> Floats:
    """Return the coefficients in powers of seconds, shape (segments, dimensions, 8)."""
    scaled = trajectory.coefficients
    if scaled[:, 8:].any():
        raise InvalidData(
            f"{name} must be of degree <= 7, got {trajectory.degree}: solve with degree=7",
            field=name,
        )
    kept = np.zeros((trajectory.segments, trajectory.dimensions, 8))
    kept[:, :, : scaled.shape[1]] = np.moveaxis(scaled[:, :8], 1, 2)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        result: Floats = kept / (trajectory.durations[:, None] ** np.arange(8.0))[:, None, :]
    result[kept == 0] = 0.0
    beyond = np.argwhere(~np.isfinite(result))
    if beyond.size:
        piece, axis, power = (int(k) for k in beyond[0])
        raise InvalidData(
            f"{name}: the coefficient of t^{power} on axis {axis} of segment {piece} has no finite "
            f"value: the segment lasts {trajectory.durations[piece]:g} s",
            field=name,
        )
    return frozen(result)


def _parsed(file: Path) -> Poly7:
    rows = numeric_rows(table_rows(file))
    line, header = next(rows, (1, []))
    names = [name.lstrip("# ").replace(" ", "").casefold() for name in header]
    for column, wanted in enumerate(_COLUMNS):
        label = names[column] if column < len(names) else None
        if label != wanted:
            raise InvalidData(
                f"{file}, line {line}, column {column + 1}: the header must hold {wanted!r}, got "
                f"{show(label) if label is not None else 'nothing'}; it is {_COLUMNS[0]},"
                f"{_COLUMNS[1]},…,{_COLUMNS[8]},{_COLUMNS[9]},…,{_COLUMNS[-1]}",
                field="header",
            )
    if len(names) > len(_COLUMNS):
        raise InvalidData(
            f"{file}, line {line}: {len(names)} columns where {len(_COLUMNS)} are allowed, the "
            f"first beyond is {show(header[len(_COLUMNS)])}",
            field="header",
        )
    table: list[list[float]] = []
    for line, values in rows:
        where = f"{file}, line {line}"
        row = numbers(values, _COLUMNS, where, "pieces")
        if row[0] <= 0:
            raise InvalidData(
                f"{where}, column duration: must be > 0 s, got {show(values[0])}", field="durations"
            )
        table.append(row)
    if not table:
        raise InvalidData(f"{file}: no piece below the header", field="pieces")
    array = np.array(table)
    return Poly7(array[:, 0], array[:, 1:].reshape(-1, 4, 8))
