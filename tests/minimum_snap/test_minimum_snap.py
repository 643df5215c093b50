"""Minimum-derivative trajectories: the model's data."""

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from minimum_snap.paths import (
    INF,
    NAN,
    TIMES,
    WAYPOINTS,
    make,
    of_order,
)

from crosstrack.errors import InvalidData
from crosstrack.models import MinimumSnap, Model
from crosstrack.models.minimum_snap import FREE, MinimumDerivative


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"waypoints": "abc"}, "waypoints", "must be an array of numbers"),
        ({"waypoints": [0, 1, 3]}, "waypoints", r"shape \(knots, dimensions\), got \(3,\)"),
        ({"waypoints": [[0, 0], [1], [3, 2]]}, "waypoints", r"row|shape"),
        ({"waypoints": [[0, NAN], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be finite, got nan"),
        ({"waypoints": [[0, -INF], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be finite, got -inf"),
        ({"waypoints": [[0, "1"], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be a number, got '1'"),
        ({"waypoints": [[0, True], [1, 2], [3, 2]]}, "waypoints", r"waypoints\[0, 1\] must be a number, got True"),
        ({"waypoints": np.zeros((3, 0))}, "waypoints", "at least 1 dimension"),
        ({"waypoints": np.zeros((3, 2), complex)}, "waypoints", "must be a number"),
        ({"times": [0, 1]}, "times", "times has 2 entries where waypoints has 3"),
        ({"times": [0, 1, 1]}, "times", r"times\[2\] must be > times\[1\] = 1, got 1"),
        ({"times": [0, -1, 1]}, "times", r"times\[1\] must be > times\[0\] = 0, got -1"),
        ({"times": [0, NAN, 1]}, "times", r"times\[1\] must be finite, got nan"),
        ({"times": [0, 1, INF]}, "times", r"times\[2\] must be finite, got inf"),
        ({"times": [0, 1, None]}, "times", r"times\[2\] must be a number, got None"),
        ({"times": [[0, 1, 2]]}, "times", r"shape \(knots,\)"),
        ({"waypoints": [[0, 0]], "times": [0]}, "times", "at least 2 entries, got 1"),
        ({"degree": 6}, "degree", "degree must be >= 2 order - 1 = 7, got 6"),
        ({"degree": 99}, "degree", "degree must be <= 31, got 99"),
        ({"degree": 7.5}, "degree", "must be a whole number"),
        ({"degree": "7"}, "degree", "must be a number, got '7'"),
        ({"degree": True}, "degree", "must be a number, got True"),
        ({"continuity": 8}, "continuity", "continuity must be <= degree = 7, got 8"),
        ({"continuity": -1}, "continuity", "continuity must be >= 0, got -1"),
        ({"start": np.zeros((8, 2))}, "start", "fixes 8 derivatives of a polynomial of degree 7"),
        ({"start": [[0, 0, 0]]}, "start", "start has 3 entries where waypoints has 2"),
        ({"start": [[0, NAN]]}, "start", r"start\[0, 1\] must be finite, got nan"),
        ({"end": [0, 0]}, "end", r"shape \(end rows, dimensions\), got \(2,\)"),
        ({"derivatives": np.zeros((2, 1, 2))}, "derivatives", "derivatives has 2 entries where waypoints has 3"),
        ({"derivatives": np.full((3, 8, 2), INF)}, "derivatives", "fixes 8 derivatives"),
        ({"derivatives": np.ones((3, 1, 2))}, "derivatives", r"derivatives\[0, 0, 0\] is 1, but start\[0, 0\] is 0"),
        (
            {"derivatives": [[[None, None]]] * 2 + [[[None, 2]]], "end": [[None, 1]]},
            "derivatives", r"derivatives\[2, 0, 1\] is 2, but end\[0, 1\] is 1",
        ),
        ({"corridor_lower": 9, "corridor_upper": 8}, "corridor_lower", r"corridor_lower\[0, 0\] must be <= corridor_upper\[0, 0\] = 8, got 9"),
        ({"corridor_lower": np.zeros((3, 2))}, "corridor_lower", r"\(2, 2\) \(segments, dimensions\), got shape \(3, 2\)"),
        ({"corridor_lower": [NAN, 0]}, "corridor_lower", r"corridor_lower\[.*0\] must be finite, got nan"),
        ({"corridor_lower": INF}, "corridor_lower", "must be finite, got inf"),
        ({"corridor_upper": [[2.5], [9]], "waypoints": [[0, 0], [1, 3], [3, 2]]}, "waypoints", r"waypoints\[1\].* 3 of knot 1, axis 1 lies outside the corridor of segment 0: \[-inf, 2.5\]"),
        ({"corridor_upper": [[9], [1.5]]}, "waypoints", r"position 3 of knot 2, axis 0 lies outside the corridor of segment 1"),
        ({"corridor_lower": 0.5}, "waypoints", r"waypoints\[0\]"),
        ({"velocity_limit": -1}, "velocity_limit", "must be >= 0, got -1"),
        ({"velocity_limit": [1, 2, 3]}, "velocity_limit", "one for each of 2 dimensions"),
        ({"velocity_limit": "fast"}, "velocity_limit", "must be an array of numbers"),
        ({"velocity_limit": True}, "velocity_limit", "must be a number, got True"),
        ({"velocity_limit": 1, "start": [[2, 0]]}, "start", r"velocity 2 of knot 0, axis 0 lies outside the velocity limit of segment 0: \[-1, 1\]"),
        ({"acceleration_limit": 1, "end": [[0, 0], [0, -3]]}, "end", r"end\[1\].*acceleration -3 of knot 2, axis 1"),
        ({"jerk_limit": [[9], [1]], "derivatives": [[[None] * 2] * 3, [[None] * 2, [None] * 2, [5, 0]], [[None] * 2] * 3]}, "derivatives", r"derivatives\[1, 2\].*jerk 5 of knot 1, axis 0 .* segment 1"),
        ({"polytope_segments": [0]}, "polytope_normals", "polytope_normals is missing"),
        ({"polytope_offsets": [0.0]}, "polytope_segments", "polytope_segments is missing"),
        ({"polytope_segments": [0], "polytope_normals": [[1, 0]]}, "polytope_offsets", "polytope_offsets is missing"),
        ({"polytope_segments": [2], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be < 2 \(segments\), got 2"),
        ({"polytope_segments": [-1], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be >= 0, got -1"),
        ({"polytope_segments": [0.5], "polytope_normals": [[1, 0]], "polytope_offsets": [9]}, "polytope_segments", r"polytope_segments\[0\] must be whole numbers"),
        ({"polytope_segments": [0, 1], "polytope_normals": [[1, 0], [0, 0]], "polytope_offsets": [9, 9]}, "polytope_normals", r"polytope_normals\[1\] must not be zero"),
        ({"polytope_segments": [0, 1], "polytope_normals": [[1, 0]], "polytope_offsets": [9, 9]}, "polytope_normals", "polytope_normals has 1 entries where polytope_segments has 2"),
        ({"polytope_segments": [1], "polytope_normals": [[2, 0]], "polytope_offsets": [5]}, "waypoints", r"waypoints\[2\] = \[3.0, 2.0\] lies 0.5 m outside half-space 0 of segment 1"),
    ],
)  # fmt: skip
def test_bad_data_names_field_place_and_value(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        make(**changes)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"order": 0}, "order", "order must be >= 1, got 0"),
        ({"order": 9}, "order", "order must be <= 8, got 9"),
        ({"order": 2.5}, "order", "whole number"),
        ({"order": 3, "weights": [1, 1]}, "weights", "one entry for each order 1 … 3"),
        ({"order": 2, "weights": [1, 0]}, "weights", "the last > 0"),
        ({"order": 2, "weights": [-1, 1]}, "weights", r"weights\[0\] must be >= 0, got -1"),
        ({"order": 2, "weights": [NAN, 1]}, "weights", r"weights\[0\] must be finite"),
        ({"order": 2, "weights": 1.0}, "weights", "shape"),
    ],
)
def test_bad_orders_and_weights(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        make(MinimumDerivative, **changes)
    assert caught.value.field == field


def test_an_array_of_infinite_times_or_limits_is_no_surprise():
    assert make(velocity_limit=INF).bounds == ()
    assert not make(velocity_limit=[None, None]).bounded
    assert make(velocity_limit=[None, 3]).bounds[0].upper.tolist() == [[INF, 3], [INF, 3]]
    assert make(corridor_lower=[None, -1]).bounds[0].lower.tolist() == [[-INF, -1]] * 2


def test_minimum_snap_has_no_order():
    with pytest.raises(TypeError, match="order"):
        make(order=3)
    with pytest.raises(TypeError, match="weights"):
        make(weights=[0, 0, 0, 1])
    with pytest.raises(ValueError, match="order"):
        replace(make(), order=3)
    with pytest.raises(InvalidData, match="unknown key 'order'"):
        MinimumSnap.from_data({**make().data(), "order": 4})


@pytest.mark.parametrize("key", ["snap", "velocity", "name"])
def test_unknown_keys_raise(key):
    data = {"model": "minimum-snap", "data": {**make().data(), key: 1}}
    with pytest.raises(InvalidData, match=f"unknown key '{key}'"):
        Model.from_json(json.dumps(data))


def test_missing_keys_raise():
    data = make().data()
    del data["times"]
    with pytest.raises(InvalidData, match="key 'times' is missing"):
        MinimumSnap.from_data(data)


def test_defaults_written_out_are_the_same_content():
    zeros = np.zeros((3, 2))
    assert make().digest == make(start=zeros, end=-zeros, degree=7, continuity=3).digest
    assert make().digest == make(name="läbel").digest
    assert make().digest == make(times=[0, 1, 3], waypoints=np.array(WAYPOINTS, np.float32)).digest
    assert make().digest != make(continuity=2).digest
    assert make().digest != make(degree=9).digest
    assert make().digest != make(start=[[0, 0]]).digest
    assert make(velocity_limit=3).digest == make(velocity_limit=[[3, 3], [3, 3]]).digest
    assert make().digest != of_order(4).digest  # another name in JSON
    assert of_order(3).digest == of_order(3, degree=5, continuity=2, start=zeros[:2]).digest


def test_waypoints_fixed_twice_alike_are_one_content_or_refused():
    rows = np.full((3, 3, 2), FREE)
    rows[0] = 0.0
    assert np.array_equal(make(derivatives=rows).conditions, make().conditions)


@pytest.mark.parametrize(
    "model",
    [
        make(name="läbel"),
        make(waypoints=[[0, 0], [None, 2], [3, FREE]]),
        make(start=[[None, 1]], end=[[None, None]]),
        make(start=np.zeros((0, 2))),
        make(derivatives=np.full((3, 2, 2), FREE)),
        make(corridor_lower=[None, -1], corridor_upper=[[4], [None]], velocity_limit=[[None], [2.5]]),
        make(polytope_segments=[0, 1], polytope_normals=[[1, 1], [0, 1]], polytope_offsets=[9, 8.5]),
        of_order(3, weights=[0, 0.5, 1], degree=8, continuity=1),
        of_order(1),
        of_order(1, degree=4),
        make(
            polytope_segments=np.zeros(0, int), polytope_normals=np.zeros((0, 2)),
            polytope_offsets=np.zeros(0),
        ),
        make(derivatives=np.zeros((3, 0, 2))),
    ],
    ids=lambda model: model.describe(),
)  # fmt: skip
def test_json_and_pickle_are_exact(model):
    text = model.to_json()
    assert "NaN" not in text
    assert "Infinity" not in text
    again = Model.from_json(text)
    thawed = pickle.loads(pickle.dumps(model))
    for other in (again, thawed):
        assert type(other) is type(model)
        assert other.digest == model.digest
        assert other.name == model.name
        assert np.array_equal(other.conditions, model.conditions)
        assert not other.waypoints.flags.writeable
        assert not other.start.flags.writeable
    assert json.loads(again.to_json()) == json.loads(text)


def test_everything_free_at_an_end_can_be_written_as_an_empty_list():
    assert make(start=[]).start.shape == (0, 2)
    assert make(start=[]).digest == make(start=np.zeros((0, 2))).digest


def test_arrays_are_copied_and_frozen():
    given_points = np.array(WAYPOINTS)
    model = make(waypoints=given_points, velocity_limit=3, polytope_segments=[0],
                 polytope_normals=[[2.0, 0]], polytope_offsets=[9.0])  # fmt: skip
    given_points[0, 0] = 7
    assert model.waypoints[0, 0] == 0
    spaces = model.halfspaces
    for array in (
        model.waypoints, model.times, model.durations, model.velocity_limit, model.conditions,
        model.start, model.order_weights, spaces.normals, spaces.offsets, model.polytope_segments,
    ):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1


def test_limits_spread():
    one = make(velocity_limit=2.0).velocity_limit
    assert one.tolist() == [[2, 2], [2, 2]]
    # Two segments in 2-D: a flat list has one number per axis, a column one per segment.
    assert make(velocity_limit=[2, 3]).velocity_limit.tolist() == [[2, 3], [2, 3]]
    assert make(velocity_limit=[[2], [3]]).velocity_limit.tolist() == [[2, 2], [3, 3]]
    assert make(velocity_limit=[[2, 3]]).velocity_limit.tolist() == [[2, 3], [2, 3]]
    assert make(velocity_limit=[[2, 3], [4, 5]]).velocity_limit.tolist() == [[2, 3], [4, 5]]
    long = {"waypoints": np.zeros((4, 2)), "times": [0, 1, 2, 3]}
    with pytest.raises(InvalidData, match="one for each of 2 dimensions"):
        make(**long, velocity_limit=[1, 2, 3])
    assert make(**long, velocity_limit=[[1], [2], [3]]).velocity_limit[2].tolist() == [3, 3]


def test_replace_keeps_explicit_values():
    model = make(velocity_limit=[None, 3], name="a")
    other = replace(model, times=[0, 2, 3])
    assert other.name == "a"
    assert other.durations.tolist() == [2, 1]
    assert np.array_equal(other.velocity_limit, model.velocity_limit)
    assert replace(model, times=TIMES).digest == model.digest


def test_replace_of_the_order_keeps_the_defaults_filled_in():
    """Filled-in defaults are part of the model. Pass those that change with the order."""
    with pytest.raises(InvalidData, match="degree must be >= 2 order - 1 = 9, got 7"):
        replace(of_order(4), order=5)
    changed = replace(of_order(4), order=5, start=None, end=None, degree=None, continuity=None)
    assert changed.digest == of_order(5).digest


def test_half_spaces_are_distances():
    spaces = make(
        polytope_segments=[1], polytope_normals=[[3, 4]], polytope_offsets=[30]
    ).halfspaces
    assert spaces.normals.tolist() == [[0.6, 0.8]]
    assert spaces.offsets.tolist() == [6.0]
    # A waypoint that is free in one coordinate can be moved inside.
    make(waypoints=[[0, 0], [1, 2], [3, None]], end=np.zeros((0, 2)), polytope_segments=[1],
         polytope_normals=[[1, 1]], polytope_offsets=[4])  # fmt: skip


@pytest.mark.parametrize("entry", [math.inf, -math.inf, float("nan"), np.inf])
def test_an_infinity_in_a_list_is_no_free_coordinate(entry):
    with pytest.raises(InvalidData, match=r"waypoints\[1, 0\] must be finite"):
        MinimumSnap([[0], [entry], [1]], [0, 1, 2])


@pytest.mark.parametrize("free", [FREE, None])
def test_a_free_coordinate_is_written_in_words(free):
    model = MinimumSnap([[0], [free], [1]], [0, 1, 2])
    assert model.digest == MinimumSnap(np.array([[0], [FREE], [1]]), [0, 1, 2]).digest
    again = replace(model, times=[0, 1, 3])
    assert np.isinf(again.waypoints[1, 0])
    assert MinimumSnap.from_json(model.to_json()).digest == model.digest


@pytest.mark.parametrize("waypoints", [[[0], [1e308], [-1e308]], [[0], [2e100], [1]]])
def test_coordinates_whose_squares_overflow_are_refused(waypoints):
    """The path was refused by an internal message about its coefficients."""
    with pytest.raises(InvalidData, match=r"waypoints\[1, 0\] must be within ±1e\+100"):
        MinimumSnap(waypoints, [0, 1, 2])
