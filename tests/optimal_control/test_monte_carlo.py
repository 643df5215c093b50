"""Flights with drawn data: agreement with single flights and closed forms, counts, and invalid input."""

from dataclasses import replace
from functools import cache

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import monte_carlo, scenario_plan


def throw():
    """Return x'' = u / mass - drag x' from a start that is data, with limits that some flights break."""
    ocp = OptimalControlProblem("throw")
    mass, drag = ocp.data("mass", value=1.0), ocp.data("drag", value=0.2)
    x0 = ocp.data("x0", 2, value=[0.0, 0.1])
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=x0[0], upper=1.3, final=(0.9, 1.1))
    v = phase.state("v", initial=x0[1])
    u = phase.control("u", lower=-3, upper=3)
    phase.dynamics({x: v, v: u / mass - drag * v})
    phase.path(casadi.sin(v) + phase.time * mass, upper=2.02, name="mixture")
    effort = phase.integral(u**2 + x**2 * mass)
    ocp.subject_to(effort, upper=5, name="effort")
    ocp.minimise(effort + 10 * (phase.final(x) - 1) ** 2)
    return ocp.build()


def drop(speed=2.0):
    """Return x' = rate without a control, whose limits are kept for known rates."""
    ocp = OptimalControlProblem("drop")
    rate = ocp.data("rate", value=speed)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, upper=2.5, final=(1.8, 2.2))
    phase.dynamics({x: rate})
    ocp.minimise(phase.final(x))
    return ocp.build()


@cache
def dropped():
    """Return the plan of `drop`, which several tests look at."""
    return ct.solve(drop(), seed=0).plan


DATA = {"mass": (0.8, 1.2), "drag": (0.1, 0.3), "x0": ([-0.1, 0.0], [0.1, 0.2])}


def test_flights_equal_simulations_with_the_same_data():
    ocp = throw()
    plan = ct.solve(ocp, seed=0).plan
    found = monte_carlo(ocp, plan, DATA, draws=8, seed=3)
    rows = {(item.name, item.side): item for item in found.limits}
    assert {("x", "upper"), ("final x", "lower"), ("mixture", "upper")} < set(rows)
    # The drawn data determine the start exactly.
    starts = [item for item in found.limits if item.name.startswith("initial")]
    assert len(starts) == 4 and all(item.kept == 8 for item in starts)
    assert found.failed == 0 and found.objectives.shape == (8,)
    values = {name: [] for name in ("x", "final x", "mixture")}
    for k in range(8):
        data = {name: table[k] for name, table in found.data.items()}
        part = ocp.given(**data).attach(replace(plan, parameters=data)).phases[0]
        flight = part.simulate(initial=data["x0"])
        values["x"].append(flight.states[:, 0].max())
        values["final x"].append(flight.states[-1, 0])
        values["mixture"].append(flight.observed["mixture"].max())
    for name, side, limit in (
        ("x", "upper", 1.3),
        ("mixture", "upper", 2.02),
        ("final x", "lower", 0.9),
    ):
        row, each = rows[name, side], np.array(values[name])
        sign = 1 if side == "upper" else -1
        k = int((sign * each).argmax())
        assert row.flight == k
        assert row.worst == pytest.approx(each[k], abs=2e-4)
        assert row.kept == (sign * (each - limit) <= 1e-6 * max(abs(limit), 1)).sum()
    assert 0 < rows["final x", "lower"].kept < 8


def test_counts_and_intervals_equal_those_of_the_distribution():
    ocp = drop()
    plan = ct.solve(ocp, seed=0).plan
    found = monte_carlo(ocp, plan, {"rate": (1.5, 2.5)}, draws=1000, seed=1)
    rates = found.data["rate"][:, 0]
    rows = {(item.name, item.side): item for item in found.limits}
    assert rows["x", "upper"].kept == 1000
    assert rows["final x", "upper"].kept == (rates <= 2.2 * (1 + 1e-6)).sum()
    assert rows["final x", "lower"].worst == pytest.approx(rates.min(), abs=1e-6)
    assert found.all_limits.kept == ((rates <= 2.2) & (rates >= 1.8)).sum()
    assert found.all_limits.low < 0.4 < found.all_limits.high
    np.testing.assert_allclose(found.objectives, rates, atol=1e-6)
    # Wilson (1927) with z = 1.959964.
    z, p = 1.959963984540054, found.all_limits.share
    centre, half = p + z * z / 2000, z * np.sqrt(p * (1 - p) / 1000 + z * z / 4e6)
    bounds = (np.array([-half, half]) + centre) / (1 + z * z / 1000)
    np.testing.assert_allclose([found.all_limits.low, found.all_limits.high], bounds, rtol=1e-9)
    assert "sampled evidence, not a proof" in str(found)
    # The same seed draws the same data; another excess is allowed by name.
    again = monte_carlo(ocp, plan, {"rate": (1.5, 2.5)}, seed=1, allowed={"final x": 0.4})
    np.testing.assert_array_equal(again.data["rate"], found.data["rate"])
    assert again.all_limits.kept == 1000


