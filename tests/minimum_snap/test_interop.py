"""Trajectories in and out: SciPy, Bézier, samples, waypoints, and public files."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from minimum_snap.drawn import drawn, smooth, spline
from scipy.interpolate import BPoly, PPoly

import crosstrack as ct
from crosstrack import instances
from crosstrack.errors import InvalidData
from crosstrack.instances import Poly7, read_poly7, write_poly7
from crosstrack.instances.minimum_snap import sample_columns
from crosstrack.models import MinimumDerivative, MinimumSnap
from crosstrack.models.minimum_snap.trajectory import Trajectory

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "minimum-snap"


def public(name):
    """A public file, or a skipped test."""
    path = PUBLIC / name
    if not path.exists():
        pytest.skip(f"the public file {name} is not beside the project")
    return path


def dense(model):
    """The optimum from the dense optimality system of the local powers."""
    program = model.formulate("legendre").program
    hessian, rows = program.hessian.toarray(), program.matrix.toarray()
    count = len(rows)
    system = np.block([[hessian, rows.T], [rows, np.zeros((count, count))]])
    point = np.linalg.solve(system, np.concatenate([-program.cost, program.row_lower]))
    return model.formulate("legendre").decode(point[: len(hessian)])


# -- SciPy and Bézier --------------------------------------------------------------------------


@given(st.integers(1, 8), st.integers(0, 9), st.integers(1, 4), st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_scipy_and_bezier_there_and_back(segments, degree, dimensions, seed):
    plan = drawn(segments, degree, dimensions, seed)
    t = np.linspace(plan.times[0], plan.times[-1], 57)[:-1]
    size = np.abs(plan.coefficients).sum(axis=(1, 2)).max()
    pieces, basis, control = plan.to_ppoly(), plan.to_bspline(), plan.bezier()
    curves = BPoly(np.moveaxis(control, 1, 0), plan.times)
    for order in range(min(degree, 3) + 1):
        wanted = plan(t, order)
        near = {"atol": 1e-11 * size * 40**order, "rtol": 1e-10}
        np.testing.assert_allclose(pieces(t, nu=order), wanted, **near)
        np.testing.assert_allclose(basis(t, nu=order), wanted, **near)
        np.testing.assert_allclose(curves(t, nu=order), wanted, **near)
    again = Trajectory.from_ppoly(pieces)
    assert again.times.tobytes() == plan.times.tobytes()
    np.testing.assert_allclose(again.coefficients, plan.coefficients, rtol=1e-14)
    back = Trajectory.from_bezier(plan.times, control)
    np.testing.assert_allclose(back.coefficients, plan.coefficients, atol=1e-12 * size * 4**degree)
    # The hull: no value beyond the control points.
    found = plan.extremes()
    assert (found.least >= control.min(axis=1) - 1e-12 * size).all()
    assert (found.largest <= control.max(axis=1) + 1e-12 * size).all()
    np.testing.assert_allclose(
        control[:, [0, -1]], np.stack(plan.at_ends(), axis=1), rtol=1e-12, atol=1e-12 * size
    )


def test_a_scalar_ppoly_is_one_dimensional():
    piecewise = PPoly(np.array([[1.0, 2.0], [3.0, 4.0]]), [0.0, 1.0, 3.0])
    plan = Trajectory.from_ppoly(piecewise)
    assert plan.dimensions == 1
    assert plan(2.0).tolist() == [float(piecewise(2.0))]
    with pytest.raises(InvalidData, match="2 or 3 dimensions"):
        Trajectory.from_ppoly(PPoly(np.zeros((2, 1, 2, 2)), [0.0, 1.0]))


def test_a_ppoly_is_a_plan():
    model, plan = smooth()
    assert ct.verify(model, plan.to_ppoly()).ok


def test_bezier_files(tmp_path):
    plan = smooth()[1]
    path = instances.write_bezier(plan, tmp_path / "b.json")
    back = instances.read_bezier(path)
    assert back.times.tobytes() == plan.times.tobytes()
    np.testing.assert_allclose(back.bezier(), plan.bezier(), atol=1e-12)
    assert json.loads(path.read_text())["points"] == plan.bezier().tolist()
    for text, message in (
        ("[]", "must hold exactly"),
        ("{", "no valid JSON"),
        ('{"times": [0, 1]}', "must hold exactly"),
        ('{"times": [0, 0], "points": [[[1]]]}', r"times\[1\] must be >"),
        ('{"times": [0, 1], "points": [[["a"]]]}', r"points\[0, 0, 0\] must be a number"),
        ('{"times": [0, 1], "points": []}', "points|coefficients"),
    ):
        path.write_text(text)
        with pytest.raises(InvalidData, match=rf"b\.json.*({message})"):
            instances.read_bezier(path)


# -- samples and waypoints ---------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4, 6])
def test_samples_there_and_back(dimensions, tmp_path):
    plan = smooth(3, dimensions, 2)[1]
    path = instances.write_samples(plan, tmp_path / "s.csv", rate=50)
    found = instances.read_samples(path)
    assert found.values.shape == (5, found.times.size, dimensions)
    assert found.times[0] == plan.times[0] and found.times[-1] == plan.times[-1]
    np.testing.assert_allclose(np.diff(found.times)[:-1], 0.02, rtol=1e-9)
    for order in range(5):
        np.testing.assert_array_equal(found.values[order], plan(found.times, order) + 0.0)
    few = instances.read_samples(instances.write_samples(plan, path, rate=3, derivatives=0))
    assert few.values.shape == (1, few.times.size, dimensions)


def test_columns_of_samples():
    assert ",".join(sample_columns(3, 2)) == "t,x,y,z,vx,vy,vz,ax,ay,az"
    assert ",".join(sample_columns(4, 1)) == "t,x,y,z,yaw,vx,vy,vz,vyaw"
    assert ",".join(sample_columns(1, 6)) == "t,x,vx,ax,jx,sx,d5x,d6x"
    assert ",".join(sample_columns(5, 0)) == "t,x0,x1,x2,x3,x4"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must be the header of samples"),
        ("0,1,2\n", "line 1: must be the header"),
        ("t,x,y,vx\n", "line 1: must be the header"),
        ("t,x,y\n", "no samples below"),
        ("t,x,y\n0,1\n", "line 2: 2 values where 3 are allowed: t to y"),
        ("t,x,y\n0,1,a\n", "line 2, column y: must be a finite number, got 'a'"),
        ("t,x\n0,1\n0,1\n", "line 3, column t: must be > 0.0, the time before, got 0.0"),
    ],
)
def test_bad_samples_are_named(text, message, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InvalidData, match=rf"bad\.csv.*{message}"):
        instances.read_samples(path)


def test_samples_need_a_rate(tmp_path):
    with pytest.raises(InvalidData, match="rate must be > 0"):
        instances.write_samples(drawn(), tmp_path / "s.csv", rate=0)
    with pytest.raises(InvalidData, match="derivative must be"):
        instances.write_samples(drawn(), tmp_path / "s.csv", derivatives=-1)
    assert not (tmp_path / "s.csv").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "at least 2 waypoints, got 0"),
        ("1,2,3\n", "at least 2 waypoints, got 1"),
        ("1,2,3\n4,5\n", "line 2: 2 values where 3 are allowed: x to z"),
        ("x,y\n1,2\n3,oops\n", "line 3, column y: must be a finite number, got 'oops'"),
        ("1,2\n3,inf\n", "line 2, column y"),
        ("t,x,y\n1,2,3\n", "line 1: a column of times"),
    ],
)
def test_bad_waypoints_are_named(text, message, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InvalidData, match=rf"bad\.csv.*{message}"):
        instances.read_waypoints(path)


def test_waypoints(tmp_path):
    path = tmp_path / "w.csv"
    path.write_text("# x, y\n\n1,2\n 3 , -4e0,\n")
    assert instances.read_waypoints(path).tolist() == [[1, 2], [3, -4]]
    path.write_text("1,2,3,4,5\n6,7,8,9,10\n")
    assert instances.read_waypoints(path).shape == (2, 5)


# -- public files ------------------------------------------------------------------------------


def test_figure8():
    """Crazyswarm's figure eight: C4 only, and two optima with its waypoints and times."""
    path = public("crazyswarm__matlab_trajectorygen_figure8.csv")
    plan = read_poly7(path)
    assert plan.segments == 10
    assert float(plan.integral_of_square(4).sum()) == pytest.approx(1978.897, abs=5e-4)
    for order, near in ((0, 1e-5), (1, 1e-4), (2, 1e-3), (3, 1e-2), (4, 0.1)):
        begin, end = plan.at_ends(order)
        assert np.abs(begin[1:] - end[:-1]).max() < near, order
    begin, end = plan.at_ends(5)
    assert np.abs(begin[1:] - end[:-1]).max() > 1
    points = plan(plan.times)
    # Printed to six digits, the file's last point differs slightly from its end point.
    rest = MinimumSnap(waypoints=points, times=plan.times)
    open_jerk = MinimumSnap(
        waypoints=points, times=plan.times, start=np.zeros((2, 4)), end=np.zeros((2, 4))
    )
    natural = [(1, np.zeros(4)), (2, np.zeros(4)), (4, np.zeros(4))]
    for model, start, wanted in (
        (rest, None, 2023.458229),
        (open_jerk, natural, 952.318904),
    ):
        for optimum in (spline(plan.times, points, start=start, end=start), dense(model)):
            found = model.verify(optimum)
            assert found.ok, str(found)
            assert found.objective == pytest.approx(wanted, abs=5e-6 * wanted / 1000)
        solution = ct.solve(model)
        assert solution.verification.ok
        assert solution.primal_bound == pytest.approx(wanted, rel=1e-6)


