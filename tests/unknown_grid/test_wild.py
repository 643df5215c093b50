"""Every policy on scenes wilder than the paper's: it ends, it verifies, it replays, and none beats the truth."""

import dataclasses
import importlib
import math
from functools import cache

import numpy as np
import pytest
from unknown_grid.scenes import WILD, fewest, run
from unknown_grid.walks import show_noise

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances.unknown_grid import clutter
from crosstrack.models.unknown_grid import Hover, Outcome
from crosstrack.solvers import find_backend
from crosstrack.solvers.contract.selection import recommended
from crosstrack.solvers.learning.gradient import arrays_of
from crosstrack.solvers.learning.weights import Weights, write_weights
from crosstrack.solvers.unknown_grid import BACKENDS

LEARNED = ("small-vin", "vin", "macn", "mcgn")
CLASSICAL = tuple(name for name in BACKENDS if name not in (*LEARNED, "oracle"))


@cache
def scene(name, uav):
    """Return a wild model by one of the rules of the UAV, with the fewest steps in each scene."""
    model = dataclasses.replace(WILD[name](), uav=uav)
    every = zip(model.blocked.tolist(), model.starts.tolist(), model.targets.tolist(), strict=True)
    return model, [fewest(*one) for one in every]


def judge(model, least, plan):
    """Assert what holds for any policy: `least` are the fewest steps in each scene."""
    found = model.verify(plan)
    assert found.ok, found.summary()
    for steps, actions, outcome in zip(least, plan.actions, plan.outcomes, strict=True):
        assert len(actions) <= model.steps
        assert outcome is not Outcome.REACHED or len(actions) >= steps
        assert outcome is not Outcome.NO_WAY or steps == math.inf
        assert outcome is not Outcome.OUT_OF_STEPS or len(actions) == model.steps
    bound = [0 if s == math.inf else min(s, model.steps + 1) for s in least]
    assert found.objective >= np.mean(bound) - 1e-9
    return found.objective, float(np.mean(bound))


@pytest.mark.sample(2)
@pytest.mark.parametrize("uav", list(Hover))
@pytest.mark.parametrize("name", CLASSICAL)
def test_a_policy_ends_verifies_replays_and_never_beats_the_truth(name, uav):
    backend = find_backend(name)
    for wild in WILD:
        model, least = scene(wild, uav)
        first = run(backend, model)
        if uav is Hover.PAPER:
            assert run(backend, model).point == first.point, wild
        judge(model, least, first.point)
        assert model.score(first.point).collisions == first.statistics["collisions"]


@pytest.mark.parametrize("wild", WILD)
def test_the_reference_is_the_truth(wild):
    model, least = scene(wild, Hover.PAPER)
    answer = find_backend("oracle").run(model, ct.solvers.Request())
    cost, bound = judge(model, least, answer.point)
    assert cost == answer.dual_bound == pytest.approx(bound, abs=1e-9)
    assert model.score(answer.point).collisions == 0


@pytest.mark.parametrize("uav", list(Hover))
def test_enough_steps_yield_a_path_or_a_proof_of_none(uav):
    for wild in WILD:
        model, least = scene(wild, uav)
        model = dataclasses.replace(model, steps=10 * model.blocked[0].size)
        expected = [Outcome.NO_WAY if one == math.inf else Outcome.REACHED for one in least]
        assert run(find_backend("d-star-lite"), model).point.outcomes == tuple(expected), wild


def test_a_process_of_its_own_changes_nothing():
    model, least = scene("u-trap", Hover.PAPER)
    assert recommended(model).name == "d-star-lite"
    found = ct.solve(model)
    assert found.backend == "d-star-lite"
    assert found.plan == run(find_backend("d-star-lite"), model).point
    assert found.primal_bound == judge(model, least, found.plan)[0]
    assert found.dual_bound is None or found.dual_bound <= min(least)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.6])
@pytest.mark.parametrize("name", CLASSICAL)
def test_a_map_of_a_million_cells(name, share):
    # Where three of five are blocked no part is large, and no way is long.
    steps = 4000 if name == "d-star-lite" else 60
    model = clutter((1000, 1000), share, 3, uav="follow", steps=steps)
    backend, least = find_backend(name), model.fewest_steps().tolist()
    first, again = run(backend, model), run(backend, model)
    assert first.point == again.point
    judge(model, least, first.point)
    if name == "d-star-lite":
        assert first.point.outcomes == ("reached",)


# -- learned policies ----------------------------------------------------------------------------


@cache
def weights(name, factor):
    """Return the weights that a network is built with, each multiplied."""
    torch = pytest.importorskip("torch", reason="networks are PyTorch's")
    module = importlib.import_module(f"crosstrack.solvers.unknown_grid.{name.replace('-', '_')}")
    torch.manual_seed(0)
    network = module.build_network(**module.ARCHITECTURE)
    arrays = {key: factor * one for key, one in arrays_of(network).items()}
    return Weights(name, arrays, module.ARCHITECTURE)


def options(name, factor, folder):
    """Return the options of a run with such weights, none for what has no weights."""
    if name not in LEARNED:
        return {}
    write_weights(folder / "weights.npz", weights(name, factor))
    return {"weights": str(folder / "weights.npz")}


@pytest.mark.parametrize("factor", [1, -1e30], ids=["untrained", "diverged"])
@pytest.mark.parametrize("name", LEARNED)
def test_learned_policies_terminate_with_any_weights(name, factor, tmp_path):
    backend, own = find_backend(name), options(name, factor, tmp_path)
    for wild in ("clutter-no-way", "beside", "wide-view", "close-walls"):
        model, least = scene(wild, Hover.PAPER)
        model = dataclasses.replace(model, steps=min(model.steps, 8))
        if backend.refuses(model):
            with pytest.raises(UnsupportedFormulation, match=name):
                run(backend, model, **own)
            continue
        first, again = (run(backend, model, **own) for _ in range(2))
        assert first.point == again.point, wild
        judge(model, least, first.point)


@pytest.mark.parametrize("name", [*CLASSICAL, *LEARNED])
def test_images_of_noise_mislead_and_do_no_harm(name, monkeypatch, tmp_path):
    pytest.importorskip("crosstrack.solvers.unknown_grid.perception", reason="it reads the images")
    show_noise(monkeypatch)
    backend, own = find_backend(name), options(name, 1, tmp_path)
    for wild in ("beside", "one-row", "one-row-blocked", "u-trap", "clutter-no-way"):
        model, least = scene(wild, Hover.FOLLOW)
        model = dataclasses.replace(model, camera={"seed": 7}, steps=min(model.steps, 12))
        first, again = (run(backend, model, **own) for _ in range(2))
        assert first.point == again.point, wild
        judge(model, least, first.point)
