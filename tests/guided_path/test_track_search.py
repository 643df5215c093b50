"""Optional fields of guided tours: exactness by enumeration, bounds, errors and refusals."""

import dataclasses

import numpy as np
import pytest
from guided_path.enumerated import best, random_tour
from guided_path.extended import CASES, best_extended, distances, random_extended

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan
from crosstrack.models.guided_path.extensions import extensions_of
from crosstrack.models.model import Model
from crosstrack.solvers import Request
from crosstrack.solvers.guided_path.track_labels import first_label, rest_of
from crosstrack.solvers.guided_path.track_search import TrackSearch
from crosstrack.solvers.guided_path.track_tables import TrackTables

NAMES = ["+".join(case) for case in CASES]
OTHERS = ("a-star", "dynamic-programming", "insert-nearest", "insert-index", "greedy")


def run(model, **options):
    backend = TrackSearch()
    return backend.run(model, Request(options=backend.checked_options(options)))


def assert_exact(model, label):
    """Assert that the search returns the length of the enumeration, or proves that no plan exists."""
    answer, least = run(model), best_extended(model)
    if least == np.inf:
        assert answer.termination == "infeasible", (label, model.data())
        return
    assert answer.termination == "optimal", (label, model.data())
    found = model.verify(answer.point)
    assert found.ok, (label, str(found), model.data())
    assert answer.primal_bound == pytest.approx(least, abs=1e-9), (label, model.data())
    assert found.objective == pytest.approx(least, abs=1e-9), (label, model.data())


@pytest.mark.parametrize("fields", CASES, ids=NAMES)
def test_small_tours_equal_enumeration(fields):
    for seed in range(6):
        assert_exact(random_extended([seed, len(fields)], fields), seed)


@pytest.mark.slow
@pytest.mark.parametrize("fields", CASES, ids=NAMES)
def test_a_thousand_tours_equal_enumeration(fields):
    for seed in range(1000):
        assert_exact(random_extended([seed, len(fields)], fields), seed)


def test_plain_tours_equal_enumeration():
    for seed in range(60):
        model = random_tour(seed)
        answer = run(model)
        limit = 1e-12 * model.size * max(1e-300, float(np.abs(model.coordinates).max()))
        assert abs(answer.primal_bound - best(model)) <= limit, seed
        assert model.verify(answer.point).ok


@pytest.mark.parametrize("seeds", [2, pytest.param(8, marks=pytest.mark.slow)])
@pytest.mark.parametrize("fields", CASES, ids=NAMES)
def test_narrow_beams_have_valid_bounds_and_plans(fields, seeds):
    for seed in range(seeds):
        model = random_extended([seed, 77], fields)
        least = best_extended(model)
        for width in (1, 2, 5):
            answer = run(model, width=width)
            assert answer.dual_bound is None or answer.dual_bound <= least + 1e-9
            if answer.point is not None:
                assert model.verify(answer.point).ok
                assert answer.primal_bound >= least - 1e-9
            if answer.termination == "infeasible":
                assert least == np.inf
        tables = TrackTables(model)
        assert rest_of(tables, first_label(tables))[0] <= least + 1e-9


def test_distances_equal_those_of_a_graph():
    for seed in range(60):
        model = random_extended([seed, 5], ("tree",) if seed % 2 else ("loop", "end"))
        ways, home = distances(model)
        tables = TrackTables(model)
        np.testing.assert_allclose(tables.ways[: model.size, : model.size], ways, atol=1e-12)
        if tables.goal >= 0:
            np.testing.assert_allclose(tables.ways[: model.size, tables.goal], home, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e6])
def test_scaled_tours_have_scaled_lengths(scale):
    for seed in range(8):
        model = random_extended([seed, 3], ("end", "loads", "windows"))
        ends = model.end * scale if isinstance(model.end, float) else model.end
        scaled = dataclasses.replace(
            model, coordinates=model.coordinates * scale, end=ends, speed=model.speed * scale,
            loads=model.loads * scale, capacity=None if model.capacity is None else model.capacity * scale,
        )  # fmt: skip
        answer, least = run(scaled), best_extended(model)
        if least == np.inf:
            assert answer.termination == "infeasible"
        else:
            assert answer.primal_bound == pytest.approx(least * scale, rel=1e-9, abs=1e-300)
            assert scaled.verify(answer.point).ok


