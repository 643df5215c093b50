"""The paper's algorithms and their rivals: every plan is valid, seeds repeat, threads change nothing."""

from __future__ import annotations

import functools
import importlib.util
import itertools
import math
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models import FleetRouting
from crosstrack.models.grid_path import GridMap
from crosstrack.solvers import Limit, Termination

#: With options that keep runs short.
OWN = {
    "pso-ac": {"swarm": 6, "iterations": 4, "ants": 4, "ant_iterations": 4},
    "pso-ac-serial": {"swarm": 6, "iterations": 4, "ants": 4, "ant_iterations": 4},
    "kmeans-ac": {"ants": 6, "ant_iterations": 6},
    "tpha": {"population": 10, "generations": 10},
    "ortools-routing": {"solutions": 20},
    "pyvrp": {"patience": 20},
}
#: Solvers of others, and the packages that they need.
YARDSTICKS = {"ortools-routing": "ortools", "pyvrp": "pyvrp"}
#: Pairs of backend and unsupported objective.
REFUSED = {("pyvrp", "range"), ("pyvrp", "sum-deviation"), ("pyvrp", "sum-variance")}
#: Those that share nodes out and find tours then; they seek no limits.
PHASED = ("pso-ac", "kmeans-ac", "tpha")


def ring(n: int, radius: float = 1.0) -> np.ndarray:
    """Return a depot in the middle and nodes around it."""
    turn = 2 * np.pi * np.arange(n) / n
    return np.vstack([[0, 0], radius * np.column_stack([np.cos(turn), np.sin(turn)])])


def lopsided(n: int, seed: int) -> np.ndarray:
    """Return costs whose ways back are longer or shorter, with ties and zeros."""
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 4, (n, n)) * rng.choice([1.0, 1e3], (n, n))
    np.fill_diagonal(costs, 0)
    return costs


RNG = np.random.default_rng(5)
POINTS = RNG.random((14, 2))
WILD = {
    "random": FleetRouting(3, points=POINTS),
    "sum": FleetRouting(3, points=POINTS, objective="sum"),
    "sum-variance": FleetRouting(3, points=POINTS, objective="sum-variance", q=0.7),
    "sum-deviation": FleetRouting(3, points=POINTS, objective="sum-deviation", q=0.7),
    "range": FleetRouting(3, points=POINTS, objective="range", use_all=False),
    "max-sum": FleetRouting(2, points=POINTS, objective="max-sum"),
    "one vehicle": FleetRouting(1, points=POINTS),
    "one node": FleetRouting(1, points=[[0, 0], [3, 4]]),
    "as many vehicles as nodes": FleetRouting(5, points=ring(5)),
    "more vehicles than nodes": FleetRouting(9, points=ring(5), use_all=False),
    "all at one place": FleetRouting(3, points=np.full((8, 2), 7.0)),
    "costs all zero": FleetRouting(3, costs=np.zeros((8, 8))),
    "twins": FleetRouting(3, points=np.repeat(POINTS[:5], 3, axis=0)),
    "one far away": FleetRouting(3, points=np.vstack([POINTS, [[1e6, 1e6]]])),
    "collinear": FleetRouting(2, points=np.column_stack([np.arange(9.0), np.zeros(9)])),
    "ties": FleetRouting(4, points=list(itertools.product(range(4), range(4)))),
    "tiny": FleetRouting(2, points=1e-290 * POINTS),
    "huge": FleetRouting(2, points=1e290 * POINTS),
    "ratios of 1e12": FleetRouting(
        3, costs=np.triu(10.0 ** RNG.integers(-6, 7, (10, 10)), 1) * (1 - np.eye(10)), objective="sum"
    ),
    "asymmetric": FleetRouting(3, costs=lopsided(12, 1)),
    "asymmetric sum": FleetRouting(2, costs=lopsided(9, 2), objective="sum"),
    "several depots": FleetRouting(3, points=POINTS, depots=[0, 5, 9]),
    "depots shared": FleetRouting(3, points=POINTS, depots=[0, 0, 9], objective="sum"),
    "embedded": FleetRouting(
        3, costs=np.abs(POINTS[:, None] - POINTS[None]).sum(axis=-1), depots=3
    ),
    "manhattan": FleetRouting(3, points=POINTS, metric="paper"),
    "on a map": FleetRouting(
        2, points=[[0.5, 0.5], [4.5, 0.5], [0.5, 2.5], [4.5, 2.5], [2.5, 0.5]],
        map=GridMap(".....\n..#..\n..#.."),
    ),
    "capacity": FleetRouting(
        3, points=POINTS, demands=[0, *[1] * 13], capacity=[5, 6, 7], objective="sum"
    ),
    "fractions carried": FleetRouting(
        3, points=POINTS, demands=[0, *[0.1] * 13], capacity=[0.5, 0.5, 0.4]
    ),
    "battery": FleetRouting(3, points=POINTS, battery=[2.5, 3.0, 3.5], use_all=False),
}  # fmt: skip


