"""Figures of trajectories with any number of axes, feasible or not."""

import numpy as np
import pytest
from pictures import artists, legend, render, words
from walks import boxes, derivatives, path, solved, spline, strips, walk

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FREE, MinimumDerivative, MinimumSnap, Trajectory
from crosstrack.models.minimum_snap.plot.data import Scene, regions
from crosstrack.models.plots.style import number

# -- what is drawn -------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4])
def test_any_number_of_axes(dimensions, tmp_path):
    model = walk(5, dimensions)
    plan, names = spline(model), ["x", "y", "z", "axis 3"][:dimensions]
    figure = ct.plot(model, plan)
    if dimensions == 3:
        figure.savefig(tmp_path / "path.png", dpi=50)
    assert path(figure).name == ("3d" if dimensions > 2 else "rectilinear")
    drawn = derivatives(figure)
    # With one axis, the left half shows the position.
    assert next(iter(drawn)) == ("velocity" if dimensions == 1 else "position")
    assert list(drawn)[-1] == "snap"
    for order, word in enumerate(("position", "velocity", "acceleration", "jerk", "snap")):
        if word not in drawn:
            continue
        for axis in range(dimensions):
            (line,) = artists(drawn[word], f"curve {names[axis]}")
            t, value = line.get_data()
            inside = ~np.isin(t, plan.times)
            assert inside.sum() > 100
            wanted = plan(t[inside], order)[:, axis]
            assert value[inside] == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    assert [w for w in legend(figure) if w in (*"xyz", "axis 3")] == names
    assert drawn["acceleration"].get_ylabel() == "acceleration\n(m/s²)"


def test_title_states_objective_and_size():
    model = walk(5, 2, name="minimum-snap/walk")
    plan = spline(model)
    objective = number(model.objective(plan))
    assert ct.plot(model, plan, derivatives=()).get_suptitle() == (
        f"minimum-snap/walk  ·  minimum snap, 5 segments, J = {objective} m²/s⁷, 6 s"
    )
    one = MinimumDerivative([[0.0], [1.0]], [0, 2], order=2, weights=[1, 0.5])
    straight = Trajectory([0, 2], [[[0.0], [0], [3], [-2]]])
    assert (
        ct.plot(one, straight, derivatives=())
        .get_suptitle()
        .startswith("minimum velocity + acceleration, 1 segment, J = ")
    )
    assert ct.plot(model).get_suptitle() == "minimum-snap/walk  ·  minimum snap, 5 segments in 2-D"
    assert ct.plot(model, plan, derivatives=(), title="Mine").get_suptitle() == "Mine"


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
    drawn = derivatives(ct.plot(model, plan))
    heights = sorted(
        {float(v) for line in artists(drawn["velocity"], "limit") for v in line.get_ydata()}
    )
    assert heights == [-3, 3]
    zones = [c for c in drawn["velocity"].collections if c.get_gid() == "forbidden"]
    assert len(zones) == 2
    # Axes with limits of their own have them in their own colours.
    own = {
        line.get_color(): abs(line.get_ydata()[0])
        for line in artists(drawn["acceleration"], "limit")
    }
    curve = [
        artists(drawn["acceleration"], f"curve {'xy'[axis]}")[0].get_color() for axis in (0, 1)
    ]
    assert own == {curve[0]: 4, curve[1]: 5}
    # A distant limit is written as text, so that the curve remains visible.
    assert artists(drawn["jerk"], "limit") == []
    assert drawn["jerk"].get_title(loc="left") == "limit ±1×10⁶"


def test_limits_change_with_the_segment():
    model = walk(3, 1, velocity_limit=[[3], [np.inf], [2]])
    upper = artists(derivatives(ct.plot(model, spline(model)))["velocity"], "limit")[1]
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
    bands = [
        c
        for c in derivatives(figure)["position"].collections
        if c.get_gid() == "corridor of an axis"
    ]
    assert len(bands) == 2
    # One box for all segments is one region.
    same = walk(6, 2, corridor_lower=-99, corridor_upper=99)
    assert len(regions(Scene(same, None, None), (0, 1), *np.array([[-9, -9], [9, 9]]))[0]) == 1


def test_polygons_of_half_spaces():
    square = MinimumSnap(
        [[0, 0], [1, 0]], [0, 1],
        polytope_segments=[0, 0], polytope_normals=[[0, 2], [-1, -1]], polytope_offsets=[2, 3],
    )  # fmt: skip
    scene = Scene(square, None, None)
    (region,), total, omitted = regions(scene, (0, 1), np.array([-4.0, -4]), np.array([4.0, 4]))
    corners = {tuple(corner) for corner in region[0].round(9).tolist()}
    assert corners == {(-4, 1), (1, -4), (4, -4), (4, 1)}
    assert (total, omitted) == (1, False)
    model = walk(4, 2, **strips(walk(4, 2), 0.4))
    render(ct.plot(model, solved(model), derivatives=()))


