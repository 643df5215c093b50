"""Time per decision of the classical policies, and D* Lite compared with A* from scratch on large maps.

The first decision of D* Lite searches the whole map once, and is reported separately. The test fails if the two
policies take different steps. A* of ``crosstrack.models.grid_path`` is timed on the same known
maps for comparison. It may return any shortest path, while the policies must return a certain one.
Slowness does not fail the test, except in the first assertions. Run with ``make bench``, or::

    pytest tests/benchmarks/unknown_grid/test_replanning_speed.py -s
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from unknown_grid.scenes import run

from crosstrack.instances.unknown_grid import clutter, draw_scenes, maze
from crosstrack.models.grid_path.search_kernels import sweep
from crosstrack.models.unknown_grid import NavigationRuns, UnknownGridNavigation
from crosstrack.models.unknown_grid.world import Looks
from crosstrack.solvers.unknown_grid.baselines import (
    BaselineOne,
    BaselineOneReachable,
    BaselineTwo,
    BaselineTwoReachable,
)
from crosstrack.solvers.unknown_grid.native import NavigationBackend, Policy
from crosstrack.solvers.unknown_grid.replanning import (
    AStarReplanning,
    CurrentView,
    DStarLite,
    Replanning,
)

SMALL = (
    DStarLite, AStarReplanning, CurrentView,
    BaselineOne, BaselineOneReachable, BaselineTwo, BaselineTwoReachable,
)  # fmt: skip
#: Number of decisions on a large map. In a maze A* takes 0.1 s per decision.
DECISIONS = 300
LARGE = {
    "maze": lambda **fields: maze(1001, 1001, **fields),
    "clutter, 20 % blocked": lambda **fields: clutter((1000, 1000), 0.2, **fields),
    "clutter, 35 % blocked": lambda **fields: clutter((1000, 1000), 0.35, **fields),
}


class Timed:
    """Policy that records the time (s) of each decision."""

    def __init__(self, policy: Policy, spent: list[float], swept: list[float]) -> None:
        self.policy, self.spent, self.swept = policy, spent, swept

    def decide(self, looks: Looks) -> Any:
        begin = time.perf_counter()
        action = self.policy.decide(looks)
        self.spent.append(time.perf_counter() - begin)
        if isinstance(self.policy, Replanning) and not self.policy.repairs:
            known, flag = self.policy, np.zeros(1, np.int8)
            goals, target = known.cells(looks.positions), int(known.ends[0, 1])
            begin = time.perf_counter()
            sweep(known.walls[0], known.width, target, goals, False, False, True, flag)
            self.swept.append(time.perf_counter() - begin)
        return action


def timed(
    backend: NavigationBackend, model: UnknownGridNavigation
) -> tuple[NavigationRuns, list[float], list[float]]:
    """Return the plan, the time (s) of each decision, and that of the other A*."""
    spent: list[float] = []
    swept: list[float] = []
    make = backend.policy

    def policy(*given: Any) -> Policy:
        return Timed(make(*given), spent, swept)

    backend.policy = policy  # type: ignore[method-assign]
    return run(backend, model).point, spent, swept


@pytest.mark.timeout(0)
def test_decisions_on_the_papers_size(capsys: Any) -> None:
    """At most a millisecond each, once the loops are compiled."""
    lines = ["| policy | ms a decision |", "|---|---|"]
    model = draw_scenes("walls", obstacles=4, scenes=100)
    for backend in SMALL:
        run(backend(), draw_scenes("walls", scenes=1, seed=1))  # compiles
        found = run(backend(), model).statistics["ms a decision"]
        lines.append(f"| {backend.name} | {found:.4f} |")
        assert found <= 1.0
    show(capsys, model.describe(), lines)


@pytest.mark.timeout(0)
@pytest.mark.parametrize("law", LARGE)
def test_large_maps(law: str, capsys: Any) -> None:
    """From the same steps on the same map, in one run."""
    for backend in (DStarLite(), AStarReplanning()):
        timed(backend, maze(9, 9))  # compiles
    model = LARGE[law](steps=DECISIONS)
    plan, repaired, _ = timed(DStarLite(), model)
    other, anew, swept = timed(AStarReplanning(), model)
    assert plan == other
    lines = [
        "| | first decision, ms | later ones, ms | all, s | of A* from scratch |",
        "|---|---|---|---|---|",
    ]
    for name, spent in (
        ("D* Lite", repaired),
        ("A* from scratch", anew),
        ("A* of grid-path from scratch", swept),
    ):
        lines.append(
            f"| {name} | {1e3 * spent[0]:.3g} | {1e3 * np.mean(spent[1:]):.3g} | {sum(spent):.3g} | "
            f"later {np.sum(spent[1:]) / np.sum(anew[1:]):.4f}, all {sum(spent) / sum(anew):.3f} |"
        )
    assert sum(repaired[1:]) < sum(anew[1:])
    whole = LARGE[law](steps=10**6)
    begin = time.perf_counter()
    reached, spent, _ = timed(DStarLite(), whole)
    lines.append(
        f"D* Lite to the end: {reached.outcomes[0]} after {len(spent)} decisions, "
        f"{sum(spent):.3g} s in {time.perf_counter() - begin:.3g} s with the simulator"
    )
    show(capsys, f"{law}: {model.describe()}", lines)


def show(capsys: Any, title: str, lines: list[str]) -> None:
    with capsys.disabled():
        print(f"\n{title}", *lines, sep="\n", flush=True)
