"""Seeded instances of fleet routing: nodes in a square.

Only ``Generator.random`` is drawn from, and what is computed of it is rounded, so that a seed means
the same nodes wherever it is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.fields import Real, Whole
from ...models.fleet.data import MOST
from ...models.fleet.model import FleetRouting

__all__ = ["generate"]

#: Digits of a node's place within the square.
_DIGITS = 4


def generate(
    nodes: int, vehicles: int, seed: int, *, side: float = 200.0, name: str = "", **fields: Any
) -> FleetRouting:
    """Return routes from the middle of a square through nodes that lie uniformly in it.

    Parameters
    ----------
    nodes : int
        Number of nodes to visit, beside the depot, which is node 0.
    vehicles : int
        Number of vehicles.
    seed : int
        Same seed, same nodes.
    side : float
        Of the square, m.
    name : str
        Of the model.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``objective``.

    Raises
    ------
    InvalidData
        A number that is not allowed, named.
    """
    count = Whole(1, MOST - 1).coerce("nodes", nodes, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    width = Real(lower=0, strict=True, unit="m").coerce("side", side, {})
    places = np.vstack([[0.5, 0.5], np.round(rng.random((count, 2)), _DIGITS)])
    return FleetRouting.from_data(
        {"points": width * places, "vehicles": vehicles, **fields}, name=name
    )