def test_bodies_of_half_spaces():
    cube = MinimumSnap(
        [[0, 0, 0], [1, 0, 0]], [0, 1], corridor_lower=-2, corridor_upper=2,
        polytope_segments=[0], polytope_normals=[[1, 1, 1]], polytope_offsets=[4],
    )  # fmt: skip
    scene = Scene(cube, None, None)
    low, high = np.full(3, -9.0), np.full(3, 9.0)
    (body,), _, _ = regions(scene, (0, 1, 2), low, high)
    # A cube of side 4 that lost one corner: a seventh face with three corners.
    assert sorted(len(face) for face in body) == [3, 4, 4, 4, 5, 5, 5]
    (shadow,), _, omitted = regions(scene, (0, 1), low, high)
    assert not omitted
    assert {tuple(c) for c in shadow[0].round(9).tolist()} == {
        (-2, -2), (2, -2), (2, 2), (-2, 2),
    }  # fmt: skip
    model = walk(3, 3, **strips(walk(3, 3), 0.5))
    for axes in (None, (0, 2), (1,)):
        render(ct.plot(model, spline(model), axes=axes, derivatives=()))
    empty = MinimumSnap(
        [[FREE, FREE], [FREE, FREE]], [0, 1],
        polytope_segments=[0, 0], polytope_normals=[[1, 0], [-1, 0]], polytope_offsets=[0, -1],
    )  # fmt: skip
    render(ct.plot(empty))
    assert "corridor" not in legend(ct.plot(empty))


def test_omitted_half_spaces_are_noted():
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
    render(ct.plot(everything))


# -- plans that are not valid --------------------------------------------------------------------


def test_the_worst_violation_is_marked():
    bare = walk(5, 2)
    plan = spline(bare)
    worst = plan.extremes(1)
    peak = max(worst.largest.max(), -worst.least.min())
    model = walk(5, 2, velocity_limit=0.8 * peak)
    figure = ct.plot(model, plan)
    assert figure.get_suptitle().endswith("\nNOT VALID: velocity limit")
    (mark,) = artists(derivatives(figure)["velocity"], "worst violation")
    (t,), (value,) = mark.get_data()
    assert abs(value) == pytest.approx(peak)
    assert np.abs(plan(t, 1)).max() == pytest.approx(peak)
    ring = next(c for c in path(figure).collections if c.get_label() == "worst violation")
    assert ring.get_offsets()[0].tolist() == pytest.approx(plan(t).tolist())
    told = derivatives(figure)["velocity"].get_title(loc="right")
    assert told.startswith(f"velocity limit violated by {number(0.2 * peak, 3)} m/s at ")
    # Without a panel for it, the violation is written next to the path.
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
    assert f"t = {Scene(model, plan, None).marks[0].time:.6g} s" in found.where
    assert any(text.startswith("polytope violated by") for text in words(figure))
    assert "worst violation" in legend(figure)


def test_every_broken_condition_draws():
    model = walk(5, 2, derivatives=[[[FREE, FREE]]] * 6, corridor_lower=-50, velocity_limit=90)
    good = spline(model)
    rng = np.random.default_rng(3)
    seen = set()
    for power in (1, 2, 5, 7):  # 0 would move both ends alike, and rounding decide which is worse
        c = good.coefficients.copy()
        c[rng.integers(5), power] += rng.normal(size=2) * 10.0 ** rng.integers(-3, 3)
        plan = Trajectory(good.times, c)
        found = [check for check in model.verify(plan).checks if not check.ok]
        scene = Scene(model, plan, None)
        assert [mark.check for mark in scene.marks] == found
        for mark in scene.marks:
            assert good.times[0] <= mark.time <= good.times[-1]
            assert f"(t = {mark.time:.6g} s)" in mark.check.where
        figure = ct.plot(model, plan, derivatives=(1,), labels=False)
        assert figure.get_suptitle().count("NOT VALID") == bool(found)
        seen |= {check.name for check in found}
    assert {"waypoints", "continuity of velocity", "velocity at the ends"} <= seen
    late = Trajectory(good.times + 1, good.coefficients)
    figure = ct.plot(model, late, derivatives=(1,))
    assert "NOT VALID: times" in figure.get_suptitle()
    wild = Trajectory(good.times, 1e150 * good.coefficients)
    render(ct.plot(model, wild, derivatives=2))
    still = Trajectory([0, 1, 2], np.zeros((2, 1, 3)))
    render(ct.plot(MinimumSnap(np.zeros((3, 3)), [0, 1, 2]), still))


def test_plans_of_another_shape_are_refused():
    model = walk(5, 2)
    with pytest.raises(InvalidData, match="plan must be a Trajectory, got 'x'"):
        ct.plot(model, "x")
    for other in (walk(4, 2), walk(5, 3)):
        with pytest.raises(InvalidData, match=r"plan has . segments in .-D, the model 5 in 2-D"):
            ct.plot(model, spline(other))
