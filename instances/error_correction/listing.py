"""Catalogue entries of error-correction routing."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ...errors import UnknownName
from ...models.error_correction.model import ErrorCorrectionRouting
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate, with_suspects
from .settings import (
    BOX,
    DELTA,
    EXAMPLE_1_OPTIMUM,
    PAPER,
    SETTINGS,
    TIGHT,
    Setting,
    Thresholds,
    published,
)

__all__ = ["catalogue_entries", "example_1", "setting_model"]

_OURS = (
    "The paper's coordinates are not published: ours are seeded and share sizes and thresholds, "
    "so lengths are not comparable with the paper's, and seconds only in their order."
)


def setting_model(row: int) -> ErrorCorrectionRouting:
    """Return our instance for a row of the paper's table 1, by the seed in its setting.

    Parameters
    ----------
    row : int
        Number of the row.

    Raises
    ------
    UnknownName
        The table has no such row.
    """
    if not isinstance(row, int) or row not in SETTINGS:
        raise UnknownName("row of table 1", str(row), map(str, SETTINGS))
    setting = SETTINGS[row]
    return generate(
        setting.horizontal,
        setting.vertical,
        setting.thresholds,
        seed=setting.seed,
        delta=DELTA,
        box=BOX,
        planted_under=_planted_under(setting),
        name=f"error-correction/{row}",
    )


def _planted_under(setting: Setting) -> tuple[float, ...] | None:
    # Rows 7 to 9 and 10 to 12 share their points, so one route must suit all three.
    return TIGHT if setting.row >= 7 else None


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return example 1 and the rows of table 1."""
    example = Row(
        "example-1",
        "Example 1: the shorter way to a point may lead nowhere",
        example_1,
        "The paper gives four distances and the thresholds; the coordinates, which have these "
        "distances, and the place of point 4 are ours.",
        Provenance.COMPLETED,
        {"example": 1, "optimum": EXAMPLE_1_OPTIMUM, "route": [1, 2, 3, 5]},
    )
    rows = (example, *map(_table_row, SETTINGS.values()), *map(_suspect_row, _SUSPECTS))
    return listed("error-correction", "error-correction", PAPER, rows)


#: Rows of table 1 with suspect points: seed, share and residual, feasible in the worst case.
_SUSPECTS = {3: (1, 0.3, 5.0), 6: (1, 0.3, 5.0), 8: (1, 0.3, 5.0)}


def _suspect_model(row: int) -> ErrorCorrectionRouting:
    """Return the instance of a row of table 1 with suspect points."""
    seed, share, residual = _SUSPECTS[row]
    name = f"error-correction/suspect-{SETTINGS[row].n}"
    return with_suspects(setting_model(row), share, residual, seed=seed, name=name)


def _suspect_row(row: int) -> Row:
    _, share, residual = _SUSPECTS[row]
    count = SETTINGS[row].n
    return Row(
        f"suspect-{count}",
        f"Suspect points: row {row} of table 1, {count} points, each suspect with probability "
        f"{share:g}, residual {residual:g}",
        partial(_suspect_model, row),
        "Points and suspects are ours, by seed; a route exists if all suspects fail.",
    )


def _table_row(setting: Setting) -> Row:
    limits = ", ".join(f"{value:g}" for value in setting.thresholds)
    notes = [_OURS]
    if setting.contest_optimum is not None:
        notes.append(
            "A public contest has points of these numbers of kinds; on them the optimum is "
            f"{setting.contest_optimum:.3f} m."
        )
    if setting.printed_vertical != setting.vertical:
        notes.append(
            f"Table 1 prints {setting.horizontal} and {setting.printed_vertical} points of the two kinds, which do not "
            f"add up to {setting.n}: {setting.horizontal} and {setting.vertical} are taken."
        )
    return Row(
        str(setting.row),
        f"Table 1, row {setting.row}: {setting.n} points, thresholds {limits}",
        partial(setting_model, setting.row),
        " ".join(notes),
        published=published(setting.row),
    )


def example_1() -> ErrorCorrectionRouting:
    """Return the paper's example 1: the shorter path to a point may be a dead end.

    Points 1 (A) to 5 (B); 2 and 4 are horizontal and 3 is vertical. Point 3 is 2 m from point 1, or
    2.5 m via point 2. Only the longer path arrives with a horizontal error small enough to reach B.
    The optimal route is 1-2-3-5 of length 4.5.

    The paper publishes d12 = 2, d13 = 2, d23 = 0.5, d35 = 2, δ = 0.1 and thresholds of 0.3. The
    coordinates with these distances and the position of point 4 are ours. The route via point 4 is
    feasible and longer.
    """
    # Points 2 and 4 are 2 m from point 1, and 0.5 m and 0.8 m from point 3, on opposite sides.
    x2, x4 = (8 - 0.5**2) / 4, (8 - 0.8**2) / 4
    places = [(0, 0), (x2, math.sqrt(4 - x2**2)), (2, 0), (x4, -math.sqrt(4 - x4**2)), (4, 0)]
    return ErrorCorrectionRouting(
        points=np.array([(x, y, 0.0) for x, y in places]),
        kinds=np.array(["A", "horizontal", "vertical", "horizontal", "B"]),
        **Thresholds(0.3, 0.3, 0.3, 0.3, 0.3)._asdict(),
        delta=0.1,
        ids=(1, 2, 3, 4, 5),
        name="error-correction/example-1",
    )
