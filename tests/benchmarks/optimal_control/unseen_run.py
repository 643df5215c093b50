"""Solve the problems of `unseen` and `published` with defaults, each in a separate process.

``python tests/benchmarks/optimal_control/unseen_run.py [--half development|frozen|all]
[--json FILE] [--limit SECONDS] [names]``

Without names the problems of one half run, by default the development half. Results on the frozen
half are reported, not used for decisions about the solver.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()


def _solve(name: str) -> dict[str, Any]:
    """Return what one call of `solve` with defaults gives."""
    sys.path.insert(0, str(HERE.parent))
    from published import problems

    import crosstrack as ct

    ocp = problems()[name].build(name)
    ct.solve(ct.load("optimal-control/double-integrator-energy"))
    start = time.perf_counter()
    solution = ct.solve(ocp)
    return {
        "ended": str(solution.termination),
        "verified": bool(solution.verified),
        "J": solution.primal_bound,
        "seconds": time.perf_counter() - start,
        "meshes": (solution.statistics or {}).get("meshes"),
        "message": solution.message or "",
    }


def measure(name: str, value: float | None, exact: float, limit: float) -> dict[str, Any]:
    """Return the answer of a process with whether it is right: verified, and as good as `value`."""
    command = [sys.executable, str(HERE), "--child", name]
    begin = time.perf_counter()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        answer: dict[str, Any] = {"ended": "killed", "message": f"over {limit:g} s"}
    else:
        lines = done.stdout.strip().splitlines()
        if done.returncode == 0 and lines:
            answer = json.loads(lines[-1])
        else:
            answer = {"ended": "error", "message": (done.stderr.strip().splitlines() or [""])[-1]}
    answer = {"verified": False, "J": None, "meshes": None, **answer}
    answer.setdefault("seconds", time.perf_counter() - begin)
    answer.update(name=name, value=value, exact=exact, error=None)
    if answer["J"] is not None and value is not None:
        answer["error"] = (answer["J"] - value) / max(abs(value), 1e-12)
    # A verified plan may be slightly better than the published value. A much better one indicates
    # another problem statement. Without a published value every verified plan counts.
    error = answer["error"]
    answer["right"] = answer["verified"] and (value is None or -1e-3 <= error <= exact)
    return answer


def main() -> None:
    """Solve the problems named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--half", choices=["development", "frozen", "all"], default="development")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        print(json.dumps(_solve(given.child)))
        return
    sys.path.insert(0, str(HERE.parent))
    from published import development, frozen, problems

    everything = problems()
    half = {"development": development, "frozen": frozen, "all": problems}[given.half]()
    rows = []
    for name in given.names or half:
        one = everything[name]
        row = measure(name, one.value, one.exact, given.limit)
        rows.append(row)
        number, error = (
            "-" if row[key] is None else f"{row[key]:{form}}"
            for key, form in (("J", ".9g"), ("error", ".1e"))
        )
        known = "-" if one.value is None else f"{one.value:.9g}"
        print(
            f"{'ok  ' if row['right'] else 'FAIL'} {name:22} {row['ended']:20} {number:>14} "
            f"{known:>14} {error:>9} {row['seconds']:6.1f} s {row['meshes'] or '-':>3} "
            f"{row['message'][:160]}",
            flush=True,
        )
    print(f"{sum(row['right'] for row in rows)} of {len(rows)} right")
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
