"""Time windows of the vehicles: brute force over orders, waiting, bounds, diagnosis, files and errors."""

import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from messenger.extended import ground

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import MessengerTour
from crosstrack.solvers.messenger.detour_search import bound_windows


def drawn(seed, tight=40.0):
    """Return a model of three vehicles of radius 0 that are far apart, compared with the turning radius of 0.3 m."""
    draw = np.random.default_rng(seed)
    begin = draw.uniform(0, 30, 3)
    windows = np.column_stack([begin, begin + draw.uniform(1, tight, 3)])
    windows[draw.integers(3), 1] = math.inf
    return MessengerTour(
        draw.uniform(-90, 90, (3, 2)), draw.uniform(-2, 2, (3, 2)), radius=0, turning_radius=0.3,
        windows=windows, wind=draw.uniform(-2, 2, 2) if seed % 3 == 0 else None,
    )  # fmt: skip


def by_enumeration(model, reserve=0.0):
    """Return the length (m) of the best order of straight flights that may wait, a lower bound.

    Each flight takes the share `reserve` of a second longer.
    """
    wind = np.zeros(2) if model.wind is None else model.wind

    def finish(order):
        place, time = model.start[:2], 0.0
        for k in order:
            rate = model.velocities[k] - wind
            way = model.positions[k] + model.velocities[k] * time - place
            # The root of |way + rate s| = speed s.
            s = max(np.roots([rate @ rate - model.speed**2, 2 * way @ rate, way @ way]).real)
            time = max(time + s + reserve, model.windows[k, 0])
            if time > model.windows[k, 1]:
                return math.inf
            place = model.positions[k] + model.velocities[k] * time
        return model.speed * time

    return min(map(finish, itertools.permutations(range(model.size))))


@pytest.mark.parametrize(
    "seed", [0, 1, 2, 6, *(pytest.param(k, marks=pytest.mark.slow) for k in range(7, 60))]
)
def test_the_search_is_as_good_as_the_enumeration_of_orders_and_the_bound_below(seed):
    model = drawn(seed)
    least, turning = by_enumeration(model), 4 * math.pi * model.turning_radius / model.speed
    answer = ct.solve(model, "detour-search", seed=1)
    if answer.plan is None:
        assert by_enumeration(model, turning) == math.inf
        return
    result = model.verify(answer.plan)
    assert result.ok and answer.dual_bound <= answer.primal_bound * (1 + 1e-9)
    assert least * (1 - 1e-9) <= answer.primal_bound
    assert answer.primal_bound <= by_enumeration(model, turning) * (1 + 1e-9)
    # Independent of the verification: times and places by the formula of a trochoid.
    pieces = answer.plan.primitives
    poses = ground(model, [p.turn for p in pieces], [p.length for p in pieces])
    flown = np.cumsum([p.length for p in pieces])
    for leg, k in enumerate(answer.plan.order):
        last = max(row for row, p in enumerate(pieces) if p.leg <= leg)
        time = flown[last] / model.speed
        begin, end = model.windows[k]
        assert begin - 1e-6 <= time <= end + 1e-6
        target = model.positions[k] + model.velocities[k] * time
        assert np.hypot(*(poses[last, :2] - target)) < 1e-4


def test_windows_change_the_order_and_a_relaxed_plan_names_the_missed_window():
    vehicles = ([[0, 40], [0, 80], [0, 120]], [[0, 0], [0, 0], [0, 0]])
    free = MessengerTour(*vehicles)
    model = dataclasses.replace(free, windows=[[25, 30], [0, math.inf], [0, 12]])
    relaxed, best = ct.solve(free, seed=1), ct.solve(model, seed=1)
    assert relaxed.plan.order == (0, 1, 2) and best.plan.order == (1, 2, 0)
    assert best.termination == "optimal" and best.primal_bound == pytest.approx(250)
    (check,) = model.verify(relaxed.plan).violated
    assert check.name == "encounter within its window" and check.where == "vehicle 0"
    assert check.worst == pytest.approx(250 - 35, abs=1e-4)


@pytest.mark.parametrize(
    ("position", "time"), [([0, 4], 5.0), ([0, 30], 3.01), ([3, 3], 700.0), ([0, 0], 3.5), ([0, 4], 1.0)]
)  # fmt: skip
def test_waits_until_the_exact_time_if_a_path_of_this_length_exists(position, time):
    model = MessengerTour([position], radius=0, windows=[[time, 1e4]])
    answer = ct.solve(model, seed=1)
    assert answer.plan is not None and answer.plan.times[0] >= time - 1e-9
    # Next to the start, lengths below that of a circle do not exist.
    gap = 2 * math.pi * 5 / 10 if position == [0, 4] and time == 1.0 else 0.0
    assert answer.plan.times[0] <= time + gap + 1e-9


def test_two_vehicles_in_one_place_are_met_at_one_time():
    model = MessengerTour([[0, 30], [4, 30]], windows=[[5, 5], [5, 5]], closed=True)
    answer = ct.solve(model, seed=1, backend_options={"rounds": 1})
    assert answer.plan is not None and answer.plan.times == pytest.approx([5, 5])
    assert bound_windows(model) == pytest.approx(50 + math.hypot(4, 30) - 5)
    assert bound_windows(model) <= answer.dual_bound <= answer.primal_bound


