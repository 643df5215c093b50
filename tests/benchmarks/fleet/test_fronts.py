"""All algorithms on TSPLIB at equal time: fronts of total, deviation and longest route.

Each runs for each of several objectives; what is shown of it are those of its plans that no other of
its own betters in all three, and the share of each algorithm's points that none of any algorithm
betters. The paper's table 2 tells neither robots nor fitness, so nothing is compared with it. Run with
``make bench``, or with other seconds a run and other files::

    CROSSTRACK_FLEET_SECONDS=10 CROSSTRACK_FLEET_FILES=eil51,berlin52 \
        pytest tests/benchmarks/fleet/test_fronts.py -s
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.models import FleetRouting

SECONDS = float(os.environ.get("CROSSTRACK_FLEET_SECONDS", "2"))
FILES = os.environ.get("CROSSTRACK_FLEET_FILES", "bayg29,berlin52,st70,eil101,ch150,kroA200").split(
    ","
)
DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "tsplib"
VEHICLES = 3
ON = {"restarts": True}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "fleet-search": {},
    "pso-ac": ON,
    "pso-ac-serial": ON,
    "tpha": ON,
    "kmeans-ac": ON,
    "ortools-routing": {},
    "pyvrp": {},
}
OBJECTIVES: tuple[dict[str, Any], ...] = (
    {"objective": "sum"},
    {"objective": "max-sum"},
    {"objective": "sum-deviation", "q": 1.0},
    {"objective": "sum-deviation", "q": 10.0},
)
#: Of points that count as equal, relatively.
SAME = 1e-9


def places(name: str) -> Any:
    """Return the coordinates of a TSPLIB file; those to draw by where it gives distances."""
    path = DATA / f"{name}.tsp"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there")
    rows, inside = [], False
    for line in path.read_text().splitlines():
        inside = inside and line.split()[:1] != ["EOF"]
        if inside and line.strip():
            rows.append([float(one) for one in line.split()[1:3]])
        inside = inside or line.startswith(("NODE_COORD_SECTION", "DISPLAY_DATA_SECTION"))
    return np.array(rows)


def bettered(one: Any, others: Any) -> bool:
    """Return whether one of `others` is nowhere worse and somewhere better."""
    least = others <= one * (1 + SAME) + SAME
    less = others < one * (1 - SAME) - SAME
    return bool((least.all(axis=1) & less.any(axis=1)).any())


def front(points: Any) -> Any:
    """Return those of the rows that no other betters, each once."""
    kept = np.array([one for one in points if not bettered(one, points)])
    return kept[np.unique(np.round(kept, 6), axis=0, return_index=True)[1]]


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", FILES)
def test_fronts_at_equal_time(name: str, capsys: Any) -> None:
    points = places(name)
    states = {one.name: one for one in ct.backends()}
    known = [one for one in ALGORITHMS if one in states and states[one].state == "installed"]
    assert "pso-ac" in known
    found: dict[str, list[Any]] = {one: [] for one in known}
    for objective in OBJECTIVES:
        model = FleetRouting(VEHICLES, points=points, **objective)
        for backend in known:
            try:
                answer = ct.solve(
                    model, backend, time_limit=SECONDS, seed=1, backend_options=ALGORITHMS[backend]
                )
            except UnsupportedFormulation:
                continue
            assert answer.plan is not None
            assert answer.verification is not None
            assert answer.verification.ok
            found[backend].append(
                [model.second_objective(one, answer.plan) for one in ("sum", "deviation", "max")]
            )
    fronts = {backend: front(np.array(rows)) for backend, rows in found.items()}
    every = np.vstack(list(fronts.values()))
    best = front(every)
    with capsys.disabled():
        print(f"\n{name}, {VEHICLES} robots, {SECONDS:g} s a run: (total, deviation, longest)")
        for backend, rows in fronts.items():
            lasting = sum(not bettered(one, every) for one in rows)
            text = "  ".join(f"({a:.1f}, {b:.2f}, {c:.1f})" for a, b, c in rows)
            print(f"  {backend:16} {lasting} of {len(rows)} lasting   {text}")
    assert len(best) > 0
    for row in best:
        assert not bettered(row, every)
