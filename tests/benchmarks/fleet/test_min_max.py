"""Min-max routes on TSPLIB: share of seeds that reach the known values, and their time, with rivals.

Distances are real-valued and city 1 is the depot. A run stops at the known value. Slowness does not
fail the test. Run with ``make bench``, or with another time per run and number of seeds::

    CROSSTRACK_FLEET_SECONDS=10 CROSSTRACK_FLEET_SEEDS=10 pytest tests/benchmarks/fleet/test_min_max.py -s
"""

from __future__ import annotations

import os
from pathlib import Path
from statistics import median
from typing import Any

import pytest

import crosstrack as ct
from crosstrack.instances.fleet import read_tsplib
from crosstrack.models import FleetRouting
from crosstrack.solvers import Target

SECONDS = float(os.environ.get("CROSSTRACK_FLEET_SECONDS", "10"))
SEEDS = int(os.environ.get("CROSSTRACK_FLEET_SEEDS", "10"))
DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "tsplib"
#: Known values of the longest route, by file and number of vehicles, to two decimals.
KNOWN = {
    "eil51": {2: 222.73, 3: 159.57, 5: 118.13, 7: 112.07},
    "berlin52": {2: 4110.21, 3: 3069.59, 5: 2440.92, 7: 2440.92},
    "eil76": {2: 280.85, 3: 195.72, 5: 142.88, 7: 127.56},
    "rat99": {2: 665.99, 3: 517.72, 5: 459.29, 7: 438.65},
    "kroA200": {3: 10691.03, 5: 7418.87},
}
RIVALS = ("pyvrp", "ortools-routing")
#: Half of the last digit that is known.
DIGIT = 0.00501


def model_of(name: str, vehicles: int) -> FleetRouting:
    path = DATA / f"{name}.tsp"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there")
    return read_tsplib(path, vehicles, objective="max")


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", KNOWN)
def test_seeds_that_reach_known_values(name: str, capsys: Any) -> None:
    for vehicles, known in KNOWN[name].items():
        model = model_of(name, vehicles)
        ct.solve(model, "fleet-search", time_limit=0.5)  # compiled before
        runs = [
            ct.solve(
                model, "fleet-search", time_limit=SECONDS, seed=seed, stop=Target(known + DIGIT)
            )
            for seed in range(SEEDS)
        ]
        assert all(run.verified for run in runs)
        best = [run.primal_bound for run in runs]
        reached = sum(value <= known + DIGIT for value in best)
        with capsys.disabled():
            print(
                f"\n{name} m={vehicles}: known {known:.2f}, reached by {reached} of {SEEDS}, "
                f"median {median(best) / known - 1:+.3%}, best {min(best):.2f}, "
                f"median {median(run.seconds['solve'] for run in runs):.1f} s"
            )


@pytest.mark.timeout(0)
@pytest.mark.parametrize(("name", "vehicles"), [("eil51", 3), ("rat99", 5), ("kroA200", 3)])
def test_rivals_at_equal_time(name: str, vehicles: int, capsys: Any) -> None:
    model = model_of(name, vehicles)
    for rival in RIVALS:
        run = ct.solve(model, rival, time_limit=SECONDS, seed=1)
        with capsys.disabled():
            value = run.primal_bound
            above = "no plan" if value is None else f"{value / KNOWN[name][vehicles] - 1:+.2%}"
            print(f"\n{name} m={vehicles} {rival}: {above}")
