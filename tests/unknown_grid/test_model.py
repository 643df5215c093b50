"""Model of navigation on unknown grids: validation, files, copies and digests."""

import copy
import dataclasses
import json
import math

import cloudpickle
import numpy as np
import pytest
from hypothesis import given, settings
from unknown_grid.scenes import models

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, UnknownGridNavigation
from crosstrack.models.unknown_grid import Camera, Hover, NavigationRuns, Rendering

ROOM = ["S..@.", ".@.@.", ".@..T"]
#: Minimal data of a model.
SHORT = {
    "blocked": [["..."]], "starts": [[0, 0]], "targets": [[0, 2]], "shape": [1, 3], "view": [1, 3],
}  # fmt: skip


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"blocked": [["..x"]]}, r"blocked\[0\], line 0, column 2 must be one of .* got 'x'", "blocked"),
        ({"blocked": [["...", ".."]]}, r"blocked\[0\], line 1 must have 3 cells .* got 2", "blocked"),
        ({"blocked": [["..."], ["...."]]}, r"blocked\[1\] must have shape \(1, 3\).*got \(1, 4\)", "blocked"),
        ({"blocked": [[[0, 0, 0], [0, 0]]]}, r"blocked\[0\] must have rows of one length", "blocked"),
        ({"blocked": [[[0, 0, 2]]]}, r"blocked\[0, 0, 2\] must be true or false, got 2", "blocked"),
        ({"blocked": [[[0, 0, math.nan]]]}, "blocked must hold true or false", "blocked"),
        ({"blocked": "..."}, "blocked must be an array", "blocked"),
        ({"blocked": [{}]}, "blocked must hold true or false", "blocked"),
        ({"blocked": [[]]}, r"blocked must have shape \(k, rows, columns\)", "blocked"),
        ({"blocked": [["..."]] * 2}, "starts has 1 entries where blocked has 2", "starts"),
        ({"blocked": [], "starts": [], "targets": []}, "at least one scene, got none", "starts"),
        ({"shape": [3, 1]}, r"shape must be that of the maps, \(1, 3\), got \[3, 1\]", "shape"),
        ({"shape": [0, 3]}, r"shape\[0\] must be >= 1, got 0", "shape"),
        ({"blocked": [["@.."]]}, r"starts\[0\] must be a free cell .* \[0, 0\], which is an obst", "starts"),
        ({"starts": [[0, 3]]}, r"starts\[0\] .* 1 × 3, got \[0, 3\], which lies off the map", "starts"),
        ({"starts": [[-1, 0]]}, r"starts\[0\] .* got \[-1, 0\], which lies off the map", "starts"),
        ({"starts": [[0, 0.5]]}, r"starts\[0, 1\] must be whole numbers .* got 0.5", "starts"),
        ({"starts": [[0, math.nan]]}, r"starts\[0, 1\] must be whole .* got nan", "starts"),
        ({"starts": [[2**62, 0]]}, "which lies off the map", "starts"),
        ({"blocked": [["..@"]]}, r"targets\[0\] .* got \[0, 2\], which is an obstacle", "targets"),
        ({"targets": [[0, 7]]}, r"targets\[0\] .* got \[0, 7\], which lies off the map", "targets"),
        ({"targets": [[0, 0]]}, r"targets\[0\] must not be the start, got \[0, 0\]", "targets"),
        ({"targets": None}, "targets must be a number, got None", "targets"),
        ({"view": [2, 3]}, r"view must be two odd numbers of cells, .* got \[2, 3\]", "view"),
        ({"view": [1, 4]}, r"view must be two odd .* got \[1, 4\]", "view"),
        ({"view": [1, 9]}, r"at most twice the map and one, got \[1, 9\]", "view"),
        ({"view": [5, 3]}, r"at most twice the map and one, got \[5, 3\]", "view"),
        ({"view": [0, 3]}, r"view\[0\] must be >= 1, got 0", "view"),
        ({"view": [math.nan, 3]}, r"view\[0\] must be whole .* got nan", "view"),
        ({"view": 3}, r"view must have shape \(2,\)", "view"),
        ({"steps": 0}, "steps must be >= 1, got 0", "steps"),
        ({"steps": 1.5}, "steps must be a whole number, got 1.5", "steps"),
        ({"steps": 10**6 + 1}, "steps must be <= 1000000", "steps"),
        ({"steps": True}, "steps must be a number, got True", "steps"),
        ({"uav": "hover"}, "uav must be one of paper, follow, got 'hover'", "uav"),
        ({"camera": 3}, "camera must be an object, got 3", "camera"),
        ({"camera": {"rendering": "soft"}}, "rendering must be one of plain, hard, got 'soft'", "rendering"),
        ({"camera": {"seed": -1}}, "seed must be >= 0, got -1", "seed"),
        ({"camera": {"sed": 1}}, "unknown key 'sed' .* did you mean 'seed'", "sed"),
    ],
)  # fmt: skip
def test_a_model_that_is_refused(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        UnknownGridNavigation(**{**SHORT, **fields})
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("drawings", "message", "field"),
    [
        ((), "at least one drawing, got none", "blocked"),
        ((3,), "drawing 0 must be lines of text, got 3", "blocked"),
        ((["S.T", 3],), "drawing 0 must be lines of text", "blocked"),
        ((["S.T"], ["..."]), r"drawing 1 must have one S \(start\), got none", "starts"),
        ((["SST"],), r"one S \(start\), got a second S in line 0, column 1", "starts"),
        ((["S.."],), r"drawing 0 must have one T \(target\), got none", "targets"),
        ((["S.T"], ["S..T"]), r"blocked\[1\] must have shape \(1, 3\)", "blocked"),
        ((["S.T", ".?."],), r"blocked\[0\], line 1, column 1 .* got '\?'", "blocked"),
    ],
)
def test_a_drawing_that_is_refused(drawings, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        UnknownGridNavigation.drawn(*drawings, view=(1, 3))
    assert caught.value.field == field


def test_maps_are_taken_as_text_numbers_or_truths():
    truths = np.array([[[False, True, False], [False, False, False]]])
    fields = {"starts": [[0, 0]], "targets": [[0, 2]], "shape": [2, 3], "view": (3, 3)}
    given = (
        truths,
        truths.astype(int),
        truths.tolist(),
        [[".@.", "..."]],
        [".#.\nG.."],
        ((".T.", "G.."),),
    )
    found = [UnknownGridNavigation(one, **fields) for one in given]
    found.append(UnknownGridNavigation.drawn("S@T\n...", view=(3, 3)))
    assert {one.digest for one in found} == {found[0].digest}
    assert not found[0].blocked.flags.writeable


@settings(max_examples=30, deadline=None)
@given(model=models(scenes=2))
def test_json_gives_the_same_model(model):
    again = Model.from_json(model.to_json())
    assert again == model and again.digest == model.digest
    assert np.array_equal(again.blocked, model.blocked) and again.uav is model.uav


def test_json_holds_everything_and_plans():
    model = UnknownGridNavigation.drawn(
        ROOM, view=(7, 1), steps=10**6, uav="follow", name="room",
        camera={"rendering": "hard", "seed": 2**32 - 1},
    )  # fmt: skip
    again = Model.from_json(model.to_json())
    assert again == model and again.name == "room"
    assert again.uav is Hover.FOLLOW and again.camera.rendering is Rendering.HARD
    assert json.loads(model.to_json())["data"]["blocked"] == [["...@.", ".@.@.", ".@..."]]
    plan = NavigationRuns(("RRDDRR",), ("reached",))
    assert model.plan_from_data(json.loads(json.dumps(model.plan_to_data(plan)))) == plan


def test_the_digest_tells_models_apart_and_copies_not():
    model = UnknownGridNavigation.drawn(ROOM, view=(3, 3))
    other = model.blocked.copy()
    other[0, 0, 4] = True
    models = [
        model,
        *(
            dataclasses.replace(model, **one)
            for one in (
                {"blocked": other}, {"starts": [[0, 1]]}, {"targets": [[1, 4]]}, {"view": [3, 1]},
                {"steps": 41}, {"uav": "follow"}, {"camera": {}}, {"camera": Camera("hard")},
                {"camera": {"seed": 1}},
            )
        ),
        UnknownGridNavigation.drawn(ROOM, ROOM, view=(3, 3)),
    ]  # fmt: skip
    assert len({one.digest for one in models}) == len(models)
    for one in models:
        copies = (
            copy.copy(one), copy.deepcopy(one), dataclasses.replace(one), one.renamed("other"),
            one.blinded(), cloudpickle.loads(cloudpickle.dumps(one)),
            cloudpickle.loads(cloudpickle.dumps(one.blinded())),
        )  # fmt: skip
        assert {each.digest for each in copies} == {one.digest}


def test_descriptions_of_a_model_and_a_plan():
    model = UnknownGridNavigation.drawn(ROOM, ROOM, view=(3, 5), steps=7, camera={})
    assert model.describe() == "2 scenes of 3 × 5 cells, view 3 × 5, 7 steps, plain images"
    plan = NavigationRuns(("RRDDRR", "", "U"), ("reached", "no way", "gave up"))
    assert str(plan) == "3 scenes: reached 1, no way 1, gave up 1"
    assert plan.success == pytest.approx(100 / 3)
    assert str(NavigationRuns(("RR",), ("reached",))) == "reached after 2 steps: RR"
    assert str(NavigationRuns(("",), ("no way",))) == "no way"
    assert str(NavigationRuns(("U" * 99,), ("gave up",))).endswith(f"99 steps: {'U' * 60}…")


@pytest.mark.parametrize(
    ("plan", "message", "field"),
    [
        ({"actions": ["RX"], "outcomes": ["reached"]}, r"actions\[0\] must be a string of .* 'RX'", "actions[0]"),
        ({"actions": ["RXR"], "outcomes": ["reached"]}, r"actions\[0\] must be a string of", "actions[0]"),
        ({"actions": ["rr"], "outcomes": ["reached"]}, r"actions\[0\] must be a string of", "actions[0]"),
        ({"actions": ["R\n"], "outcomes": ["reached"]}, r"actions\[0\] must be a string of", "actions[0]"),
        ({"actions": [["R"]], "outcomes": ["reached"]}, r"actions\[0\] must be a string of", "actions[0]"),
        ({"actions": [3], "outcomes": ["reached"]}, r"actions\[0\] .* got 3", "actions[0]"),
        ({"actions": "R", "outcomes": ["reached"]}, "actions must be a list, got 'R'", "actions"),
        ({"actions": {"0": "R"}, "outcomes": ["reached"]}, "actions must be a list", "actions"),
        ({"actions": ["R"], "outcomes": "reached"}, "outcomes must be a list", "outcomes"),
        ({"actions": ["R"], "outcomes": ["there"]}, r"outcomes\[0\] must be one of reached, .*'there'", "outcomes[0]"),
        ({"actions": ["R"], "outcomes": [None]}, r"outcomes\[0\] must be one of", "outcomes[0]"),
        ({"actions": ["R"], "outcomes": []}, "outcomes has 0 entries where actions has 1", "outcomes"),
        ({"actions": ["R"] * 2, "outcomes": ["gave up"] * 2}, "must have 1 entries, one per scene, got 2", "actions"),
        ({"actions": [], "outcomes": []}, "must have 1 entries, one per scene, got 0", "actions"),
        ({"actions": ["R"]}, "key 'outcomes' is missing in the data of a plan", "outcomes"),
        ({"actions": ["R"], "outcomes": ["reached"], "steps": 1}, "unknown key 'steps' .* allowed: actions, outcomes", "steps"),
        (["R"], "an object with the keys actions, outcomes", "plan"),
        (None, "there is no plan", "plan"),
        ("R", "plan must be a NavigationRuns", "plan"),
    ],
)  # fmt: skip
def test_a_plan_that_is_none(plan, message, field):
    model = UnknownGridNavigation.drawn(["ST"], view=(1, 1))
    for ask in (lambda one: ct.verify(model, one), model.score, model.replays):
        with pytest.raises(InvalidData, match=message) as caught:
            ask(plan)
        assert caught.value.field == field
