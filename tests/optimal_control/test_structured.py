"""Agreement of steps on the structure of the intervals with steps of the backend."""

import casadi
import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import OptimalControlProblem
from crosstrack.solvers.optimal_control.elimination import Singular


def limited():
    """Return a problem with free time, a parameter, path and boundary inequalities and a fixed end."""
    problem = OptimalControlProblem("limited")
    start = problem.data("start", 2, value=[1.0, 0.2])
    drag = problem.data("drag", value=0.3)
    k = problem.parameter("k", lower=0.1, upper=5.0, guess=1.0)
    phase = problem.phase(time=(0, (0.5, 6)))
    x = phase.state("x", 2, initial=start, upper=[2.0, 2.0])
    w = phase.state("w", initial=0.0, final=0.3)
    u = phase.control("u", lower=-2.0, upper=2.0)
    phase.dynamics({x: [x[1], u - drag * x[1] ** 3], w: k * x[0] - w})
    phase.path(u * x[1], lower=-1.0, upper=0.4, name="power")
    problem.subject_to(casadi.sumsqr(phase.final(x)) <= 0.01, name="near rest")
    problem.subject_to(phase.final(x)[0] == 0.0, name="there")
    problem.minimise(phase.end + phase.integral(0.3 * u**2) + 0.05 * k**2)
    return problem


CASES = {
    "brake": (brake, {}, [{"x0": [1.0, 0.0]}, {"x0": [0.9, -0.2]}, {"x0": [2.0, 0.5], "weight": 0.02}]),
    "cart-pole": (cart_pole, {}, [{"x0": [0, 0, 0.2, 0]}, {"x0": [0.05, 0.1, 0.1, -0.3]}]),
    "limited": (limited, {}, [{}, {"start": [0.95, 0.15]}, {"start": [0.95, 0.1], "drag": 0.4}]),
}  # fmt: skip


FORMULATIONS = ("gauss", "radau", "hermite-simpson", "trapezoid")


@pytest.mark.parametrize(
    ("case", "formulation"),
    [
        *(("limited", formulation) for formulation in FORMULATIONS[1:]),
        ("brake", "gauss"),
        pytest.param("limited", "gauss", marks=pytest.mark.slow),
        ("cart-pole", "radau"),
        *(
            pytest.param(case, formulation, marks=pytest.mark.slow)
            for case, others in (("brake", FORMULATIONS[1:]), ("cart-pole", FORMULATIONS[::2]))
            for formulation in others
        ),
        pytest.param("cart-pole", "trapezoid", marks=pytest.mark.slow),
    ],
)
def test_structured_steps_equal_those_of_the_backend(case, formulation):
    make, options, steps = CASES[case]
    options = {"intervals": 6, **options}
    if formulation in ("gauss", "radau"):
        options["degree"] = 4
    solvers = [
        ct.prepare(make(), formulation=formulation, structured=structured, **options)
        for structured in (True, False)
    ]
    for number, data in enumerate(steps):
        step, other = (solver(**data, warm=True) for solver in solvers)
        assert step.ok
        assert other.ok
        assert step.method == ("structured" if number else "ipopt")
        assert other.method == "ipopt"
        np.testing.assert_allclose(step.objective, other.objective, rtol=1e-7)
        for mine, theirs in zip(step.multipliers, other.multipliers, strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-4 * max(1.0, np.abs(theirs).max()))
        np.testing.assert_allclose(step.u0, other.u0, atol=1e-4)


def coupled():
    """Return a problem whose objective multiplies its initial and its final state."""
    problem = OptimalControlProblem("coupled")
    phase = problem.phase(time=(0, 1))
    x, u = phase.state("x"), phase.control("u")
    phase.dynamics({x: u})
    problem.minimise((phase.final(x) - phase.initial(x) - 1) ** 2 + phase.integral(u**2 + x**2))
    return problem


def algebraic():
    """Return a problem with a path equation."""
    problem = OptimalControlProblem("algebraic")
    phase = problem.phase(time=(0, 1))
    x, u, v = phase.state("x", initial=1), phase.control("u"), phase.control("v")
    phase.dynamics({x: u})
    phase.path(v - u - x, equals=0)
    problem.minimise(phase.integral(u**2 + v**2))
    return problem


def two_phases():
    """Return a problem of two linked phases."""
    problem = OptimalControlProblem("two")
    phases = [problem.phase(name, time=(k, k + 1)) for k, name in enumerate("ab")]
    for number, phase in enumerate(phases):
        x, u = phase.state("x", initial=None if number else 1), phase.control("u")
        phase.dynamics({x: u})
    problem.link(*phases)
    problem.minimise(sum(phase.integral(phase.symbols["u"] ** 2) for phase in phases))
    return problem


