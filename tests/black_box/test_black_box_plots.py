"""Pictures of black boxes show the data of the function and the plan."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from listening import incumbents
from pictures import artists, legend, panels, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import BlackBoxMinimisation, GridPath
from crosstrack.models.black_box import WaypointPath, path_problem
from crosstrack.models.black_box.plot import animate_search
from crosstrack.models.grid_path import GridMap

#: A wall with a way around its end.
WALL = GridMap(["......", "..@@@@", "......", "......"], upward=True)


def curve(axes):
    (found,) = artists(axes, "curve value")
    return found.get_xdata(), found.get_ydata()


def mark(axes, gid="point"):
    (found,) = artists(axes, gid)
    return float(found.get_xdata()[0]), float(found.get_ydata()[0])


def broken(x):
    """0.2 … 0.4 raises, beyond 1 is no number, below 0 infinite."""
    if 0.2 < x[0] < 0.4:
        raise ZeroDivisionError("nothing here")
    return math.nan if x[0] > 1 else math.inf if x[0] < 0 else float(x[0]) ** 2


@pytest.fixture(scope="module")
def walled():
    """A free path around the wall, and one through it."""
    grid = GridPath(WALL, (0, 5), (2, 5), connectivity="any", name="wall")
    problem = path_problem(grid, 2)
    return problem, {"x": [2, 1, 2, 2]}, {"x": [5.5, 1.0, 5.5, 1.5]}


# -- one variable --------------------------------------------------------------------------------


def test_a_curve_with_the_point_on_it(tmp_path):
    model = BlackBoxMinimisation("rastrigin", [[-5, 4]], name="ripples")
    figure = ct.plot(model, {"x": [1.0]}, others={"better": {"x": [0.0]}})
    figure.savefig(tmp_path / "curve.png", dpi=40)
    (axes,) = figure.axes
    x, y = curve(axes)
    assert (x.min(), x.max()) == (-5, 4)
    assert len(x) >= 404
    assert y == pytest.approx(x**2 - 10 * np.cos(2 * np.pi * x) + 10)
    assert 1.0 in x
    assert mark(axes, "point, 1") == (1.0, pytest.approx(1.0))
    assert mark(axes, "better, 0") == (0.0, 0.0)
    assert sorted(line.get_xdata()[0] for line in artists(axes, "bound")) == [-5, 4]
    assert figure.get_suptitle() == "ripples  ·  1 variable, 10000 evaluations, value 1"
    assert legend(figure) == ["bound", "point, 1", "better, 0"]
    assert axes.get_xlabel() == "x[0] (–)"


def test_where_there_is_no_value_there_is_a_gap():
    model = BlackBoxMinimisation(broken, [[-1, 2]])
    x, y = curve(render(ct.plot(model, points=50)).axes[0])
    gap = (x < 0) | ((x > 0.2) & (x < 0.4)) | (x > 1)
    assert np.isnan(y).tolist() == gap.tolist()
    assert y[~gap] == pytest.approx(x[~gap] ** 2)
    figure = render(ct.plot(model, {"x": [1.5]}))
    assert "NOT VALID: value is a number" in figure.get_suptitle()
    with pytest.raises(InvalidData, match="nothing here"):
        ct.plot(model, {"x": [0.3]})


def test_a_well_narrower_than_a_step_is_met_at_the_point():
    def well(x):
        return 0.0 if abs(x[0] - 0.123456) < 1e-9 else 1.0

    axes = render(ct.plot(BlackBoxMinimisation(well, [[0, 1]]), {"x": [0.123456]})).axes[0]
    assert curve(axes)[1].min() == 0.0 == mark(axes)[1]


# -- two variables -------------------------------------------------------------------------------


def test_a_map_of_levels_with_the_point(tmp_path):
    model = BlackBoxMinimisation("booth", [[-10, 10], [-4, 10]])
    figure = ct.plot(model, {"x": [1, 3]}, others={"beyond": {"x": [99, 0]}})
    figure.savefig(tmp_path / "map.png", dpi=40)
    axes, bar = figure.axes
    filled = next(one for one in axes.collections if one.get_array() is not None and one.filled)
    x, y = np.meshgrid(np.linspace(-10, 10, 101), np.linspace(-4, 10, 101))
    values = (x + 2 * y - 7) ** 2 + (2 * x + y - 5) ** 2
    assert (filled.levels[0], filled.levels[-1]) == pytest.approx((values.min(), values.max()))
    # Levels hold about equal shares of the area.
    shares = np.histogram(values, filled.levels)[0] / values.size
    assert len(shares) > 10
    assert shares.max() < 0.12
    assert mark(axes) == (1, 3)
    # Values far away are drawn at the edge.
    assert mark(axes, "beyond") == (30, 0)
    assert legend(figure) == ["bound", "point, 0", "beyond, 45713, NOT VALID"]
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == (
        "x[0] (–)",
        "x[1] (–)",
        "value (–)",
    )
    (edge,) = artists(axes, "bound")
    assert (*edge.get_xy(), edge.get_width(), edge.get_height()) == (-10, -4, 20, 14)


def test_a_flat_function_with_a_narrow_well_has_equal_steps():
    figure = render(ct.plot(BlackBoxMinimisation("easom", [[-10, 10]] * 2)))
    filled = next(one for one in figure.axes[0].collections if one.get_array() is not None)
    steps = np.diff(filled.levels)
    assert steps == pytest.approx(np.full(len(steps), steps[0]))
    assert filled.levels[0] < -0.9


def test_maps_of_what_is_constant_or_has_no_value():
    constant = render(ct.plot(BlackBoxMinimisation("constant", [[0, 1]] * 2)))
    assert legend(constant) == ["bound", "value 0"]
    nothing = render(ct.plot(BlackBoxMinimisation(lambda x: math.nan, [[0, 1]] * 2), points=5))
    assert legend(nothing) == ["bound", "no value"]
    some = BlackBoxMinimisation(lambda x: broken(x) + x[1], [[-1, 2], [0, 1]])
    figure = render(ct.plot(some, {"x": [0.5, 0.5]}, points=31))
    assert legend(figure) == ["bound", "no value", "point"]
    filled = next(one for one in figure.axes[0].collections if one.get_array() is not None)
    assert filled.get_datalim(figure.axes[0].transData).x0 >= 0


# -- many variables ------------------------------------------------------------------------------


def test_cross_sections_lead_through_the_point(tmp_path):
    point = np.arange(1.0, 6.0)
    model = BlackBoxMinimisation("sum-squares", [[-9, 9], [0, 9], [3, 3], [-9, 9], [-9, 9]])
    figure = ct.plot(model, {"x": [1, 2, 3, 4, 5]}, others={"least": {"x": [0, 0, 3, 0, 0]}})
    figure.savefig(tmp_path / "sections.png", dpi=40)
    assert [axes.get_xlabel() for axes in figure.axes] == [f"x[{k}] (–)" for k in (0, 1, 3, 4)]
    weights = np.arange(1.0, 6.0)
    whole = float(weights @ point**2)
    for axes, k in zip(figure.axes, (0, 1, 3, 4), strict=True):
        x, y = curve(axes)
        assert y == pytest.approx(whole + weights[k] * (x**2 - point[k] ** 2))
        assert mark(axes, "point, 225") == (point[k], whole)
        assert mark(axes, "least, 27") == (0, 27)
    assert set(panels(figure)) == {"value", ""}


def test_twelve_cross_sections_at_the_most_through_the_middle():
    figure = render(ct.plot(BlackBoxMinimisation("sphere", [[0, 2]] * 100), points=3))
    assert len(figure.axes) == 12
    assert curve(figure.axes[7])[1].tolist() == [99, 100, 103]


def test_variables_that_are_all_fixed():
    axes = render(ct.plot(BlackBoxMinimisation("sphere", [[2, 2]] * 3), {"x": [2, 2, 2]})).axes[0]
    assert mark(axes) == (2, 12)
    two = render(ct.plot(BlackBoxMinimisation("sphere", [[0, 1], [2, 2], [0, 1]]), points=3)).axes
    assert (two[0].get_xlabel(), two[0].get_ylabel()) == ("x[0] (–)", "x[2] (–)")


@pytest.mark.parametrize(
    ("function", "bounds", "x"),
    [
        ("sphere", [[-1e-9, 1e-9]], [0.0]),
        ("sphere", [[1e9, 1e9 + 1e-3]], [1e9]),
        pytest.param("sphere", [[-1e150, 1e150]], [1e150], marks=pytest.mark.slow),
        ("sphere", [[-1e300, 1e300]], [1.0]),
        ("sphere", [[-1, 1]], [1e300]),
        ("ackley", [[-1e-9, 1e-9], [1e9, 2e9]], [0, 1e9]),
        pytest.param("sphere", [[-1, 1]] * 2, [1e300, -1e300], marks=pytest.mark.slow),
        pytest.param("step", [[-1e9, 1e9]] * 2, [0, 0], marks=pytest.mark.slow),
        ("rosenbrock", [[-1e6, 1e6]] * 3, [1e-6, 1e300, 1]),
        ({"name": "sphere", "deviation": 1e6}, [[-1, 1]] * 5, [0] * 5),
        (lambda x: -math.inf, [[-1, 1]] * 4, [0] * 4),
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_functions_are_drawn(function, bounds, x, tmp_path):
    model = BlackBoxMinimisation(function, bounds, name="strange")
    render(ct.plot(model, points=9))
    figure = ct.plot(model, {"x": x}, points=9)
    figure.savefig(tmp_path / "point.png", dpi=30)
    held = model.verify(model.as_plan({"x": x}))
    assert ("NOT VALID" in figure.get_suptitle()) == (not held.ok)


# -- paths ---------------------------------------------------------------------------------------


def test_a_path_on_its_map(walled, tmp_path):
    model, free, blocked = walled
    figure = ct.plot(model, free, others={"through": blocked})
    figure.savefig(tmp_path / "path.png", dpi=40)
    (axes,) = figure.axes
    (line,) = artists(axes, "path")
    assert np.column_stack(line.get_data()).tolist() == [[5.5, 0.5], [2, 1], [2, 2], [5.5, 2.5]]
    (other,) = artists(axes, "other path")
    assert other.get_xdata().tolist() == [5.5] * 4
    (start,), (goal,) = artists(axes, "start"), artists(axes, "goal")
    assert start.get_offsets().tolist() == [[5.5, 0.5]]
    assert goal.get_offsets().tolist() == [[5.5, 2.5]]
    (image,) = axes.images
    assert (image.get_array() == WALL.blocked).all()
    assert list(image.get_extent()) == [0, 6, 0, 4]
    assert axes.get_aspect() == 1
    assert axes.get_ylim()[0] < axes.get_ylim()[1]
    assert not artists(axes, "blocked path")
    length = 1 + 2 * math.hypot(3.5, 0.5)
    assert figure.get_suptitle().startswith("wall  ·  4 variables, 10000 evaluations, value 8.07")
    assert f"path, {length:.6g}" in legend(figure)
    assert "blocked" not in figure.get_suptitle()


def test_what_is_blocked_of_a_path_is_red(walled):
    model, _, blocked = walled
    figure = render(ct.plot(model, blocked))
    (red,) = artists(figure.axes[0], "blocked path")
    points = np.column_stack(red.get_data())
    inside = points[np.isfinite(points).all(axis=1)]
    assert np.ptp(inside[:, 1]) == pytest.approx(1.0, abs=0.01)
    assert model.function.map.blocked[tuple(np.floor(inside[1:-1]).astype(int).T[::-1])].all()
    assert f"of which {model.function.penalty:.6g} for what is blocked" in figure.get_suptitle()
    assert "through what is blocked" in legend(figure)


def test_maps_of_text_and_paths_that_leave_them():
    text = GridMap(WALL.blocked, cell=1e-3)
    function = WaypointPath(text, (5.5e-3, 5e-4), (5.5e-3, 2.5e-3), 1)
    model = BlackBoxMinimisation(function, [[0, 6e-3], [0, 4e-3]])
    for x in ([3e-3, 1e-3], [0.05, 1e3], [1e300, -1e300]):
        figure = ct.plot(model, {"x": x})
        render(figure)
        (axes,) = figure.axes
        assert axes.get_ylim()[0] > axes.get_ylim()[1]
        assert axes.get_xlabel() == "x (mm)"
        assert axes.get_xlim()[1] < 20
    alone = render(ct.plot(model))
    assert not artists(alone.axes[0], "path")
    assert legend(alone) == ["start", "goal", "blocked"]


def test_a_path_as_a_function_of_numbers(walled):
    model, free, _ = walled
    figure = render(ct.plot(model, free, view="values", points=5))
    assert [axes.get_xlabel() for axes in figure.axes] == [f"x[{k}] (–)" for k in range(4)]
    x, y = curve(figure.axes[1])
    at = np.tile([2.0, 1, 2, 2], (len(x), 1))
    at[:, 1] = x
    assert y == pytest.approx(model.function.values(at))


# -- options and the animation -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"view": "maps"}, "view must be 'map' or 'values', got 'maps'"),
        ({"points": 1}, "points must be a whole number from 2 to 2001, got 1"),
        ({"points": 2.5}, "points must"),
        ({"others": [1]}, "others must be at most 12 plans by their names"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": "big"}, "size must be"),
        ({"zoom": True}, "no option 'zoom'"),
    ],
)
def test_values_that_no_picture_of_black_boxes_takes(options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(BlackBoxMinimisation("sphere", [[0, 1]]), {"x": [1]}, **options)


def test_title_and_size_are_as_asked(walled):
    for model, x in [(walled[0], walled[1]["x"]), (BlackBoxMinimisation("sphere", [[0, 1]]), [1])]:
        figure = render(ct.plot(model, {"x": x}, title="mine", size=(4, 3)))
        assert figure.get_suptitle() == "mine"
        assert figure.get_size_inches().tolist() == [4, 3]
    with pytest.raises(InvalidData, match="x must have 4 entries, got 1"):
        ct.plot(walled[0], {"x": [1]})


def test_the_search_in_motion(walled, tmp_path):
    model = walled[0]
    met = []
    ct.solve(model, "random-search", seed=3, evaluations=600, on_event=incumbents(met.append))
    points = np.random.default_rng(1).uniform(model.lows, model.highs, (9, 4))
    values = model.function.values(points)
    worst = np.argsort(-values)
    met = [one for one in met if one.objective < values.min()]
    before = [
        SimpleNamespace(seconds=0.0, objective=values[k], plan=model.as_plan({"x": points[k]}))
        for k in worst
    ]
    met = [*before, *met]
    animation = animate_search(model, met, frames=4, size=(3, 3))
    animation.save(tmp_path / "search.gif", writer="pillow", dpi=40)
    assert (tmp_path / "search.gif").stat().st_size > 1000
    figure = animation._fig
    for frame, kept in ((0, met[0]), (3, met[-1])):
        animation._func(frame)
        (line,) = artists(figure.axes[0], "path")
        drawn = np.column_stack(line.get_data())
        assert drawn[1:-1].ravel() == pytest.approx(kept.plan.x)
        assert any(f"value {kept.objective:.6g}" in text for text in words(figure))
    (within,) = artists(figure.axes[0], "path through what is blocked")
    length = np.hypot(*np.diff(drawn, axis=0).T).sum()
    seen = np.isfinite(within.get_xdata()).any()
    assert seen == (met[-1].objective > length * (1 + 1e-9))
    assert len(list(animation.new_frame_seq())) == 4
    one = animate_search(model, met[:1])
    one.save(tmp_path / "one.gif", writer="pillow", dpi=20)
    assert len(list(one.new_frame_seq())) == 1


def test_what_no_animation_shows(walled):
    model = walled[0]
    for wrong in ([], None, ["x"], ct.solve(model, "random-search", evaluations=9)):
        with pytest.raises(InvalidData, match="incumbents must be a list"):
            animate_search(model, wrong)
    with pytest.raises(UnsupportedOption, match="frames must"):
        animate_search(model, [], frames=1)
    with pytest.raises(InvalidData, match="function must be a WaypointPath"):
        animate_search(BlackBoxMinimisation("sphere", [[0, 1]]), [])


def test_the_animation_takes_the_events_of_a_run(walled):
    events = []
    ct.solve(walled[0], "random-search", seed=3, evaluations=600, on_event=events.append)
    animation = animate_search(walled[0], events, frames=2, size=(3, 3))
    assert len(list(animation.new_frame_seq())) == 2
    animation._draw_was_started = True
