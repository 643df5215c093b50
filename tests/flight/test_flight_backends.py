"""Backends of flights on maps of all forms, wild cases, proofs, replanning and exports."""

import dataclasses

import numpy as np
import pytest
from flight.flights import RING, WALL, around, is_clear, world

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import export_plan
from crosstrack.jit import OutOfTime
from crosstrack.models import (
    DifferentialDrive,
    Flight,
    FlightPlan,
    GridMap,
    PointMass,
    Quadrotor,
    Trajectory,
)
from crosstrack.models.fleet_mission import MovingObstacle
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.flight import proofs, ways
from crosstrack.solvers.flight.staged import Staged

BACKENDS = ["minco", "staged"]
QUADROTOR = Quadrotor(0.61, (2.0, 12.0), tilt=1.05, body_rate=2.1, speed=4.0)


def solved(model, backend):
    solution = ct.solve(model, backend)
    assert solution.termination == "feasible", solution.message
    again = model.verify(solution.plan)
    assert again.ok, again
    assert solution.dual_bound <= again.objective
    return solution


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_plans_on_voxels_are_clear_by_exact_arithmetic(backend, seed):
    source = world(seed)
    model = Flight(source, (1, 1, 2), (11, 11, 2), QUADROTOR, radius=0.2)
    curve = solved(model, backend).plan.trajectory
    assert is_clear(curve, source, 0.2 - 1e-6 * source.cell)
    quantities = QUADROTOR.quantities(curve, np.linspace(*curve.times[[0, -1]], 5001))
    assert quantities["thrust"].max() <= 12.0 * (1 + 1e-6)
    assert quantities["thrust"].min() >= 2.0 * (1 - 1e-6)
    assert quantities["body_rate"].max() <= 2.1 * (1 + 1e-6)
    assert quantities["speed"].max() <= 4.0 * (1 + 1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scale", [1e-3, pytest.param(1.0, marks=pytest.mark.slow), 1e6])
def test_the_flight_time_of_a_scaled_map_is_the_same(backend, scale):
    """Lengths and limits scale together, so that the times are equal."""
    wall = scale * np.array(WALL)
    model = Flight(
        [wall], (0, 0), (10 * scale, 0), PointMass(2.0 * scale, 1.0 * scale), radius=0.3 * scale
    )
    solution = solved(model, backend)
    first = TIMES.setdefault(backend, solution.plan.duration)
    assert solution.plan.duration == pytest.approx(
        first, rel=0.05
    )  # corridors may differ by rounding


TIMES: dict[str, float] = {}


WILD = {
    "nothing": {"map": []},
    "empty grid": {"map": GridMap(["...", "...", "..."], 5.0), "start": (1, 1)},
    "a radius beyond the map": {
        "map": GridMap(["...", "...", "..."], 5.0),
        "start": (1, 1),
        "radius": 1e200,
    },
    "no limits": {"vehicle": PointMass(), "objective": "weighted"},
    "points": {"map": np.array([[5.0, 0.0], [5.0, 1.0]])},
    "touches at the start": {"start": (3.7, 0)},
    "on the wall": {"start": (4.0, 0), "radius": 0.0},
    "one place": {"goal": (0, 0)},
    "a waypoint twice": {"waypoints": [[5, 4], [5, 4]]},
    "a waypoint at the start": {"waypoints": [[0, 0]]},
    "moving": {"start_velocity": (0.5, 1.0), "start_acceleration": (0.0, 0.3)},
    "moving at the goal": {"goal_velocity": (0.5, -0.5)},
    "wheels": {"vehicle": DifferentialDrive(1.0, 1.0, 0.4)},
    "weighted": {"objective": "weighted", "order": 4},
    "a tenth of a millimetre": {"goal": (1e-4, 0)},
    "bounds": {"bounds": (-1, -1, 11, 3.5)},
    "obstacle": {"moving": [MovingObstacle(0.5, [0, 9], [[2, 2], [9, 5]])]},
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", WILD)
def test_wild_flights(name, backend):
    solved(around(**WILD[name]), backend)


def test_a_flight_is_slower_if_it_can_neither_wait_nor_pass():
    """One obstacle passes over the start at 5 s, another one blocks the line until 10 s."""
    sweeps = MovingObstacle(0.5, [0, 10], [[0, -20], [0, 20]])
    blocks = MovingObstacle(0.5, [0, 10, 12], [[6, 0], [6, 0], [6, 20]])
    model = around(map=[], moving=[sweeps, blocks])
    curve = solved(model, "minco").plan.trajectory
    assert np.linalg.norm(curve(5.0)) > 0.8  # it has left the start
    assert 2.0 < curve.duration / ct.solve(around(map=[])).plan.duration < 3.0


def test_the_time_of_minco_is_shorter_and_near_the_bound():
    model = around(map=[], goal=(40, 0))
    fast, slow = solved(model, "minco"), solved(model, "staged")
    assert fast.plan.duration < slow.plan.duration
    assert fast.gap < 0.06


def test_auto_is_minco_and_compare_agrees():
    model = around()
    solution = ct.solve(model)
    assert solution.backend == "minco"
    answers = [solution, *(ct.solve(model, name) for name in BACKENDS if name != "minco")]
    verdict = judge("around", answers, model)
    assert verdict.outcome != "CONTRADICTION"
    assert all(entry.plan is not None for entry in verdict.solutions)


CLOSED = ["........", "..@@@@..", "..@..@..", "..@..@..", "..@@@@..", "........"]


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(Flight(GridMap(CLOSED), (1, 1), (4, 3), PointMass(1, 1)), id="cells"),
        pytest.param(around(map=[RING], goal=(5, 0)), id="polygon"),
        pytest.param(
            around(
                map=np.array([[5 + 2 * np.cos(t), 2 * np.sin(t)] for t in np.arange(0, 6.3, 0.1)]),
                goal=(5, 0), cell=0.1,
            ),
            id="points",
        ),
    ],
)  # fmt: skip
def test_a_map_without_a_way_is_proven_infeasible(model):
    for backend in BACKENDS:
        solution = ct.solve(model, backend)
        assert solution.termination == "infeasible"
        assert "no way from the start to the goal" in solution.message


