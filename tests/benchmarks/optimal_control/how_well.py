"""How well one call with defaults does over the whole catalogue, and other people's Python beside it.

``python tests/benchmarks/optimal_control/how_well.py`` solves every problem once, each in a process of
its own, one after the other, and writes the tables of ``docs/how-well.md``. Peers are those of
``control_peers.py``, on the problems that are stated there.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
ROOT = HERE.parents[3]
PAGE = ROOT / "docs" / "how-well.md"
#: Time limit (s) of a problem.
LIMIT = 45.0
#: Largest violation, relative to the bounded quantity, of an accepted answer.
TOLERANCE = 1e-6
#: Settings of each peer: that of ``test_control_rivals.py`` that reaches 1e-6, if there is such a setting.
SETTINGS: dict[str, dict[str, Any]] = {
    "yapss": {"intervals": 20, "degree": 6},
    "maptor": {"intervals": 8, "degree": 6, "adaptive": {"error_tolerance": 1e-7, "max_iterations": 30}},
    "mpopt": {"intervals": 24, "degree": 10, "adaptive": {"residual": 1e-6, "rounds": 10}},
}  # fmt: skip
STATED = (
    "optimal-control/brachistochrone",
    "optimal-control/bryson-denham",
    "optimal-control/hypersensitive-40",
    "optimal-control/goddard",
    "satellite-slew/paper-components",
)


def solve(name: str) -> dict[str, Any]:
    """Return the result of ``solve`` with defaults. Run it in a separate process."""
    import crosstrack as ct

    model = ct.load(name)
    ct.solve(ct.load("optimal-control/double-integrator-energy"))  # loads modules
    begin = time.perf_counter()
    found = ct.solve(model, time_limit=LIMIT)
    return {
        "seconds": time.perf_counter() - begin,
        "ended": str(found.termination),
        "objective": found.primal_bound,
        "meshes": found.statistics.get("meshes"),
        "said": found.message,
    }


def ours(name: str) -> dict[str, Any]:
    """Return the answer of a fresh process."""
    command = [sys.executable, str(HERE), "--child", name]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=2 * LIMIT)
    except subprocess.TimeoutExpired:
        return {"seconds": 2 * LIMIT, "ended": "killed", "objective": None}
    if done.returncode:
        return {"seconds": None, "ended": f"exit {done.returncode}", "objective": None}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def error(objective: float | None, best: float | None) -> float | None:
    """Return by how much an objective is worse than the best value known, relative to it."""
    if objective is None or best is None:
        return None
    return (objective - best) / (abs(best) if abs(best) > 1e-9 else 1.0)


def peers(name: str) -> list[tuple[Any, ...]]:
    """Return a row for each peer on one problem: its first call, measured by our verification."""
    sys.path[:0] = [str(ROOT / "tests")]
    from benchmarks.optimal_control import test_control_rivals as rivals
    from benchmarks.optimal_control.control_peers import Runner, missing

    rows: list[tuple[Any, ...]] = []
    for peer, setting in SETTINGS.items():
        reason = missing(peer)
        if reason:
            rows.append((name, peer, "not installed", None, None, None))
            continue
        told = rivals.task(name, setting["intervals"], setting["degree"])
        told.update(setting)
        try:
            with Runner(peer, told) as runner:
                answer = runner.run(LIMIT)
            found = rivals.measured(name, answer)
        except Exception as problem:  # a peer that breaks has not solved it
            rows.append((name, peer, f"{type(problem).__name__}", None, None, None))
            continue
        best = rivals.model(name)[1]
        if found is None:
            rows.append((name, peer, str(answer.get("ended")), None, None, answer.get("seconds")))
        else:
            off = error(found.objective, best)
            rows.append((name, peer, "", off, found.worst, answer["seconds"]))
    return rows


def number(value: float | None, digits: str) -> str:
    """Return a number for a table."""
    return "" if value is None else format(value, digits)


def main() -> None:
    """Solve everything and write the page's tables."""
    import crosstrack as ct

    names = [
        entry.name
        for entry in ct.instances.entries()
        if entry.name.startswith(("optimal-control/", "satellite-slew/"))
    ]
    known = {
        entry.name: (entry.published or {}).get("objective") for entry in ct.instances.entries()
    }
    lines = []
    mine: dict[str, dict[str, Any]] = {}
    for name in names:
        answer = mine[name] = ours(name)
        off = error(answer["objective"], known[name])
        lines.append(
            f"| `{name}` | {answer['ended']} | {number(answer['objective'], '.9g')} | "
            f"{number(known[name], '.9g')} | {number(off, '.1e')} | {answer.get('meshes') or ''} | "
            f"{number(answer['seconds'], '.2f')} |"
        )
        print(lines[-1], flush=True)
    ours_table = "\n".join(
        ["| problem | ended | objective | best known | relative error | meshes | seconds |",
         "|---|---|---|---|---|---|---|", *lines]
    )  # fmt: skip
    rows = []
    for name in STATED:
        best = known[name] or 8.6529177
        own = mine[name]
        rows.append(
            (name, "crosstrack", "verified", error(own["objective"], best), None, own["seconds"])
        )
        rows += peers(name)
        print(*rows[-4:], sep="\n", flush=True)
    others = "\n".join(
        ["| problem | package | ended | relative error | worst violation | seconds |",
         "|---|---|---|---|---|---|",
         *(f"| `{n}` | {p} | {e or held(w)} | {number(off, '.1e')} | {number(w, '.1e')} | {number(s, '.2f')} |"
           for n, p, e, off, w, s in rows)]
    )  # fmt: skip
    text = PAGE.read_text()
    for mark, table in (("ours", ours_table), ("peers", others)):
        pattern = rf"(<!-- {mark} -->\n).*?(<!-- end of {mark} -->)"
        text = re.sub(pattern, lambda m, t=table: f"{m[1]}\n{t}\n\n{m[2]}", text, flags=re.DOTALL)
    PAGE.write_text(text)


def held(worst: float | None) -> str:
    """Return whether a peer's answer would be verified here."""
    return "" if worst is None else "verified" if worst <= TOLERANCE else "rejected"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--child")
    asked = parser.parse_args()
    if asked.child:
        print(json.dumps(solve(asked.child)))
    else:
        main()
