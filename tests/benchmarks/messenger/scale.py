"""Lengths of ``tour-search`` and of the other searches at equal time limits, for many vehicles.

``python tests/benchmarks/messenger/scale.py FILE [--seconds 10] [--vehicles 100 200] [--seeds 5]`` appends one JSON
line per run to FILE and skips runs with this limit that it contains. The limit counts CPU seconds. Each line contains
the CPU seconds of its run. ``--wild N`` measures N wild instances of 1 to 300 vehicles instead, and ``--report``
prints the comparison.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks import cpu_clock  # noqa: E402, F401 - before crosstrack

import crosstrack as ct  # noqa: E402
from crosstrack import jit  # noqa: E402
from crosstrack.instances.messenger import generate  # noqa: E402
from crosstrack.models import MessengerTour  # noqa: E402
from crosstrack.solvers.messenger.decoding import follow  # noqa: E402
from crosstrack.solvers.messenger.heuristics import build_greedily  # noqa: E402
from crosstrack.solvers.messenger.rivals import Flight  # noqa: E402

TWO_OPT = "greedy-boundary + 2-opt"
BACKENDS = (
    "tour-search", TWO_OPT, "greedy-boundary", "greedy-centre", "memetic", "memetic-relaxed",
    "variable-neighbourhood",
)  # fmt: skip


class Clockwork:
    """Request of a search without a solver run: the attributes that :class:`Flight` reads."""

    def __init__(self) -> None:
        self.seed, self.control = 0, self
        self.flag = np.zeros(1, np.int8)

    def incumbent(self, *_: Any) -> None:
        """Ignore incumbents."""


@jit.kernel
def improve_once(order: Any, genes: Any, task: Any, end: float, rows: Any) -> float:
    """Try every reversal that begins at one of `rows`; keep each that shortens the tour."""
    n, trial, trial_genes = len(order), order.copy(), genes.copy()
    for a in rows:
        for b in range(a + 1, n):
            for k in range(a, b + 1):
                trial[k] = order[a + b - k]
            there = follow(trial, trial_genes, task, a, end)
            if there < end:
                end = there
                order[:], genes[:] = trial, trial_genes
            else:
                trial[:], trial_genes[:] = order, genes
                follow(order, trial_genes, task, a, np.inf)
    return end


def two_opt(model: MessengerTour, seconds: float) -> float | None:
    """Return the length of HE-B, improved by reversals until the time is over."""
    flight, begin = Flight(model, Clockwork()), time.process_time()  # type: ignore[arg-type]
    order, genes = flight.blank()
    build_greedily(order, genes, flight.task, 2, 100)
    end, row, idle = follow(order, genes, flight.task, 0, np.inf), 0, 0
    while time.process_time() - begin < seconds and idle < model.size:
        row = (row + 1) % model.size
        after = improve_once(order, genes, flight.task, end, np.array([row]))
        idle = idle + 1 if after >= end else 0
        end = after
    flight.offer(order, genes)
    assert flight.plan is not None
    return flight.plan.length if model.verify(flight.plan).ok else None


def wild(seed: int) -> MessengerTour:
    """Return an instance with fast, clustered or resting vehicles, and extreme radii, of 1 to 300 vehicles."""
    rng = np.random.default_rng(seed)
    n = int(np.exp(rng.uniform(0.0, np.log(300.5))))
    scale = 10.0 ** rng.choice([-3.0, 0.0, 2.0, 6.0])
    centres = rng.uniform(0.0, 300.0, (1 if rng.random() < 0.7 else 4, 2))
    spots = centres[rng.integers(0, len(centres), n)] + rng.normal(
        0.0, 10.0 ** rng.uniform(0, 2.5), (n, 2)
    )
    pace = 10.0 * rng.choice([0.0, 0.2, 0.35, 0.7, 0.95]) * rng.uniform(0.0, 1.0, n)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    radius = rng.choice([0.0, 1e-3, 1.0, 5.0, 100.0], n if rng.random() < 0.3 else 1)
    closed = bool(rng.random() < 0.2)
    if closed:
        pace *= 0.0
    return MessengerTour(
        spots * scale, (pace * np.array([np.cos(angle), np.sin(angle)])).T * scale, radius * np.ones(n) * scale,
        speed=10.0 * scale, turning_radius=float(rng.choice([0.0, 1e-2, 5.0, 100.0])) * scale, closed=closed,
    )  # fmt: skip


def measure(model: MessengerTour, backend: str, seconds: float, seed: int) -> float | None:
    """Return the length of the verified plan, or None without one."""
    if backend == TWO_OPT:
        return two_opt(model, seconds)
    try:
        result = ct.solve(model, backend, time_limit=seconds, seed=seed)
    except ct.CrosstrackError:
        return None
    return None if result.plan is None else float(result.primal_bound)


def report(rows: list[dict[str, Any]]) -> None:
    """Print lengths relative to ``tour-search``: geometric means, and the signed-rank test."""
    cells = {(row["case"], row["backend"]): row["length"] for row in rows}
    kinds = sorted({row["kind"] for row in rows})
    for kind in kinds:
        cases = sorted({row["case"] for row in rows if row["kind"] == kind})
        for backend in BACKENDS[1:]:
            pairs = [
                (cells.get((c, BACKENDS[0])), cells[c, backend])
                for c in cases
                if (c, backend) in cells
            ]
            both = [(own, other) for own, other in pairs if own and other]
            lost = sum(own is None and other is not None for own, other in pairs)
            line = f"{kind} {backend}: {len(pairs)} cases, no plan but the other has one {lost}"
            if both:
                ratio = np.log([own / other for own, other in both])
                longer = int((ratio > 1e-6).sum())
                line += f", longer {longer} of {len(both)}, mean ratio {np.exp(ratio.mean()):.3g}"
                if len(both) > 4 and ratio.any():
                    line += f", p = {wilcoxon(ratio).pvalue:.2g}"
            print(line)


def main() -> None:
    """Measure the missing cells, and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--vehicles", type=int, nargs="*", default=[20, 40, 100, 200])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--wild", type=int, default=0)
    parser.add_argument("--backends", nargs="*", default=list(BACKENDS))
    parser.add_argument("--report", action="store_true")
    options = parser.parse_args()
    text = options.file.read_text().splitlines() if options.file.exists() else []
    rows = [row for row in map(json.loads, text) if row["seconds"] == options.seconds]
    known = {(row["case"], row["backend"]) for row in rows}
    jit.compile_always()
    pairs = [(n, seed) for n in options.vehicles for seed in range(1, options.seeds + 1)]
    cases = (
        [("wild", f"wild-{seed}", seed) for seed in range(options.wild)]
        if options.wild
        else [(str(n), f"{n}-{seed}", seed) for n, seed in pairs]
    )
    if not options.report:
        for n in (3, 60):  # a kernel is compiled only if the limit is far away
            hasty = {"patience": 1, "steps": 1, "bound": n == 3}
            ct.solve(generate(n, 8.0, 0), "tour-search", time_limit=600, backend_options=hasty)
        for backend in options.backends:  # compiling must not use the time of a run
            measure(generate(3, 8.0, 0), backend, 30.0, 0)
    for kind, case, seed in [] if options.report else cases:
        model = wild(seed) if kind == "wild" else generate(int(kind), 8.0, 100 * int(kind) + seed)
        for backend in options.backends:
            if (case, backend) in known or (kind == "wild" and backend == TWO_OPT):
                continue
            begin = time.process_time()
            length = measure(model, backend, options.seconds, seed)
            cpu = round(time.process_time() - begin, 2)
            row = {
                "kind": kind,
                "case": case,
                "backend": backend,
                "length": length,
                "size": model.size,
            }
            rows.append({**row, "seconds": options.seconds, "cpu": cpu})
            print(rows[-1], flush=True)
            with options.file.open("a") as stream:
                stream.write(json.dumps(rows[-1]) + "\n")
    report(rows)


if __name__ == "__main__":
    main()