def test_the_default_backend_and_the_refusals():
    for seed, fields in enumerate(CASES):
        model = random_extended([seed, 9], fields)
        assert ct.solve(model).backend == "track-search"
        for backend in OTHERS:
            with pytest.raises(
                UnsupportedFormulation, match=f"the fields .*{extensions_of(model)[0]}"
            ):
                ct.solve(model, backend)
        for formulation in model.formulations:
            with pytest.raises(UnsupportedFormulation, match="does not cover the fields"):
                model.formulate(formulation).program  # noqa: B018
    assert ct.solve(GuidedPathTour([0, 1, 3], chains=[[2, 1]], speed=2.0)).backend != "track-search"


@pytest.mark.parametrize("fields", CASES, ids=NAMES)
def test_json_keeps_models_and_plans(fields):
    for seed in range(10):
        model = random_extended([seed, 4], fields)
        again = Model.from_json(model.to_json())
        assert again == model
        plan = run(model).point
        if plan is not None:
            assert again.plan_from_data(model.plan_to_data(plan)) == plan
            rows = model.details(plan)
            assert rows[-1]["walked"] == model.verify(plan).objective


def test_defaults_keep_the_digest_and_the_data():
    model = GuidedPathTour([0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]])
    assert model.digest == "6e5db7770acf6d4914a988a688dc3eb4ee89dcda8a90db39865d010260ad1e4b"
    same = GuidedPathTour(
        [0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]], end=None, track="line", loads=None
    )
    assert same == model
    assert set(model.data()) == {"coordinates", "chains", "precedence", "ids"}
    assert GuidedPathPlan((1, 2)).data() == {"order": [1, 2]}


TREE = {"tree": [[0, 1, 5.0], [1, 2, 3.0]], "at": [0, 0, 1]}
WINDOWS = [[0, None], [0, 9], [0, 9]]


@pytest.mark.parametrize(
    ("options", "field", "text"),
    [
        ({"end": "home"}, "end", "must be None .the start., .free. or a coordinate"),
        ({"end": float("nan")}, "end", "finite"),
        ({"end": True}, "end", "number"),
        ({"loads": [0, 1]}, "loads", "2 entries"),
        ({"loads": [3, 1, 1], "capacity": 2}, "loads", r"0 … 2 .capacity., got 3"),
        ({"loads": [-1, 1, 1]}, "loads", r"loads\[0\]"),
        ({"loads": [0, 1e308, 1e308]}, "loads", "finite sum"),
        ({"windows": [[-1e308, 1e308]] * 3, "speed": 1}, "speed", "finite times"),
        ({"track": np.arange(3)}, "track", "must be .line."),
        ({"capacity": 2}, "capacity", "needs loads"),
        ({"loads": [0, 1, 1], "capacity": -1}, "capacity", ">= 0"),
        ({"windows": WINDOWS}, "speed", "need a speed"),
        ({"windows": WINDOWS, "speed": 0}, "speed", "> 0"),
        ({"windows": [[0, 9], [5, 4], [0, 9]], "speed": 1}, "windows", r"windows\[1\]"),
        ({"windows": [[None, None], [0, 4], [0, 9]], "speed": 1}, "windows", r"windows\[0\]"),
        ({"service": [0, -1, 0]}, "service", ">= 0"),
        ({"speed": 1e-320}, "speed", "finite times"),
        ({"end": 1.7e308}, "end|speed|coordinates", "finite"),
        ({"track": "ring"}, "track", "must be .line."),
        ({"track": {"loop": 0}}, "track", "> 0"),
        ({"track": {"loop": 2.5}}, "coordinates", r"coordinates\[2\] must be in 0 … 2.5"),
        ({"track": {"loop": 9}, "end": 10}, "end", "0 … 9"),
        ({"track": {"tree": [[0, 1, 5.0]], "at": [0, 0]}}, "track", "track.at has 2 entries"),
        ({"track": {"tree": [[0, 1, 2.0]], "at": [0, 0, 0]}}, "coordinates", "length of edge 0"),
        (
            {"track": {"tree": [[0, 1, 5], [1, 0, 3]], "at": [0, 0, 0]}},
            "track",
            "node 2 is not connected",
        ),
        ({"track": {"tree": [[0, 1, -5]], "at": [0, 0, 0]}}, "track", ">= 0"),
        ({"track": {"tree": [], "at": []}}, "track", "1 … 1000 edges"),
        ({"track": TREE, "end": 1.0}, "end", "on a tree"),
        ({"vehicles": []}, "vehicles", "first at"),
        ({"vehicles": [1, 2]}, "vehicles", r"coordinates\[0\] = 0"),
        ({"vehicles": [0, 2, 1]}, "vehicles", "in the order on the line"),
        ({"vehicles": [0, 1], "track": {"loop": 9}}, "vehicles", "need a line"),
        ({"vehicles": [0, 1], "end": 3}, "end", "several vehicles"),
    ],
)
def test_contradictions_are_named(options, field, text):
    with pytest.raises(InvalidData, match=text) as error:
        GuidedPathTour([0, 1, 3], **options)
    assert error.value.field.split(".")[0] in field.split("|")


