"""CPU and wall-clock seconds of the first call with an empty cache of compiled code, and of the second.

::

    python tests/benchmarks/framework/first_calls.py records.jsonl
    python tests/benchmarks/framework/first_calls.py records.jsonl --names "fleet/*" --each 2
    python tests/benchmarks/framework/first_calls.py records.jsonl --write

Each catalogue entry is solved by two processes in turn, with the recommended backend and no limit; each
Python block of README.md is run. The first process has an empty cache of compiled code. The second starts
when the background compiler of the first has ended. CPU is that of the calling process, with the import and
the loading of the model; that of its children, with the background compiler, is a column of its own. Runs
that the file of records holds already are not repeated. ``--write`` writes the tables of the records to
``docs/measured/first-calls.json``.
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
sys.path.insert(0, str(ROOT / "tests"))
#: Largest CPU time of a first call, s.
MOST = 3.0
#: Seconds after which a process is killed.
KILLED = 120.0
#: Columns of the tables, with their formats.
PROBLEMS = {
    "problem": "", "calls": "d", "CPU, s": ".1f", "largest CPU, s": ".1f", "second CPU, s": ".1f",
    "largest second CPU, s": ".1f", "clock, s": ".1f", "largest clock, s": ".1f",
    "compiler CPU, s": ".1f", "largest compiler CPU, s": ".1f", "slowest": "",
}  # fmt: skip
ABOVE = {
    "call": "", "CPU, s": ".1f", "second CPU, s": ".1f", "clock, s": ".1f", "compiler CPU, s": ".1f",
    "backend": "", "reason": "",
}  # fmt: skip
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
    parser.add_argument(
        "--write", action="store_true", help="write the tables of the records, run nothing"
    )
    options = parser.parse_args()
    done: dict[str, dict[str, Any]] = {}
    if options.records.exists():
        rows = [json.loads(line) for line in options.records.read_text().splitlines()]
        done = {row["name"]: row for row in rows}
    if options.write:
        write_tables(list(done.values()))
        return
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


def per_problem(rows: list[dict[str, Any]]) -> list[list[Any]]:
    """Return a row per problem, and one of all: medians and largest values of the calls without an error."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if "error" not in row["first"] and "error" not in row["second"]:
            groups[row["name"].split("/")[0]].append(row)
    groups["all"] = [row for group in groups.values() for row in group]
    result: list[list[Any]] = []
    for problem, group in groups.items():
        cells: list[Any] = [problem, len(group)]
        for call, key in (
            ("first", "cpu"),
            ("second", "cpu"),
            ("first", "wall"),
            ("first", "children"),
        ):
            values = [row[call][key] for row in group]
            cells += [median(values), max(values)]
        result.append([*cells, max(group, key=lambda row: row["first"]["cpu"])["name"]])
    return result


def above(rows: list[dict[str, Any]]) -> list[list[Any]]:
    """Return a row per call that failed or took more than :data:`MOST` seconds of CPU, the longest first."""
    result: list[list[Any]] = []
    for row in rows:
        first, second = row["first"], row["second"]
        error = first.get("error") or second.get("error")
        if error or first["cpu"] > MOST:
            reason = error or ("solving" if second["cpu"] > MOST else "compiling")
            figures = [
                first.get("cpu"),
                second.get("cpu"),
                first.get("wall"),
                first.get("children"),
            ]
            result.append([row["name"], *figures, first.get("backend"), reason])
    return sorted(result, key=lambda cells: -(cells[1] or KILLED))


def report(rows: list[dict[str, Any]]) -> None:
    """Print both tables."""
    for columns, table in ((PROBLEMS, per_problem(rows)), (ABOVE, above(rows))):
        print(*columns, sep="; ")
        for cells in table:
            pairs = zip(cells, columns.values(), strict=True)
            print(*("" if cell is None else format(cell, form) for cell, form in pairs), sep="; ")


def write_tables(rows: list[dict[str, Any]]) -> None:
    """Write both tables to ``docs/measured/first-calls.json``."""
    from benchmarks.measured import write

    count = len(BLOCKS) + len(catalogue.entries())
    text = f"{len(rows)} of {count} catalogue entries and blocks of the README were measured."
    packages = ["numba", "llvmlite", "numpy", "scipy"]
    write("first-calls", "problems", __file__, PROBLEMS, per_problem(rows), packages, text)
    write("first-calls", "above", __file__, ABOVE, above(rows), packages)


if __name__ == "__main__":
    main()
