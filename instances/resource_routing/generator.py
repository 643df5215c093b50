"""Seeded instances of routes with resources: electric vehicles among stations, networks of streets.

Only ``Generator.random`` is drawn from, so that a seed means the same instance wherever it is used.
"""

from __future__ import annotations

import numpy as np

from ...models.fields import Real, Whole
from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource

__all__ = ["generate_electric", "generate_network"]


def generate_electric(
    stations: int, seed: int, *, hours: float = 6.0, revisits: bool = False, name: str = ""
) -> ResourceRouting:
    """Return a drive across 400 km × 100 km from station to station, on straight roads.

    The battery holds 30 kWh, of which 0.2 are used for each kilometre at 80 km/h. A third of the
    stations charge it fully in 40 minutes, the others to 20 kWh in 15 minutes.

    Parameters
    ----------
    stations : int
        Their number; they are drawn uniformly.
    seed : int
        Same seed, same stations.
    hours : float
        The latest arrival at the end, h.
    revisits : bool
        Whether a station may be visited again.
    name : str
        Of the model.

    Raises
    ------
    InvalidData
        A number that is not allowed, named.
    """
    count = Whole(0, 5000).coerce("stations", stations, {})
    latest = Real(lower=0).coerce("hours", hours, {})
    generator = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    places = generator.random((count, 2)) * [400.0, 100.0]
    full = generator.random(count) < 1 / 3
    kinds = ["full charge" if is_full else "quick charge" for is_full in full.tolist()]
    present_kinds = sorted(set(kinds))
    energy = Resource(
        "energy", 0.2, unit="kWh",
        limits=dict.fromkeys([*present_kinds, "end"], 30.0),
        resets={kind: {"full charge": 0.0, "quick charge": 10.0}[kind] for kind in present_kinds},
    )  # fmt: skip
    waits = {"full charge": 40 / 60, "quick charge": 15 / 60}
    time = Resource(
        "time",
        1 / 80,
        limits={"end": latest},
        gains={kind: waits[kind] for kind in present_kinds},
        unit="h",
    )
    return ResourceRouting(
        ("start", *kinds, "end"),
        (energy, time),
        0,
        count + 1,
        points=np.vstack([[0.0, 50.0], places, [400.0, 50.0]]),
        revisits=revisits,
        name=name,
    )


def generate_network(
    side: int, seed: int, *, tightness: float = 1.15, revisits: bool = False, name: str = ""
) -> ResourceRouting:
    """Return a way through a square network of streets with energy, time and exposure.

    Streets lead both ways with lengths of their own in both directions. One crossing in eight has a
    station, which resets the energy, and one in eight a shelter, which leaves at most 1 of exposure.

    Parameters
    ----------
    side : int
        Crossings of a side, 2 at least.
    seed : int
        Same seed, same network.
    tightness : float
        The limit on the time, relative to the time that the shortest ways take on average.
    revisits, name
        As for :func:`generate_electric`.

    Raises
    ------
    InvalidData
        A number that is not allowed, named.
    """
    side = Whole(2, 300).coerce("side", side, {})
    share = Real(lower=0).coerce("tightness", tightness, {})
    generator = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    number = np.arange(side * side).reshape(side, side)
    right = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    down = np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    arcs = np.concatenate([right, right[:, ::-1], down, down[:, ::-1]])
    lengths = 1.0 + generator.random(len(arcs))
    exposure = 2.0 * generator.random(len(arcs)) ** 2
    time = lengths * (0.5 + generator.random(len(arcs)))
    drawn = generator.random(side * side)
    kinds = np.where(drawn < 0.125, "station", np.where(drawn < 0.25, "shelter", "crossing"))
    kinds[0], kinds[-1] = "start", "end"
    present = sorted(set(kinds.tolist()) - {"start"})
    steps = 2.0 * (side - 1)
    resources = (
        Resource(
            "energy", 1.0, limits=dict.fromkeys(present, max(8.0, 0.9 * side)),
            resets={kind: 0.0 for kind in present if kind == "station"},
        ),
        Resource("time", limits={"end": 1.4 * share * steps}),
        Resource(
            "exposure", limits=dict.fromkeys(present, 4.0),
            resets={kind: 1.0 for kind in present if kind == "shelter"},
        ),
    )  # fmt: skip
    return ResourceRouting(
        tuple(kinds.tolist()),
        resources,
        0,
        side * side - 1,
        points=np.column_stack([number.ravel() % side, number.ravel() // side]).astype(float),
        arcs=arcs,
        lengths=lengths,
        uses=np.column_stack([np.zeros(len(arcs)), time, exposure]),
        revisits=revisits,
        name=name,
    )
