"""Measurements of the benchmarks, and the table that compares them."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median

__all__ = ["Ledger", "Row", "duration"]

#: The distributions whose versions matter to what is measured.
_VERSIONS = ("numpy", "numba", "highspy", "cspy")


@dataclass(frozen=True)
class Row:
    """One solver on one instance.

    Parameters
    ----------
    case, solver : str
        Names.
    own : sequence of float
        Seconds of every call from coordinates to answer: build and solve, without verification.
    whole : sequence of float
        Seconds of every call as a whole, verification included.
    work : str
        Labels, nodes or extensions.
    outcome : str
        How it ended.
    """

    case: str
    solver: str
    own: Sequence[float] = ()
    whole: Sequence[float] = ()
    work: str = ""
    outcome: str = ""


@dataclass
class Ledger:
    """Rows by instance, and single figures."""

    rows: list[Row] = field(default_factory=list)
    titles: dict[str, str] = field(default_factory=dict)
    starts: list[tuple[str, str]] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        """Yield the report."""
        versions = [f"Python {platform.python_version()}"]
        for name in _VERSIONS:
            try:
                versions.append(f"{name} {importlib.metadata.version(name)}")
            except importlib.metadata.PackageNotFoundError:
                versions.append(f"{name} not installed")
        load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
        yield f"{', '.join(versions)}; {os.cpu_count()} cores{load}"
        yield "own: build and solve, compilation and verification apart; whole: the call with its"
        yield "verification, on a model never solved before; ratio: median own / that of the first row"
        header = ("solver", "own min", "own median", "whole", "ratio", "work", "outcome")
        for case, title in self.titles.items():
            rows = [row for row in self.rows if row.case == case]
            base = next((median(row.own) for row in rows if row.own), None)
            yield ""
            yield title
            yield from _aligned([header, *(_cells(row, base) for row in rows)])
        if self.starts:
            yield ""
            yield "the first minute (whole processes, error-correction/7)"
            yield from _aligned(self.starts)


def _cells(row: Row, base: float | None) -> tuple[str, ...]:
    if not row.own:
        return (row.solver, "–", "–", "–", "–", row.work, row.outcome)
    ratio = "" if not base else f"{median(row.own) / base:,.{0 if row.own[0] > 10 * base else 1}f}"
    return (
        row.solver,
        duration(min(row.own)),
        duration(median(row.own)),
        duration(median(row.whole)),
        ratio,
        row.work,
        row.outcome,
    )


def _aligned(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of `table`: the first, and the last two of many columns, to the left."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for cells in table:
        padded = [
            f"{cell:<{width}}" if place == 0 or place > 4 else f"{cell:>{width}}"
            for place, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        yield "  " + "  ".join(padded).rstrip()


def duration(seconds: float) -> str:
    """Return `seconds` in a unit that people read easily."""
    if seconds >= 1:
        return f"{seconds:.2f} s"
    if seconds >= 1e-3:
        return f"{seconds * 1e3:.2f} ms"
    return f"{seconds * 1e6:.0f} µs"