@pytest.mark.parametrize(
    ("plan", "text"),
    [
        (GuidedPathPlan((1, 2), (0,)), "each of 2 stops, got 1"),
        (GuidedPathPlan((1, 2)), "each of 2 stops, got 0"),
        (GuidedPathPlan((1, 2), (0, 2)), r"vehicles\[1\] must be in 0 … 1, got 2"),
    ],
)
def test_plans_of_other_vehicles_are_refused(plan, text):
    with pytest.raises(InvalidData, match=text):
        GuidedPathTour([0, 1, 3], vehicles=[0, 2]).verify(plan)
    with pytest.raises(InvalidData, match="must be empty"):
        GuidedPathTour([0, 1, 3]).verify(GuidedPathPlan((1, 2), (0, 0)))


def test_a_vehicle_makes_room():
    """The left vehicle serves 9 and pushes the right one from 4 to 9 and back: 18 + 10 m."""
    model = GuidedPathTour([0, 9, 4], vehicles=[0, 4], speed=1.0)
    found = model.verify(GuidedPathPlan((2, 1), (1, 0)))
    assert (found.ok, found.objective) == (True, 28.0)
    assert ct.solve(model).primal_bound == 10.0


def test_passing_without_service_may_be_necessary():
    """With capacity 1, the customer at 1 must wait until the load of 2 is set down at 3."""
    model = GuidedPathTour([0, 1, 2, 3], chains=[[2, 3]], loads=[0, 1, 1, -1], capacity=1)
    solution = ct.solve(model)
    assert solution.plan.order == (2, 3, 1)
    assert solution.primal_bound == 6.0


def test_a_larger_tour_has_a_plan_and_a_bound():
    rng = np.random.default_rng(1)
    x = rng.integers(0, 200, 41)
    jobs = (np.arange(40) + 1).reshape(20, 2).tolist()
    loads = [0, *[1, -1] * 20]
    model = GuidedPathTour(x, chains=jobs, loads=loads, capacity=3, end="free")
    answer = run(model, width=80)
    assert model.verify(answer.point).ok
    assert 0 < answer.dual_bound <= answer.primal_bound
    assert answer.termination == "feasible"
    assert answer.limit == "memory"


