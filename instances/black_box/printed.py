"""The setting of the paper's tables, and lengths of shortest paths, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...models.black_box.functions import Landscape
from .generator import BOUNDS
from .listing import FUNCTIONS, LENGTHS
from .paths import PATHS

__all__ = ["functions", "paths"]


def functions() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of the functions of tables 2 and 3."""
    rows: list[Sequence[Any]] = []
    for name, formula, dimension, least in FUNCTIONS:
        low, high = BOUNDS[Landscape(formula)]
        rows.append((f"`{name}`", dimension, f"{low:g} … {high:g}", f"{least:g}"))
    return ("function", "variables", "bounds of each", "least value"), rows, []


def paths() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of the maps that a robot crosses."""
    rows: list[Sequence[Any]] = []
    for name, asked in PATHS.items():
        lengths = LENGTHS.get(name)
        figures = () if lengths is None else (*lengths, lengths[1] / lengths[0])
        cells = [f"{one:.3f}" for one in figures] or [""] * 3
        rows.append((f"`path-{name}`", asked.title, asked.waypoints, *cells))
    columns = ("map", "", "waypoints", "any direction (m)", "eight neighbours (m)", "ratio")
    return columns, rows, []
