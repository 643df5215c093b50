"""Flight times of missions beside robots that fly straight and stop at every corner.

::

    python tests/benchmarks/fleet_mission/speed.py [--seeds 50] [--picture speed.png]

The reference has the same routes and the same limits of the components. On each straight line it has the
time-optimal trapezoidal profile of the speed, without a limit on its jerk: its acceleration jumps. No curve
with continuous acceleration is as fast on a straight line from rest to rest. Two references are measured:
along the any-angle paths of the routes' legs, and along the shortest polylines in the corridors.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.fleet_mission import random_mission  # noqa: E402
from crosstrack.models import FleetMission, GridPath  # noqa: E402
from crosstrack.models.fleet_mission import lengths_of  # noqa: E402
from crosstrack.solvers.fleet_mission.corridor import corridor, crossed  # noqa: E402

CATALOGUE = ("nested", "pocket", "corridor", "paper")
#: Smallest turn that is a corner, rad.
CORNER = 1e-6


class Run(NamedTuple):
    """Flight time (s), length (m), objective (m) and CPU time (s) of a plan."""

    seconds: float
    length: float
    objective: float
    spent: float


def stopping(model: FleetMission, polyline: np.ndarray) -> float:
    """Return the least time along a polyline with a stop at every corner, s."""
    steps = np.diff(polyline, axis=0)
    steps = steps[np.hypot(*steps.T) > 1e-9 * model.cell]
    legs = [steps[0]]
    for step in steps[1:]:
        last = legs[-1]
        turn = abs(np.arctan2(last[0] * step[1] - last[1] * step[0], last @ step))
        if turn > CORNER:
            legs.append(step)
        else:
            legs[-1] = last + step
    total = 0.0
    for leg in np.abs(legs):
        # The share of the leg is limited like its components: speed in 1/s, acceleration in 1/s².
        parts = leg > 0
        speed = float((model.velocity_limit[parts] / leg[parts]).min())
        push = float((model.acceleration_limit[parts] / leg[parts]).min())
        ramp = speed / push
        total += 2.0 / np.sqrt(push) if speed * ramp >= 1.0 else 1.0 / speed + ramp
    return total


def references(model: FleetMission, routes: object) -> tuple[float, float]:
    """Return the times with stops along the any-angle paths, and along the shortest polylines, s."""
    along_paths = along_polylines = 0.0
    for route in routes:
        stops = [0, *(node + 1 for node in route), 0]
        chains, path = [], [model.places[:1]]
        for start, goal in itertools.pairwise(stops):
            ends = model.places[[start, goal]]
            if np.hypot(*(ends[1] - ends[0])) <= 1e-7 * model.cell:
                chains.append([])
                continue
            leg = GridPath(model.map, model.cells[start], model.cells[goal], connectivity="any")
            way = ct.solve(leg, "any-angle").plan.paths[0]
            chains.append(crossed(model.map, np.concatenate([ends[:1], way, ends[1:]])))
            path += [way, ends[1:]]
        along_paths += stopping(model, np.concatenate(path))
        knots = corridor(model.map, model.places[stops], chains, model.cell).knots
        along_polylines += stopping(model, knots)
    return along_paths, along_polylines


def fly(model: FleetMission, **options: object) -> tuple[object, Run]:
    """Return the plan of `staged` and its numbers."""
    begin = time.process_time()
    chosen = {"routing": "kmeans-ac", **options}
    answer = ct.solve(model, "staged", seed=0, threads=1, backend_options=chosen)
    spent = time.process_time() - begin
    assert answer.verified, answer
    curves = answer.plan.trajectories
    seconds = sum(curve.duration for curve in curves)
    length = sum(float(lengths_of(curve).sum()) for curve in curves)
    return answer.plan, Run(seconds, length, answer.verification.objective, spent)


def straight(nodes: int = 1) -> FleetMission:
    """Return a mission of one robot to a node and back, which has only straight legs."""
    places = [[8.0, 2.0 + k] for k in range(nodes)]
    return FleetMission([], (0, 0, 10, 10), places, (2, 2), 1, cell=0.5)


def missions(seeds: int) -> list[tuple[str, FleetMission]]:
    """Return the missions by name."""
    rows = [(name, ct.load(f"fleet-mission/{name}")) for name in CATALOGUE]
    for seed in range(seeds):
        draw = np.random.default_rng(seed)
        nodes = int(draw.integers(2, 14))
        robots = int(draw.integers(1, min(nodes, 4) + 1))
        model = random_mission(nodes, 6, robots, seed, bounds=(0, 0, 60, 60), size=0.5)
        rows.append((f"random {seed}", dataclasses.replace(model, name=f"random {seed}")))
    return rows


def picture(model: FleetMission, path: str) -> None:
    """Draw the speed and the acceleration of the first robot before and after."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(9, 5), layout="constrained")
    for name, label in (("interior-point", "minimum snap"), ("rounded", "rounded polyline")):
        plan, _ = fly(model, trajectories=name)
        curve = plan.trajectories[0]
        t = np.linspace(curve.times[0], curve.times[-1], 4000)
        speed, push = curve(t, 1), curve(t, 2)
        own = t - t[0]
        axes[0].plot(own, np.hypot(*speed.T), label=label)
        axes[1].plot(own, np.abs(push / model.acceleration_limit).max(axis=1), label=label)
    axes[0].set_ylabel("speed, m/s")
    axes[1].set_ylabel("largest component of\nacceleration / limit")
    axes[1].set_xlabel("time since departure, s")
    axes[0].legend()
    figure.savefig(path, dpi=100)


