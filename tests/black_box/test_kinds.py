"""Integers, categories, conditions, constraints and several objectives of black boxes: the model."""

import json
import math

import numpy as np
import pytest
from black_box.searches import box

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import BlackBoxMinimisation, Model
from crosstrack.models.black_box import BlackBoxPoint
from crosstrack.models.black_box.fronts import hypervolume, non_dominated
from crosstrack.models.black_box.variables import Variable

UNIT = ((0, 1), (0, 1))
COLOURS = {"type": "category", "values": ["red", "green", "blue"]}


def test_new_fields_keep_the_old_digests_and_files():
    """The digests are those of the version before the fields existed."""
    assert box("booth", (-10, 10), (-10, 10), budget=500).digest == (
        "35527bd0dded81054e397a71ea0d486ca278f1961eef7ef8acad8cd7f2f0504a"
    )
    far = {"name": "ackley", "shift": [0.1, -1e9], "stretch": 1e-3, "deviation": 0.5}
    model = box(far, (-1e9, 1e9), (1e-9, 1e-9), budget=17, samples=3)
    assert model.digest == "f95fe8fbb15292d526fd06fb80f030a5026cc5b4ea723eb1990a7ecfcd3c828a"
    assert set(json.loads(model.to_json())["data"]) == {"function", "bounds", "budget", "samples"}
    plan = BlackBoxPoint((0.5, 0.5))
    assert plan.to_data() == {"x": [0.5, 0.5]} and BlackBoxPoint.from_data(plan.to_data()) == plan


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"variables": ["real"]}, "variables has 1 entries where bounds has 2", "variables"),
        ({"variables": ["real", "whole"]}, r"variables\[1\]: type must be one of real, integer, category, got 'whole'", "variables"),
        ({"variables": ["real", 3]}, r"variables\[1\]: .*must be an object, got 3", "variables"),
        ({"variables": ["real", {"type": "category"}]}, r"variables\[1\]: .*'category' needs values", "variables"),
        ({"variables": ["real", {"values": [1]}]}, r"variables\[1\]: .*'real' has no values", "variables"),
        ({"variables": ["real", {"type": "category", "values": [1, 1]}]}, "each once, got", "variables"),
        ({"variables": ["real", {"type": "category", "values": []}]}, "at least one value", "variables"),
        ({"variables": ["real", "integer"], "bounds": [[0, 1], [0.5, 2]]}, r"bounds\[1\] .*'integer' must be whole numbers.*got \[0.5, 2.0\]", "bounds"),
        ({"variables": ["real", "integer"], "bounds": [[0, 1], [0, 1e17]]}, "whole numbers up to 2.53", "bounds"),
        ({"variables": ["real", COLOURS], "bounds": [[0, 1], [0, 3]]}, "whole numbers from 0 to 2, got", "bounds"),
        ({"variables": ["real", {"when": {"variable": 0, "in": [1]}}]}, r"variables\[1\].when.variable must be the index of an integer or a category, got 0", "variables"),
        ({"variables": ["integer", {"when": {"variable": 0, "in": [0.5]}}]}, r"values of variable 0 .* got 0.5", "variables"),
        ({"variables": ["integer", {"when": {"variable": 9, "in": [1]}}]}, "got 9", "variables"),
        ({"variables": ["integer", {"when": {"variable": 0, "in": [7]}}]}, r"values of variable 0 within its bounds \(0 … 1\), got 7", "variables"),
        ({"variables": [{**COLOURS, "values": ["a", "b"]}, {"when": {"variable": 0, "in": ["c"]}}]}, r"\('a', 'b'\), got 'c'", "variables"),
        ({"variables": ["integer", {"when": {"variable": 0}}]}, "the keys 'variable' and 'in'", "variables"),
        ({"variables": [{"type": "integer", "when": {"variable": 1, "in": [1]}}, {"type": "integer", "when": {"variable": 0, "in": [1]}}]}, "variables 0, 1 have conditions that depend", "variables"),
        ({"inequalities": -1}, "inequalities must be >= 0", "inequalities"),
        ({"equality_tolerance": 0}, "equality_tolerance must be > 0", "equality_tolerance"),
        ({"objectives": 5}, "objectives must be <= 4, got 5", "objectives"),
        ({"objectives": 2}, "reference must be 2 numbers for 2 objectives, got None", "reference"),
        ({"objectives": 2, "reference": [1]}, "reference must be 2 numbers", "reference"),
        ({"reference": [1]}, r"reference must be None for 1 objective, got \[1.0\]", "reference"),
        ({"repeats": 11, "budget": 10}, "repeats must be at most the budget of 10, got 11", "repeats"),
        ({"function": "sphere", "inequalities": 1}, "'named' returns one number", "function"),
    ],
)  # fmt: skip
def test_bad_fields_are_refused_with_field_and_value(fields, message, field):
    asked = {"function": lambda x: 0.0, "bounds": UNIT, **fields}
    with pytest.raises(InvalidData, match=message) as caught:
        BlackBoxMinimisation(**asked)
    assert caught.value.field == field


