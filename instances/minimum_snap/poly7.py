"""Poly7 files, the trajectory format of Crazyflie and Crazyswarm.

Each line is a piece: its duration, then for x, y, z and yaw the 8 coefficients of a polynomial of
degree 7, in ascending powers of the *seconds* since the start of the piece. The header is
``duration,x^0,…,x^7,y^0,…,y^7,z^0,…,z^7,yaw^0,…,yaw^7``. Positions in metres, yaw in radians.

Source: bitcraze/crazyflie-firmware, ``src/modules/interface/pptraj.h`` (``struct poly4d``: 4 times 8
coefficients and the duration, all 4-byte floats), ``src/modules/src/pptraj.c`` (the evaluation) and
``crtp_commander_high_level.c`` (``TRAJECTORY_MEMORY_SIZE`` is 4096: "4k allows us to store 31 poly4d
pieces").
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path, write_text
from ...models.fields import Flag
from ...models.minimum_snap.bounds import derivative_name, derivative_unit
from ...models.minimum_snap.trajectory import Trajectory
from ..exports import ExportFormat
from ..storage import joined
from .pieces import Poly7, Precision

__all__ = [
    "MEMORY_BYTES",
    "PIECES_THAT_FIT",
    "PIECE_BYTES",
    "POLY7",
    "Poly7Report",
    "model_of_trajectory",
    "read_poly7",
    "write_poly7",
]

if TYPE_CHECKING:
    from ...models.minimum_snap.model import MinimumSnap

log = logging.getLogger("crosstrack")

Floats = NDArray[np.float64]

#: Memory of the firmware for trajectories, bytes.
MEMORY_BYTES = 4096
#: Size of a piece, bytes: 4 polynomials of 8 coefficients and the duration, 4 bytes each.
PIECE_BYTES = 4 * (4 * 8 + 1)
#: Number of uncompressed pieces that fit into the memory.
PIECES_THAT_FIT = MEMORY_BYTES // PIECE_BYTES

#: Derivatives whose jumps are reported: position to jerk.
_ORDERS = range(4)


@dataclass(frozen=True)
class Poly7Report:
    """Effect of 4-byte floats on a trajectory, and its size in the firmware's memory.

    The report is for the numbers that the firmware stores, independent of the digits in the file.

    Parameters
    ----------
    path : str
        Path of the written file.
    pieces : int
        Number of pieces.
    jumps : tuple of tuple of float
        Largest jump at a knot, ``jumps[derivative][axis]``: position, velocity, acceleration, jerk
        of x, y, z (m/s^j) and yaw (rad/s^j).
    rounding_jumps : tuple of tuple of float
        Part of `jumps` that is due to the rounding of coefficients and durations.
    end_drift : tuple of float
        Change of the last position: x, y, z (m), yaw (rad).
    time_drift : float
        Delay of the end, s.
    """

    path: str
    pieces: int
    jumps: tuple[tuple[float, ...], ...]
    rounding_jumps: tuple[tuple[float, ...], ...]
    end_drift: tuple[float, ...]
    time_drift: float

    @property
    def bytes_needed(self) -> int:
        """Size of the uncompressed pieces, bytes."""
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
    """Read a trajectory from a poly7 file: x, y, z (m) and yaw (rad).

    Parameters
    ----------
    path : path-like
        Path of the file. The header may contain blanks, capitals and a leading ``#``, and lines may
        end with a comma. Rows of commas only are skipped.
    start : float
        Time of the first knot, s. The file contains durations only.

    Returns
    -------
    Trajectory
        Trajectory of degree 7 in 4 dimensions.

    Raises
    ------
    InvalidData
        The header or the length of a row is wrong, a number is not finite, a duration is not
        positive, or the file has no piece. The message names file, line, column, value and the
        allowed values.

    See Also
    --------
    Poly7 : Exact numbers of the file.
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
    """Write a trajectory atomically as a poly7 file, and report the effect of rounding.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory of degree <= 7 in 1 to 4 dimensions: x, y, z (m), yaw (rad). Missing axes are 0.
        The file starts at time 0, independent of the first knot.
    path : path-like
        Path of the file.
    yaw : float or Trajectory, optional
        Constant (rad), or a 1-dimensional trajectory with the same knots. Default: the yaw of the
        trajectory, if any.
    precision : {"float32", "float64"}
        Digits in the file: those of the firmware's 4-byte floats (default), or full precision.
    strict : bool
        Whether to reject more pieces than fit into the firmware's memory (31). By default the
        report states it.

    Returns
    -------
    Poly7Report
        Jumps at the knots and drift of the end in the firmware's 4-byte floats.

    Raises
    ------
    InvalidData
        The degree is above 7, there are more than 4 dimensions, numbers are outside the range of
        4-byte floats, there are too many pieces with `strict`, or the file cannot be written. The
        file is then unchanged.
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
        # Sum the differences. The difference of the sums would lose their digits.
        time_drift=float((stored.durations - exact.durations).sum()),
    )


def model_of_trajectory(path: Path, *, form: str, **data: Any) -> MinimumSnap:
    """Return the minimum-snap problem with the knots of a trajectory in a file: its waypoints and times."""
    from ...models.minimum_snap.model import MinimumSnap
    from .bezier import read_bezier

    trajectory = read_poly7(path) if form == "poly7" else read_bezier(path)
    log.warning(
        "%s: a trajectory, which is a plan; its waypoints and times become an instance", path
    )
    times = trajectory.times
    fields = {"waypoints": trajectory(times), "times": times}
    return MinimumSnap.from_data(joined(fields, data), name=path.stem)


POLY7 = ExportFormat("pieces of degree 7 as a Crazyflie flies them (CSV)", ".csv", write_poly7)