def test_diagnosis_names_every_separated_pair_of_places():
    model = Flight(GridMap(CLOSED), (1, 1), (1, 5), PointMass(1, 1), waypoints=[[4, 3]])
    diagnosis = ct.diagnose(model)
    assert diagnosis.feasible is False
    assert [finding.where for finding in diagnosis.findings] == [
        "start to waypoint 0",
        "waypoint 0 to goal",
    ]
    assert "forbidden cells" in diagnosis.findings[0].data["reason"]
    # The inner region of two by two cells is named for the second pair.
    assert "its region has 4 cells" in diagnosis.findings[1].text


def test_diagnosis_without_a_proof_decides_nothing():
    lines = ["...@", "..@.", ".@..", "@..."]
    for model in (around(), Flight(GridMap(lines), (0.5, 0.5), (3.5, 3.5), PointMass(1, 1))):
        diagnosis = ct.diagnose(model)
        assert diagnosis.feasible is None and not diagnosis.findings
        assert "no cause is proven" in str(diagnosis)


def test_a_tolerance_that_crosses_cells_proves_nothing():
    model = Flight(GridMap(CLOSED), (1, 1), (4, 3), PointMass(1, 1), radius=0.05)
    assert proofs.separations(model, 1e-3)
    assert not proofs.separations(model, 0.1)