def test_json_carries_kinds_and_conditions():
    kinds = ["integer", COLOURS, {"when": {"variable": 1, "in": ["green", 2]}}, "real"]
    model = box("sphere", (0, 5), (0, 2), (-1, 1), (0, 1), variables=kinds, repeats=2)
    again = Model.from_json(model.to_json())
    assert again == model and again.digest == model.digest
    assert json.loads(model.to_json())["data"]["variables"] == [
        "integer", COLOURS, {"type": "real", "when": {"variable": 1, "in": ["green", 2.0]}}, "real",
    ]  # fmt: skip
    assert (
        model.digest
        != box(
            "sphere", *model.bounds.tolist(), variables=["integer"] * 2 + ["real"] * 2, repeats=2
        ).digest
    )
    assert isinstance(model.variables[0], Variable) and model.variables[0].type == "integer"
    assert model.describe() == "4 variables (2 discrete), 10000 evaluations, 2 per point"


def test_equal_designs_are_equal_points():
    kinds = [
        COLOURS,
        {"type": "integer", "when": {"variable": 0, "in": ["blue"]}},
        {"when": {"variable": 1, "in": [3]}},
    ]
    layout = box("sphere", (0, 2), (1, 3), (-5, 5), variables=kinds).layout
    points = np.array([[2.4, 3.2, 1.5], [2, 2, 1.5], [1, 3, 1.5], [-9, 3, 1.5]])
    expected = [[2, 3, 1.5], [2, 2, -5], [1, 1, -5], [0, 1, -5]]
    np.testing.assert_array_equal(layout.canonical(points), expected)
    np.testing.assert_array_equal(layout.canonical(layout.canonical(points)), expected)


@pytest.mark.parametrize(
    ("x", "bad"),
    [
        ((2, 3, 1.5), ""), ((1, 1, -5), ""),
        ((1, 1, 1.5), "variables whose condition fails: VIOLATED, worst 1 at x[2]"),
        ((2, 2.5, -5), "integers and categories: VIOLATED, worst 1 at x[1]"),
        ((2, 3 + 1e-9, -5), "integers and categories: VIOLATED"),
        ((2, 4, -5), "bounds: VIOLATED"),
    ],
)  # fmt: skip
def test_kinds_and_conditions_are_verified_exactly(x, bad):
    kinds = [
        COLOURS,
        {"type": "integer", "when": {"variable": 0, "in": ["blue"]}},
        {"when": {"variable": 1, "in": [3]}},
    ]
    checked = box("sphere", (0, 2), (1, 3), (-5, 5), variables=kinds).verify(BlackBoxPoint(x))
    assert checked.ok is (not bad) and bad in str(checked)


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1e-6, 1.0, 1e6, 1e300])
@pytest.mark.parametrize("excess", [1e-12, 1e-6, 1.0])
def test_a_violated_inequality_is_never_accepted(scale, excess):
    model = box(lambda x: [x[0], scale * (x[0] - 0.5), -scale], *UNIT, inequalities=2)
    assert model.verify(BlackBoxPoint((0.5, 0))).ok
    checked = model.verify(BlackBoxPoint((0.5 + excess, 0)), tolerance=0.9)
    if scale * excess > 0:
        assert (
            not checked.ok and "inequalities: VIOLATED" in str(checked) and "g[0]" in str(checked)
        )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_equalities_hold_within_their_own_tolerance(scale):
    model = box(
        lambda x: [x[0], scale * (x[0] - 0.5)], *UNIT, equalities=1, equality_tolerance=1e-3 * scale
    )
    for excess, ok in ((0, True), (9e-4, True), (-9e-4, True), (1.1e-3, False), (-1.1e-3, False)):
        checked = model.verify(BlackBoxPoint((0.5 + excess, 0)), tolerance=0.9)
        assert checked.ok is ok and not checked.within_tolerance


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_constraint_without_a_value_is_no_plan(bad):
    checked = box(lambda x: [1.0, bad], *UNIT, inequalities=1).verify(BlackBoxPoint((0, 0)))
    assert not checked.ok and checked.objective is None


