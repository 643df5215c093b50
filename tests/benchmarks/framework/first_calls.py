"""CPU and wall-clock seconds of the first call with an empty cache of compiled code, and of the second.

::

    python tests/benchmarks/framework/first_calls.py records.jsonl
    python tests/benchmarks/framework/first_calls.py records.jsonl --names "fleet/*" --each 2

Each catalogue entry is solved by two processes in turn, with the recommended backend and no limit; each
Python block of README.md is run. The first process has an empty cache of compiled code. The second starts
when the background compiler of the first has ended. CPU is that of the calling process, with the import and
the loading of the model; that of its children, with the background compiler, is a column of its own. Runs
that the file of records holds already are not repeated.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from fnmatch import fnmatch
from pathlib import Path
from statistics import median
from typing import Any

from crosstrack.instances import catalogue

ROOT = Path(__file__).resolve().parents[3]
#: Largest CPU time of a first call, s.
MOST = 3.0
#: Seconds after which a process is killed.
KILLED = 120.0
#: Script of one process: the name of an entry, or the code of a block, in; a record out.
SOLVE = """
import json, resource, sys, time
begin = time.perf_counter()
import crosstrack as ct
from crosstrack import compilation
name, code = sys.argv[1:]
if code:
    exec(code, {"ct": ct})
    what = {"backend": "", "compile": 0.0}
else:
    solution = ct.solve(ct.load(name))
    what = {"backend": solution.backend, "compile": solution.seconds.get("compile", 0.0)}
record = {"cpu": time.process_time(), "wall": time.perf_counter() - begin, **what}
process = compilation._process
if process is not None:  # let it end, for the second process
    compilation._bodies.put(None)
    compilation._writer.join()
    process.stdin.close()
    process.wait()
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
print("\\n" + json.dumps({**record, "children": usage.ru_utime + usage.ru_stime}))
"""


#: Python blocks of README.md, by name.
BLOCKS = {
    f"README/{number}": code
    for number, code in enumerate(
        re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL), 1
    )
}


def run(name: str, folder: str) -> dict[str, Any]:
    """Return the record of one process whose cache of compiled code is in `folder`."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", SOLVE, name, BLOCKS.get(name, "")],
            env={**os.environ, "MPLBACKEND": "Agg", "NUMBA_CACHE_DIR": folder},
            cwd=folder, capture_output=True, text=True, timeout=KILLED, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"error": f"killed after {KILLED:g} s"}
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        return {"error": (done.stderr.strip().splitlines() or ["no output"])[-1]}
    record: dict[str, Any] = json.loads(lines[-1])
    return record


def main() -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("records", type=Path)
    parser.add_argument("--names", nargs="+", default=["*"])
    parser.add_argument("--each", type=int, help="largest number of entries per problem")
    options = parser.parse_args()
    done: dict[str, dict[str, Any]] = {}
    if options.records.exists():
        rows = [json.loads(line) for line in options.records.read_text().splitlines()]
        done = {row["name"]: row for row in rows}
    names: dict[str, list[str]] = defaultdict(list)
    for name in (*BLOCKS, *(entry.name for entry in catalogue.entries())):
        if any(fnmatch(name, pattern) for pattern in options.names):
            names[name.split("/")[0]].append(name)
    chosen = [name for group in names.values() for name in group[: options.each]]
    with options.records.open("a") as file:
        for name in chosen:
            if name in done:
                continue
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                done[name] = {"name": name, "first": run(name, folder), "second": run(name, folder)}
            file.write(json.dumps(done[name]) + "\n")
            file.flush()
    report([done[name] for name in chosen])


def report(rows: list[dict[str, Any]]) -> None:
    """Print a row per problem, and each entry whose first call takes too much CPU."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if "error" not in row["first"] and "error" not in row["second"]:
            groups[row["name"].split("/")[0]].append(row)
    print(
        f"{'problem':<20}{'entries':>8}{'CPU first':>11}{'worst':>7}{'second':>8}{'worst':>7}"
        f"{'wall first':>12}{'worst':>7}{'compiler':>10}  worst entry"
    )
    groups["all"] = [row for group in groups.values() for row in group]
    for problem, group in groups.items():
        columns = [
            [row[call][key] for row in group]
            for call, key in (("first", "cpu"), ("second", "cpu"), ("first", "wall"))
        ]
        cpu, again, wall = ((median(column), max(column)) for column in columns)
        worst = max(group, key=lambda row: row["first"]["cpu"])["name"]
        compiler = median(row["first"]["children"] for row in group)
        print(
            f"{problem:<20}{len(group):>8}{cpu[0]:>11.1f}{cpu[1]:>7.1f}{again[0]:>8.1f}{again[1]:>7.1f}"
            f"{wall[0]:>12.1f}{wall[1]:>7.1f}{compiler:>10.1f}  {worst}"
        )
    for row in rows:
        first, second = row["first"], row["second"]
        if "error" in first or "error" in second:
            print(f"{row['name']}: {first.get('error')}, {second.get('error')}")
        elif first["cpu"] > MOST:
            why = "the solve itself" if second["cpu"] > MOST else "compiling"
            print(
                f"{row['name']}: {first['cpu']:.1f} s, then {second['cpu']:.1f} s: {why}, "
                f"{first['backend']}"
            )


if __name__ == "__main__":
    main()
