"""Scenes outside the law that a network was trained on."""

import dataclasses
import json

import numpy as np
import pytest
from unknown_grid.scenes import drawn, run, watch

from crosstrack.instances.unknown_grid import clutter, draw_scene_arrays, draw_scenes, maze
from crosstrack.models.unknown_grid.model import UnknownGridNavigation
from crosstrack.models.unknown_grid.scenes import TASKS
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.learning.weights import Weights, read_weights, write_weights
from crosstrack.solvers.unknown_grid import imitation
from crosstrack.solvers.unknown_grid.imitation import best_actions, first_of, shortest_ways
from crosstrack.solvers.unknown_grid.networks import shipped_weights
from crosstrack.solvers.unknown_grid.training_laws import (
    MEASURED,
    openness,
    outside_law,
    statement,
    wall_lengths,
)

LAWS = ("walls", "l-shapes", "u-traps", "rectangles", "mixed", "paper")


def seen_by_a_planner(model):
    """Return the cells that a planner has seen at the end of its runs."""
    known = np.full_like(model.blocked, -1, np.int8)

    def choose(observed, rows):
        known[rows] = observed.known
        ways = shortest_ways(observed.known == 1, observed.targets)
        return first_of(best_actions(ways, observed.positions))

    watch(model, choose)
    return known


def test_openness_by_hand():
    known = np.array([[[0, 0, -1], [0, 0, 1], [2, 0, 0]]])
    # Seen squares: top left, bottom left (with the target) and bottom right (with an obstacle).
    assert openness(known) == pytest.approx([2 / 3])
    assert openness(np.full((2, 4, 4), -1)).tolist() == [1.0, 1.0]
    assert openness(np.zeros((1, 1, 9))).tolist() == [1.0]
    corridors = maze(17, 17, 5)
    assert openness(corridors.blocked.astype(np.int8)).tolist() == [0.0]


def test_lengths_of_walls_by_hand():
    known = np.full((3, 6, 7), -1, np.int8)
    known[0] = 0
    known[0, 2, 1:6] = 1  # five cells; the third one has a neighbour
    known[0, 3, 3] = 1
    known[1, 1:3, :] = 1  # two cells thick
    known[2, :, 0] = 1  # along the edge of the map, and unseen beyond
    assert wall_lengths(known).tolist() == [2, 0, 6]
    assert wall_lengths(np.zeros((2, 1, 1), np.int8)).tolist() == [0, 0]
    assert wall_lengths(np.ones((1, 1, 9), np.int8)).tolist() == [9]


def test_long_thin_walls_are_outside_the_law_of_the_paper():
    for law, least in (("walls", 0.5), ("l-shapes", 0.3), ("u-traps", 0.2)):
        model = draw_scenes(law, obstacles=(2, 5), scenes=60, seed=12, view=(9, 9))
        known = [seen_by_a_planner(model)]
        outside, reason = outside_law(model, "paper", known)
        assert outside.mean() >= least and reason.startswith("walls longer than")
        assert outside_law(model, "paper, walls", known)[0].mean() <= 0.1


@pytest.mark.parametrize("law", LAWS)
def test_few_scenes_of_a_law_are_outside_it(law):
    wrong = []
    for task in TASKS:
        model = draw_scenes(
            law, shape=task.shape, view=task.view, obstacles=(2, 5), scenes=80, seed=317
        )
        outside, _ = outside_law(model, law, [seen_by_a_planner(model)])
        wrong.append(outside)
    assert np.mean(wrong) <= 0.05


def test_mazes_and_clutter_are_outside_every_law():
    for build in (
        lambda seed: maze(17, 17, seed, view=(9, 9), steps=40),
        lambda seed: clutter((17, 17), 0.5, seed, view=(11, 11), steps=40),
    ):
        models = [build(seed) for seed in range(15)]
        known = [seen_by_a_planner(model) for model in models]
        for law in LAWS:
            outside, reason = outside_law(models[0], law, known)
            assert np.mean(outside) >= 0.9 and "less open" in reason


