"""The picture of a trajectory: what is drawn, for any number of axes, valid or not."""

import itertools
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.interpolate import PPoly, make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import FREE, MinimumDerivative, MinimumSnap, Trajectory
from crosstrack.models.minimum_snap.plot import picture as trajectory
from crosstrack.models.minimum_snap.plot.data import pretty_unit, scene_of
from crosstrack.models.minimum_snap.plot.regions import regions
from crosstrack.models.plots.style import number

RED = "#c8102e"


def spline(model):
    """Return the minimum-snap trajectory from rest to rest, as SciPy finds it."""
    t, w = model.times, model.waypoints
    rest = [(j, np.zeros(w.shape[1])) for j in (1, 2, 3)]
    found = make_interp_spline(t, w, k=7, bc_type=(rest, rest))
    pieces = [PPoly.from_spline((found.t, np.ascontiguousarray(c), 7)) for c in found.c.T]
    keep = np.flatnonzero(np.diff(pieces[0].x) > 0)
    c = np.stack([piece.c[:, keep] for piece in pieces], axis=2)
    return Trajectory.from_ppoly(PPoly(c, np.append(pieces[0].x[keep], pieces[0].x[-1])))


def solved(model):
    """Return a solution of the model's own program, which holds its bounds at some instants."""
    import piqp

    formulation = model.formulate("legendre")
    program = formulation.program
    lower, upper = program.row_lower, program.row_upper
    equal = lower == upper
    matrix = sp.csc_matrix(program.matrix)
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    solver.setup(
        sp.csc_matrix(program.hessian), program.cost, matrix[equal], lower[equal],
        matrix[~equal], np.maximum(lower[~equal], -1e30), np.minimum(upper[~equal], 1e30),
    )  # fmt: skip
    solver.solve()
    return formulation.decode(np.array(solver.result.x))


def walk(segments, dimensions, seed=1, **more):
    steps = np.random.default_rng(seed).normal(size=(segments + 1, dimensions))
    return MinimumSnap(
        np.cumsum(steps, axis=0), np.linspace(0, 1.2 * segments, segments + 1), **more
    )


def boxes(model, by):
    before, after = model.waypoints[:-1], model.waypoints[1:]
    return {
        "corridor_lower": np.minimum(before, after) - by,
        "corridor_upper": np.maximum(before, after) + by,
    }


def strips(model, by):
    """Return half-spaces on both sides of, before and behind every leg."""
    rows = []
    for k, (here, there) in enumerate(itertools.pairwise(model.waypoints)):
        along = (there - here) / np.linalg.norm(there - here)
        across = np.linalg.svd(along[None])[2][1:]
        for normal in (*across, *-across):
            rows.append((k, normal, normal @ here + by))
        rows += [(k, along, along @ there + by), (k, -along, -along @ here + by)]
    segments, normals, offsets = zip(*rows, strict=True)
    return {
        "polytope_segments": segments, "polytope_normals": normals, "polytope_offsets": offsets,
    }  # fmt: skip


def panels(figure):
    """Return the derivatives' axes by their name."""
    words = ("position", "velocity", "acceleration", "jerk", "snap", "crackle")
    found = {axes.get_ylabel().split("\n")[0]: axes for axes in figure.axes}
    return {word: found[word] for word in words if word in found}


def path(figure):
    return figure.axes[0]


def lines(axes, gid):
    return [line for line in axes.lines if line.get_gid() == gid]


def legend(figure):
    from matplotlib.legend import Legend

    return [text.get_text() for found in figure.findobj(Legend) for text in found.get_texts()]


def words(figure):
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def artists(figure):
    return sum(len(axes.get_children()) for axes in figure.axes)


# -- what is drawn -------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4])
def test_any_number_of_axes(dimensions, tmp_path):
    model = walk(5, dimensions)
    plan = spline(model)
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "path.png")
    assert path(figure).name == ("3d" if dimensions > 2 else "rectilinear")
    drawn = panels(figure)
    # The position of one axis stands on the left.
    assert next(iter(drawn)) == ("velocity" if dimensions == 1 else "position")
    assert list(drawn)[-1] == "snap"
    for order, word in enumerate(("position", "velocity", "acceleration", "jerk", "snap")):
        if word not in drawn:
            continue
        for axis in range(dimensions):
            (line,) = lines(drawn[word], f"axis {axis}")
            t, value = line.get_data()
            inside = ~np.isin(t, plan.times)
            assert inside.sum() > 100
            wanted = plan(t[inside], order)[:, axis]
            assert value[inside] == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    named = {1: ["x"], 2: ["x", "y"], 3: ["x", "y", "z"], 4: ["x", "y", "z", "axis 3"]}
    assert [w for w in legend(figure) if w in named[4]] == named[dimensions]
    assert drawn["acceleration"].get_ylabel() == "acceleration\n(m/s²)"