def test_figure8_flies_again(tmp_path):
    path = public("crazyswarm__matlab_trajectorygen_figure8.csv")
    plan = read_poly7(path)
    report = write_poly7(plan, tmp_path / "p.csv", strict=True)
    assert report.pieces == 10
    assert max(report.rounding_jumps[0]) < 1e-6
    one = Poly7.read(path)
    two = Poly7.read(tmp_path / "p.csv")
    np.testing.assert_array_equal(two.rounded().coefficients, one.rounded().coefficients)
    np.testing.assert_allclose(two.coefficients, one.coefficients, rtol=1e-7)
    assert ct.load(path).segments == plan.segments == 10


def references(name):
    """Times and derivatives of a file of minsnap_trajectories, shape (orders, samples, axes)."""
    data = pytest.importorskip("scipy.io", reason="scipy.io is not installed").loadmat(public(name))
    return data["sample_time"].ravel(), data["kinematic_references"]


SYMAO = np.array([0, 0.5400960100096803, 1.3039071123489652, 3.5307800095935304, 5])


def symao(t, values):
    """The minimum-jerk problem of the file, its waypoints read off its samples."""
    inner = [int(np.abs(t - knot).argmin()) for knot in SYMAO[:-1]]
    assert np.abs(t[inner] - SYMAO[:-1]).max() < 1e-12
    last = np.round(values[0, -1], 3)  # the samples end just before
    points = np.round(np.concatenate([values[0, inner], [last]]), 6)
    return MinimumDerivative(waypoints=points, times=SYMAO, order=3)


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("minsnap_trajectories__symao_closed_form.mat", 1e-11),
        ("minsnap_trajectories__symao_simple.mat", 5e-6),
    ],
)
def test_symao(name, near):
    t, values = references(name)
    model = symao(t, values)
    for plan in (
        spline(model.times, model.waypoints, order=3),
        dense(model),
        ct.solve(model).plan,
    ):
        assert model.verify(plan).ok
        for order in range(4):
            wanted = values[order]
            # A sample at a knot speaks for one side of a jump.
            far = np.abs(t[:, None] - SYMAO).min(axis=1) > 1e-9
            off = np.abs(plan(t[far], order) - wanted[far]) / np.abs(wanted).max()
            assert off.max() < near, (order, off.max())


