"""Make the records of a campaign small enough to be kept: what judges and ranks them stays.

::

    python tests/benchmarks/slim_records.py records.jsonl docs/campaign/records.jsonl

Plans, courses of better plans, meshes, multipliers and counts go; so do checks that hold but for
rounding, and the machine of all but the first, which is one. Answers are sorted, so that two campaigns differ by what they found.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def slim(row: dict[str, Any]) -> dict[str, Any]:
    """Return an answer without what its verdict does not need."""
    kept = {**row, "incumbents": [], "duals": None, "starts": [], "rejected_plan": None}
    kept.pop("history", None)
    kept["statistics"] = {}
    # Whether there is one decides; what it is does not.
    kept["plan"] = None if row["plan"] is None else []
    kept["message"] = row["message"][:300]
    kept["seconds"] = {name: float(f"{value:.4g}") for name, value in row["seconds"].items()}
    if row["verification"] is not None:
        checks = row["verification"]["checks"]
        far = [one for one in checks if not one["worst"] <= one["rounding"]]
        kept["verification"] = {**row["verification"], "checks": far}
    return kept


def main(source: str, target: str) -> None:
    """Write the small records."""
    rows = [
        slim(json.loads(line)) for line in Path(source).read_text().splitlines() if line.strip()
    ]
    names = ("model", "instance", "backend", "formulation", "seed", "key")
    machines = {row["environment"]["processor"] for row in rows}
    assert len(machines) == 1, f"records of several machines: {machines}"
    rows.sort(key=lambda row: [str(row[name]) for name in names])
    for row in rows[1:]:
        row["environment"] = {name: row["environment"][name] for name in ("load", "threads")}
    lines = [
        json.dumps(row, allow_nan=False, ensure_ascii=False, separators=(",", ":")) for row in rows
    ]
    Path(target).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