def test_the_bound_holds_for_a_plan_within_a_coarse_tolerance():
    """A speed that is 0.9e-4 above its limit passes with the tolerance 1e-4."""
    length = 2e5
    model = Flight([], (0, 0), (length, 0), PointMass(2.0, 1.0))
    # The speed rises by 2 (10 s³ - 15 s⁴ + 6 s⁵) over 4 s and 4 m, and falls in the same way.
    rise = np.array([0, 0, 0, 0, 20.0, -24.0, 8.0])
    steady = np.array([4.0, length - 8.0, 0, 0, 0, 0, 0])
    fall = np.array([length - 4.0, 8.0, 0, 0, -20.0, 24.0, -8.0])
    powers = np.stack([rise, steady, fall])[:, :, None] * [1.0, 0.0]
    times = np.array([0.0, 4.0, length / 2, length / 2 + 4.0]) / (1 + 0.9e-4)
    result = model.verify(FlightPlan(Trajectory(times, powers)), tolerance=1e-4)
    assert result.ok, result
    assert result.objective < proofs.least_objective(model)
    assert result.objective >= proofs.least_objective(model, 1e-4)


def test_only_a_vehicle_without_extent_passes_a_corner():
    lines = ["...@", "..@.", ".@..", "@..."]
    model = Flight(GridMap(lines), (0.5, 0.5), (3.5, 3.5), PointMass(1, 1))
    assert not proofs.separations(model)
    assert ct.solve(model).termination == "no_solution"
    assert ct.solve(dataclasses.replace(model, radius=0.1)).termination == "infeasible"


def test_a_gap_narrower_than_the_vehicle_between_polygons():
    walls = [[[4, -9], [5, -9], [5, -0.2], [4, -0.2]], [[4, 0.2], [5, 0.2], [5, 9], [4, 9]]]
    closed = [
        *walls,
        [[-9, 9], [15, 9], [15, 10], [-9, 10]],
        [[-9, -10], [15, -10], [15, -9], [-9, -9]],
    ]
    frame = {"bounds": (-8.0, -8.9, 14.0, 8.9)}
    assert ct.solve(around(map=closed, radius=0.3, **frame)).termination == "infeasible"
    solved(around(map=closed, radius=0.15, **frame), "minco")


