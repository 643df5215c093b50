"""Derivatives of a solution by its data: agreement with differences, and rejected cases."""

import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole
from optimal_control.test_prepared import everywhere

import crosstrack as ct
from crosstrack.errors import InvalidData, NoDerivative
from crosstrack.models import OptimalControlProblem

STEP = 1e-5


def bounded():
    """Return Bryson and Denham's problem with its bound as data, active at one node or more."""
    problem = OptimalControlProblem("bounded")
    bound = problem.data("bound", value=0.1)
    phase = problem.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    phase.path(x <= bound)
    problem.minimise(phase.integral(u**2 / 2))
    return problem


def relay():
    """Return two phases that meet at a free time."""
    problem = OptimalControlProblem("relay")
    mass = problem.data("mass", value=1.5)
    start = problem.data("start", 2, value=[0.1, 0.2])
    first = problem.phase("a", time=(0, (0.2, 3)))
    x, v = first.state("x", initial=start[0]), first.state("v", initial=start[1])
    u = first.control("u", lower=-5, upper=5)
    first.dynamics({x: v, v: u / mass})
    second = problem.phase("b", time=((0.2, 3), 3))
    y, w = second.state("x", final=2), second.state("v")
    force = second.control("u")
    second.dynamics({y: w, w: force - mass * w})
    problem.link(first, second)
    cost = first.integral(u**2 + 0.1) + second.integral(2 * force**2)
    problem.minimise(cost + second.final(w) ** 2)
    return problem


@pytest.mark.parametrize(
    ("make", "formulation"),
    [
        (brake, "gauss"),
        (cart_pole, "radau"),
        pytest.param(everywhere, "gauss", marks=pytest.mark.slow),
        (everywhere, "hermite-simpson"),
        (bounded, "trapezoid"),
        pytest.param(bounded, "gauss", marks=pytest.mark.slow),
        (relay, "gauss"),
    ],
)
def test_derivatives_agree_with_differences(make, formulation):
    options = {"degree": 4} if formulation in ("gauss", "radau") else {}
    # At other limits a Hermite-Simpson node has a multiplier of 1e-5, close to a corner.
    problem = make().given(limit=1.4) if make is everywhere else make()
    solver = ct.prepare(problem, formulation=formulation, tolerance=1e-9, intervals=6, **options)
    step = solver()
    assert step.ok
    for name, base in solver.data.items():
        found = step.sensitivity(name)
        for k in range(base.size):
            move = np.zeros(base.size)
            move[k] = STEP
            one, two = (solver(**{name: base + side * move}, warm=True) for side in (-1, 1))
            assert one.ok
            assert two.ok
            slope = (two.objective - one.objective) / (2 * STEP)
            assert found.objective[k] == pytest.approx(slope, rel=1e-6, abs=1e-7)
            for number, part in enumerate(step.plan.phases):
                others = [side.plan.phases[number] for side in (one, two)]
                ends = [(other.start, other.end) for other in others]
                moved = (np.array(ends[1]) - ends[0]) / (2 * STEP)
                np.testing.assert_allclose(found.times[number, :, k], moved, atol=1e-5)
                times = part.start + np.array([0.04, 0.41, 0.77]) * part.duration
                for signal in (*part.state_names, *part.control_names):
                    want = (others[1][signal](times) - others[0][signal](times)) / (2 * STEP)
                    have = found(signal, times, phase=part.name)[..., k]
                    size = max(1.0, np.abs(want).max())
                    np.testing.assert_allclose(have, want, atol=1e-5 * size)


def test_shapes_follow_names_and_times():
    step = ct.prepare(cart_pole(), intervals=3, degree=3)()
    found = step.sensitivity("x0")
    assert found.objective.shape == (4,)
    assert found("x", 0.0).shape == (4, 4)
    np.testing.assert_allclose(found("x", 0.0), np.eye(4), atol=1e-8)
    assert found("x", [0.0, 0.5, 1.0]).shape == (3, 4, 4)
    assert found("force", [0.1, 0.2]).shape == (2, 4)
    assert found("x[2]", 0.3).shape == (4,)
    with pytest.raises(InvalidData, match="'x1' is no data"):
        step.sensitivity("x1")


def test_the_derivative_of_a_saturated_control_is_zero():
    step = ct.prepare(brake(value=(4.0, 0.0)), intervals=6, degree=4)()
    assert float(step.plan["u"](0.05)) == pytest.approx(-3.0, abs=1e-6)
    np.testing.assert_array_equal(step.sensitivity("x0")("u", 0.05), [0.0, 0.0])


def _single(bound=np.inf, final=None, cost=None, lower=-np.inf):
    problem = OptimalControlProblem("single")
    a = problem.data("a", value=1.0)
    phase = problem.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=None if final is None else final * a)
    u = phase.control("u", lower=lower, upper=bound)
    phase.dynamics({x: u})
    problem.minimise(phase.integral(u if cost is None else cost(u, a)))
    return problem, phase, x, a


def test_rejects_a_bound_without_a_multiplier():
    problem, *_ = _single(bound=1.0, cost=lambda u, a: (u - a) ** 2)
    solver = ct.prepare(problem, intervals=2, degree=3)
    with pytest.raises(
        NoDerivative,
        match=r"u in interval 1.*strict complementarity.*active for data on one side only",
    ):
        solver().sensitivity("a")
    # On each side of the corner the derivative exists, with different values.
    assert solver(a=0.9).sensitivity("a")("u", 0.5) == pytest.approx(1.0, abs=1e-6)
    assert solver(a=1.1).sensitivity("a")("u", 0.5) == 0.0


def test_rejects_a_singular_arc():
    problem, *_ = _single(bound=1.0, lower=0.0, final=0.5)
    with pytest.raises(NoDerivative, match="second-order condition fails"):
        ct.prepare(problem, intervals=3, degree=4)().sensitivity("a")


def test_rejects_dependent_constraints():
    problem, phase, x, a = _single(cost=lambda u, a: u**2)
    problem.subject_to(phase.final(x) >= a)
    problem.subject_to(2 * phase.final(x) >= 2 * a)
    with pytest.raises(NoDerivative, match="depend on one another"):
        ct.prepare(problem, intervals=2, degree=3)().sensitivity("a")


def test_a_failed_step_has_no_derivative():
    problem, *_ = _single(bound=1.0, lower=-1.0, final=2.0, cost=lambda u, a: u**2)
    step = ct.prepare(problem, intervals=2, degree=3)()
    assert not step.ok
    with pytest.raises(NoDerivative, match="the step failed"):
        step.sensitivity("a")
