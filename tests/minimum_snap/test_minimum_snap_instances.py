"""The catalogue of minimum-derivative trajectories, its generators, and known optima."""

import hashlib
import math
import warnings

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack import instances
from crosstrack.instances import Provenance, minimum_snap as ms
from crosstrack.instances.minimum_snap.corridors import corridor_with_way
from crosstrack.models import MinimumSnap, Model
from crosstrack.models.minimum_snap.trajectory import Trajectory

NAMES = [e.name for e in instances.entries() if e.name.startswith("minimum-")]
SPLINES = [
    "minimum-snap/figure-eight",
    "minimum-snap/figure-eight-yaw",
    "minimum-snap/helix",
    "minimum-snap/random-10",
    "minimum-snap/random-100",
    "minimum-snap/random-1000",
    "minimum-snap/square",
    "minimum-derivative/jerk",
    "minimum-derivative/reach",
]
# Waypoints and times of what the catalogue ships: a change of NumPy's streams would show here.
FINGERPRINTS = {
    "minimum-derivative/jerk": "5afa2759814d405d",
    "minimum-derivative/reach": "26492eded38cbced",
    "minimum-derivative/weighted": "2db5808d64e91b53",
    "minimum-snap/corridor-10": "482ac90d338c892f",
    "minimum-snap/corridor-1000": "b1a7992b3d087747",
    "minimum-snap/corridor-infeasible": "240f2d36a5970a2c",
    "minimum-snap/figure-eight": "a8987a699a30c973",
    "minimum-snap/figure-eight-yaw": "32e7f584e719ed8f",
    "minimum-snap/gate-2d": "f144eae5beeacb8a",
    "minimum-snap/helix": "a33a4e91b2bcf9f6",
    "minimum-snap/paper": "40fcd37e368b1a09",
    "minimum-snap/paper-5": "079f312f160675b0",
    "minimum-snap/paper-late": "e8d0614156ed11e8",
    "minimum-snap/random-10": "b3585a3f950040fd",
    "minimum-snap/random-100": "95f38e4667cfacb7",
    "minimum-snap/random-1000": "36dca86ba575aef4",
    "minimum-snap/square": "78eb772d5d51056e",
}
# Our own figures by SciPy's spline, and for corridors by PIQP and Clarabel to 1e-6.
OPTIMA = {
    "minimum-snap/figure-eight": 1446.2736589572,
    "minimum-snap/figure-eight-yaw": 2012.8113380833,
    "minimum-snap/helix": 1500.5786250995,
    "minimum-snap/random-10": 15463.567864144,
    "minimum-snap/random-100": 23430.115302504,
    "minimum-snap/random-1000": 331985.53780296,
    "minimum-snap/square": 20.448652172588,
    "minimum-derivative/jerk": 1111.5332915900,
    "minimum-derivative/reach": 197.75390625,
    "minimum-snap/paper": 506.29590178851,
    "minimum-snap/paper-5": 3239.3205629884,
    "minimum-snap/corridor-10": 48.3122361,
    "minimum-snap/corridor-1000": 74.8267212,
    "minimum-snap/gate-2d": 58.4475808,
}


def spline(model):
    """The optimum by SciPy: a spline of degree 2r - 1 at rest at both ends."""
    rest = [(j, np.zeros(model.dimensions)) for j in range(1, model.order)]
    found = make_interp_spline(
        model.times, model.waypoints, k=2 * model.order - 1, bc_type=(rest, rest)
    )
    pieces = [found.derivative(j) if j else found for j in range(2 * model.order)]
    starts = [piece(model.times[:-1]) / math.factorial(j) for j, piece in enumerate(pieces)]
    # The highest derivative jumps at the knots, and a spline says the later value there.
    scale = model.durations[:, None] ** np.arange(2.0 * model.order)
    return Trajectory(model.times, np.stack(starts, axis=1) * scale[:, :, None])


