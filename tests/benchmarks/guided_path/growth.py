"""Growth of ``a-star`` on long chains: time to the first tour, length, gap and memory at equal CPU time.

Each tour runs in a process of its own, for a number of CPU seconds after the kernels are compiled::

    python tests/benchmarks/guided_path/growth.py --seconds 10

It writes the table ``growth`` of ``docs/measured/guided-path.json``.
"""

from __future__ import annotations

import argparse
import resource
import sys
import threading
import time
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

SIZES = ((10, 10), (20, 10), (20, 50), (20, 250), (20, 1000), (4000, 5))
HEADS = {
    "chains": "", "customers of each": "", "first tour (s)": ".2f", "Algorithm 6": ".0f",
    "length": ".0f", "bound": ".0f", "gap (%)": ".1f", "memory (MB)": ".0f",
}  # fmt: skip


def solved(backend: Any, model: Any, seconds: float) -> tuple[Any, list[float]]:
    """Return the answer after some CPU seconds, and the CPU times of its incumbents."""
    from crosstrack.solvers import Limit, Request
    from crosstrack.solvers.contract.backend import Control

    begin, times = time.process_time(), []
    control = Control(forward=lambda value, point: times.append(time.process_time() - begin))

    def watch() -> None:
        while time.process_time() - begin < seconds:
            time.sleep(0.02)
        control.stop(Limit.TIME)

    threading.Thread(target=watch, daemon=True).start()
    options = backend.checked_options({})
    return backend.run(model, Request(options=options, control=control)), times


def measured(chains: int, each: int, seconds: float) -> list[Any]:
    """Return a row of the table."""
    from crosstrack.models import GuidedPathTour
    from crosstrack.solvers.guided_path.a_star import AStar
    from crosstrack.solvers.guided_path.insertion import InsertIndex, InsertNearest

    def tour(chains: int, each: int) -> GuidedPathTour:
        places = np.random.default_rng(1).random(chains * each) * 1000
        members = 1 + np.arange(chains * each).reshape(chains, each)
        return GuidedPathTour(np.append(0.0, places), chains=members.tolist())

    solved(AStar(), tour(12, 40), 4.0)  # compiles
    model = tour(chains, each)
    merged = [solved(one(), model, 600.0)[0].primal_bound for one in (InsertIndex, InsertNearest)]
    answer, times = solved(AStar(), model, seconds)
    assert model.verify(answer.point).ok
    gap = 100.0 * (1.0 - answer.dual_bound / answer.primal_bound)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return [
        chains, each, times[0], min(merged), answer.primal_bound, answer.dual_bound, gap, memory,
    ]  # fmt: skip


def main() -> None:
    """Measure all sizes and write the table."""
    from benchmarks.measured import write

    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--from-size", type=int, default=0, help="index of the first size")
    options = parser.parse_args()
    seconds = options.seconds
    said = (
        f"Uniform random places within 1 km, one seed, {seconds:g} s of CPU time after compilation. "
        "The column Algorithm 6 has the shorter tour of both orders; the first tour is any feasible one."
    )
    for chains, each in SIZES[options.from_size :]:
        with get_context("spawn").Pool(1) as pool:
            row = pool.apply(measured, (chains, each, seconds))
        print(row, flush=True)
        fields = {"said": said, "merge": True, "keys": 2, "order": SIZES}
        write("guided-path", "growth", __file__, HEADS, [row], **fields)


if __name__ == "__main__":
    main()
