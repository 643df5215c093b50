"""Instances of unknown grids: laws, extreme scenes and the catalogue."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from unknown_grid.scenes import WILD, fewest, models, run

from crosstrack.errors import InvalidData
from crosstrack.instances import Provenance, entries
from crosstrack.instances.unknown_grid import (
    SceneLaw,
    clutter,
    draw_scene_arrays,
    draw_scenes,
    enclosed,
    maze,
    spiral,
    training_generator,
)
from crosstrack.instances.unknown_grid.paper import PAPER
from crosstrack.models.unknown_grid import scenes as tasks
from crosstrack.solvers.unknown_grid.baselines import BaselineOne, BaselineTwo
from crosstrack.solvers.unknown_grid.replanning import DStarLite

#: First digits of the SHA-256 of three scenes of each law.
FINGERPRINTS = {
    "walls": "31a61d0ccdea",
    "l-shapes": "2260e53db0a9",
    "u-traps": "f928fd1ad3c9",
    "rectangles": "58e1b8cccaf5",
    "mixed": "e7bc78afe809",
    "paper": "0efc5302e6ba",
}

# -- the laws ------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", list(SceneLaw)[:-1])
@pytest.mark.parametrize(("shape", "clear"), [((17, 17), 5), ((9, 21), 3), ((4, 5), 1)])
def test_scenes_of_a_law(law, shape, clear):
    rows, columns = shape
    model = draw_scenes(law, shape=shape, obstacles=2, scenes=40, seed=1, view=(3, 3))
    assert model.blocked.shape == (40, rows, columns)
    assert model.blocked.any(axis=(1, 2)).all()
    apart = np.abs(model.starts - model.targets).sum(axis=1)
    assert (2 * apart >= rows + columns).all()
    for one, start, target in zip(model.blocked, model.starts, model.targets, strict=True):
        assert np.isfinite(fewest(one, start, target))
        row, column = target
        ground = one[max(row - clear, 0) : row + clear + 1, max(column - clear, 0) :]
        assert not ground[:, : column + clear + 1 - max(column - clear, 0)].any()
    # The minimum distance equals the limit of the law.
    near = [
        np.abs(np.argwhere(one) - target).max(axis=1).min()
        for one, target in zip(model.blocked, model.targets, strict=True)
    ]
    assert min(near) == clear + 1


def test_scenes_of_the_paper():
    """Blocks have different sizes, start and target are arbitrary, and a path exists."""
    model = draw_scenes("paper", obstacles=3, scenes=60, seed=1)
    apart = np.abs(model.starts - model.targets).sum(axis=1)
    assert apart.min() <= 4 and apart.max() > 20
    assert np.isfinite(model.fewest_steps()).all()
    blocks = list(_one("paper"))
    sizes = {one.shape for one in blocks}
    assert all(one.all() for one in blocks)
    assert {side for size in sizes for side in size} == {1, 2, 3, 4, 5} and (1, 5) in sizes


def _one(law, shape=(17, 17)):
    """Return single obstacles, cut out of their maps."""
    found = draw_scene_arrays(law, shape, 1, 300, training_generator(2))
    for blocked in found.blocked:
        rows, columns = np.nonzero(blocked)
        yield blocked[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def test_forms_of_obstacles():
    walls = [one.shape for one in _one("walls")]
    assert {min(one) for one in walls} == {1}
    assert {max(one) for one in walls} == set(range(5, 13))
    assert 100 < sum(one[0] == 1 for one in walls) < 200
    assert {max(one) for one in (two.shape for two in _one("walls", (15, 15)))} == set(range(4, 12))
    for law, cells in (("l-shapes", (1, 1)), ("u-traps", (2, 1))):
        turned = set()
        for one in _one(law):
            assert all(5 <= side <= 8 for side in one.shape)
            full = one.all(axis=1).sum(), one.all(axis=0).sum()
            assert sorted(full) == sorted(cells)
            turned.add((*full, bool(one[0].all()), bool(one[:, 0].all())))
            rest = one.size - one.sum()
            lines = np.subtract(one.shape, full)
            assert rest == lines.prod()
        assert len(turned) == 4
    blocks = list(_one("rectangles"))
    assert all(one.all() for one in blocks)
    assert {side for one in blocks for side in one.shape} == {3, 4, 5}
    mixed = [one.mean() if 1 not in one.shape else 0.0 for one in _one("mixed")]
    assert 30 < mixed.count(0.0) < 120 and 30 < mixed.count(1.0) < 120


def test_seeds_of_scenes():
    one = draw_scenes(obstacles=4, scenes=6, seed=7)
    more = draw_scenes("walls", obstacles=(4, 4), scenes=9, seed=7)
    assert np.array_equal(one.blocked, more.blocked[:6])
    assert np.array_equal(one.starts, more.starts[:6])
    assert one.digest == draw_scenes(obstacles=4, scenes=6, seed=7).digest
    assert len({maps.tobytes() for maps in more.blocked}) == 9
    others = [
        draw_scenes(obstacles=4, scenes=6, seed=8),
        draw_scenes(obstacles=3, scenes=6, seed=7),
        draw_scenes("mixed", obstacles=4, scenes=6, seed=7),
        draw_scenes(obstacles=4, scenes=6, seed=7, clear=4),
    ]
    assert all(not np.array_equal(one.starts, other.starts) for other in others)
    drawn = draw_scene_arrays("walls", (17, 17), 4, 6, training_generator(7))
    again = draw_scene_arrays("walls", (17, 17), 4, 6, training_generator(7))
    assert np.array_equal(drawn.blocked, again.blocked)
    assert not np.array_equal(drawn.starts, one.starts)
    several = draw_scene_arrays("walls", (17, 17), (0, 2), 60, training_generator())
    empty = ~several.blocked.any(axis=(1, 2))
    assert 5 < empty.sum() < 40


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"law": "hedges"}, "law must be one of walls, l-shapes"),
        ({"shape": (17,)}, "shape must have"),
        ({"shape": (1, 2)}, "sum is >= 4"),
        ({"obstacles": -1}, "obstacles"),
        ({"obstacles": (3, 2)}, "must rise"),
        ({"shape": (2, 2), "obstacles": 1, "view": (1, 3)}, "must leave room for a way"),
        ({"scenes": 0}, "scenes must be"),
        ({"seed": -1}, "seed must be"),
        ({"clear": -1}, "clear must be"),
        ({"view": (4, 4)}, "odd"),
    ],
)
def test_laws_refuse(asked, message):
    with pytest.raises(InvalidData, match=message):
        draw_scenes(**{"scenes": 2, **asked})


def test_training_refuses():
    with pytest.raises(InvalidData, match="seed"):
        training_generator(2**32)
    with pytest.raises(InvalidData, match="generator"):
        draw_scene_arrays("walls", (17, 17), 2, 1, 5)


# -- wilder ones ---------------------------------------------------------------------------------


def test_mazes_and_spirals():
    model = maze(17, 23, 4)
    cells = ~model.blocked[0]
    steps = (cells[1:] & cells[:-1]).sum() + (cells[:, 1:] & cells[:, :-1]).sum()
    assert steps == cells.sum() - 1  # a tree
    assert model.digest != maze(17, 23, 5).digest
    assert model.steps == 17 * 23 and maze(steps=5).steps == 5
    for size in (5, 6, 7, 8, 13):
        winding = spiral(size, view=(3, 3))
        free = ~winding.blocked[0]
        assert winding.fewest_steps()[0] == free.sum() - 1
        joined = (free[1:] & free[:-1]).sum() + (free[:, 1:] & free[:, :-1]).sum()
        assert joined == free.sum() - 1
        assert np.abs(winding.targets[0] - (size - 1) / 2).max() <= 1.5


@pytest.mark.parametrize("shape", [(8, 8), (7, 19)])
@pytest.mark.parametrize("share", [0.4, 0.5, 0.6])
def test_clutter(shape, share):
    for seed in range(5):
        for way in (True, False):
            model = clutter(shape, share, seed, way=way, view=(3, 3))
            assert model.blocked.sum() == round(share * shape[0] * shape[1])
            assert np.isfinite(model.fewest_steps()[0]) == way


def test_enclosed():
    for shape, distance in (((17, 17), 2), ((9, 12), 3), ((4, 4), 1)):
        model = enclosed(shape, distance, view=(3, 3))
        assert fewest(model.blocked[0], model.starts[0], model.targets[0]) == np.inf
        assert model.blocked.sum() == 8 * distance


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: maze(2, 9), "rows"),
        (lambda: spiral(4), "size"),
        (lambda: clutter((5, 5), 1.0), "share must leave cells"),
        (lambda: clutter((5, 5), 0.0, way=False), "share must leave cells"),
        (lambda: clutter((5, 5), 1.5), "share"),
        (lambda: enclosed((5, 5), 2), "shape"),
        (lambda: enclosed((5, 5), 0), "distance"),
    ],
)
def test_wild_scenes_refuse(make, message):
    with pytest.raises(InvalidData, match=message):
        make()


@pytest.mark.parametrize("name", WILD)
def test_helper_scenes(name):
    model = WILD[name]()
    for k, steps in enumerate(model.fewest_steps()):
        assert steps == fewest(model.blocked[k], model.starts[k], model.targets[k])


@settings(max_examples=40, deadline=None)
@given(models(scenes=2))
def test_drawn_models_are_models(model):
    assert type(model).from_data(model.data()).digest == model.digest


# -- the catalogue -------------------------------------------------------------------------------

OURS = {one.name.partition("/")[2]: one for one in entries() if one.model == "unknown-grid"}
TASKS = [f"task-{task}-{obstacles}" for task in (1, 2, 3) for obstacles in (2, 3, 4, 5)]


def test_the_papers_figures():
    """The text states 14 points between the methods of Table VI, and three observation ratios."""
    rows = PAPER.table("table-6").rows
    means = {name: np.mean([rows[task, name] for task in "123"]) for name in ("MACN", "MCGN")}
    assert round(means["MCGN"] - means["MACN"]) == 14
    # The paper has 0.65, 0.53 and 0.6.
    assert [round(task.ratio, 2) for task in tasks.TASKS] == [0.65, 0.53, 0.6]


def test_the_papers_tasks():
    assert set(TASKS) <= set(OURS)
    found = [OURS[name] for name in TASKS]
    assert {one.provenance for one in found} == {Provenance.SEEDED}
    models = [one.builder(scenes=40) for one in found]
    for task, (side, view) in enumerate(((17, 11), (17, 9), (15, 9))):
        for model in models[4 * task : 4 * task + 4]:
            assert model.blocked.shape == (40, side, side)
            assert model.view.tolist() == [view, view]
            assert (model.steps, model.uav) == (40, "paper")
    assert OURS["task-3-2"].build().scenes == 400
    # Tasks 1 and 2 differ in the view alone.
    assert all(np.array_equal(models[k].blocked, models[4 + k].blocked) for k in range(4))
    blocked = [model.blocked.mean() for model in models]
    assert blocked[:4] == sorted(blocked[:4])
    assert blocked[8:] == sorted(blocked[8:])


def test_other_entries():
    assert len(OURS) == len(TASKS) + 24
    built = {name: one.build() for name, one in OURS.items() if name not in TASKS}
    for name, one in built.items():
        way = name not in ("no-way", "clutter")
        assert np.isfinite(one.fewest_steps()).all() == way
        assert OURS[name].published == {}
        by_formula = name in ("no-way", "spiral", "u-trap", "crossing")
        assert OURS[name].provenance == (Provenance.OURS if by_formula else Provenance.SEEDED)
    assert built["large"].blocked.shape == (1, 1000, 1000)
    assert built["follow"].uav == "follow"
    assert np.array_equal(built["follow"].blocked, built["close-walls"].blocked)
    assert (built["whole-view"].view >= 2 * built["whole-view"].shape - 1).all()
    plain, hard = built["camera-plain"], built["camera-hard"]
    assert (plain.camera.rendering, hard.camera.rendering) == ("plain", "hard")
    assert np.array_equal(plain.blocked, hard.blocked)
    # The pocket is deeper than half the view, so a straight move enters it.
    assert "RRRRRR" in run(DStarLite(), built["u-trap"]).point.actions[0]


def test_scenes_never_change():
    # A change of NumPy's streams or of the laws would show here; trained weights depend on them.
    found = {}
    for law in SceneLaw:
        model = draw_scenes(law, obstacles=3, scenes=3, seed=1)
        held = np.concatenate([one.ravel() for one in (model.blocked, model.starts, model.targets)])
        found[law] = hashlib.sha256(held.astype(np.int8).tobytes()).hexdigest()[:12]
    assert found == FINGERPRINTS


@pytest.mark.parametrize("scenes", [12, pytest.param(400, marks=pytest.mark.slow)])
def test_the_walls_law_matches_its_definition(scenes):
    found = {DStarLite: [], BaselineOne: [], BaselineTwo: []}
    for name in TASKS:
        model = OURS[name].builder(scenes=scenes)  # the first of its 400
        for backend, scores in found.items():
            scores.append(model.score(run(backend(), model).point))
    successes = {
        backend: np.reshape([100 * one.reached / scenes for one in scores], (3, 4))
        for backend, scores in found.items()
    }
    # Requirement: at least 94 %, no collision, paths at most 10 % longer than the shortest.
    assert successes[DStarLite].mean() >= 94
    assert sum(one.collisions for one in found[DStarLite]) == 0
    assert np.mean([one.ratio for one in found[DStarLite]]) <= 1.10
    # The paper's MACN has 60 to 84, on average 70; it falls with the number of obstacles.
    for one in (BaselineOne, BaselineTwo):
        assert 65 <= successes[one].mean() <= 80
        assert successes[one][:, 0].mean() > successes[one][:, -1].mean()
