"""The table of the paper as it prints it, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .settings import TABLE_3, VEHICLE

__all__ = ["errors"]


def errors() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of table 3: errors of the estimated angle."""
    rows: list[Sequence[Any]] = [
        (f"`{road}`", f"{one.speed:g}", f"{one.mean:.4f}", f"{one.deviation:.4f}")
        for road, one in TABLE_3.items()
    ]
    v = VEHICLE
    notes = [
        "The paper's vehicle is lost, and so are the coefficients of its roads and what its drivers were like.",
        (
            f"Ours has a mass of {v.mass:g} kg, a moment of inertia of {v.yaw_inertia:g} kg m², its axles "
            f"{v.front:g} m before and {v.rear:g} m behind the centre of mass, and a cornering stiffness of "
            f"{v.cornering_front:g} N/rad in front and {v.cornering_rear:g} N/rad behind (an exercise in Z. Yu, "
            "Automobile Theory)."
        ),
    ]
    columns = ("road", "speed (km/h)", "mean error (°)", "its standard deviation (°)")
    return columns, rows, notes
