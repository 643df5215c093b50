"""Catalogue of messenger tours: instances of the paper's sizes, and special cases."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import numpy as np

from ...models.messenger.model import MessengerTour
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate
from .printed import TABLE_3, TABLE_4

__all__ = ["PAPER", "catalogue_entries", "paper_instance"]

PAPER = (
    "A Memetic Algorithm for Curvature-Constrained Path Planning of Messenger UAV in Air-Ground "
    "Coordination, IEEE Transactions on Automation Science and Engineering, doi "
    "10.1109/TASE.2021.3135044"
)

_OURS = (
    "The paper does not publish its instances: this one is ours by seed, with the paper's number of "
    "vehicles and sparsity, so lengths compare with the paper's by magnitude only."
)
_SPECIAL = "Ours: the paper has no such instance."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries."""
    papers = (
        _paper_row(number, name, cells[0])
        for number, table in ((3, TABLE_3), (4, TABLE_4))
        for (name,), cells in table.rows.items()
    )
    return listed("messenger", "messenger-tour", PAPER, (*papers, *_special()))


def paper_instance(name: str) -> MessengerTour:
    """Return the seeded instance with the paper's name `name`, such as ``"B-2-01"``."""
    sparsity: Any = (TABLE_3.rows.get((name,)) or TABLE_4.rows[name,])[0]
    _, size, row = name.split("-")
    return generate(int(size), sparsity, 100 * int(size) + int(row), name=name)


def _paper_row(table: int, name: str, sparsity: Any) -> Row:
    _, size, row = name.split("-")
    return Row(
        f"B-{int(size):02}-{row}",
        f"{size} vehicles, sparsity {sparsity:g}",
        partial(paper_instance, name),
        _OURS,
        published={"table": table, "row": 100 * int(size) + int(row)},
    )


def _special() -> tuple[Row, ...]:
    return (
        Row(
            "static-closed",
            "A closed tour over 8 vehicles at rest, which may begin anywhere",
            _static,
            f"{_SPECIAL} The Dubins travelling salesman problem with neighbourhoods.",
        ),
        Row(
            "moving-targets",
            "7 moving vehicles that must be met exactly",
            partial(generate, 7, 6.0, 3, radius=0.0),
            f"{_SPECIAL} The Dubins travelling salesman problem with moving targets.",
        ),
        Row(
            "euclidean",
            "8 moving vehicles, and a UAV that turns on the spot",
            _euclidean,
            f"{_SPECIAL} Without curvature the relaxation that gives bounds is the problem itself.",
        ),
        Row(
            "gap",
            "A vehicle that slips out of the UAV's turning circle",
            partial(_explicit, [[-5.0, 4.4], [-40.0, 30.0]], [[0.0, 0.5], [0.0, -1.0]], 0.0),
            f"{_SPECIAL} The first vehicle leaves the left turning circle after 1.2 s, when the UAV has "
            "flown 12 m. The shortest path there drops to 7.9 m at once, but none has 12 m: waiting is "
            "not possible, and the meeting comes later.",
            Provenance.OURS,
        ),
        Row(
            "met-at-start",
            "4 vehicles whose discs all hold the start: the optimum is 0 m",
            partial(
                _explicit,
                [[1.0, 2.0], [-3.0, 1.0], [0.0, -4.0], [2.0, -2.0]],
                [[1.0, 0.0], [0.0, 3.0], [-2.0, 2.0], [0.0, 0.0]],
                5.0,
            ),
            f"{_SPECIAL} Every vehicle is met at time 0.",
            Provenance.OURS,
            {"optimum": 0.0, "source": "no path is shorter than none"},
        ),
    )


def _explicit(
    positions: list[list[float]], velocities: list[list[float]], radius: float
) -> MessengerTour:
    data = {"positions": positions, "velocities": velocities, "radius": radius}
    return MessengerTour.from_data(data)


def _static() -> MessengerTour:
    return dataclasses.replace(generate(8, 6.0, 1, fastest=0.0), start=None, closed=True)


def _euclidean() -> MessengerTour:
    return dataclasses.replace(generate(8, 6.0, 2), turning_radius=0.0, start=np.zeros(2))
