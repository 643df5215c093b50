"""Pipelines: staged plans are verified on every map; the paper's plans may collide."""

import dataclasses

import numpy as np
import pytest
import shapely
from fleet_mission.missions import small, wild
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import UnknownName, UnsupportedFormulation, UnsupportedOption
from crosstrack.instances.fleet_mission import random_mission
from crosstrack.models import GridPath, MinimumSnap
from crosstrack.models.fleet_mission import lengths_of
from crosstrack.solvers import Answer, Termination
from crosstrack.solvers.fleet_mission import flight
from crosstrack.solvers.fleet_mission.corridor import corridor, crossed
from crosstrack.solvers.fleet_mission.flight import resting, slowed, times_along

#: Any backend will do for the routes, and this one takes no time.
QUICK = {"routing": "kmeans-ac"}


def staged(model, **options):
    return ct.solve(model, "staged", seed=0, backend_options={**QUICK, **options})


@pytest.mark.parametrize("changes", [pytest.param(one, id=name) for name, one in wild()])
def test_every_staged_plan_is_verified(changes):
    model = small(**changes)
    found = staged(model)
    assert found.termination == "feasible", found.message
    again = model.verify(found.plan)
    assert again.ok, again
    assert again.objective == pytest.approx(found.primal_bound, rel=1e-9)
    free_by_samples(model, found.plan)


def free_by_samples(model, plan):
    """Assert by points of the curves alone that they keep away from all obstacles."""
    if not model.obstacles:
        return
    solid = shapely.union_all([shapely.Polygon(one.shell, one.holes) for one in model.obstacles])
    for one in plan.trajectories:
        at = one(np.linspace(one.times[0], one.times[-1], 2001))
        away = shapely.distance(shapely.points(at), solid)
        assert away.min() >= model.radius - 1e-6 * model.cell
        if model.radius == 0.0:
            inside = shapely.contains_xy(solid.buffer(-1e-6 * model.cell), at)
            assert not inside.any()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=2, deadline=None)
def test_drawn_missions(seed):
    draw = np.random.default_rng(seed)
    nodes, vehicles = int(draw.integers(2, 9)), int(draw.integers(1, 4))
    model = random_mission(
        nodes, int(draw.integers(0, 7)), min(vehicles, nodes), seed, size=0.4, bounds=(0, 0, 40, 30),
        cell=float(draw.choice([0.3, 0.5, 1.0])), radius=float(draw.choice([0.0, 0.4])),
        separation=float(draw.choice([0.0, 1.5])),
    )  # fmt: skip
    found = staged(model)
    assert found.termination == "feasible", found.message
    free_by_samples(model, found.plan)


def test_the_same_seed_is_the_same_plan_on_any_number_of_threads():
    model = ct.load("fleet-mission/nested")
    one, two = (
        ct.solve(model, "staged", seed=3, threads=k, backend_options=QUICK).plan for k in (1, 2)
    )
    assert one.to_data() == two.to_data()


def test_stages_are_counted():
    found = staged(ct.load("fleet-mission/nested"), trajectories="interior-point")
    counts = found.statistics
    assert counts["robots that rest at knots"] == 0
    assert counts["minimum-snap problems"] == 8
    total = sum(value for name, value in counts.items() if name.endswith(" seconds"))
    assert 0 < total <= found.seconds["solve"] * 1.01
    assert counts["polyline length"] < sum(lengths_of(one).sum() for one in found.plan.trajectories)


def test_wider_corridors_give_longer_and_narrower_ones_shorter_curves():
    model = ct.load("fleet-mission/pocket")
    wide, narrow = (
        staged(model, margin=margin, trajectories="interior-point") for margin in (4.0, 0.1)
    )
    assert narrow.primal_bound < wide.primal_bound
    assert narrow.primal_bound < 1.06 * narrow.statistics["polyline length"]


def test_other_backends_of_the_stages():
    """Programs give the same curves as our own algorithm; other paths are as free as the shortest."""
    model = ct.load("fleet-mission/pocket")
    ours, programs = (staged(model, trajectories=name) for name in ("interior-point", "clarabel"))
    assert programs.statistics["robots that rest at knots"] == 0
    assert programs.primal_bound == pytest.approx(ours.primal_bound, rel=1e-5)
    paths = staged(model, paths="shortcut-greedy")
    assert paths.termination == "feasible", paths.message
    assert paths.statistics["polyline length"] >= ours.statistics["polyline length"] * (1 - 1e-9)


def test_robots_rest_at_knots_if_no_curve_is_found(monkeypatch):
    none = Answer(Termination.NO_SOLUTION)
    monkeypatch.setattr(flight, "programmed", lambda *_: none)
    found = staged(ct.load("fleet-mission/corridor"), trajectories="interior-point")
    assert found.termination == "feasible", found.message
    assert found.statistics["robots that rest at knots"] == 2
    lengths = sum(lengths_of(one).sum() for one in found.plan.trajectories)
    assert lengths == pytest.approx(found.statistics["polyline length"], rel=1e-9)


