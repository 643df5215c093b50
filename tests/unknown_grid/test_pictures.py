"""Plots of runs on unknown grids: agreement with the simulator and the plan."""

import numpy as np
import pytest
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns, World
from crosstrack.models.unknown_grid.plot import animate_run
from crosstrack.models.unknown_grid.sight import first_seen, uav_cells
from crosstrack.solvers import Control, Request
from crosstrack.solvers.unknown_grid.oracle import Oracle

TRAP = """\
............
..#######...
........#...
..S.....#.T.
........#...
..#######...
............"""
#: Actions into the trap, against its wall, out, against its roof, and to the target.
WALK = "RRRRRR" + "LLLLLL" + "UUU" + "R" + "D" + "RRRRRRRR" + "DDD"
WHITE, WALL, UNKNOWN, HIDDEN_WALL = "#ffffff", "#4d4d4d", "#dbe0e8", "#a9b3c3"


def trap(**fields):
    return UnknownGridNavigation.drawn(TRAP, view=(5, 5), name="trap", **fields)


def runs(*pairs):
    return NavigationRuns(tuple(a for a, _ in pairs), tuple(b for _, b in pairs))


def best(model):
    """Return the shortest paths, computed in this process."""
    return Oracle().run(model, Request(control=Control())).point


def noise(rows, columns, share, seed, scenes=1, **fields):
    """Return scenes of random cells from the first corner to the last one."""
    blocked = np.random.default_rng(seed).random((scenes, rows, columns)) < share
    blocked[:, 0, 0] = blocked[:, -1, -1] = False
    ends = np.zeros((scenes, 2), int), np.full((scenes, 2), [rows - 1, columns - 1])
    return UnknownGridNavigation(blocked, *ends, [rows, columns], **fields)


def colours(axes):
    """Return the colours of the cells that axes show, shape (rows, columns)."""
    (image,) = [one for one in axes.images if one.get_gid() == "cells"]
    return np.apply_along_axis(lambda c: "#" + bytes(c[:3].tolist()).hex(), 2, image.get_array())


def moments(figure):
    """Return the axes of moments by the number of steps."""
    found = [(one.get_title(), one) for one in figure.axes]
    return {int(text.split()[1]): one for text, one in found if text.startswith("step")}


@pytest.mark.parametrize("uav", ["paper", "follow"])
@pytest.mark.parametrize("seed", range(4))
def test_cells_seen_equal_the_views_of_the_world(seed, uav):
    drawn = np.random.default_rng(seed)
    view = [(3, 3), (1, 5), (9, 3), (13, 21)][seed]
    model = noise(8, 11, 0.3, seed, uav=uav, view=view, steps=300)
    world = World(model)
    known = np.full((8, 11), -1)
    middles, positions = [], []
    half = np.array(view) // 2
    action, k = -1, 0
    while True:
        (answer,) = world(np.array([[0.0, action]]))
        corner = answer[2:4].astype(int)
        for row, column in np.ndindex(view):
            cell = corner + np.array([row, column])
            if (cell >= 0).all() and (cell < (8, 11)).all() and known[tuple(cell)] < 0:
                known[tuple(cell)] = k
        positions.append(answer[:2].astype(int))
        middles.append(corner + half)
        if answer[4] or k == 200:
            break
        k += 1
        action = float(drawn.integers(4))
    walked = np.array(positions)
    uav = uav_cells(model, 0, walked)
    assert uav.tolist() == np.array(middles).tolist()
    seen = first_seen(model, 0, walked, uav)
    assert seen.tolist() == np.where(known < 0, len(walked), known).tolist()
    # The plot does not read the true map.
    assert (first_seen(model.blinded(), 0, walked, uav) == seen).all()


def test_a_run_is_drawn_on_the_map_and_step_by_step(tmp_path):
    model = trap()
    plan = runs((WALK, "reached"))
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "run.png", dpi=40)
    whole = figure.axes[0]
    taken = model.replays(plan)[0]
    (way,) = artists(whole, "way")
    assert np.column_stack(way.get_data()).tolist() == taken.positions[:, ::-1].tolist()
    (hits,) = artists(whole, "collision")
    assert np.column_stack(hits.get_data()).tolist() == [[7.5, 3.0], [2.0, 0.5]]
    shown = moments(figure)
    assert len(shown) == 6
    assert (min(shown), max(shown)) == (0, len(WALK))
    first = colours(shown[0])
    blocked = model.blocked[0]
    for cell in np.ndindex(blocked.shape):
        seen = abs(cell[0] - 3) <= 2 and abs(cell[1] - 2) <= 2
        expected = (
            (WALL if seen else HIDDEN_WALL) if blocked[cell] else (WHITE if seen else UNKNOWN)
        )
        assert first[cell] == expected
    for step, axes in shown.items():
        (vehicle,), (uav,), (view,) = (artists(axes, gid) for gid in ("vehicle", "UAV", "view"))
        row, column = taken.positions[step]
        assert (vehicle.get_xdata(), vehicle.get_ydata()) == (column, row)
        assert view.get_x() + 2.5 == uav.get_xdata() and view.get_y() + 2.5 == uav.get_ydata()
        assert (view.get_width(), view.get_height()) == (5, 5)
        hovers = (uav.get_xdata(), uav.get_ydata()) != (column, row)
        assert (view.get_linestyle() == "--") == hovers
    assert hovers, "at the end the UAV has stayed behind"
    ended = ", 2 collisions, at best 16"
    assert figure.get_suptitle() == f"trap  ·  reached after {len(WALK)} steps{ended}"
    assert {"vehicle", "the UAV hovers", "collision", "run"} <= set(legend(figure))


