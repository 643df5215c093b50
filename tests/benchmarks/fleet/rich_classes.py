"""Gap to the best known solution by class of rich fleets: backends, and PyVRP called directly, at equal CPU time.

Each run is a process of its own with a limit on its CPU time, set-up included. A schedule checker that
shares no code with the package checks each plan of a backend. Results are appended to a file, and runs
found there are skipped, so that an interrupted campaign continues::

    python tests/benchmarks/fleet/rich_classes.py --seconds 30 --seeds 5
    python tests/benchmarks/fleet/rich_classes.py --files 1 --seconds 5 --only CVRP VRPTW

The files are those of ``../shared/data/fleet-vrplib``; each class prints the mean gap in per cent.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]
DATA = HERE.parents[4] / "shared" / "data" / "fleet-vrplib"
#: Per class: options of the reader, units of the published cost per unit of length, and PyVRP's rounding.
CLASSES: dict[str, tuple[dict[str, Any], float | None, str]] = {
    "CVRP": ({"rounded": True}, 1.0, "round"),
    "VRPB": ({"rounded": True}, 1.0, "round"),
    "VRPTW": ({"decimals": 1}, 1.0, "dimacs"),
    "PCVRPTW": ({"decimals": 1}, 10.0, "dimacs"),
    "MTVRPTWR": ({"decimals": 1}, 10.0, "dimacs"),
    "MDVRPTW": ({}, 1000.0, "exact"),
    "SDVRPTW": ({}, 1000.0, "exact"),
    "HFVRP": ({}, None, "exact"),
}
#: Units of PyVRP's cost by its rounding.
UNITS = {"round": 1.0, "dimacs": 10.0, "exact": 1000.0}
SOLVERS = ("native", "pyvrp", "ortools-routing")


def published(path: Path) -> tuple[int, float]:
    """Return the number of routes and the cost of the best known solution."""
    text = path.with_suffix(".sol").read_text()
    match = re.search(r"^Cost:?\s+(\S+)", text, re.M)
    assert match
    return len(re.findall("^Route", text, re.M)), float(match[1])


def best_known(path: Path, value: float) -> float:
    """Return the published cost in the units of `value`; those of HFVRP are in hundreds or thousandths."""
    _, cost = published(path)
    unit = CLASSES[path.parent.name][1]
    if unit is None:
        unit = 0.01 if cost < value else 1000.0
    return cost / unit


def run_native(path: Path, seed: int, seconds: float) -> dict[str, Any]:
    """Run PyVRP on its own reading of the file."""
    import pyvrp

    rounding = CLASSES[path.parent.name][2]
    data = pyvrp.read(path, rounding)
    result = pyvrp.solve(data, lambda _: time.process_time() > seconds, seed, collect_stats=False)
    value = result.cost() / UNITS[rounding] if result.is_feasible() else None
    return {"value": value, "work": result.num_iterations}


def run_backend(path: Path, name: str, seed: int, seconds: float) -> dict[str, Any]:
    """Run a backend, and check its plan with the schedule checker of the tests."""
    from fleet.rich_oracle import reject

    import crosstrack as ct
    from crosstrack.instances.fleet import read_vrplib
    from crosstrack.solvers import Limit
    from crosstrack.solvers.contract.stopping import Criterion

    class Cpu(Criterion):
        def reached(self, progress: Any) -> Limit | None:
            return Limit.TIME if time.process_time() > seconds else None

    routes, _ = published(path)
    vehicles = None if re.search("^VEHICLES", path.read_text(), re.M) else 2 * routes
    model = read_vrplib(path, vehicles, use_all=False, **CLASSES[path.parent.name][0])
    seeds = {"seed": seed} if name == "pyvrp" else {}
    answer = ct.solve(model, name, time_limit=60 * seconds, stop=Cpu(), **seeds)
    if answer.plan is None:
        return {"value": None, "message": answer.message}
    value = answer.verification.objective
    if model.prizes is not None:  # the published costs count the prizes that are not collected
        value += float(np.nansum(model.prizes))
    faults = [str(fault) for fault in reject(model, answer.plan)]
    work = answer.statistics.get("iterations", answer.statistics.get("solutions"))
    return {"value": value, "work": work, "faults": faults}


def run_one(path: Path, solver: str, seed: int, seconds: float) -> dict[str, Any]:
    """Return the result of one run in this process."""
    if solver == "native":
        result = run_native(path, seed, seconds)
    else:
        result = run_backend(path, solver, seed, seconds)
    value = result["value"]
    gap = None if value is None else 100.0 * (value / best_known(path, value) - 1.0)
    return result | {"gap": gap, "cpu": time.process_time()}


def jobs(options: argparse.Namespace) -> Iterator[tuple[Path, str, int]]:
    """Yield file, solver and seed of each run, one file of each class first."""
    for place in range(options.files):
        for kind in options.only:
            files = sorted(
                (DATA / kind).glob("*.vrp"), key=lambda path: (path.stat().st_size, path)
            )
            for seed in range(options.seeds):
                for solver in options.solvers if place < len(files) else ():
                    yield files[place], solver, seed


def report(rows: list[dict[str, Any]]) -> None:
    """Print the mean gap per class and solver, the runs without a plan and the rejected plans."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["file"].split("/")[0], row["solver"]].append(row)
    for (kind, solver), runs in sorted(groups.items()):
        gaps = [row["gap"] for row in runs if row.get("gap") is not None]
        mean = f"{np.mean(gaps):7.2f} %" if gaps else "      - "
        rejected = sum(bool(row.get("faults")) for row in runs)
        print(
            f"{kind:10} {solver:16} {mean}  runs {len(runs)}, without plan {len(runs) - len(gaps)}, "
            f"rejected {rejected}"
        )


def main() -> None:
    """Run the missing runs, append their results, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="CPU seconds per run")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--files", type=int, default=99, help="files per class, the smallest first")
    parser.add_argument("--only", nargs="+", default=list(CLASSES), choices=list(CLASSES))
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=SOLVERS)
    parser.add_argument(
        "--out", type=Path, default=HERE.parents[3] / "build" / "rich-classes.jsonl"
    )
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        path, solver, seed = options.one
        print(json.dumps(run_one(Path(path), solver, int(seed), options.seconds)))
        return
    options.out.parent.mkdir(parents=True, exist_ok=True)
    lines = options.out.read_text().splitlines() if options.out.exists() else []
    rows = [row for row in map(json.loads, lines) if row["seconds"] == options.seconds]
    present = {(row["file"], row["solver"], row["seed"]) for row in rows}
    for path, solver, seed in jobs(options):
        name = f"{path.parent.name}/{path.stem}"
        if (name, solver, seed) in present:
            continue
        command = [sys.executable, str(HERE), "--seconds", str(options.seconds)]
        done = subprocess.run(
            [*command, "--one", str(path), solver, str(seed)],
            capture_output=True,
            text=True,
            check=False,
        )
        row = {"file": name, "solver": solver, "seed": seed, "seconds": options.seconds}
        output = done.stdout.strip().splitlines()
        row |= json.loads(output[-1]) if done.returncode == 0 else {"error": done.stderr[-500:]}
        rows.append(row)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
    report(rows)


if __name__ == "__main__":
    main()
