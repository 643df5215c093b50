"""Gymnasium environment: its checker, equality with replays of the model, and absence of the true map."""

import dataclasses
import sys
import types
import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.scenes import models
from unknown_grid.walks import show_noise

from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns, World
from crosstrack.solvers.unknown_grid.gymnasium import UnknownGridEnv
from crosstrack.solvers.unknown_grid.registration import register

ROOM = ["S..@.", ".@.@.", ".@..T"]


@pytest.fixture
def gym():
    return pytest.importorskip("gymnasium", reason="the environment is one of Gymnasium's")


@pytest.fixture
def room(gym):
    return UnknownGridNavigation.drawn(ROOM, ROOM[::-1], view=(3, 3), steps=9)


def with_images(model, monkeypatch):
    """Return the model with a camera, which shows noise."""
    show_noise(monkeypatch)
    return dataclasses.replace(model, camera={"rendering": "hard", "seed": 3})


@pytest.mark.parametrize("images", [False, True], ids=["cells", "images"])
@pytest.mark.parametrize("fields", [{}, {"scene": 1}, {"memory": False}], ids=str)
def test_gymnasiums_own_checker_has_nothing_to_say(
    gym, room, fields, images, monkeypatch
):  # fmt: skip
    from gymnasium.envs.registration import EnvSpec
    from gymnasium.utils.env_checker import check_env

    model = with_images(room, monkeypatch) if images else room
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(UnknownGridEnv(model, **fields), skip_render_check=True)
        made = gym.make(EnvSpec("crosstrack/UnknownGrid-v0", UnknownGridEnv), model=model, **fields)
        check_env(made.unwrapped)
        made.close()


