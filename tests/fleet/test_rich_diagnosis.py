"""Diagnosis of rich fleets without a plan: it names the node or the load."""

import math
from typing import Any

import numpy as np
import pytest
from fleet.rich_oracle import enumerate_best
from fleet.rich_random import random_rich

import crosstrack as ct
from crosstrack.models import FleetRouting
from crosstrack.solvers.fleet.diagnosis import _too_heavy, _unserved

POINTS = [[0, 0], [3, 0], [0, 4], [5, 5]]


@pytest.mark.parametrize(
    ("fields", "text", "where"),
    [
        ({"demands": [0, 2, 2, 2], "capacity": 2.5}, "all nodes take 6, and all vehicles give 5", ""),
        ({"pickups": [0, 2, 2, 9], "capacity": 5}, "node 3 brings 9", "node 3"),
        (
            {"demands": [[0, 0], [1, 1], [1, 7], [1, 1]], "capacity": [[3, 3], [3, 3]]},
            "node 2 takes 7 in dimension 1",
            "node 2",
        ),
        ({"windows": [None, (0, 1), None, None]}, "vehicle 0 violates 'service within a window' by 2 s", "node 1"),
        ({"requires": [[], [], ["lift"], []], "skills": [[], ["crane"]]}, "'skills of the vehicle'", "node 2"),
    ],
)  # fmt: skip
def test_names_the_node_or_the_load(fields: dict[str, Any], text: str, where: str) -> None:
    model = FleetRouting(2, points=POINTS, objective="sum", **({"service": np.zeros(4)} | fields))
    found = ct.diagnose(model)
    # Without compiled kernels, the proof for windows and skills may exceed the limit of a loaded machine.
    assert found.feasible is False or (
        found.feasible is None and {"windows", "requires"} & set(fields)
    )
    assert text in found.summary
    assert found.findings[0].where == where


def test_reloads_and_prizes_are_no_conflict_of_loads() -> None:
    loads: dict[str, Any] = {"objective": "sum", "demands": [0, 2, 2, 2], "capacity": 2.5}
    cases: list[dict[str, Any]] = [
        {"reloads": [0]},
        {"prizes": [None, 9.0, 9.0, 9.0], "objective": "cost"},
    ]
    for fields in cases:
        pytest.importorskip("pyvrp", reason="PyVRP is an extra")
        model = FleetRouting(2, points=POINTS, **(loads | fields))
        assert ct.diagnose(model, time_limit=1.0).feasible is True


ROUNDABOUT = np.array([[0, 1, 9, 1], [1, 0, 1, 1], [9, 1, 0, 1], [1, 1, 1, 0]], float)


@pytest.mark.parametrize(
    "fields",
    [
        {"pickups": [0, 1, 0, 1], "demands": [0, 0, 1, 0], "capacity": 5, "backhauls": True},
        {"range_limit": 5.0},
        {"deviation_limit": 5.0},
        {"battery": 6.5, "stations": [1]},
        {"costs": ROUNDABOUT, "points": None, "battery": 6.0},
        {"times": ROUNDABOUT, "windows": [None, None, (0, 3), None]},
    ],
    ids=lambda fields: next(reversed(fields)),
)
def test_a_node_that_longer_routes_serve_is_no_reason(fields: dict[str, Any]) -> None:
    model = FleetRouting(
        2, **({"points": POINTS, "objective": "sum", "service": np.zeros(4)} | fields)
    )
    assert not [*_unserved(model)]


@pytest.mark.parametrize(
    "seeds",
    [range(70), pytest.param(range(70, 4000), marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def test_fleets_with_a_node_that_no_vehicle_serves_have_no_plan(seeds: range) -> None:
    models = [random_rich(np.random.default_rng(seed)) for seed in seeds]
    unserved = [model for model in models if [*_too_heavy(model), *_unserved(model)]]
    assert len(unserved) > len(seeds) / 20
    assert not [model for model in unserved if enumerate_best(model)[0] < math.inf]