@pytest.mark.parametrize(
    "fields",
    [
        # -0.3 + 0.2 + 0.1 > 0 in floating-point numbers.
        {"coordinates": [0.1, 0.0], "speed": 1.0, "service": [0.2, 0.2],
         "windows": [[-0.3, 0.4], [0.0, 0.0]]},
        {"coordinates": [0.1, 0.0], "speed": 1.0, "service": [0.2, 0.0], "end": "free",
         "windows": [[-0.3, None], [-1.0, 0.0]]},
        # The last window leaves no time, and its rounding error exceeds 1e-9 of the first one.
        {"coordinates": [0.0, 0.0, 0.0, 1 / 3], "speed": 0.3, "service": [0.0, 1e-6, 0.0, 3e-6],
         "precedence": [(2, 3), (1, 3)],
         "windows": [[0.0, None], [0.0, 0.0], [0.0, 0.0], [1.111112111111111] * 2]},
        # Only rounding permits the load.
        {"coordinates": [0, 1, 2], "loads": [0.3, 1e-10, 0], "capacity": 0.1 + 0.2},
    ],
)  # fmt: skip
def test_plans_at_the_limits_are_found_and_verified(fields):
    model = GuidedPathTour(**fields)
    answer = run(model)
    assert answer.termination == "optimal"
    assert model.verify(answer.point).ok
    assert answer.dual_bound <= answer.primal_bound
    assert ct.diagnose(model).feasible
    tables = TrackTables(model)
    assert rest_of(tables, first_label(tables))[0] <= answer.primal_bound


def test_the_check_of_loads_names_a_customer():
    model = GuidedPathTour([0, 1, 2], loads=[1, 0, -1], capacity=1, ids=["depot", "a", "b"])
    (check,) = [c for c in model.verify(GuidedPathPlan((1, 2))).checks if "load" in c.name]
    assert check.where == "customer a"


def test_the_text_of_a_plan_states_no_end():
    assert str(GuidedPathPlan((2, 1, 3))) == "2-1-3"
    assert str(GuidedPathPlan((2, 1), (1, 0))) == "2-1 by vehicles 1-0"


def test_seventy_vehicles():
    model = GuidedPathTour([0, 50.5, 20], vehicles=np.arange(70))
    solution = ct.solve(model, "track-search")
    assert (solution.termination, solution.primal_bound) == ("optimal", 1.0)
    with pytest.raises(UnsupportedFormulation, match="2 customers and 3000 vehicles: at most 3000"):
        ct.solve(GuidedPathTour([0, 1, 2], vehicles=np.arange(3000)), "track-search")
    many = GuidedPathTour(np.arange(501), vehicles=np.zeros(100), windows=[[0, 9]] * 501, speed=1)
    with pytest.raises(UnsupportedFormulation, match="500 chains and 100 vehicles: the extensions"):
        ct.solve(many, "track-search")


@pytest.mark.parametrize("fields", [{"end": "free"}, {"vehicles": [0, 5]}])
def test_a_short_limit_keeps_a_simple_plan(fields):
    model = GuidedPathTour(np.arange(400) % 7, **fields)
    answer = TrackSearch().run(model, Request(time_limit=0.0, options={}))
    assert answer.termination == "feasible"
    assert model.verify(answer.point).ok


@pytest.mark.parametrize("other", [1e6, 1e18])
@pytest.mark.parametrize("latest", [0.0, 0.05])
def test_other_times_do_not_loosen_a_latest_time(latest, other):
    windows = [[0, None], [0, latest], [-3e5, other]]
    model = GuidedPathTour([0, 0.1, 1], speed=1.0, windows=windows, chains=[[1, 2]])
    assert not model.verify(GuidedPathPlan((1, 2))).ok
    assert run(model).termination == "infeasible"


@pytest.mark.parametrize("shift", [0.0, 1.7e9, -1.7e9])
def test_a_shift_of_all_times_does_not_accept_a_late_plan(shift):
    for latest, status in ((50.0, "infeasible"), (100.0, "optimal")):
        windows = shift + np.array([[0.0, 1e4], [0.0, latest], [0.0, 1e4]])
        model = GuidedPathTour([0, 100, 200], speed=1.0, windows=windows)
        assert run(model).termination == status
        assert model.verify(GuidedPathPlan((1, 2))).ok == (status == "optimal")
