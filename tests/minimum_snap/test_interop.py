"""Trajectories in and out: SciPy, Bézier, poly7, samples, waypoints, and public files."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import BPoly, PPoly, make_interp_spline

import crosstrack as ct
from crosstrack import instances
from crosstrack.errors import InvalidData
from crosstrack.instances import Poly7, read_poly7, write_poly7
from crosstrack.instances.minimum_snap import PIECES_THAT_FIT, random_walk, sample_columns
from crosstrack.models import MinimumDerivative, MinimumSnap
from crosstrack.models.minimum_snap.trajectory import Trajectory

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "minimum-snap"
HEADER = ",".join(["duration", *(f"{a}^{k}" for a in ("x", "y", "z", "yaw") for k in range(8))])


def public(name):
    """A public file, or a skipped test."""
    path = PUBLIC / name
    if not path.exists():
        pytest.skip(f"the public file {name} is not beside the project")
    return path


def drawn(segments=5, degree=7, dimensions=3, seed=0, low=0.3, high=3.0):
    """A trajectory at random: not continuous, so that nothing is hidden."""
    rng = np.random.default_rng(seed)
    times = rng.normal() + np.concatenate([[0], np.cumsum(rng.uniform(low, high, segments))])
    return Trajectory(times, rng.normal(size=(segments, degree + 1, dimensions)))


def smooth(segments=5, dimensions=3, seed=0):
    """An optimum by SciPy's spline."""
    model = random_walk(segments, dimensions, seed)
    return model, spline(model.times, model.waypoints)


def spline(times, points, order=4, start=None, end=None):
    """SciPy's spline of degree 2r - 1 as a trajectory; at rest where no derivatives are given."""
    rest = [(j, np.zeros(points.shape[1])) for j in range(1, order)]
    ends = (rest if start is None else start, rest if end is None else end)
    found = make_interp_spline(times, points, k=2 * order - 1, bc_type=ends)
    rows = [found(times[:-1], nu=j) / math.factorial(j) for j in range(2 * order)]
    scale = np.diff(times)[:, None] ** np.arange(2.0 * order)
    return Trajectory(times, np.stack(rows, axis=1) * scale[:, :, None])


def dense(model):
    """The optimum from the dense optimality system of the local powers."""
    program = model.formulate("legendre").program
    hessian, rows = program.hessian.toarray(), program.matrix.toarray()
    count = len(rows)
    system = np.block([[hessian, rows.T], [rows, np.zeros((count, count))]])
    point = np.linalg.solve(system, np.concatenate([-program.cost, program.row_lower]))
    return model.formulate("legendre").decode(point[: len(hessian)])


# -- SciPy and Bézier --------------------------------------------------------------------------------


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


# -- poly7 -------------------------------------------------------------------------------------------


numbers = st.floats(-1e6, 1e6).map(lambda x: x + 0.0)
tables = st.integers(1, 5).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(1e-3, 1e3), min_size=n, max_size=n),
        st.lists(st.lists(numbers, min_size=32, max_size=32), min_size=n, max_size=n),
    )
)


@given(tables)
@settings(max_examples=50, deadline=None)
def test_poly7_files_are_exact(tmp_path_factory, table):
    """All digits: every number. 4 bytes: what the firmware stores, and the same text ever after."""
    path = tmp_path_factory.mktemp("poly7") / "p.csv"
    pieces = Poly7(table[0], np.reshape(table[1], (-1, 4, 8)))
    path.write_text(pieces.text("float64"))
    again = Poly7.read(path)
    assert again.durations.tobytes() == pieces.durations.tobytes()
    assert again.coefficients.tobytes() == pieces.coefficients.tobytes()
    path.write_text(pieces.text("float32"))
    stored, rounded = Poly7.read(path), pieces.rounded()
    for have, want in ((stored.durations, rounded.durations), (stored.coefficients, rounded.coefficients)):  # fmt: skip
        assert have.astype(np.float32).tobytes() == want.astype(np.float32).tobytes()


@given(
    st.integers(1, 12),
    st.integers(1, 4),
    st.integers(0, 10**6),
    st.sampled_from(["float32", "float64"]),
)
@settings(max_examples=40, deadline=None)
def test_poly7_round_trip_within_what_is_reported(
    tmp_path_factory, segments, dimensions, seed, precision
):
    path = tmp_path_factory.mktemp("poly7") / "p.csv"
    plan = smooth(segments, dimensions, seed)[1]
    report = write_poly7(plan, path, precision=precision)
    back = read_poly7(path, start=plan.times[0])
    text = path.read_text()
    if precision == "float32":
        # Once rounded, it stays as it is; the firmware reads the digits as 4-byte floats.
        write_poly7(back, path)
        assert path.read_text() == text
        back = Poly7.read(path).rounded().trajectory(plan.times[0])
    assert (back.segments, back.dimensions, back.degree) == (segments, 4, 7)
    assert report.pieces == segments and report.fits
    assert not back.coefficients[:, :, dimensions:].any()
    if precision == "float64":
        np.testing.assert_allclose(back.times, plan.times, atol=1e-13 * plan.duration)
        np.testing.assert_allclose(
            back.coefficients[:, :, :dimensions], plan.coefficients, rtol=1e-12, atol=1e-12
        )
        # The report is of what the firmware makes of it, whatever digits the file has.
        assert max(map(max, report.jumps)) > 0 or segments == 1
        return
    for order in range(4):
        begin, end = back.at_ends(order)
        jump = np.abs(begin[1:] - end[:-1]).max(axis=0, initial=0.0)
        reported = np.array(report.jumps[order])
        np.testing.assert_allclose(jump, reported, rtol=1e-4, atol=1e-11 * 100**order)
        # The plan's own jumps are rounding in eight bytes.
        caused = np.array(report.rounding_jumps[order])
        np.testing.assert_allclose(caused, reported, rtol=1e-3, atol=1e-9 * 100**order)
    drift = back.at_ends()[1][-1, :dimensions] - plan.at_ends()[1][-1]
    np.testing.assert_allclose(drift, report.end_drift[:dimensions], atol=1e-11)
    assert back.duration - plan.duration == pytest.approx(report.time_drift, abs=1e-12)


