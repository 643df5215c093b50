"""Gaps of column generation beside the bounds of fleet-search and of HiGHS, for equal processor time.

Writes the table "column-generation" of ``docs/measured/fleet.json``. Rows of earlier calls stay:
``python tests/benchmarks/fleet/column_generation.py [--seconds 60] [--highs] [row …]``. A row is the name
of a file in ``shared/data`` and the number of vehicles, such as ``eil51/3`` (the longest route),
``eil51/3/sum``, ``X-n101-k25/26`` (capacities, sum) or ``RC208-25/10`` (windows, sum). A search provides the
first plan. Then each backend runs until it has used the seconds of processor time. The gap is relative to the
best plan of all backends.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.fleet import read_tsplib, read_vrplib  # noqa: E402
from crosstrack.jit import compile_always  # noqa: E402
from crosstrack.models import FleetRouting  # noqa: E402
from crosstrack.models.fleet import FleetPlan  # noqa: E402
from crosstrack.solvers.contract.backend import Limit, Request  # noqa: E402
from crosstrack.solvers.contract.stopping import Criterion  # noqa: E402
from crosstrack.solvers.fleet.bound import lower_bound  # noqa: E402
from crosstrack.solvers.fleet.column_generation import ColumnGeneration  # noqa: E402
from crosstrack.solvers.fleet.fleet_search import FleetSearch  # noqa: E402

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
#: Seconds of processor time of the search that provides the first plan.
FIRST = 10.0
ROWS = (
    "eil51/2", "eil51/3", "eil51/5", "berlin52/3", "eil76/5", "rat99/5", "kroA100/5", "eil51/3/sum",
    "X-n101-k25/26", "X-n110-k13/13", "X-n120-k6/6", "RC208-25/10", "RC208-50/25",
)  # fmt: skip


def read(row: str) -> FleetRouting:
    """Return the model of a row."""
    name, vehicles, *objective = row.split("/")
    if name.startswith("X-"):
        path = DATA / "fleet-vrplib" / "CVRP" / f"{name}.vrp"
        return read_vrplib(path, int(vehicles), rounded=True, use_all=False)
    if name.startswith("RC208"):
        return solomon(DATA / "fleet-vrplib" / "small" / "RC208.vrp", int(name[6:]), int(vehicles))
    kind = objective[0] if objective else "max"
    return read_tsplib(DATA / "tsplib" / f"{name}.tsp", int(vehicles), objective=kind)


def solomon(path: Path, customers: int, vehicles: int) -> FleetRouting:
    """Return the first customers of a file with windows; distances have one decimal, cut off."""
    model, n = read_vrplib(path, vehicles, decimals=1), customers + 1
    assert model.demands is not None and model.service is not None and model.windows is not None
    return FleetRouting(
        vehicles, costs=model.distances[:n, :n], service=model.service[:n], windows=model.windows[:n],
        demands=model.demands[:n], capacity=model.capacity, objective="sum",
    )  # fmt: skip


def first_plan(model: FleetRouting) -> FleetPlan:
    """Return a plan of a search."""
    begin = time.process_time()

    class Cpu(Criterion):
        def reached(self, progress: Any) -> Limit | None:
            return Limit.TIME if time.process_time() - begin > FIRST else None

    name, options = "fleet-search", {"bound": False}
    if model.is_rich:
        name, options = "pyvrp", {}
    answer = ct.solve(
        model, name, time_limit=100 * FIRST, stop=Cpu(), seed=1, backend_options=options
    )
    assert answer.plan is not None
    return answer.plan


def column_generation(model: FleetRouting, seconds: float, warm: FleetPlan | None) -> Any:
    """Return the answer within seconds of processor time, and the seconds of its last bound."""
    backend = ColumnGeneration()
    request = Request(seed=1, warm_start=warm, options=backend.checked_options({}))
    begin, last = time.process_time(), [0.0]

    def note(_: float) -> None:
        last[0] = time.process_time() - begin

    def watch() -> None:
        while not done.wait(0.1):
            if time.process_time() - begin > seconds:
                request.control.stop(Limit.TIME)

    request.control._proven = note
    done = threading.Event()
    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    answer = backend.run(model, request)
    done.set()
    return answer, last[0]


def measure(row: str, seconds: float, highs: bool) -> list[Any]:
    """Return one row of the table."""
    model = read(row)
    warm = first_plan(model)
    answer, last = column_generation(model, seconds, warm)
    value = answer.primal_bound
    assert value is not None and answer.dual_bound <= value
    earlier = lower_bound(model, np.zeros(1, np.int8)) if not model.is_rich else None
    program = None
    if highs and not model.is_rich:
        program = ct.solve(model, "highs", time_limit=seconds, warm_start=warm).dual_bound

    def gap(bound: float | None) -> str:
        return "" if bound is None else f"{100 * (value - bound) / value:.2f}"

    proven = "yes" if answer.termination == "optimal" else ""
    return [row, len(model.customers), f"{value:.2f}", gap(earlier), gap(program),
            gap(answer.dual_bound), proven, f"{last:.0f}", seconds]  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", default=ROWS)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--highs", action="store_true")
    given = parser.parse_args()
    compile_always()
    tiny = FleetRouting(2, points=np.random.default_rng(0).random((16, 2)))
    options = FleetSearch().checked_options({})
    FleetSearch().run(tiny, Request(seed=1, options=options))  # compiles
    columns = {
        "file and vehicles": "", "nodes": "d", "best plan": "", "fleet-search, gap in %": "",
        "HiGHS, gap in %": "", "column-generation, gap in %": "", "optimal": "",
        "last bound after s": "", "limit in s": "g",
    }  # fmt: skip
    for name in given.rows:
        entry = measure(name, given.seconds, given.highs)
        print(entry, flush=True)
        write(
            "fleet", "column-generation", __file__, columns, [entry], ("numba", "highspy"), merge=True,
            order=[(row,) for row in ROWS],
        )  # fmt: skip