@pytest.mark.parametrize(
    ("make", "reason"),
    [(coupled, "the two ends"), (algebraic, "path constraint is an equation"), (two_phases, "2 phases")],
)  # fmt: skip
def test_programs_without_the_structure_are_left_to_the_backend(make, reason):
    options = {"formulation": "radau", "intervals": 3, "degree": 3}
    solver = ct.prepare(make(), **options)
    assert solver.structured is None
    assert reason in solver.unstructured
    assert solver().ok
    assert solver(warm=True).method == "ipopt"
    with pytest.raises(UnsupportedOption, match=f"structured=True is not possible: .*{reason}"):
        ct.prepare(make(), structured=True, **options)


def test_other_backends_use_the_structure_on_request():
    solver = ct.prepare(brake(), intervals=3, degree=3, backend="sqpmethod")
    assert solver.structured is None
    assert "sqpmethod" in solver.unstructured
    solver = ct.prepare(brake(), intervals=3, degree=3, backend="sqpmethod", structured=True)
    assert [solver(warm=True).method for _ in range(2)] == ["sqpmethod", "structured"]


def test_the_backend_solves_steps_that_do_not_converge(monkeypatch):
    solver = ct.prepare(cart_pole(), intervals=5, degree=4)
    first = solver()
    assert solver(warm=True).method == "structured"

    def fail(*_):
        raise Singular("no curvature")

    monkeypatch.setattr(solver.structured.stages, "solve", fail)
    step = solver(x0=[0.0, 0.0, 0.1, 0.0], warm=first)
    assert (step.ok, step.method, step.warm) == (True, "ipopt", True)


def test_a_saddle_point_is_not_a_step():
    """From a maximiser, where the curvature is negative, the backend leaves for a minimum."""
    problem = OptimalControlProblem("saddle")
    x0 = problem.data("x0", value=0.0)
    phase = problem.phase(time=(0, 1))
    x, u = phase.state("x", initial=x0), phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    problem.minimise(phase.integral(0.01 * u**2) - phase.final(x) ** 2)
    solver = ct.prepare(problem, intervals=3, degree=3)
    best = solver(x0=0.1)
    assert best.objective == pytest.approx(0.01 - 1.1**2, abs=1e-6)
    zero = np.zeros(best.z.size)
    result = solver.structured.solve(np.zeros(1), zero, (zero, np.zeros(best.multipliers[1].size)))
    assert not result["success"] or result["f"] < -0.5


def hill(pair):
    """Return a problem whose guess is a maximum, with one phase or with two linked phases."""
    problem = OptimalControlProblem("hill")
    x0 = problem.data("x0", value=0.0)
    phases = [problem.phase(f"p{k}", time=(k, k + 1)) for k in range(1 + pair)]
    for number, phase in enumerate(phases):
        x, u = phase.state("x", initial=None if number else x0), phase.control("u")
        phase.dynamics({x: u})
    if pair:
        problem.link(*phases)
    end = phases[-1].final(x)
    energy = sum(phase.integral(phase.symbols["u"] ** 2) for phase in phases)
    problem.minimise(0.1 * energy - end**2 + end**4)
    return problem


@pytest.mark.parametrize("pair", [False, True])
@pytest.mark.parametrize("structured", [None, False])
def test_a_maximum_is_left_for_a_minimum(pair, structured):
    """Ipopt stops at its guess, a maximum along u, because it is stationary."""
    solver = ct.prepare(hill(pair), intervals=3, degree=3, structured=structured)
    least = -((1 - 0.1 / (1 + pair)) ** 2) / 4
    first = solver()
    assert (first.ok, first.warm) == (True, False)
    assert first.objective == pytest.approx(least, abs=1e-6)
    zero = np.zeros(first.z.size), np.zeros(first.multipliers[1].size)
    if solver.structured is not None:
        assert not solver.structured.solve(np.zeros(1), 0.0 * first.z, zero)["success"]
    assert solver(warm=True).objective == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize("case", list(CASES))
def test_the_step_solves_the_kkt_system(case):
    """Compare with a dense solution of the same equations."""
    make, _, _ = CASES[case]
    solver = ct.prepare(make(), formulation="gauss", intervals=3, degree=3)
    step, structured = solver(), solver.structured
    gradient, g, jacobian, hessian, _ = structured._at(step.z, step.values, step.multipliers[1])
    count, rows = step.z.size, g.size
    derivative = solver.posed.derivative("hessian").sparsity_out(0)
    upper = casadi.DM(derivative, hessian).full()
    dense = upper + upper.T - np.diag(upper.diagonal()) + np.eye(count)
    jac = np.zeros((rows, count))
    jac[structured._row, structured._column] = jacobian
    weight = np.full(rows, np.inf)
    weight[structured._between] = 2.0
    residual = np.linspace(-1.0, 1.0, rows)
    moved, duals = structured.stages.solve(
        jacobian, hessian, np.ones(count), gradient, residual, weight
    )
    used = np.concatenate([structured._equal, structured._between])
    matrix = np.block([
        [dense, jac[used].T], [jac[used], -np.diag(1.0 / weight[used])],
    ])  # fmt: skip
    expected = np.linalg.solve(matrix, -np.concatenate([gradient, residual[used]]))
    np.testing.assert_allclose(moved, expected[:count], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(duals[used], expected[count:], rtol=1e-6, atol=1e-7)
