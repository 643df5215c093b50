"""A table of the paper as it prints it, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .listing import TABLE_4

__all__ = ["table_4"]


def table_4() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of what table IV prints of the memetic algorithm."""
    rows: list[Sequence[Any]] = [
        (vehicles, f"{low:g}", f"{high:g}") for vehicles, (low, high) in TABLE_4.items()
    ]
    notes = ["Means of 25 runs over all its instances of a size. Tables IV and V disagree in part."]
    return ("vehicles", "from (m)", "to (m)"), rows, notes
