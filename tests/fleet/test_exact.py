"""Exact methods for fleets: the programs and subset-dp equal enumeration, feasible or not."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleet.enumerated import (
    OBJECTIVES,
    all_routes,
    allowed,
    best,
    lengths,
    random_fleet,
    sweep,
)
from listening import incumbents

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.instances import entries
from crosstrack.instances.fleet import generate, read_tsplib
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.solvers import Diagnosis
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.fleet.subset_dp import SubsetDP, shortest_tours

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "tsplib"
needs_public = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public instances lie in ../shared/data/tsplib, which is absent"
)


def settled(model, answer, value):
    """Assert that a solution is what enumeration says."""
    if value == np.inf:
        assert answer.termination == "infeasible", (model.describe(), answer)
        return
    # A range of nearly equal lengths has the digits of the lengths.
    scale = max(value, float(model.distances.max()) if model.objective == "range" else 0.0)
    assert answer.termination == "optimal", (model.describe(), answer)
    assert abs(answer.primal_bound - value) <= 2e-6 * scale
    assert answer.dual_bound <= value + 2e-6 * scale


def fits(formulation, plan):
    """Assert that a plan satisfies all rows, and comes back as good as it was."""
    model = formulation.model
    point = formulation.encode(plan)
    found = formulation.program.verify(point)
    assert found.ok, found
    again = model.verify(formulation.decode(point))
    assert again.ok, again
    given = model.verify(plan)
    assert again.objective == pytest.approx(given.objective, rel=1e-9, abs=1e-9 * given.scale)
    assert found.objective == pytest.approx(given.objective, rel=1e-9, abs=1e-9 * given.scale)


# -- against enumeration -------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [*range(1, 9, 2), 60, 107, 116, 129, 323])
def test_three_index_equals_enumeration(seed):
    model = random_fleet(seed)
    value, plan = best(model)
    settled(model, ct.solve(model, "highs", formulation="three-index"), value)
    if plan is not None:
        fits(model.formulate("three-index"), plan)
    if model.q > 0:
        squared = replace(model, objective="sum-variance")
        settled(squared, ct.solve(squared, "highs", formulation="three-index"), best(squared)[0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(400, 600))
def test_three_index_equals_enumeration_often(seed):
    test_three_index_equals_enumeration(seed)


@pytest.mark.parametrize("seed", sweep(25, 50))
def test_subset_dp_equals_enumeration(seed):
    model = replace(random_fleet(1000 + seed), deviation_limit=None, range_limit=None)
    if model.objective == "range":
        model = replace(model, objective="max")
    # As far as the shortest tours are best.
    most = 1.0 if model.vehicles > 1 else 5.0
    model = replace(model, q=min(model.q, most))
    settled(model, ct.solve(model, "subset-dp"), best(model)[0])


@pytest.mark.parametrize("seed", range(5))
def test_two_index_equals_enumeration(seed):
    rng = np.random.default_rng(seed)
    points = np.round(rng.random((int(rng.integers(2, 7)), 2)) * 4) * 10.0 ** rng.integers(-3, 6)
    vehicles = int(rng.integers(1, min(4, len(points))))
    model = FleetRouting(
        vehicles, points=points, depots=int(rng.integers(len(points))), objective="sum",
        use_all=bool(seed % 2),
    )  # fmt: skip
    value, plan = best(model)
    for rounds in (0, 100):
        written = {"formulation": "two-index", "formulation_options": {"root_rounds": rounds}}
        settled(model, ct.solve(model, "highs", **written), value)
    fits(model.formulate("two-index"), plan)
    if value > 0:
        barely = replace(model, budget=value * 1.001)
        settled(barely, ct.solve(barely, "highs", formulation="two-index"), value)
        beyond = replace(model, budget=value * 0.999)
        settled(beyond, ct.solve(beyond, "highs", formulation="two-index"), np.inf)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_every_plan_fits_three_indices(objective):
    """Every plan that the limits allow, of vehicles that are partly alike."""
    rng = np.random.default_rng(3)
    model = FleetRouting(
        3, costs=np.where(np.eye(6), 0, rng.integers(0, 9, (6, 6))), objective=objective,
        use_all=False, depots=[0, 0, 1], battery=[40, 40, 25], budget=70, deviation_limit=15,
        range_limit=30, q=2.0 if objective.startswith("sum-") else 0.0,
        demands=[0, 0, 1, 1, 1, 1], capacity=[4, 4, 2],
    )  # fmt: skip
    written = model.formulate("three-index")
    plans = [
        FleetPlan(routes) for routes in all_routes(model.customers.tolist(), 3)
        if allowed(model, lengths(model, routes), routes)
    ]  # fmt: skip
    assert len(plans) > 200
    for plan in plans[:: len(plans) // 25]:
        fits(written, plan)


def test_held_and_karps_tours():
    distances = np.random.default_rng(5).integers(0, 9, (7, 7)).astype(float)
    found = shortest_tours(distances)
    model = FleetRouting(1, costs=np.where(np.eye(7), 0, distances), depots=6)
    for chosen in range(1, 64):
        nodes = [k for k in range(6) if chosen >> k & 1]
        tours = [lengths(model, [route])[0] for (route,) in all_routes(nodes, 1)]
        assert found[chosen, 6] == min(tours)
    assert found[0, 6] == 0


def test_subset_dp_refuses_models_in_which_a_detour_pays():
    """The bound on q is sharp: beyond it, the best plan has a route that is not the shortest."""
    points = [[0, 0], [0.0, 1.0], [40.0, 0.0], [-2.0, 0.5], [1.5, -1.0]]
    for kind, most in (("sample", 2**0.5), ("population", 2.0)):
        far = {"points": points, "objective": "sum-deviation", "deviation": kind}
        model = FleetRouting(2, **far, q=most * 1.01)
        with pytest.raises(UnsupportedFormulation, match="a detour may pay"):
            ct.solve(model, "subset-dp")
        _, plan = best(model)
        near = min((one for one in plan.routes if 2 not in one), default=())
        shortest = min(lengths(model, [route, ()])[0] for (route,) in all_routes(list(near), 1))
        assert lengths(model, [near, ()])[0] > shortest + 1e-6
        within = replace(model, q=most * 0.99)
        settled(within, ct.solve(within, "subset-dp"), best(within)[0])
    refused = [{"objective": "range"}, {"objective": "sum-variance", "q": 0.1}]
    for more in (*refused, {"deviation_limit": 1.0}, {"range_limit": 1.0}):
        with pytest.raises(UnsupportedFormulation, match="a detour may pay"):
            ct.solve(FleetRouting(2, points=points, **more), "subset-dp")
    with pytest.raises(UnsupportedFormulation, match="more than 15 nodes or vehicles, got 16"):
        ct.solve(generate(16, 2, 1), "subset-dp")
    with pytest.raises(UnsupportedFormulation, match="more than 15 nodes or vehicles"):
        ct.solve(generate(3, 16, 1, use_all=False), "subset-dp")


# -- programs ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ({"objective": "max"}, "the objective 'max'"),
        ({"depots": [0, 1]}, "several depots"),
        ({"battery": 9.0}, "battery"),
        ({"demands": [1] * 4, "capacity": 9.0}, "capacity"),
        ({"deviation_limit": 9.0}, "deviation_limit"),
        ({"range_limit": 9.0}, "range_limit"),
        ({"costs": np.triu(np.ones((4, 4)), 1)}, "distances that depend on the direction"),
    ],
)
def test_two_index_refuses_other_models(more, what):
    data = {"costs": np.ones((4, 4)) - np.eye(4), "objective": "sum", **more}
    with pytest.raises(UnsupportedFormulation, match=what):
        FleetRouting(2, **data).formulate("two-index")


@pytest.mark.parametrize("name", ["two-index", "three-index"])
def test_points_and_plans_that_are_none(name):
    model = generate(6, 2, 1, objective="sum", depots=2)
    written = model.formulate(name)
    plan = FleetPlan([[0, 1, 3], [4, 5, 6]])
    point = written.encode(plan)
    with pytest.raises(InvalidData, match="point must"):
        written.decode(point[:-1])
    for routes in ([[0, 1, 2], [3]], [[9], [0]]):
        with pytest.raises(InvalidData, match=r"routes\[0\]"):
            written.encode(FleetPlan(routes))
    with pytest.raises(InvalidData, match="plan must be a FleetPlan"):
        written.encode([[0, 1, 3], [4, 5, 6]])
    with pytest.raises(UnsupportedOption, match="root_rounds must be a whole number"):
        model.formulate(name, root_rounds=-1)
    # Two nodes joined by an edge to nowhere else: a route without the depot.
    aside = written.encode(FleetPlan([[0, 1, 3], [4]]))
    edges = written._edges
    aside[edges.at[4, 5]] = 2
    with pytest.raises(InvalidData, match="without the depot"):
        written.decode(aside)
    one = np.zeros_like(point)
    one[edges.at[0, 6]] = 1
    with pytest.raises(InvalidData, match="no closed routes"):
        written.decode(one)


def test_separation_finds_violated_cuts():
    """Without the cuts of the root, clusters far from the depot make routes of their own."""
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    points = np.vstack([[[50, 50]], corners, corners + 100, corners + np.array([100, 0])])
    for objective, name, size in (
        ("sum", "two-index", 9), ("sum", "three-index", 9), ("max", "three-index", 7),
    ):  # fmt: skip
        model = FleetRouting(2, points=points[:size], objective=objective)
        bare = {"formulation": name, "formulation_options": {"root_rounds": 0}}
        late = ct.solve(model, "highs", **bare)
        assert late.statistics["refinements"] >= 1
        assert late.statistics["subtour cuts"] >= 1
        again = ct.solve(model, "highs", **bare, warm_start=late.plan)
        early = ct.solve(model, "subset-dp")
        for one in (late, again):
            assert one.termination == "optimal"
            assert one.primal_bound == pytest.approx(early.primal_bound, rel=1e-9)


def test_a_warm_start_is_reused_between_programs():
    """A plan starts every refined program, and a limit that comes between two loses nothing of it."""
    model = generate(30, 3, 2, objective="sum")
    plan = ct.solve(model, "highs", formulation="two-index").plan
    bare = {"formulation": "two-index", "formulation_options": {"root_rounds": 0}}
    seen = []
    answer = ct.solve(model, "highs", **bare, warm_start=plan, on_event=incumbents(seen.append))
    assert answer.statistics["refinements"] >= 1
    best = model.verify(plan).objective
    assert answer.primal_bound == pytest.approx(best, rel=1e-9)
    assert any(one.objective == pytest.approx(best, rel=1e-9) for one in seen)


# -- the catalogue, and the figures ------------------------------------------------------


RICH = ("fleet/mixed-6", "fleet/windows-7")  # enumerated in test_rich.py
SMALL = [
    one
    for one in entries()
    if one.name.startswith("fleet/") and "table" not in one.name and one.name not in RICH
]


def test_exact_methods_agree():
    model = ct.load("fleet/example")
    verdict = judge(model.name, [ct.solve(model, name) for name in ("subset-dp", "highs")], model)
    assert verdict.outcome == "AGREED", verdict


@pytest.mark.parametrize("costs", [[[0, 0], [0, 0]], [[0, 2], [2, 0]], [[0, 1], [3, 0]]])
def test_one_node(costs):
    for objective in OBJECTIVES:
        model = FleetRouting(1, costs=costs, objective=objective)
        value, _ = best(model)
        settled(model, ct.solve(model, "highs", formulation="three-index"), value)
        if objective != "range":
            settled(model, ct.solve(model, "subset-dp"), value)
    model = FleetRouting(3, costs=costs, objective="sum", use_all=False)
    for name in model.formulations if model.symmetric else ["three-index"]:
        settled(model, ct.solve(model, "highs", formulation=name), costs[0][1] + costs[1][0])


@pytest.mark.slow
@pytest.mark.parametrize("entry", SMALL, ids=lambda entry: entry.name)
def test_exact_methods_agree_on_all_of_the_catalogue(entry):
    model = entry.build()
    methods = ["highs", "scip"]
    if not SubsetDP().refuses(model):
        methods.append("subset-dp")
    verdict = ct.compare([model], methods, time_limit=120)
    assert verdict.outcome == "AGREED", verdict
    optimum = entry.published.get("optimum")
    if optimum is not None:
        assert verdict.solutions[0].primal_bound == pytest.approx(optimum, rel=1e-6)


@needs_public
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"), [("bayg29", 9623.0), ("berlin52", 7737.0), ("st70", 690.2)]
)
def test_the_least_sums_are_proven_in_seconds(name, value):
    model = read_tsplib(PUBLIC / f"{name}.tsp", 3, objective="sum", display=True)
    begin = time.perf_counter()
    answer = ct.solve(model, "highs", formulation="two-index", time_limit=120)
    print(f"{name}: {answer.primal_bound:.2f} in {time.perf_counter() - begin:.1f} s")
    assert answer.termination == "optimal"
    assert answer.primal_bound == pytest.approx(value, abs=0.06)
    assert answer.dual_bound == pytest.approx(answer.primal_bound, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("vehicles", "seed"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_twelve_nodes_by_program_and_by_subsets(vehicles, seed):
    model = generate(12, vehicles, seed)
    one = ct.solve(model, "highs", formulation="three-index", time_limit=300)
    other = ct.solve(model, "subset-dp")
    print(f"{vehicles} vehicles, seed {seed}: {one.seconds['total']:.1f} s")
    assert (one.termination, other.termination) == ("optimal", "optimal")
    assert one.primal_bound == pytest.approx(other.primal_bound, rel=1e-6)


# -- diagnosis -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "message", "where"),
    [
        (
            "fleet/battery-too-small",
            "node 2 is out of reach.* takes 85.44 m.* lasts 80 m",
            "node 2",
        ),
        (generate(7, 2, 1, budget=300.0), "together take at least 585.603 m", "budget"),
        (generate(5, 2, 1, deviation_limit=1e-3), "deviation_limit 0.001 is in", "deviation_limit"),
        (generate(5, 2, 1, range_limit=0.0), "range_limit 0 is in the way", "range_limit"),
        (generate(6, 2, 1, battery=250), "battery 250 is in the way.* at least 308.43", "battery"),
        (generate(4, 3, 1, demands=[0, 9, 1, 1, 1], capacity=5), "node 1 takes 9", "node 1"),
        (generate(4, 3, 1, demands=[0, 5, 5, 5, 5], capacity=5), "all nodes take 20", ""),
        (generate(4, 3, 1, demands=[0, 3, 3, 3, 3], capacity=5), "capacity 5 is in", "capacity"),
        (generate(3, 3, 1, battery=[300, 300, 1]), "use_all is in the way.* of 3 veh", "use_all"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_diagnosis_names_the_conflicting_limit(model, message, where):
    model = ct.load(model) if isinstance(model, str) else model
    found = ct.diagnose(model)
    assert found.feasible is False
    texts = [finding.text for finding in found.findings if finding.where == where]
    assert texts, found
    assert re.search(message, texts[0]), texts
    assert Diagnosis.from_dict(json.loads(json.dumps(found.to_dict()))) == found


def test_a_fleet_with_a_plan():
    found = ct.diagnose(ct.load("fleet/example"))
    assert found.feasible
    assert "a plan exists" in found.summary
