"""Record a plan of each catalogue entry for the pages of the entries.

::

    python tests/benchmarks/best_plans.py build/plans.jsonl docs/campaign/plans.jsonl

The records of the campaign contain a short plan for some entries only. For each other entry the backend with the
best verified plan of the campaign runs again, or the recommended backend if the campaign has no plan, for at most
LIMIT seconds. An interrupted run continues with the jobs that the first file lacks. The second file is the input of
the pages.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from slim_records import slim

from crosstrack.instances import entries
from crosstrack.solvers.bench import Campaign, Set, bench, read_records
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.contract.states import backend_states
from crosstrack.solvers.contract.verdict import judge

ROOT = Path(__file__).resolve().parents[2]
#: Time limit (s) of a run, on one thread.
LIMIT = 5.0


def best_answers(path: Path) -> dict[str, Any]:
    """Return the best verified answer by instance, without backends that read hidden data."""
    answers: dict[str, list[Any]] = {}
    for solution in read_records(path).solutions:
        if not find_backend(solution.backend, problem=solution.problem or None).sees_hidden:
            answers.setdefault(solution.instance, []).append(solution)
    return {name: judge(name, solutions).best for name, solutions in answers.items()}


def main(raw: str, target: str) -> None:
    """Run the backends, and write the answers with the content that the pages show."""
    known = best_answers(ROOT / "docs" / "campaign" / "records.jsonl")
    installed = {state.name for state in backend_states() if state.state == "installed"}
    sets = []
    for entry in entries():
        answer = known.get(entry.name)
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
    rows = [slim(row, best=True) for row in rows if row["plan"] is not None]
    for row in rows:
        row["environment"] = {}
    rows.sort(key=lambda row: row["instance"])
    lines = [
        json.dumps(row, allow_nan=False, ensure_ascii=False, separators=(",", ":")) for row in rows
    ]
    Path(target).write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
