"""Gap to the best known solution by class of rich fleets: backends, PyVRP called directly and VROOM, at equal CPU time.

Each run is a process of its own with a limit on its CPU time, set-up included. A schedule checker that
shares no code with the package checks each plan. Solvers without a seed run once. Results are appended to a
file, and runs found there are skipped, so that an interrupted campaign continues::

    python tests/benchmarks/fleet/rich_classes.py --seconds 30 --seeds 5
    python tests/benchmarks/fleet/rich_classes.py --files 1 --seconds 5 --only CVRP VRPTW
    python tests/benchmarks/fleet/rich_classes.py --files 1 --seconds 30 --write
    python tests/benchmarks/fleet/rich_classes.py --seconds 30 --seeds 5 --stored --write  # starts no runs

The files are those of ``../shared/data/fleet-vrplib``; each class prints the mean gap in per cent, and ``--write``
writes the table "rich-classes" of ``docs/measured/fleet.json``. VROOM is the package ``pyvroom``.
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
from datetime import timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402

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
#: Solvers and their names in the table.
SOLVERS = {
    "native": "PyVRP itself",
    "pyvrp": "`pyvrp`",
    "ortools-routing": "`ortools-routing`",
    "vroom": "VROOM",
}
#: Solvers with a seed; the others run once.
SEEDED = ("native", "pyvrp")
#: Classes that VROOM's model contains.
IN_VROOM = ("CVRP", "VRPTW", "MDVRPTW", "SDVRPTW", "HFVRP")
#: Steps of VROOM's units per unit of length and time, and of its costs per unit of cost and length.
VROOM_STEPS, VROOM_COSTS = 100, 1000
#: VROOM's exploration level: its highest one.
LEVEL = 5


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
    if not result.is_feasible():
        return {"value": None}
    model = read_model(path)
    kinds = np.repeat(
        np.arange(data.num_vehicle_types), [kind.num_available for kind in data.vehicle_types()]
    )
    free = {int(kind): iter(np.flatnonzero(kinds == kind)) for kind in np.unique(kinds)}
    routes: list[list[int]] = [[] for _ in range(max(len(kinds), model.vehicles))]
    for route in result.best.routes():
        stops = list(route)[1:-1]
        routes[next(free[route.vehicle_type()])] = [
            (data.client if stop.is_client() else data.depot)(stop.idx).location for stop in stops
        ]
    checked = judge(model, model.with_schedule(routes[: model.vehicles]))
    cost = result.cost() / UNITS[rounding]
    return {"value": cost, "work": result.num_iterations, "faults": checked["faults"]}


def read_model(path: Path) -> Any:
    """Return the model of a file; without a number of vehicles, twice as many as in the best known solution."""
    from crosstrack.instances.fleet import read_vrplib

    routes, _ = published(path)
    vehicles = None if re.search("^VEHICLES", path.read_text(), re.M) else 2 * routes
    return read_vrplib(path, vehicles, use_all=False, **CLASSES[path.parent.name][0])


def judge(model: Any, plan: Any) -> dict[str, Any]:
    """Return the value of a plan and its faults by the schedule checker of the tests."""
    from fleet.rich_oracle import reject

    value = model.verify(plan).objective
    if model.prizes is not None:  # the published costs count the prizes that are not collected
        value += float(np.nansum(model.prizes))
    return {"value": value, "faults": [str(fault) for fault in reject(model, plan)]}


def run_backend(path: Path, name: str, seed: int, seconds: float) -> dict[str, Any]:
    """Run a backend."""
    import crosstrack as ct
    from crosstrack.solvers import Limit
    from crosstrack.solvers.contract.stopping import Criterion

    class Cpu(Criterion):
        def reached(self, progress: Any) -> Limit | None:
            return Limit.TIME if time.process_time() > seconds else None

    model = read_model(path)
    seeds = {"seed": seed} if name == "pyvrp" else {}
    answer = ct.solve(model, name, time_limit=60 * seconds, stop=Cpu(), **seeds)
    if answer.plan is None:
        return {"value": None, "message": answer.message}
    work = answer.statistics.get("iterations", answer.statistics.get("solutions"))
    return judge(model, answer.plan) | {"work": work}


def run_vroom(path: Path, seconds: float) -> dict[str, Any]:
    """Run VROOM on one thread until it ends or its time limit, which counts waiting for a processor."""
    import vroom

    model, steps = read_model(path), VROOM_STEPS

    def whole(value: Any) -> Any:
        return np.ceil(np.asarray(value) * steps - 1e-9).astype(int)

    spans = [None if each is None else each[0] for each in model.windows or [None] * model.size]

    def window(node: int, early: float, late: float) -> Any:
        begin, end = spans[node] or (0.0, np.inf)
        first, last = max(begin, early), min(end, late)
        return None if np.isinf(last) else vroom.TimeWindow(int(whole(first)), int(last * steps))

    program = vroom.Input()
    lengths = whole(model.distances)
    program.set_durations_matrix("car", lengths)
    program.set_distances_matrix("car", lengths)
    names = {name for needed in model.requires or () for name in needed}
    skill = {name: number for number, name in enumerate(sorted(names), 1)}
    for k in range(model.vehicles):
        rate = 1.0 if model.distance_cost is None else float(model.distance_cost[k])
        fixed = 0.0 if model.fixed_cost is None else float(model.fixed_cost[k])
        home = int(model.homes[k])
        # A cost per km of 1000 c is c per unit of the matrix.
        costs = vroom.VehicleCosts(round(fixed * steps), 0, round(VROOM_COSTS * rate))
        longest = np.inf if model.max_duration is None else float(model.max_duration[k])
        known = set() if model.skills is None else {skill[x] for x in model.skills[k] if x in skill}
        spare = {} if np.isinf(longest) else {"max_travel_time": int(longest * steps)}
        span = window(home, 0.0, np.inf)
        program.add_vehicle(
            vroom.Vehicle(
                k, home, home, capacity=[int(model.capacity[k])], costs=costs, skills=known,
                **spare, **({} if span is None else {"time_window": span}),
            )
        )  # fmt: skip
    for node in model.customers.tolist():
        needed = {skill[name] for name in (model.requires[node] if model.requires else ())}
        span = window(node, 0.0, np.inf)
        service = 0 if model.service is None else int(whole(model.service[node]))
        program.add_job(
            vroom.Job(
                node, node, default_service=service, delivery=[int(model.demands[node])],
                skills=needed, time_windows=[] if span is None else [span],
            )
        )  # fmt: skip
    left = timedelta(seconds=max(0.0, seconds - time.process_time()))
    answer = program.solve(exploration_level=LEVEL, nb_threads=1, timeout=left)
    if answer.summary.unassigned:
        return {"value": None, "message": f"{answer.summary.unassigned} nodes without a route"}
    routes: list[list[int]] = [[] for _ in range(model.vehicles)]
    table = answer.routes[answer.routes["type"] == "job"]
    for k, node in zip(table["vehicle_id"], table["id"], strict=True):
        routes[int(k)].append(int(node))
    return judge(model, model.with_schedule(routes)) | {"work": None}


def run_one(path: Path, solver: str, seed: int, seconds: float) -> dict[str, Any]:
    """Return the result of one run in this process."""
    if solver == "native":
        result = run_native(path, seed, seconds)
    elif solver == "vroom":
        result = run_vroom(path, seconds)
    else:
        result = run_backend(path, solver, seed, seconds)
    value = result["value"]
    gap = None if value is None else 100.0 * (value / best_known(path, value) - 1.0)
    return result | {"gap": gap, "cpu": time.process_time()}


def jobs(options: argparse.Namespace) -> Iterator[tuple[Path, str, int]]:
    """Yield file, solver and seed of each run: first one seed of one file of each class."""
    for place in range(options.files):
        for seed in range(options.seeds):
            for kind in options.only:
                files = sorted(
                    (DATA / kind).glob("*.vrp"), key=lambda path: (path.stat().st_size, path)
                )
                for solver in options.solvers if place < len(files) else ():
                    contained = solver != "vroom" or kind in IN_VROOM
                    if contained and (seed == 0 or solver in SEEDED):
                        yield files[place], solver, seed


def report(rows: list[dict[str, Any]], seconds: float, write_table: bool) -> None:
    """Print the mean gap per class and solver, with the rejected plans, and write the table if required."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["file"].split("/")[0], row["solver"]].append(row)
    table = []
    for kind in CLASSES:
        runs = [run for solver in SOLVERS for run in groups[kind, solver]]
        if not runs:
            continue
        cells: list[str] = []
        for solver in SOLVERS:
            own = groups[kind, solver]
            gaps = [run["gap"] for run in own if run.get("gap") is not None]
            lacking = f", {len(own) - len(gaps)} without plan" * (len(gaps) < len(own))
            spent = ""
            if solver == "vroom" and own:
                spent = f" ({np.mean([run['cpu'] for run in own]):.0f} s)"
            cells.append(f"{np.mean(gaps):.2f}{spent}{lacking}" if gaps else lacking.strip(", "))
            if any("does not cover" in run.get("error", "") for run in own):
                cells[-1] = "refused"
        files = sorted({run["file"].split("/")[1] for run in runs})
        seeds = len({run["seed"] for run in runs})
        counts = {
            name: sum(bool(run.get("faults")) for run in groups[kind, key])
            for key, name in SOLVERS.items()
        }
        rejected = ", ".join(f"{count} of {name}" for name, count in counts.items() if count) or "0"
        table.append([kind, ", ".join(files), seeds, *cells, rejected])
        print(*table[-1], sep=" | ")
    if write_table:
        columns = {"class": "", "files": "", "seeds": "d"} | dict.fromkeys(SOLVERS.values(), "")
        said = (
            f"Mean gap to the best known solutions in per cent after {seconds:g} CPU seconds on one thread, set-up "
            "included. The seeds are those of PyVRP; OR-Tools and VROOM have none and run once per file. "
            f"VROOM {vroom_version()} may end earlier, its CPU seconds are in parentheses; it limits the travel time of a "
            "vehicle, not its duration. An empty cell is a class that it does not contain. The last column counts the "
            "plans that an independent schedule checker rejects."
        )
        write(
            "fleet", "rich-classes", str(HERE), columns | {"rejected": ""}, table,
            ("pyvrp", "ortools"), said,
        )  # fmt: skip


def vroom_version() -> str:
    """Return the version of pyvroom, empty if it is not installed."""
    try:
        return version("pyvroom")
    except ImportError:
        return ""


def main() -> None:
    """Run the missing runs, append their results, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="CPU seconds per run")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--files", type=int, default=99, help="files per class, the smallest first")
    parser.add_argument("--only", nargs="+", default=list(CLASSES), choices=list(CLASSES))
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument(
        "--stored",
        action="store_true",
        help="report the files with all seeds in the file of results",
    )
    parser.add_argument("--write", action="store_true", help="write the table of the page")
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
    if options.stored:
        expected: dict[str, set[tuple[str, str, int]]] = defaultdict(set)
        for path, solver, seed in jobs(options):
            name = f"{path.parent.name}/{path.stem}"
            expected[name].add((name, solver, seed))
        rows = [row for row in rows if expected[row["file"]] <= present]
        report(rows, options.seconds, options.write)
        return
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
    report(rows, options.seconds, options.write)


if __name__ == "__main__":
    main()
