"""Robots that share space and time: schedules against brute force, lanes, rests and cells."""

import dataclasses
import itertools

import numpy as np
import pytest
from benchmarks.fleet_mission.cells import CellPlanner
from benchmarks.fleet_mission.mapf import check
from benchmarks.fleet_mission.shared_space import mission
from fleet_mission.contacts import contacts, moving_contacts
from fleet_mission.missions import SQUARE, box, small
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission import MovingObstacle
from crosstrack.models.fleet_mission.curves import nearest
from crosstrack.solvers import Limit
from crosstrack.solvers.fleet_mission import delays, schedule as scheduling, staged
from crosstrack.solvers.fleet_mission.corridor import Corridor
from crosstrack.solvers.fleet_mission.courses import Course, Leg, whole_courses
from crosstrack.solvers.fleet_mission.delays import departures
from crosstrack.solvers.fleet_mission.flight import Flight, resting
from crosstrack.solvers.fleet_mission.lanes import kept_right
from crosstrack.solvers.fleet_mission.schedule import schedule
from crosstrack.solvers.fleet_mission.stages import Stages

QUICK, HOME = {"routing": "kmeans-ac"}, [1.0, 1.0]
OPEN = FleetMission(
    [],
    (0, 0, 12, 12),
    [[9, 6], [6, 9], [9, 9]],
    (2, 2),
    3,
    cell=0.5,
    radius=0.4,
    objective="makespan",
)


def around(model, *points):
    """Return the resting flight of a robot from the depot over `points` and back."""
    knots = np.array([model.depot, *points, model.depot], float)
    empty = np.empty((len(knots) - 1, 2))
    return resting(model, Corridor(empty, empty, knots, np.arange(len(knots))))


def split(model, *points):
    """Return the course of a resting flight that may wait at each point."""
    flight = around(model, *points)
    places = np.array([model.depot, *points, model.depot], float)
    parts = [
        Leg(k, k + 1, Trajectory(flight.times[k : k + 2] - flight.times[k], flight.coefficients[k : k + 1]),
            np.zeros(0))
        for k in range(flight.segments)
    ]  # fmt: skip
    return Course(places, (Leg(0, len(places) - 1, flight, np.zeros(0)), *parts))


def ends(result):
    """Return the time of the last return."""
    return max(entry.trajectory.times[-1] for entry in result)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_two_robots_return_as_early_as_in_a_brute_force_search(seed):
    """Every pair of departures on a grid of time is tried, on points of the curves alone."""
    draw = np.random.default_rng(seed)
    places = draw.uniform(3, 11, (2, 2, 2))
    model = dataclasses.replace(OPEN, nodes=places.reshape(-1, 2)[:2], vehicles=2)
    flights = [around(model, *entry) for entry in places]
    home = np.stack([model.depot, model.depot])
    courses = [Course(home, (Leg(0, 1, entry, np.zeros(0)),)) for entry in flights]
    result = schedule(model, courses, 0, 1e-9, lambda: False)
    step = min(entry.duration for entry in flights) / 150
    samples = [
        entry(np.minimum(np.arange(0, entry.duration + step, step), entry.duration))
        for entry in flights
    ]
    long = [len(entry) for entry in samples]
    best = np.inf
    for delay in range(-long[0], long[1]):
        first, second = max(delay, 0), max(-delay, 0)
        begin, end = max(first, second), min(first + long[0], second + long[1])
        a, b = samples[0][begin - first : end - first], samples[1][begin - second : end - second]
        if not len(a) or np.hypot(*(a - b).T).min() >= model.separation:
            best = min(best, step * max(first + long[0], second + long[1]))
    # A step of each grid, and the samples' allowance for the motion between them.
    assert ends(result) <= best + 0.06 * max(entry.duration for entry in flights)
    assert nearest([entry.trajectory for entry in result], 1e-9).distance >= model.separation


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_robots_that_wait_inside_keep_their_separation(seed):
    draw = np.random.default_rng(seed)
    count = int(draw.integers(2, 6))
    places = draw.uniform(3.2, 11, (count, 3, 2))
    model = dataclasses.replace(OPEN, nodes=places[:, 0], vehicles=count)
    courses = [split(model, *entry) for entry in places]
    result = schedule(model, courses, seed, 1e-9, lambda: False)
    assert nearest([entry.trajectory for entry in result], 1e-9).distance >= model.separation
    whole = schedule(
        model, [Course(entry.places[[0, -1]], (entry.legs[0]._replace(end=1),)) for entry in courses],
        seed, 1e-9, lambda: False,
    )  # fmt: skip
    sequential = sum(entry.legs[0].curve.duration for entry in courses)
    assert ends(result) <= sequential * (1 + 1e-9)
    assert ends(whole) <= sequential * (1 + 1e-9)
    for entry, course in zip(result, courses, strict=True):
        begins, finals = entry.trajectory.at_ends()
        assert finals[:-1] == pytest.approx(begins[1:], abs=1e-9)
        assert entry.trajectory.duration >= course.legs[0].curve.duration * (1 - 1e-9)