def test_poly7_is_refused_before_a_file_is_touched():
    plan = smooth(32, 3, 1)[1]
    assert PIECES_THAT_FIT == 31
    path = Path("nowhere") / "p.csv"
    with pytest.raises(InvalidData, match=r"at most 31 pieces.*4096 bytes.*got 32"):
        write_poly7(plan, path, strict=True)
    with pytest.raises(InvalidData, match="cannot be written"):
        write_poly7(plan, path)


def test_poly7_report_in_words(tmp_path):
    path = tmp_path / "p.csv"
    plan = smooth(32, 3, 1)[1]
    report = write_poly7(plan, path)
    assert not report.fits
    assert report.bytes_needed == 32 * 132
    text = str(report)
    assert "TOO MANY, the firmware holds 31" in text
    assert "largest jump of jerk" in text
    data = json.loads(json.dumps(report.to_dict()))
    assert data["fits"] is False and data["limit"] == 31 and len(data["jumps"]) == 4
    assert 0 < report.jumps[0][0] < 1e-5
    assert "yaw" not in text
    assert "rad/s by rounding" in str(write_poly7(smooth(3, 4)[1], path))
    write_poly7(plan, path)
    before = path.read_text()
    with pytest.raises(InvalidData, match="31"):
        write_poly7(plan, path, strict=True)
    assert path.read_text() == before
    fits = write_poly7(smooth(31)[1], path, strict=True)
    assert fits.fits and "TOO MANY" not in str(fits)


def test_rounding_jumps_leave_the_trajectorys_own_out(tmp_path):
    plan = drawn(4, 7, 3, 5)  # jumps by itself
    report = write_poly7(plan, tmp_path / "p.csv")
    assert max(report.jumps[0]) > 0.1
    assert 0 < max(report.rounding_jumps[0]) < 1e-4
    single = write_poly7(drawn(1), tmp_path / "p.csv")
    assert single.jumps == ((0.0,) * 4,) * 4


def test_poly7_axes_and_yaw(tmp_path):
    path = tmp_path / "p.csv"
    model, plan = smooth(3, 2, 7)
    write_poly7(plan, path, yaw=0.5)
    t = np.linspace(0, plan.duration, 9)[:-1]
    back = read_poly7(path)
    np.testing.assert_allclose(back(t)[:, :2], plan(t), atol=1e-5)
    assert not back(t)[:, 2].any()
    np.testing.assert_array_equal(back(t)[:, 3], 0.5)
    turn = spline(plan.times, model.waypoints[:, :1])
    write_poly7(plan, path, yaw=turn, precision="float64")
    np.testing.assert_allclose(read_poly7(path)(t)[:, 3], turn(t)[:, 0], atol=1e-11)
    four = drawn(2, 5, 4)
    write_poly7(four, path, precision="float64")
    back = read_poly7(path, start=float(four.times[0]))
    assert not back.coefficients[:, 6:].any()
    np.testing.assert_allclose(back.coefficients[:, :6], four.coefficients, rtol=1e-12)
    # Zeros above degree 7 are no obstacle.
    padded = Trajectory(four.times, np.pad(four.coefficients, ((0, 0), (0, 4), (0, 0))))
    text = path.read_text()
    write_poly7(padded, path, precision="float64")
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: write_poly7(drawn(degree=9), p), "degree <= 7, got 9.*degree=7"),
        (lambda p: write_poly7(drawn(dimensions=5), p), "1 to 4 dimensions.*got 5"),
        (lambda p: write_poly7([1], p), "must be a Trajectory, got list"),
        (lambda p: write_poly7(drawn(dimensions=4), p, yaw=0.0), "fourth axis is yaw"),
        (lambda p: write_poly7(drawn(), p, yaw=math.inf), "yaw must be finite"),
        (lambda p: write_poly7(drawn(), p, yaw="north"), "yaw must be a number"),
        (lambda p: write_poly7(drawn(), p, yaw=drawn(dimensions=1, seed=9)), "knots of the traj"),
        (lambda p: write_poly7(drawn(), p, yaw=drawn(dimensions=2)), "1-dimensional"),
        (lambda p: write_poly7(drawn(), p, precision="half"), "float32, float64, got 'half'"),
        (lambda p: write_poly7(drawn(low=1e-7, high=2e-7), p), "4-byte float, got .*lasts"),
        (lambda p: write_poly7(Trajectory([0, 1e39], [[[1.0]]]), p), "duration of piece 0 must"),
        (lambda p: write_poly7(Trajectory([0, 1e-50], [[[0.0], [1]]]), p), "4-byte|no finite"),
        (lambda p: Poly7([], np.zeros((0, 4, 8))), "at least 1 entry"),
        (lambda p: Poly7([0.0], np.zeros((1, 4, 8))), r"durations\[0\] must be > 0"),
        (lambda p: Poly7([1.0], np.zeros((1, 3, 8))), "shape"),
    ],
)
def test_what_poly7_cannot_hold(call, message, tmp_path):
    path = tmp_path / "p.csv"
    with pytest.raises(InvalidData, match=message):
        call(path)
    assert not path.exists()


