"""Known systems with their figures, for the documentation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from .systems import SYSTEMS

__all__ = ["systems"]


def systems() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of what is known of the systems."""
    rows: list[Sequence[Any]] = []
    for name, known in SYSTEMS.items():
        exponent, dimension = (
            "" if figure is None else f"{figure:.4g}"
            for figure in (known.exponent, known.dimension)
        )
        bits = "" if known.exponent is None else f"{known.exponent / math.log(2.0):.4g}"
        chaotic = "yes" if known.chaotic else "no"
        rows.append(
            (
                f"`{name}`",
                known.title,
                known.period,
                exponent,
                bits,
                dimension,
                chaotic,
                known.source,
            )
        )
    columns = (
        "system", "", "period (s)", "exponent (nats/s)", "(bits/s)", "correlation dimension", "chaotic", "source",
    )  # fmt: skip
    notes = ["An empty cell: not known, or the series is no motion on an attractor."]
    return columns, rows, notes