def test_a_robot_waits_inside_the_map_for_a_crossing_obstacle():
    """One obstacle blocks the second leg until 40 s, and another one the first leg from 30 s to 95 s."""
    model = FleetMission(
        [], (0, 0, 20, 4), [[18, 2]], (2, 2), 1, cell=0.5, radius=0.3, objective="makespan",
        moving=[MovingObstacle(0.5, [0, 40, 45], [[10, 2], [10, 2], [10, 12]]),
                MovingObstacle(0.5, [0, 30, 35, 90, 95], [[5, 12], [5, 12], [5, 2], [5, 2], [5, 12]])],
    )  # fmt: skip
    course = split(model, [8, 2], [18, 2])
    result = schedule(model, [course], 0, 1e-9, lambda: False)
    late = schedule(
        model,
        [Course(course.places[[0, -1]], (course.legs[0]._replace(end=1),))],
        0,
        1e-9,
        lambda: False,
    )
    assert ends(result) < ends(late)
    answer = ct.solve(model, "staged", seed=1)
    assert answer.verified, answer.message
    assert not moving_contacts(model, answer.plan)


def test_an_obstacle_that_stays_at_the_depot_leaves_no_schedule():
    model = small(moving=[MovingObstacle(0.5, [0.0], [HOME])])
    answer = ct.solve(model, "staged", seed=1, backend_options=QUICK)
    assert answer.plan is None
    assert "moving obstacle 0" in answer.message
    assert ct.diagnose(model).feasible is None


def test_departures_keep_the_digits_of_segments_if_an_obstacle_stops_late():
    cart = MovingObstacle(0.5, [0, 1e18, 2e18], [HOME, HOME, [9, 9]])
    model = small(moving=[cart], vehicles=1)
    (moved,) = departures(model, [around(model, [8, 8])], 1e-3)
    assert moved.durations == pytest.approx(around(model, [8, 8]).durations, rel=1e-6)


@pytest.mark.parametrize(("kind", "robots"), [("corridor", 3), ("crossing", 2), ("door", 3)])
def test_shared_missions_have_no_contact_and_improve_on_delays(kind, robots):
    model = mission(kind, 3, robots)
    answer = ct.solve(model, "staged", seed=1, backend_options=QUICK)
    assert answer.verified, answer
    assert not contacts(model, answer.plan)
    flights = [
        Trajectory(one.times - one.times[0], one.coefficients) for one in answer.plan.trajectories
    ]
    delayed = departures(model, flights, 1e-9)
    assert answer.plan.end <= max(one.times[-1] for one in delayed) * (1 + 1e-9)
    if kind == "corridor":
        again = ct.solve(model, "staged", seed=1, backend_options=QUICK)
        assert again.plan.to_data() == answer.plan.to_data()


def test_other_objectives_keep_the_lengths_of_the_curves():
    model = dataclasses.replace(mission("corridor", 1, robots=3), objective="sum-deviation")
    answer, free = (
        ct.solve(asked, "staged", seed=1, backend_options=QUICK)
        for asked in (model, dataclasses.replace(model, separation=0))
    )
    assert answer.primal_bound == pytest.approx(free.primal_bound, rel=1e-9)
    assert not contacts(model, answer.plan)


