"""Diagnosis of rich fleets without a plan: it names the node or the load."""

from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import FleetRouting

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
    loads = {"demands": [0, 2, 2, 2], "capacity": 2.5}
    free = [None, 9.0, 9.0, 9.0]
    for fields in ({"reloads": [0]}, {"prizes": free, "objective": "cost"}):
        pytest.importorskip("pyvrp", reason="PyVRP is an extra")
        model = FleetRouting(2, points=POINTS, **({"objective": "sum"} | loads | fields))
        assert ct.diagnose(model, time_limit=1.0).feasible is True
