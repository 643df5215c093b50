"""Plans and wall-clock times of all catalogue entries at short time limits, with nothing compiled.

::

    python tests/benchmarks/framework/short_limits.py records.jsonl --limits 1 3 10
    python tests/benchmarks/framework/short_limits.py records.jsonl --limits 1 --names "fleet/*"
    python tests/benchmarks/framework/short_limits.py records.jsonl --limits 1 --backends all
    python tests/benchmarks/framework/short_limits.py records.jsonl --limits 1 2 5 --backends interrupt

``--names`` accepts patterns of entries and files of instances. Each run is a process of its own with an empty cache of compiled code, and two processes run side by side.
Runs that the file of records holds already are not repeated. ``--backends all`` runs each native backend of
a model as well, and compares the recommended one with them. ``--backends interrupt`` runs each backend that
claims to stop soon after a stop request, by default on one larger entry per problem. ``--warm`` uses the
present cache of compiled code.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import crosstrack as ct
from crosstrack.instances import catalogue
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.contract.registry import backend_names, find_backend
from crosstrack.solvers.contract.selection import fitting

#: Seconds beyond the limit that a call may take: the last polls of the clock, and the verification.
GRACE = 0.5
#: Seconds beyond the limit after which a process is killed.
KILLED = 90.0
#: Relative difference of objectives up to which the recommended backend is as good as another one.
MARGIN = 0.01
#: Fleet with time windows among the public data, which only rich fleets' backends accept.
WINDOWS = str(
    Path(__file__).resolve().parents[4] / "shared" / "data" / "fleet-vrplib" / "small" / "RC208.vrp"
)
#: Larger entry of each problem, for the test of every backend that claims to be interruptible.
LARGER = (
    "attractor/hunt-long", "black-box/sphere-100", "error-correction/suspect-327", "fleet/max-10",
    "fleet-mission/paper", "flight/cloud", "grid-path/terrain", "guided-path/hard-20x20",
    "messenger/B-20-01", "minimum-derivative/jerk", "minimum-snap/random-100", "optimal-control/free-flying-robot",
    "resource-routing/network-40", "satellite-slew/roll-180",
    "sequential-ordering/random-100-100-30", "sideslip/serpentine", "time-allocation/lap-8s",
    "unknown-grid/large", WINDOWS,
)  # fmt: skip
#: Script of one process: name, backend and limit (0: none) in; a record out.
SOLVE = """
import json, sys, time
begin = time.perf_counter()
import crosstrack as ct
from crosstrack import compilation
name, backend, limit = sys.argv[1], sys.argv[2], float(sys.argv[3])
model, solve = ct.load(name), ct.solve
loaded, used = time.perf_counter(), time.process_time()
solution = solve(model, backend, time_limit=limit or None)
seconds, cpu = time.perf_counter() - loaded, time.process_time() - used
print("\\n" + json.dumps({
    "ran": solution.backend, "termination": solution.termination, "reason": solution.limit,
    "plan": solution.plan is not None, "objective": solution.primal_bound,
    "seconds": seconds, "cpu": cpu, "process_cpu": time.process_time(), "load": loaded - begin,
    "parts": {key: round(value, 3) for key, value in solution.seconds.items() if value > 0.01},
    "message": solution.message[:400],
}))
if compilation._process is not None:  # it compiles for later runs, which have another cache
    compilation._process.kill()