def test_icsl_jeon():
    """Degree 8, acceleration and jerk weighed alike, derivatives 0 to 4 continuous."""
    t, values = references("minsnap_trajectories__icsl_jeon_3d.mat")
    times = np.array([0.0, 2.0, 4.0, 7.0])
    points = np.round([values[0, int(np.abs(t - knot).argmin())] for knot in times], 3)
    assert np.abs(t - 2).min() < 1e-9
    model = MinimumDerivative(
        waypoints=points, times=times, order=3, weights=np.array([0.0, 1.0, 1.0]), degree=8, continuity=4,
    )  # fmt: skip
    for plan in (dense(model), ct.solve(model).plan):
        assert model.verify(plan).ok
        for order in range(4):
            np.testing.assert_allclose(plan(t, order), values[order], atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", ["takeoff", "waypoints1"])
def test_uav_trajectories(name):
    points = instances.read_waypoints(public(f"uav_trajectories__{name}.csv"))
    assert points.shape[1] == 3
    assert len(points) >= 2
    times = instances.times_by_distance(points)
    model = MinimumSnap(waypoints=points, times=times)
    found = model.verify(spline(times, points))
    assert found.ok, str(found)


@pytest.mark.parametrize("header", ["x,y", "X, Y", "px,py", "east,north", "e,n", "x0,x1", "# x,y"])
def test_headers_of_waypoints_name_coordinates_in_order(header, tmp_path):
    file = tmp_path / "way.csv"
    file.write_text(f"{header}\n1,2\n3,4\n", "utf-8")
    assert instances.read_waypoints(file).tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("header", ["y,x", "x,x", "x,vx", "id,x", "x,radius", "lat,lon", "x1,x2"])
def test_other_columns_are_not_taken_for_coordinates(header, tmp_path):
    file = tmp_path / "way.csv"
    file.write_text(f"{header}\n1,2\n3,4\n", "utf-8")
    with pytest.raises(
        InvalidData, match="line 1: must name coordinates in their order, x,y,z,yaw"
    ):
        instances.read_waypoints(file)