@pytest.mark.parametrize("seed", range(5))
def test_the_way_over_cells_is_as_short_as_dijkstra(seed):
    """The kernel's path over 26 neighbours equals SciPy's shortest path."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    from crosstrack.solvers.flight.kernels import walk

    blocked = world(seed, (9, 8, 6), 0.3).blocked.copy()
    walls = np.pad(blocked, 1, constant_values=True).astype(np.uint8)
    number = np.arange(walls.size).reshape(walls.shape)
    rows, columns, lengths = [], [], []
    for cell in np.argwhere(walls == 0):
        for step in np.ndindex(3, 3, 3):
            way = np.array(step) - 1
            box = [slice(min(c, c + w), max(c, c + w) + 1) for c, w in zip(cell, way, strict=True)]
            if way.any() and not walls[tuple(box)].any():
                rows.append(number[tuple(cell)])
                columns.append(number[tuple(cell + way)])
                lengths.append(np.linalg.norm(way))
    graph = coo_matrix((lengths, (rows, columns)), (walls.size, walls.size)).tocsr()
    free = number[walls == 0]
    start, goal = int(free[0]), int(free[-1])
    exact = dijkstra(graph, indices=start)[goal]
    path = walk(walls.ravel(), *walls.shape[1:], start, goal, np.zeros(1, np.int8))
    places = np.stack(np.unravel_index(path, walls.shape), axis=1)
    length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum() if len(path) else np.inf
    assert length == pytest.approx(exact)


def test_free_cells_are_safe_for_the_centre():
    """Every free cell of the planner keeps the radius, at its corners and inside."""
    draw = np.random.default_rng(0)
    for source in (world(3), draw.random((30, 3)) * 6 + 1, draw.random((40, 2)) * 9):
        axes = 3 if not isinstance(source, np.ndarray) else source.shape[1]
        low = [0.2] * axes if isinstance(source, np.ndarray) else [1.0] * axes
        low = np.array(low) - (3.0 if isinstance(source, np.ndarray) else 0.0)
        model = Flight(source, low, low, PointMass(1, 1), radius=0.35, cell=None)
        cells = ways.lattice(model)
        free = np.argwhere(~cells.blocked)
        free = free[draw.permutation(len(free))[:200]]
        for shift in draw.random((8, axes)):
            points = cells.origin + (free + shift) * cells.cell
            assert model.space.solids.depths(points, 0.35).max() <= 1e-9


def test_plan_flight_accepts_fields_and_options():
    solution = ct.plan_flight(
        [WALL], (0, 0), (10, 0), PointMass(2, 1), radius=0.3, backend="staged"
    )
    assert solution.backend == "staged" and solution.verification.ok
    with pytest.raises(InvalidData):
        ct.plan_flight([WALL], (0, 0), (5, 0), PointMass(2, 1))
    corridor = ct.corridor([WALL], solution.plan.path, radius=0.3)
    assert corridor.verify([WALL]).ok


def test_exports_samples_and_pieces(tmp_path):
    model = around()
    plan = ct.solve(model).plan
    export_plan(model, plan, tmp_path / "flight.csv", rate=50.0)
    rows = np.loadtxt(tmp_path / "flight.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[-1, 1:3], [10, 0], atol=1e-6)
    report = export_plan(model, plan, tmp_path / "pieces.csv", "poly7", height=2.0)
    assert report.pieces == plan.trajectory.segments
    from crosstrack.instances.minimum_snap import read_poly7

    curve = read_poly7(tmp_path / "pieces.csv")
    np.testing.assert_allclose(curve(curve.times[-1])[:3], [10, 0, 2], atol=1e-3)


def test_pictures_of_all_maps():
    import matplotlib.pyplot as plt

    from crosstrack.models.flight.plot import animate_flight

    for source in ([WALL], GridMap(["...", "...", "..."], 5.0), np.array([[5.0, 1.0]])):
        model = around(map=source, start=(1, 1), goal=(9, 5))
        plan = ct.solve(model).plan
        plt.close(ct.plot(model, plan))
    wrong = FlightPlan(dataclasses.replace(plan.trajectory, times=0.5 * plan.trajectory.times))
    figure = ct.plot(model, wrong)
    drawn = [artist.get_gid() for axes in figure.axes for artist in axes.get_children()]
    assert "worst violation" in drawn
    animation = animate_flight(model, plan)
    assert animation._save_count > 1
    animation._draw_was_started = True  # looked at, not played
    plt.close("all")


@pytest.mark.parametrize("radius", [0.3, 0.39])
def test_a_gap_of_one_cell_is_passed_in_its_middle(radius):
    cells = np.zeros((8, 9), bool)
    cells[:, 4], cells[3, 4] = True, False
    solved(Flight(GridMap(cells), (1, 1), (8, 7), PointMass(2, 1), radius=radius), "minco")


def test_minco_returns_the_smoothest_curve_if_a_flight_begins_at_full_speed_towards_a_wall():
    solved(around(start_velocity=(2.0, 0.0)), "minco")


def test_a_loop_at_one_place_is_not_planned():
    solution = ct.solve(around(goal=(0, 0), start_velocity=(0.1, 0.0)))
    assert solution.termination == "no_solution"
    assert "all places coincide" in solution.message


def test_a_search_out_of_time_is_a_limit_of_the_answer(monkeypatch):
    def fly(*_):
        raise OutOfTime

    monkeypatch.setattr(Staged, "fly", fly)
    solution = ct.solve(around(), "staged")
    assert solution.termination == "feasible" and solution.limit == "time"
    assert solution.statistics["search for a curve stopped"]
    assert solution.statistics["rests at points of the path"]
    moving = ct.solve(around(start_velocity=(0.5, 0.0)), "staged")
    assert moving.termination == "no_solution" and moving.limit == "time"
    assert moving.message == "the search for a curve was stopped"


def test_a_stopped_corridor_ends():
    def stop():
        raise TimeoutError

    with pytest.raises(TimeoutError):
        ct.corridor([WALL], [[0, 0], [2, 0]], radius=0.3, pause=stop)