def test_the_title_tells_what_it_is():
    model = walk(5, 2, name="minimum-snap/walk")
    plan = spline(model)
    objective = number(model.objective(plan))
    assert ct.plot(model, plan).get_suptitle() == (
        f"minimum-snap/walk  ·  minimum snap, 5 segments, J = {objective} m²/s⁷, 6 s"
    )
    one = MinimumDerivative([[0.0], [1.0]], [0, 2], order=2, weights=[1, 0.5])
    straight = Trajectory([0, 2], [[[0.0], [0], [3], [-2]]])
    assert (
        ct.plot(one, straight)
        .get_suptitle()
        .startswith("minimum velocity + acceleration, 1 segment, J = ")
    )
    assert ct.plot(model).get_suptitle() == "minimum-snap/walk  ·  minimum snap, 5 segments in 2-D"
    assert ct.plot(model, plan, title="Mine").get_suptitle() == "Mine"


def test_the_path_runs_through_its_waypoints():
    model = walk(5, 2)
    plan = spline(model)
    axes = path(ct.plot(model, plan))
    way = next(c for c in axes.collections if c.get_array() is not None)
    ends = np.array([piece[0] for piece in way.get_segments()])
    gaps = np.linalg.norm(ends[:, None] - model.waypoints[:-1], axis=2).min(axis=0)
    assert gaps == pytest.approx(0, abs=1e-9)
    speed = np.linalg.norm(plan(np.linspace(0, 6, 2000), 1), axis=1)
    assert way.get_array().max() == pytest.approx(speed.max(), rel=1e-3)
    assert axes.get_aspect() == 1
    numbers = [text.get_text() for text in axes.texts]
    assert numbers == list("012345")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    # Everything is in sight.
    for points in (model.waypoints, ends):
        assert (points >= [axes.get_xlim()[0], axes.get_ylim()[0]]).all()
        assert (points <= [axes.get_xlim()[1], axes.get_ylim()[1]]).all()


def test_space_has_equal_scales_even_where_it_is_flat():
    model = walk(5, 3)
    flat = model.waypoints * [10, 10, 0]
    axes = path(ct.plot(MinimumSnap(flat, model.times)))
    sides = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    scales = np.asarray(axes._box_aspect) / sides
    assert scales == pytest.approx(scales[0])
    assert sides[2] > 0.25 * sides.max()


def test_limits_stand_at_their_height():
    model = walk(4, 2, velocity_limit=3, acceleration_limit=[[4, 5]], jerk_limit=1e6)
    plan = spline(model)
    drawn = panels(ct.plot(model, plan))
    heights = sorted(
        {float(v) for line in lines(drawn["velocity"], "limit") for v in line.get_ydata()}
    )
    assert heights == [-3, 3]
    zones = [c for c in drawn["velocity"].collections if c.get_gid() == "forbidden"]
    assert len(zones) == 2
    # Axes with limits of their own have them in their own colours.
    own = {
        line.get_color(): abs(line.get_ydata()[0]) for line in lines(drawn["acceleration"], "limit")
    }
    curve = [lines(drawn["acceleration"], f"axis {axis}")[0].get_color() for axis in (0, 1)]
    assert own == {curve[0]: 4, curve[1]: 5}
    # One that is far away is told, so that the curve can still be seen.
    assert lines(drawn["jerk"], "limit") == []
    assert [text.get_text() for text in drawn["jerk"].texts] == ["jerk limit ±1×10⁶"]


def test_limits_change_with_the_segment():
    model = walk(3, 1, velocity_limit=[[3], [np.inf], [2]])
    upper = lines(panels(ct.plot(model, spline(model)))["velocity"], "limit")[1]
    t, height = upper.get_data()
    assert t.tolist() == np.repeat(model.times, 2)[1:-1].tolist()
    assert height == pytest.approx([3, 3, np.nan, np.nan, 2, 2], nan_ok=True)


def test_boxes_of_the_corridor():
    bare = walk(6, 2)
    model = walk(6, 2, **boxes(bare, 0.5))
    figure = ct.plot(model, solved(model))
    faces = next(c for c in path(figure).collections if c.get_gid() == "corridor")
    found = np.array([[p.vertices.min(axis=0), p.vertices.max(axis=0)] for p in faces.get_paths()])
    wanted = np.stack([model.corridor_lower, model.corridor_upper], axis=1)
    assert found == pytest.approx(wanted)
    assert "corridor" in legend(figure)
    bands = [c for c in panels(figure)["position"].collections if c.get_gid() == "band"]
    assert len(bands) == 2
    # One box for all segments is one region.
    same = walk(6, 2, corridor_lower=-99, corridor_upper=99)
    assert len(regions(scene_of(same, None, None), (0, 1), *np.array([[-9, -9], [9, 9]]))[0]) == 1