def by_qp(model, solver):
    """The optimum by a solver of quadratic programs, rows added until nothing sticks out."""
    qpsolvers = pytest.importorskip("qpsolvers", reason="qpsolvers is not installed")
    pytest.importorskip(solver, reason=f"{solver} is not installed")
    formulation = model.formulate("legendre")
    while True:
        with warnings.catch_warnings():
            # It warns of what is infeasible, which is asked for here.
            warnings.simplefilter("ignore", UserWarning)
            answer = qpsolvers.solve_problem(formulation.program.to_qpsolvers(), solver=solver)
        if not answer.found:
            return None
        finer = formulation.refined(answer.x, 1e-6)
        if finer is None:
            return formulation.decode(answer.x)
        formulation = finer


# -- the catalogue -----------------------------------------------------------------------------------


def test_names():
    assert {
        "minimum-snap/figure-eight", "minimum-snap/helix", "minimum-snap/square",
        "minimum-snap/random-10", "minimum-snap/random-1000", "minimum-snap/paper",
        "minimum-snap/corridor-1000", "minimum-snap/corridor-infeasible",
        "minimum-derivative/reach",
    } <= set(NAMES)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_entries(name, tmp_path):
    entry, model = instances.entry(name), ct.load(name)
    assert model.name == name
    assert model.kind == entry.model == name.partition("/")[0]
    assert entry.provenance in (Provenance.SEEDED, Provenance.OURS)
    assert entry.title and entry.note and entry.paper
    # Exactly through JSON, and the same again.
    assert Model.from_json(model.to_json()).digest == model.digest == entry.build().digest
    path = instances.write_model(model, tmp_path / "instance.json")
    again = ct.load(path)
    assert again.digest == model.digest
    assert type(again) is type(model)
    for field in ("waypoints", "times", "start", "end"):
        assert getattr(again, field).tobytes() == getattr(model, field).tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_instances_never_change(name):
    model = ct.load(name)
    # To the micrometre: sines differ by their last digit from library to library.
    parts = [model.waypoints, model.times]
    parts += [a for a in (model.corridor_lower, model.corridor_upper, model.polytope_offsets) if a is not None]  # fmt: skip
    content = b"".join(np.round(np.nan_to_num(a, posinf=-1.0), 5).tobytes() for a in parts)
    assert hashlib.sha256(content).hexdigest()[:16] == FINGERPRINTS[name]


@pytest.mark.parametrize("name", SPLINES)
def test_optimum_by_scipy(name):
    model = ct.load(name)
    plan = spline(model)
    found = model.verify(plan)
    assert found.ok, str(found)
    assert found.objective == pytest.approx(OPTIMA[name], rel=1e-8)


def test_reach_is_the_published_optimum():
    entry = instances.entry("minimum-derivative/reach")
    model = entry.build()
    s = np.array([0, 0, 0, 10, -15, 6]) * 0.3
    plan = Trajectory(model.times, s.reshape(1, 6, 1))
    found = model.verify(plan)
    assert found.ok
    assert found.objective == pytest.approx(entry.published["optimum"], rel=1e-13)
    assert entry.published["optimum"] == pytest.approx(197.75390625, rel=1e-14)


def test_a_solver_finds_the_optima():
    """Through the face, with whatever is installed."""
    for name in ("minimum-derivative/reach", "minimum-snap/random-10", "minimum-snap/square"):
        solution = ct.solve(ct.load(name), tolerance=1e-6)
        assert solution.verification.ok
        assert solution.primal_bound == pytest.approx(OPTIMA[name], rel=1e-6)


# -- the paper's own problem -------------------------------------------------------------------------


def by_elimination(model, formulation):
    """The optimum of an equality-constrained program by its dense optimality system."""
    program = model.formulate(formulation).program
    hessian, rows = program.hessian.toarray(), program.matrix.toarray()
    count = len(rows)
    system = np.block([[hessian, rows.T], [rows, np.zeros((count, count))]])
    right = np.concatenate([-program.cost, program.row_lower])
    point = np.linalg.solve(system, right)[: len(hessian)]
    return model.formulate(formulation).decode(point), np.linalg.cond(system)


def test_powers_of_absolute_time_break():
    early, late = ct.load("minimum-snap/paper-5"), ct.load("minimum-snap/paper-late")
    assert early.waypoints.tobytes() == late.waypoints.tobytes()
    assert (early.continuity, early.start.tolist()) == (2, [[0.0] * 3] * 2)
    np.testing.assert_allclose(late.durations, early.durations, atol=1e-12)
    wanted = OPTIMA["minimum-snap/paper-5"]
    for model in (early, late):
        plan, condition = by_elimination(model, "legendre")
        assert condition < 1e6
        assert model.verify(plan).ok
        assert model.verify(plan).objective == pytest.approx(wanted, rel=1e-8)
    assert by_elimination(early, "paper")[1] > 1e18
    plan, condition = by_elimination(late, "paper")
    assert condition > 1e18
    assert not late.verify(plan).ok