def test_a_uav_that_follows_never_hovers():
    model = trap(uav="follow")
    figure = ct.plot(model, best(model), moments=24)
    assert "the UAV hovers" not in legend(figure)
    assert "collision" not in legend(figure)
    assert {one.get_linestyle() for axes in figure.axes for one in artists(axes, "view")} == {"-"}
    assert list(moments(figure)) == list(range(17)), "no more moments than there are"


def test_moments_are_chosen_and_others_are_named():
    model = trap()
    good, lost = best(model), runs(("RRRRRR", "gave up"))
    lie = model.plan_to_data(runs(("R", "reached")))
    figure = render(ct.plot(model, lost, moments=[6, 0], others={"best": good, "lie": lie}))
    assert list(moments(figure)) == [0, 6]
    told = legend(figure)
    assert "run: gave up after 6 steps, 1 collision" in told
    assert "best: reached after 16 steps" in told
    assert "lie: reached after 1 step, NOT VALID" in told
    assert len(artists(figure.axes[0], "other way")) == 2
    assert "NOT VALID" not in figure.get_suptitle()
    assert (
        "NOT VALID: the target is where the run ends"
        in ct.plot(model, lie, moments=0).get_suptitle()
    )
    alone = render(ct.plot(model, others={"best": good}, moments=3))
    assert not moments(alone)
    assert set(colours(alone.axes[0]).ravel()) == {WHITE, WALL}
    assert not moments(ct.plot(model, good, moments=0))


def test_many_scenes_have_a_panel_of_all():
    model = noise(17, 17, 0.25, 1, scenes=400)
    found = best(model)
    half = NavigationRuns(
        tuple(run if k % 2 else run[:7] for k, run in enumerate(found.actions)),
        tuple(how if k % 2 else "gave up" for k, how in enumerate(found.outcomes)),
    )
    figure = render(ct.plot(model, half, scene=399, moments=1, others={"oracle": found}))
    panel = figure.axes[-1]
    own, other = artists(panel, "reached")
    (shortest,) = artists(panel, "shortest")
    assert own.get_ydata()[-1] == pytest.approx(half.success)
    assert other.get_ydata()[-1] == pytest.approx(found.success)
    assert other.get_xydata().tolist() == shortest.get_xydata().tolist()
    within = [
        len(a) <= 32 for a, b in zip(found.actions, found.outcomes, strict=True) if b == "reached"
    ]
    at = np.searchsorted(other.get_xdata(), 32, side="right") - 1
    assert other.get_ydata()[at] == pytest.approx(100 * sum(within) / 400)
    assert figure.get_suptitle().startswith("scene 399 of 400: ")
    assert f"{half.success:.4g} % reached" in figure.get_suptitle()
    cells = model.blocked[399]
    assert (np.isin(colours(figure.axes[0]), [WALL, HIDDEN_WALL]) == cells).all()
    assert "here scene 7" in ct.plot(model, scene=7).get_suptitle()


def test_scenes_without_a_way_and_runs_without_a_step_are_drawn():
    model = UnknownGridNavigation.drawn("S@T", "ST@", view=(1, 1))
    solution = best(model)
    figure = render(ct.plot(model, solution))
    assert list(moments(figure)) == [0]
    assert "no way after 0 steps, there is no way" in figure.get_suptitle()
    given_up = runs(("", "gave up"), ("", "gave up"))
    panel = render(ct.plot(model, given_up, scene=1, moments=0)).axes[-1]
    (line,) = artists(panel, "reached")
    assert set(line.get_ydata()) == {0.0}
    animate_run(model, given_up).to_jshtml(default_mode="once")