ROW = ",".join(["1.5", *map(str, range(32))])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"line 1, column 1: the header must hold 'duration', got nothing"),
        (ROW, r"line 1, column 1: the header must hold 'duration', got '1\.5'"),
        (HEADER.replace("x^1", "x1") + "\n" + ROW, r"line 1, column 3.*'x\^1', got 'x1'"),
        (HEADER.replace(",yaw^7", "") + "\n" + ROW, r"line 1, column 33.*'yaw\^7', got nothing"),
        (HEADER + ",w\n" + ROW, r"line 1: 34 columns where 33 are allowed.*'w'"),
        (HEADER, "no piece below the header"),
        (HEADER + "\n" + ROW + ",1", r"line 2: 34 values where 33 are allowed"),
        (HEADER + "\n\n" + ROW.removesuffix(",31"), r"line 3: 32 values where 33"),
        (HEADER + "\n" + ROW.replace(",9,", ",nan,"), r"line 2, column y\^1: must be a finite number, got 'nan'"),
        (HEADER + "\n" + ROW.replace(",9,", ",1e999,"), r"line 2, column y\^1: must be a finite"),
        (HEADER + "\n" + ROW.replace(",9,", ",,"), r"line 2, column y\^1: must be a finite number, got ''"),
        (HEADER + "\n" + ROW.replace(",9,", ",1_0,"), r"line 2, column y\^1"),
        (HEADER + "\n" + ROW + "\n" + ROW.replace("1.5", "0", 1), r"line 3, column duration: must be > 0 s, got '0'"),
        (HEADER + "\n" + ROW.replace("1.5", "-2", 1), r"line 2, column duration: must be > 0"),
        (HEADER + "\n" + ROW.replace("1.5", "1e300", 1), r"coefficients\[0, 2, 0\] must be finite"),
        (HEADER + "\n" + ROW + "\n" + ROW.replace("1.5", "1e-30", 1), r"times\[2\] must be >"),
    ],
)  # fmt: skip
def test_bad_poly7_files_are_named(text, message, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InvalidData, match=rf"bad\.csv.*{message}"):
        read_poly7(path)


def test_poly7_files_of_other_tools(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(
        f"# {HEADER.replace(',', ' , ').title()} ,\r\n\r\n{ROW.replace(',', ', ')},\r\n"
    )
    assert read_poly7(path).segments == 1
    with pytest.raises(InvalidData, match="no such file"):
        read_poly7(tmp_path / "none.csv")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidData, match=r"p\.csv.*no UTF-8"):
        read_poly7(path)
    path.write_text(HEADER + "\n" + ROW)
    with pytest.raises(InvalidData, match="start must be finite"):
        read_poly7(path, start=math.nan)


def test_load_says_what_a_csv_file_is(tmp_path):
    path = tmp_path / "some.csv"
    for text, message in (
        (HEADER.upper() + "\n" + ROW, r"poly7.*a plan, and no instance.*read_poly7\(path\)"),
        ("t,x,y\n0,1,2\n", r"samples.*read_samples\(path\)"),
        ("0,1,2\n3,4,5\n", r"no times.*\"waypoints\": \"some\.csv\".*read_waypoints\(path\)"),
        ("x,y,z\n3,4,5\n", "no times"),
        ("id,x,y,z,kind\n", "no thresholds.*read_csv"),
        ("", "no times"),
    ):
        path.write_text(text)
        with pytest.raises(InvalidData, match=rf"some\.csv: a .*{message}"):
            ct.load(path)
    with pytest.raises(InvalidData, match="no such file"):
        ct.load(tmp_path / "none.csv")


# -- samples and waypoints ---------------------------------------------------------------------------


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


# -- public files ------------------------------------------------------------------------------------


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
    # Printed to six digits, the file's last point is not quite where it stops.
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
    with pytest.raises(InvalidData, match="poly7"):
        ct.load(path)


def references(name):
    """Times and derivatives of a file of minsnap_trajectories, shape (orders, samples, axes)."""
    data = pytest.importorskip("scipy.io").loadmat(public(name))
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
