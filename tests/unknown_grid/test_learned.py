"""Learned policies: memory, training data and results of training."""

import dataclasses
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
from commands import run as command
from hypothesis import given, settings, strategies as st
from unknown_grid.scenes import WILD, drawn, models, run, watch

from crosstrack.errors import BackendMissing, InvalidData, UnsupportedFormulation
from crosstrack.instances.unknown_grid import draw_scene_arrays, draw_scenes
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import Outcome, World
from crosstrack.models.unknown_grid.world import Looks
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.learning.trainer import Course
from crosstrack.solvers.learning.training import find_training, train
from crosstrack.solvers.learning.weights import Weights, read_weights, write_weights
from crosstrack.solvers.unknown_grid import small_vin
from crosstrack.solvers.unknown_grid.episodes import ImitationTrainer
from crosstrack.solvers.unknown_grid.imitation import (
    FAR,
    Recurrence,
    Scenes,
    best_actions,
    choose_actions,
    first_of,
    shortest_ways,
    walk_through,
)
from crosstrack.solvers.unknown_grid.learned import LearnedPolicy, SmallVin, Vin
from crosstrack.solvers.unknown_grid.memory import Memory, Observation
from crosstrack.solvers.unknown_grid.networks import load_network, shipped_weights

BACKENDS = {"small-vin": SmallVin, "vin": Vin}
#: Options of a training of a few seconds.
TINY = {"scenes": 2, "batches": 9, "batch": 24, "judged": 1, "rate": 0.02}


@pytest.fixture(scope="module")
def torch():
    return pytest.importorskip("torch", reason="networks need PyTorch, which is an extra")


def scenes_of(model):
    return Scenes(model.blocked, model.starts, model.targets)


def optimistic(observed):
    """Return the actions of optimistic replanning on the remembered map."""
    ways = shortest_ways(observed.known == 1, observed.targets)
    return first_of(best_actions(ways, observed.positions))


# -- what needs no PyTorch ------------------------------------------------------------------------


@settings(deadline=None, max_examples=12)
@given(models(scenes=2), st.lists(st.integers(0, 3), min_size=6, max_size=6))
def test_walks_follow_the_rules_of_the_world(model, actions):
    """The masked map equals the cells seen, for both rules of the UAV and several views."""
    for uav, view in (("follow", (3, 5)), ("paper", (5, 3)), ("paper", (1, 1))):
        if (np.array(view) > 2 * model.shape + 1).any():
            continue
        same = dataclasses.replace(model, view=view, steps=len(actions), uav=uav)
        left = iter(actions)
        ended, walked = watch(same, lambda _, rows, left=left: (next(left) + rows) % 4)
        world, memory = World(same), Memory(same.shape, same.view, same.targets)
        chosen = np.full(same.scenes, -1)
        rows = np.arange(same.scenes)
        known = [{} for _ in rows]
        for action, (observed, active) in zip(actions, walked, strict=False):
            answers = world(np.column_stack([rows, chosen[rows]]).astype(float))
            looks = Looks.read(same, rows, answers)
            rows = rows[looks.states == 0]
            looks = Looks._make(one[looks.states == 0] for one in looks)
            assert (active == rows).all()
            seen = memory.look(rows, looks.positions, looks.corners, looks.view)
            for name, one in observed._asdict().items():
                assert (one == getattr(seen, name)).all(), name
            assert (observed.view == (looks.view == 1)).all()
            for k, row in enumerate(rows.tolist()):
                check_known(same, row, looks, k, observed.known[k], known[row])
            chosen[rows] = (action + rows) % 4
            memory.act(rows, chosen[rows])
        world(np.column_stack([rows, chosen[rows]]).astype(float))
        assert (ended.positions == world.positions).all()
        assert (ended.collisions == world.collisions).all()


def check_known(model, scene, looks, k, cells, known):
    """Compare a masked map with a dictionary of the cells seen."""
    corner = looks.corners[k]
    for (r, c), value in np.ndenumerate(looks.view[k]):
        at = (r + int(corner[0]), c + int(corner[1]))
        if 0 <= at[0] < model.shape[0] and 0 <= at[1] < model.shape[1]:
            known[at] = int(value)
    known[tuple(model.targets[scene].tolist())] = 2
    # The cell of the vehicle is known even if a hovering camera does not show it.
    now = known | {tuple(looks.positions[k].tolist()): 0}
    for at, value in np.ndenumerate(cells):
        if at in now:
            assert value == now[at]
        elif value == 1:  # found by a collision
            assert model.blocked[(scene, *at)]
        else:
            assert value == -1


