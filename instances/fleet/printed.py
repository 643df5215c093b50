"""The tables of the paper as it prints them, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .listing import TABLE_2

__all__ = ["table_2"]


def table_2() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of table 2: TSPLIB instances shared out among robots."""
    rows: list[Sequence[Any]] = [(name, f"{best:g}") for name, best in TABLE_2.items()]
    notes = [
        (
            "The paper states neither the number of robots nor what its fitness is, so these are no "
            "lengths to compare with. Lengths from city 1 fit best for m = 3 and routes of nearly equal, "
            "real-valued length."
        ),
        "st70: the printed mean, 77.47, is a running time: a misprint.",
    ]
    return ("instance", "GPSO-AC, best"), rows, notes
