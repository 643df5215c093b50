"""The simulator against its rules, cell by cell, and what it refuses to answer."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.loop_world import LoopWorld
from unknown_grid.scenes import models, run
from unknown_grid.walks import PlainWorld, Told, request_for

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns, World
from crosstrack.models.unknown_grid.plan import LETTERS
from crosstrack.models.unknown_grid.world import LOOK, Looks
from crosstrack.solvers.contract.enums import Limit

ROOM = ["S...@...", ".@@.@.@.", ".@......", ".@.@@.@T"]


def ask(world, *questions):
    """Return what a world answers, read."""
    asked = np.array(questions, float)
    answers = world(asked)
    return Looks.read(world.problem, asked[:, 0].astype(int), answers)


@settings(max_examples=40, deadline=None)
@given(model=models(scenes=3), data=st.data())
def test_every_answer_is_that_of_the_rules(model, data):
    world = World(model)
    plain = [PlainWorld(model, k) for k in range(model.scenes)]
    for _ in range(data.draw(st.integers(1, 25))):
        asked = []
        for k in data.draw(st.lists(st.integers(0, model.scenes - 1), min_size=1, max_size=4)):
            # One question a scene and turn: what another one shows is then what it ends with.
            if k not in [one for one, _ in asked]:
                going = plain[k].state() == 0
                asked.append((k, data.draw(st.integers(LOOK, 3 if going else LOOK))))
        for k, action in asked:
            if action != LOOK:
                plain[k].act(action)
        looks = ask(world, *asked)
        assert looks.scenes.tolist() == [k for k, _ in asked]
        for row, k in enumerate(looks.scenes.tolist()):
            assert tuple(looks.positions[row]) == plain[k].at
            assert tuple(looks.corners[row]) == plain[k].corner()
            assert looks.states[row] == plain[k].state()
            assert looks.collisions[row] == plain[k].hit
            assert looks.view[row].tolist() == plain[k].shown()


@settings(max_examples=60, deadline=None)
@given(model=models(scenes=4), data=st.data())
def test_the_answers_equal_those_of_a_loop_over_the_scenes(model, data):
    world, loop = World(model), LoopWorld(model)
    for _ in range(data.draw(st.integers(1, 12))):
        asked = []
        for k in data.draw(st.lists(st.integers(0, model.scenes - 1), max_size=6)):
            # The scenes may repeat, in any order.
            moves = [row for row in asked if row[0] == k and row[1] != LOOK]
            going = loop.state(k) == 0 and not moves
            asked.append((k, data.draw(st.integers(LOOK, 3 if going else LOOK))))
        questions = np.array(asked, float).reshape(-1, 2)
        np.testing.assert_array_equal(world(questions), loop(questions))
        assert [world.state(k) for k in range(model.scenes)] == [
            loop.state(k) for k in range(model.scenes)
        ]
    runs = tuple(map("".join, loop._actions))
    for actions in (runs, ("U", *runs[1:]), (*runs[:-1], runs[-1] + "R")):
        plan = NavigationRuns(actions, ("gave up",) * model.scenes)
        assert world.contradiction(plan) == loop.contradiction(plan)


def test_the_images_equal_those_of_a_loop_over_the_scenes():
    model = ct.load("unknown-grid/camera-hard")
    world, loop = World(model), LoopWorld(model)
    for action in (LOOK, 3, 1, 0):
        questions = np.array([[2.0, action], [5.0, action]])
        np.testing.assert_array_equal(world(questions), loop(questions))


@settings(max_examples=25, deadline=None)
@given(model=models(scenes=3), data=st.data())
def test_the_replay_of_a_plan_equals_the_world(model, data):
    letters = st.text("UDLR", max_size=45)
    told = Told(*[data.draw(letters) for _ in range(model.scenes)])
    answer = run(told, model)
    assert answer.statistics["collisions"] == model.score(answer.point).collisions
    assert model.verify(answer.point).ok
    for k, taken in enumerate(model.replays(answer.point)):
        seen = [
            (one.positions[row].tolist(), int(one.collisions[row]))
            for one in told.looks
            for row in np.flatnonzero(one.scenes == k)
        ]
        # What ended a run is not shown to the policy.
        hits = np.concatenate([[0], np.cumsum(taken.collided)]).tolist()
        assert seen == list(zip(taken.positions.tolist(), hits, strict=True))[: len(seen)]
        assert len(seen) >= len(answer.point.actions[k])


def test_the_uav_hovers_or_follows_by_its_rule():
    way = [1, 1, 1]  # towards the target, which is seen from the first step on
    drawing = ["S", ".", ".", ".", "T"]
    for uav, corners in (("paper", [-3, -2, -2, -2]), ("follow", [-3, -2, -1, 0])):
        world = World(UnknownGridNavigation.drawn(drawing, view=(7, 1), uav=uav))
        found = [ask(world, (0, LOOK))] + [ask(world, (0, action)) for action in way]
        assert [int(one.corners[0, 0]) for one in found] == corners
        assert [2 in one.view[0] for one in found] == [False, True, True, True]


def test_the_target_is_seen_through_obstacles_and_a_collision_uses_a_step():
    world = World(UnknownGridNavigation.drawn(["S@T"], view=(1, 5), steps=2))
    first = ask(world, (0, LOOK))
    assert first.view.tolist() == [[[1, 1, 0, 1, 2]]] and first.states.tolist() == [0]
    assert ask(world, (0, 3)).collisions.tolist() == [1]
    last = ask(world, (0, 2))
    assert last.collisions.tolist() == [2] and last.states.tolist() == [2]
    assert last.positions.tolist() == [[0, 0]]


def test_the_target_counts_though_the_steps_are_used_up():
    world = World(UnknownGridNavigation.drawn(["ST"], view=(1, 1), steps=1))
    assert ask(world, (0, 3)).states.tolist() == [1]


def test_the_actions_of_long_runs_are_stored():
    world = World(UnknownGridNavigation.drawn(["S.T"], ["T@S"], view=(1, 1), steps=300))
    for _ in range(300):
        ask(world, (0, 0), (1, 3))
    outcomes = ("out of steps",) * 2
    assert not world.contradiction(NavigationRuns(("U" * 300, "R" * 300), outcomes))
    assert "scene 1" in world.contradiction(NavigationRuns(("U" * 300, "R" * 299), outcomes))


def test_each_run_has_its_own_world():
    model = UnknownGridNavigation.drawn(ROOM, view=(3, 3))
    first = model.oracle()
    first(np.array([[0.0, 3.0]]))
    assert first.positions.tolist() == [[0, 1]]
    assert model.oracle().positions.tolist() == [[0, 0]] == model.starts.tolist()


def test_runs_in_the_same_scene_are_independent():
    model = UnknownGridNavigation.drawn(
        ["S.@T", "...."], ["S@.T", "...."], view=(3, 3), moving=1, world_seed=5
    )
    scenes = np.array([1, 0, 1])
    world, alone = World(model, scenes), [World(model) for _ in scenes]
    walks = ["DDRRR", "RDRRU", "WURWD"]
    for actions in zip(*walks, strict=True):
        asked = [LETTERS.index(letter) for letter in actions]
        answers = world(np.array(list(enumerate(asked)), float))
        for other, scene, action, answer in zip(alone, scenes, asked, answers, strict=True):
            assert (other(np.array([[scene, action]], float))[0] == answer).all()
    scenes[0] = 0
    world.restart(np.array([0]))
    assert (world(np.array([[0.0, LOOK]])) == World(model)(np.array([[0.0, LOOK]]))).all()


@pytest.mark.parametrize(
    ("question", "message"),
    [
        ((0, 4), r"an action must be 0 \(up\), .*, got 4"),
        ((0, -2), "or -1 .look., got -2"),
        ((0, 0.5), "an action must be .*, got 0.5"),
        ((0, math.nan), "an action must be .*, got nan"),
        ((0, math.inf), "an action must be .*, got inf"),
        ((1, 0), r"scene must be 0 … 0, got 1"),
        ((-1, 0), "scene must be .*, got -1"),
        ((0.5, 0), "scene must be .*, got 0.5"),
        ((math.nan, LOOK), "scene must be .*, got nan"),
        ((1e300, LOOK), "scene must be .*, got 1e.300"),
    ],
)
def test_questions_that_are_refused(question, message):
    world = World(UnknownGridNavigation.drawn(ROOM, view=(3, 3)))
    with pytest.raises(InvalidData, match=message) as caught:
        ask(world, (0, LOOK), question)
    assert caught.value.field == "actions"
    assert world.taken.tolist() == [0]


@pytest.mark.parametrize("shape", [(2,), (1, 3), (1, 1, 2), (0,)])
def test_questions_of_another_shape(shape):
    world = World(UnknownGridNavigation.drawn(ROOM, view=(3, 3)))
    with pytest.raises(InvalidData, match=r"questions must have shape \(n, 2\), got") as caught:
        world(np.zeros(shape))
    assert caught.value.field == "actions"


def test_nothing_is_done_after_the_end():
    model = UnknownGridNavigation.drawn(["ST."], ["S.T"], view=(1, 3), steps=1)
    world = World(model)
    ask(world, (0, 3), (1, 0))  # one is there, one has used up its steps
    for scene in (0, 1):
        with pytest.raises(InvalidData, match=f"the run of scene {scene} has ended") as caught:
            ask(world, (scene, 3))
        assert caught.value.field == "actions"
        assert ask(world, (scene, LOOK)).states.tolist() == [1 + scene]
    assert world.taken.tolist() == [1, 1] and world.collisions.tolist() == [0, 1]


def test_a_policy_leads_many_scenes_at_once():
    model = UnknownGridNavigation.drawn(["S.T"], ["S@T"], ["T.S"], ["ST."], view=(1, 3), steps=3)
    one, many = Told("RR", "R", "RLL", "R"), Told("RR", "R", "RLL", "R")
    many.together = 3
    answers = [run(each, model).point for each in (one, many)]
    assert answers[0] == answers[1]
    assert answers[0].actions == ("RR", "R", "RLL", "R")
    assert answers[0].outcomes == ("reached", "gave up", "reached", "reached")
    assert [one.scenes.tolist() for one in many.looks] == [[0, 1, 2], [0, 1, 2], [2], [3]]
    assert run(Told(*["U"] * 4, last=-1), model).point.outcomes == ("no way",) * 4


@pytest.mark.parametrize("together", [1, 2])
def test_a_stopped_run_returns_the_executed_actions(together):
    model = UnknownGridNavigation.drawn(["S....T"], ["S....T"], view=(1, 3), steps=9)

    class Stopped(Told):
        def decide(self, looks):
            if len(self.looks) == 2:
                asked.control.stop(Limit.TIME)
            return super().decide(looks)

    told = Stopped("RRRRR", "RRRRR")
    told.together = together
    asked = request_for(model, told)
    answer = told.run(model.blinded(), asked)
    assert answer.limit is Limit.TIME
    # The action that was chosen last was not taken.
    assert answer.point.actions == ("RR", "RR" if together == 2 else "")
    assert answer.point.outcomes == ("gave up", "gave up")
    assert asked.control.oracle.taken.tolist() == [2, 2 if together == 2 else 0]
    assert model.verify(answer.point).ok
