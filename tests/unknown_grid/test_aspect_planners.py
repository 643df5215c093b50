"""Planners, pictures and diagnosis under all aspects of scenes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.aspects import look, plain_request, rules, with_rules
from unknown_grid.scenes import models, run

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import World, sight
from crosstrack.models.unknown_grid.drawn import walk_of
from crosstrack.models.unknown_grid.moving import obstacle_tracks
from crosstrack.models.unknown_grid.plan import LETTERS, NavigationRuns
from crosstrack.models.unknown_grid.sight import wrong_readings
from crosstrack.models.unknown_grid.world import LOOK
from crosstrack.solvers.unknown_grid.baselines import BaselineOne
from crosstrack.solvers.unknown_grid.oracle import Oracle
from crosstrack.solvers.unknown_grid.replanning import AStarReplanning, CurrentView, DStarLite
from crosstrack.solvers.unknown_grid.replanning_kernels import TIME, WAITS
from crosstrack.solvers.unknown_grid.vector import Episodes

drawn = UnknownGridNavigation.drawn
PLANNERS = (DStarLite, AStarReplanning, CurrentView)
OPEN = ["S....", ".....", ".....", ".....", "....T"]


@pytest.mark.sample(2)
@pytest.mark.parametrize("backend", PLANNERS, ids=lambda one: one.name)
@pytest.mark.parametrize(
    "fields",
    [
        {"connectivity": "8"}, {"connectivity": "8", "corners": "any"}, {"occlusion": True},
        {"false_obstacles": 0.05, "missed_obstacles": 0.1}, {"moving": 4},
        {"connectivity": "8", "corners": "one", "occlusion": True, "false_obstacles": 0.02, "moving": 2},
    ],
    ids=str,
)  # fmt: skip
def test_planners_reach_most_targets_under_every_aspect(backend, fields):
    model = draw_scenes(
        "mixed", obstacles=4, scenes=20, view=(9, 9), steps=60, uav="follow", **fields
    )
    answer = run(backend(), model)
    again = run(backend(), model)
    assert answer.point == again.point and model.verify(answer.point).ok
    score = model.score(answer.point)
    assert score.collisions == answer.statistics["collisions"]
    least = 6 if backend is CurrentView else 14 if "false_obstacles" in fields else 18
    assert score.reached >= least, score
    assert 0 < score.spl <= score.reached / score.scenes


@pytest.mark.parametrize("backend", PLANNERS[:2], ids=lambda one: one.name)
def test_unknown_targets_are_found_and_missing_ones_reported(backend):
    model = draw_scenes(
        "walls", obstacles=4, scenes=20, view=(5, 5), steps=200, target_known=False, uav="follow"
    )
    answer = run(backend(), model)
    assert model.verify(answer.point).ok and answer.point.success == 100.0
    known = run(backend(), dataclasses.replace(model, target_known=True))
    assert sum(map(len, answer.point.actions)) > sum(map(len, known.point.actions))
    shut = drawn(["S..@T", "...@@", "....."], view=(3, 3), target_known=False)
    assert run(backend(), shut).point.outcomes == ("no way",)


def test_a_planner_without_memory_forgets():
    trap = [
        "...........",
        ".@@@@@@@@..",
        "........@..",
        "S.......@.T",
        "........@..",
        ".@@@@@@@@..",
        "...........",
    ]
    model = drawn(trap, view=(5, 5), steps=120, uav="follow")
    found = {forget: run(DStarLite(), model, forget=forget).point for forget in (None, 0, 3, 1000)}
    assert found[None].outcomes == ("reached",)
    assert len(found[1000].actions[0]) == len(found[None].actions[0])
    assert found[0] == run(CurrentView(), model).point
    assert found[0].outcomes == ("out of steps",) == found[3].outcomes


def test_policies_refuse_aspects_by_name():
    model = drawn(OPEN, view=(3, 3), moving=1, occlusion=True)
    assert BaselineOne().refuses(model) == "moving obstacles and occlusion"
    with pytest.raises(
        UnsupportedFormulation, match="'baseline-1' does not cover moving obstacles and occlusion"
    ):
        ct.solve(model, "baseline-1")
    search = drawn(OPEN, view=(3, 3), target_known=False)
    with pytest.raises(InvalidData, match="model must have no moving obstacles and occlusion"):
        Episodes(model, 1, True)
    assert CurrentView().refuses(search) == "an unknown target" and not DStarLite().refuses(search)


@settings(max_examples=20, deadline=None)
@given(
    model=models(most=9, steps=60, uav="follow"), fields=rules(),
    sensing=st.sampled_from(
        [{}, {"occlusion": True}, {"false_obstacles": 0.1, "missed_obstacles": 0.1}, {"target_known": False}]
    ),
    forget=st.sampled_from([None, 0, 4]),
)  # fmt: skip
def test_d_star_lite_takes_the_steps_of_a_search_from_scratch(model, fields, sensing, forget):
    model = with_rules(model, {**fields, **sensing})
    found = [run(backend(), model, forget=forget) for backend in (DStarLite, AStarReplanning)]
    assert found[0].point == found[1].point
    assert model.verify(found[0].point).ok


def test_pictures_show_what_the_world_shows(monkeypatch):
    model = draw_scenes(
        "mixed", obstacles=4, scenes=1, view=(7, 7), steps=60, connectivity="8", occlusion=True, moving=5,
        false_obstacles=0.1, missed_obstacles=0.1,
    )  # fmt: skip
    plan = run(DStarLite(), model).point
    exact = dataclasses.replace(model, false_obstacles=0.0, missed_obstacles=0.0)
    walk, worlds = walk_of(model, plan, 0), (World(model), World(exact))
    expected = np.full(model.shape, walk.steps + 1)
    for step, action in enumerate([LOOK, *map(LETTERS.index, plan.actions[0])]):
        noisy, true = (look(world, [(0, action)]) for world in worlds)
        assert (walk.positions[step] == noisy.positions[0]).all()
        assert (walk.uav[step] == noisy.corners[0] + 3).all()
        for row, column in np.argwhere(noisy.view[0] != -1) + noisy.corners[0]:
            if 0 <= row < 17 and 0 <= column < 17:
                expected[row, column] = min(expected[row, column], step)
        others = obstacle_tracks(model)[0][:, step]
        wrong = wrong_readings(model, 0, walk.positions[step], walk.uav[step], others, step)
        shown = np.argwhere(noisy.view[0] != true.view[0]) + noisy.corners[0]
        assert wrong.tolist() == shown.tolist()
    assert (walk.seen == expected).all()
    assert (walk.others == obstacle_tracks(model)[0][:, : walk.steps + 1]).all()
    calls = []
    monkeypatch.setattr(
        sight, "obstacle_tracks", lambda model: calls.append(1) or obstacle_tracks(model)
    )
    figure = ct.plot(model, plan, moments=[0, 1, 2, walk.steps])
    assert len(calls) <= 3  # not per moment
    ends = [line for axes in figure.axes for line in axes.lines if line.get_gid() == "moving"]
    assert [line.get_xydata()[:, ::-1].tolist() for line in ends] == [
        walk.others[:, step].tolist() for step in (0, 1, 2, walk.steps)
    ]


def test_no_way_and_diagnosis_under_the_rules():
    fence = ["S.@..", ".@...", "@...T"]
    for corners, way in (("free", False), ("one", False), ("any", True)):
        model = drawn(fence, view=(3, 3), connectivity="8", corners=corners)
        claim = model.verify(NavigationRuns(("",), ("no way",)))
        assert claim.ok is not way
        assert np.isfinite(model.fewest_steps()[0]) == way
        assert bool(ct.diagnose(model).findings) is not way
    double = drawn(["S.@@.", ".@@..", "@@..T"], view=(3, 3), connectivity="8", corners="any")
    found = ct.diagnose(double).findings[0]
    assert found.data["opening"] and len(found.data["opening"]) == 1
    late = drawn(["S.T"], view=(3, 3), moving=1, tracks=[[[[0, 1]]]], steps=9)
    assert "past the moving obstacles in 9 steps" in str(ct.diagnose(late))
    assert run(DStarLite(), late).point.outcomes == ("out of steps",)
    answer = Oracle().run(late, plain_request())
    assert answer.point.outcomes == ("gave up",) and answer.dual_bound == 10
    assert not late.verify(NavigationRuns(("",), ("no way",))).ok


def test_extreme_scenes():
    fields = {
        "connectivity": "8",
        "corners": "any",
        "occlusion": True,
        "false_obstacles": 0.999,
        "missed_obstacles": 0.999,
    }
    crowd = drawn(["ST"], view=(1, 1), steps=50, moving=1000, **fields)
    lonely = drawn(
        ["S" + "." * 500 + "T"], view=(3, 3), steps=600, target_known=False, uav="follow", **fields
    )
    for model in (crowd, lonely):
        answer = run(DStarLite(), model)
        assert model.verify(answer.point).ok
    exact = dataclasses.replace(lonely, false_obstacles=0.0, missed_obstacles=0.0)
    assert len(run(AStarReplanning(), exact).point.actions[0]) == 501


@pytest.mark.parametrize("backend", PLANNERS[:2], ids=lambda one: one.name)
def test_readings_are_stamped_with_the_decision_that_notes_them(backend):
    """Without a path the view is noted twice in one decision."""
    model = drawn(["S.@T", "..@@"], moving=1, view=(5, 7), steps=5)
    policy = backend().policy(model.blinded(), np.arange(1), plain_request())
    assert policy.decide(look(World(model), [[0, LOOK]]))[0] == WAITS
    memory = policy._memory
    assert memory.stamps.max() == 0 and memory.tally[0, TIME] == 1
