"""The model base: coercion, checks with field and index, exact JSON, digest, freezing."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import ErrorCorrectionRouting, Model, Route

POINTS = [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [9, 9, 9], [3.5, 0, 0]]
KINDS = ["A", "horizontal", "vertical", "horizontal", "B"]
DATA = {
    "points": POINTS, "kinds": KINDS, "alpha1": 0.3, "alpha2": 0.3, "beta1": 0.3, "beta2": 0.3,
    "theta": 0.3, "delta": 0.1,
}  # fmt: skip


def make(**changes):
    return ErrorCorrectionRouting(**{**DATA, **changes})


def test_arrays_are_copied_coerced_and_frozen():
    points = np.array(POINTS)
    model = make(points=points)
    points[0, 0] = 7
    assert model.points[0, 0] == 0
    assert model.points.dtype == float
    with pytest.raises(ValueError, match="read-only"):
        model.points[0, 0] = 1
    again = pickle.loads(pickle.dumps(model))
    assert again.digest == model.digest
    with pytest.raises(ValueError, match="read-only"):
        again.points[0, 0] = 1


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"points": [[0, 0, float("nan")], *POINTS[1:]]}, "points", r"points\[0, 2\] must be finite, got nan"),
        ({"points": [[0, 0, float("inf")], *POINTS[1:]]}, "points", r"points\[0, 2\] must be finite"),
        ({"points": [[0, 0], *POINTS[1:]]}, "points", "row 0 must hold 3 numbers"),
        ({"points": [row[:2] for row in POINTS]}, "points", r"shape \(n, 3\), got \(5, 2\)"),
        ({"points": [["0", 0, 0], *POINTS[1:]]}, "points", r"points\[0, 0\] must be a number, got '0'"),
        ({"points": [[None, 0, 0], *POINTS[1:]]}, "points", r"points\[0, 0\] must be a number, got None"),
        ({"points": "abc"}, "points", "must be an array of numbers"),
        ({"points": POINTS[:4]}, "kinds", "kinds has 5 entries where points has 4"),
        ({"kinds": [*KINDS[:3], "sideways", "B"]}, "kinds", r"kinds\[3\] must be one of A, .* got 'sideways'"),
        ({"kinds": ["A", *["horizontal"] * 4]}, "kinds", "'B' exactly once, got none"),
        ({"kinds": ["A", "A", "vertical", "horizontal", "B"]}, "kinds", r"'A' exactly once, got rows \[0, 1\]"),
        ({"alpha1": -1}, "alpha1", "alpha1 must be >= 0, got -1"),
        ({"theta": float("nan")}, "theta", "theta must be finite, got nan"),
        ({"theta": "0.3"}, "theta", "theta must be a number, got '0.3'"),
        ({"theta": True}, "theta", "theta must be a number, got True"),
        ({"delta": -0.1}, "delta", "delta must be >= 0"),
        ({"delta": None}, "horizontal_rate", "horizontal_rate is missing"),
        ({"horizontal_rate": 0.1}, "delta", "give it or horizontal_rate, not both"),
        ({"delta": None, "horizontal_rate": 0.1}, "vertical_rate", "vertical_rate is missing"),
        ({"revisits": 1}, "revisits", "must be true or false, got 1"),
        ({"ids": [1, 2, 2, 3, 4]}, "ids", r"ids\[2\] is 2, as is ids\[1\]"),
        ({"ids": [1, 2]}, "ids", "ids has 2 entries where points has 5"),
        ({"ids": [1, 2, 3.5, 4, 5]}, "ids", r"ids\[2\] must be a whole number or a word"),
    ],
)  # fmt: skip
def test_bad_data_names_field_place_and_value(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        make(**changes)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "no valid JSON"),
        ("[]", "a model must be an object"),
        ('{"model": "error-correction"}', "key 'data' is missing"),
        ('{"model": "error-correction", "data": []}', "data must be an object"),
        ('{"model": "error-correction", "data": {}, "extra": 1}', "unknown key 'extra'"),
        ('{"model": 3, "data": {}}', "model must be a string"),
        ('{"model": "error-correction", "data": {"theta": NaN}}', "NaN is no JSON number"),
        ('{"model": "error-correction", "data": {"theta": 1, "theta": 2}}', "'theta' stands twice"),
        (
            json.dumps({"model": "error-correction", "data": {**DATA, "gamma": 1}}),
            "unknown key 'gamma'",
        ),
        (
            json.dumps(
                {
                    "model": "error-correction",
                    "data": {k: v for k, v in DATA.items() if k != "beta2"},
                }
            ),
            "key 'beta2' is missing",
        ),
        (
            json.dumps({"model": "error-correction", "data": {**DATA, "delta": None}}),
            "delta must be a number",
        ),
    ],
)
def test_bad_json_is_refused(text, words):
    with pytest.raises(InvalidData, match=words):
        Model.from_json(text)


def test_unknown_model_suggests():
    with pytest.raises(UnknownName, match="did you mean 'error-correction'"):
        Model.from_json('{"model": "error-corection", "data": {}}')


def test_name_and_ids_are_labels_outside_the_digest():
    assert make().digest == make(name="x", ids=[10, 11, 12, 13, 14]).digest
    assert make(alpha1=20).digest == make(alpha1=20.0).digest
    assert make(alpha1=20).digest != make(alpha1=21).digest
    assert make().digest == make(delta=None, horizontal_rate=0.1, vertical_rate=0.1).digest
    assert make().digest != make(delta=None, horizontal_rate=0.1, vertical_rate=0.2).digest
    assert make().digest == make(points=np.array(POINTS, np.float32)).digest
    assert make(points=[[-0.0, 0, 0], *POINTS[1:]]).digest == make().digest
    assert make(kinds=["A", 0, "1", "0", "B"]).digest == make().digest


numbers = st.floats(0, 1e6, allow_nan=False)
coordinates = st.floats(-1e9, 1e9, allow_nan=False)


@settings(max_examples=50, deadline=None)
@given(
    rows=st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=6),
    limits=st.tuples(numbers, numbers, numbers, numbers, numbers),
    rates=st.tuples(numbers, numbers),
    revisits=st.booleans(),
    data=st.data(),
)
def test_json_is_exact(rows, limits, rates, revisits, data):
    inner = data.draw(
        st.lists(
            st.sampled_from(["horizontal", "vertical"]),
            min_size=len(rows) - 2,
            max_size=len(rows) - 2,
        )
    )
    model = ErrorCorrectionRouting(
        rows, data.draw(st.permutations(["A", "B", *inner])), *limits,
        horizontal_rate=rates[0], vertical_rate=rates[1], revisits=revisits, name="läbel",
    )  # fmt: skip
    again = Model.from_json(model.to_json())
    assert type(again) is ErrorCorrectionRouting
    assert again.digest == model.digest
    assert again.name == model.name
    assert np.array_equal(again.points, model.points)


def test_verify_walks_the_route():
    model = make()
    found = model.verify(Route((0, 1, 2, 4)))
    assert found.ok
    assert found.objective == pytest.approx(3.5)
    assert not found.within_tolerance
    for route, name in [
        ((0, 1, 2), "ends at B"),
        ((1, 2, 4), "starts at A"),
        ((0, 1, 2, 1, 4), "no point twice"),
        ((0, 3, 4), "horizontal error at horizontal points"),
        ((0, 4, 2, 4), "only correction points between"),
        ((0, 4), "horizontal error at B"),
        ((0, 2, 4), None),
        ((), "starts at A"),
    ]:
        result = model.verify(Route(route))
        if name is None:
            continue
        assert not result.ok
        assert name in [check.name for check in result.violated], route


def test_threshold_met_exactly_is_met_and_a_hair_above_is_marked():
    kinds = ["A", "vertical", "B"]
    for far, ok, marked in (
        (3.0, True, False),
        (3.0 + 2e-6, True, True),
        (3.0 + 5e-6, False, False),
    ):
        model = ErrorCorrectionRouting(
            [[0, 0, 0], [far, 0, 0], [4, 0, 0]], kinds, 0.3, 0.3, 0.3, 0.3, 9, delta=0.1
        )
        found = model.verify(Route((0, 1, 2)))
        assert found.ok is ok
        assert bool(found.within_tolerance) is marked
        if marked:
            assert {check.where for check in found.within_tolerance} == {"point 1"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"route": [0, 9]}, r"route\[1\] must be in 0 … 4, got 9"),
        ({"route": [0, -1]}, "must be in"),
        ({"route": [0, 1.5]}, r"route\[1\] must be a point index"),
        ({"route": [0, True]}, "must be a point index"),
        ({"route": "0-4"}, "must be a list"),
        ({"path": [0, 4]}, "unknown key 'path'"),
        ({}, "needs the key route"),
        ("0-4", "must be a list"),
        (None, "must be a list"),
        ({"ids": [0, 77]}, "no point is called 77"),
        ({"route": [0, 4], "ids": [0, 1, 4]}, "name different points"),
    ],
)
def test_bad_plans_are_refused(data, words):
    with pytest.raises(InvalidData, match=words):
        make().plan_from_data(data)


def test_plans_by_index_and_by_id():
    model = make(ids=["a", "b", "c", "d", "e"])
    route = model.plan_from_data({"ids": ["a", "b", "c", "e"]})
    assert route == Route((0, 1, 2, 4))
    assert model.plan_to_data(route) == {"route": [0, 1, 2, 4], "ids": ["a", "b", "c", "e"]}
    assert model.plan_from_data(model.plan_to_data(route)) == route
    assert make().plan_from_data([0, 1, 2, 4]) == route


def test_formulation_options_are_typed():
    with pytest.raises(UnknownName, match="formulation of model"):
        make().formulate("papper")
    with pytest.raises(UnsupportedOption, match="no option 'bigm'"):
        make().formulate("paper", bigm=3)
    with pytest.raises(UnsupportedOption, match="big_m must be a number > 0, got -1"):
        make().formulate("paper", big_m=-1)
    for name in ("paper", "arc-flow"):
        with pytest.raises(UnsupportedFormulation, match="revisits"):
            make(revisits=True).formulate(name)
