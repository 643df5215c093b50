"""Seeded instances of fleet routing: nodes in a square.

Only ``Generator.random`` is used and its results are rounded, so that a seed gives the same nodes on
every platform.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.fields import Real, Whole
from ...models.fleet.data import MOST
from ...models.fleet.model import FleetRouting

__all__ = ["generate"]

#: Decimal digits of a node's position in the unit square.
_DIGITS = 4


def generate(
    nodes: int, vehicles: int, seed: int, *, side: float = 200.0, name: str = "", **fields: Any
) -> FleetRouting:
    """Return a fleet model with the depot in the middle of a square and uniformly random nodes.

    Parameters
    ----------
    nodes : int
        Number of nodes to visit, beside the depot, which is node 0.
    vehicles : int
        Number of vehicles.
    seed : int
        Seed of the random numbers; the same seed gives the same nodes.
    side : float
        Side of the square, m.
    name : str
        Name of the model.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``objective``.

    Returns
    -------
    FleetRouting
        The model.

    Raises
    ------
    InvalidData
        An argument is invalid; the error names it.
    """
    count = Whole(1, MOST - 1).coerce("nodes", nodes, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    width = Real(lower=0, strict=True, unit="m").coerce("side", side, {})
    places = np.vstack([[0.5, 0.5], np.round(rng.random((count, 2)), _DIGITS)])
    return FleetRouting.from_data(
        {"points": width * places, "vehicles": vehicles, **fields}, name=name
    )
