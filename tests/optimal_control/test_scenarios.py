"""One control for several realisations of the data: structure, optima, files and invalid input."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import scenario_plan

SHIPS = {"light": {"mass": 0.8}, "heavy": {"mass": 1.25, "x0": [0.05, 0.0]}}


def cart():
    """Return a cart with quantities that depend on the mass, and a tank and a limit that do not."""
    ocp = OptimalControlProblem("cart")
    mass, x0 = ocp.data("mass", value=1.0), ocp.data("x0", 2, value=[0.0, 0.0])
    drag = ocp.data("drag", value=0.1)
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", 2, initial=x0, upper=[1.5, 2])
    fuel = phase.state("fuel", initial=1)
    u = phase.control("u", lower=-3, upper=3)
    load = phase.state("load", initial=2)
    phase.dynamics({x: [x[1], (u - drag * x[1] ** 2) / mass], fuel: -0.1 * u**2, load: 0})
    phase.path(u * x[1], upper=2.5, name="power")
    phase.path(u**2, upper=8, name="heat")
    phase.invariant("weight", load)
    phase.output("momentum", mass * x[1])
    ocp.subject_to(phase.final(fuel), lower=0.1, name="reserve")
    final = phase.final(x)
    ocp.minimise(10 * (final[0] - 1) ** 2 + final[1] ** 2 + 0.1 * phase.integral(u**2))
    return ocp


def push():
    """Return v' = u / mass to a final speed near 1, whose optima have closed forms."""
    ocp = OptimalControlProblem("push")
    mass = ocp.data("mass", value=1.0)
    phase = ocp.phase(time=(0, 1))
    v, u = phase.state("v", initial=0), phase.control("u", lower=-9, upper=9)
    phase.dynamics({v: u / mass})
    ocp.minimise((phase.final(v) - 1) ** 2 + phase.integral(u**2))
    return ocp


def test_copies_only_quantities_that_depend_on_the_data_that_differ():
    definition = cart().scenarios(SHIPS).definition
    phase = definition.phases[0]
    assert [item.name for item in phase.states] == ["x (light)", "x (heavy)", "fuel", "load"]
    assert phase.control_names == ("u",)
    assert [item.name for item in phase.paths] == ["power (light)", "power (heavy)", "heat"]
    assert [item.name for item in phase.invariants] == ["weight"]
    assert [item.name for item in phase.outputs] == ["momentum (light)", "momentum (heavy)"]
    assert phase.integrals == 1
    names = ["initial x of phase 1 (light)", "initial x of phase 1 (heavy)", "reserve"]
    assert [item.name for item in definition.boundaries] == names
    names = ["mass (light)", "mass (heavy)", "x0 (light)", "x0 (heavy)", "drag"]
    assert [item.name for item in definition.parameters] == names
    values = [item.lower.tolist() for item in definition.parameters]
    assert values == [[0.8], [1.25], [0.0, 0.0], [0.05, 0.0], [0.1]]


@pytest.mark.parametrize("objective", ["expectation", "worst"])
def test_every_scenario_of_the_plan_verifies_by_itself(objective):
    ocp = cart()
    robust = ocp.scenarios(SHIPS, objective=objective)
    found = ct.solve(robust, seed=0)
    assert found.termination == "locally_optimal"
    values = []
    for name, data in SHIPS.items():
        part = scenario_plan(ocp, found.plan, name)
        result = ocp.given(**data).verify(part)
        assert result.ok
        values.append(result.objective)
        np.testing.assert_array_equal(part["x"](0.7), found.plan[f"x ({name})"](0.7))
        assert part["momentum"](0.7) == pytest.approx(found.plan[f"momentum ({name})"](0.7))
    expected = np.mean(values) if objective == "expectation" else max(values)
    assert found.primal_bound == pytest.approx(expected, rel=1e-6)
    if objective == "worst":
        assert found.plan.parameters["worst case"][0] == pytest.approx(max(values), rel=1e-6)
        assert values[0] == pytest.approx(values[1], rel=1e-5)  # neither can improve alone


def test_optima_equal_their_closed_forms():
    # With U = ∫ u dt, the cost of a scenario is (U / m - 1)² + U².
    masses, weights = np.array([0.5, 1.0, 2.0]), np.array([1.0, 2.0, 1.0])
    data = [{"mass": m} for m in masses]
    shares = weights / weights.sum()
    best = (shares / masses).sum() / ((shares / masses**2).sum() + 1)
    cost = shares @ ((best / masses - 1) ** 2) + best**2
    found = ct.solve(push().scenarios(data, weights=weights), seed=0)
    assert found.primal_bound == pytest.approx(cost, rel=1e-7)
    np.testing.assert_allclose(found.plan["u"]([0.1, 0.8]), best, rtol=1e-5)
    final = [float(found.plan[f"v ({k})"](1.0)) for k in (1, 2, 3)]
    np.testing.assert_allclose(final, best / masses, rtol=1e-6)
    grid = np.linspace(0, 1, 1_000_001)[:, None]
    worst = ((grid / masses - 1) ** 2 + grid**2).max(axis=1).min()
    found = ct.solve(push().scenarios(data, objective="worst"), seed=0)
    assert found.primal_bound == pytest.approx(worst, rel=1e-6)


def test_one_scenario_is_the_problem_with_its_data():
    alone = ct.solve(push().given(mass=2.0), seed=0)
    for objective in ("expectation", "worst"):
        single = push().scenarios([{"mass": 2.0}], objective=objective)
        assert single.definition.phases[0].state_names == ("v",)
        assert ct.solve(single, seed=0).primal_bound == pytest.approx(alone.primal_bound)


