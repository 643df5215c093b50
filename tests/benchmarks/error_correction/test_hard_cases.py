"""``label-setting`` on detours, dead ends and chains, beside the search of the general model.

The other search is ``resource-labelling``, whose bounds ignore the errors. Ratios are of times within one
run; nothing fails because it is slow.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from benchmarks.ledger import Ledger, Row
from error_correction.hard_cases import ball, chain, clusters, wall

from crosstrack.instances.error_correction.generator import uniform_slab
from crosstrack.solvers import Request, find_backend


def out_of_reach(n: int) -> Any:
    """Return uniform points that are all too far from B for its threshold."""
    return uniform_slab(n, (25, 15, 20, 25, 1e-3), seed=3)


#: Instance, target time (s, inf for none) and smaller instance for the ratio, by name.
CASES = {
    "ball": (lambda: ball(10_000), 0.1, lambda: ball(700)),
    "ball of 100,000": (lambda: ball(100_000), np.inf, None),
    "ball without a way on": (lambda: ball(10_000, 60, "horizontal"), 0.1, None),
    "wall": (lambda: wall(10_000), 2.0, lambda: wall(3000)),
    "wall of 100,000": (lambda: wall(100_000), 7.0, None),
    "two walls": (lambda: wall(10_000, "two"), 2.0, lambda: wall(3000, "two")),
    "pocket": (lambda: wall(10_000, "pocket"), 2.0, lambda: wall(3000, "pocket")),
    "closed wall": (lambda: wall(10_000, "closed"), 2.0, lambda: wall(3000, "closed")),
    "B out of reach": (lambda: out_of_reach(100_000), 2.0, lambda: out_of_reach(2000)),
    "chain": (lambda: chain(24), 0.1, lambda: chain(16)),
    "chain of 100": (lambda: chain(100), np.inf, None),
    "chain of ties": (lambda: chain(24, jitter=0.0), 0.1, lambda: chain(9, jitter=0.0)),
    "lattice of clusters": (lambda: clusters(12, 12), np.inf, lambda: clusters(3, 4)),
}


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile everything beforehand."""
    for model in (chain(6, jitter=0.0), wall(1000)):
        measure(model, "label-setting")
    measure(chain(3, jitter=0.0).lower(), "resource-labelling")


def measure(model: Any, name: str) -> tuple[float, float | None, int]:
    """Return seconds, length and labels of a search."""
    begin = time.perf_counter()
    answer = find_backend(name, model).run(model, Request())
    seconds = time.perf_counter() - begin
    assert answer.termination in ("optimal", "infeasible")
    if answer.point is not None:
        assert model.verify(answer.point).ok
    return seconds, answer.primal_bound, int(answer.statistics["labels made"])


@pytest.mark.parametrize("name", CASES)
def test_hard_case(name: str, ledger: Ledger) -> None:
    make, goal, smaller = CASES[name]
    model = make()
    calls = [measure(model, "label-setting") for _ in range(3)]
    best = min(seconds for seconds, _, _ in calls)
    title = f"{name}, {len(model.points):,} points"
    if goal < np.inf:
        title += f": wanted ≤ {goal:g} s: {'kept' if best <= goal else 'MISSED'}"
    ledger.titles[name] = title
    ledger.rows.append(
        Row(
            name,
            "label-setting",
            [best],
            [best],
            work=f"{calls[0][2]:,} labels",
            outcome=str(calls[0][1]),
        )
    )
    if smaller is None:
        return
    model = smaller()
    with_bound = min((measure(model, "label-setting") for _ in range(3)), key=lambda call: call[0])
    without = measure(model.lower(), "resource-labelling")
    assert (without[1] or np.inf) == pytest.approx(with_bound[1] or np.inf, rel=1e-9)
    ratio = without[0] / with_bound[0]
    for solver, call in (("of fewer points", with_bound), ("resource-labelling", without)):
        outcome = f"{len(model.points):,} points" + (
            f", {ratio:.3g} times the time" if call is without else ""
        )
        ledger.rows.append(
            Row(name, solver, [call[0]], [call[0]], work=f"{call[2]:,} labels", outcome=outcome)
        )
