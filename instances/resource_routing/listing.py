"""Catalogue entries of routing with resources."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource
from ..catalogue import CatalogueEntry, Provenance
from .generator import generate_electric, generate_network

__all__ = ["catalogue_entries"]

SOURCE = (
    "Shortest path problems with resource constraints, in: Column Generation, 2005 (the problem; the "
    "instances are ours)"
)


_OURS = "Ours, drawn by a seed: no publication has these figures."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    return (
        _entry(
            "errand", "Five places, fuel for 3.5 km, one station", _errand,
            "By hand: straight to the station and on, sqrt(10) + sqrt(2) km.",
            {"optimum": 10**0.5 + 2**0.5, "source": "two straight lines"},
        ),
        _entry(
            "electric-40", "A drive of 400 km among 40 charging stations, in 8 hours",
            partial(generate_electric, 40, 1, hours=8.0),
        ),
        _entry(
            "electric-200", "A drive of 400 km among 200 charging stations, in 6.5 hours",
            partial(generate_electric, 200, 3, hours=6.5),
        ),
        _entry(
            "network-5", "25 crossings, three resources", partial(generate_network, 5, 1, tightness=1.1)
        ),
        _entry(
            "network-20", "400 crossings, three resources",
            partial(generate_network, 20, 3, tightness=0.9),
        ),
        _entry(
            "network-20-again", "The same where crossings may be visited again",
            partial(_again, 20, 3, 0.9),
        ),
        _entry(
            "network-40", "1600 crossings, three resources",
            partial(generate_network, 40, 4, tightness=0.9),
        ),
        _entry(
            "no-way", "100 crossings, and too little time for any way",
            partial(generate_network, 10, 2, tightness=0.5), "There is no plan, which is proven.",
        ),
        _entry(
            "plain", "25 crossings without resources: the shortest path alone", _plain,
        ),
    )  # fmt: skip


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


def _again(side: int, seed: int, tightness: float) -> ResourceRouting:
    return generate_network(side, seed, tightness=tightness, revisits=True)


def _plain() -> ResourceRouting:
    return replace(generate_network(5, 7), resources=(), uses=None)


def _entry(
    name: str, title: str, builder: Callable[[], ResourceRouting], note: str = "",
    published: Mapping[str, Any] | None = None,
) -> CatalogueEntry:  # fmt: skip
    return CatalogueEntry(
        name=f"resource-routing/{name}",
        model="resource-routing",
        title=title,
        paper=SOURCE,
        provenance=Provenance.OURS if published or name == "plain" else Provenance.SEEDED,
        builder=builder,
        published=published or {},
        note=note or _OURS,
    )
