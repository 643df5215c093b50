"""Replanning in the air: median and 99th percentile with a warm start, and the cold start.

The vehicle follows each plan for 0.1 s, is blown off by a centimetre, and plans again, until it is at the goal. If a
plan does not keep the limits, the vehicle stays on the last one.

::

    python tests/benchmarks/flight/replanning.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "tests")]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402

#: Time between two plans, s, and standard deviations of the disturbances of position (m) and velocity (m/s).
STEP, OFF, GUST = 0.1, 0.01, 0.02
NAMES = ("flight/wall", "flight/forest", "flight/cloud")


def main() -> None:
    """Fly each instance, and write the table."""
    begin = time.perf_counter()
    ct.prepare(ct.load(NAMES[0]))
    cold = time.perf_counter() - begin
    table = []
    for name in NAMES:
        model = ct.load(name)
        begin = time.process_time()
        prepared = ct.prepare(model)
        first = time.process_time() - begin
        segments = len(prepared.course.polytopes)
        draw = np.random.default_rng(1)
        replan = prepared.replan(model.start)
        walls, cpus, kept, warm, flown, proven, checked = [], [], [], [], 0.0, 0, 0
        curve, at = replan.trajectory, 0.0
        while curve.duration - at > 3 * STEP and flown < 60.0:
            at += STEP
            state = [curve(at, order) for order in range(3)]
            state[0] = state[0] + OFF * draw.standard_normal(model.dimensions)
            state[1] = 0.99 * state[1] + GUST * draw.standard_normal(model.dimensions)
            flown += STEP
            begin = time.thread_time()
            replan = prepared.replan(*state)
            cpus.append(time.thread_time() - begin)
            walls.append(replan.seconds)
            kept.append(replan.ok)
            if replan.ok:  # otherwise the vehicle stays on its last plan
                curve, at = replan.trajectory, 0.0
            warm.append(replan.warm)
            if replan.ok and len(kept) % 5 == 0:
                checked += 1
                proven += replan.verification().ok
        median, high = (1e3 * np.quantile(cpus, q) for q in (0.5, 0.99))
        near = 1e3 * np.quantile(np.array(cpus)[warm], 0.99)
        table.append(
            (
                name, segments, len(kept), f"{np.mean(kept):.1%}",
                f"{proven} of {checked}", median, high, f"{np.mean(warm):.1%}", near, 1e3 * float(np.median(walls)), first,
            )
        )  # fmt: skip
        print(*table[-1], flush=True)
    columns = {
        "instance": "", "segments": "", "replans": "", "limits kept": "", "proven, of each fifth": "",
        "CPU, median (ms)": ".2f", "CPU, 99 % (ms)": ".2f", "warm": "",
        "CPU of warm ones, 99 % (ms)": ".2f", "wall clock, median (ms)": ".2f",
        "first plan, CPU (s)": ".2f",
    }  # fmt: skip
    said = (
        f"A plan each {STEP:g} s after a disturbance of {OFF:g} m and {GUST:g} m/s (standard deviations). The cold "
        f"start of the process, with imports and compiled code from the cache, took {cold:.1f} s of wall clock."
    )
    write("flight", "replanning", __file__, columns, table, ("numpy", "numba"), said)


if __name__ == "__main__":
    main()
