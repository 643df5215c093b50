"""On how many problems of the catalogue does each NLP backend reach Ipopt's value, verified?

``python tests/benchmarks/optimal_control/nlp_backends.py [--json FILE] [--seconds LIMIT] [problems]``

Each pair runs in a separate process with a time limit, one after the other, at tolerance 1e-3. A
backend matches if its plan is verified and its objective is at most Ipopt's, to 1e-3.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

BACKENDS = (
    "ipopt", "uno", "fatrop", "sqpmethod", "blocksqp", "slsqp", "trust-constr", "sleqp", "bonmin",
)  # fmt: skip
PROBLEMS = (
    "double-integrator-energy",
    "linear-regulator",
    "brachistochrone",
    "bryson-denham",
    "zermelo",
    "van-der-pol",
    "moon-lander",
    "rayleigh-free",
    "hanging-chain",
    "linear-tangent-steering",
    "container-crane",
    "orbit-raising",
)
TOLERANCE = 1e-3


def _solve(backend: str, name: str, seconds: float) -> dict[str, Any]:
    """Return what one backend gives on one problem."""
    import crosstrack as ct

    problem = ct.load(f"optimal-control/{name}")
    begin = time.perf_counter()
    found = ct.solve(problem, backend, tolerance=TOLERANCE, time_limit=seconds, starts=1)
    return {
        "ended": str(found.termination),
        "verified": bool(found.verified),
        "J": found.primal_bound,
        "seconds": time.perf_counter() - begin,
        "message": found.message or "",
    }


def measure(backend: str, name: str, seconds: float) -> dict[str, Any]:
    """Return the answer of a process, which is killed 30 s after its limit: it has to start."""
    command = [sys.executable, __file__, "--child", backend, name, "--seconds", str(seconds)]
    answer: dict[str, Any] = {"verified": False, "J": None, "seconds": None, "message": ""}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + 30)
    except subprocess.TimeoutExpired:
        answer["ended"] = "killed"
    else:
        if done.returncode == 0:
            answer.update(json.loads(done.stdout.strip().splitlines()[-1]))
        else:
            last = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
            answer.update(ended="error", message=last)
    return {"backend": backend, "problem": name, **answer}


def main() -> None:
    """Measure, print a line of each pair and a count of each backend."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problems", nargs="*")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        print(json.dumps(_solve(*given.problems, given.seconds)))
        return
    rows: list[dict[str, Any]] = []
    for name in given.problems or PROBLEMS:
        best = None
        for backend in BACKENDS:
            row = measure(backend, name, given.seconds)
            if backend == "ipopt" and row["verified"]:
                best = row["J"]
            row["matches"] = bool(
                row["verified"]
                and best is not None
                and row["J"] <= best + TOLERANCE * max(abs(best), 1e-9)
            )
            rows.append(row)
            print(
                f"{name:26} {backend:13} {'matches' if row['matches'] else '-':8}"
                f"{row['ended']:22} {row['J']} {row['seconds']} {row['message'][:100]}",
                flush=True,
            )
            if given.json:
                given.json.write_text(json.dumps(rows, indent=1) + "\n")
    for backend in BACKENDS:
        own = [row for row in rows if row["backend"] == backend]
        print(f"{backend:13} {sum(row['matches'] for row in own)} of {len(own)}")


if __name__ == "__main__":
    main()
