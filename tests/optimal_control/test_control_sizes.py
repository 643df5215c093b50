"""Independence of units: sizes scale with them, and search and verification scale with the sizes."""

import math

import casadi
import numpy as np
import pytest
from checked import check, phase_plan
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import ControlPlan, OptimalControlProblem


def wall(weight=1.0, length=1.0, time=1.0, scale=None):
    """Return Bryson and Denham's cart in other units of length, time and effort."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, time))
    x = phase.state("x", initial=0, final=0, upper=length / 9)
    v = phase.state("v", initial=length / time, final=-length / time)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    effort = phase.integral(u**2 / 2) * time**3 / length**2
    ocp.minimise(weight * effort, scale=scale)
    return ocp


def disc(length=1.0, time=1.0):
    """Return a path around a disc whose radius is a parameter; nothing else has a size."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, 2 * time))
    r = phase.state("r", 2, initial=[0, 0], final=[length, length])
    v = phase.state("v", 2, initial=[0, 0])
    a = phase.control("a", 2)
    phase.dynamics({r: v, v: a})
    radius = ocp.parameter("radius", lower=0.2 * length, upper=0.2 * length)
    off = r - np.array([0.45, 0.5]) * length
    phase.path(casadi.dot(off, off) >= radius**2)
    ocp.subject_to(phase.final(v[0]) == phase.final(v[1]))
    ocp.minimise(phase.integral(casadi.dot(a, a)))
    return ocp


def test_the_result_is_independent_of_the_weight_of_the_objective():
    plain = ct.solve(wall(), seed=0)
    assert plain.primal_bound == pytest.approx(4.0, rel=1e-7)
    for weight in (1e-9, 1e9):
        found = ct.solve(wall(weight), seed=0)
        assert found.termination == "locally_optimal"
        assert found.primal_bound / weight == pytest.approx(plain.primal_bound, rel=1e-9)
        assert found.statistics["iterations"] == plain.statistics["iterations"], weight


@pytest.mark.parametrize(("length", "time"), [(1e-6, 3600), (1e3, 1e-3)])
def test_the_result_is_independent_of_units(length, time):
    found = ct.solve(wall(1.0, length, time), seed=0)
    assert found.termination == "locally_optimal", found.message
    assert found.primal_bound == pytest.approx(4.0, rel=1e-6)


def test_sizes_without_bounds_follow_from_the_dynamics():
    values = []
    for length, time in ((1e3, 3600.0), (1e-3, 1e-3)):
        found = ct.solve(disc(length, time), tolerance=1e-5, seed=0)
        assert found.termination == "locally_optimal", found.message
        values.append(found.primal_bound * time**3 / length**2)
    assert values == pytest.approx([values[0]] * 2, rel=1e-4)


@pytest.fixture(scope="module")
def plain():
    return disc().formulate("gauss").sizes


@settings(max_examples=10, deadline=None)  # declaring takes longer on a busy machine
@given(st.floats(-6, 6), st.floats(-6, 6))
def test_sizes_scale_with_the_units(plain, length, time):
    length, time = 10.0**length, 10.0**time
    other = disc(length, time).formulate("gauss").sizes
    (one,), (two,) = plain.phases, other.phases
    speed, push = length / time, length / time**2
    units = np.array([length, length, speed, speed])
    assert two.time == pytest.approx(one.time * time)
    assert two.states == pytest.approx(one.states * units, rel=1e-6)
    assert two.controls == pytest.approx(one.controls * push, rel=1e-6)
    assert two.paths == pytest.approx(one.paths * length**2, rel=1e-6)
    assert two.integrals == pytest.approx(one.integrals * push**2 * time, rel=1e-6)
    assert other.boundaries == pytest.approx(plain.boundaries * speed, rel=1e-6)
    assert other.variation == pytest.approx(plain.variation * push**2 * time, rel=1e-6)


def test_scale_sets_the_size_of_the_objective():
    assert wall(scale=7).definition.objective_scale == 7
    assert wall(scale=7).formulate("gauss").program.objective_scale == 7
    assert wall().definition.objective_scale == 0
    assert wall().digest == wall(scale=None).digest != wall(scale=7).digest
    for wrong in (0, -1, math.inf, "much", [1, 2]):
        with pytest.raises(InvalidData, match="scale of the objective"):
            wall(scale=wrong)
    again = type(wall().build()).from_json(wall(scale=7).to_json())
    assert again.definition.objective_scale == 7
    assert "objective_scale" not in wall().to_json()


def _straight(rate):
    return phase_plan((0, 1), {"x": lambda t: rate * t}, {"u": lambda t: rate + 0 * t})


def test_small_limits_are_as_tight_as_large_ones():
    """Check that a rate limit of 0.1 is not exceeded by 0.1 % at a tolerance of 1e-4."""
    for limit in (0.1, 1e-4, 1e4):
        ocp = OptimalControlProblem()
        phase = ocp.phase(time=(0, 1))
        x = phase.state("x", initial=0)
        u = phase.control("u", lower=-limit, upper=limit)
        phase.dynamics({x: u})
        ocp.minimise(-phase.final(x))
        for excess, ok in ((0.5e-4, True), (2e-4, False)):
            rate = limit * (1 + excess)
            plan = ControlPlan((_straight(rate),))
            one = check(ocp.verify(plan, tolerance=1e-4), "bounds of controls")
            assert one.ok is ok and one.scale == pytest.approx(limit)


def test_a_bound_near_0_is_scaled_by_the_range_of_the_state():
    """Check that a bound such as 1e-9, which avoids a division by 0, is not used as a scale."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1, lower=1e-9)
    phase.dynamics({x: -x})
    ocp.minimise(phase.final(x))
    found = ct.solve(ocp, seed=0)
    assert found.verification.ok
    assert check(found.verification, "bounds of states").scale == pytest.approx(1, rel=1e-6)
