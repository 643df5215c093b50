"""Yaw of a vehicle: the field of a model, and the angles at the knots."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..arrays import Array
from ..specs import Real, Spec, frozen, show

__all__ = ["YawSpec", "yaw_waypoints"]

Floats = NDArray[np.float64]

#: Largest absolute yaw, rad. The shortest turn between larger angles has no digits.
_MOST = 1e6


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
