"""The demonstration of error-correction routing: 327 points, or those of a user's CSV file."""

from __future__ import annotations

from typing import Any

from ...errors import InvalidData
from ...models.error_correction.model import ErrorCorrectionRouting
from ..demos import Demo, DemoOption
from .files import read_csv
from .settings import Thresholds

__all__ = ["DEMO"]


def _from_csv(points: str, thresholds: str, delta: float) -> ErrorCorrectionRouting:
    """Return the model of the points in a CSV file under thresholds separated by commas."""
    names = Thresholds._fields
    try:
        given: dict[str, Any] = dict(zip(names, map(float, thresholds.split(",")), strict=True))
    except ValueError:
        raise InvalidData(
            f"thresholds must be five numbers: {','.join(names)}, got {thresholds!r}",
            field="thresholds",
        ) from None
    return read_csv(points, **given, delta=delta)


DEMO = Demo(
    "error-correction/7",
    {
        "points": DemoOption(
            "A CSV or Excel file of points instead of error-correction/7.", metavar="FILE"
        ),
        "thresholds": DemoOption(
            "alpha1,alpha2,beta1,beta2,theta for --points.", default="20,10,15,20,20"
        ),
        "delta": DemoOption("Error gained per metre for --points.", default=0.001, type=float),
    },
    _from_csv,
)
