"""Speed and quality of `fleet-search`: steps per second, longest routes, and sums beside other searches.

Writes tables of ``docs/measured/fleet.json``. All seconds are CPU seconds; runs have one thread. LKH is the package
`elkai` of another Python: ``python tests/benchmarks/fleet/engine.py [--lkh PYTHON_WITH_ELKAI] [table …]``.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.fleet.test_min_max import DIGIT, KNOWN, model_of  # noqa: E402
from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.fleet import read_vrplib  # noqa: E402
from crosstrack.jit import compile_always  # noqa: E402
from crosstrack.models import FleetRouting  # noqa: E402
from crosstrack.solvers import Limit, Target  # noqa: E402
from crosstrack.solvers.contract.stopping import Criterion  # noqa: E402
from crosstrack.solvers.fleet.candidate import Candidate, scaled  # noqa: E402
from crosstrack.solvers.fleet.giant_tour import GiantTour  # noqa: E402
from crosstrack.solvers.fleet.start import cut_tour  # noqa: E402

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "fleet-vrplib" / "CVRP"
VEHICLES, NODES, STEPS = (1, 5, 20, 100), 1000, 4000
#: As many points as rat575, and kicks of a tour.
POINTS, KICKS = 575, (5_000, 20_000)
#: CPU seconds of a run on an instance with at most 200 nodes, and of one for the longest route.
SECONDS, LONGEST = 5.0, 5.0
#: Runs for each longest route.
SEEDS = 5
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


def tours(python: str) -> list[list[Any]]:
    """Return the lengths of one tour through random points after each number of kicks, beside LKH's."""
    rows: list[list[Any]] = []
    for seed in range(2):
        points = np.random.default_rng(seed).integers(0, 1000, (POINTS, 2)) * 1.0
        model = FleetRouting(1, points=points, metric="rounded", objective="sum")
        matrix = json.dumps(model.distances.astype(int).tolist())
        answer = subprocess.run(
            [python, "-c", LKH], input=matrix, capture_output=True, text=True, check=True
        )
        known, seconds = map(float, answer.stdout.split())
        rows.append([seed, "LKH, one run", known, 0.0, seconds])
        tour = GiantTour.of(model, scaled(model))
        assert tour is not None
        for kicks in KICKS:
            begin = spent()
            routes, _ = tour.improve(cut_tour(model), kicks, FLAG, np.random.default_rng(1))
            used = spent() - begin
            stops = [0, *routes[0], 0]
            length = float(model.legs(stops[:-1], stops[1:]).sum())
            above = 100 * (length / known - 1)
            rows.append([seed, f"`fleet-search`, {kicks} kicks", length, above, used])
    return rows


class Cpu(Criterion):
    """A limit on the CPU seconds of a run."""

    def __init__(self, seconds: float) -> None:
        self.end = spent() + seconds

    def reached(self, progress: Any) -> Limit | None:
        """Return the limit if the seconds are used."""
        return Limit.TIME if spent() > self.end else None


def sums() -> list[list[str]]:
    """Return our sum and PyVRP's of instances with at most 200 nodes, each vehicle used."""
    rows = []
    for path in sorted(DATA.glob("*.vrp")):
        model = read_vrplib(path, rounded=True)
        if model.size > 200:
            continue
        values = [
            ct.solve(
                model, name, time_limit=20 * SECONDS, stop=Cpu(SECONDS), seed=1, threads=1
            ).primal_bound
            for name in ("fleet-search", "pyvrp")
        ]
        rows.append(
            [path.stem, *("no plan" if value is None else f"{value:.0f}" for value in values)]
        )
        print(*rows[-1], flush=True)
    return rows


def longest() -> Iterator[list[Any]]:
    """Yield the seeds that reach each known value of a longest route, the best value and the median time."""
    for name, vehicles, known in ((f, m, v) for f, all_ in KNOWN.items() for m, v in all_.items()):
        model, best, times = model_of(name, vehicles), [], []
        for seed in range(SEEDS):
            begin = spent()
            stop = Target(known + DIGIT) | Cpu(LONGEST)
            run = ct.solve(
                model, "fleet-search", time_limit=20 * LONGEST, seed=seed, threads=1, stop=stop
            )
            assert run.verified and run.primal_bound is not None
            best.append(run.primal_bound)
            times.append(spent() - begin)
        reached = sum(value <= known + DIGIT for value in best)
        print(name, vehicles, reached, min(best), median(times), flush=True)
        yield [f"{name}/{vehicles}", known, reached, min(best), median(times)]


def main() -> None:
    """Measure the tables that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="*", default=("steps", "longest", "tour", "sums"))
    parser.add_argument("--lkh", default=sys.executable, help="Python that has elkai")
    given = parser.parse_args()
    compile_always()
    for table in given.tables:
        packages = ["numba"]
        if table == "steps":
            rows: Any = zip(VEHICLES, steps_per_second("max"), steps_per_second("sum"), strict=True)
            columns = {"vehicles": "d", "steps per second, `max`": ".0f", "`sum`": ".0f"}
            said = f"Nodes: {NODES}."
        elif table == "longest":
            ct.solve(model_of("eil51", 3), "fleet-search", time_limit=5)  # compiles
            rows = longest()
            columns = {"file and vehicles": "", "known": ".2f", "seeds that reach it": "d"}
            columns |= {"best": ".2f", "median CPU s": ".1f"}
            said = f"Seeds: {SEEDS}. CPU seconds of each run: at most {LONGEST:g}, one thread."
        elif table == "tour":
            rows, said = tours(given.lkh), f"Random points: {POINTS}."
            columns = {
                "seed": "d",
                "search": "",
                "length": ".0f",
                "above LKH in %": ".2f",
                "CPU s": ".1f",
            }
        else:
            rows, packages = sums(), ["numba", "pyvrp"]
            columns = {"file": "", "`fleet-search`": "", "`pyvrp`": ""}
            said = (
                f"CPU seconds of each run: {SECONDS:g}, one thread. Seed: 1. Every vehicle is used."
            )
        write("fleet", table, __file__, columns, rows, packages, said)


if __name__ == "__main__":
    main()