def test_robots_depart_one_after_another_once_the_time_is_over(monkeypatch):
    flights = [around(OPEN, [9, 6])] * 2
    calls, tried = itertools.count(), []
    original = delays.is_clear
    monkeypatch.setattr(delays, "is_clear", lambda *rest: tried.append(rest) or original(*rest))
    first, second = departures(OPEN, flights, 1e-9, lambda: next(calls) > 2)
    assert second.times[0] == first.times[-1]
    assert len(tried) == 2


def test_no_flight_with_lanes_is_planned_once_the_time_is_over(monkeypatch):
    is_over, flown = [], []

    def begin(*arguments):
        is_over.append(Limit.TIME)
        return courses(*arguments)

    courses, fly = staged.courses_with_rests, staged.fly
    monkeypatch.setattr(staged, "LATE", 0.0)
    monkeypatch.setattr(staged, "courses_with_rests", begin)
    monkeypatch.setattr(staged, "fly", lambda *rest: flown.append(len(is_over)) or fly(*rest))
    monkeypatch.setattr(Stages, "stopped", lambda stages: is_over[0] if is_over else None)
    answer = ct.solve(mission("door", 3, 3), "staged", seed=1, backend_options=QUICK)
    assert answer.verified and is_over
    assert flown == [0] * 3


def test_pairs_of_samples_are_compared_in_batches(monkeypatch):
    courses = [split(OPEN, [9, 6], [6, 9]), split(OPEN, [6, 9])]
    expected = scheduling._Grid(OPEN, courses, 1.0).clashes(0, 0, 1, 0)
    monkeypatch.setattr(scheduling, "PAIRS", 1000)
    assert expected.size
    assert scheduling._Grid(OPEN, courses, 1.0).clashes(0, 0, 1, 0).tolist() == expected.tolist()


def test_opposite_lanes_of_a_passage_keep_the_separation():
    """The curves are anywhere in the boxes, so the boxes themselves are compared."""
    low, high = np.array([[0.0, 0.0], [4.0, 4.0]]), np.array([[12.0, 2.0], [6.0, 9.0]])
    knots = np.array([[0.0, 1.0], [12.0, 1.0]])
    there = Corridor(low[:1], high[:1], knots, np.array([0, 1]))
    back = Corridor(low[:1], high[:1], knots[::-1], np.array([0, 1]))
    lanes = [kept_right(way, 0.8, 10.0) for way in (there, back)]
    tops = [(way.lower[1, 1], way.upper[1, 1]) for way in lanes]
    assert tops[0][1] + 0.8 < tops[1][0]
    for way in lanes:
        assert (way.knots[[0, -1]] == (there if way is lanes[0] else back).knots).all()
        assert (way.lower <= way.upper).all()
    assert kept_right(there, 3.0, 10.0) is None


def test_whole_courses_at_several_speeds():
    flight = around(OPEN, [9, 6])
    (course,) = whole_courses(OPEN, [Flight(flight, 0, True, np.arange(3))])
    factors = [leg.curve.duration / flight.duration for leg in course.legs]
    assert factors[0] == 1.0
    assert sorted(factors) == factors
    assert course.legs[-1].visits == pytest.approx(factors[-1] * flight.times[1:2])


# -- cells -------------------------------------------------------------------------------------------


def joint_steps(blocked, agents):
    """Return the least number of steps of two robots by a search over pairs of cells, or None."""
    rows, columns = blocked.shape

    def moves(cell):
        for row, column in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)):
            r, c = cell[0] + row, cell[1] + column
            if 0 <= r < rows and 0 <= c < columns and not blocked[r, c]:
                yield (r, c)

    layer, goal = {(agents[0][0], agents[1][0])}, (agents[0][1], agents[1][1])
    seen, steps = set(layer), 0
    while layer:
        if goal in layer:
            return steps
        layer = {
            (a, b)
            for one, other in layer
            for a, b in itertools.product(moves(one), moves(other))
            if a != b and (a, b) != (other, one)
        } - seen
        seen |= layer
        steps += 1
    return None


