"""Random missions of robots that share corridors, crossings and doors: contacts and the last return.

::

    python tests/benchmarks/fleet_mission/shared_space.py [COUNT] [FIRST]

Contacts are searched by ``tests/fleet_mission/contacts.py``, which shares no code with the package and exempts no
robot under way. The last return is compared with that of the slowest robot alone: each robot's nodes are solved
again as a mission of one robot. The map grows with the number of robots, as all of them use one depot.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402
from fleet_mission.contacts import contacts  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.errors import InvalidData  # noqa: E402
from crosstrack.models import FleetMission  # noqa: E402

KINDS = ("corridor", "crossing", "door")
#: Required last return as a multiple of that of the slowest robot alone, for corridors and crossings.
WITHIN = 1.2
RADIUS, HIGH = 0.3, 20.0


def box(x, y, right, top):
    """Return a rectangle."""
    return [[x, y], [right, y], [right, top], [x, top]]


def mission(kind: str, seed: int, robots: int | None = None) -> FleetMission:
    """Return a random mission: two rooms and a passage between them, or blocks with streets.

    A corridor has room for two robots, a door only for one.
    """
    draw = np.random.default_rng([seed, KINDS.index(kind)])
    count = int(draw.integers(2, 21)) if robots is None else robots
    cell = 0.25 if kind == "door" else 0.5
    long = 20.0 + 4.0 * count * float(draw.uniform(0.8, 1.2))
    if kind == "crossing":
        side, street = float(draw.uniform(5.0, 8.0)), float(draw.uniform(2.4, 3.2))
        lefts = np.arange(3.0, long, side + street)
        lows = np.arange(3.0, HIGH - 2.0, side + street)
        obstacles = [box(x, y, x + side, min(y + side, HIGH - 2.0)) for x in lefts for y in lows]
        depot, first = [1.2, 1.2], 3.0
    else:
        wide = (
            float(draw.uniform(2.0, 2.8)) if kind == "corridor" else float(draw.uniform(1.2, 1.5))
        )
        thick = (
            float(draw.uniform(4.0, 10.0)) if kind == "corridor" else float(draw.uniform(0.4, 1.0))
        )
        middle = float(draw.uniform(5.0, HIGH - 5.0))
        obstacles = [
            box(10.0, 0.0, 10.0 + thick, middle - wide / 2),
            box(10.0, middle + wide / 2, 10.0 + thick, HIGH),
        ]
        depot, first = [2.0, float(draw.uniform(4.0, HIGH - 4.0))], 12.0 + thick
    nodes: list[list[float]] = []
    while len(nodes) < count + int(count * draw.uniform(0.0, 0.5)):
        place = [float(draw.uniform(first, first + long)), float(draw.uniform(1.0, HIGH - 1.0))]
        try:
            FleetMission(obstacles, (0, 0, first + long + 2, HIGH), [place], depot, 1, cell, RADIUS)
        except InvalidData:  # in a block or too near to one
            continue
        nodes.append(place)
    return FleetMission(
        obstacles, (0, 0, first + long + 2, HIGH), nodes, depot, count, cell, RADIUS, objective="makespan",
        name=f"{kind}-{seed}",
    )  # fmt: skip


def alone(model: FleetMission, routes: Sequence[Sequence[int]]) -> float:
    """Return the last return (s) if every robot visits its nodes alone on the map, in its best order."""
    returns = []
    for route in routes:
        one = replace(model, nodes=model.nodes[list(route)], vehicles=1)
        answer = ct.solve(one, "staged", seed=1)
        assert answer.verified, answer
        returns.append(answer.plan.end)
    return max(returns)


def measure(kind: str, seed: int) -> tuple[float, float, int]:
    """Return the last return over that of the slowest robot alone, CPU seconds, and the number of contacts."""
    model = mission(kind, seed)
    started = time.process_time()
    answer = ct.solve(model, "staged", seed=1)
    seconds = time.process_time() - started
    assert answer.verified, answer
    touching = contacts(model, answer.plan)
    ratio = answer.plan.end / alone(model, answer.plan.routes)
    print(
        f"{model.name} {model.vehicles} robots {ratio:.3f} {seconds:.1f} s {touching}", flush=True
    )
    return ratio, seconds, len(touching)


def record(results: dict[str, list[tuple[float, float, int]]], first: int, last: int) -> None:
    """Write the table of the seeds `first` to `last`."""
    rows = []
    for kind, entries in results.items():
        ratios, seconds, touching = (np.array(column) for column in zip(*entries, strict=True))
        rows.append(
            (
                kind, len(entries), int(touching.sum()), float(np.median(ratios)), float(ratios.max()),
                float((ratios <= WITHIN).mean()), float(np.median(seconds)),
            )
        )  # fmt: skip
    columns = {
        "missions": "", "number": "d", "contacts": "d", "median": ".3f", "largest": ".3f",
        f"at most {WITHIN}": ".0%", "CPU seconds": ".3g",
    }  # fmt: skip
    text = (
        f"Random missions of 2 to 20 robots with objective makespan, seeds {first} to {last}: "
        "return of the last robot over that of the slowest robot alone (median, largest, and share of missions "
        "within the limit), and median time of `staged`. Alone means that the nodes of each robot are solved "
        "again as a mission of one robot on the same map."
    )
    write("fleet-mission", "shared-space", __file__, columns, rows, ("numpy", "shapely"), text)


def main() -> None:
    """Solve missions of every kind; write a table after each seed."""
    arguments = [int(entry) for entry in sys.argv[1:]]
    count, begin = (arguments + [10, 0][len(arguments) :])[:2]
    results: dict[str, list[tuple[float, float, int]]] = {kind: [] for kind in KINDS}
    for seed in range(begin, begin + count):
        for kind in KINDS:
            results[kind].append(measure(kind, seed))
        record(results, begin, seed)


if __name__ == "__main__":
    main()
