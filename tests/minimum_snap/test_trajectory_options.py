"""The picture of a trajectory: forms of plans, options, and thousands of segments."""

from types import SimpleNamespace

import pytest
from pictures import artists, legend, render, words
from walks import boxes, derivatives, path, spline, strips, walk

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models.minimum_snap.plot import picture as trajectory


def size_of(figure):
    return sum(len(axes.get_children()) for axes in figure.axes)


def test_plans_in_any_form():
    model = walk(5, 2)
    plan = spline(model)
    wanted = ct.plot(model, plan, derivatives=()).get_suptitle()
    for form in (model.plan_to_data(plan), SimpleNamespace(plan=plan), plan.to_ppoly()):
        assert ct.plot(model, form, derivatives=()).get_suptitle() == wanted
    with pytest.raises(InvalidData, match="there is no plan"):
        ct.plot(model, SimpleNamespace(plan=None, termination="infeasible"))


def test_a_model_without_times_takes_those_of_the_plan():
    base = walk(5, 2, velocity_limit=0.1)
    plan = spline(base)
    free = SimpleNamespace(
        waypoints=base.waypoints, order=4, bounds=lambda: base.bounds, verify=base.verify,
        describe=lambda: "times to choose", objective_unit="s", name="",
    )  # fmt: skip
    figure = trajectory.draw(free, plan)
    assert "minimum snap, times chosen, 5 segments, objective = " in figure.get_suptitle()
    knots = next(c for c in derivatives(figure)["velocity"].collections if len(c.get_paths()) == 6)
    assert [p.vertices[0, 0] for p in knots.get_paths()] == plan.times.tolist()
    assert len(artists(derivatives(figure)["velocity"], "worst violation")) == 1
    for axes in (None, (0,)):
        alone = trajectory.draw(free, axes=axes)
        assert alone.get_suptitle() == "times to choose"
    assert path(alone).get_xlabel() == "knot (number)"


def test_data_alone():
    for dimensions in (1, 2, 3, 4):
        bare = walk(5, dimensions)
        model = walk(5, dimensions, **boxes(bare, 0.5))
        figure = ct.plot(model)
        assert len(figure.axes) == 1
        assert not any("speed" in word for word in words(figure))


def test_options():
    model = walk(4, 4)
    plan = spline(model)
    figure = ct.plot(
        model, plan, axes=(0, 3), derivatives=2, names=("x", "y", "z", "yaw"), labels=False,
        size=(8, 4),
    )  # fmt: skip
    assert list(derivatives(figure)) == ["position", "velocity", "acceleration"]
    assert path(figure).get_ylabel() == "yaw (m)"
    assert path(figure).texts[:] == []
    assert "speed along x, yaw (m/s)" in words(figure)
    assert figure.get_size_inches().tolist() == [8, 4]
    assert list(derivatives(ct.plot(model, plan, derivatives=(3, 1)))) == ["velocity", "jerk"]
    alone = ct.plot(model, plan, derivatives=(), axes=(2,))
    assert derivatives(alone) == {}
    assert path(alone).get_ylabel() == "z (m)"
    assert path(alone).get_xlabel() == "time (s)"
    for size in ((1, 1), (30, 20)):
        render(ct.plot(model, plan, size=size, derivatives=(1,)))


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"axes": (0, 2)}, "axes", r"different axes from 0 to 1, got \(0, 2\)"),
        ({"axes": (1, 1)}, "axes", "hold 1 to 3 different axes"),
        ({"axes": ()}, "axes", r"got \(\)"),
        ({"axes": "xy"}, "axes", "got 'xy'"),
        ({"axes": 0}, "axes", "got 0"),
        ({"axes": (0.0, 1)}, "axes", "got"),
        ({"derivatives": -1}, "derivatives", "from 0 to 15, .* got -1"),
        ({"derivatives": True}, "derivatives", "got True"),
        ({"derivatives": (1, 1)}, "derivatives", "different ones"),
        ({"derivatives": (1, 99)}, "derivatives", r"got \(1, 99\)"),
        ({"names": ("x",)}, "names", "2 different words"),
        ({"names": ("x", "x")}, "names", "different"),
        ({"names": ("x", 2)}, "names", "got"),
        ({"names": "xy"}, "names", "got 'xy'"),
        ({"labels": "yes"}, "labels", "be True or False, got 'yes'"),
        ({"size": (0, 3)}, "size", r"width and height in inches.* got \(0, 3\)"),
        ({"size": "big"}, "size", "got 'big'"),
    ],
)
def test_values_that_are_not_allowed(options, field, message):
    model = walk(3, 2)
    with pytest.raises(UnsupportedOption, match=f"^{field} must .*{message}"):
        ct.plot(model, spline(model), **options)


def test_unknown_options():
    known = "axes, derivatives, names, labels, title, size"
    with pytest.raises(UnsupportedOption, match=f"no option 'color'; its options: {known}"):
        ct.plot(walk(3, 2), color="red")


# -- size and state ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "dimensions"),
    [pytest.param("boxes", 2, marks=pytest.mark.slow), ("boxes", 3), ("polytopes", 2)],
)
def test_a_thousand_segments_are_as_many_artists_as_a_hundred(shape, dimensions):
    counts, pieces = [], []
    for segments in (100, 1000):
        bare = walk(segments, dimensions)
        region = boxes(bare, 9.0) if shape == "boxes" else strips(bare, 9.0)
        model = walk(segments, dimensions, velocity_limit=50, **region)
        figure = ct.plot(model, spline(bare), derivatives=(1,))
        counts.append(size_of(figure))
        way = next(c for c in path(figure).collections if c.get_array() is not None)
        pieces.append(len(way.get_array()))
        if segments == 1000:
            render(figure)
            regions_drawn = "corridor (400 of 1000 drawn)" if dimensions == 3 else "corridor"
            assert regions_drawn in legend(figure)
    # The rings of the waypoints are one artist, omitted if they are too many.
    assert counts[1] == counts[0] - 1 < 130
    assert max(pieces) <= 8000


def test_many_segments_are_thinned():
    model = walk(30_000, 1)
    figure = ct.plot(model, spline(model), derivatives=(1,))
    (line,) = artists(derivatives(figure)["velocity"], "curve x")
    assert len(line.get_xdata()) <= 8000
    assert line.get_xdata()[[0, -1]].tolist() == model.times[[0, -1]].tolist()
