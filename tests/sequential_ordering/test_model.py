"""Model of sequential ordering: input, verification, diagnosis, plots."""

import json

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.sequential_ordering import generate_ordering
from crosstrack.models import SequentialOrdering, SequentialOrderingPlan

FOUR = [[0, 3, 1, 9], [9, 0, 2, 5], [9, 4, 0, 1], [9, 9, 9, 0]]


@pytest.mark.parametrize(
    ("distances", "precedence", "message"),
    [
        ([[0]], (), r"distances must be those of 2 … 3000 nodes, got 1"),
        ([[0, 1, 2], [1, 0, 2]], (), "distances"),
        ([[0, -1], [1, 0]], (), r"distances\[0, 1\] must be >= 0"),
        ([[0, float("nan")], [1, 0]], (), "must be finite"),
        ([[0, 1e308], [1, 0]], (), "small enough to be added up"),
        ([[0, 2e307], [1, 0]], (), "small enough to be added up"),
        (FOUR, [[1, 4]], r"precedence\[0, 1\] must be in 0 … 3, got 4"),
        (FOUR, [[1, 2], [2, 0]], r"precedence\[1\] must give the first node 0 no predecessor, got 2 before 0"),
        (FOUR, [[3, 1]], r"precedence\[0\] must give the last node 3 no successor, got 3 before 1"),
        (FOUR, [[1, 2], [2, 1]], r"precedence must have no cycle, got (1 -> 2 -> 1|2 -> 1 -> 2)"),
        (FOUR, [[1, 1]], "precedence must have no cycle, got 1 -> 1"),
        (FOUR, [[1, -1]], r"precedence\[0, 1\] must be >= 0"),
    ],
)  # fmt: skip
def test_invalid_data_is_named(distances, precedence, message):
    with pytest.raises(InvalidData, match=message):
        SequentialOrdering(distances, precedence=precedence)


def test_verification_names_every_violation():
    model = SequentialOrdering(FOUR, precedence=[[1, 2]], ids=["a", "b", "c", "d"])
    good = model.verify(SequentialOrderingPlan([0, 1, 2, 3]))
    assert (good.ok, good.objective) == (True, 6.0)
    for order, name, place in (
        ([0, 2, 1, 3], "precedence", "b before c"),
        ([1, 0, 2, 3], "first and last node", "first node a"),
        ([0, 1, 3, 2], "first and last node", "last node d"),
        ([0, 1, 3], "each node once", "node c"),
        ([0, 1, 2, 2, 3], "each node once", "node c"),
        ([], "first and last node", "first node a"),
    ):
        wrong = model.verify(SequentialOrderingPlan(order))
        assert name in [check.name for check in wrong.violated], order
        assert place in str(wrong), (order, str(wrong))
    lacks = SequentialOrdering([[0, 1, None], [1, 0, None], [1, 1, 0]])
    found = lacks.verify(SequentialOrderingPlan([0, 1, 2]))
    assert [check.name for check in found.violated] == ["no missing arc"]
    assert "1-2" in str(found)
    with pytest.raises(InvalidData, match="order"):
        model.verify(SequentialOrderingPlan([0, 7, 2, 3]))


def test_json_keeps_the_digest():
    model = SequentialOrdering(
        [[0, 1, None], [1, 0, 2.5], [1, 1, 0]], precedence=[[0, 1]], ids=("s", 1, "e")
    )
    again = type(model).from_json(model.to_json())
    assert again.digest == model.digest
    assert json.loads(model.to_json())["data"]["distances"][0][2] is None
    plan = SequentialOrderingPlan((0, 1, 2))
    assert again.plan_from_data(model.plan_to_data(plan)) == plan
    assert str(plan) == "0-1-2"


def test_arcs_exclude_implied_intermediate_nodes():
    model = SequentialOrdering(np.ones((5, 5)), precedence=[[1, 2], [2, 3], [1, 3]])
    assert model.links.tolist() == [[1, 2], [2, 3]]
    assert np.argwhere(model.arcs).tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert ct.solve(model).plan.order == (0, 1, 2, 3, 4)


def test_diagnosis():
    assert ct.diagnose(generate_ordering(12, 9, 30, 0)).feasible is True
    stuck = ct.diagnose(
        SequentialOrdering([[0, 1, 1, 1], [1, 0, None, None], [1, 1, 0, 1], [1, 1, 1, 0]])
    )
    assert stuck.feasible is False
    assert "node 1 has no possible direct successor" in str(stuck)
    both = np.full((4, 4), np.inf)
    both[0, 1] = both[0, 2] = both[1, 3] = both[2, 3] = 1.0
    found = ct.diagnose(SequentialOrdering(both))
    assert found.feasible is False
    assert "arcs are missing" in found.summary
    assert ct.solve(SequentialOrdering(both)).termination == "infeasible"


def test_plots():
    model = generate_ordering(8, 9, 30, 1)
    plan = ct.solve(model).plan
    for shown in (None, plan, SequentialOrderingPlan(plan.order[::-1]), SequentialOrderingPlan(())):
        figure = ct.plot(model, shown)
        assert len(figure.axes) == 1 + (shown is not None)
    wrong = ct.plot(model, SequentialOrderingPlan(plan.order[::-1]))
    assert "wrong order" in " ".join(text.get_text() for text in wrong.legends[0].get_texts())
