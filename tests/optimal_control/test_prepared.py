"""Agreement of a prepared solver with `solve`, in any order of calls, warm and cold."""

import json

import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import OptimalControlProblem
from crosstrack.solvers.optimal_control.parametric import Parametric

STATES = np.random.default_rng(17).uniform(-0.3, 0.3, (4, 4))


def everywhere():
    """Return a free-time problem with data in dynamics, path, ends, boundary, integral and objective."""
    problem = OptimalControlProblem("everywhere")
    start = problem.data("start", 2, value=[1.0, 0.2])
    drag, limit, goal, price = (
        problem.data(name, value=value)
        for name, value in (("drag", 0.3), ("limit", 1.5), ("goal", 0.0), ("price", 0.3))
    )
    phase = problem.phase(time=(0, (0.5, 6)))
    x = phase.state("x", initial=start[0], final=goal)
    v = phase.state("v", initial=start[1], final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u - drag * v**3})
    phase.path(u**2 <= limit**2, name="strength")
    problem.subject_to(limit >= 0.1, name="some strength")
    problem.minimise(phase.end + phase.integral(price * u**2))
    return problem


# -- declarations ------------------------------------------------------------------------------------


def test_data_are_stored_and_replaced():
    problem = everywhere().build()
    other = problem.given(drag=0.5, start=[0.9, 0.1])
    assert other.digest != problem.digest
    assert other.given(drag=0.3, start=[1.0, 0.2]).digest == problem.digest
    again = type(problem).from_json(other.to_json())
    assert again.digest == other.digest
    assert [one.given for one in again.definition.parameters] == [True] * 5
    plain = OptimalControlProblem("plain")
    plain.parameter("k", lower=0, upper=1)
    phase = plain.phase()
    x = phase.state("x", initial=1)
    phase.dynamics({x: -x})
    plain.minimise(phase.final(x))
    # Problems stored by earlier versions, and their digests, have no data.
    assert "given" not in json.dumps(plain.build().to_dict())


def test_solve_takes_the_declared_and_the_given_values():
    options = {"intervals": 5, "degree": 5}
    found = ct.solve(brake(), formulation_options=options, tolerance=1e-4, seed=0)
    np.testing.assert_allclose(found.plan["x"](0.0), [1.0, 0.0], atol=1e-8)
    moved = ct.solve(
        brake().given(x0=[0.4, -0.3]), formulation_options=options, tolerance=1e-4, seed=0
    )
    np.testing.assert_allclose(moved.plan["x"](0.0), [0.4, -0.3], atol=1e-8)
    assert moved.plan.parameters["weight"] == found.plan.parameters["weight"] == 0.1
    assert moved.verification.ok


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"x0": [1, 2, 3]}, "'x0' must be 2 finite numbers"),
        ({"x0": [1, np.nan]}, "'x0' must be 2 finite numbers"),
        ({"x0": [np.inf, 0]}, "'x0' must be 2 finite numbers"),
        ({"x0": [[1, 2]]}, "'x0' must be 2 finite numbers"),
        ({"x0": "ab"}, "'x0' must be 2 finite numbers"),
        ({"x0": None}, "'x0' must be 2 finite numbers"),
        ({"x0": [True, False]}, "'x0' must be 2 finite numbers"),
        ({"weight": [1, 2]}, "'weight' must be a finite number"),
        ({"weigth": 1}, "did you mean 'weight'.*its data: 'x0', 'weight'"),
    ],
)
def test_bad_data_are_named(data, words):
    problem = brake()
    with pytest.raises(InvalidData, match=words) as caught:
        problem.given(**data)
    assert caught.value.field == next(iter(data))
    solver = ct.prepare(problem, intervals=2, degree=3)
    with pytest.raises(InvalidData, match=words) as caught:
        solver(**data)
    assert caught.value.field == next(iter(data))


