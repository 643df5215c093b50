"""Speed and quality of `fleet-search`: steps per second by vehicles, and sums beside other searches.

All numbers are CPU seconds or ratios within one run. LKH is called through the package `elkai` of another
Python if its path is given: ``python tests/benchmarks/fleet/engine.py [PYTHON_WITH_ELKAI]``.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

import crosstrack as ct  # noqa: E402
from crosstrack.instances.fleet import read_vrplib  # noqa: E402
from crosstrack.jit import compile_always  # noqa: E402
from crosstrack.models import FleetRouting  # noqa: E402
from crosstrack.solvers.fleet.candidate import Candidate, scaled  # noqa: E402
from crosstrack.solvers.fleet.giant_tour import GiantTour  # noqa: E402
from crosstrack.solvers.fleet.start import cut_tour  # noqa: E402

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "fleet-vrplib" / "CVRP"
VEHICLES, NODES, STEPS = (1, 5, 20, 100), 1000, 4000
#: As many points as rat575, and kicks of a tour.
POINTS, KICKS = 575, (5_000, 20_000)
#: Seconds of a run on an instance with at most 200 nodes.
SECONDS = 20.0
FLAG = np.zeros(1, np.int8)
LKH = """
import elkai, json, resource, sys
matrix = json.load(sys.stdin)
tour = elkai.DistanceMatrix(matrix).solve_tsp(runs=1)
used = resource.getrusage(resource.RUSAGE_SELF)
print(sum(matrix[a][b] for a, b in zip(tour, tour[1:])), used.ru_utime)
"""


def spent() -> float:
    """Return the CPU seconds of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def steps_per_second(objective: str) -> list[float]:
    """Return the steps per CPU second for each number of vehicles."""
    points = np.random.default_rng(0).random((NODES + 1, 2))
    rates = []
    for vehicles in VEHICLES:
        fleet = scaled(FleetRouting(vehicles, points=points, objective=objective))
        candidate = Candidate(fleet, [])
        candidate.anneal(0.02, 10, FLAG, np.random.default_rng(0))
        best = 0.0
        for _ in range(3):
            begin = spent()
            done = candidate.anneal(0.02, STEPS, FLAG, np.random.default_rng(0))
            best = max(best, done / (spent() - begin))
        rates.append(best)
    return rates


def sums(python: str | None) -> None:
    """Print the sum of one vehicle through random points, and LKH's length."""
    for seed in range(2):
        points = np.random.default_rng(seed).integers(0, 1000, (POINTS, 2)) * 1.0
        model = FleetRouting(1, points=points, metric="rounded", objective="sum")
        known, line = None, "no LKH"
        if python is not None:
            matrix = json.dumps(model.distances.astype(int).tolist())
            answer = subprocess.run(
                [python, "-c", LKH], input=matrix, capture_output=True, text=True, check=True
            )
            known, seconds = map(float, answer.stdout.split())
            line = f"LKH {known:.0f} in {seconds:.1f} s"
        tour = GiantTour.of(model, scaled(model))
        assert tour is not None
        for kicks in KICKS:
            begin = spent()
            routes, _ = tour.improve(cut_tour(model), kicks, FLAG, np.random.default_rng(1))
            stops = [0, *routes[0], 0]
            length = float(model.legs(stops[:-1], stops[1:]).sum())
            above = "" if known is None else f", {length / known - 1:+.2%}"
            print(
                f"sum seed {seed}: {line}; {kicks} kicks {length:.0f}{above} in {spent() - begin:.1f} s"
            )


def capacitated() -> None:
    """Print our sum and PyVRP's of instances with at most 200 nodes, each vehicle used."""
    for path in sorted(DATA.glob("*.vrp")):
        model = read_vrplib(path, rounded=True)
        if model.size > 200:
            continue
        for backend in ("fleet-search", "pyvrp"):
            begin = spent()
            run = ct.solve(model, backend, time_limit=SECONDS, seed=1, threads=1)
            print(f"{path.stem} {backend}: {run.primal_bound} in {spent() - begin:.1f} s")


if __name__ == "__main__":
    compile_always()
    for objective in ("max", "sum"):
        rates = steps_per_second(objective)
        shares = ", ".join(f"m = {m}: {r:.0f}" for m, r in zip(VEHICLES, rates, strict=True))
        print(f"{objective}, n = {NODES}, steps per second: {shares}")
    sums(sys.argv[1] if len(sys.argv) > 1 else None)
    capacitated()
