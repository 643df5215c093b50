"""The first minute: whole processes that solve one instance and print it, run in turn.

Each round runs every process once, so that ratios are taken of neighbours: machines change speed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.ledger import Ledger, duration

SOLVE = "import crosstrack as ct; print(ct.solve(ct.load('error-correction/7')))"
COMPILE = "from crosstrack.jit import compile_always; compile_always(); " + SOLVE
LIBRARIES = "import numpy, scipy.sparse"
#: Name of a process: its script, and whether its folder of compiled code is new each time.
PROCESSES = {
    "import numpy, scipy.sparse": (LIBRARIES, False),
    "solve and print, empty cache": (SOLVE, True),
    "solve and print, filled cache": (SOLVE, False),
    "the same compiled, filled cache": (COMPILE, False),
}
ROUNDS = 7


def test_first_minute(benchmark: Any, ledger: Ledger, tmp_path: Path) -> None:
    filled = tmp_path / "filled"
    first = run(COMPILE, filled)
    found: dict[str, list[float]] = {name: [] for name in PROCESSES}

    def once() -> None:
        for name, (script, empty) in PROCESSES.items():
            turn = len(found[name])
            found[name].append(run(script, tmp_path / f"{turn}" if empty else filled))

    benchmark.group = "first minute"
    benchmark.pedantic(once, rounds=ROUNDS)
    base = found["import numpy, scipy.sparse"]
    for name, seconds in found.items():
        ratio = median(one / other for one, other in zip(seconds, base, strict=True))
        ledger.starts.append((name, f"{duration(median(seconds))} (ratio {ratio:.2f})"))
    ledger.starts.append(("the same compiled, empty cache", duration(first)))


def test_demonstration(benchmark: Any, ledger: Ledger, tmp_path: Path) -> None:
    script = "import sys; from crosstrack.__main__ import main; sys.argv[1:] = ['demo']; main()"
    seconds: list[float] = []
    benchmark.group = "first minute"
    benchmark.pedantic(lambda: seconds.append(run(script, tmp_path / "empty")), rounds=1)
    ledger.starts.append(("crosstrack demo, empty cache", duration(seconds[0])))


def run(script: str, folder: Path) -> float:
    """Return the time (s) of a process whose cache of compiled code is in `folder`."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder), "MPLBACKEND": "Agg"},
        cwd=folder.parent,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return time.perf_counter() - begin