def test_data_are_declared_once_and_finite():
    problem = brake()
    with pytest.raises(InvalidData, match="'x0' is declared already"):
        problem.data("x0")
    with pytest.raises(InvalidData, match="must be 3 finite numbers"):
        problem.data("y", 3, value=[1, 2])
    with pytest.raises(InvalidData, match="size"):
        problem.data("y", 0)


# -- steps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "data", "formulation"),
    [
        pytest.param(
            make, data, formulation, marks=[] if formulation in fast else [pytest.mark.slow]
        )
        for make, data, fast in (
            (brake, {"x0": [0.4, -1.3], "weight": 0.02}, ("gauss", "trapezoid")),
            (cart_pole, {"x0": STATES[0]}, ("radau",)),
            (
                everywhere,
                {"start": [0.7, -0.4], "drag": 1.0, "limit": 0.8, "price": 0.1},
                ("gauss", "hermite-simpson"),
            ),
        )
        for formulation in ("gauss", "radau", "hermite-simpson", "trapezoid")
    ],
)
def test_a_step_equals_a_solve(make, data, formulation):
    options = {"intervals": 6}
    if formulation in ("gauss", "radau"):
        options["degree"] = 4
    problem = make()
    step = ct.prepare(problem, formulation=formulation, tolerance=1e-7, **options)(**data)
    assert step.ok
    asked = problem.given(**data)
    assert step.problem.digest == asked.digest
    program = asked.formulate(formulation, refine=False, **options).program
    single = ct.solve(program, "ipopt", tolerance=1e-8)
    assert single.plan is not None
    np.testing.assert_allclose(step.objective, single.primal_bound, rtol=1e-7)
    np.testing.assert_allclose(step.columns, single.plan, atol=1e-4 * np.abs(single.plan).max())
    np.testing.assert_allclose(step.u0, step.plan.phases[0].controls(0.0), atol=1e-12)


@pytest.mark.parametrize("backend", ["ipopt", "sqpmethod"])
def test_results_are_independent_of_the_order_of_calls(backend):
    solver = ct.prepare(cart_pole(), intervals=5, degree=4, backend=backend)
    cold = [solver(x0=state) for state in STATES]
    again = {k: solver(x0=STATES[k]) for k in (2, 0, 3, 1)}
    warm = [solver(x0=state, warm=True) for state in STATES]
    near = [solver(x0=state, warm=step) for state, step in zip(STATES, cold, strict=True)]
    sampled = [solver(x0=state, warm=step.plan) for state, step in zip(STATES, cold, strict=True)]
    for k, step in enumerate(cold):
        assert step.ok
        assert not step.warm
        # A cold step is independent of earlier ones.
        np.testing.assert_array_equal(again[k].z, step.z)
        for other in (warm[k], near[k], sampled[k]):
            assert other.ok
            # Without multipliers an SQP method may fail at an optimum, and is repeated cold.
            assert other.warm or (backend == "sqpmethod" and other is sampled[k])
            np.testing.assert_allclose(other.objective, step.objective, rtol=1e-6)
            np.testing.assert_allclose(other.u0, step.u0, atol=1e-3)
        assert near[k].iterations <= 1
    # Data that a call does not name have their declared values, not those of earlier calls.
    np.testing.assert_array_equal(solver().data["x0"], [0.0, 0.0, 0.2, 0.0])


def test_a_step_is_verified_on_demand():
    step = ct.prepare(everywhere(), intervals=12, degree=6)(drag=0.4, limit=3.0)
    found = step.verification(1e-4)
    assert found.ok
    assert not ct.prepare(everywhere(), intervals=1, degree=4)(limit=3.0).verification(1e-4).ok
    assert step.problem.verify(step.plan).objective == pytest.approx(step.objective, rel=1e-6)
    costate = step.plan.phases[0].costates
    assert costate is not None


def test_reports_rows_violated_by_data_alone():
    solver = ct.prepare(everywhere(), intervals=5, degree=4)
    assert solver(limit=0.9).ok
    broken = solver(limit=0.05)
    assert not broken.ok
    assert broken.violation >= 0.04
    # After a failure, the next warm step starts from the last successful one.
    assert solver(limit=0.9, warm=True).iterations <= 2


