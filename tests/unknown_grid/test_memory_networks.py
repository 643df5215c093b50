"""The paper's networks: comparison with its equations, and training."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="networks with a memory are built with PyTorch")

from torch.nn import functional  # noqa: E402
from unknown_grid.scenes import WILD, drawn, first_look, run  # noqa: E402

from crosstrack.errors import CrosstrackError, InvalidData  # noqa: E402
from crosstrack.instances.unknown_grid import draw_scene_arrays, draw_scenes  # noqa: E402
from crosstrack.models.unknown_grid.scenes import Task  # noqa: E402
from crosstrack.solvers.learning.gradient import arrays_of  # noqa: E402
from crosstrack.solvers.learning.trainer import Course, one_thread  # noqa: E402
from crosstrack.solvers.learning.training import find_training  # noqa: E402
from crosstrack.solvers.learning.weights import Weights, read_weights, write_weights  # noqa: E402
from crosstrack.solvers.unknown_grid import macn, value_iteration  # noqa: E402
from crosstrack.solvers.unknown_grid.dnc import (  # noqa: E402
    Interface,
    Record,
    allocate,
    build_computer,
    link,
    read,
    write,
)
from crosstrack.solvers.unknown_grid.episodes import (  # noqa: E402
    ImitationTrainer,
    lead,
)
from crosstrack.solvers.unknown_grid.imitation import Scenes  # noqa: E402
from crosstrack.solvers.unknown_grid.learned import Macn, Mcgn  # noqa: E402
from crosstrack.solvers.unknown_grid.networks import shipped_weights  # noqa: E402
from crosstrack.solvers.unknown_grid.value_iteration import build_planner  # noqa: E402

#: Networks with a memory: module, and the part of the run for the training.
NETWORKS = {"macn": (macn, 0), "mcgn-1": (macn.First, 1)}
POLICIES = {"macn": Macn, "mcgn": Mcgn}
#: Lower limits on the targets that shipped weights reach, percent, below the measured values.
LEAST = {"macn": 45.0, "mcgn": 75.0}
SMALL = {"hidden": 3, "iterations": 4, "units": 16, "words": 6, "width": 3, "heads": 2}


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
    """Return a computer with weights large enough to open and close every gate."""
    torch.manual_seed(seed)
    found = build_computer(3, 4, **{"units": 8, "words": 5, "width": 3, "heads": 2, **sizes})
    with torch.no_grad():
        for one in found.parameters():
            one.mul_(3.0)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_computer_matches_the_equations(seed):
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


def test_links_store_the_order_of_writes():
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


def test_writing_and_reading_by_hand():
    """Equations 3 and 4 with both words alike, so that half of each is written and read."""
    record = build_computer(1, 1, units=4, words=2, width=2, heads=1).start(1)
    record = record._replace(memory=torch.ones(1, 2, 2))
    asked = Interface(
        read_keys=torch.ones(1, 1, 2), read_strengths=torch.ones(1, 1),
        write_key=torch.ones(1, 1, 2), write_strength=torch.ones(1, 1),
        erase=torch.tensor([[1.0, 0.0]]), content=torch.tensor([[0.2, 0.4]]), free=torch.zeros(1, 1),
        allocation=torch.zeros(1, 1), gate=torch.ones(1, 1), modes=torch.tensor([[[0.0, 1.0, 0.0]]]),
    )  # fmt: skip
    record = read(write(record, asked), asked)
    # M = 1 (1 - 0.5 · 1) + 0.5 · 0.2 = 0.6 and 1 (1 - 0.5 · 0) + 0.5 · 0.4 = 1.2.
    np.testing.assert_allclose(record.memory[0].numpy(), [[0.6, 1.2], [0.6, 1.2]], atol=1e-6)
    np.testing.assert_allclose(record.reads[0, 0].numpy(), [0.6, 1.2], atol=1e-6)


# --- value iteration --------------------------------------------------------


def corridor(iterations):
    """A planner with R = reward map - 2 map, whose last two actions halve the value of the cell left and right."""
    planner = build_planner(2, iterations)
    with torch.no_grad():
        for weight in planner.parameters():
            weight.zero_()
        # The two hidden channels pass on map and reward map.
        planner.reading.weight[0, 0, 1, 1] = planner.reading.weight[1, 1, 1, 1] = 1.0
        planner.pooling.weight[0, :, 0, 0] = torch.tensor([-2.0, 1.0])
        planner.rewarding.weight[:, 0, 1, 1] = 1.0
        planner.moving.weight[2, 0, 1, 0] = planner.moving.weight[3, 0, 1, 2] = 0.5
    return planner


def test_value_iteration_by_hand():
    """Table I and equations 1 and 2 on three cells in a row, the target at the right end."""
    cells, target = torch.tensor([[[0.0, 0.0, 2.0]]]), torch.tensor([[0, 2]])
    for iterations, values in ((0, [0, 0, 6]), (1, [0, 3, 6]), (2, [1.5, 3, 7.5])):
        planner = corridor(iterations)
        for traced in (False, True):
            with torch.set_grad_enabled(traced):
                rewards, found, worth = planner(cells, target)
            assert rewards[0, 0, 0].tolist() == [0, 0, 6]  # 10 - 2 · 2
            assert found[0, 0, 0].tolist() == values
    # Q = R + 0.5 V of the neighbour: left, then right.
    assert worth[0, 2, 0].tolist() == [0, 0.75, 7.5]
    assert worth[0, 3, 0].tolist() == [1.5, 3.75, 6]


def test_iteration_by_shifts_has_the_gradients_of_the_convolutions():
    torch.manual_seed(2)
    planner = build_planner(3, 6)
    with torch.no_grad():
        for weight in planner.parameters():
            weight.normal_(0.0, 0.4)
    maps, targets = (
        torch.randint(-1, 3, (4, 5, 7)).float(),
        torch.tensor([[0, 0], [4, 6], [2, 3], [1, 5]]),
    )
    shifted = planner(maps, targets)[1]
    shifted.square().sum().backward()
    gradients = [one.grad.clone() for one in planner.parameters()]
    planner.zero_grad()
    goals = torch.zeros(4, 5, 7)
    goals[torch.arange(4), targets[:, 0], targets[:, 1]] = 10.0
    # Layer by layer, as Table I prints them.
    fixed = planner.rewarding(planner.pooling(planner.reading(torch.stack([maps, goals], dim=1))))
    values = fixed.amax(dim=1, keepdim=True)
    for _ in range(6):
        values = (fixed + planner.moving(values)).amax(dim=1, keepdim=True)
    values.square().sum().backward()
    np.testing.assert_allclose(shifted.detach(), values.detach(), rtol=1e-4)
    for one, other in zip(gradients, planner.parameters(), strict=True):
        np.testing.assert_allclose(
            one, other.grad, rtol=1e-3, atol=1e-3 * float(other.grad.abs().max())
        )


# --- what the networks see --------------------------------------------------


def looks(lines, view):
    """Return the observation at the start of a random scene."""
    return first_look(drawn(lines, view=view))


def test_masked_and_partial_map_by_hand():
    """O_g is -1 outside the view, even at the target; O_p is the view, with the target as 2."""
    far = looks(["@S..T"], (1, 5))
    assert far.current[0].tolist() == [[1, 0, 0, 0, -1]] and not far.seen[0]
    near = looks(["@S.T."], (1, 5))
    assert near.current[0].tolist() == [[1, 0, 0, 2, -1]] and near.seen[0]
    partial = near.in_view()
    # The view begins one cell to the left of the map, which is blocked there.
    assert partial.current[0].tolist() == [[1, 1, 0, 0, 2]]
    assert partial.positions.tolist() == [[0, 2]] and partial.targets.tolist() == [[0, 4]]


def test_the_controller_reads_two_maps():
    """MCGN-I reads O_g and V, MACN R and V; a small map is centred among obstacles."""
    observed = looks(["...", ".S.", "..T"], (1, 3)).tensors()
    sizes = {"side": 5, **SMALL}
    torch.manual_seed(0)
    first = macn.First.build_network(**sizes)
    inputs = first.read(observed)[0].detach().reshape(2, 5, 5)
    wanted = np.ones((5, 5))
    wanted[1:4, 1:4] = [[-1, -1, -1], [0, 0, 0], [-1, -1, -1]]
    np.testing.assert_array_equal(inputs[0], wanted)
    torch.manual_seed(0)
    other = macn.build_network(**sizes)
    rewards, values, _ = other.planner(
        torch.from_numpy(wanted).float()[None], torch.tensor([[3, 3]])
    )
    np.testing.assert_allclose(
        other.read(observed)[0].detach().reshape(2, 5, 5)[0], rewards[0, 0].detach()
    )
    np.testing.assert_allclose(inputs[1], values[0, 0].detach())
    first.without = "values"
    assert not first.read(observed)[0].reshape(2, 5, 5)[1].any()


def test_the_second_part_decides_once_the_target_was_seen():
    class Part(torch.nn.Module):
        def __init__(self, action):
            super().__init__()
            self.action, self.maps = action, []

        def forward(self, observed, state):
            self.maps.append(observed.current)
            return functional.one_hot(
                torch.full((len(observed.seen),), self.action), 4
            ).float(), state

    one, two = Part(1), Part(2)
    both = macn.combine(one, two)
    model = drawn(["@S.T.", "....."], ["S...T", "....."], view=(1, 5))
    logits, _ = both(first_look(model).tensors(), None)
    assert logits.argmax(dim=1).tolist() == [2, 1]
    assert one.maps[0].shape == (2, 2, 5) and two.maps[0][0].tolist() == [[1, 1, 0, 0, 2]]


# --- training ---------------------------------------------------------------


def test_the_expert_leads_and_its_first_action_is_learned():
    """A* around a wall: up before right, and the target in the view after three steps."""
    model = drawn(["......", ".@@@..", "S@..T."], view=(5, 5))
    found = lead(Scenes(model.blocked, model.starts, model.targets), Task((3, 6), (5, 5)))
    assert found.actions.tolist() == [0, 0, 3, 3, 3, 3, 1, 1]
    assert found.observed.seen.tolist() == [False] * 4 + [True] * 4
    assert found.observed.positions[:4].tolist() == [[2, 0], [1, 0], [0, 0], [0, 1]]
    assert found.steps.tolist() == list(range(8)) and found.take(
        found.steps == 7
    ).actions.tolist() == [1]


def trainer(name, seed):
    module, part = NETWORKS.get(name, (value_iteration, 2))
    asked = {key: one.default for key, one in find_training(name).options.items()}
    asked |= {"batch": 16, "batches": 8 if part < 2 else 40, "rate": 0.01}
    torch.manual_seed(seed)
    sizes = {key: SMALL.get(key, size) for key, size in module.ARCHITECTURE.items()}
    network = module.build_network(**sizes)
    course = Course(seed, 2, asked, draw_scene_arrays)
    return ImitationTrainer(course, name, network, sizes, part=part, recurrent=part < 2)


@pytest.mark.parametrize("name", [*NETWORKS, "mcgn-2"])
def test_training_lowers_the_loss_and_repeats_bit_for_bit(name):
    def learn(seed):
        learner = trainer(name, seed)
        learner.judge = lambda: {"score": 0.0}  # the weights do not depend on it
        before = elsewhere(learner)
        for epoch in range(3):
            figures = learner.run_epoch(epoch, lambda: None)
        return learner, before, figures

    def elsewhere(learner):
        """Return the loss in scenes outside the training data."""
        with torch.no_grad():
            return float(learner.loss(0, np.random.default_rng(99)))

    with one_thread():
        one, before, figures = learn(0)
        two, _, repeated = learn(0)
        assert elsewhere(one) < before - 0.02
    assert figures == repeated
    for key, weight in one.weights().arrays.items():
        assert np.isfinite(weight).all()
        np.testing.assert_array_equal(weight, two.weights().arrays[key])


def test_a_part_learns_from_its_own_steps():
    rng = np.random.default_rng(0)
    assert not trainer("mcgn-1", 0).draw(0, rng).observed.seen.any()
    assert trainer("mcgn-2", 0).draw(0, rng).observed.seen.all()


def test_perception_is_trained_in_three_stages():
    asked = {key: one.default for key, one in find_training("gmgn").options.items()}
    learner = find_training("gmgn").run(Course(0, 10, asked, draw_scene_arrays))
    free = {}
    for number in (0, 6, 7):
        learner.prepare(number, np.random.default_rng(0))
        named = learner.network.named_parameters()
        free[number] = {name.split(".")[0] for name, one in named if one.requires_grad}
    assert free == {0: {"enet"}, 6: {"ppn", "scale"}, 7: {"enet", "ppn", "scale"}}


# --- the networks -----------------------------------------------------------


@pytest.mark.parametrize("name", NETWORKS)
def test_sizes_are_those_of_the_paper(name):
    arrays = read_weights(shipped_weights(name), name).arrays
    shapes = {key.removeprefix("planner."): one.shape for key, one in arrays.items()}
    assert shapes["reading.weight"] == (150, 2, 3, 3) and shapes["pooling.weight"] == (1, 150, 1, 1)
    assert shapes["rewarding.weight"] == shapes["moving.weight"] == (4, 1, 3, 3)
    assert shapes["computer.controller.weight_ih"] == (1024, 2 * 17 * 17 + 4 * 8)
    assert shapes["computer.interface.weight"] == (4 * 8 + 3 * 8 + 5 * 4 + 3, 256)
    assert shapes["computer.output.weight"] == (4, 256 + 4 * 8)
    assert macn.First.ARCHITECTURE["iterations"] == 30
    assert value_iteration.ARCHITECTURE["iterations"] == 30
    assert shipped_weights(name).stat().st_size < 1_000_000


def test_sizes_beyond_the_canvas_are_refused():
    wide = draw_scenes(shape=(17, 18), scenes=1, view=(9, 9))
    for backend in POLICIES.values():
        assert "17 × 17" in backend().refuses(wide)
        with pytest.raises(CrosstrackError, match="17 × 17"):
            run(backend(), wide)


@pytest.fixture(scope="module")
def strange(tmp_path_factory):
    """Files of weights of a small network: at random, and so large that nothing is finite."""
    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(5)
    sizes = {**macn.ARCHITECTURE, **SMALL}
    arrays = arrays_of(macn.build_network(**sizes))
    rng = np.random.default_rng(5)
    files = {}
    for word, size in (("random", 1.0), ("diverged", 1e30)):
        values = {key: size * rng.normal(size=one.shape) for key, one in arrays.items()}
        files[word] = str(folder / f"{word}.npz")
        write_weights(files[word], Weights("macn", values, sizes))
    return files


@pytest.mark.parametrize("word", ["random", "diverged"])
def test_runs_of_strange_weights_end_and_replay(strange, word):
    model = draw_scenes("walls", shape=(9, 11), scenes=6, view=(5, 7), steps=25, seed=4)
    answer, again = (run(Macn(), model, weights=strange[word]) for _ in range(2))
    assert answer.point == again.point
    assert max(map(len, answer.point.actions)) <= 25
    assert model.verify(answer.point).ok
    assert ("decisions not finite" in answer.statistics) is (word == "diverged")


def test_weights_of_another_network_are_refused(strange):
    model = draw_scenes(shape=(9, 9), scenes=1, view=(5, 5))
    with pytest.raises(InvalidData, match="must hold the weights of mcgn-1"):
        run(Mcgn(), model, weights=strange["random"])


@pytest.mark.parametrize("name", POLICIES)
def test_shipped_weights_lead_to_most_targets(name):
    backend = POLICIES[name]
    model = draw_scenes("paper", obstacles=3, scenes=60, seed=11, view=(11, 11))
    answer = run(backend(), model)
    assert model.verify(answer.point).ok
    assert answer.point.success >= LEAST[name]
    assert answer.point == run(backend(), model).point
    blind = run(backend(), model, without="values").point
    assert blind.success < answer.point.success
    assert run(backend(), model, without="memory").point != answer.point


@pytest.mark.parametrize("scene", ["whole-view", "no-way-at-once", "one-row-blocked", "one-step"])
@pytest.mark.parametrize("name", POLICIES)
def test_wild_scenes_end(name, scene):
    model = WILD[scene]()
    plan = run(POLICIES[name](), model).point
    assert model.verify(plan).ok
    assert max(map(len, plan.actions)) <= model.steps


@pytest.mark.parametrize("name", POLICIES)
def test_decisions_depend_only_on_cells_seen(name):
    """Blocking all unseen cells does not change the actions."""
    backend, model = POLICIES[name](), draw_scenes(scenes=4, seed=8, view=(5, 5), uav="follow")
    plan = run(backend, model).point
    unseen = np.ones_like(model.blocked)
    for k, taken in enumerate(model.replays(plan)):
        for row, column in taken.positions:
            unseen[k, max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3] = False
    unseen[np.arange(4), model.targets[:, 0], model.targets[:, 1]] = False
    assert unseen.sum() > 200
    darker = replace(model, blocked=model.blocked | unseen)
    assert run(backend, darker).point == plan