def test_a_step_that_was_stopped_leaves_an_obstacle_in_memory():
    model = drawn(["S#.T"], view=(1, 1), steps=2)
    world, looks = watch(model, lambda _, rows: np.array([3]))
    first, seen = (observed for observed, _ in looks)
    assert first.known.tolist() == [[[0, -1, -1, 2]]]
    assert seen.known.tolist() == [[[0, 1, -1, 2]]] and world.collisions.tolist() == [2]
    assert seen.current.tolist() == [[[0, -1, -1, -1]]]


@settings(deadline=None, max_examples=15)
@given(models(scenes=3))
def test_ways_are_as_long_as_those_of_the_map_and_the_expert_takes_one(model):
    ways = shortest_ways(model.blocked, model.targets)
    here = ways[np.arange(3), *model.starts.T]
    assert (np.where(here < FAR, here, np.inf) == model.fewest_steps()).all()

    def choose(seen, rows):
        return first_of(best_actions(ways[rows], seen.positions))

    world = walk_through(scenes_of(model), (3, 3), choose, steps=60)
    reached = (world.positions == model.targets).all(axis=1)
    assert (reached == (here < FAR)).all()
    assert (world.taken == here)[reached].all()
    assert not world.collisions[reached].any()


def test_logits_that_are_not_finite_are_never_chosen():
    nan, inf = np.nan, np.inf
    logits = np.array(
        [[nan, 1, 2, inf], [nan] * 4, [1, 1, 0, -inf], [-inf, nan, -5, nan]], np.float32
    )
    actions, wrong = choose_actions(logits)
    assert actions.tolist() == [2, 0, 0, 2]
    assert wrong.tolist() == [2, 4, 1, 3]


def test_states_follow_the_active_scenes():
    def network(inputs, state):
        marks, counts = (inputs, np.zeros(len(inputs))) if state is None else state
        assert (marks == inputs).all()
        return counts, (marks, counts + 1)

    recurrence, marks = Recurrence(network), np.array([5, 6, 7])
    for step, rows in enumerate([[0, 1, 2], [0, 2], [0, 2], [2]]):
        counts = recurrence(marks[rows], np.array(rows))
        assert counts.tolist() == [step] * len(rows)


@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_network_is_judged_by_its_runs(part, monkeypatch):
    """Arrays in place of tensors, and the planner or a walk to the left in place of a network."""
    monkeypatch.setattr(Observation, "tensors", lambda observed: observed)

    class Judged(ImitationTrainer):
        def __init__(self, network):
            self.course = Course(0, 1, {"law": "paper", "judged": 12}, draw_scene_arrays)
            self.part, self.network, self.device = part, network, SimpleNamespace(type="cpu")

    def answer(actions):
        return SimpleNamespace(numpy=lambda force: np.eye(4)[actions]), (actions,)

    def planner(seen, _):
        ways = shortest_ways((seen.current if part == 2 else seen.known) == 1, seen.targets)
        return answer(first_of(best_actions(ways, seen.positions)))

    good = Judged(planner).judge()
    assert good["score"] == 100.0 and good["collisions"] == 0.0 and 1.0 <= good["ratio"] < 1.1
    bad = Judged(lambda seen, _: answer(np.full(len(seen.targets), 2))).judge()
    # The expert leads all runs into the view, and those that begin there to the target.
    assert bad["score"] < 60.0 and bad["collisions"] > 1.0


def test_without_pytorch_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    with pytest.raises(BackendMissing, match=r"crosstrack\[learn\]"):
        find_backend("small-vin").require()
    with pytest.raises(BackendMissing, match=r"crosstrack\[learn\]"):
        train("vin", "vin.npz")


@pytest.mark.parametrize("name", BACKENDS)
def test_maps_that_are_too_large_are_refused(name):
    cls = BACKENDS[name]
    shape = (300, 300)
    model = UnknownGridNavigation(
        np.zeros((1, *shape), bool), np.array([[0, 0]]), np.array([[9, 9]]), np.array(shape)
    )
    assert "maps of 300 × 300 cells, only of at most 65536 cells" in cls().refuses(model)
    if not cls().missing():
        with pytest.raises(UnsupportedFormulation, match="65536"):
            run(cls(), model)