def main() -> None:
    """Fly the missions with both curves and write the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--picture")
    given = parser.parse_args()
    if given.picture:
        picture(ct.load("fleet-mission/corridor"), given.picture)
        return
    fly(ct.load("fleet-mission/nested"), trajectories="interior-point")  # compiles
    rows = []
    for name, model in missions(given.seeds):
        plan, after = fly(model)
        _, before = fly(model, trajectories="interior-point")
        paths, polylines = references(model, plan.routes)
        rows.append(
            (
                name, polylines, before.seconds / polylines, after.seconds / polylines,
                after.seconds / paths, after.objective / before.objective - 1.0,
                before.spent, after.spent,
            )
        )  # fmt: skip
        print(
            ("{:12s} {:9.2f} s" + " {:.4f}" * 3 + " {:+.2%} {:.2f} {:.2f} s").format(*rows[-1]),
            flush=True,
        )
    drawn = np.array([row[1:] for row in rows[len(CATALOGUE) :]])
    table = rows[: len(CATALOGUE)]
    for word, value in (("median", np.median), ("largest", np.max)):
        table.append((f"{given.seeds} random missions, {word}", *value(drawn, axis=0).tolist()))
    model = straight()
    plan, after = fly(model)
    _, before = fly(model, trajectories="interior-point")
    paths, polylines = references(model, plan.routes)
    table.append(
        (
            "there and back on a straight line", polylines, before.seconds / polylines, after.seconds / polylines,
            after.seconds / paths, after.objective / before.objective - 1.0, before.spent, after.spent,
        )
    )  # fmt: skip
    columns = {
        "mission": "", "polyline with stops, s": ".2f", "minimum snap / polyline": ".3f",
        "rounded / polyline": ".4f", "rounded / any-angle path with stops": ".4f", "change of the objective": "+.2%",
        "CPU of minimum snap, s": ".2f", "CPU of rounded, s": ".2f",
    }  # fmt: skip
    text = (
        "Total flight times of all robots. CPU times are those of all stages. Medians and largest values are "
        "those of each column."
    )
    for row in table[len(CATALOGUE) :]:
        print(row)
    write("fleet-mission", "speed", __file__, columns, table, ("numpy", "shapely"), text)


if __name__ == "__main__":
    main()