def test_draws_by_a_function_and_reports_flights_that_fail():
    ocp = OptimalControlProblem("escape")
    rate = ocp.data("rate", value=0.1)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1, upper=5)
    phase.dynamics({x: rate * x**2})
    ocp.minimise(phase.final(x))
    ocp = ocp.build()
    plan = ct.solve(ocp, seed=0).plan
    # x = 1 / (1 - rate t) has no finite value at t = 1 for rates of 1 and more.
    found = monte_carlo(ocp, plan, lambda rng, n: {"rate": np.linspace(0.1, 0.5, n)}, draws=5)
    np.testing.assert_allclose(found.objectives, 1 / (1 - np.linspace(0.1, 0.5, 5)), rtol=1e-6)
    found = monte_carlo(ocp, plan, {"rate": (2.0, 2.0)}, draws=3)
    assert found.failed == 3 and found.all_limits.kept == 0


def test_follows_linked_phases_and_robust_plans():
    ocp = OptimalControlProblem("two legs")
    mass = ocp.data("mass", value=1.0)
    first, second = ocp.phase("go", time=(0, 1)), ocp.phase("stop", time=(1, 2))
    for phase in (first, second):
        x = phase.state("x", initial=0 if phase is first else None)
        v = phase.state("v", initial=0 if phase is first else None)
        u = phase.control("u", lower=-5, upper=5)
        phase.dynamics({x: v, v: u / mass})
    ocp.link(first, second)
    final = second.final(second.symbols["x"])
    ocp.subject_to(final, lower=0.9, upper=1.1, name="arrives")
    ocp.minimise(
        sum(phase.integral(phase.symbols["u"] ** 2) for phase in (first, second))
        + second.final(second.symbols["v"]) ** 2
    )
    robust = ocp.scenarios({"light": {"mass": 0.95}, "heavy": {"mass": 1.05}})
    plan = scenario_plan(ocp, ct.solve(robust, seed=0).plan, "light")
    found = monte_carlo(ocp.build(), plan, {"mass": (0.95, 1.05)}, draws=50)
    row = next(item for item in found.limits if item.name == "arrives" and item.side == "lower")
    # The final position is inversely proportional to the mass.
    ends = plan.phases[1]["x"](2.0) * 0.95 / found.data["mass"][:, 0]
    assert row.worst == pytest.approx(ends.min(), rel=1e-6)
    assert found.all_limits.kept == 50
    linked = [item for item in found.limits if "goes on" in item.name]
    assert all(abs(item.worst - item.limit) < 1e-9 for item in linked)


@pytest.mark.parametrize(
    ("data", "options", "text"),
    [
        ({"speed": (0, 1)}, {}, "'speed' is no data of the problem"),
        ({"rate": 3}, {}, r"data 'rate' must be a range \(lower, upper\)"),
        ({"rate": (1, np.inf)}, {}, "data 'rate' must be a range"),
        (lambda rng, n: {"rate": np.ones(n + 1)}, {}, "or 10 samples of size 1"),
        (7, {}, "data must be"),
        (
            {},
            {"allowed": {"final y": 1}},
            "allowed must name limits, got 'final y'; limits: 'final x', 'x'",
        ),
        ({}, {"allowed": 3}, "allowed must be a mapping of names of limits, got 3"),
        ({}, {"draws": 0}, "draws must be"),
        ({}, {"seed": -1}, "seed must be"),
    ],
)
def test_rejects_invalid_draws(data, options, text):
    ocp = drop()
    plan = dropped()
    with pytest.raises(InvalidData, match=text):
        monte_carlo(ocp, plan, data, **{"draws": 10, **options})


def test_rejects_another_kind_of_problem():
    with pytest.raises(InvalidData, match="problem must be a Definition, got <object"):
        monte_carlo(object(), None, {})
    with pytest.raises(InvalidData, match="plan must be a ControlPlan, got None"):
        monte_carlo(drop().definition, None, {})


@pytest.mark.parametrize("implicit", [False, True])
def test_states_at_instants_and_algebraic_variables_follow_the_data(implicit):
    ocp = OptimalControlProblem("instant")
    mass = ocp.data("mass", value=1.0)
    phase = ocp.phase(time=(0, 2))
    v, u = phase.state("v", initial=0), phase.control("u", lower=-9, upper=9)
    rate = u / mass
    if implicit:
        rate = phase.algebraic("z", guess=1)
        phase.algebraic_equation(mass * rate == u)
    phase.dynamics({v: rate})
    ocp.subject_to(phase.at(0.7, v), upper=0.9, name="slow")
    ocp.minimise((phase.at(1.1, v) - 1) ** 2 + (phase.final(v) - 1) ** 2 + phase.integral(u**2))
    plan = ct.solve(ocp, seed=0).plan
    flights = monte_carlo(ocp, plan, {"mass": (0.5, 2.0)}, draws=60, seed=3)
    drawn = flights.data["mass"][:, 0]
    early, inner, final = (float(plan["v"](t)) for t in (0.7, 1.1, 2.0))
    effort = flights.objectives - (inner / drawn - 1) ** 2 - (final / drawn - 1) ** 2
    assert effort == pytest.approx(np.full(60, effort[0]), abs=1e-6)
    (slow,) = (limit for limit in flights.limits if limit.name == "slow")
    assert slow.worst == pytest.approx(early / drawn.min(), rel=1e-6)
    assert slow.kept == np.sum(early / drawn <= 0.9 * (1 + 1e-6))
    assert flights.failed == 0
