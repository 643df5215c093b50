"""Wind and a home that moves: the exact change of frame, bounds, plans, plots and errors."""

import json
import math

import numpy as np
import pytest
from messenger.extended import ground, shortest_flight, trochoid_time

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.messenger.samples import write_tour_samples
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.sampling import outline, track

FIELD = ([[60, 20], [10, 70], [-50, 40]], [[1, 0], [0, -2], [2, 1]])


@pytest.mark.parametrize(
    ("place", "velocity", "wind"),
    [([60, 20], [1, 0], [3, -2]), ([-70, -30], [0, 2], [0, 6]), ([8, -90], [9, 0], [12, 1])],
)
def test_one_vehicle_is_met_at_the_time_of_a_trochoid(place, velocity, wind):
    model = MessengerTour([place], [velocity], radius=0, wind=wind)
    time = trochoid_time(model)
    best = ct.solve(model, seed=1)
    assert best.primal_bound == pytest.approx(time * model.speed, rel=1e-9)
    assert best.plan.times[0] == pytest.approx(time, rel=1e-9)
    assert best.plan.points[0] == pytest.approx(model.where(0, time), rel=1e-8)


def drawn(seed):
    """Return a random model of at most three vehicles with wind, open, or closed to a home that moves."""
    draw = np.random.default_rng(seed)
    n, closed = int(draw.integers(1, 4)), bool(seed % 2)
    wind = draw.uniform(-5, 5, 2)
    return MessengerTour(
        draw.uniform(-90, 90, (n, 2)), draw.uniform(-3, 3, (n, 2)) + wind * draw.choice([0, 0.5], (n, 1)),
        draw.choice([0.0, 5.0], n), start=[0, 0, draw.uniform(0, 6)], wind=wind, closed=closed,
        home_velocity=draw.uniform(-3, 3, 2) if closed and seed % 4 == 1 else None,
    )  # fmt: skip


#: Cases of three vehicles, for which brute force takes longest.
LONG = {seed for seed in range(10) if drawn(seed).size == 3} - {1}


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] if k in LONG else []) for k in range(10)]
)
def test_no_flight_found_by_brute_force_is_shorter_than_a_bound(seed):
    model = drawn(seed)
    best = shortest_flight(model)
    assert math.isfinite(best)
    plain, curved = (
        ct.solve(model, f"{name}-bound").dual_bound for name in ("euclidean", "curvature")
    )
    assert 0 < plain * (1 - 1e-9) <= curved <= best * (1 + 1e-6)


@pytest.mark.parametrize(
    ("closed", "count"), [(False, 2), (True, 2), pytest.param(True, 3, marks=pytest.mark.slow)]
)
def test_the_search_is_at_least_as_good_as_brute_force_and_flies_over_the_ground(closed, count):
    home = [1, 0.5] if closed else None
    field = [part[:count] for part in FIELD]
    model = MessengerTour(*field, wind=[3, -1], closed=closed, home_velocity=home)
    best = ct.solve(model, seed=1)
    plan = best.plan
    assert best.primal_bound <= shortest_flight(model) * (1 + 1e-7)
    poses = ground(model, [p.turn for p in plan.primitives], [p.length for p in plan.primitives])
    legs = [piece.leg for piece in plan.primitives]
    ends = np.searchsorted(legs, range(count), side="right") - 1
    assert np.allclose(poses[ends, :2], plan.points, atol=1e-6)
    vehicles = np.array([model.where(k, t) for k, t in zip(plan.order, plan.times, strict=True)])
    assert (np.hypot(*(plan.points - vehicles).T) <= 5 + 1e-6).all()
    if closed:
        assert np.allclose(poses[-1, :2], np.array(home) * best.primal_bound / 10, atol=1e-5)
    again = ct.solve(model, warm_start=plan, seed=1)
    assert again.primal_bound <= best.primal_bound * (1 + 1e-9)
    local = ct.solve(
        model, "ipopt", warm_start=plan, formulation="primitives",
        backend_options={"mu_strategy": "monotone"},
    )  # fmt: skip
    assert local.primal_bound == pytest.approx(best.primal_bound, rel=1e-6)


@pytest.mark.parametrize("name", ["greedy-boundary", "memetic-relaxed"])
def test_the_algorithms_of_the_paper_fly_in_wind(name):
    model = MessengerTour(*FIELD, wind=[3, -1])
    best = ct.solve(model, name, seed=1, time_limit=2)
    assert best.plan is not None and model.verify(best.plan).ok
    with pytest.raises(ct.errors.UnsupportedFormulation, match="closed"):
        ct.solve(MessengerTour(*FIELD, wind=[3, -1], closed=True), name)