def test_windows_and_zones_hold_together():
    model = MessengerTour(
        [[0, 90], [60, 10]], windows=[[30, 31], [0, 20]], no_fly=[[0, 40, 15], [30, 60, 5]]
    )
    answer = ct.solve(model, seed=1)
    assert answer.backend == "detour-search" and model.verify(answer.plan).ok
    assert answer.plan.order == (1, 0)
    timeless = ct.solve(dataclasses.replace(model, windows=None), seed=1).plan
    missed = [check.name for check in model.verify(timeless).violated]
    assert missed == ["encounter within its window"]


def test_diagnosis_names_a_vehicle_that_no_uav_meets_in_time():
    model = MessengerTour([[0, 30], [4, 30]], windows=[[0, math.inf], [1, 2]], ids=["a", "b"])
    diagnosis = ct.diagnose(model)
    assert diagnosis.feasible is False
    assert "vehicle b" in diagnosis.summary and "ends at 2 s" in diagnosis.summary
    answer = ct.solve(model, seed=1, backend_options={"rounds": 1})
    assert answer.plan is None and answer.termination == "no_solution"
    # Each vehicle alone is met in time, but not both: no claim.
    both = MessengerTour([[0, 60], [0, -60]], windows=[[0, 6.5], [0, 8.5]])
    assert ct.diagnose(both).feasible is None
    # The verification accepts 1e-6 of the radius, which is more than the proof's share of the short flight.
    for late, feasible in ((5e-5, True), (0.1, False)):
        near = MessengerTour([[0, 1001]], radius=1000, windows=[[0, (1 - late) / 10]])
        assert (ct.diagnose(near, time_limit=2).feasible is not False) == feasible


@pytest.mark.parametrize("name", ["tour-search", "memetic", "greedy-boundary", "direct-sampling"])
def test_other_methods_refuse_windows_by_name(name):
    model = MessengerTour([[0, 90], [20, 40]], windows=[[0, 20], [0, 30]])
    with pytest.raises(UnsupportedFormulation, match=r"windows.*'detour-search' does"):
        ct.solve(model, name)


def test_programs_several_uavs_and_closed_tours_in_wind_are_refused():
    model = MessengerTour([[0, 90], [20, 40]], windows=[[0, 20], [0, 30]])
    with pytest.raises(UnsupportedFormulation, match="windows"):
        model.formulate("primitives")
    with pytest.raises(UnsupportedFormulation, match="windows"):
        ct.solve(dataclasses.replace(model, uavs=2), "crew-search")
    with pytest.raises(UnsupportedFormulation, match="closed tour in wind"):
        ct.solve(dataclasses.replace(model, closed=True, wind=[1, 0]), "detour-search")
    with pytest.raises(UnsupportedFormulation, match="time windows: use tour-search"):
        ct.solve(dataclasses.replace(model, windows=None), "detour-search")


@pytest.mark.parametrize("turning_radius", [0.0, 5.0])
def test_bounds_accept_windows_and_return_no_plan(turning_radius):
    model = MessengerTour(
        [[0, 90], [20, 40]], windows=[[0, 20], [10, 30]], turning_radius=turning_radius
    )
    answer = ct.solve(model, "euclidean-bound")
    assert answer.plan is None
    assert answer.dual_bound == ct.solve(
        dataclasses.replace(model, windows=None), "euclidean-bound"
    ).dual_bound  # fmt: skip


def test_files_hold_the_windows(tmp_path):
    model = MessengerTour([[0, 90], [20, 40]], windows=[[5, math.inf], [0, 30]])
    again = MessengerTour.from_data(json.loads(json.dumps(model.data())))
    free = dataclasses.replace(model, windows=None)
    assert again.digest == model.digest != free.digest
    assert "time windows" in model.describe()
    unlimited = dataclasses.replace(model, windows=[[0, math.inf], [-1, math.inf]])
    assert unlimited.windows is None and unlimited.digest == free.digest
    assert model.share(0, [1]).windows.tolist() == [[0, 30]]
    file = tmp_path / "vehicles.csv"
    file.write_text("x,y,radius,latest [min],earliest\n0,90,5,,5\n20,40,5,0.5,\n", "utf-8")
    assert ct.load(file, model="messenger-tour").digest == model.digest


@pytest.mark.parametrize(
    "windows",
    [
        [[5, 4], [0, 1]], [[0, -1], [0, 1]], [[math.inf, math.inf], [0, 1]], [[0, 1]], [0, 1],
        [[math.nan, 1], [0, 1]], [[-math.inf, 1], [0, 1]], "soon", 3, [[0, 1, 2], [0, 1, 2]],
    ],
)  # fmt: skip
def test_rejects_invalid_windows(windows):
    with pytest.raises(InvalidData, match="windows") as error:
        MessengerTour([[0, 90], [20, 40]], windows=windows)
    assert error.value.field.startswith("windows")
