"""The trainer of all networks: same seed, same weights, also after an interruption."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="networks are trained with PyTorch")

from crosstrack.errors import InvalidData
from crosstrack.instances.unknown_grid import draw_scene_arrays
from crosstrack.solvers.learning.training import find_training, train
from crosstrack.solvers.learning.weights import read_weights
from crosstrack.solvers.unknown_grid import TRAININGS, gmgn, macn, value_iteration

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