def test_options_that_name_no_backend_of_a_stage():
    for own, message in (
        ({"routing": "a-star"}, "'routing' must name a backend for fleet-routing, got 'a-star'"),
        ({"paths": "pso-ac"}, "'paths' must name a backend for grid-path, got 'pso-ac'"),
        ({"trajectories": "pso-ac"}, "'trajectories' must name a backend for minimum-snap"),
    ):
        with pytest.raises(UnsupportedOption, match=message):
            staged(small(), **own)
    with pytest.raises(UnsupportedFormulation, match="does not cover corridor"):
        staged(small(), trajectories="banded")


def test_options_with_unknown_names():
    with pytest.raises(UnknownName, match="routing-search"):
        staged(small(), routing="routing-search")


@pytest.mark.parametrize("name", ["corridor", "paper"])
def test_a_run_without_time_returns_the_first_plan(name):
    model = ct.load(f"fleet-mission/{name}")
    found = ct.solve(model, "staged", time_limit=1e-3, backend_options=QUICK)
    assert found.limit == "time"
    assert found.termination == "feasible" and found.verification.ok


def test_the_check_locates_collisions_of_the_papers_curves():
    model = ct.load("fleet-mission/corridor")
    found = ct.solve(model, "paper-pipeline", seed=0)
    assert found.termination == "rejected"
    checks = {check.name: check for check in found.verification.violated}
    where = checks["radius away from obstacles"].where
    x, y = (float(part.split()[1]) for part in where.split("), ")[1].split(", "))
    solid = shapely.union_all([shapely.Polygon(one.shell) for one in model.obstacles])
    worst = checks["radius away from obstacles"].worst
    at = shapely.Point(x, y)
    depth = shapely.distance(at, solid.boundary) if solid.contains(at) else 0.0
    assert worst == pytest.approx(model.radius - shapely.distance(at, solid) + depth, rel=1e-3)


def test_the_papers_pipeline_without_obstacles():
    model = small(obstacles=[], bounds=(-20, -20, 30, 30))
    found = ct.solve(model, "paper-pipeline", seed=0)
    assert found.termination == "feasible", found.message


# -- corridors ---------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_boxes_are_free_overlap_and_hold_the_string(seed):
    draw = np.random.default_rng(seed)
    blocked = draw.random((12, 15)) < 0.25
    free = np.argwhere(~blocked)
    start, goal = free[draw.integers(len(free), size=2)]
    grid = GridPath({"blocked": blocked, "cell": 0.7, "origin": [3, -2]}, start, goal).map
    leg = GridPath(grid, start, goal, connectivity="any")
    found = ct.solve(leg, "any-angle")
    if found.plan is None:
        return
    ends = grid.centres([start, goal]) + draw.uniform(-0.3, 0.3, (2, 2))
    chain = crossed(grid, np.concatenate([ends[:1], found.plan.paths[0], ends[1:]]))
    assert grid.holds(np.array(chain)).all()
    assert (np.abs(np.diff(chain, axis=0)).sum(axis=1) == 1).all()
    margin = float(draw.choice([1e9, 1.0, 0.05]))
    way = corridor(grid, ends, [chain], margin)
    assert (way.knots[way.stops] == ends).all()
    for low, high in zip(way.lower, way.upper, strict=True):
        first, last = grid.cells_of(low + 1e-9), grid.cells_of(high - 1e-9)
        assert not blocked[first[0] : last[0] + 1, first[1] : last[1] + 1].any()
    for knots in (way.knots[:-1], way.knots[1:]):
        assert (knots >= way.lower - 1e-12).all()
        assert (knots <= way.upper + 1e-12).all()
    string = np.hypot(*np.diff(way.knots, axis=0).T).sum()
    slack = 2 * 0.3 * np.sqrt(2)
    assert string <= found.primal_bound + slack + 0.1 * len(way.lower)
    if len(way.lower):
        model = small(obstacles=[], bounds=(-50, -50, 50, 50), nodes=[[0, 0]], vehicles=1)
        rest = slowed(model, resting(model, way))
        assert rest.duration == pytest.approx(resting(model, way).duration, rel=0.05)
        times = np.concatenate([[0.0], np.cumsum(times_along(model, way))])
        boxes = {"corridor_lower": way.lower, "corridor_upper": way.upper}
        asked = MinimumSnap(way.knots, times, **boxes)
        again = dataclasses.replace(asked, times=rest.times)
        assert again.verify(rest).ok


def test_paths_between_touching_cells_and_through_blocked_ones_are_refused():
    grid = GridPath({"blocked": [".@", "@."]}, (0, 0), (0, 0)).map
    assert crossed(grid, np.array([[0.5, 0.5], [1.5, 1.5]])) is None
    assert crossed(grid, np.array([[0.5, 0.5], [1.5, 0.5]])) is None
    assert crossed(grid, np.array([[0.5, 0.5], [0.5, 0.5]])) == [(0, 0)]
    assert crossed(grid, np.array([[5.0, 5.0]])) is None


# -- diagnosis ---------------------------------------------------------------------------------------


def test_the_diagnosis_returns_the_largest_radius():
    model = small()
    found = ct.diagnose(model)
    assert found.feasible
    greatest = found.findings[-1].data["greatest"]
    small(radius=greatest * (1 - 1e-6))
    with pytest.raises(ValueError, match=r"radius|cell"):
        small(radius=greatest * 1.01)
