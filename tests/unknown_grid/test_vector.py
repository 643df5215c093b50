"""Vectorised environment of Gymnasium: equality with single environments, modes and refusals."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.scenes import models
from unknown_grid.walks import show_noise

from crosstrack.errors import InvalidData
from crosstrack.models import UnknownGridNavigation
from crosstrack.solvers.unknown_grid.gymnasium import UnknownGridEnv
from crosstrack.solvers.unknown_grid.registration import ID, register
from crosstrack.solvers.unknown_grid.vector import UnknownGridVectorEnv

gym = pytest.importorskip("gymnasium", reason="the environment is one of Gymnasium's")

ROOM = ["S..@.", ".@.@.", ".@..T"]


@pytest.fixture
def room():
    return UnknownGridNavigation.drawn(ROOM, ROOM[::-1], view=(3, 3), steps=9)


def assert_equal(one, other):
    """Compare two results of an environment, entry by entry."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal(one[key], other[key])
    elif isinstance(one, tuple):
        for pair in zip(one, other, strict=True):
            assert_equal(*pair)
    elif isinstance(one, np.ndarray) and one.dtype == object:
        for pair in zip(one, other, strict=True):
            if pair[0] is not None or pair[1] is not None:
                assert_equal(*pair)
    else:
        np.testing.assert_array_equal(one, other)


def compare(model, size, mode, actions, seed, **fields):
    """Compare the vectorised environment with single ones in every step."""
    several = [lambda: UnknownGridEnv(model, **fields)] * size
    loop = gym.vector.SyncVectorEnv(several, autoreset_mode=mode)
    env = UnknownGridVectorEnv(model, size, autoreset_mode=mode, **fields)
    assert env.observation_space == loop.observation_space
    assert env.single_observation_space == loop.single_observation_space
    assert (env.action_space, env.single_action_space) == (
        loop.action_space, loop.single_action_space,
    )  # fmt: skip
    assert env.metadata["autoreset_mode"] is loop.metadata["autoreset_mode"]
    assert_equal(env.reset(seed=seed), loop.reset(seed=seed))
    for row in actions:
        given_actions = np.array(row[:size])
        results = env.step(given_actions)
        assert env.observation_space.contains(results[0])
        assert_equal(results, loop.step(given_actions))
    assert_equal(env.reset(), loop.reset())
    assert_equal(env.reset(options={"scene": 0}), loop.reset(options={"scene": 0}))


@settings(max_examples=12, deadline=None)
@given(
    model=models(scenes=3), size=st.integers(1, 5), mode=st.sampled_from(["NextStep", "SameStep"]),
    actions=st.lists(st.lists(st.integers(0, 3), min_size=5, max_size=5), max_size=30),
    memory=st.booleans(), seed=st.integers(0, 99),
)  # fmt: skip
def test_all_values_equal_those_of_single_environments(model, size, mode, actions, memory, seed):
    compare(model, size, mode, actions, seed, memory=memory)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_many_short_episodes_equal_those_of_single_environments(room, mode):
    actions = np.random.default_rng(2).integers(0, 4, (60, 8)).tolist()
    compare(room, 8, mode, actions, 5)
    compare(room, 8, mode, actions, 5, scene=1)


def test_images_equal_those_of_single_environments(room, monkeypatch):
    show_noise(monkeypatch)
    model = UnknownGridNavigation.drawn(ROOM, view=(3, 3), steps=3, camera={"seed": 3})
    compare(model, 2, "NextStep", [[3, 1], [3, 1], [0, 0], [1, 1]], 0)


def test_gymnasium_makes_both_environments_by_name(room):
    from gymnasium.utils.env_checker import check_env

    register()
    register()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        single = gym.make(ID, model=room)
        assert isinstance(single.unwrapped, UnknownGridEnv)
        check_env(single.unwrapped, skip_render_check=True)
        env = gym.make_vec(ID, num_envs=3, model=room)
        loop = gym.make_vec(ID, num_envs=3, vectorization_mode="sync", model=room)
    assert isinstance(env, UnknownGridVectorEnv) and isinstance(env, gym.vector.VectorEnv)
    assert not isinstance(loop.unwrapped, UnknownGridVectorEnv)
    assert env.spec.id == ID and env.num_envs == 3
    assert_equal(env.reset(seed=1)[0], loop.reset(seed=1)[0])
    wrapped = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec(ID, num_envs=3, model=room))
    wrapped.reset(seed=1)
    for _ in range(9):
        info = wrapped.step([0, 0, 0])[-1]
    assert info["episode"]["r"].tolist() == [-10.0] * 3  # 9 steps, and 1 for the missed target
    env.close()


def test_results_are_not_changed_later(room):
    env = UnknownGridVectorEnv(room, 2)
    first, told = env.reset(seed=0)
    kept = {name: array.copy() for name, array in {**first, **told}.items()}
    env.step([1, 1])
    assert_equal({**first, **told}, kept)


@pytest.mark.parametrize(
    ("ask", "message", "field"),
    [
        (lambda m: UnknownGridVectorEnv(m, 0), "num_envs must be >= 1, got 0", "num_envs"),
        (lambda m: UnknownGridVectorEnv(m, 2, 5), "scene must be <= 1, got 5", "scene"),
        (lambda m: UnknownGridVectorEnv(m, memory=2), "memory must be true or false", "memory"),
        (lambda m: UnknownGridVectorEnv(m.blinded()), "model must have its true maps", "model"),
        (lambda m: UnknownGridVectorEnv(m, autoreset_mode="Disabled"), "autoreset_mode must be", "autoreset_mode"),
        (lambda m: UnknownGridVectorEnv(m).step([0]), "reset must begin episodes", "actions"),
        (lambda m: UnknownGridVectorEnv(m, 2).reset(seed=[1]), "seed must have 2 entries, got 1", "seed"),
        (lambda m: UnknownGridVectorEnv(m).reset(options={"scenes": 1}), "unknown option 'scenes'", "options"),
    ],
)  # fmt: skip
def test_rejects_invalid_arguments(room, ask, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        ask(room)
    assert caught.value.field == field


@pytest.mark.parametrize("actions", [[4, 0], [-1, 0], [0], [0, 0, 0], [0.5, 0], [np.nan, 0], "ud"])
def test_rejects_invalid_actions_without_a_step(room, actions):
    env = UnknownGridVectorEnv(room, 2, 0)
    env.reset()
    with pytest.raises(InvalidData, match="actions") as caught:
        env.step(actions)
    assert caught.value.field == "actions"
    assert env.step([3, 3])[-1]["steps"].tolist() == [1, 1]
