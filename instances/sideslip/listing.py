"""Catalogue entries of sideslip estimation: the paper's two roads, and more difficult drives."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate
from .paper import TABLE_3

__all__ = ["MISMATCH", "PAPER", "catalogue_entries"]

PAPER = (
    "Vehicle Sideslip Angle Estimation Based on General Regression Neural Network, Mathematical "
    "Problems in Engineering, 2016"
)

#: Factors between assumed and true parameters in the entries with a wrong vehicle: a heavier car on
#: softer tyres.
MISMATCH = {"mass": 1.3, "cornering_front": 0.7, "cornering_rear": 0.7}
#: The roads with their speed, km/h, and row of Table 3.
_ROADS = {"lane-change": (80, "double lane"), "serpentine": (65, "serpentine line")}

_LOST = (
    "The road is the paper's. Its car, the ranges of its drivers and its records are not printed: a textbook's car, "
    "drivers with ranges of ours and simulated sensors replace them, so the errors are not comparable."
)
_SPECIAL = "Ours: the paper has no such drive."

#: Drives that are not in the paper: name, title and arguments of the generator.
_WILD: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    (
        "limit", "saturating tyres near the limit, friction 0.55",
        {"tyre": "saturating", "friction": 0.55},
    ),
    (
        "ice", "friction 0.2 where 0.9 is believed, after drives on a dry road",
        {
            "tyre": "saturating", "friction": 0.2, "speed": 16.0, "training_friction": 0.9,
            "mismatch": {"friction": 4.5},
        },
    ),
    (
        "friction-change", "friction 0.9 that falls to 0.3 halfway, after drives on a dry road",
        {
            "tyre": "saturating", "friction": 0.9, "later_friction": 0.3,
            "training_friction": 0.9,
        },
    ),
    (
        "stop-and-go", "down to standstill and on again",
        {"speed": ((0, 22), (4, 10), (7, 0), (9, 0), (14, 15), (24, 22))},
    ),
    ("missing", "three samples of ten are left out", {"missing": 0.3}),
    ("stale", "three samples of ten repeat the one before", {"stale": 0.3}),
    ("biased", "sensors with a bias of 0.02 rad/s and 0.3 m/s²", {"bias": (0.02, 0.3)}),
    ("noisy", "noise of ten times the signals' power", {"decibels": -10.0}),
    ("short", "50 samples", {"road": "serpentine", "samples": 50}),
    ("long", "10,000 samples", {"road": "serpentine", "samples": 10_000}),
    ("unknown", "nobody knows the true angle", {"known": False}),
    ("untrained", "no drive to learn from", {"drivers": 0}),
)  # fmt: skip


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of sideslip estimation.

    Returns
    -------
    tuple of CatalogueEntry
    """
    rows = []
    for road, (speed, row) in _ROADS.items():
        title = f"{road.replace('-', ' ')} at {speed} km/h"
        mean, deviation = TABLE_3.rows[(row,)]
        published = {"mean": mean, "deviation": deviation, "source": "table 3"}
        mismatch = f"{title}, mass and stiffness believed wrong by 30 %"
        rows += [
            Row(road, title, partial(generate, road=road), _LOST, Provenance.COMPLETED, published),
            Row(
                f"{road}-mismatch",
                mismatch,
                partial(generate, road=road, mismatch=MISMATCH),
                f"{_SPECIAL} The drives are those of {road}.",
            ),
        ]
    rows += [Row(name, title, partial(generate, **options)) for name, title, options in _WILD]
    return listed("sideslip", "sideslip", PAPER, rows, note=_SPECIAL)