# -- corridors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("segments", "seed"), [(10, 357), (1000, 0)])
def test_corridors_are_strictly_feasible(segments, seed):
    model, way = corridor_with_way(segments, seed)
    assert model.digest == ct.load(f"minimum-snap/corridor-{segments}").digest
    assert model.verify(way).ok
    spot, speed, push = (way.extremes(j) for j in range(3))
    assert (spot.least - model.corridor_lower).min() > 0.19
    assert (model.corridor_upper - spot.largest).min() > 0.19
    for extremes, limit in ((speed, model.velocity_limit), (push, model.acceleration_limit)):
        reached = np.maximum(-extremes.least, extremes.largest)
        assert (reached <= limit / 1.045).all()
    assert np.isinf(model.waypoints[1:-1]).all()
    assert np.isfinite(model.waypoints[[0, -1]]).all()
    assert not model.start.any() and not model.end.any()
    overlap = np.minimum(model.corridor_upper[1:], model.corridor_upper[:-1]) - np.maximum(
        model.corridor_lower[1:], model.corridor_lower[:-1]
    )
    assert (overlap > 0.38).all()
    assert model.durations.max() / model.durations.min() < 10


def active(model, plan):
    spot, speed, push = (plan.extremes(j) for j in range(3))
    edge = 1e-4
    return (
        int(((spot.least < model.corridor_lower + edge) | (spot.largest > model.corridor_upper - edge)).any(axis=1).sum()),
        int((np.maximum(-speed.least, speed.largest) > model.velocity_limit - edge).any(axis=1).sum()),
        int((np.maximum(-push.least, push.largest) > model.acceleration_limit - edge).any(axis=1).sum()),
    )  # fmt: skip


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
def test_small_corridor_by_two_solvers(solver):
    model = ct.load("minimum-snap/corridor-10")
    plan = by_qp(model, solver)
    found = model.verify(plan)
    assert found.ok, str(found)
    assert found.objective == pytest.approx(OPTIMA[model.name], rel=2e-6)
    assert min(active(model, plan)) >= 1, "a box and a limit of each kind are active"


@pytest.mark.slow
def test_long_corridor():
    model = ct.load("minimum-snap/corridor-1000")
    plan = by_qp(model, "piqp")
    found = model.verify(plan)
    assert found.ok, str(found)
    assert found.objective == pytest.approx(OPTIMA[model.name], rel=2e-6)
    boxes, speeds, pushes = active(model, plan)
    assert boxes > 300
    assert speeds > 10
    assert pushes > 0


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
def test_infeasible_corridor_and_its_segment(solver):
    model = ct.load("minimum-snap/corridor-infeasible")
    assert "segment 6" in instances.entry(model.name).note
    length = np.abs(np.diff(model.waypoints[6:8], axis=0)).max()
    assert length > model.velocity_limit[6].max() * model.durations[6] * 1.2
    assert by_qp(model, solver) is None
    data = model.data()
    data["velocity_limit"] = model.velocity_limit[0].tolist()
    free = MinimumSnap.from_data(data)
    assert free.verify(corridor_with_way(10, 357)[1]).ok
    assert by_qp(free, solver) is not None


def test_gates():
    model = ct.load("minimum-snap/gate-2d")
    assert model.halfspaces is not None
    assert model.halfspaces.segments.size == 24
    plan = by_qp(model, "piqp")
    found = model.verify(plan)
    assert found.ok, str(found)
    assert found.objective == pytest.approx(OPTIMA[model.name], rel=1e-5)
    # Stopping at every gate.
    points = ms.random_waypoints(6, 2, seed=0, step=2.0)
    bell = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])
    inner = bell[None, :, None] * np.diff(points, axis=0)[:, None, :]
    inner[:, 0] += points[:-1]
    assert model.verify(Trajectory(model.times, inner)).ok
