"""Differential-algebraic equations: closed forms, index reduction, verification, storage and errors."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from optimal_control.checked import check
from optimal_control.reactor import reactor
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.optimal_control.tables import write_control_samples
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import round_controls
from crosstrack.models.optimal_control.plan import Piecewise
from crosstrack.models.optimal_control.transcription.mesh import Mesh

GRAVITY, TIME = 9.81, 2.0


def valve(control=False):
    """Return a tank that empties through a valve: ẋ = -z with z³ + z = x, closed form in z.

    From x = z³ + z follows ż (3 z² + 1) = -z, so that 3 z²/2 + ln z + t is constant.
    """
    ocp = OptimalControlProblem("valve")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=2, lower=0, unit="m")
    z = phase.algebraic("z", lower=0, upper=5, guess=1, unit="m/s")
    u = phase.control("u") if control else 0
    phase.dynamics({x: u - z})
    phase.algebraic_equation(z**3 + z == x, name="valve", equation="2")
    phase.path(z <= 4, name="limit of the flow")
    phase.output("power", x * z, unit="W")
    ocp.minimise(phase.integral(z**2 + (u**2 if control else 0)) + phase.final(x) ** 2)
    return ocp


def outflow(t):
    """Return z of :func:`valve` without a control, whose z(0) is 1."""
    return brentq(lambda z: 1.5 * z**2 + np.log(z) + t - 1.5, 1e-9, 2.0, xtol=1e-15)


def cartesian():
    """Return a pendulum of 1 m in Cartesian coordinates, with the constraint differentiated twice."""
    ocp = OptimalControlProblem("pendulum")
    phase = ocp.phase(time=(0, TIME))
    x, y = phase.state("x", initial=0), phase.state("y", initial=-1, final=0)
    v, w = phase.state("v", initial=0), phase.state("w", initial=0, final=0)
    rod, torque = phase.algebraic("rod"), phase.control("torque", lower=-8, upper=8)
    phase.dynamics({x: v, y: w, v: -rod * x - torque * y, w: -rod * y - GRAVITY + torque * x})
    phase.algebraic_equation(v**2 + w**2 - GRAVITY * y == rod * (x**2 + y**2))
    phase.invariant("length", x**2 + y**2)
    phase.guess(x=[0, 1])
    ocp.minimise(phase.integral(torque**2))
    return ocp


def angle():
    ocp = OptimalControlProblem("pendulum")
    phase = ocp.phase(time=(0, TIME))
    a, q = phase.state("a", initial=0, final=np.pi / 2), phase.state("q", initial=0, final=0)
    torque = phase.control("torque", lower=-8, upper=8)
    phase.dynamics({a: q, q: torque - GRAVITY * casadi.sin(a)})
    ocp.minimise(phase.integral(torque**2))
    return ocp


@pytest.fixture(scope="module")
def emptied():
    return ct.solve(valve(), tolerance=1e-7, seed=0)


def test_a_tank_empties_in_closed_form(emptied):
    plan = emptied.plan
    assert emptied.verification.ok
    for t in (0.0, 0.3, 1.0):
        z = outflow(t)
        assert plan["z"](t) == pytest.approx(z, abs=1e-7)
        assert plan["x"](t) == pytest.approx(z**3 + z, abs=1e-7)
        assert plan["power"](t) == pytest.approx(z * (z**3 + z), abs=1e-6)
    z = outflow(1.0)
    # ∫ z² dt = ∫ (3 z³ + z) dz, because dt = -(3 z + 1/z) dz.
    value = 0.75 * (1 - z**4) + 0.5 * (1 - z**2) + (z**3 + z) ** 2
    assert emptied.primal_bound == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize(
    "formulation", ["gauss", "hermite-simpson", pytest.param("radau", marks=pytest.mark.slow)]
)
def test_schemes_agree_with_the_eliminated_variable(formulation):
    # The same problem in z alone: ż (3 z² + 1) = u - z.
    ocp = OptimalControlProblem("eliminated")
    phase = ocp.phase(time=(0, 1))
    z, u = phase.state("z", initial=1, lower=0), phase.control("u")
    phase.dynamics({z: (u - z) / (3 * z**2 + 1)})
    end = phase.final(z)
    ocp.minimise(phase.integral(z**2 + u**2) + (end**3 + end) ** 2)
    expected = ct.solve(ocp, tolerance=1e-8, seed=0).primal_bound
    best = ct.solve(valve(control=True), formulation=formulation, seed=0)
    assert best.verification.ok
    assert best.primal_bound == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("formulation", ["gauss", pytest.param("radau", marks=pytest.mark.slow)])
def test_a_pendulum_in_cartesian_coordinates_equals_the_angle_form(formulation):
    best = ct.solve(cartesian(), formulation=formulation, seed=0)
    expected = ct.solve(angle(), seed=0)
    assert best.primal_bound == pytest.approx(expected.primal_bound, rel=1e-7)
    assert check(best.verification, "length").ok
    t = np.linspace(0, TIME, 9)
    assert best.plan["torque"](t) == pytest.approx(expected.plan["torque"](t), abs=1e-3)
    assert np.arctan2(best.plan["x"](t), -best.plan["y"](t)) == pytest.approx(
        expected.plan["a"](t), abs=1e-5
    )


def test_implicit_dynamics_have_rates_as_algebraic_variables():
    # ẋ + 0.1 ẋ³ = -x
    ocp = OptimalControlProblem("implicit")
    phase = ocp.phase(time=(0, 2))
    x, rate = phase.state("x", initial=1), phase.algebraic("rate")
    phase.dynamics({x: rate})
    phase.algebraic_equation(rate + 0.1 * rate**3 == -x)
    ocp.minimise(phase.final(x))
    best = ct.solve(ocp, seed=0)

    def explicit(t, state):
        return [brentq(lambda r: r + 0.1 * r**3 + state[0], -5, 5, xtol=1e-15)]

    end = solve_ivp(explicit, (0, 2), [1.0], rtol=1e-11, atol=1e-12).y[0, -1]
    assert best.verification.ok and best.primal_bound == pytest.approx(end, abs=1e-8)


@pytest.mark.slow
def test_a_kinetic_batch_reactor_ends_at_the_published_optimum():
    options = {"refine": False, "degree": 4}
    best = ct.solve(reactor(), formulation="radau", seed=0, formulation_options=options)
    assert best.verification.objective == pytest.approx(3.16466910, rel=2e-5)
    plan = reactor().plan_from_data(best.rejected_plan)
    assert plan.end == pytest.approx(1.7468208, rel=5e-5)
    # The guess is a simulation of the differential-algebraic equations.
    assert best.statistics["iterations"] < 60


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["gauss", "radau"])
def test_a_kinetic_batch_reactor_verifies(formulation):
    # Both schemes end 1.4e-5 below the published value.
    best = ct.solve(reactor(), formulation=formulation, seed=0, tolerance=1e-3)
    assert best.verification.ok
    assert best.primal_bound == pytest.approx(3.1646245, rel=1e-6)


def changed(plan, what, change):
    part = plan.phases[0]
    source = getattr(part, what)
    values = tuple(map(change, source.values))
    new = Piecewise(source.knots, source.nodes, values, source.lower, source.upper)
    return replace(plan, phases=(replace(part, **{what: new}),))


def test_verification_solves_the_equations_itself(emptied):
    ocp, plan = valve(), emptied.plan
    assert check(ocp.verify(plan), "algebraic variables").ok
    off = ocp.verify(changed(plan, "controls", lambda table: table + 0.01))
    # The equation and the variable are wrong; the motion is integrated with the solved variable.
    assert not check(off, "valve").ok and check(off, "motion").ok
    wrong = check(off, "algebraic variables")
    assert wrong.worst == pytest.approx(0.01, rel=1e-6) and "z at t =" in wrong.where
    lifted = ocp.verify(changed(plan, "states", lambda table: table * 1.01))
    assert not check(lifted, "motion").ok


def test_inconsistent_initial_values_are_found(emptied):
    plan = emptied.plan
    source = plan.phases[0].controls
    first = source.values[0] + 0.1 * (1 - source.nodes[0][:, None]) / 2
    values = (first, *source.values[1:])
    new = Piecewise(source.knots, source.nodes, values, source.lower, source.upper)
    off = replace(plan, phases=(replace(plan.phases[0], controls=new),))
    wrong = check(valve().verify(off), "algebraic variables")
    assert wrong.where.startswith("z at t = 0 s") and wrong.worst == pytest.approx(0.1, rel=1e-6)


def test_a_solution_that_ceases_to_exist_is_reported():
    # z² = x with ẋ = -1 has no solution after x = 0.
    ocp = OptimalControlProblem("ends")
    phase = ocp.phase(time=(0, 1))
    x, z = phase.state("x", initial=1.5), phase.algebraic("z", lower=0, guess=1)
    phase.dynamics({x: -1 + 0 * z})
    phase.algebraic_equation(z**2 == x)
    ocp.minimise(phase.integral(z))
    plan = ct.solve(ocp, seed=0).plan
    assert plan["z"](0.5) == pytest.approx(1, abs=1e-6)
    lower = changed(plan, "states", lambda table: table - 1.0)
    found = ocp.verify(lower)
    assert check(found, "algebraic variables").worst > 1
    assert not found.ok


def test_declarations_survive_storage(emptied, tmp_path):
    ocp = valve()
    again = type(ocp.build()).from_json(ocp.to_json())
    assert again.digest == ocp.digest and again.verify(emptied.plan, tolerance=1e-6).ok
    (z,) = again.definition.phases[0].controls
    assert z.algebraic and z.unit == "m/s"
    assert [item.algebraic for item in again.definition.phases[0].paths] == [True, False]
    assert ocp.describe().endswith("1 algebraic variables")
    assert "algebraic" not in angle().to_json()
    loaded = again.plan_from_data(emptied.plan.data())
    assert loaded["z"](0.3) == emptied.plan["z"](0.3)


def test_pictures_and_tables_contain_algebraic_variables(emptied, tmp_path):
    table = write_control_samples(emptied.plan, tmp_path / "plan.csv", rate=4).read_text()
    assert table.splitlines()[0] == "phase,t,x,z,valve,limit of the flow,power (W)"
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    figure = ct.plot(valve(), emptied, only=("z", "valve"))
    assert len(figure.axes) == 2 and figure.axes[0].lines


def test_simulations_solve_the_equations(emptied):
    pushed = emptied.plan.simulate(initial={"x": 1.0})
    assert not pushed.failure
    residual = pushed.controls[:, 0] ** 3 + pushed.controls[:, 0] - pushed.states[:, 0]
    assert np.abs(residual).max() < 1e-9
    plan = ct.solve(valve(control=True), seed=0).plan
    steered = plan.simulate(feedback=lambda t, x, plan: [0.0, 0.0])
    assert steered.states[-1, 0] == pytest.approx(outflow(1.0) ** 3 + outflow(1.0), rel=1e-6)


def test_guesses_by_simulation_solve_the_equations():
    ocp = valve(control=True)
    ocp.phases[0].simulate(u=0)
    guess = ocp.definition.phases[0].guess
    assert guess.controls[-1, 0] == pytest.approx(outflow(1.0), rel=1e-4)
    with pytest.raises(InvalidData, match="has the controls 'u'"):
        ocp.phases[0].simulate(z=1)


def test_only_controls_are_kept_calm():
    # Rows that lower the degree of an algebraic variable would contradict its equation.
    mesh = Mesh(np.linspace(0, 1, 3), np.full(2, 6), np.array([True, False]))
    model = valve(control=True).build()
    written = model.formulate("radau", mesh=[mesh], refine=False)
    (phase,) = written.layout.phases
    rows = phase.calm_rows(written.layout.size).tocoo()
    assert rows.shape[0] == mesh.calm_rows.sum() > 0
    controls = model.definition.phases[0].control_names
    assert set(rows.col) <= set(phase.control_columns[controls.index("u")])
    size = written.program.row_count
    (gains,) = written.layout.strains(written.sizes, np.ones(size), written.program.guess)
    assert gains[0] > 0 == gains[1]
    best = ct.solve(
        model, formulation="radau", formulation_options={"mesh": [mesh], "refine": False}
    )
    assert best.plan["z"](0.0) == pytest.approx(1, abs=1e-3)


def test_rounding_refuses_algebraic_variables():
    ocp = OptimalControlProblem("switched")
    phase = ocp.phase(time=(0, 1))
    x, z = phase.state("x", initial=0), phase.algebraic("z")
    on = phase.control("on", lower=0, upper=1, integer=True)
    phase.dynamics({x: z})
    phase.algebraic_equation(z == on)
    ocp.minimise((phase.final(x) - 0.5) ** 2)
    with pytest.raises(InvalidData, match="no algebraic variables"):
        round_controls(ocp, ct.solve(ocp, seed=0).plan, steps=4)


def position(phase):
    x, y = phase.state("x", initial=0), phase.state("v", initial=1)
    rod = phase.algebraic("rod")
    phase.dynamics({x: y, y: -rod * x})
    phase.algebraic_equation(x**2 + y**2 == 1)


def alike(phase):
    x, z = phase.state("x"), phase.algebraic("z", 3)
    phase.dynamics({x: z[0]})
    phase.algebraic_equation(
        casadi.vertcat(z[0] - x, z[1] + z[2], 2 * z[1] + 2 * z[2] - x), equals=0
    )


def missing(phase):
    x, _ = phase.state("x"), phase.algebraic("z", 2)
    phase.dynamics({x: 1})
    phase.algebraic_equation(phase.symbols["z"][0] == x)


def inequality(phase):
    phase.algebraic_equation(phase.algebraic("z") <= 1)


def without_variables(phase):
    x = phase.state("x")
    phase.dynamics({x: 1})
    phase.algebraic_equation(x == 1)


ERRORS = {
    "position": (
        position,
        ["phase 'leg'", "do not determine 'rod'", "index above 1", "differentiate"],
    ),
    "dependent": (alike, ["do not determine 'z[1]', 'z[2]'"]),
    "missing": (missing, ["('z') have 2 entries", "got 1"]),
    "inequality": (inequality, ["algebraic equation 'algebraic equation 1'", "=="]),
    "no variables": (without_variables, ["(none) have 0 entries", "got 1"]),
    "end": (
        lambda p: p.final(p.algebraic("z")),
        ["algebraic variable 'z' has no value at the ends"],
    ),
    "name": (lambda p: (p.control("z"), p.algebraic("z")), ["'z' is declared already"]),
    "guess": (lambda p: p.algebraic("z", guess="a"), ["guess of 'z'"]),
}


@pytest.mark.parametrize(("declare", "words"), ERRORS.values(), ids=ERRORS)
def test_bad_declarations_are_named(declare, words):
    ocp = OptimalControlProblem()
    phase = ocp.phase("leg")
    ocp.minimise(1)

    def built():
        declare(phase)
        return ocp.build()

    with pytest.raises(InvalidData) as caught:
        built()
    assert all(word in str(caught.value) for word in words), str(caught.value)
