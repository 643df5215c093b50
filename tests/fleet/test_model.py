"""Fleet routing: its data, its plan, and a check that believes nothing but distances and routes."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from fleet.enumerated import OBJECTIVES, allowed, deviation, lengths, objective, random_fleet

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FleetRouting, GridMap, Model
from crosstrack.models.fleet import FleetPlan

SQUARE = [[0, 0], [0, 3], [4, 3], [4, 0]]


def violated(model, routes, tolerance=1e-6):
    return {check.name for check in model.verify(FleetPlan(routes), tolerance=tolerance).violated}


def random_routes(model, rng):
    """Hand out the nodes at random."""
    nodes = rng.permutation(model.customers)
    ends = np.sort(rng.integers(0, nodes.size + 1, model.vehicles - 1))
    return tuple(tuple(part.tolist()) for part in np.split(nodes, ends))


# -- what the check finds ------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(60))
def test_checks_equal_plain_arithmetic(seed):
    model, rng = random_fleet(seed), np.random.default_rng(seed)
    for _ in range(5):
        routes = random_routes(model, rng)
        loads = lengths(model, routes)
        found = model.verify(FleetPlan(routes), tolerance=1e-9)
        assert found.objective == pytest.approx(objective(model, loads), rel=1e-12, abs=1e-300)
        assert found.ok == allowed(model, loads, routes), found
        plan = FleetPlan(routes)
        assert model.second_objective("sum", plan) == pytest.approx(loads.sum())
        assert model.second_objective("max", plan) == loads.max()
        assert model.second_objective("deviation", plan) == pytest.approx(deviation(model, loads))
        assert model.second_objective("range", plan) == np.ptp(loads)


def test_each_fault_is_named():
    model = FleetRouting(
        2, points=SQUARE, battery=[100, 14.1], demands=[0, 1, 2, 3], capacity=3, budget=26.1,
        deviation_limit=2.9, range_limit=4.1,
    )  # fmt: skip
    assert violated(model, [[1], [2]]) == {"each node visited once"}
    assert violated(model, [[1, 2], [3, 3]]) == {
        "each node visited once",
        "demands within capacity",
    }
    assert violated(model, [[1, 2, 3], []]) == {
        "every vehicle used", "demands within capacity", "deviation within limit", "range within limit",
    }  # fmt: skip
    assert violated(model, [[3], [1, 2]]) == set()
    assert "route within battery" in violated(replace(model, battery=11.9), [[3], [1, 2]])
    assert "sum within budget" in violated(replace(model, budget=19.9), [[3], [1, 2]])
    assert violated(model, [[1], [2], [3]]) == {"one route for each vehicle"}
    (worst,) = replace(model, battery=11.9).verify(FleetPlan([[3], [1, 2]])).violated
    assert (worst.where, worst.worst) == ("vehicle 1", pytest.approx(0.1))
    for node in (-1, 4):
        with pytest.raises(InvalidData, match=r"routes\[1\]\[0\] must be in 0 … 3"):
            model.verify(FleetPlan([[1, 2, 3], [node]]))
    with pytest.raises(InvalidData, match="plan must be a FleetPlan"):
        model.verify([[1], [2, 3]])


def test_depots_are_no_nodes_to_visit():
    model = FleetRouting(2, points=SQUARE, depots=[0, 3])
    assert model.customers.tolist() == [1, 2]
    assert violated(model, [[1], [2]]) == set()
    assert violated(model, [[1, 3], [2]]) == {"each node visited once"}
    assert lengths(model, [[1], [2]]).tolist() == [6.0, 6.0]


@pytest.mark.parametrize("kind", ["sample", "population"])
def test_deviations(kind):
    model = FleetRouting(2, points=SQUARE, objective="sum-deviation", q=2, deviation=kind)
    plan = FleetPlan([[1, 2], [3]])
    loads = [12.0, 8.0]
    spread = np.std(loads, ddof=kind == "sample")
    assert model.verify(plan).objective == pytest.approx(20 + 2 * spread)
    # Eq. 16 by hand: the mean of 12 and 8 is 10, so ((12 - 10)^2 + (8 - 10)^2) / 2 = 4.
    assert replace(model, objective="sum-variance").verify(plan).objective == 20 + 2 * 4
    alone = replace(model, vehicles=1)
    assert alone.verify(FleetPlan([[1, 2, 3]])).objective == 14


# -- data ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(0, 40, 3))
def test_json_holds_all(seed):
    model = random_fleet(seed)
    again = Model.from_json(model.to_json())
    assert (again.digest, again.to_dict()) == (model.digest, model.to_dict())
    plan = FleetPlan(random_routes(model, np.random.default_rng(seed)))
    data = json.loads(json.dumps(model.plan_to_data(plan)))
    assert model.plan_from_data(data).routes == plan.routes


def test_metrics():
    points = [[0.0, 0.0], [1.4, 2.3], [-3.0, 0.6]]
    true, rounded, paper = (
        FleetRouting(1, points=points, metric=name).distances
        for name in ("euclidean", "rounded", "paper")
    )
    for i, j in itertools.product(range(3), repeat=2):
        away = np.abs(np.subtract(points[i], points[j]))
        assert true[i, j] == pytest.approx(np.hypot(*away))
        assert rounded[i, j] == int(np.hypot(*away) + 0.5)
        assert paper[i, j] == pytest.approx(away.sum())
    wall = GridMap(["...", "@@.", "..."])
    around = FleetRouting(1, points=[[0.5, 0.5], [0.5, 2.5]], map=wall)
    assert around.metric == "grid"
    assert around.distances[0, 1] == pytest.approx(6)
    assert (
        FleetRouting(1, points=[[0.5, 0.5], [0.5, 2.5]], map=wall, metric="paper").distances[0, 1]
        == 2
    )


def test_one_number_counts_for_all_vehicles():
    model = FleetRouting(3, points=SQUARE, battery=20, demands=[0, 1, 1, 1], capacity=2, depots=2)
    assert model.battery.tolist() == [20] * 3
    assert model.capacity.tolist() == [2] * 3
    assert model.homes.tolist() == [2] * 3


ONE_WAY = [[0, 1, 2], [3, 0, 1], [1, 1, 0]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, "costs or points must be given, got neither"),
        ({"map": GridMap(["."])}, "points must be given beside a map"),
        ({"costs": [[0, 1], [1, 0]], "metric": "euclidean"}, "metric must not be given beside costs"),
        ({"costs": [[0, 1], [1, 1]]}, r"costs\[1, 1\] must be 0, got 1"),
        ({"costs": [[0, 1, 2], [1, 0, 3]]}, "costs has"),
        ({"costs": [[0, -1], [1, 0]]}, "costs.* must be >= 0"),
        ({"costs": [[0, np.nan], [1, 0]]}, "costs.* must be finite"),
        ({"costs": [[0, np.inf], [1, 0]]}, "costs.* must be finite"),
        ({"points": [[0, 0], [np.nan, 1]]}, "points.* must be finite"),
        ({"points": [[0, 0]]}, "there must be a node to visit beside the depot, got 1 nodes"),
        ({"points": SQUARE, "vehicles": 4}, "vehicles must be at most the 3 nodes to visit"),
        ({"points": SQUARE, "vehicles": 0}, "vehicles must be"),
        ({"points": SQUARE, "vehicles": 2.5}, "vehicles must be a whole number"),
        ({"points": SQUARE, "depots": [0, 1, 2]}, "depots must be one node, or one for each of 2"),
        ({"points": SQUARE, "depots": 4}, r"depots must be nodes 0 … 3, got 4"),
        ({"points": SQUARE, "depots": -1}, "depots must be >= 0"),
        ({"points": SQUARE, "capacity": 3}, "demands must be given together with capacity"),
        ({"points": SQUARE, "demands": [1] * 4}, "capacity must be given together with demands"),
        ({"points": SQUARE, "demands": [1, 2], "capacity": 3}, "demands has 2 entries"),
        ({"points": SQUARE, "battery": [1, 2, 3]}, "battery has 3 entries where vehicles has 2"),
        ({"points": SQUARE, "battery": -1}, "battery.* must be >= 0"),
        ({"points": SQUARE, "q": 1}, "q must be 0 unless the objective is 'sum-variance'"),
        ({"points": SQUARE, "objective": "least"}, "objective must be one of"),
        ({"points": SQUARE, "budget": np.inf}, "budget must be finite"),
        ({"points": SQUARE, "ids": ["a", "b", "b", "c"]}, "ids must differ"),
        ({"points": SQUARE, "metric": "grid"}, "map must be given for the metric 'grid'"),
        ({"points": [[0.5, 0.5], [1.5, 0.5]], "map": GridMap([".@"]), "vehicles": 1},
         r"points\[1\] \(node 1\) must lie in a free cell"),
        ({"points": [[0.5, 0.5], [2.5, 0.5]], "map": GridMap([".@."]), "vehicles": 1,
          "ids": ["home", "beyond"]}, "node beyond cannot be reached from node home"),
    ],
)  # fmt: skip
def test_bad_data(data, message):
    with pytest.raises(InvalidData, match=message):
        FleetRouting.from_data({"vehicles": 2, **data})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([[1], [2]], "a plan must be an object with the keys routes, starts"),
        ({"routes": "12"}, "routes must be a list, got"),
        ({"routes": {"0": [1]}}, "routes must be a list, got"),
        ({"routes": [[1.5]]}, r"routes\[0\]"),
        ({"routes": [[1], ["a"]]}, r"routes\[1\]"),
        ({"routes": [[[1]]]}, r"routes\[0\]"),
        (
            {"routes": [[1]], "more": 1},
            "unknown key 'more' in the data of a plan; allowed: routes, starts",
        ),
    ],
)
def test_bad_plans(data, message):
    with pytest.raises(InvalidData, match=message):
        ct.load("fleet/example").plan_from_data(data)


def test_words():
    model = FleetRouting(
        2, costs=ONE_WAY, objective="sum-deviation", q=0.5, budget=9, range_limit=1
    )
    assert model.describe() == "2 vehicles, 2 nodes, sum-deviation, q 0.5, limits: budget, range"
    assert not model.symmetric
    assert FleetRouting(1, points=SQUARE).symmetric
    assert str(FleetPlan([[1, 2], []])) == "1-2 | at the depot"
    assert {str(one) for one in type(model.objective)} == {*OBJECTIVES, "cost", "makespan"}
