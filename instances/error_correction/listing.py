"""Catalogue entries of error-correction routing."""

from __future__ import annotations

from functools import partial

from ...errors import UnknownName
from ...models.error_correction.model import ErrorCorrectionRouting
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .examples import example_1
from .generator import generate, with_suspects
from .settings import BOX, DELTA, EXAMPLE_1_OPTIMUM, PAPER, SETTINGS, TIGHT, Setting, published

__all__ = ["catalogue_entries", "setting_model"]

_OURS = (
    "The paper's coordinates are not published: ours are seeded and share sizes and thresholds, "
    "so lengths are not comparable with the paper's, and seconds only in their order."
)


def setting_model(row: int) -> ErrorCorrectionRouting:
    """Return our instance for a row of the paper's table 1, by the seed in its setting."""
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