"""


def run(name: str, backend: str, limit: float, warm: bool = False) -> dict[str, Any]:
    """Return the record of one run in a new process, by default with an empty cache of compiled code."""
    record: dict[str, Any] = {"name": name, "backend": backend, "limit": limit}
    path = str(Path(name).resolve()) if Path(name).is_file() else name
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        begin = time.perf_counter()
        record["machine"] = os.getloadavg()[0]
        process = subprocess.Popen(
            [sys.executable, "-c", SOLVE, path, backend, str(limit)],
            env={
                **os.environ,
                "MPLBACKEND": "Agg",
                **({} if warm else {"NUMBA_CACHE_DIR": folder}),
            },
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            out, err = process.communicate(timeout=limit + KILLED)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            return {**record, "error": f"killed after {limit + KILLED:g} s"}
    record["process"] = time.perf_counter() - begin
    lines = out.splitlines()
    if process.returncode or not lines:
        return {**record, "error": err.strip().splitlines()[-1] if err.strip() else "no output"}
    return {**record, **json.loads(lines[-1])}


def interruptible(name: str) -> list[str]:
    """Return the names of the backends for an entry that claim to stop soon after a stop request."""
    model = ct.load(name)
    targets = [Job(model, backend).find_target() for backend in fitting(model)]
    return [target.backend.name for target in targets if target.backend.interrupts(target.kind)]


def native(name: str) -> list[str]:
    """Return the names of the installed native backends for an entry."""
    model = ct.load(name)
    backends = [find_backend(backend, model) for backend in backend_names()]
    return [
        backend.name
        for backend in backends
        if isinstance(model, backend.accepts)
        and not (backend.sees_hidden or backend.missing() or backend.refuses(model))
    ]


def main() -> None:
    """Run what is missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("records", type=Path)
    parser.add_argument("--limits", type=float, nargs="+", default=[1.0, 3.0, 10.0])
    parser.add_argument("--names", nargs="+")
    parser.add_argument("--backends", choices=("auto", "all", "interrupt"), default="auto")
    parser.add_argument(
        "--warm", action="store_true", help="use the present cache of compiled code"
    )
    parser.add_argument("--processes", type=int, default=2, help="processes side by side")
    options = parser.parse_args()
    done = read(options.records)
    every = {"auto": lambda name: [], "all": native, "interrupt": interruptible}[options.backends]
    patterns = options.names or (LARGER if options.backends == "interrupt" else ["*"])
    names = [
        entry.name
        for entry in catalogue.entries()
        if any(fnmatch(entry.name, pattern) for pattern in patterns)
    ]
    names += [pattern for pattern in patterns if Path(pattern).is_file()]
    runs = [
        (name, backend, limit)
        for limit in options.limits
        for name in names
        for backend in ["auto", *every(name)]
    ]
    missing = [key for key in runs if key not in done]
    begin = time.perf_counter()
    with ThreadPoolExecutor(options.processes) as pool, options.records.open("a") as file:
        records = pool.map(lambda key: run(*key, warm=options.warm), missing)
        for number, record in enumerate(records, 1):
            file.write(json.dumps(record) + "\n")
            file.flush()
            if number % 20 == 0:
                spent = time.perf_counter() - begin
                print(f"{number} of {len(missing)} runs, {spent:.0f} s", flush=True)
    done = read(options.records)
    report([done[key] for key in runs])


def read(path: Path) -> dict[tuple[str, str, float], dict[str, Any]]:
    """Return the records of a file by entry, backend and limit; the last one of each."""
    lines = path.read_text().splitlines() if path.exists() else []
    rows = [json.loads(line) for line in lines]
    return {(row["name"], row["backend"], row["limit"]): row for row in rows}


def report(rows: list[dict[str, Any]]) -> None:
    """Print a table per problem and limit, each run without a plan or over its limit, and each worse one."""
    groups: dict[tuple[str, float], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row["backend"] == "auto":
            problem = Path(row["name"]).name if Path(row["name"]).is_file() else row["name"]
            groups[problem.split("/")[0], row["limit"]].append(row)
        elif is_late(row):
            what = (
                row.get("error")
                or f"{row['seconds']:.2f} s, cpu {row['cpu']:.2f} s, {row['parts']}"
            )
            print(f"{row['name']} with {row['backend']} at {row['limit']:g} s: {what}")
    print(
        f"{'problem':<18}{'limit':>6}{'entries':>9}{'without plan':>14}{'over limit':>12}{'worst':>8}"
    )
    for (problem, limit), group in sorted(groups.items()):
        none, late = sum(map(is_without_plan, group)), sum(map(is_late, group))
        worst = max(row.get("seconds", float("nan")) for row in group)
        print(f"{problem:<18}{limit:>6g}{len(group):>9}{none:>14}{late:>12}{worst:>8.2f}")
    others: dict[tuple[str, float], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row.get("plan") and row["backend"] != "auto" and row["objective"] is not None:
            others[row["name"], row["limit"]].append(row)
    for row in rows:
        if row["backend"] != "auto":
            continue
        about = f"{row['name']} at {row['limit']:g} s"
        if "error" in row:
            print(f"{about}: {row['error']}")
            continue
        if is_late(row):
            print(f"{about}: {row['seconds']:.2f} s, {row['ran']}, {row['parts']}")
        best = min(
            others[row["name"], row["limit"]], key=lambda other: other["objective"], default=None
        )
        if is_without_plan(row):
            plan = "" if best is None else f"; {best['backend']} has {best['objective']:.6g}"
            print(f"{about}: {row['termination']}, {row['ran']}{plan}: {row['message'][:120]}")
        elif best is not None and row["objective"] is not None:
            above = row["objective"] - best["objective"]
            if above > MARGIN * abs(best["objective"]):
                print(
                    f"{about}: {row['ran']} {row['objective']:.6g}, "
                    f"{best['backend']} {best['objective']:.6g}"
                )


def is_without_plan(row: dict[str, Any]) -> bool:
    """Return whether a run has no plan although its instance is not proven infeasible."""
    return not row.get("plan") and row.get("termination") != "infeasible"


def is_late(row: dict[str, Any]) -> bool:
    """Return whether a call took longer than its limit and the grace."""
    return row.get("seconds", float("inf")) > row["limit"] + GRACE


if __name__ == "__main__":
    main()