def test_other_sizes_are_outside_and_unknown_laws_are_not_judged():
    open_map = [np.zeros((2, 17, 17), np.int8)]
    model = draw_scenes("paper", scenes=2, view=(9, 9))
    assert outside_law(model, "paper", open_map)[0].tolist() == [False, False]
    assert outside_law(model, "paper", open_map)[1] == ""
    narrow = dataclasses.replace(model, view=(5, 9))
    outside, reason = outside_law(narrow, "paper", open_map)
    assert outside.all() and reason == "view 5 × 9, trained with 9 × 9 or 11 × 11"
    dense = [np.ones((2, 17, 17), np.int8)]  # the rate of mazes applies, not that of open maps
    less_open = "maps less open than those of the training"
    assert outside_law(narrow, "paper", dense)[1] == f"{less_open}; {reason}"
    small = draw_scenes("paper", shape=(15, 17), scenes=2, view=(9, 9))
    assert outside_law(small, "paper", open_map)[1].startswith("shape 15 × 17")
    assert outside_law(model, "", open_map) == (None, "")
    assert outside_law(model, "walls,nowhere", open_map) == (None, "")
    # 30 single obstacles leave 136 of 256 squares open: fewer than walls do, but not than traps do.
    dense = np.zeros((2, 17, 17), np.int8)
    dense[:, 1:14:3, 1:12:2] = 1
    assert openness(dense).tolist() == [136 / 256] * 2
    assert outside_law(model, "walls", [dense])[0].all()
    assert not outside_law(model, "walls, u-traps", [dense])[0].any()


def test_a_statement_has_the_measured_rates_of_shipped_weights_only():
    assert statement(0, 9, "paper", "", "vin") == ""
    text = statement(2, 9, "paper", "maps less open")
    assert text.startswith("2 of 9 scenes lie outside the law this network was trained on (paper)")
    assert text.endswith("maps less open")
    rates = json.loads(MEASURED.read_text("utf-8"))["success"]
    assert set(rates) == {"small-vin", "vin", "macn", "mcgn"}
    for kind, shares in rates.items():
        for key in ("maps", "walls", "view", "shape"):
            if (kind, key) == ("small-vin", "walls"):  # it is trained on walls
                assert statement(2, 9, "walls", "walls longer", kind).endswith("walls longer")
                continue
            place, share = shares[key]
            longer = statement(2, 9, "paper", f"{key} of another kind", kind)
            end = f"; measured success: {share:.0f} % in {place}, {shares['inside']:.0f} % inside the law"
            assert longer.endswith(end)


def test_scenes_of_several_laws_are_drawn_in_equal_numbers():
    calls = []

    def examples(law, shape, obstacles, scenes, generator):
        calls.append((law, scenes))
        return draw_scene_arrays(law, shape, obstacles, scenes, generator)

    rng = np.random.default_rng(0)
    scenes = imitation.draw_scenes(examples, "walls, paper,mixed", (9, 9), (1, 2), 8, rng)
    assert calls == [("walls", 3), ("paper", 3), ("mixed", 2)] and scenes.blocked.shape == (8, 9, 9)
    calls.clear()
    assert len(imitation.draw_scenes(examples, "walls,paper", (9, 9), (1, 2), 1, rng).starts) == 1
    assert calls == [("walls", 1)]


@pytest.mark.parametrize("name", ["small-vin", "vin", "macn", "mcgn"])
def test_results_report_scenes_outside_the_law(name, tmp_path):
    pytest.importorskip("torch", reason="networks need PyTorch, which is an extra")
    backend = find_backend(name)
    mazes = [maze(17, 17, seed) for seed in range(3)]
    inside = draw_scenes("paper", obstacles=2, scenes=1, seed=4, view=(9, 9))
    fields = (
        np.concatenate([getattr(one, field) for one in (*mazes, inside)])
        for field in ("blocked", "starts", "targets")
    )
    model = UnknownGridNavigation(*fields, (17, 17), view=(9, 9), steps=40)
    answer = run(backend, model)
    assert answer.statistics["scenes outside the law"] == 3
    assert "3 of 4 scenes lie outside the law this network was trained on" in answer.message
    assert "; measured success: " in answer.message and " % in mazes, " in answer.message
    answer = run(backend, inside)
    assert answer.statistics["scenes outside the law"] == 0 and "law" not in answer.message
    narrow = run(backend, drawn(["S..", "..T"], view=(3, 3)))
    assert "1 of 1 scenes lie outside" in narrow.message and "shape 2 × 3" in narrow.message
    # Other weights have no measured success, and weights of an unknown origin no law.
    kind = "mcgn-1" if name == "mcgn" else name
    shipped = read_weights(shipped_weights(kind), kind)
    file = tmp_path / "other.npz"
    write_weights(file, shipped)
    other = run(backend, model, weights=str(file))
    assert "3 of 4 scenes" in other.message and "measured" not in other.message
    write_weights(file, Weights(kind, shipped.arrays, shipped.architecture))
    unknown = run(backend, model, weights=str(file))
    assert "scenes outside the law" not in unknown.statistics and "law" not in unknown.message
    assert unknown.point == other.point
