"""What wider corridors cost a mission with the paper's numbers, and what solves its minimum-snap problems.

Nothing fails because it is slow. Run with ``make bench``, or::

    pytest tests/benchmarks/fleet_mission -s
"""

from __future__ import annotations

import time
from typing import Any

import pytest

import crosstrack as ct
from crosstrack.models import FREE, MinimumSnap
from crosstrack.models.fleet_mission import lengths_of
from crosstrack.solvers.backend import Request
from crosstrack.solvers.fleet_mission import staged
from crosstrack.solvers.fleet_mission.flight import programmed, slowed, times_along
from crosstrack.solvers.registry import find_backend

MARGINS = (0.1, 0.5, 1.0, 2.0, 100.0)
PROGRAMS = ("interior-point", "clarabel", "piqp", "proxqp", "highs", "osqp")


@pytest.mark.timeout(0)
def test_margins(capsys: Any) -> None:
    """What wider corridors cost in length, and gain in time."""
    model = ct.load("fleet-mission/paper")
    with capsys.disabled():
        print("\nmargin (cells)   curves / polylines   last robot back (s)")
    for margin in MARGINS:
        own = {"margin": margin, "routing": "kmeans-ac"}
        found = ct.solve(model, "staged", seed=1, backend_options=own)
        length = sum(lengths_of(one).sum() for one in found.plan.trajectories)
        shortest = float(found.statistics["polyline length"])
        with capsys.disabled():
            print(f"{margin:14g}   {length / shortest:18.4f}   {found.plan.end:19.1f}")


@pytest.mark.timeout(0)
def test_minimum_snap_backends(capsys: Any, monkeypatch: pytest.MonkeyPatch, limit: float) -> None:
    """The corridor of one robot, without limits and with them in nine tenths of the time they need."""
    model = ct.load("fleet-mission/paper")
    ways: list[Any] = []
    fly = staged.fly

    def noted(problem: Any, way: Any, *others: Any) -> Any:
        ways.append(way)
        return fly(problem, way, *others)

    monkeypatch.setattr(staged, "fly", noted)
    own = {"routing": "kmeans-ac"}
    ct.solve(model, "staged", seed=1, threads=1, backend_options=own)
    way = ways[0]
    points = way.knots.copy()
    inner = [k for k in range(len(points)) if k not in set(way.stops.tolist())]
    points[inner] = FREE
    times = [0.0, *times_along(model, way).cumsum()]
    boxes = {"corridor_lower": way.lower, "corridor_upper": way.upper}
    free = MinimumSnap(points, times, **boxes)
    first = slowed(model, ct.solve(free, "interior-point").plan)
    limits = {
        "velocity_limit": model.velocity_limit, "acceleration_limit": model.acceleration_limit
    }  # fmt: skip
    hurried = MinimumSnap(points, 0.9 * first.times, **boxes, **limits)
    for title, asked in (("corridor", free), ("corridor and limits", hurried)):
        with capsys.disabled():
            print(f"\n{title}, {asked.segments} segments: seconds, by the first's, objective")
        base = None
        for name in PROGRAMS:
            backend = find_backend(name, asked)
            if backend.missing():
                continue
            begin = time.perf_counter()
            answer = programmed(backend, asked, Request(time_limit=limit), 1)
            spent = time.perf_counter() - begin
            base = spent if base is None else base
            checked = None if answer.point is None else asked.verify(answer.point)
            said = f"{checked.objective:.6g}" if checked and checked.ok else str(answer.termination)
            with capsys.disabled():
                print(f"  {name:16s} {spent:7.2f}   {spent / base:6.1f}   {said}")
