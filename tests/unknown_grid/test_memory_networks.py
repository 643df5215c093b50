"""The neural computer against its equations, and the networks that use it."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="networks with a memory are built with PyTorch")

from unknown_grid.scenes import WILD, run  # noqa: E402

from crosstrack.errors import CrosstrackError, InvalidData  # noqa: E402
from crosstrack.instances.unknown_grid import draw_scene_arrays, draw_scenes  # noqa: E402
from crosstrack.solvers.gradient import arrays_of  # noqa: E402
from crosstrack.solvers.trainer import Course, one_thread  # noqa: E402
from crosstrack.solvers.unknown_grid import macn, mcgn, run_training  # noqa: E402
from crosstrack.solvers.unknown_grid.dnc import Record, allocate, build_computer, link  # noqa: E402
from crosstrack.solvers.unknown_grid.imitation import shortest_ways  # noqa: E402
from crosstrack.solvers.unknown_grid.learned import Macn, Mcgn  # noqa: E402
from crosstrack.solvers.unknown_grid.networks import shipped_weights  # noqa: E402
from crosstrack.solvers.unknown_grid.run_training import RunTrainer  # noqa: E402
from crosstrack.solvers.unknown_grid.value_iteration import (  # noqa: E402
    OBSTACLE,
    build_planner,
    crop,
)
from crosstrack.solvers.weights import Weights, read_weights, write_weights  # noqa: E402

NETWORKS = {"macn": (macn, Macn), "mcgn": (mcgn, Mcgn)}
#: Targets that shipped weights reach at the least, percent; less than they do.
LEAST = {"macn": 85.0, "mcgn": 85.0}
SMALL = {
    "channels": 4,
    "features": 1,
    "encoded": 4,
    "units": 16,
    "words": 6,
    "width": 3,
    "heads": 2,
}


# --- the neural computer ----------------------------------------------------


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


def softmax(x):
    found = np.exp(x - x.max())
    return found / found.sum()


def oneplus(x):
    return 1.0 + np.log1p(np.exp(x))


def plain_likeness(memory, key, strength):
    """C(M, k, beta), with the lengths that the module compares."""
    lengths = np.sqrt((memory**2).sum(axis=1) + 1e-4) * np.sqrt((key**2).sum() + 1e-4)
    return softmax(strength * (memory @ key) / lengths)


def plain_allocation(usage):
    free = sorted(range(len(usage)), key=lambda i: usage[i])
    found = np.zeros(len(usage))
    for j, word in enumerate(free):
        found[word] = (1.0 - usage[word]) * np.prod([usage[i] for i in free[:j]])
    return found


def plain_step(state, x, weights, heads, width):
    """One step of one computer, equation by equation of the section Methods of the source."""
    memory, usage, precedence, written, links, attended, reads, hidden, cell = state
    words = len(memory)
    gates = weights["controller.weight_ih"] @ np.concatenate([x, reads.ravel()])
    gates = gates + weights["controller.bias_ih"] + weights["controller.bias_hh"]
    entered, forgotten, offered, shown = np.split(
        gates + weights["controller.weight_hh"] @ hidden, 4
    )
    cell = sigmoid(forgotten) * cell + sigmoid(entered) * np.tanh(offered)
    hidden = sigmoid(shown) * np.tanh(cell)
    raw = iter(weights["interface.weight"] @ hidden + weights["interface.bias"])

    def take(count):
        return np.array([next(raw) for _ in range(count)])

    read_keys, read_strengths = take(heads * width).reshape(heads, width), oneplus(take(heads))
    write_key, write_strength = take(width), oneplus(take(1))[0]
    erase, content, free = sigmoid(take(width)), take(width), sigmoid(take(heads))
    allocation_gate, write_gate = sigmoid(take(2))
    modes = [softmax(take(3)) for _ in range(heads)]
    retained = np.prod([1.0 - free[i] * attended[i] for i in range(heads)], axis=0)
    usage = (usage + written - usage * written) * retained
    usage = 1e-6 + (1.0 - 1e-6) * usage
    by_content = plain_likeness(memory, write_key, write_strength)
    by_need = plain_allocation(usage)
    written = write_gate * (allocation_gate * by_need + (1.0 - allocation_gate) * by_content)
    memory = memory * (1.0 - np.outer(written, erase)) + np.outer(written, content)
    fresh = np.zeros((words, words))
    for i in range(words):
        for j in range(words):
            if i != j:
                fresh[i, j] = (1.0 - written[i] - written[j]) * links[i, j]
                fresh[i, j] += written[i] * precedence[j]
    precedence = (1.0 - written.sum()) * precedence + written
    found = []
    for i in range(heads):
        by_key = plain_likeness(memory, read_keys[i], read_strengths[i])
        ways = fresh.T @ attended[i], by_key, fresh @ attended[i]
        found.append(sum(share * way for share, way in zip(modes[i], ways, strict=True)))
    attended = np.array(found)
    reads = attended @ memory
    out = (
        weights["output.weight"] @ np.concatenate([hidden, reads.ravel()]) + weights["output.bias"]
    )
    return out, (memory, usage, precedence, written, fresh, attended, reads, hidden, cell)


def wild_computer(seed, **sizes):
    """A computer whose weights are large enough for every gate to open and close."""
    torch.manual_seed(seed)
    found = build_computer(3, 4, **{"units": 8, "words": 5, "width": 3, "heads": 2, **sizes})
    with torch.no_grad():
        for one in found.parameters():
            one.mul_(3.0)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_computer_is_what_the_equations_say(seed):
    computer = wild_computer(seed).double()
    record = Record(*(one.double() for one in computer.start(2)))
    weights = {name: one.astype(float) for name, one in arrays_of(computer).items()}
    plain = [tuple(one[k].numpy() for one in record) for k in range(2)]
    for inputs in np.random.default_rng(seed).normal(size=(12, 2, 3)):
        with torch.no_grad():
            out, record = computer(torch.from_numpy(inputs), record)
        for k in range(2):
            wanted, plain[k] = plain_step(plain[k], inputs[k], weights, heads=2, width=3)
            np.testing.assert_allclose(out[k].numpy(), wanted, atol=1e-9)
            for one, other in zip(record, plain[k], strict=True):
                np.testing.assert_allclose(one[k].numpy(), other, atol=1e-9)


def test_weightings_stay_shares_and_links_have_no_loops():
    computer = wild_computer(7, words=8, heads=4)
    record = computer.start(3)
    moved = 0.0
    for _ in range(60):
        with torch.no_grad():
            _, record = computer(2.0 * torch.randn(3, 3), record)
        for weighting in (record.written, record.attended, record.links, record.links.mT):
            assert float(weighting.min()) >= -1e-6
            assert float(weighting.sum(dim=-1).max()) <= 1.0 + 1e-5
        assert float(record.usage.min()) > 0.0 and float(record.usage.max()) <= 1.0 + 1e-6
        assert not record.links.diagonal(dim1=1, dim2=2).any()
        moved = max(moved, float(record.links.max()))
    assert moved > 0.1  # words were linked at all


def test_allocation_takes_the_least_used_word():
    found = allocate(torch.tensor([[0.9, 0.2, 0.5], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    wanted = [[0.1 * 0.5 * 0.2, 0.8, 0.5 * 0.2], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-7)


def test_links_say_what_was_written_next():
    links, precedence = torch.zeros(1, 3, 3), torch.zeros(1, 3)
    for word in (2, 0, 1):
        links, precedence = link(links, precedence, torch.eye(3)[word][None])
    np.testing.assert_array_equal(links[0].numpy(), [[0, 0, 1], [1, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(precedence[0].numpy(), [0, 1, 0])


def test_gradients_are_finite_from_an_empty_memory_on():
    computer = wild_computer(1)
    record, total = computer.start(4), torch.zeros(())
    for step in range(40):
        out, record = computer(torch.zeros(4, 3) if step < 3 else torch.randn(4, 3), record)
        total = total + out.square().mean()
    total.backward()
    for name, one in computer.named_parameters():
        assert bool(torch.isfinite(one.grad).all()), name
        assert bool(one.grad.any()), name


# --- value iteration --------------------------------------------------------


def test_first_values_are_steps_to_the_target():
    rng = np.random.default_rng(3)
    blocked, _, targets = draw_scene_arrays("mixed", (13, 11), (2, 6), 20, rng)
    steps = shortest_ways(blocked, targets)
    rewards = np.where(blocked, -OBSTACLE, -1.0)
    rewards[np.arange(20), targets[:, 0], targets[:, 1]] = 0.0
    framed = np.pad(rewards, ((0, 0), (1, 1), (1, 1)), constant_values=-OBSTACLE)
    with torch.no_grad():
        worth, values = build_planner(30)(torch.from_numpy(framed[:, None].astype(np.float32)))
    found = values[:, 0, 1:-1, 1:-1].numpy()
    near = (steps < 30) & ~blocked
    assert near.sum() > 1000
    np.testing.assert_array_equal(found[near], -steps[near])
    np.testing.assert_array_equal(worth.amax(dim=1).numpy(), values[:, 0].numpy())


def test_windows_lie_around_their_places():
    planes = torch.arange(2 * 3 * 4 * 5, dtype=torch.float32).reshape(2, 3, 4, 5) + 1.0
    found = crop(planes, torch.tensor([[0, 4], [2, 2]]), 1)
    np.testing.assert_array_equal(found[1], planes[1, :, 1:4, 1:4])
    np.testing.assert_array_equal(found[0, :, 1:, :2], planes[0, :, :2, 3:])
    assert not found[0, :, 0].any() and not found[0, :, :, 2].any()


# --- the networks -----------------------------------------------------------


def small(name):
    return {**NETWORKS[name][0].ARCHITECTURE, **SMALL}


def trainer(name, seed):
    module = NETWORKS[name][0]
    asked = {key: one.default for key, one in module.TRAINING.options.items()}
    asked |= {"scenes": 10, "runs": 6, "batches": 3, "rate": 0.02}
    torch.manual_seed(seed)
    network = module.build_network(**small(name))
    if name == "mcgn":  # its first weights know the way: this one is to be learned
        torch.nn.init.constant_(network.sharpness, 0.05)
    return RunTrainer(Course(seed, 2, asked, draw_scene_arrays), name, network, small(name))


@pytest.mark.parametrize("name", NETWORKS)
def test_sizes_are_those_of_the_paper(name):
    wanted = {"iterations": 30, "units": 256, "words": 32, "width": 8, "heads": 4}
    assert wanted.items() <= NETWORKS[name][0].ARCHITECTURE.items()
    arrays = read_weights(shipped_weights(name), name).arrays
    assert arrays["computer.controller.weight_hh"].shape == (1024, 256)
    assert arrays["computer.interface.weight"].shape == (4 * 8 + 3 * 8 + 5 * 4 + 3, 256)
    assert arrays["computer.output.weight"].shape == (4, 256 + 4 * 8)
    assert shipped_weights(name).stat().st_size < 1_000_000


def test_sizes_beyond_the_canvas_are_refused():
    wide = draw_scenes(shape=(17, 18), scenes=1, view=(9, 9))
    assert "17 × 17" in Mcgn().refuses(wide) and not Macn().refuses(wide)
    far = draw_scenes(scenes=1, view=(13, 11))
    assert "11 × 11" in Macn().refuses(far) and not Mcgn().refuses(far)
    with pytest.raises(CrosstrackError, match="17 × 17"):
        run(Mcgn(), wide)


@pytest.mark.parametrize("name", NETWORKS)
def test_training_lowers_the_loss_and_repeats_bit_for_bit(name, monkeypatch):
    # All vehicles go where the expert goes, so that the losses are of the same decisions.
    monkeypatch.setattr(run_training, "_EXPERT", 1.0)
    monkeypatch.setattr(run_training, "_CHANCE", 0.0)

    def learn(seed):
        found = trainer(name, seed)
        found.judge = lambda: {"score": 0.0}  # what is learned does not depend on it
        before, first = loss_elsewhere(found), found.weights().arrays
        figures = found.run_epoch(0, lambda: None)
        return found, before, first, figures

    def loss_elsewhere(found):
        """The loss in scenes that are none of those learned from."""
        with torch.no_grad():
            found.prepare(0, np.random.default_rng(99))
            return float(found.loss(0, np.random.default_rng(99)))

    with one_thread():
        one, before, first, figures = learn(0)
        two, *_, repeated = learn(0)
        assert loss_elsewhere(one) < before - 0.02
    assert figures == repeated
    for key, weight in one.weights().arrays.items():
        assert np.isfinite(weight).all()
        np.testing.assert_array_equal(weight, two.weights().arrays[key])
        if key != "planning.first":
            assert (weight != first[key]).any(), key


@pytest.fixture(scope="module", params=NETWORKS)
def strange(request, tmp_path_factory):
    """A policy, and files of weights of a small network: at random, and so large that nothing is finite."""
    folder, name = tmp_path_factory.mktemp("weights"), request.param
    torch.manual_seed(5)
    arrays = arrays_of(NETWORKS[name][0].build_network(**small(name)))
    rng = np.random.default_rng(5)
    found = {}
    for word, size in (("random", 1.0), ("large", 1e3), ("diverged", 1e30)):
        drawn = {key: size * rng.normal(size=one.shape) for key, one in arrays.items()}
        found[word] = str(folder / f"{word}.npz")
        write_weights(found[word], Weights(name, drawn, small(name)))
    return NETWORKS[name][1], found


@pytest.mark.parametrize("word", ["random", "large", "diverged"])
def test_runs_of_strange_weights_end_and_replay(strange, word):
    backend, files = strange
    model = draw_scenes("walls", shape=(9, 11), scenes=6, view=(5, 7), steps=25, seed=4)
    answer, again = (run(backend(), model, weights=files[word]) for _ in range(2))
    assert answer.point == again.point
    assert max(map(len, answer.point.actions)) <= 25
    assert model.verify(answer.point).ok
    assert ("decisions not finite" in answer.statistics) is (word != "random")


def test_weights_of_another_network_are_refused(strange, tmp_path):
    backend, files = strange
    other = Macn if backend is Mcgn else Mcgn
    model = draw_scenes(shape=(9, 9), scenes=1, view=(5, 5))
    with pytest.raises(InvalidData, match="must hold the weights of"):
        run(other(), model, weights=files["random"])


@pytest.mark.parametrize("name", NETWORKS)
def test_shipped_weights_lead_to_most_targets(name):
    backend = NETWORKS[name][1]
    model = draw_scenes("walls", obstacles=3, scenes=30, seed=11, view=(11, 11))
    answer = run(backend(), model)
    assert model.verify(answer.point).ok
    assert answer.point.success >= LEAST[name]
    assert answer.point == run(backend(), model).point


@pytest.mark.parametrize("scene", ["whole-view", "no-way-at-once", "one-row-blocked", "one-step"])
@pytest.mark.parametrize("name", NETWORKS)
def test_wild_scenes_end_or_are_refused(name, scene):
    model, backend = WILD[scene](), NETWORKS[name][1]()
    if name == "macn" and max(model.view) > 11:
        assert backend.refuses(model)
        return
    plan = run(backend, model).point
    assert model.verify(plan).ok
    assert max(map(len, plan.actions)) <= model.steps


@pytest.mark.parametrize("name", NETWORKS)
def test_decisions_follow_from_what_was_seen(name):
    """A map that is blocked wherever no view ever was leads to the same actions."""
    backend, model = NETWORKS[name][1](), draw_scenes(scenes=4, seed=8, view=(5, 5), uav="follow")
    plan = run(backend, model).point
    unseen = np.ones_like(model.blocked)
    for k, taken in enumerate(model.replays(plan)):
        for row, column in taken.positions:
            unseen[k, max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3] = False
    unseen[np.arange(4), model.targets[:, 0], model.targets[:, 1]] = False
    assert unseen.sum() > 200
    darker = replace(model, blocked=model.blocked | unseen)
    assert run(backend, darker).point == plan