def test_without_turns_the_bound_is_the_optimum_with_a_home_that_moves():
    model = MessengerTour(
        *FIELD, turning_radius=0, start=[0, 0], wind=[3, 2], closed=True, home_velocity=[-2, 1]
    )
    best = ct.solve(model, "euclidean-bound")
    assert best.termination == "optimal"
    assert best.primal_bound == pytest.approx(best.dual_bound, rel=1e-6)
    end = track(best.plan, 0, [best.primal_bound], model.drift).poses[0, :2]
    assert end == pytest.approx(model.home_velocity * best.primal_bound / 10, abs=1e-6)


def test_verification_rejects_a_plan_for_calm_air_and_a_home_at_rest():
    calm = MessengerTour(*FIELD, closed=True)
    plan = ct.solve(calm, seed=1, time_limit=1).plan
    windy = MessengerTour(*FIELD, closed=True, wind=[1, 0]).verify(plan)
    assert {check.name for check in windy.violated} >= {
        "encounter at its point",
        "ends where it begins",
    }
    moved = MessengerTour(*FIELD, closed=True, home_velocity=[1, 0]).verify(plan)
    assert [check.name for check in moved.violated] == ["ends where it begins"]
    assert moved.violated[0].worst == pytest.approx(plan.length / 10, rel=1e-9)


def test_defaults_keep_the_digest_and_fields_survive_json():
    plain = MessengerTour(*FIELD, closed=True)
    still = MessengerTour(*FIELD, closed=True, wind=[0, 0], home_velocity=(0.0, 0.0))
    assert still.digest == plain.digest and "wind" not in still.data()
    windy = MessengerTour(*FIELD, closed=True, wind=[3, -1], home_velocity=[1, 0])
    again = MessengerTour.from_data(json.loads(json.dumps(windy.data())))
    assert again.digest == windy.digest != plain.digest
    assert "wind 3.162 m/s" in windy.describe() and "home at 1 m/s" in windy.describe()


@pytest.mark.parametrize(
    ("fields", "field", "words"),
    [
        ({"wind": [math.nan, 0]}, "wind", "wind"),
        ({"wind": [1, 2, 3]}, "wind", "wind"),
        ({"wind": [-9.5, 0]}, "velocities", "velocities\\[0\\] must be slower than the UAV, 10 m/s relative"),
        ({"wind": [1e300, 0]}, "velocities", "relative to the air"),
        ({"home_velocity": [1, 0]}, "home_velocity", "unless closed is True"),
        ({"home_velocity": [9, 9], "closed": True}, "home_velocity", "home of a closed tour slower"),
        ({"velocities": [[8, 8]] * 3, "wind": [8, 8], "closed": True}, "wind", "home at 11.31"),
        ({"velocities": None, "wind": [1, 0], "closed": True, "start": None}, "start", "start must be given"),
        (
            {"velocities": None, "home_velocity": [1, 0], "closed": True, "start": None},
            "start", "start must be given",
        ),
    ],
)  # fmt: skip
def test_rejects_unreachable_vehicles_and_homes(fields, field, words):
    data = {"positions": FIELD[0], "velocities": FIELD[1], **fields}
    with pytest.raises(InvalidData, match=words) as error:
        MessengerTour(**data)
    assert error.value.field == field


def test_plot_and_export_show_places_over_the_ground(tmp_path):
    model = MessengerTour(*FIELD, wind=[3, -1], closed=True, home_velocity=[1, 0])
    best = ct.solve(model, seed=1, time_limit=2)
    figure = ct.plot(model, best)
    marks = {artist.get_gid() for axes in figure.axes for artist in axes.get_children()}
    assert {"wind", "home"} <= marks
    path = write_tour_samples(best.plan, tmp_path / "path.csv", model=model, rate=2.0)
    rows = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert rows[-1, 1:3] == pytest.approx(model.home_velocity * rows[-1, 0], abs=1e-5)
    # Full circles do not coincide in wind.
    circles = [{"leg": 0, "turn": "L", "length": 40 * math.pi * 5, "heading": 0.0}]
    plan = ct.models.messenger.TourPlan((0,), [0.0], [[0, 0]], [0, 0, 0], circles)
    assert np.ptp(outline(plan, 5.0, np.array([0.3, 0])).poses[:, 0]) > 180
    assert np.ptp(outline(plan, 5.0).poses[:, 0]) < 10.1


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_the_bounds_in_wind_hold_on_two_hundred_cases(block):
    usable = 0
    for seed in range(1000 + 20 * block, 1020 + 20 * block):
        model = drawn(seed)
        best = shortest_flight(model)
        bounds = [
            ct.solve(model, f"{name}-bound").dual_bound for name in ("euclidean", "curvature")
        ]
        assert max(bounds) <= best * (1 + 1e-6)
        usable += math.isfinite(best)
    assert usable >= 15