@pytest.mark.parametrize("name", [*BACKENDS, "macn", "mcgn-1", "mcgn-2"])
def test_shipped_weights_are_small_and_say_how_they_were_made(name):
    assert shipped_weights(name).stat().st_size < 1e6
    made = read_weights(shipped_weights(name), name).made
    law = "walls" if name == "small-vin" else "paper"
    assert made["examples"] == "draw_scene_arrays" and made["law"] == law
    chosen, words = find_training(name), shlex.split(made["command"])
    begin = f"crosstrack train {name} --output FILE.npz --seed 0 --epochs {made['epochs']}".split()
    assert words[: len(begin)] == begin
    # The command line has the same effect.
    given = dict(one.split("=") for one in words[len(begin) + 1 :: 2])
    given = {key: type(chosen.options[key].default)(value) for key, value in given.items()}
    # Earlier files lack the options that were added later.
    recorded = {key: made.get(key, option.default) for key, option in chosen.options.items()}
    assert recorded == chosen.checked_options(given)


# -- networks -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def seen(torch):
    """Return the observations of runs in scenes of the paper's first task, as arrays."""
    model = draw_scenes(scenes=12, obstacles=5, seed=7, view=(9, 9))
    _, found = watch(model, lambda observed, _: optimistic(observed))
    return [observed for observed, rows in found if len(rows) == model.scenes]


def test_first_weights_are_value_iteration(seen, torch):
    """The best action begins a shortest path with unknown cells treated as free."""
    torch.manual_seed(3)
    network = small_vin.build_network(**small_vin.ARCHITECTURE)
    right = []
    for observed in seen:
        with torch.inference_mode():
            logits, _ = network(observed.tensors(), None)
        ways = shortest_ways(observed.known == 1, observed.targets)
        best = best_actions(ways, observed.positions)
        right += best[np.arange(len(best)), choose_actions(logits.numpy())[0]].tolist()
    assert np.mean(right) >= 0.999


def test_a_way_that_winds_is_found_at_any_length(torch):
    model = WILD["maze"]()
    ways = shortest_ways(model.blocked, model.targets)
    network = small_vin.build_network()

    def choose(observed, rows):
        with torch.inference_mode():
            return choose_actions(network(observed.tensors(), None)[0].numpy())[0]

    world = walk_through(scenes_of(model), (35, 35), choose, steps=200)
    assert (world.positions == model.targets).all()
    assert world.taken[0] == ways[0][tuple(model.starts[0])]


def test_the_state_of_a_scene_stays_with_it(torch):
    """A network that counts the steps of each scene keeps the counts as other scenes end."""
    model = drawn(
        ["ST....", "......"], ["S....T", "......"], ["S..T..", "......"], view=(3, 3), steps=9
    )
    told = []

    def network(observed, state):
        marks = observed.targets[:, 1].to(torch.float32)
        count = torch.zeros(len(marks)) if state is None else state[1] + 1
        if state is not None:
            assert (state[0] == marks).all()
        told.append(count.tolist())
        return torch.tensor([[0.0, 0.0, 0.0, 1.0]]).expand(len(marks), 4), (marks, count)

    policy = LearnedPolicy(model, np.arange(3), network)
    world, rows, chosen = World(model), np.arange(3), np.full(3, -1)
    while len(rows):
        looks = Looks.read(model, rows, world(np.column_stack([rows, chosen]).astype(float)))
        looks = Looks._make(one[looks.states == 0] for one in looks)
        rows, chosen = looks.scenes, policy.decide(looks) if len(looks.scenes) else chosen[:0]
    assert told == [[0, 0, 0], [1, 1], [2, 2], [3], [4]]


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("wild", ["no-way", "beside-in-the-dark", "one-row", "wide-view"])
def test_every_run_ends_and_repeats(name, wild, torch):
    backend, model = BACKENDS[name](), dataclasses.replace(WILD[wild](), steps=25)
    answer = run(backend, model)
    assert model.verify(answer.point).ok
    assert run(backend, model).point == answer.point
    assert all(len(one) <= model.steps for one in answer.point.actions)
    assert Outcome.NO_WAY not in answer.point.outcomes
    assert torch.is_inference_mode_enabled() is False


@pytest.mark.parametrize("name", BACKENDS)
def test_weights_that_diverged_end_within_the_steps(name, torch, tmp_path):
    """Non-finite logits, as after a diverged training, still yield valid runs."""
    shipped = read_weights(shipped_weights(name), name)
    wild = {key: np.where(one > 0, 3e38, -3e38) for key, one in shipped.arrays.items()}
    file = tmp_path / "wild.npz"
    write_weights(file, Weights(name, wild, shipped.architecture))
    model = draw_scenes(scenes=4, seed=3, steps=12)
    backend = BACKENDS[name]()
    answer = run(backend, model, weights=str(file))
    assert model.verify(answer.point).ok
    assert run(backend, model, weights=str(file)).point == answer.point
    assert answer.statistics["decisions not finite"] > 0
    assert "decisions not finite" not in run(backend, model).statistics


