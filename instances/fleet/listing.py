"""Catalogue entries of fleet routing: small fleets of every kind, and the sizes of Table 3."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...models.fleet.model import FleetRouting
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from ..grid_path import paper_map, random_nodes
from ..grid_path.listing import PAPER
from .generator import generate

__all__ = ["NODES", "PAPER", "ROBOTS", "WEIGHTS", "catalogue_entries"]

#: Robots and nodes of Table 3, and five of its weights of the variance.
ROBOTS, NODES, WEIGHTS = 4, 75, (0.0, 0.2, 0.4, 0.6, 0.8)
#: Depot on the map, x, y (m), in a free cell.
DEPOT = (100.0, 100.0)

_ENUMERATED = "enumeration of all routes, tests/fleet/rich_oracle.py"
_SPECIAL = "Ours: the paper has no such instance."
#: Nodes of the example; the first is the depot.
_EXAMPLE = (*((50, 50), (20, 80), (35, 90), (80, 75)), *((90, 40), (60, 15), (25, 20), (10, 45)))


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    rows = (*_small(), *_limited(), *_wild(), *_rich(), *map(_table_3, WEIGHTS))
    return listed("fleet", "fleet-routing", PAPER, rows, note=_SPECIAL)


def _small() -> tuple[Row, ...]:
    cases: tuple[tuple[str, str, int, int, str, dict[str, Any]], ...] = (
        ("sum-9", "the shortest routes in all", 9, 3, "sum", {}),
        ("max-8", "the longest route shortest", 8, 2, "max", {}),
        ("max-10", "the longest route shortest", 10, 3, "max", {}),
        ("max-sum-7", "the longest route shortest, then the sum", 7, 2, "max-sum", {}),
        ("deviation-8", "length and balance weighed", 8, 3, "sum-deviation", {"q": 1.0}),
        ("deviation-7-q4", "balance above all", 7, 3, "sum-deviation", {"q": 4.0}),
        ("range-7", "the most equal routes, however long", 7, 2, "range", {}),
    )
    return (
        Row(
            "example", "2 robots share 7 nodes so that the longer route is shortest",
            partial(_fleet, 2, points=_EXAMPLE), provenance=Provenance.OURS,
        ),
        *(
            Row(
                name, f"{m} robots, {n} nodes: {title}",
                partial(generate, n, m, n + 100 * m, objective=objective, **more),
            )
            for name, title, n, m, objective, more in cases
        ),
    )  # fmt: skip


def _limited() -> tuple[Row, ...]:
    demands = (0, 3, 5, 2, 4, 1, 6, 3)
    return (
        Row(
            "asymmetric", "2 robots, 7 nodes: against the wind every way is longer", _windy
        ),
        Row(
            "two-depots", "3 robots from 2 depots, 7 nodes",
            partial(generate, 8, 3, 5, depots=[0, 1, 1]),
        ),
        Row(
            "battery", "3 robots with batteries of different size, not all needed",
            partial(
                generate, 7, 3, 6, objective="sum", use_all=False, battery=[500.0, 400.0, 250.0]
            ),
        ),
        Row(
            "capacity", "2 lorries that carry half of all each: the demands must split evenly",
            partial(_fleet, 2, points=_EXAMPLE, objective="sum", demands=demands, capacity=12.0),
            provenance=Provenance.OURS,
        ),
        Row(
            "bounded", "Little in all and little between the routes, for which a detour pays",
            partial(generate, 7, 2, 7, budget=660.0, deviation_limit=18.0, range_limit=25.0),
        ),
        Row(
            "bounded-too-tight", "The same with a budget that leaves none for the detour: no plan",
            partial(generate, 7, 2, 7, budget=640.0, deviation_limit=18.0, range_limit=25.0),
        ),
        Row(
            "battery-too-small", "A node beyond half a battery: no plan",
            partial(_fleet, 2, points=_EXAMPLE, battery=80.0),
            f"{_SPECIAL} Node 1 lies 42.4 m from the depot, so the round trip takes more than 80 m.",
            Provenance.OURS,
        ),
    )  # fmt: skip


def _wild() -> tuple[Row, ...]:
    far = [*_EXAMPLE[:6], (1e6, 50)]
    return (
        Row(
            "ties", "A lattice with many optimal plans, and nodes at one place",
            partial(_fleet, 2, points=[(x, y) for x in (0, 1, 2) for y in (0, 1)] + [(1, 1), (0, 0)]),
            provenance=Provenance.OURS,
        ),
        Row(
            "zeros", "Costs of 0, 1 and 2 that are no distances", partial(_fleet, 2, costs=_zeros()),
            provenance=Provenance.OURS,
        ),
        Row(
            "each-its-own", "As many robots as nodes", partial(_fleet, 5, points=_EXAMPLE[:6]),
            provenance=Provenance.OURS,
            published={"optimum": 2 * float(np.hypot(15, 40)), "source": "the farthest node and back"},
        ),
        Row(
            "one-far", "One node a million metres away", partial(_fleet, 2, points=far),
            provenance=Provenance.OURS,
        ),
    )  # fmt: skip


def _rich() -> tuple[Row, ...]:
    windows = (None, (20, 60), (50, 100), (90, 150), (40, 120), (60, 140), (110, 190), (0, 230))
    halves = ((0, 80), (150, 240))
    return (
        Row(
            "windows-7", "2 vehicles serve 7 nodes within time windows by 250 s",
            partial(
                _fleet, 2, points=_EXAMPLE, objective="sum", windows=windows,
                service=(0, *[5] * 7), shifts=(0, 250),
            ),
            provenance=Provenance.OURS, published={"optimum": 331.0419174590793, "source": _ENUMERATED},
        ),
        Row(
            "mixed-6", "2 vehicles with costs: a shipment, a reload, skills, and nodes with prizes",
            partial(
                _fleet, 2, points=_EXAMPLE[:7], objective="cost", fixed_cost=(30, 10),
                distance_cost=(1, 1.5), time_cost=0.2, service=(0, *[5] * 6),
                windows=(None, halves, None, None, (0, 160), None, (60, 300)),
                demands=(0, 3, 4, 0, 5, 0, 3), pickups=(0, 0, 0, 4, 0, 0, 2), pairs=[(3, 5)],
                capacity=(7, 5), reloads=[0], max_reloads=1, prizes=(*[None] * 4, 90, None, 50),
                requires=[[], [], ["lift"], [], [], [], []], skills=[["lift"], []],
            ),
            provenance=Provenance.OURS, published={"optimum": 281.5422683929398, "source": _ENUMERATED},
        ),
    )  # fmt: skip


def _table_3(q: float) -> Row:
    return Row(
        f"table-3-q{q:g}",
        f"{ROBOTS} robots, {NODES} nodes among 28 obstacles: length and {q:g} times the variance",
        partial(_among_obstacles, q),
        "The paper prints no coordinates: obstacles and nodes are ours by seed, with their numbers, so "
        "lengths are not comparable with the paper's.",
        published={"q": q},
    )


def _fleet(vehicles: int, **fields: Any) -> FleetRouting:
    return FleetRouting.from_data({"vehicles": vehicles, **fields})


def _among_obstacles(q: float) -> FleetRouting:
    grid = paper_map()
    depot = grid.centres(grid.cells_of(DEPOT))
    points = np.vstack([depot, random_nodes(grid, depot, NODES, 28)])
    return _fleet(ROBOTS, points=points, map=grid, objective="sum-variance", q=q)


def _windy() -> FleetRouting:
    calm = generate(7, 2, 4)
    assert calm.points is not None
    step = calm.points[None] - calm.points[:, None]
    # Half as fast against a wind from the east, rounded so that the bits are the same everywhere.
    costs = np.round(calm.distances + np.maximum(step[..., 0], 0.0), 6)
    return _fleet(2, costs=costs)


def _zeros() -> list[list[float]]:
    costs = [[float((3 * i + 5 * j + i * j) % 3) for j in range(7)] for i in range(7)]
    for i in range(7):
        costs[i][i] = 0.0
    return costs