def test_polygons_of_half_spaces():
    square = MinimumSnap(
        [[0, 0], [1, 0]], [0, 1],
        polytope_segments=[0, 0], polytope_normals=[[0, 2], [-1, -1]], polytope_offsets=[2, 3],
    )  # fmt: skip
    scene = scene_of(square, None, None)
    (region,), total, omitted = regions(scene, (0, 1), np.array([-4.0, -4]), np.array([4.0, 4]))
    corners = {tuple(corner) for corner in region.faces[0].round(9).tolist()}
    assert corners == {(-4, 1), (1, -4), (4, -4), (4, 1)}
    assert (total, omitted) == (1, False)
    model = walk(4, 2, **strips(walk(4, 2), 0.4))
    ct.plot(model, solved(model)).canvas.draw()


def test_bodies_of_half_spaces():
    cube = MinimumSnap(
        [[0, 0, 0], [1, 0, 0]], [0, 1], corridor_lower=-2, corridor_upper=2,
        polytope_segments=[0], polytope_normals=[[1, 1, 1]], polytope_offsets=[4],
    )  # fmt: skip
    scene = scene_of(cube, None, None)
    low, high = np.full(3, -9.0), np.full(3, 9.0)
    (body,), _, _ = regions(scene, (0, 1, 2), low, high)
    # A cube of side 4 that lost one corner: a seventh face with three corners.
    assert sorted(len(face) for face in body.faces) == [3, 4, 4, 4, 5, 5, 5]
    (shadow,), _, omitted = regions(scene, (0, 1), low, high)
    assert not omitted
    assert {tuple(c) for c in shadow.faces[0].round(9).tolist()} == {
        (-2, -2), (2, -2), (2, 2), (-2, 2),
    }  # fmt: skip
    model = walk(3, 3, **strips(walk(3, 3), 0.5))
    for axes in (None, (0, 2), (1,)):
        ct.plot(model, spline(model), axes=axes).canvas.draw()
    empty = MinimumSnap(
        [[FREE, FREE], [FREE, FREE]], [0, 1],
        polytope_segments=[0, 0], polytope_normals=[[1, 0], [-1, 0]], polytope_offsets=[0, -1],
    )  # fmt: skip
    ct.plot(empty).canvas.draw()
    assert "corridor" not in legend(ct.plot(empty))


def test_half_spaces_that_cannot_be_shown_are_told():
    model = MinimumSnap(
        [[0] * 4, [1] * 4], [0, 1],
        polytope_segments=[0, 0], polytope_normals=[[1, 0, 0, 1], [1, 0, 0, 0]],
        polytope_offsets=[9, 2],
    )  # fmt: skip
    assert "tilted half-spaces left out" in words(ct.plot(model))
    assert "tilted half-spaces left out" not in words(ct.plot(model, axes=(1, 2)))


def test_free_coordinates():
    waypoints = walk(6, 2).waypoints.copy()
    waypoints[2, 1] = waypoints[4] = FREE
    model = MinimumSnap(waypoints, walk(6, 2).times)
    plan = spline(walk(6, 2))
    figure = ct.plot(model, plan)
    assert "waypoint, partly free" in legend(figure)
    partly = next(c for c in path(figure).collections if c.get_label() == "waypoint, partly free")
    assert partly.get_offsets().tolist() == [pytest.approx(plan(model.times[2]).tolist())]
    assert [text.get_text() for text in path(figure).texts] == list("012356")
    none = ct.plot(model)
    assert [text.get_text() for text in path(none).texts] == list("01356")
    everything = MinimumSnap(np.full((3, 2), FREE), [0, 1, 2])
    ct.plot(everything).canvas.draw()


# -- plans that are not valid --------------------------------------------------------------------