def test_a_map_of_one_row_is_an_environment_too(gym):
    from gymnasium.utils.env_checker import check_env

    env = UnknownGridEnv(UnknownGridNavigation.drawn(["S..T"], view=(1, 1), steps=3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    assert isinstance(env, gym.Env) and isinstance(env, UnknownGridEnv)


@settings(max_examples=25, deadline=None)
@given(
    model=models(scenes=3),
    runs=st.lists(st.text("UDLR", max_size=45), min_size=3, max_size=3),
    memory=st.booleans(),
)
def test_an_episode_equals_the_replay_of_the_model(model, runs, memory):
    pytest.importorskip("gymnasium", reason="the environment is one of Gymnasium's")
    env = UnknownGridEnv(model, memory=memory)
    done, costs = [], []
    for scene in range(model.scenes):
        seen, told = env.reset(options={"scene": scene})
        known = np.full(tuple(model.shape), -1)
        walk, hits, total, letters, over = [], [], 0.0, "", (False, False)
        for letter in [None, *runs[scene]]:
            if letter is not None:
                seen, reward, *over, told = env.step("UDLR".index(letter))
                letters, total = letters + letter, total + reward
            walk.append(seen["position"].tolist())
            hits.append(told["collisions"])
            assert env.observation_space.contains(seen)
            assert told["scene"] == scene and told["steps"] == len(letters)
            # O_g is what the views show of the map, all of them or the last.
            known = known if memory else np.full(known.shape, -1)
            for (a, b), cell in np.ndenumerate(seen["view"]):
                row, column = seen["corner"] + (a, b)
                if 0 <= row < known.shape[0] and 0 <= column < known.shape[1]:
                    known[row, column] = cell
                else:
                    assert cell == 1
            # With memory it also holds target and vehicle, and the cells that stopped the vehicle.
            shown = seen["map"]
            hit = model.blocked[scene] & (known < 0) & (shown == 1)
            assert hit.sum() <= (told["collisions"] if memory else 0)
            expected = np.where(hit, 1, known)
            if memory:
                expected[tuple(seen["position"])] = 0
                expected[tuple(seen["target"])] = 2
            np.testing.assert_array_equal(shown, expected)
            sure = np.isin(known, (0, 1))
            np.testing.assert_array_equal(known[sure] == 1, model.blocked[scene][sure])
            if any(over):
                break
        outcome = "reached" if over[0] else "out of steps" if over[1] else "gave up"
        done.append((letters, outcome))
        costs.append(-total if any(over) else model.steps + 1)
        (taken,) = model.replays(
            NavigationRuns((letters,) * model.scenes, (outcome,) * model.scenes)
        )[scene : scene + 1]
        assert walk == taken.positions.tolist()
        assert hits == [0, *np.cumsum(taken.collided).tolist()]
    checked = model.verify(NavigationRuns(*map(tuple, zip(*done, strict=True))))
    assert checked.ok and checked.objective == pytest.approx(np.mean(costs))


def test_scenes_are_drawn_by_the_seed(room):
    env = UnknownGridEnv(room)

    def drawn(seed):
        return [env.reset(seed=seed if k == 0 else None)[1]["scene"] for k in range(20)]

    assert drawn(4) == drawn(4) != drawn(5)
    assert set(drawn(4)) == {0, 1}
    fixed = UnknownGridEnv(room, 1)
    assert {fixed.reset(seed=k)[1]["scene"] for k in range(9)} == {1}
    assert fixed.reset(options={"scene": 0})[1]["scene"] == 0


def test_renders_the_known_map(room):
    env = UnknownGridEnv(room, 0, render_mode="ansi")
    assert env.render() is None
    env.reset()
    assert env.render() == "V.???\n.@???\n????T"
    for action in (3, 3, 1, 1):
        env.step(action)
    assert env.render() == "...@?\n.@.@?\n?@V.T"
    image = UnknownGridEnv(room, 0, render_mode="rgb_array")
    image.reset()
    picture = image.render()
    assert picture.shape == (3 * 102, 5 * 102, 3) and picture.dtype == np.uint8
    # The colours of vehicle, free, blocked, unknown and target differ.
    cells = {
        tuple(picture[102 * r + 50, 102 * c + 50])
        for r, c in ((0, 0), (0, 1), (1, 1), (0, 4), (2, 4))
    }
    assert len(cells) == 5
    assert UnknownGridEnv(room, 0).render() is None


def test_a_camera_shows_images_alone(room, monkeypatch):
    model = with_images(room, monkeypatch)
    env = UnknownGridEnv(model, 1, render_mode="rgb_array")
    seen, _ = env.reset()
    assert set(seen) == {"image", "position", "target", "corner"}
    shown = World(model)(np.array([[1.0, -1.0]]))[0, 6:].reshape(256, 256, 3)
    np.testing.assert_allclose(seen["image"] / 255, shown, atol=0.5 / 255 + 1e-12)
    np.testing.assert_array_equal(env.render(), seen["image"])


def holds(thing, secret, depth=5, met=()):
    """Return whether an array like `secret` can be reached by public names, entries and elements."""
    if isinstance(thing, np.ndarray):
        return thing.shape[-2:] == secret.shape[-2:] and bool(
            ((thing == 1) == secret).all(axis=(-1, -2)).any()
        )
    if (
        depth == 0
        or isinstance(thing, str | int | float | types.ModuleType | type)
        or id(thing) in met
    ):
        return False
    met = (*met, id(thing))
    inner = list(thing.values()) if isinstance(thing, dict) else []
    inner += list(thing) if isinstance(thing, list | tuple) else []
    names = [name for name in dir(thing) if not name.startswith("_")]
    for name in names:
        try:
            value = getattr(thing, name)
        except Exception:  # what is hidden, or a property that needs more
            continue
        if not callable(value) or isinstance(value, UnknownGridNavigation):
            inner.append(value)
    return any(holds(one, secret, depth - 1, met) for one in inner)


def test_the_map_is_in_no_public_place(room):
    env = UnknownGridEnv(room, 0, render_mode="ansi")
    secret = room.blocked[:1]
    first = env.reset(seed=1)
    last = env.step(3)
    assert not any(holds(one, secret) for one in (env, first, last))
    assert holds(room, secret), "where it is, it is found"
    assert env.problem.is_blinded
    whole = UnknownGridEnv(UnknownGridNavigation.drawn(ROOM, view=(5, 9)), 0)
    assert holds(whole.reset(), secret), "and where it has been seen"


@pytest.mark.parametrize(
    ("ask", "message", "field"),
    [
        (lambda m: UnknownGridEnv(m, 2), "scene must be <= 1, got 2", "scene"),
        (lambda m: UnknownGridEnv(m, -1), "scene must be >= 0, got -1", "scene"),
        (lambda m: UnknownGridEnv(m, 0.5), "scene must be a whole number, got 0.5", "scene"),
        (lambda m: UnknownGridEnv(m, memory=1), "memory must be true or false, got 1", "memory"),
        (lambda m: UnknownGridEnv(m, render_mode="human"), "render_mode must be ansi, .*'human'", "render_mode"),
        (lambda m: UnknownGridEnv(m.blinded()), "model must have its true maps", "model"),
        (lambda m: UnknownGridEnv("room"), "model must be a UnknownGridNavigation, got 'room'", "model"),
        (lambda m: UnknownGridEnv(m).step(0), "reset must begin an episode", "action"),
        (lambda m: UnknownGridEnv(m).reset(options={"scene": 9}), "scene must be <= 1, got 9", "scene"),
        (lambda m: UnknownGridEnv(m).reset(options={"scenes": 1}), "unknown option 'scenes'", "options"),
    ],
)  # fmt: skip
def test_rejects_invalid_arguments(room, ask, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        ask(room)
    assert caught.value.field == field


@pytest.mark.parametrize("action", [4, -1, 0.5, None, "up", np.nan])
def test_actions_that_are_none(room, action):
    env = UnknownGridEnv(room, 0)
    env.reset()
    with pytest.raises(InvalidData, match="action must be") as caught:
        env.step(action)
    assert caught.value.field == "action"
    assert env.step(np.int64(3))[-1] == {"scene": 0, "steps": 1, "collisions": 0}


def test_an_episode_that_has_ended_takes_no_step(gym):
    env = UnknownGridEnv(UnknownGridNavigation.drawn(["ST", ".."], view=(1, 1), steps=2))
    env.reset()
    assert env.step(3)[1:4] == (-1.0, True, False)
    with pytest.raises(InvalidData, match="the run of scene 0 has ended"):
        env.step(3)
    env.reset()
    assert env.step(0)[1:4] == (-1.0, False, False)
    assert env.step(0)[1:4] == (-2.0, False, True)


def test_without_gymnasium_the_error_names_the_package(monkeypatch):
    class Own(UnknownGridEnv):
        """New subclass, so that the cache has no entry for it."""

    monkeypatch.setitem(sys.modules, "gymnasium", None)
    model = UnknownGridNavigation.drawn(ROOM, view=(3, 3))
    with pytest.raises(BackendMissing, match=r"needs gymnasium: pip install 'crosstrack\[learn\]'"):
        Own(model)
    with pytest.raises(BackendMissing, match="crosstrack/UnknownGrid-v0 needs gymnasium"):
        register()


def test_a_class_of_ones_own_is_an_environment(room, gym):
    class Shaped(UnknownGridEnv):
        def step(self, action):
            seen, reward, *rest = super().step(action)
            return seen, reward - 1.0, *rest

    env = Shaped(room, 0)
    env.reset(seed=3)
    assert isinstance(env, gym.Env) and env.step(3)[1] == -2.0
