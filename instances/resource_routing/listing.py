"""Catalogue entries of routing with resources."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate_electric, generate_network

__all__ = ["catalogue_entries"]

SOURCE = (
    "Shortest path problems with resource constraints, in: Column Generation, 2005 (the problem; the "
    "instances are ours)"
)
_OURS = "Ours, drawn by a seed: no publication has these figures."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    rows = (
        Row(
            "errand", "Five places, fuel for 3.5 km, one station", _errand,
            "By hand: straight to the station and on, sqrt(10) + sqrt(2) km.",
            Provenance.OURS, {"optimum": 10**0.5 + 2**0.5, "source": "two straight lines"},
        ),
        Row(
            "electric-40", "A drive of 400 km among 40 charging stations, in 8 hours",
            partial(generate_electric, 40, 1, hours=8.0),
        ),
        Row(
            "electric-200", "A drive of 400 km among 200 charging stations, in 6.5 hours",
            partial(generate_electric, 200, 3, hours=6.5),
        ),
        Row("network-5", "25 crossings, three resources", partial(generate_network, 5, 1, tightness=1.1)),
        Row("network-20", "400 crossings, three resources", partial(generate_network, 20, 3, tightness=0.9)),
        Row(
            "network-20-again", "The same where crossings may be visited again",
            partial(generate_network, 20, 3, tightness=0.9, revisits=True),
        ),
        Row("network-40", "1600 crossings, three resources", partial(generate_network, 40, 4, tightness=0.9)),
        Row(
            "no-way", "100 crossings, and too little time for any way",
            partial(generate_network, 10, 2, tightness=0.5), "There is no plan, which is proven.",
        ),
        Row(
            "plain", "25 crossings without resources: the shortest path alone", _plain,
            provenance=Provenance.OURS,
        ),
    )  # fmt: skip
    return listed("resource-routing", "resource-routing", SOURCE, rows, note=_OURS)


def _errand() -> ResourceRouting:
    places = np.array([[0.0, 0], [2, 0], [3, 1], [4, 0], [2, -2]])
    fuel = Resource(
        "fuel",
        1.0,
        limits={"place": 3.5, "station": 3.5, "end": 3.5},
        resets={"station": 0},
        unit="km",
    )
    kinds = ("start", "place", "station", "end", "place")
    return ResourceRouting(kinds, (fuel,), 0, 3, points=places)


def _plain() -> ResourceRouting:
    return replace(generate_network(5, 7), resources=(), uses=None)