def test_the_worst_violation_is_marked():
    bare = walk(5, 2)
    plan = spline(bare)
    worst = plan.extremes(1)
    peak = max(worst.largest.max(), -worst.least.min())
    model = walk(5, 2, velocity_limit=0.8 * peak)
    figure = ct.plot(model, plan)
    assert figure.get_suptitle().endswith("\nNOT VALID: velocity limit")
    (mark,) = lines(panels(figure)["velocity"], "violation")
    (t,), (value,) = mark.get_data()
    assert abs(value) == pytest.approx(peak)
    assert np.abs(plan(t, 1)).max() == pytest.approx(peak)
    ring = next(c for c in path(figure).collections if c.get_label() == "worst violation")
    assert ring.get_offsets()[0].tolist() == pytest.approx(plan(t).tolist())
    told = panels(figure)["velocity"].get_title(loc="right")
    assert told.startswith(f"velocity limit violated by {number(0.2 * peak, 3)} m/s at ")
    # Where no panel shows it, it is told beside the path.
    assert told in words(ct.plot(model, plan, derivatives=(0, 2)))
    assert ct.plot(bare, plan)._suptitle.get_color() != figure._suptitle.get_color() == "#C8102E"


@pytest.mark.parametrize("dimensions", [2, 3])
def test_polytopes_that_are_left(dimensions):
    bare = walk(5, dimensions)
    model = walk(5, dimensions, **strips(bare, 0.05))
    plan = spline(bare)
    figure = ct.plot(model, plan)
    (found,) = (c for c in model.verify(plan).checks if c.name == "polytope")
    assert not found.ok
    assert f"t = {scene_of(model, plan, None).marks[0].time:.6g} s" in found.where
    assert any(text.startswith("polytope violated by") for text in words(figure))
    assert "worst violation" in legend(figure)


def test_every_broken_condition_draws():
    model = walk(5, 2, derivatives=[[[FREE, FREE]]] * 6, corridor_lower=-50, velocity_limit=90)
    good = spline(model)
    rng = np.random.default_rng(3)
    seen = set()
    for power in range(8):
        c = good.coefficients.copy()
        c[rng.integers(5), power] += rng.normal(size=2) * 10.0 ** rng.integers(-3, 3)
        plan = Trajectory(good.times, c)
        found = [check for check in model.verify(plan).checks if not check.ok]
        scene = scene_of(model, plan, None)
        assert [mark.check for mark in scene.marks] == found
        for mark in scene.marks:
            assert good.times[0] <= mark.time <= good.times[-1]
            assert f"(t = {mark.time:.6g} s)" in mark.check.where
        figure = ct.plot(model, plan)
        figure.canvas.draw()
        assert figure.get_suptitle().count("NOT VALID") == bool(found)
        seen |= {check.name for check in found}
    assert {"waypoints", "continuity of velocity", "velocity at the ends"} <= seen
    late = Trajectory(good.times + 1, good.coefficients)
    figure = ct.plot(model, late)
    assert "NOT VALID: times" in figure.get_suptitle()
    wild = Trajectory(good.times, 1e150 * good.coefficients)
    ct.plot(model, wild).canvas.draw()
    still = Trajectory([0, 1, 2], np.zeros((2, 1, 3)))
    ct.plot(MinimumSnap(np.zeros((3, 3)), [0, 1, 2]), still).canvas.draw()


def test_plans_of_another_shape_are_refused():
    model = walk(5, 2)
    with pytest.raises(InvalidData, match="plan must be a Trajectory, got 'x'"):
        ct.plot(model, "x")
    for other in (walk(4, 2), walk(5, 3)):
        with pytest.raises(InvalidData, match=r"plan has . segments in .-D, the model 5 in 2-D"):
            ct.plot(model, spline(other))


# -- what is accepted ----------------------------------------------------------------------------


def test_plans_in_any_form():
    model = walk(5, 2)
    plan = spline(model)
    wanted = ct.plot(model, plan).get_suptitle()
    for form in (model.plan_to_data(plan), SimpleNamespace(plan=plan), plan.to_ppoly()):
        assert ct.plot(model, form).get_suptitle() == wanted
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
    knots = next(c for c in panels(figure)["velocity"].collections if len(c.get_paths()) == 6)
    assert [p.vertices[0, 0] for p in knots.get_paths()] == plan.times.tolist()
    assert len(lines(panels(figure)["velocity"], "violation")) == 1
    for axes in (None, (0,)):
        alone = trajectory.draw(free, axes=axes)
        assert alone.get_suptitle() == "times to choose"
    assert path(alone).get_xlabel() == "knot"


def test_data_alone():
    for dimensions in (1, 2, 3, 4):
        bare = walk(5, dimensions)
        model = walk(5, dimensions, **boxes(bare, 0.5))
        figure = ct.plot(model)
        figure.canvas.draw()
        assert len(figure.axes) == 1
        assert not any("speed" in word for word in words(figure))


