"""Record a plan of each catalogue entry for the pages of the entries.

::

    python tests/benchmarks/best_plans.py build/plans.jsonl docs/campaign/plans.jsonl

The records of the campaign contain a short plan for some entries only. For each other entry the backend with the
best verified plan of the campaign runs again, or the recommended backend if the campaign has no plan, for at most
LIMIT seconds. An interrupted run continues with the jobs that the first file lacks. The second file is the input of
the pages. A pattern such as ``sequential-ordering/*`` as the third argument records only these entries; the plans of the
others remain.
"""

from __future__ import annotations

import json
import sys
from fnmatch import fnmatch
from pathlib import Path

from slim_records import slim

from crosstrack.instances import entries
from crosstrack.solvers.bench import Campaign, Set, bench
from crosstrack.solvers.contract.states import backend_states

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))

from crosstrack_tables import best, records  # noqa: E402

#: Time limit (s) of a run, on one thread.
LIMIT = 10.0
#: Largest number of characters of a plan. Plans of satellite slews have more than 200,000.
LONGEST = 40_000


def main(raw: str, target: str, pattern: str = "*") -> None:
    """Run the backends, and write the answers with the content that the pages show."""
    known = records(ROOT / "docs" / "campaign" / "records.jsonl")
    installed = {state.name for state in backend_states() if state.state == "installed"}
    sets = []
    for entry in entries():
        if not fnmatch(entry.name, pattern):
            continue
        answer = best(known.get(entry.name, []))
        if answer is None and entry.name in known:
            continue  # Infeasible, or no backend has a plan.
        name, seed = "auto", 0
        if answer is not None and answer.backend in installed:
            name, seed = ":".join(filter(None, (answer.backend, answer.formulation))), answer.seed
        if answer is None or not isinstance(answer.stored_plan, dict):
            sets.append(
                Set((entry.name,), (name,), seeds=(seed or 0,), time_limit=LIMIT, warm_up=False)
            )
    bench(Campaign(sets=tuple(sets)), record=raw, resume=Path(raw).exists())
    rows = [json.loads(line) for line in Path(raw).read_text("utf-8").splitlines()]
    rows = [slim(row, best=True, longest=LONGEST) for row in rows if row["plan"] is not None]
    for row in rows:
        del row["environment"]
        row.pop("incumbents", None)
    if pattern != "*":
        former = map(json.loads, Path(target).read_text("utf-8").splitlines())
        rows += [row for row in former if not fnmatch(row["instance"], pattern)]
    rows.sort(key=lambda row: row["instance"])
    lines = [
        json.dumps(row, allow_nan=False, ensure_ascii=False, separators=(",", ":")) for row in rows
    ]
    Path(target).write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