def snake(rows, columns):
    """Return the actions from the first corner to the last one, through every column."""
    down, up = "D" * (rows - 1), "U" * (rows - 1)
    return "R".join(down if k % 2 == 0 else up for k in range(columns))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("rows", "columns", "view"),
    [(1, 2, (1, 3)), (1, 1000, (1, 11)), (1000, 1, (3, 1)), (61, 7, (3, 15)), (1000, 1000, (5, 5)),
     (1000, 1000, (1999, 1999))],
)  # fmt: skip
def test_maps_of_any_size_are_drawn(rows, columns, view):
    model = noise(rows, columns, 0.0, 0, view=view, steps=10**6, uav="follow")
    # An odd number of columns ends at the bottom; of an even number the target is not reached.
    actions = snake(rows, min(columns, 5)) + "R" * max(columns - 5, 0)
    plan = runs(
        (actions, "gave up" if columns % 2 == 0 and rows > 1 and columns < 5 else "reached")
    )
    figure = render(ct.plot(model, plan, moments=4))
    whole = figure.axes[0]
    assert whole.get_xlim() == (-0.5, columns - 0.5)
    assert whole.get_ylim() == (rows - 0.5, -0.5)
    for step, axes in moments(figure).items():
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        row, column = model.replays(plan)[0].positions[step]
        assert left < column < right
        assert top < row < bottom
        assert right - left <= max(60, 2 * view[1] + 1)
    sides = [axes.get_position() for axes in figure.axes]
    assert all(0 <= p.x0 < p.x1 <= 1 and 0 <= p.y0 < p.y1 <= 1 for p in sides)
    for k, one in enumerate(sides):
        assert not any(one.overlaps(other) for other in sides[k + 1 :])
    integers = [tick for axis in (whole.get_xticks(), whole.get_yticks()) for tick in axis]
    assert all(tick == int(tick) for tick in integers)


@pytest.mark.parametrize("size", [(4, 3), (3, 8)])
def test_the_figure_has_the_requested_size(size):
    model = trap()
    figure = render(ct.plot(model, runs((WALK, "reached")), size=size))
    assert tuple(figure.get_size_inches()) == size
    assert len(moments(figure)) == 6


def test_the_run_in_motion(tmp_path):
    model = trap()
    plan = runs((WALK, "reached"))
    film = animate_run(model, plan, frames=3, size=(3, 3))
    film.save(tmp_path / "run.gif", writer="pillow", dpi=40)
    assert (tmp_path / "run.gif").read_bytes()[:4] == b"GIF8"
    figure = film._fig
    (vehicle,) = artists(figure.axes[0], "vehicle")
    assert (vehicle.get_xdata(), vehicle.get_ydata()) == (10, 3), "the last frame is the last step"
    assert f"step {len(WALK)} of {len(WALK)}: reached" in words(figure)
    film._func(0)
    assert f"step 0 of {len(WALK)}" in words(figure)
    assert (vehicle.get_xdata(), vehicle.get_ydata()) == (2, 3)
    assert (colours(figure.axes[0]) == UNKNOWN).sum() > 30
    # On a large map, the visible part follows the vehicle.
    large = noise(300, 300, 0.0, 0, steps=1000)
    moving = animate_run(large, best(large), frames=3)
    for frame in range(3):
        moving._func(frame)
        axes = moving._fig.axes[0]
        (vehicle,) = artists(axes, "vehicle")
        left, right = axes.get_xlim()
        assert left < vehicle.get_xdata()[0] < right
        upright, _ = artists(axes, "lines")
        ends = [line[0, 0] for line in upright.get_segments()]
        assert (min(ends), max(ends)) == (left, right)
    moving._draw_was_started = True  # looked at, not played


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scene": 1}, "scene must be 0, the only scene, got 1"),
        ({"scene": -1}, "scene must be 0"),
        ({"scene": True}, "scene must be 0"),
        ({"moments": 25}, "moments must be a whole number from 0 to 24, or as many"),
        ({"moments": [17]}, "numbers of steps from 0 to 16, got"),
        ({"moments": [3, 3]}, "moments must be"),
        ({"moments": "all"}, "moments must be"),
        ({"moments": [0.5]}, "moments must be"),
        ({"others": [1]}, "others must be at most 5 plans by their names"),
        ({"others": {str(k): None for k in range(6)}}, "others must be at most 5"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": (0, 1)}, "size must be"),
        ({"steps": 6}, "no option 'steps'"),
    ],
)
def test_values_that_the_picture_does_not_take(options, message):
    model = trap()
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(model, best(model), **options)


def test_values_that_an_animation_does_not_take():
    model = trap()
    plan = runs(("R", "gave up"))
    for options, message in (
        ({"frames": 1}, "frames must"),
        ({"interval": 0}, "interval must"),
        ({"scene": 2}, "scene must"),
    ):
        with pytest.raises(UnsupportedOption, match=message):
            animate_run(model, plan, **options)
    with pytest.raises(InvalidData, match="there is no plan"):
        animate_run(model, None)


def test_plans_of_other_models_and_blinded_models_are_refused():
    model = trap()
    two = runs(("R", "gave up"), ("L", "gave up"))
    for call in (lambda: ct.plot(model, two), lambda: animate_run(model, two)):
        with pytest.raises(InvalidData, match="actions must have 1 entries"):
            call()
    with pytest.raises(InvalidData, match="actions must have 1 entries"):
        ct.plot(model, others={"two": two})
    with pytest.raises(HiddenData, match="blocked of model 'unknown-grid' is hidden"):
        ct.plot(model.blinded())
    with pytest.raises(HiddenData, match="blocked"):
        animate_run(model.blinded(), runs(("R", "gave up")))
