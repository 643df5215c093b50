"""Pictures of paths on maps."""

import itertools

import numpy as np
import pytest
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances.grid_path import maze, random_polygons
from crosstrack.models.grid_path import GridMap, GridPath, GridPlan
from crosstrack.models.grid_path.plot import draw, draw_progress

LINES = ["....", ".@@.", "...."]
AROUND = [[0.5, 0.5], [1.5, 0.5], [2.5, 0.5], [3.5, 0.5], [3.5, 1.5], [3.5, 2.5]]


def posed(start=(0, 0), goals=(2, 3), lines=LINES, **options):
    held = {"map": {"blocked": lines}, "start": start, "goals": goals, **options}
    return GridPath.from_data(held, name="four")


def picture(axes):
    (image,) = axes.images
    return image


def rings(figure):
    found = artists(figure.axes[0], "worst violation")
    return found[0].get_offsets().tolist() if found else []


def test_draws_all_elements(tmp_path):
    model = posed()
    plan = GridPlan([AROUND])
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "path.png", dpi=40)
    (axes,) = figure.axes
    assert axes.get_aspect() == 1
    image = picture(axes)
    assert image.get_array().tolist() == model.map.blocked.tolist()
    assert image.get_extent() == [0, 4, 0, 3]
    (line,) = artists(axes, "path")
    assert line.get_xydata().tolist() == AROUND
    (start,), (goal,) = artists(axes, "start"), artists(axes, "goal")
    assert (start.get_offsets().tolist(), goal.get_offsets().tolist()) == (
        [[0.5, 0.5]],
        [[3.5, 2.5]],
    )
    low, high = sorted(axes.get_xlim())
    assert low < 0 < 4 < high
    assert legend(figure) == ["start", "goal", "blocked", "path"]
    assert "four  ·  3 × 4 cells, 17% blocked, 8 neighbours, 5 m" in words(figure)
    assert not rings(figure)
    assert "mine" in words(ct.plot(model, plan, title="mine"))
    assert ct.plot(model, plan, size=(5, 4)).get_size_inches().tolist() == [5, 4]


def test_text_is_drawn_from_the_top_and_a_terrain_from_the_foot():
    """The image of a cell lies where the cell is, whichever way y is drawn."""
    for upward in (False, True):
        grid = GridMap(["..", "@.", ".."], 2.0, (10.0, 20.0), upward)
        figure = render(ct.plot(GridPath(grid, np.array([0, 0]), np.array([2, 0]))))
        (axes,) = figure.axes
        assert axes.yaxis_inverted() != upward
        image = picture(axes)
        assert (image.origin, image.get_extent()) == ("lower", [10, 14, 20, 26])
        assert image.get_array()[1, 0] == 1
        canvas = figure.canvas
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
        for cell in ((0, 0), (1, 0), (1, 1), (2, 1)):
            # Beside the middle, where the ends are marked.
            column, row = axes.transData.transform(grid.centres(cell) + 0.7).astype(int)
            dark = pixels[len(pixels) - row, column].max() < 100
            assert dark == grid.blocked[cell]


def test_weights_are_shades():
    weights = np.array([[1, 2, 3, 4], [1, 1e9, 1e9, 1], [1, 1, 1, 2.0]])
    figure = render(ct.plot(posed(weights=weights)))
    axes, bar = figure.axes
    shown = picture(axes).get_array()
    assert np.array_equal(shown.mask, [[letter == "@" for letter in line] for line in LINES])
    assert picture(axes).get_clim() == (1, 4), "blocked cells cost nothing"
    assert bar.get_ylabel() == "cost of a metre (–)"
    steep = weights.copy()
    steep[0, 0] = 1e-3
    (_, bar) = render(ct.plot(posed(weights=steep))).axes
    assert bar.get_yscale() == "log"
    assert "0.1" in [text.get_text() for text in bar.get_yticklabels()]
    plan = GridPlan([AROUND])
    found = ct.verify(posed(weights=weights), plan)
    assert any(
        f"{found.objective:g} m" in text for text in words(ct.plot(posed(weights=weights), plan))
    )


def test_several_plans_and_obstacles():
    model = posed(goals=[(2, 3), (2, 0)], connectivity="any", reach="nearest")
    straight = GridPlan([[[0.5, 0.5], [3, 1], [3.5, 2.5]]])
    steps = GridPlan([AROUND])
    through = {"paths": [[[0.5, 0.5], [3.5, 2.5]]]}
    figure = ct.plot(
        model, straight, others={"steps": steps, "through": through},
        obstacles=[{"shell": [(1, 1), (3, 1), (3, 2), (1, 2)], "holes": [[(1.5, 1.5), (2, 1.5), (2, 1.7)]]}],
    )  # fmt: skip
    (axes,) = figure.axes
    assert legend(figure) == [
        "start", "goals", "blocked", "obstacle", f"path, {straight.length:.6g} m", "steps, 5 m",
        "through, 3.60555 m, NOT VALID",
    ]  # fmt: skip
    lines = [*artists(axes, "path"), *artists(axes, "other path")]
    assert len({line.get_color() for line in lines}) == len(lines) == 3
    (polygon,) = artists(axes, "obstacle")[0].get_paths()
    shell, hole = ({tuple(place) for place in ring} for ring in polygon.to_polygons())
    assert shell == {(1, 1), (3, 1), (3, 2), (1, 2)}
    assert hole == {(1.5, 1.5), (2, 1.5), (2, 1.7)}
    corners = sorted(map(tuple, np.vstack([one.get_offsets() for one in artists(axes, "corner")])))
    assert corners == [(3, 1), (3.5, 0.5)], "points on a straight line are no corners"
    assert not rings(figure), "other plans may be wrong"
    alone = ct.plot(model, others={"steps": steps})
    assert "steps, 5 m" in legend(alone)
    assert not artists(alone.axes[0], "path")