def test_options():
    model = walk(4, 4)
    plan = spline(model)
    figure = ct.plot(
        model, plan, axes=(0, 3), derivatives=2, names=("x", "y", "z", "yaw"), labels=False,
        size=(8, 4),
    )  # fmt: skip
    assert list(panels(figure)) == ["position", "velocity", "acceleration"]
    assert path(figure).get_ylabel() == "yaw (m)"
    assert path(figure).texts[:] == []
    assert "speed along x, yaw (m/s)" in words(figure)
    assert figure.get_size_inches().tolist() == [8, 4]
    assert list(panels(ct.plot(model, plan, derivatives=(3, 1)))) == ["velocity", "jerk"]
    alone = ct.plot(model, plan, derivatives=(), axes=(2,))
    assert panels(alone) == {}
    assert path(alone).get_ylabel() == "z (m)"
    assert path(alone).get_xlabel() == "time (s)"
    for size in ((1, 1), (3, 2), (30, 20)):
        ct.plot(model, plan, size=size).canvas.draw()


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"axes": (0, 2)}, "axes", r"different axes from 0 to 1, got \(0, 2\)"),
        ({"axes": (1, 1)}, "axes", "1 to 3 different axes"),
        ({"axes": ()}, "axes", r"got \(\)"),
        ({"axes": "xy"}, "axes", "got 'xy'"),
        ({"axes": 0}, "axes", "got 0"),
        ({"axes": (0.0, 1)}, "axes", "got"),
        ({"derivatives": -1}, "derivatives", "from 0 to 15, .* got -1"),
        ({"derivatives": True}, "derivatives", "got True"),
        ({"derivatives": (1, 1)}, "derivatives", "different ones"),
        ({"derivatives": (1, 99)}, "derivatives", r"got \(1, 99\)"),
        ({"names": ("x",)}, "names", "must hold 2 different words"),
        ({"names": ("x", "x")}, "names", "different"),
        ({"names": ("x", 2)}, "names", "got"),
        ({"names": "xy"}, "names", "got 'xy'"),
        ({"labels": "yes"}, "labels", "must be True, False or None, got 'yes'"),
        ({"size": (0, 3)}, "size", r"width and height in inches.* got \(0, 3\)"),
        ({"size": "big"}, "size", "got 'big'"),
    ],
)
def test_values_that_are_not_allowed(options, field, message):
    model = walk(3, 2)
    with pytest.raises(InvalidData, match=message) as caught:
        ct.plot(model, spline(model), **options)
    assert caught.value.field == field


def test_unknown_options():
    known = "axes, derivatives, names, labels, title, size"
    with pytest.raises(UnsupportedOption, match=f"no option 'color'; its options: {known}"):
        ct.plot(walk(3, 2), color="red")


# -- size and state ------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("shape", ["boxes", "polytopes"])
def test_a_thousand_segments_are_as_many_artists_as_a_hundred(dimensions, shape):
    counts, pieces = [], []
    for segments in (100, 1000):
        bare = walk(segments, dimensions)
        region = boxes(bare, 9.0) if shape == "boxes" else strips(bare, 9.0)
        model = walk(segments, dimensions, velocity_limit=50, **region)
        figure = ct.plot(model, spline(bare))
        counts.append(artists(figure))
        way = next(c for c in path(figure).collections if c.get_array() is not None)
        pieces.append(len(way.get_array()))
        if segments == 1000:
            figure.canvas.draw()
            regions_drawn = "corridor (400 of 1000 drawn)" if dimensions == 3 else "corridor"
            assert regions_drawn in legend(figure)
    # The rings of the waypoints are one artist, left out where they are too many.
    assert counts[1] == counts[0] - 1 < 250
    assert max(pieces) <= 8000


def test_many_segments_are_thinned():
    model = walk(30_000, 1)
    figure = ct.plot(model, spline(model), derivatives=(1,))
    (line,) = lines(panels(figure)["velocity"], "axis 0")
    assert len(line.get_xdata()) <= 8000
    assert line.get_xdata()[[0, -1]].tolist() == model.times[[0, -1]].tolist()


def test_no_pyplot():
    code = (
        "import sys, crosstrack as ct; from crosstrack.models import MinimumSnap; "
        "m = MinimumSnap([[0, 0, 0], [1, 1, 1]], [0, 1]); assert 'matplotlib' not in sys.modules; "
        "ct.plot(m).canvas.draw(); assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={"MPLBACKEND": "TkAgg"})


def test_numbers_and_units_for_people():
    assert number(6566.4812) == "6566.48"
    assert number(-1.5) == "−1.5"
    assert number(1.234567e9) == "1.23457×10⁹"
    assert number(2e-7) == "2×10⁻⁷"
    assert pretty_unit("m/s^2") == "m/s²"
    assert pretty_unit("m²/s^11") == "m²/s¹¹"
    assert pretty_unit("m") == "m"
