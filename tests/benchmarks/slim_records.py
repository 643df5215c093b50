"""Reduce the records of a campaign to the data that verdicts, rankings and plots need.

::

    python tests/benchmarks/slim_records.py records.jsonl docs/campaign/records.jsonl

The best plan of each instance is retained if it is short, because the report draws it. Of the incumbents
those that halve the distance to the last one are retained. Satisfied checks, the machine of all
answers but the first, and empty entries are removed. Answers are sorted, so that two campaigns differ
only in their results.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from crosstrack.solvers.bench import read_records
from crosstrack.solvers.contract.solution import Solution
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.run.recording import LEFT_OUT

#: Largest number of characters of a plan.
PLAN = 12_000
#: Shortest time (s) of a recorded part, and the parts that are always recorded.
LEAST, PARTS = 0.01, ("build", "solve", "total")
#: Smallest recorded distance of an incumbent to the last one, relative to that of the first one.
LEFT = 1e-4
#: Default values of the options.
USUAL = {"starts": 1, "warm_start": None, "backend_options": {}, "threads": None, "repeat": 0}


def slim(row: dict[str, Any], best: bool, longest: int = PLAN) -> dict[str, Any]:
    """Return an answer reduced to the data that its verdict and its rank need.

    The plan of the best answer is retained up to `longest` characters.
    """
    kept = {name: value for name, value in row.items() if name not in ("gap", "duals", "history")}
    # The verdict needs the existence of a plan, and only the plot needs its content.
    if row["plan"] is not None and not (best and len(json.dumps(row["plan"])) <= longest):
        kept["plan"] = LEFT_OUT
    kept["rejected_plan"], kept["starts"] = None, []
    kept["incumbents"] = course(row["incumbents"])
    counts = ("evaluations", "variables")
    kept["statistics"] = {k: v for k, v in row["statistics"].items() if k in counts}
    kept["message"] = row["message"][:300]
    kept["seconds"] = {
        name: float(f"{value:.4g}")
        for name, value in row["seconds"].items()
        if name in PARTS or value >= LEAST
    }
    kept["options"] = {k: v for k, v in row["options"].items() if USUAL.get(k, ...) != v}
    if row["verification"] is not None:
        checks = row["verification"]["checks"]
        far = [one for one in checks if not one["worst"] <= one["rounding"]]
        kept["verification"] = {**row["verification"], "checks": far}
    always = (
        "plan",
        "primal_bound",
        "verification",
        "key",
        "instance",
        "version",
        "backend",
        "seconds",
    )
    return {k: v for k, v in kept.items() if k in always or v not in (None, "", [], {})}


def course(incumbents: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the incumbents that halve the distance to the best objective, and the best one."""
    if not incumbents:
        return []
    last = min(one["objective"] for one in incumbents)
    way = incumbents[0]["objective"] - last
    kept: list[dict[str, Any]] = []
    above = math.inf
    for one in incumbents:
        left = one["objective"] - last
        if left == 0 or (left <= 0.5 * above and left > LEFT * way):
            above = left
            counted = {} if one.get("evaluations") is None else {"evaluations": one["evaluations"]}
            seconds, objective = float(f"{one['seconds']:.3g}"), float(f"{one['objective']:.9g}")
            kept.append({"seconds": seconds, "objective": objective, **counted})
        if left == 0:
            break
    return kept


def main(source: str, target: str) -> None:
    """Write the small records."""
    rows = [json.loads(line) for line in Path(source).read_text().splitlines() if line.strip()]
    answers: dict[str, list[tuple[Solution[Any], int]]] = {}
    for index, row in enumerate(rows):
        answers.setdefault(row["digest"], []).append((Solution.from_dict(row), index))
    best = set()
    for found in answers.values():
        leader = judge("", [one for one, _ in found]).best
        best.update(index for one, index in found if one is leader)
    machines = {where for row in rows if (where := row.get("environment", {}).get("processor"))}
    assert len(machines) == 1, f"records of several machines: {machines}"
    rows = [slim(row, index in best) for index, row in enumerate(rows)]
    names = ("model", "instance", "backend", "formulation", "seed", "key")
    rows.sort(key=lambda row: [str(row.get(name)) for name in names])
    told = (row.get("environment", {}) for row in rows)
    whole = next(where for where in told if "processor" in where)
    for row in rows:
        where = row.get("environment", {})
        row["environment"] = {n: where[n] for n in ("load", "warm") if where.get(n) is not None}
    rows[0]["environment"] = {**whole, **rows[0]["environment"]}
    lines = [
        json.dumps(row, allow_nan=False, ensure_ascii=False, separators=(",", ":")) for row in rows
    ]
    Path(target).write_text("\n".join(lines) + "\n")
    before, after = read_records(source), read_records(target)
    outcomes = [{one.instance: one.outcome for one in r.verdicts} for r in (before, after)]
    assert outcomes[0] == outcomes[1], "a verdict changed with what was left out"


if __name__ == "__main__":
    main(*sys.argv[1:])