def test_weights_of_another_network_are_refused(torch, tmp_path):
    model = draw_scenes(scenes=1)
    with pytest.raises(InvalidData, match="must hold the weights of vin, got 'small-vin'"):
        run(Vin(), model, weights=str(shipped_weights("small-vin")))
    shipped = read_weights(shipped_weights("vin"), "vin")
    file = tmp_path / "vin.npz"
    write_weights(file, Weights("vin", shipped.arrays, {"hidden": 150}))
    with pytest.raises(InvalidData, match="architecture must name hidden, iterations"):
        load_network("vin", file)
    write_weights(file, Weights("vin", shipped.arrays, {"hidden": 7, "iterations": 30}))
    with pytest.raises(InvalidData, match="must have shape"):
        load_network("vin", file)


def test_the_small_network_stays_near_the_planner(torch):
    model = draw_scenes(obstacles=4, scenes=30, seed=21, view=(9, 9))
    world, _ = watch(model, lambda observed, _: optimistic(observed))
    reached = (world.positions == model.targets).all(axis=1)
    learned = run(SmallVin(), model).point
    assert learned.success >= 100.0 * reached.mean() - 5.0
    assert model.score(learned).ratio <= 1.1


# -- training -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tiny(torch, tmp_path_factory):
    """A short training from random weights writes files and reports each epoch."""
    folder = tmp_path_factory.mktemp("tiny")
    told = []
    file = folder / "small.npz"
    train(
        blank_training(), file, examples=draw_scene_arrays, epochs=2, options=TINY,
        on_progress=told.append,
    )  # fmt: skip
    return SimpleNamespace(folder=folder, file=file, told=told)


def blank_training():
    """The training of the small network, from drawn costs, and with its choices upside down."""
    training = find_training("small-vin")

    def trainer(course):
        import torch

        found = training.run(course)
        with torch.no_grad():
            found.network.cost.weight.normal_(0.0, 0.5)
            found.network.sharpness.fill_(-0.05)
        return found

    return dataclasses.replace(training, run=trainer)


def test_a_training_of_seconds_learns(tiny):
    losses = [one.figures["loss"] for one in tiny.told]
    # A uniform choice among four actions with two correct ones has the loss log 2 = 0.69.
    assert losses[-1] < 0.6 and losses[-1] < 0.5 * losses[0]
    model = draw_scenes(obstacles=3, scenes=25, seed=11)
    untrained = tiny.folder / "untrained.npz"
    options = find_training("small-vin").checked_options(TINY)
    write_weights(untrained, blank_training().run(Course(0, 1, options)).weights())
    before = run(SmallVin(), model, weights=str(untrained)).point
    after = run(SmallVin(), model, weights=str(tiny.file)).point
    assert before.success <= 20.0 and after.success >= 80.0


def test_same_seed_same_weights_also_when_resumed(tiny, monkeypatch):
    file = tiny.folder / "again.npz"
    asked = {"examples": draw_scene_arrays, "epochs": 2, "options": TINY}

    def stop(epoch):
        if epoch.number == 1:
            raise KeyboardInterrupt

    assert train(blank_training(), file, on_progress=stop, **asked).ended == "interrupted"
    assert train(blank_training(), file, resume=True, **asked).epochs == 2
    one, two = (read_weights(path, "small-vin") for path in (file, tiny.file))
    assert all((one.arrays[key] == two.arrays[key]).all() for key in two.arrays)
    assert one.made == two.made


def test_solve_accepts_weights_of_the_command(torch, tmp_path):
    file = tmp_path / "vin.npz"
    asked = ["--epochs", 1, "--option", "batch=2", "--option", "batches=1"]
    asked += ["--option", "judged=1", "--seed", 5]
    done = command("train", "vin", "--output", file, *asked)
    assert f"--option weights={file}" in done.stdout
    found = read_weights(file, "vin")
    assert found.made["command"].startswith("crosstrack train vin --output FILE.npz --seed 5 --e")
    assert found.made["examples"] == "draw_scene_arrays"
    model = draw_scenes(scenes=2)
    assert model.verify(run(Vin(), model, weights=str(file)).point).ok


def test_training_without_scenes_names_the_argument(torch, tmp_path):
    with pytest.raises(InvalidData, match="examples must be a function that draws scenes"):
        train("small-vin", tmp_path / "small.npz", options=TINY)