@pytest.mark.parametrize(
    ("path", "broken", "near"),
    [
        ([[0.5, 0.5], [3.5, 2.5]], "keeps to free cells", [2, 1.5]),
        ([[1.5, 0.5], *AROUND[2:]], "starts at its cell", [1.5, 0.5]),
        (AROUND[:-1], "ends at its goal", [3.5, 1.5]),
        ([*AROUND[:2], [2.5, 0.75], *AROUND[3:]], "points at centres", [2.5, 0.75]),
        ([*AROUND[:1], *AROUND[2:]], "steps to neighbours", [1.5, 0.5]),
        ([*AROUND, [1e300, -1e300], AROUND[-1]], "keeps to free cells", None),
    ],
)  # fmt: skip
def test_rings_mark_violations(path, broken, near):
    model = posed()
    figure = render(ct.plot(model, GridPlan([path])))
    (axes,) = figure.axes
    assert any("NOT VALID" in text and broken in text for text in words(figure))
    assert "worst violation" in legend(figure)
    found = rings(figure)
    assert found
    if near is not None:
        assert min(np.hypot(*(np.array(one) - near)) for one in found) < 0.35
    assert all(np.isfinite(axes.get_xlim())) and np.ptp(axes.get_xlim()) < 20


def test_a_path_between_cells_that_touch_is_ringed_at_their_corner():
    model = posed((0, 0), (1, 1), [".@", "@."], connectivity="any")
    assert rings(ct.plot(model, GridPlan([[[0.5, 0.5], [1.5, 1.5]]]))) == [[1, 1]]


def test_pictures_of_every_size(tmp_path):
    wide = posed((0, 0), (0, 399), ["." * 400])
    high = posed((0, 0), (399, 0), ["."] * 400)
    cells = [model.map.blocked.size for model in (wide, high)]
    for model in (wide, high, GridPath(maze(201, 301, 1), np.array([1, 1]), np.array([199, 299]))):
        figure = ct.plot(model)
        figure.savefig(tmp_path / "a.png", dpi=30)
        assert (np.array(figure.get_size_inches()) < 8).all()
    assert cells == [400, 400]
    for cell in (1e-9, 1e6, 1e200):
        grid = GridMap([".."], cell, (3 * cell, -5 * cell))
        figure = render(ct.plot(GridPath(grid, np.array([0, 0]), np.array([0, 1]))))
        assert all(np.isfinite(figure.axes[0].get_xlim()))
    alone = posed((1, 1), (1, 1), ["@@@", "@.@", "@@@"])
    assert rings(ct.plot(alone, GridPlan([[[1.5, 1.5]]]))) == []
    steep = posed(weights=np.geomspace(1e-300, 1e300, 12).reshape(3, 4))
    ct.plot(steep).savefig(tmp_path / "a.png", dpi=30)


def test_walls_of_one_cell_are_seen_in_large_maps():
    """A wall that is thinner than a pixel leaves a shade, and is not left out."""
    blocked = np.zeros((1000, 1000), bool)
    blocked[:, 500] = True
    grid = GridMap(blocked)
    figure = ct.plot(GridPath(grid, np.array([0, 0]), np.array([999, 499])), size=(4, 4))
    figure.set_dpi(80)
    figure.canvas.draw()
    axes = figure.axes[0]
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., 0].astype(int)
    column, row = axes.transData.transform((500.5, 300)).astype(int)
    line = pixels[len(pixels) - row, column - 5 : column + 6]
    assert line.min() < 250 < line.max()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"others": 3}, "others must be at most 12 plans by their names, got 3"),
        ({"others": {3: GridPlan([AROUND])}}, "others must be"),
        ({"others": dict(zip(map(str, range(13)), itertools.repeat(None), strict=False))}, "others"),
        ({"size": (0, 3)}, "size must be"),
        ({"tolerance": 0}, "tolerance must be"),
        ({"labels": True}, "has no option 'labels'"),
    ],
)  # fmt: skip
def test_options_that_are_refused(options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(posed(), **options)


def test_rejects_invalid_options():
    with pytest.raises(InvalidData, match="plan must be a GridPlan"):
        draw(posed(), [AROUND])
    with pytest.raises(InvalidData, match="there is no plan"):
        ct.plot(posed(), others={"a": None})
    with pytest.raises(InvalidData, match=r"obstacles\[0\] must have at least 3 different points"):
        ct.plot(posed(), obstacles=[[(0, 0)]])
    assert callable(draw_progress)


def test_the_polygons_of_a_map_lie_within_its_blocked_cells():
    polygons = random_polygons(9, 4, (0, 0, 40, 40))
    grid = GridMap.from_polygons(polygons, (0, 0, 40, 40), 1)
    model = GridPath(grid, *np.argwhere(~grid.blocked)[[0, -1]])
    (axes,) = ct.plot(model, obstacles=polygons).axes
    for path in artists(axes, "obstacle")[0].get_paths():
        assert grid.blocked[tuple(grid.cells_of(path.vertices.mean(axis=0)))]