def test_a_failed_warm_start_is_tried_cold():
    solver = ct.prepare(cart_pole(), intervals=5, degree=4, backend_options={"max_iter": 30})
    good = solver(x0=STATES[0])
    far = np.full(good.z.size, 1e8)
    lost = type(good)(
        good.posed, good.values, far, (far, np.full(good.multipliers[1].size, -1e12)), ok=True,
        status="", objective=0.0, seconds=0.0, iterations=0, violation=0.0, warm=False,
    )  # fmt: skip
    step = solver(x0=STATES[0], warm=lost)
    assert step.ok
    np.testing.assert_allclose(step.objective, good.objective, rtol=1e-8)


def test_a_step_keeps_its_time_limit():
    solver = ct.prepare(cart_pole(), intervals=5, degree=4, time_limit=1e-6)
    step = solver()
    assert not step.ok
    assert "Maximum_WallTime" in step.status
    assert ct.prepare(cart_pole(), intervals=5, degree=4, time_limit=100)().ok


def test_uses_the_mesh_of_a_solution():
    problem = everywhere()
    refined = ct.solve(
        problem, tolerance=1e-6, formulation_options={"intervals": 2, "degree": 3}, seed=0
    )
    solver = ct.prepare(problem, mesh=refined)
    step = solver()
    np.testing.assert_allclose(
        step.plan.phases[0].states.knots, refined.plan.phases[0].states.knots, atol=1e-6
    )
    np.testing.assert_allclose(step.objective, refined.primal_bound, rtol=1e-7)
    assert step.verification(1e-5).ok
    # The guess is the solution.
    assert step.iterations <= ct.prepare(problem, intervals=8)().iterations


def test_a_problem_without_data_and_one_that_lowers():
    problem = OptimalControlProblem("plain")
    phase = problem.phase()
    x, u = phase.state("x", initial=1), phase.control("u")
    phase.dynamics({x: u})
    problem.minimise(phase.integral(x**2 + u**2))
    solver = ct.prepare(problem, intervals=3, degree=5)
    assert solver().objective == pytest.approx(np.tanh(1.0), rel=1e-8)
    assert solver.data == {}
    with pytest.raises(InvalidData, match="'x' is no data of the problem; its data: none"):
        solver(x=1)


def test_prepare_rejects_invalid_arguments():
    problem = brake()
    with pytest.raises(
        UnsupportedFormulation, match="flights, grid maps and sideslip models, got model"
    ):
        ct.prepare(ct.load("error-correction/7"))
    with pytest.raises(UnsupportedOption, match=r"over CasADi's nlpsol.*'slsqp'"):
        ct.prepare(problem, backend="slsqp")
    with pytest.raises(UnsupportedOption, match="'refine' can only be false"):
        ct.prepare(problem, refine=True)
    with pytest.raises(UnsupportedOption, match="did you mean 'intervals'"):
        ct.prepare(problem, interval=3)
    with pytest.raises(UnknownName, match="collocation"):
        ct.prepare(problem, formulation="collocation")
    with pytest.raises(InvalidData, match="tolerance must be > 0"):
        ct.prepare(problem, tolerance=0)
    with pytest.raises(UnsupportedOption, match="knows no time_limit"):
        ct.prepare(problem, backend="sqpmethod", time_limit=1)
    solver, other = (ct.prepare(problem, intervals=2, degree=3) for _ in range(2))
    with pytest.raises(InvalidData, match="a step of this solver, got another's"):
        solver(warm=other())
    with pytest.raises(InvalidData, match="warm must be true or false"):
        solver(warm=3)


def test_derivatives_of_a_program_are_built_once(monkeypatch):
    derivative, kinds = Parametric.derivative, []
    monkeypatch.setattr(
        Parametric, "derivative", lambda posed, kind: kinds.append(kind) or derivative(posed, kind)
    )
    ct.prepare(cart_pole(), intervals=2, degree=3)
    assert len(kinds) == len(set(kinds)) > 0
