"""The same answers on an idle and on a loaded machine: solve problems alone, then beside processes that use all cores.

Each call of ``ct.solve`` with defaults runs in a process of its own. Limits in the solver must count work, not
seconds, so objective, termination, plan and statistics have to be equal digit by digit.

``python tests/benchmarks/optimal_control/load.py [--hogs N] [names]`` takes problems of ``unseen.py`` and instances
of the catalogue. It prints one row per problem and exits with 1 if an answer differs.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parent)]

#: Problems by default: several starts, a second look, refinement, a singular arc, several phases.
NAMES = (
    "car",
    "f8_aircraft",
    "jacobson_singular",
    "van_der_pol_time",
    "obstacles",
    "stirred_tank",
    "satellite-slew/paper-components",
    *(
        f"optimal-control/{name}"
        for name in (
            "goddard",
            "around-discs",
            "brachistochrone",
            "bryson-denham",
            "bryson-denham-touch",
            "bryson-denham-edge",
            "bryson-denham-free",
            "dido",
            "double-integrator-energy",
            "hanging-chain",
            "hypersensitive",
            "hypersensitive-40",
            "linear-regulator",
            "zermelo",
            "decay-fit",
            "harmonic-oscillator",
            "rayleigh",
            "rayleigh-free",
            "van-der-pol",
            "double-integrator",
            "double-integrator-fuel",
            "moon-lander",
            "linear-tangent-steering",
            "orbit-raising",
            "container-crane",
            "dubins",
            "cart-pole",
            "brockett",
            "batch-reactor",
            "tubular-reactor",
            "two-stage-ascent",
        )
    ),
)
#: Statistics that measure time.
TIMES = ("seconds", "cpu")
#: Limit (s) of one call on the loaded machine.
LIMIT = 1200.0
_HOG = "while True: pass"


def _solve(name: str) -> dict[str, Any]:
    """Return the answer of one call with all digits."""
    import hashlib

    import crosstrack as ct

    if "/" in name:
        problem = ct.load(name)
    else:
        from scoreboard_parts import problem_of

        problem = problem_of(name).build(name)
    solution = ct.solve(problem)
    statistics = {
        key: repr(value)
        for key, value in sorted((solution.statistics or {}).items())
        if not any(word in key for word in TIMES)
    }
    plan = "" if solution.plan is None else json.dumps(solution.plan.data(), sort_keys=True)
    return {
        "termination": str(solution.termination),
        "objective": repr(solution.primal_bound),
        "meshes": len(solution.history or ()),
        "plan": hashlib.sha256(plan.encode()).hexdigest()[:16],
        "message": solution.message or "",
        **statistics,
    }


def answer(name: str) -> dict[str, Any]:
    """Return the answer of a fresh process."""
    command = [sys.executable, str(HERE), "--child", name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
    if done.returncode:
        return {"termination": f"exit {done.returncode}: {done.stderr[-200:]}"}
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Run processes that use one core each."""
    running = [subprocess.Popen([sys.executable, "-c", _HOG]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def main() -> int:
    """Compare the answers, and return the number of the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--hogs", type=int, default=4 * (os.cpu_count() or 2))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        print(json.dumps(_solve(given.child)))
        return 0
    different = 0
    for name in given.names or NAMES:
        alone = answer(name)
        with hogs(given.hogs):
            beside = answer(name)
        keys = [key for key in {**alone, **beside} if alone.get(key) != beside.get(key)]
        different += bool(keys)
        print(
            f"{'DIFF' if keys else 'same'} {name:32} {alone['termination']:18} {alone.get('objective')}",
            *(f"\n     {key}: {alone.get(key)} | {beside.get(key)}" for key in keys),
            flush=True,
        )
    print(f"{different} answers differ beside {given.hogs} processes")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
