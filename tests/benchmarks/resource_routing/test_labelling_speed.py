"""What generality costs: ``resource-labelling`` beside ``label-setting``, HiGHS and cspy, as ratios.

Nothing fails because it is slow; everything fails that is wrong. Run with ``make bench``, or::

    pytest tests/benchmarks/resource_routing -s
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmarks.cases import CASES
from benchmarks.resource_routing import labelling_peer

import crosstrack as ct
from crosstrack.models import Resource, ResourceRouting

NAME = "resource-labelling"
ROWS = [name for name, case in CASES.items() if case.size < 1000]


def least(repeats: int, run: Callable[[], Any]) -> tuple[Any, float]:
    """Return the last answer, and the least seconds of `repeats` calls after one that compiles."""
    run()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        answer = run()
        seconds.append(time.perf_counter() - begin)
    return answer, min(seconds)


def neighbours(count: int, seed: int) -> ResourceRouting:
    """Return points in a square with arcs to the ten nearest, fuel from wells and rest at inns."""
    draw = np.random.default_rng(seed)
    points = draw.uniform(0, 100, (count, 2))
    points[0], points[-1] = (0, 0), (100, 100)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    arcs = [(i, j) for i in range(count) for j in np.argsort(apart[i])[1:11].tolist()]
    kinds = draw.choice(["stop", "well", "inn"], count, p=[0.7, 0.15, 0.15])
    kinds[[0, -1]] = "stop"
    words = sorted(set(kinds.tolist()))
    resources = [
        Resource("fuel", rate=1.0, limits=dict.fromkeys(words, 60.0), resets={"well": 0}),
        Resource("hours", limits=dict.fromkeys(words, 40.0), resets={"inn": 5}),
    ]
    lengths = [apart[i, j] for i, j in arcs]
    uses = np.column_stack([np.zeros(len(arcs)), draw.uniform(0, 600 / count**0.5, len(arcs))])
    return ResourceRouting(
        kinds.tolist(),
        resources,
        0,
        count - 1,
        arcs=arcs,
        lengths=lengths,
        uses=uses,
        revisits=True,
    )


@pytest.mark.parametrize("name", ROWS)
def test_what_generality_costs(name: str, capsys: Any) -> None:
    model = CASES[name].fresh()
    special, one = least(20, lambda: ct.solve(model, "label-setting"))
    general, other = least(20, lambda: ct.solve(model, NAME))
    assert general.primal_bound == pytest.approx(special.primal_bound, rel=1e-12)
    with capsys.disabled():
        print(f"\n{name}: {other * 1e3:.2f} ms, {other / one:.1f} times label-setting")


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", ROWS)
def test_beside_highs(name: str, limit: float, capsys: Any) -> None:
    model = CASES[name].fresh()
    general, own = least(5, lambda: ct.solve(model, NAME))
    begin = time.perf_counter()
    found = ct.solve(model, "highs", formulation="arc-flow", time_limit=limit)
    seconds = time.perf_counter() - begin
    assert found.dual_bound is None or found.dual_bound <= general.primal_bound * (1 + 1e-6)
    with capsys.disabled():
        print(f"\n{name}: highs {seconds:.2f} s ({found.termination}), {seconds / own:.0f} times")


@pytest.mark.timeout(0)
@pytest.mark.parametrize("count", [100, 300, 1000])
def test_beside_cspy(count: int, limit: float, capsys: Any) -> None:
    ratios = []
    for seed in range(3):
        model = neighbours(count, seed)
        general, own = least(5, lambda model=model: ct.solve(model, NAME))
        plan, seconds = labelling_peer.run(model, limit)
        if seconds < limit:
            assert (plan is None) == (general.termination == "infeasible")
        if plan is not None:
            checked = ct.verify(model, plan)
            assert checked.ok
            assert checked.objective == pytest.approx(general.primal_bound, rel=1e-9)
        more = "more than " if seconds >= limit else ""
        ratios.append(f"{more}{seconds / own:.0f} ({general.termination})")
    with capsys.disabled():
        print(f"\n{count} points: cspy takes {', '.join(ratios)} times as long")
