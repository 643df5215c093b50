"""Convex tracking problems with singular arcs: our default beside our Radau and the bare program.

Each seed draws a stable or unstable linear system of 2 to 6 states with 1 or 2 bounded controls, and a quadratic
tracking cost of some states. The cost contains no control, so optimal controls are bang-bang or
singular; in every problem a control is between its bounds for at least 30 % of the time. No final state is
prescribed: every control is feasible, and the objective of its integrated motion is
an upper bound on the optimum. The problem is convex, so two answers may differ only by their accuracy.

``python tests/benchmarks/optimal_control/singular.py [--json FILE] [seeds]`` prints one row per
seed and the number of our answers that are worse than the best of the three by more than 1e-5, relative.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from scipy.integrate import solve_ivp

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parent)]

from bare import solve_bare  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.models import OptimalControlProblem  # noqa: E402

__all__ = ["draw"]

#: Largest relative excess of an answer over the best of the three.
WORSE = 1e-5
#: Intervals of the bare program, which has no refinement.
INTERVALS = 240
#: Number of problems.
SEEDS = 50


def draw(seed: int) -> OptimalControlProblem:
    """Return the problem of a seed."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    m = int(random.integers(1, min(2, n - 1) + 1))
    if random.random() < 0.4:  # a chain of integrators with friction
        a = np.diag(np.ones(n - 1), 1) - np.diag(random.uniform(0.0, 0.5, n))
        b = np.zeros((n, m))
        b[n - 1, 0] = 1.0
        if m == 2:
            b[n // 2 - 1, 1] = 1.0
    else:
        a = random.normal(size=(n, n)) / math.sqrt(n)
        a -= np.eye(n) * max(0.0, np.linalg.eigvals(a).real.max() - 0.1)
        b = random.normal(size=(n, m))
    tracked = random.permutation(n)[: int(random.integers(1, n + 1))]
    weights = random.uniform(0.2, 2.0, tracked.size)
    levels, waves = random.normal(size=tracked.size), random.normal(size=tracked.size)
    frequency = random.uniform(0.3, 1.5)
    limit = random.uniform(2.0, 6.0, m)
    ocp = OptimalControlProblem(f"tracking {seed}")
    phase = ocp.phase(time=(0, float(random.uniform(2.0, 6.0))))
    x = phase.state("x", n, initial=0.5 * random.normal(size=n))
    u = phase.control("u", m, lower=-limit, upper=limit)
    phase.dynamics({x: casadi.mtimes(a, x) + casadi.mtimes(b, u)})
    wave = casadi.sin(frequency * phase.time)
    cost = 0
    for state, weight, level, height in zip(tracked, weights, levels, waves, strict=True):
        cost += weight * (x[int(state)] - level - height * wave) ** 2
    ocp.minimise(phase.integral(cost))
    return ocp.build()


def integrated(problem: Any, plan: Any) -> float:
    """Return the cost of the motion with the plan's control, integrated by DOP853 from knot to knot."""
    phase = problem.definition.phases[0]
    part = plan.phases[0]
    state = np.append(phase.guess.states[0], 0.0)
    for k, (begin, end) in enumerate(itertools.pairwise(part.controls.knots)):

        def rate(t: float, y: Any, k: int = k, begin: float = begin, end: float = end) -> Any:
            place = 2.0 * (t - begin) / (end - begin) - 1.0
            u = part.controls.on(k, [place])[0]
            rates, _, integrand, _ = phase.function(t, y[:-1], u, [])
            return np.append(rates.full().ravel(), float(integrand))

        motion = solve_ivp(rate, (begin, end), state, method="DOP853", rtol=1e-10, atol=1e-11)
        state = motion.y[:, -1]
    return float(state[-1])


def _ours(problem: Any, **options: Any) -> dict[str, Any]:
    """Return termination, cost of the integrated motion and CPU seconds of one call of `solve`."""
    begin = time.process_time()
    try:
        solution = ct.solve(problem, **options)
    except ct.CrosstrackError as error:
        return {"ended": type(error).__name__, "J": None, "seconds": time.process_time() - begin}
    return {
        "ended": str(solution.termination),
        "J": integrated(problem, solution.plan) if solution.verified else None,
        "seconds": time.process_time() - begin,
        "message": solution.message or "",
    }


def _bare(problem: Any, intervals: int) -> dict[str, Any]:
    """Return status, cost of the integrated motion and CPU seconds of the bare program."""
    answer = solve_bare(problem, intervals=intervals)
    good = answer.success and answer.plan is not None
    objective = integrated(problem, answer.plan) if good else None
    return {"ended": answer.status, "J": objective, "seconds": answer.seconds}


def compare(seed: int, limit: float) -> dict[str, Any]:
    """Return the three answers to the problem of a seed, and the excess of ours over the best."""
    problem = draw(seed)
    row: dict[str, Any] = {"seed": seed, "size": problem.describe()}
    row["ours"] = _ours(problem, time_limit=limit)
    row["radau"] = _ours(problem, time_limit=limit, formulation="radau")
    row["bare"] = _bare(problem, INTERVALS)
    best = min(
        (row[by]["J"] for by in ("ours", "radau", "bare") if row[by]["J"] is not None),
        default=math.nan,
    )
    mine = row["ours"]["J"]
    row["excess"] = None if mine is None else (mine - best) / abs(best)
    row["worse"] = row["excess"] is None or not row["excess"] <= WORSE
    return row


def main() -> None:
    """Compare the answers for the seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--limit", type=float, default=60.0, help="time limit of each of our calls")
    given = parser.parse_args()
    ct.solve(ct.load("optimal-control/double-integrator-energy"))  # loads modules
    rows = []
    for seed in given.seeds or range(SEEDS):
        row = compare(seed, given.limit)
        rows.append(row)
        values = " ".join(
            f"{by} {'-' if row[by]['J'] is None else format(row[by]['J'], '.9f'):>14} {row[by]['seconds']:6.2f} s "
            f"{row[by]['ended']:16.16}"
            for by in ("ours", "radau", "bare")
        )
        excess = "-" if row["excess"] is None else f"{row['excess']:.1e}"
        print(f"{'WORSE' if row['worse'] else 'ok   '} {seed:2} {values} {excess}", flush=True)
    count = sum(row["worse"] for row in rows)
    total = sum(row["ours"]["seconds"] for row in rows)
    print(f"{count} of {len(rows)} worse by more than {WORSE:g}; ours {total:.1f} s of CPU")
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