@pytest.fixture(params=OWN)
def name(request: Any) -> str:
    """Return the name of a backend that is installed."""
    needs = YARDSTICKS.get(request.param, "numpy")
    if importlib.util.find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    return str(request.param)


def solved(model: FleetRouting, name: str, **more: Any) -> Any:
    """Return the verified solution of a short run."""
    options = {**OWN[name], **more.pop("options", {})}
    return ct.solve(model, name, backend_options=options, **more)


@pytest.mark.sample(3)
@pytest.mark.parametrize("case", WILD)
def test_every_plan_is_valid(name: str, case: str) -> None:
    model = WILD[case]
    if (name, case) in REFUSED:
        with pytest.raises(UnsupportedFormulation, match=case):
            solved(model, name)
        return
    found = solved(model, name, seed=3)
    if found.plan is None:  # what heuristics do not seek, they may not find
        assert case in ("capacity", "battery", "fractions carried")
        assert name in (*PHASED, "pso-ac-serial")
        assert found.termination is Termination.NO_SOLUTION
        assert "within" in found.message
        return
    assert found.termination is Termination.FEASIBLE
    assert found.verification.ok
    # Recompute the objective independently.
    d, lengths = model.distances, []
    for home, route in zip(model.homes, found.plan.routes, strict=True):
        stops = [home, *route, home] if route else []
        lengths.append(math.fsum(d[a, b] for a, b in itertools.pairwise(stops)))
    total, most = sum(lengths), max(lengths)
    wanted = {
        "max": most,
        "sum": total,
        "sum-variance": total + model.q * float(np.var(lengths)) if model.q else total,
        "sum-deviation": total + model.q * float(np.std(lengths, ddof=1)) if model.q else total,
        "range": most - min(lengths),
        "max-sum": most + 1e-6 * total,
    }[model.objective]
    assert found.primal_bound == pytest.approx(wanted, rel=1e-12, abs=1e-15)
    assert sorted(node for route in found.plan.routes for node in route) == list(model.customers)
    if model.use_all:
        assert all(found.plan.routes)
    values = [one.objective for one in found.incumbents]
    assert values == sorted(values, reverse=True)


def test_a_seed_gives_one_plan(name: str) -> None:
    model = FleetRouting(4, points=np.random.default_rng(8).random((40, 2)))
    one, two = (solved(model, name, seed=5).plan for _ in range(2))
    assert one.to_data() == two.to_data()
    if name == "ortools-routing":
        return  # it draws nothing
    others = {solved(model, name, seed=seed).primal_bound for seed in range(3)}
    assert len(others) > 1


def test_threads_change_nothing() -> None:
    model = FleetRouting(5, points=np.random.default_rng(9).random((60, 2)))
    for name in PHASED:
        plans = [solved(model, name, seed=2, threads=threads).plan for threads in (1, 2, None)]
        assert plans[0].to_data() == plans[1].to_data() == plans[2].to_data(), name
    serial = solved(model, "pso-ac-serial", seed=2).plan
    assert serial.to_data() == solved(model, "pso-ac", seed=2).plan.to_data()


def test_a_power_of_two_scales_the_plan() -> None:
    points = np.random.default_rng(3).random((30, 2))
    for name in PHASED:
        one = solved(FleetRouting(3, points=points), name, seed=1)
        two = solved(FleetRouting(3, points=points * 2.0**30), name, seed=1)
        assert one.plan.to_data() == two.plan.to_data()
        assert two.primal_bound == one.primal_bound * 2.0**30


def test_limits_are_honoured() -> None:
    model = FleetRouting(10, points=np.random.default_rng(2).random((400, 2)))
    long = {
        "pso-ac": {"iterations": 10**6},
        "kmeans-ac": {"ant_iterations": 10**6},
        "tpha": {"generations": 10**6},
    }
    for name, options in long.items():
        found = ct.solve(model, name, time_limit=0.25, backend_options=options)
        assert found.verification.ok, name
        assert found.limit is Limit.TIME, name
        assert found.seconds["solve"] < 20.0, name  # a busy machine
        # Again and again until the time is used up.
        few = FleetRouting(2, points=ring(8))
        found = solved(few, name, time_limit=0.3, seed=1, options={"restarts": True})
        assert found.limit is Limit.TIME, name
        assert found.statistics["runs"] > 1, name


