"""The trainer of all networks: same seed, same weights, also after an interruption."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="networks are trained with PyTorch")

from crosstrack.errors import InvalidData, UnsupportedOption  # noqa: E402
from crosstrack.instances.unknown_grid import draw_scene_arrays  # noqa: E402
from crosstrack.solvers.learning.trainer import Course  # noqa: E402
from crosstrack.solvers.learning.training import checkpoint_path, find_training, train  # noqa: E402
from crosstrack.solvers.learning.weights import read_arrays, read_weights, write_arrays  # noqa: E402
from crosstrack.solvers.unknown_grid import TRAININGS, episodes, gmgn, macn, value_iteration  # noqa: E402

#: Options of a training of a second, as far as a training has them.
TINY = {"scenes": 2, "batches": 2, "batch": 3, "judged": 1, "rate": 0.01, "images": 2}
#: Sizes of small networks.
SMALL = {"hidden": 3, "iterations": 4, "units": 8, "words": 4, "width": 3, "heads": 1}


@pytest.fixture
def small(monkeypatch):
    """Replace sizes of networks, and the constants of the perception's training, by small ones."""
    for module in (value_iteration, macn, macn.First):
        sizes = {key: SMALL.get(key, size) for key, size in module.ARCHITECTURE.items()}
        monkeypatch.setattr(module, "ARCHITECTURE", sizes)
    monkeypatch.setattr(gmgn, "ARCHITECTURE", {"channels": 16, "inner": 16, "cells": 4})
    for name, value in (("VIEWS", {(3, 3): 1}), ("_SCENES", 2), ("_JUDGED", 1)):
        monkeypatch.setattr(gmgn, name, value)


@pytest.mark.parametrize("name", TRAININGS)
def test_a_resumed_training_ends_with_the_same_weights(name, small, tmp_path):
    options = {key: size for key, size in TINY.items() if key in find_training(name).options}
    asked = {"examples": draw_scene_arrays, "epochs": 2, "options": options}
    whole, parts, other = (tmp_path / f"{word}.npz" for word in ("whole", "parts", "other"))

    def stop(epoch):
        raise KeyboardInterrupt

    assert train(name, whole, **asked).ended == "finished"
    assert train(name, parts, on_progress=stop, **asked).ended == "interrupted"
    resumed = train(name, parts, resume=True, **asked)
    assert resumed.epochs == 2 and len(resumed.figures) == 1
    one, two = (read_weights(path, name) for path in (whole, parts))
    assert one.made == two.made
    for key, array in one.arrays.items():
        np.testing.assert_array_equal(array, two.arrays[key])
    train(name, other, seed=1, **asked)
    elsewhere = read_weights(other, name).arrays
    assert any((array != elsewhere[key]).any() for key, array in one.arrays.items())
    with pytest.raises(InvalidData, match="seed must be 1, got 0"):
        train(name, parts, seed=1, resume=True, **asked)


PAPER = [name for name in TRAININGS if "workers" in find_training(name).options]


def tiny_trainer(name, **options):
    training = find_training(name)
    chosen = training.checked_options({"batches": 2, "batch": 3, "judged": 1, **options})
    return training.run(Course(0, 3, chosen, draw_scene_arrays))


@pytest.mark.parametrize("name", PAPER)
def test_a_padded_batch_has_the_same_gradient(name, small):
    learner, generator = tiny_trainer(name), np.random.default_rng(5)
    learner._batches = [learner.draw(batch, generator) for batch in range(3)]
    for batch, drawn in enumerate(learner._batches):
        loss = learner.gradient(batch, generator)
        grads = [parameter.grad.clone() for parameter in learner.network.parameters()]
        arrays = learner.pad(drawn)
        assert len(arrays[0]) % 12 == 0 if learner.recurrent else len(arrays[0]) == 3
        padded = learner._replay(*arrays)
        np.testing.assert_allclose(padded.item(), loss.item(), rtol=1e-6)
        for parameter, grad in zip(learner.network.parameters(), grads, strict=True):
            np.testing.assert_allclose(parameter.grad, grad, atol=1e-3 * grad.abs().max().item())