def test_two_robots_on_tiny_grids_against_a_search_over_pairs():
    draw = np.random.default_rng(5)
    optimal = solved = total = 0
    while total < 40:
        blocked = draw.random((int(draw.integers(2, 5)), int(draw.integers(3, 6)))) < 0.25
        free = [tuple(cell) for cell in np.argwhere(~blocked).tolist()]
        if len(free) < 4:
            continue
        starts, goals = (
            [free[k] for k in draw.choice(len(free), 2, replace=False)] for _ in range(2)
        )
        agents = list(zip(starts, goals, strict=True))
        least = joint_steps(blocked, agents)
        if least is None:
            continue
        total += 1
        planner = CellPlanner(blocked, seed=1)
        for start, goal in agents:
            planner.add(start, goal)
        calls = itertools.count()
        if planner.solve(lambda calls=calls: next(calls) > 200):
            check(blocked, agents, planner.cells())
            solved += 1
            optimal += planner.makespan == least
            assert planner.makespan >= least
    # Prioritised planning is incomplete: a robot may have to leave its goal for another one.
    assert solved >= 0.85 * total
    assert optimal >= 0.9 * solved


def test_thirty_robots_on_a_small_grid():
    draw = np.random.default_rng(2)
    blocked = draw.random((12, 12)) < 0.1
    free = np.argwhere(~blocked)
    agents = [
        (tuple(a), tuple(b))
        for a, b in zip(draw.permutation(free)[:30].tolist(), draw.permutation(free)[:30].tolist(), strict=True)
    ]  # fmt: skip
    results = []
    for _ in range(2):
        planner = CellPlanner(blocked, seed=4)
        for start, goal in agents:
            planner.add(start, goal)
        assert planner.solve(lambda: False)
        check(blocked, agents, planner.cells())
        results.append([path.tolist() for path in planner.cells()])
    assert results[0] == results[1]


def test_wrong_cells_are_refused():
    planner = CellPlanner(np.array([[False, True, False], [False, False, True]]))
    planner.add((0, 0), (1, 1))
    for start, goal, message in (
        ((0, 1), (1, 0), "start must be a free cell"),
        ((1, 0), (7, 0), "goal must be a cell of the map"),
        ((1, 0), (1, 1), "goal must differ between robots"),
        ((0, 0), (1, 0), "start must differ"),
        ((1, 0), (0, 2), "goal must be reachable"),
        ((1, 0), (0,), "goal"),
    ):
        with pytest.raises(InvalidData, match=message):
            planner.add(start, goal)
    for grid in ([], np.zeros((2, 2)), "map"):
        with pytest.raises(InvalidData, match="blocked must be a matrix of Booleans"):
            CellPlanner(grid)


def test_a_mission_with_moving_obstacles_is_verified_and_free_of_contacts():
    carts = [
        MovingObstacle(0.5, [0, 30, 60], [[5, 0], [5, 10], [9.5, 9.5]]),
        MovingObstacle(0.3, [0, 20], coefficients=[[[9, 5], [0, 0], [-8, 4]]]),
    ]
    model = small(moving=carts, objective="makespan", obstacles=[SQUARE, box(0, 9.5, 1, 10)])
    answer = ct.solve(model, "staged", seed=1, backend_options=QUICK)
    assert answer.verified, answer.message
    assert not contacts(model, answer.plan)
    assert not moving_contacts(model, answer.plan)
    assert answer.primal_bound == answer.plan.end


def test_a_robot_whose_nodes_are_at_the_depot_does_not_hinder_lanes_and_rests():
    places = [[1, 1], [8, 8], [8, 8]]
    model = small(nodes=places, vehicles=3, objective="makespan", separation=0.5)
    answer = ct.solve(model, seed=0, backend_options=QUICK)
    assert answer.verified, answer
    assert not contacts(model, answer.plan)