def best_of_all(model: FleetRouting) -> float:
    """Return the least objective, by trying every way to share the nodes out, and every order."""
    d, nodes = model.distances, model.customers.tolist()

    @functools.cache
    def tour(home: int, held: tuple[int, ...]) -> float:
        if not held:
            return 0.0
        return min(
            sum(d[a, b] for a, b in itertools.pairwise([home, *order, home]))
            for order in itertools.permutations(held)
        )

    least = math.inf
    for owners in itertools.product(range(model.vehicles), repeat=len(nodes)):
        parts = [
            tuple(node for node, owner in zip(nodes, owners, strict=True) if owner == k)
            for k in range(model.vehicles)
        ]
        if model.use_all and not all(parts):
            continue
        if model.capacity is not None and any(
            model.demands[list(part)].sum() > limit + 1e-9
            for part, limit in zip(parts, model.capacity, strict=True)
        ):
            continue
        lengths = [tour(int(home), part) for home, part in zip(model.homes, parts, strict=True)]
        if model.battery is not None and (np.array(lengths) > model.battery * (1 + 1e-9)).any():
            continue
        least = min(least, {"max": max(lengths), "sum": sum(lengths)}[model.objective])
    return least


SIX = RNG.random((7, 2))
SMALL = {
    "max": {"points": SIX},
    "sum": {"points": SIX, "objective": "sum"},
    "sum, some unused": {"points": SIX, "objective": "sum", "use_all": False},
    "max, depots apart": {"points": SIX, "depots": [0, 3]},
    "sum, depots apart": {"points": SIX, "depots": [4, 1], "objective": "sum"},
    "sum, three depots": {"vehicles": 3, "points": SIX, "depots": [5, 2, 5], "objective": "sum"},
    "asymmetric": {"costs": lopsided(6, 4)},
    "asymmetric sum": {"costs": lopsided(6, 5), "objective": "sum"},
    "capacity": {
        "points": SIX, "objective": "sum", "demands": [0, 1, 2, 3, 1, 2, 3], "capacity": [5, 7],
    },
    "battery": {"points": SIX, "objective": "sum", "battery": [1.8, 2.7]},
}  # fmt: skip


@pytest.mark.parametrize("case", SMALL)
def test_no_plan_betters_the_best_of_all_and_yardsticks_find_it(case: str) -> None:
    model = FleetRouting(**{"vehicles": 2, **SMALL[case]})
    best = best_of_all(model)
    assert math.isfinite(best)
    for name, needs in {**dict.fromkeys(PHASED, "numpy"), **YARDSTICKS}.items():
        if importlib.util.find_spec(needs) is None:
            continue
        options = {"solutions": 300} if name == "ortools-routing" else {}
        found = solved(model, name, seed=1, options=options)
        if found.plan is None:
            assert name in PHASED
            assert case in ("capacity", "battery")
            continue
        assert found.primal_bound >= best * (1 - 1e-6) - 1e-12
        if name in YARDSTICKS:
            assert found.primal_bound == pytest.approx(best, rel=1e-6, abs=1e-9), name


@pytest.mark.parametrize("name", ["ortools-routing", "pyvrp"])
def test_yardsticks_stop_in_time(name: str) -> None:
    for objective in ("max", "sum"):
        points = np.random.default_rng(2).random((30, 2))  # a first plan takes 20 ms
        found = ct.solve(FleetRouting(8, points=points, objective=objective), name, time_limit=1.5)
        assert found.verification.ok
        assert found.limit is Limit.TIME
        assert found.seconds["solve"] < 20.0
        assert all(found.plan.routes)


def test_restarts_pay() -> None:
    model = FleetRouting(3, points=np.random.default_rng(4).random((40, 2)))
    for name in PHASED:
        once = solved(model, name, seed=1)
        for limit in (0.3, 3.0, 30.0):  # on a busy machine, few restarts fit into a short limit
            again = solved(model, name, seed=1, time_limit=limit, options={"restarts": True})
            if again.primal_bound < once.primal_bound:
                break
        assert again.primal_bound < once.primal_bound


def test_infeasible_models_have_no_plan(name: str) -> None:
    model = FleetRouting(2, points=POINTS, battery=0.1)
    found = solved(model, name)
    assert found.termination is Termination.NO_SOLUTION
    assert found.plan is None
    if name in PHASED:
        assert "route within battery" in found.message


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("pso-ac", {"swarm": 0}),
        ("pso-ac", {"ants": 0}),
        ("pso-ac", {"device": "tpu"}),
        ("pso-ac-serial", {"device": "gpu"}),
        ("pso-ac", {"learning": float("nan")}),
        ("kmeans-ac", {"evaporation": 0.0}),
        ("kmeans-ac", {"swarm": 3}),
        ("tpha", {"population": 1}),
    ],
)
def test_bad_options_are_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(UnsupportedOption, match=next(iter(options))):
        ct.solve(WILD["random"], name, backend_options=options)
