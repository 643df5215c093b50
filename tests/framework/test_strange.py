"""No file and no call ends in a traceback: damaged instances, plans and arguments, made by a seed."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
import strange
import strangers

from crosstrack.errors import CrosstrackError, InvalidData
from crosstrack.models import Model

#: Every code that the command line may end with; 1 is an internal error.
CODES = {f"exit {code}" for code in (0, 2, 3, 4, 5, 6)}


def judge(what, begin, end):
    counts, faults = strangers.run(what, begin, end)
    print(f"{what} {begin} to {end - 1}: {dict(counts)}")
    assert not faults, "\n\n".join(faults[:5])
    return counts


def test_strange_files_raise_a_named_error():
    counts = judge("files", 0, 40)
    assert set(counts) <= CODES
    assert counts["exit 2"] > 12


def test_strange_calls_are_refused_by_name():
    counts = judge("calls", 0, 150)
    assert set(counts) == {"refused", "success"}
    assert counts["refused"] > 75


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_ten_thousand_strange_files():
    counts = judge("files", 0, 10_000)
    assert set(counts) <= CODES
    assert sum(counts.values()) >= 10_000


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_ten_thousand_strange_calls():
    counts = judge("calls", 0, 10_000)
    assert set(counts) == {"refused", "success"}
    assert sum(counts.values()) == 10_000


def test_a_traceback_a_crash_and_a_hang_are_detected(tmp_path, monkeypatch):
    """The judge itself: a case of each kind is counted as what it is."""
    monkeypatch.setenv("STRANGERS_PATIENCE", "1")
    counts, faults = strangers.run("faults", 0, 5, workers=1)
    assert counts == {"success": 1, "other exception": 1, "crash": 1, "hang": 1, "refused": 1}
    assert len(faults) == 3


@pytest.mark.parametrize("number", [0, 2, 7, 9])
def test_a_separate_process_ends_alike(number, tmp_path):
    instance, plan = strange.strange_file(number)
    (tmp_path / "instance.json").write_bytes(instance)
    (tmp_path / "plan.json").write_bytes(plan)
    done = subprocess.run(
        [sys.executable, "-m", "crosstrack", "check", "instance.json", "plan.json"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert f"exit {done.returncode}" in CODES
    assert "Traceback" not in done.stderr


def test_every_kind_of_model_is_damaged():
    from crosstrack.models import model_types

    kinds = {json.loads(text)["model"] for text, _ in strange.examples()}
    difference = sorted(kinds ^ set(model_types()))
    assert not difference, f"kinds without an instance in _examples of strange.py: {difference}"
    for text, plan in strange.examples():
        model = Model.from_json(text)
        assert model.to_json() == text
        model.verify(model.plan_from_data(json.loads(plan)))


def routing(number):
    """Return a routing instance with `number` as the text of a coordinate."""
    data = {
        **dict.fromkeys(("alpha1", "alpha2", "beta1", "beta2", "theta", "delta"), 1),
        "kinds": ["A", "B"],
    }
    data["points"] = [[0, 0, 0], [1, strange.Raw(number), 0]]
    return strange.written({"model": "error-correction", "data": data})


@pytest.mark.parametrize(
    ("text", "field", "words"),
    [
        (routing("1e400"), "points", "points[1][1] is beyond the range of numbers, got '1e400': write null"),
        (routing("-" + "9" * 5000), "points", "points[1][1] is beyond the range of numbers"),
        (routing("1" + "0" * 400), "points", "points[1, 1] must be within the range of floats"),
        (routing('"\\ud800"'), "points", "points[1][1] holds half a character"),
        (routing("null"), "points", "points[1, 1] must be a number, got None"),
        ('{"model": "error-correction", "name": "\\udfff", "data": {}}', "name", "name holds half a character"),
        ("[" * 100_000, None, "nested too deeply"),
        ("1" * 5000, None, "the data is beyond the range of numbers"),
    ],
)  # fmt: skip
def test_unrepresentable_numbers_and_characters_are_named(text, field, words):
    with pytest.raises(InvalidData) as caught:
        Model.from_json(text)
    assert words in str(caught.value)
    assert caught.value.field == field


def test_a_free_coordinate_is_written_null_and_never_1e400():
    text = '{"model": "minimum-snap", "data": {"waypoints": [[0], [%s], [1]], "times": [0, 1, 2]}}'
    assert Model.from_json(text % "null").waypoints[1, 0] == float("inf")
    with pytest.raises(InvalidData, match=r"waypoints\[1\]\[0\] is beyond .* write null"):
        Model.from_json(text % "1e400")


def program(**changes):
    kinds = {json.loads(text)["model"]: json.loads(text) for text, _ in strange.examples()}
    data = kinds["mixed-integer-program"]["data"]
    return {**kinds["mixed-integer-program"], "data": {**data, **changes}}


BLOCK = {
    "name": "x", "equation": "", "start": 0, "size": 3, "template": "item {0}", "index": [[0], [1], [2]], "unit": "",
}  # fmt: skip
MATRIX = {"shape": [3, 3], "indptr": [0, 1, 2, 3], "indices": [0, 1, 2], "data": [1, 1, 1]}


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"rows": 3}, "rows", "rows must be a list of blocks, got 3"),
        ({"rows": [3]}, "rows", "rows[0]: data must be an object"),
        ({"columns": [{**BLOCK, "name": ["x"]}]}, "columns", "columns[0]: name must be a string"),
        ({"columns": [{**BLOCK, "size": "3"}]}, "columns", "columns[0]: size must be a number"),
        ({"columns": [{**BLOCK, "start": -1}]}, "columns", "columns[0]: start must be >= 0"),
        ({"columns": [{**BLOCK, "index": {"a": 1}}]}, "columns", "columns[0]: index must be an array"),
        ({"columns": [{**BLOCK, "index": [[0]]}]}, "columns", "a row for each of 3 entries, got 1"),
        ({"columns": [{**BLOCK, "index": [[0], [1], [2.5]]}]}, "columns", "index[2, 0] must be whole numbers"),
        ({"columns": [{**BLOCK, "template": "{1}"}]}, "columns", "template must hold {0} and text, got '{1}'"),
        ({"columns": [{**BLOCK, "template": "{0:>9999999999}"}]}, "columns", "template must hold {0}"),
        ({"columns": [{**BLOCK, "template": "{0.__class__}"}]}, "columns", "template must hold {0}"),
        ({"matrix": {**MATRIX, "indices": [0, 1, 9]}}, "matrix", "matrix is no sparse matrix"),
        ({"matrix": {**MATRIX, "indices": [0, 1, -1]}}, "matrix", "indices[2] must be >= 0, got -1"),
        ({"matrix": {**MATRIX, "indptr": [0, 1, 2, -(2**63)]}}, "matrix", "indptr[3] must be >= 0"),
        ({"matrix": {**MATRIX, "indptr": [0, 1, 2, 2]}}, "matrix", "indptr ends at 2, 3 entries are given"),
        ({"matrix": {**MATRIX, "shape": [3]}}, "matrix", "shape must have shape (2,), got (1,)"),
        ({"matrix": {**MATRIX, "data": [1, None, 1]}}, "matrix", "data[1] must be a number, got None"),
        (
            {"matrix": {"shape": [3, 3], "indptr": [0, 2, 2, 2], "indices": [1, 1], "data": [1e308, 1e308]}},
            "matrix", "matrix[0, 1] must be finite, got inf",
        ),
        ({"cost": [10**400, 0, 0]}, "cost", "cost[0] must be within the range of floats"),
        ({"offset": 10**400}, "offset", "offset must be within the range of floats"),
    ],
)  # fmt: skip
def test_malformed_programs_are_named(changes, field, words):
    with pytest.raises(InvalidData) as caught:
        Model.from_dict(program(**changes))
    assert words in str(caught.value)
    assert caught.value.field == field


def test_an_overflow_verifies_no_plan():
    wide = {"column_upper": [None, None, None], "matrix": {**MATRIX, "data": [1e308, 1, 1]}}
    model = Model.from_dict(program(**wide, cost=[1e308, 1e308, 0]))
    found = model.verify(model.plan_from_data([1e5, 2e4, 0]))
    assert not found.ok
    assert found.objective is None
    json.dumps(found.to_dict(), allow_nan=False)
    assert not type(found).from_dict(found.to_dict()).ok
    far = Model.from_json(routing("1.7e308"))
    assert far.verify(far.plan_from_data([0, 1, 0, 1])).objective is None


def test_models_of_equal_content_are_equal():
    from crosstrack.models import Route

    texts = [text for text, _ in strange.examples()]
    for k, text in enumerate(texts):
        model, again = Model.from_json(text), Model.from_json(text).renamed("another")
        assert model == again
        assert hash(model) == hash(again)
        assert {model: k}[again] == k
        assert all(model != Model.from_json(other) for other in texts if other != text)
    assert model != Route((0, 1))
    assert model.blinded() == model


def test_stored_records_are_checked():
    import crosstrack as ct
    from crosstrack.models import Verification

    model = ct.load("error-correction/example-1")
    stored = ct.solve(model).to_dict()
    assert ct.Solution.from_dict({**stored, "later": 1}, model).to_dict() == stored
    for key, value, words in (
        ("termination", "done", "termination must be one of optimal"),
        ("seconds", 3, "seconds must be an object"),
        ("primal_bound", "3", "primal_bound must be a number"),
        ("incumbents", [{"seconds": 1}], "key 'objective' is missing in an incumbent"),
        ("starts", [3], "a solution must be an object"),
        ("verification", {"checks": 3, "objective": 1}, "checks must be a list"),
    ):
        with pytest.raises(InvalidData) as caught:
            ct.Solution.from_dict({**stored, key: value})
        assert words in str(caught.value)
        rest = {name: part for name, part in stored.items() if name != key}
        if key in ("incumbents", "starts"):  # absent means empty
            assert ct.Solution.from_dict(rest, model).to_dict() == {**stored, key: []}
            continue
        with pytest.raises(InvalidData, match=f"key '{key}' is missing"):
            ct.Solution.from_dict(rest)
    with pytest.raises(InvalidData, match="a check must be an object"):
        Verification.from_dict({"objective": 1, "checks": [1]})


@pytest.mark.parametrize("value", [7, {"model": "x"}, None, ["a"], 1.5])
def test_verbs_name_an_argument_that_is_not_a_model(value):
    import crosstrack as ct

    for call in (
        lambda: ct.load(value),
        lambda: ct.solve(value),
        lambda: ct.verify(value, {}),
        lambda: ct.compare(value, ["highs"]),
        lambda: ct.diagnose(value),
    ):
        with pytest.raises(CrosstrackError):
            call()
    model = ct.load("error-correction/example-1")
    with pytest.raises(CrosstrackError, match=r"pool must be a concurrent\.futures\.Executor"):
        ct.compare(model, ["label-setting"], pool=5)
    with pytest.raises(CrosstrackError):
        ct.compare(model, value)
    with pytest.raises(CrosstrackError, match="plan"):
        ct.verify(model, 7)