@pytest.mark.parametrize(
    ("returned", "message"),
    [([1.0, 2.0], "must return 3 numbers, got"), (1.0, "must return 3 numbers"), ([1, "a", 2], "must return 3")],
)  # fmt: skip
def test_a_function_must_return_every_column(returned, message):
    model = box(lambda x: returned, *UNIT, inequalities=1, equalities=1)
    with pytest.raises(InvalidData, match=message) as caught:
        model.verify(BlackBoxPoint((0, 0)))
    assert caught.value.field == "function"


def test_a_vectorised_function_must_not_return_the_transpose():
    call = ct.models.black_box.PythonFunction(lambda x: np.zeros((2, len(x))), vectorized=True)
    with pytest.raises(InvalidData, match=r"an array of shape \(3, 2\)"):
        box(call, *UNIT, inequalities=1).oracle()(np.zeros((3, 2)))


def test_the_oracle_answers_columns_and_counts_repeats():
    calls = []

    def noisy(x):
        calls.append(x)
        return [len(calls), x[0] - 0.5]

    model = box(noisy, *UNIT, inequalities=1, repeats=3, budget=10)
    oracle = model.oracle()
    np.testing.assert_array_equal(oracle(np.array([[0.25, 0], [1, 0]])), [[2, -0.25], [5, 0.5]])
    assert len(calls) == 6
    with pytest.raises(InvalidData, match="6 evaluations asked for, 4 of 10 left"):
        oracle(np.zeros((2, 2)))
    whole = box("sphere", (0, 3), variables=["integer"]).oracle()
    with pytest.raises(InvalidData, match=r"x\[0\] must be a value of its variable.*got 1.5"):
        whole(np.array([[1.5]]))


# -- fronts ------------------------------------------------------------------------------------------


def test_the_hypervolume_equals_a_count_of_cells():
    """Integer objectives: the dominated cells of a grid can be counted."""
    generator = np.random.default_rng(0)
    for _ in range(300):
        m, n, side = generator.integers(2, 5), generator.integers(1, 8), 6
        values = generator.integers(-1, side + 2, (n, m)).astype(float)
        reference = np.full(m, float(side))
        cells = np.stack(np.meshgrid(*[np.arange(-1, side)] * m, indexing="ij"), -1).reshape(-1, m)
        count = (values[:, None] <= cells).all(axis=2).any(axis=0).sum()
        assert hypervolume(values, reference) == count


def test_the_hypervolume_equals_that_of_pymoo():
    hv = pytest.importorskip("pymoo.indicators.hv").HV
    generator = np.random.default_rng(1)
    for m in (2, 3, 4):
        values = generator.random((20, m))
        assert hypervolume(values, np.ones(m)) == pytest.approx(hv(np.ones(m))(values), rel=1e-12)


def test_dominated_rows_are_found():
    values = np.array([[0, 1], [1, 0], [1, 1], [0, 1], [2, -1.0]])
    assert non_dominated(values).tolist() == [True, True, False, True, True]
    assert non_dominated(np.empty((0, 2))).tolist() == []


