"""Yaw of a vehicle as an axis of its own: the curve of least angular acceleration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..arrays import Array
from ..specs import Real, Spec, frozen, show
from .trajectory import Trajectory

__all__ = ["YawSpec", "smoothest_yaw", "yaw_waypoints"]

Floats = NDArray[np.float64]

#: Largest absolute yaw, rad. The shortest turn between larger angles has no digits.
_MOST = 1e6
#: Energy ∫ ψ̈² of a segment in ψ and T ψ̇ at its two ends, times T³.
_ENERGY = np.array(
    [[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]],
)
#: Powers of s from the same four values.
_POWERS = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [-3, -2, 3, -1], [2, 1, -2, 1]])


@dataclass(frozen=True)
class YawSpec(Spec):
    """Yaw: ``"tangent"``, one number, or one entry per knot with None for free ones, rad."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        if isinstance(value, str):
            if value != "tangent":
                raise InvalidData(
                    f'{name} must be "tangent", a number or one entry per knot, got {show(value)}',
                    field=name,
                )
            return "tangent"
        if isinstance(value, bool | int | float | np.integer | np.floating):
            return Real(-_MOST, _MOST, unit="rad").coerce(name, value, sizes)
        array = Array(("knots",), infinity=1, unit="rad").coerce(name, value, sizes)
        given = array[np.isfinite(array)]
        if not given.size or np.abs(given).max() > _MOST:
            raise InvalidData(
                f"{name} must hold at least one angle, all within ±{_MOST:g} rad, got {show(value)}",
                field=name,
            )
        return array

    def encode(self, value: Any) -> Any:
        return (
            Array(("knots",), infinity=1).encode(value) if isinstance(value, np.ndarray) else value
        )

    def feed(self, value: Any) -> Iterable[bytes]:
        yield value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()

    def refreeze(self, value: Any) -> Any:
        return frozen(value) if isinstance(value, np.ndarray) else value


def yaw_waypoints(yaw: Floats | float, count: int, periodic: bool) -> Floats:
    """Return the yaw at the knots by the shortest turns from one given knot to the next; NaN if free."""
    if not isinstance(yaw, np.ndarray):
        return np.full(count, float(yaw))
    result = np.where(np.isfinite(yaw), yaw, np.nan)
    if periodic and np.isnan(result[-1]):
        result[-1] = result[0]
    given = np.isfinite(result)
    result[given] = np.unwrap(result[given])
    return result


def smoothest_yaw(yaw: Floats | float, times: Floats, periodic: bool) -> Trajectory:
    """Return the yaw that minimises ∫ ψ̈² dt through the given angles, of one axis.

    Its rate is continuous; it is 0 at both ends, or equal there if the path is periodic.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import spsolve

    angles, long, count = yaw_waypoints(yaw, times.size, periodic), np.diff(times), times.size - 1
    fixed = np.column_stack([angles, np.full(count + 1, np.nan)])
    number = np.arange(2 * count + 2).reshape(-1, 2)
    if periodic:
        number[-1, 1] = number[0, 1]
    else:
        fixed[[0, -1], 1] = 0.0
    local = np.concatenate([number[:-1], number[1:]], axis=1)
    units = np.stack([np.ones(count), long, np.ones(count), long], axis=1)
    energy = _ENERGY * units[:, :, None] * units[:, None, :] / long[:, None, None] ** 3
    rows = np.broadcast_to(local[:, :, None], energy.shape)
    columns = np.broadcast_to(local[:, None, :], energy.shape)
    size = number.size
    hessian = csc_array((energy.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    value = fixed.ravel().copy()
    known = np.isfinite(value)
    used = np.zeros(size, bool)
    used[number.ravel()] = True
    free = np.flatnonzero(~known & used)
    value[~known] = 0.0
    if free.size:
        value[free] = np.atleast_1d(spsolve(hessian[free][:, free], -(hessian @ value)[free]))
    return Trajectory(times, ((value[local] * units) @ _POWERS.T)[:, :, None])