def test_phases_with_a_free_time_share_it():
    ocp = OptimalControlProblem("relay")
    mass, start = ocp.data("mass", value=1.5), ocp.data("start", value=0.1)
    first, second = ocp.phase("a", time=(0, (0.2, 3))), ocp.phase("b", time=((0.2, 3), 3))
    ends = []
    for phase, bound in ((first, 5), (second, 2)):
        x = phase.state("x", initial=start if phase is first else None)
        v = phase.state("v", initial=0 if phase is first else None)
        u = phase.control("u", lower=-bound, upper=bound)
        phase.dynamics({x: v, v: u / mass - 0.1 * v})
        ends += [(x, v, u)]
    ocp.link(first, second)
    ocp.subject_to(second.final(ends[1][0]), lower=1.9, upper=2.1, name="arrives")
    cost = first.integral(ends[0][2] ** 2 + 0.1) + second.integral(2 * ends[1][2] ** 2)
    ocp.minimise(cost + second.final(ends[1][1]) ** 2)
    data = {"a": {"mass": 1.45, "start": 0.1}, "b": {"mass": 1.55, "start": 0.12}}
    robust = ocp.scenarios(data)
    names = ("x (a)", "x (b)", "v (a)", "v (b)")
    assert [phase.state_names for phase in robust.definition.phases] == [names, names]
    found = ct.solve(robust, seed=0)
    assert found.verification.ok
    assert 0.2 < found.plan.phases[0].end < 3
    for name, values in data.items():
        part = scenario_plan(ocp, found.plan, name)
        assert ocp.given(**values).verify(part).ok
        assert part.phases[0].end == found.plan.phases[0].end
        # The link is an equation of the program.
        assert part.phases[1].start == pytest.approx(part.phases[0].end, rel=1e-12)


def test_data_of_scenarios_remain_data_and_files_keep_them():
    robust = cart().scenarios(SHIPS)
    assert type(robust).from_json(robust.to_json()).digest == robust.digest
    solver = ct.prepare(robust, intervals=4, degree=4)
    first, second = solver(), solver(**{"mass (heavy)": 1.1})
    assert first.ok and second.ok and second.objective != first.objective
    slope = first.sensitivity("mass (heavy)").objective[0]
    near = solver(**{"mass (heavy)": 1.25 + 1e-4}).objective - first.objective
    assert near / 1e-4 == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize(
    ("data", "options", "text"),
    [
        ([{"weight": 1}], {}, "'weight' is no data of the problem"),
        ([{"mass": [1, 2]}], {}, "data 'mass' must be a finite number"),
        ([], {}, "data must be one mapping"),
        ([3], {}, "data must be one mapping"),
        (3, {}, "data must be one mapping"),
        ([{"mass": 1}], {"objective": "mean"}, "objective must be one of 'expectation', 'worst'"),
        ([{"mass": 1}], {"weights": [1, 2]}, "weights"),
        ([{"mass": 1}], {"weights": [0.0]}, "weights must have a positive entry"),
        ([{"mass": 1}], {"weights": [1], "objective": "worst"}, "weights are those of"),
    ],
)
def test_rejects_invalid_scenarios(data, options, text):
    with pytest.raises(InvalidData, match=text):
        push().scenarios(data, **options)


def test_names_the_missing_state_of_an_unknown_scenario():
    robust = push().scenarios({"a": {"mass": 1}, "b": {"mass": 2}})
    plan = ct.solve(robust, seed=0).plan
    with pytest.raises(InvalidData, match=r"'v \(c\)' or 'v' for scenario 'c', got 'v \(a\)'"):
        scenario_plan(push(), plan, "c")
    with pytest.raises(InvalidData, match="plan must be a ControlPlan, got None"):
        scenario_plan(push(), None, "a")


def test_values_at_instants_are_those_of_each_scenario():
    ocp = OptimalControlProblem("instant")
    mass = ocp.data("mass", value=1.0)
    phase = ocp.phase(time=(0, 1))
    v, u = phase.state("v", initial=0), phase.control("u", lower=-9, upper=9)
    phase.dynamics({v: u / mass})
    ocp.subject_to(phase.at(0.25, v), upper=0.2, name="slow")
    ocp.minimise((phase.at(0.5, v) - 1) ** 2 + (phase.final(v) - 1) ** 2)
    best = ct.solve(
        ocp.scenarios({"light": {"mass": 0.8}, "heavy": {"mass": 1.25}}, objective="worst")
    )
    assert best.verification.ok and best.plan["v (light)"](0.25) <= 0.2 + 1e-6
    # With the impulse J, v is J / mass at both instants. The worst case is least if J / 0.8 - 1 = 1 - J / 1.25.
    impulse = 2 / (1 / 0.8 + 1 / 1.25)
    assert best.primal_bound == pytest.approx(2 * (1 - impulse / 1.25) ** 2, rel=1e-5)
    for name, value in (("light", 0.8), ("heavy", 1.25)):
        part = ocp.build().given(mass=value).verify(scenario_plan(ocp, best.plan, name))
        assert part.ok, part.summary()


def test_refuses_algebraic_variables():
    ocp = OptimalControlProblem("dae")
    mass = ocp.data("mass", value=1.0)
    phase = ocp.phase(time=(0, 1))
    v, z = phase.state("v", initial=0), phase.algebraic("z")
    phase.algebraic_equation(mass * z == 1)
    phase.dynamics({v: z})
    ocp.minimise(phase.final(v))
    with pytest.raises(InvalidData, match=r"no algebraic variables.*got 'z'"):
        ocp.scenarios([{"mass": 1.0}, {"mass": 2.0}])