def test_a_front_is_verified_by_its_hypervolume():
    model = box(
        lambda x: [x[0], 1 - x[0], x[1] - 0.5],
        *UNIT,
        objectives=2,
        reference=[1, 1],
        inequalities=1,
    )
    plan = model.as_plan({"x": [0.5, 0], "front": [[0.25, 0], [0.5, 0], [0.75, 0.5]]})
    checked = model.verify(plan)
    assert checked.ok and checked.objective == -(0.25 * 0.75 + 0.25 * 0.5 + 0.25 * 0.25)
    assert model.plan_from_data(json.loads(json.dumps(model.plan_to_data(plan)))) == plan
    assert model.verify(BlackBoxPoint((0.5, 0))).objective == -0.25
    outside = model.verify(model.as_plan({"x": [0.5, 0], "front": [[0.25, 0], [0.5, 0.75]]}))
    assert (
        not outside.ok
        and "front[1], g[0]" in str(outside)
        and "x is in the front: VIOL" in str(outside)
    )
    worse = model.verify(model.as_plan({"x": [0.5, 0], "front": [[0.5, 0], [0.5, 0.5]]}))
    assert worse.ok, "equal objectives are no domination"
    model = box(lambda x: [x[0], x[1]], *UNIT, objectives=2, reference=[1, 1])
    worse = model.verify(model.as_plan({"x": [0.5, 0], "front": [[0.5, 0], [0.5, 0.5]]}))
    assert not worse.ok and "dominated by another point: VIOLATED, worst 1 at front[1]" in str(
        worse
    )
    for data, message in (
        ({"x": [0, 0], "front": []}, "front must hold at least one point"),
        ({"x": [0, 0], "front": [[0]]}, r"front\[0\] must have 2 entries as x, got \[0.0\]"),
    ):
        with pytest.raises(InvalidData, match=message):
            model.as_plan(data)
    with pytest.raises(InvalidData, match="front must be None for a model with one objective"):
        box("sphere", *UNIT).verify(plan)


# -- pictures and diagnosis ----------------------------------------------------------------------------


def test_infeasible_points_are_shaded_and_fronts_are_points():
    pytest.importorskip("matplotlib", reason="pictures need matplotlib")
    disc = box(lambda x: [x.sum(), ((x - 0.5) ** 2).sum() - 0.04], *UNIT, inequalities=1)
    axes = ct.plot(disc, BlackBoxPoint((0.5, 0.5)), points=31).axes[0]
    assert any(part.get_gid() == "infeasible" for part in axes.collections)
    plain = ct.plot(box("sphere", *UNIT), BlackBoxPoint((0.5, 0.5)), points=11).axes[0]
    assert not any(part.get_gid() == "infeasible" for part in plain.collections)
    for count in (2, 3):
        model = box(
            lambda x, n=count: [x[0], 1 - x[0], x[1]][:n],
            *UNIT,
            objectives=count,
            reference=[1] * count,
        )
        plan = model.as_plan({"x": [0.5, 0], "front": [[0.25, 0], [0.5, 0], [0.75, 0]]})
        panels = ct.plot(model, plan).axes
        assert len(panels) == (1 if count == 2 else 3)
        (points,) = [
            line
            for line in panels[0].lines
            if len(line.get_xdata()) == 3 and line.get_marker() == "o"
        ]
        np.testing.assert_array_equal(points.get_xydata(), [[0.25, 0.75], [0.5, 0.5], [0.75, 0.25]])


def test_a_diagnosis_names_violated_constraints():
    found = ct.diagnose(
        box(lambda x: [x[0], 0.75 - x[0]], (0, 1), variables=["integer"], inequalities=1)
    )
    assert found.feasible is True and "all constraints hold at 1 of 3 points" in found.summary
    assert "at the corner (low) g[0] is violated by 0.75" in str(found)
    never = ct.diagnose(box(lambda x: [x[0], 1.0], (0, 1), inequalities=1))
    assert never.feasible is None and "violated at all of 3 points" in never.summary