def test_a_batch_that_fails_restores_the_iteration(small):
    learner = tiny_trainer("mcgn-2")
    learner.device, learner._iterate = SimpleNamespace(type="cuda"), object()
    iterations = []

    def fail(*arrays):
        iterations.append(learner.network.planner.iterate)
        raise MemoryError

    learner._replay = fail
    with pytest.raises(MemoryError):
        learner.gradient(0, np.random.default_rng(0))
    assert iterations == [learner._iterate]
    assert learner.network.planner.iterate is value_iteration.iterate


class Threads(ThreadPoolExecutor):
    """Threads in the place of processes."""

    def __init__(self, count, *_):
        super().__init__(count)
        self.ended = []
        self._processes = {1: SimpleNamespace(terminate=lambda: self.ended.append(1))}


@pytest.mark.parametrize("name", ["macn", "mcgn-2"])
def test_batches_of_workers_are_those_of_the_process(name, small, monkeypatch):
    plain, ahead = tiny_trainer(name), tiny_trainer(name, workers=2)
    pickle.loads(pickle.dumps(ahead.course))
    monkeypatch.setattr(episodes, "ProcessPoolExecutor", Threads)
    for number in (0, 1, 2):
        measures = [learner.run_epoch(number, lambda: None) for learner in (plain, ahead)]
        assert str(measures[0]) == str(measures[1])
    ahead.close()
    assert ahead._queue._workers.ended == [1]
    for one, two in zip(plain.network.parameters(), ahead.network.parameters(), strict=True):
        assert torch.equal(one, two)


def test_examples_that_a_worker_cannot_import_are_refused(small, tmp_path):
    with pytest.raises(InvalidData, match=r"examples must be a function of a module.*workers=0"):
        train("vin", tmp_path / "none.npz", examples=lambda *_: None, options={"workers": 1})


@pytest.mark.parametrize("newer", [{}, {"device": "cpu", "workers": 4}])
def test_a_checkpoint_without_newer_options_or_with_other_workers_continues(newer, small, tmp_path):
    path = tmp_path / "old.npz"
    options = {"batches": 1, "batch": 2, "judged": 1}
    how = {"examples": draw_scene_arrays, "epochs": 2, "options": options}

    def stop(epoch):
        raise KeyboardInterrupt

    train("vin", path, on_progress=stop, **how)
    arrays, about = read_arrays(checkpoint_path(path))
    del about["checkpoint"]["device"], about["checkpoint"]["workers"]
    about["checkpoint"].update(newer)
    write_arrays(checkpoint_path(path), arrays, about)
    assert train("vin", path, resume=True, **how).epochs == 2


@pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is present")
@pytest.mark.parametrize("name", ["small-vin", "macn"])
def test_a_missing_gpu_is_named(name, small):
    with pytest.raises(UnsupportedOption, match="device='gpu' needs a CUDA device"):
        tiny_trainer(name, device="gpu")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("name", PAPER)
def test_the_gpu_has_the_gradient_of_the_processor(name, small):
    here, there = tiny_trainer(name), tiny_trainer(name, device="gpu")
    here._batches = there._batches = [here.draw(0, np.random.default_rng(0))]
    losses = [learner.gradient(0, None) for learner in (here, there)]
    np.testing.assert_allclose(losses[1].item(), losses[0].item(), rtol=1e-4)
    pairs = zip(here.network.parameters(), there.network.parameters(), strict=True)
    for one, two in pairs:
        scale = one.grad.abs().max().item()
        np.testing.assert_allclose(two.grad.cpu(), one.grad, atol=1e-3 * scale)


@pytest.mark.parametrize("name", ["small-vin", "vin", "macn"])
def test_a_training_draws_from_several_laws(name, small, tmp_path):
    laws = []

    def examples(law, shape, obstacles, scenes, generator):
        laws.append((law, scenes))
        return draw_scene_arrays(law, shape, obstacles, scenes, generator)

    options = {key: size for key, size in TINY.items() if key in find_training(name).options}
    options |= {"law": "walls, u-traps", "judged": 3}
    train(name, tmp_path / "few.npz", examples=examples, epochs=1, options=options)
    assert {law for law, _ in laws} == {"walls", "u-traps"}
    # Three validation scenes: two of the first law, one of the second.
    assert laws[-2:] == [("walls", 2), ("u-traps", 1)]
    assert read_weights(tmp_path / "few.npz", name).made["law"] == "walls, u-traps"
    options["law"] = "walls,nowhere"
    with pytest.raises(InvalidData, match="nowhere"):
        train(name, tmp_path / "few.npz", examples=draw_scene_arrays, options=options)
