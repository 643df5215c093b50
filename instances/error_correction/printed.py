"""The tables of the paper as it prints them, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .settings import SETTINGS, TABLE_2, TABLE_3

__all__ = ["table_1", "table_2", "table_3"]

Printed = tuple[Sequence[str], list[Sequence[Any]], list[str]]


def _figure(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ") if value >= 1000 else f"{value:g}"


def table_1() -> Printed:
    """Return columns, rows and notes of table 1: sizes and thresholds."""
    columns = ("row", "points", "horizontal", "vertical", "α1", "α2", "β1", "β2", "θ")
    rows: list[Sequence[Any]] = [
        (s.row, s.n, s.horizontal, s.vertical, *(f"{t:g}" for t in s.thresholds))
        for s in SETTINGS.values()
    ]
    return columns, rows, [f"Row {s.row}: {s.misprint}" for s in SETTINGS.values() if s.misprint]


def table_2() -> Printed:
    """Return columns, rows and notes of table 2: a MIP solver against two-stage."""
    columns = ("row", "optimum (m)", "Gurobi 8.0 (s)", "two-stage (s)")
    rows: list[Sequence[Any]] = [
        (row, _figure(f.optimum), _figure(f.gurobi), _figure(f.two_stage))
        for row, f in TABLE_2.items()
    ]
    return columns, rows, []


def table_3() -> Printed:
    """Return columns, rows and notes of table 3: seconds of the paper's exact algorithms."""
    columns = ("row", "stage 1 (s)", "stage 2 (s)", "two-stage (s)", "pulse (s)", "DP (s)")
    rows: list[Sequence[Any]] = [
        (
            row,
            *map(_figure, (f.stage_1, f.stage_2, f.two_stage, f.pulse, f.dynamic_programming)),
        )
        for row, f in TABLE_3.items()
    ]
    return columns, rows, []
