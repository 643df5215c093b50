"""Poly7 files: what Crazyflie and Crazyswarm fly.

A line is a piece: its duration, then for x, y, z and yaw the 8 coefficients of a polynomial of
degree 7, in ascending powers of the piece's own time in *seconds*. The header is
``duration,x^0,…,x^7,y^0,…,y^7,z^0,…,z^7,yaw^0,…,yaw^7``. Positions in metres, yaw in radians.

Source: bitcraze/crazyflie-firmware, ``src/modules/interface/pptraj.h`` (``struct poly4d``: 4 times 8
coefficients and the duration, all 4-byte floats), ``src/modules/src/pptraj.c`` (the evaluation) and
``crtp_commander_high_level.c`` (``TRAJECTORY_MEMORY_SIZE`` is 4096: "4k allows us to store 31 poly4d
pieces").
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path, write_text
from ...models.fields import Flag
from ...models.minimum_snap.bounds import derivative_name, derivative_unit
from ...models.minimum_snap.trajectory import Trajectory
from .pieces import Poly7, Precision

__all__ = [
    "MEMORY_BYTES",
    "PIECES_THAT_FIT",
    "PIECE_BYTES",
    "Poly7Report",
    "read_poly7",
    "write_poly7",
]

Floats = NDArray[np.float64]

#: The firmware's memory for trajectories.
MEMORY_BYTES = 4096
#: What a piece takes of it: 4 polynomials of 8 coefficients, and the duration, 4 bytes each.
PIECE_BYTES = 4 * (4 * 8 + 1)
#: Pieces that fit uncompressed.
PIECES_THAT_FIT = MEMORY_BYTES // PIECE_BYTES

#: Derivatives whose jumps are reported: position to jerk.
_ORDERS = range(4)


@dataclass(frozen=True)
class Poly7Report:
    """What 4-byte floats do to a trajectory, and whether it fits into the firmware's memory.

    All of it is about the numbers that the firmware stores, whatever digits the file has.

    Parameters
    ----------
    path : str
        The file written.
    pieces : int
        Number of pieces.
    jumps : tuple of tuple of float
        Largest jump at a knot, ``jumps[derivative][axis]``: position, velocity, acceleration, jerk
        of x, y, z (m/s^j) and yaw (rad/s^j).
    rounding_jumps : tuple of tuple of float
        The part of it that the rounding of coefficients and durations causes.
    end_drift : tuple of float
        By how much the last position moves: x, y, z (m), yaw (rad).
    time_drift : float
        By how much the end comes later, s.
    """

    path: str
    pieces: int
    jumps: tuple[tuple[float, ...], ...]
    rounding_jumps: tuple[tuple[float, ...], ...]
    end_drift: tuple[float, ...]
    time_drift: float

    @property
    def bytes_needed(self) -> int:
        """Bytes that the pieces take uncompressed."""
        return self.pieces * PIECE_BYTES

    @property
    def fits(self) -> bool:
        """Whether the pieces fit uncompressed into the firmware's memory for trajectories."""
        return self.pieces <= PIECES_THAT_FIT

    def __str__(self) -> str:
        memory = f"{self.pieces} pieces, {self.bytes_needed} of {MEMORY_BYTES} bytes"
        lines = [
            f"{self.path}: {memory}"
            + ("" if self.fits else f": TOO MANY, the firmware holds {PIECES_THAT_FIT}")
        ]
        for order in _ORDERS:
            word, unit = derivative_name(order), derivative_unit(order)
            whole, caused = max(self.jumps[order][:3]), max(self.rounding_jumps[order][:3])
            lines.append(f"  largest jump of {word}: {whole:.2e} {unit} ({caused:.1e} by rounding)")
        drift = max(map(abs, self.end_drift[:3]))
        lines.append(f"  end: {drift:.1e} m off, {self.time_drift:+.1e} s late")
        turned = [row[3] for row in self.rounding_jumps]
        if any(turned) or self.end_drift[3]:
            lines.append(
                f"  yaw: jumps of {turned[0]:.1e} rad and {turned[1]:.1e} rad/s by rounding, end "
                f"{abs(self.end_drift[3]):.1e} rad off"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        return {
            "path": self.path,
            "pieces": self.pieces,
            "limit": PIECES_THAT_FIT,
            "fits": self.fits,
            "jumps": [list(row) for row in self.jumps],
            "rounding_jumps": [list(row) for row in self.rounding_jumps],
            "end_drift": list(self.end_drift),
            "time_drift": self.time_drift,
        }


def read_poly7(path: str | os.PathLike[str], *, start: float = 0.0) -> Trajectory:
    """Return the trajectory in a poly7 file: x, y, z (m) and yaw (rad).

    Parameters
    ----------
    path : path-like
        The file. Blanks in the header, capitals, a ``#`` before it and a comma at the end of lines
        are borne with.
    start : float
        Time of the first knot, s; the file knows durations only.

    Raises
    ------
    InvalidData
        Naming file, line, column, value and what is allowed: a header of other names, a row too
        short or too long, what is no finite number, a duration that is not > 0, no piece at all.

    See Also
    --------
    Poly7 : the same, number for number.
    """
    path = as_path(path)
    try:
        return Poly7.read(path).trajectory(start)
    except InvalidData as error:
        if str(error).startswith(str(path)):
            raise
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def write_poly7(
    trajectory: Trajectory,
    path: str | os.PathLike[str],
    *,
    yaw: float | Trajectory | None = None,
    precision: Precision = "float32",
    strict: bool = False,
) -> Poly7Report:
    """Write a trajectory as a poly7 file, in one step, and say what rounding does to it.

    Parameters
    ----------
    trajectory : Trajectory
        Of degree <= 7, in 1 to 4 dimensions: x, y, z (m), yaw (rad). Axes it lacks are 0. The file
        begins at time 0 whatever the first knot is.
    path : path-like
        The file.
    yaw : float or Trajectory, optional
        A constant (rad), or a 1-dimensional trajectory with the same knots.
    precision : {"float32", "float64"}
        Digits in the file: those of the firmware's 4-byte floats, or all that there are.
    strict : bool
        Refuse more pieces than fit into the firmware's memory (31), instead of reporting it.

    Returns
    -------
    Poly7Report
        Jumps at the knots and drift of the end in the firmware's 4-byte floats.

    Raises
    ------
    InvalidData
        A degree above 7, more than 4 dimensions, numbers beyond the range of 4-byte floats, too
        many pieces when `strict`, or a file that cannot be written. Nothing is written then.
    """
    path, strict = as_path(path), Flag().coerce("strict", strict, {})
    exact = Poly7.of(trajectory, yaw)
    if strict and exact.pieces > PIECES_THAT_FIT:
        raise InvalidData(
            f"trajectory must have at most {PIECES_THAT_FIT} pieces, which is what fits into the "
            f"firmware's {MEMORY_BYTES} bytes uncompressed, got {exact.pieces}",
            field="trajectory",
        )
    stored = exact.rounded()
    text = exact.text(precision)
    report = _report(exact, stored, str(path))
    write_text(path, text)
    return report


def _report(exact: Poly7, stored: Poly7, path: str) -> Poly7Report:
    def largest(jumps: Floats) -> tuple[float, ...]:
        return tuple(np.abs(jumps).max(axis=0, initial=0.0).tolist())

    after = [stored.jumps(order) for order in _ORDERS]
    caused = [after[order] - exact.jumps(order) for order in _ORDERS]
    drift = stored.at_ends(0)[1][-1] - exact.at_ends(0)[1][-1]
    return Poly7Report(
        path=path,
        pieces=exact.pieces,
        jumps=tuple(map(largest, after)),
        rounding_jumps=tuple(map(largest, caused)),
        end_drift=tuple(drift.tolist()),
        # Summed as differences: the sum of the durations would swallow them.
        time_drift=float((stored.durations - exact.durations).sum()),
    )
