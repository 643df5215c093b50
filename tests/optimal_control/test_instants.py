"""Values at interior instants: closed forms, published estimates, verification, storage and errors."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from optimal_control.checked import check
from optimal_control.measured import alpha_pinene, gas_oil

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.plan import Piecewise

#: Effort of a beam: clamped at 0 and 1, it is raised by 1 at a = 1/3 by a force of 3 / (a b)³ with
#: b = 1 - a, and ∫ u² is the force times the rise.
GATE = 3 / (1 / 3 * 2 / 3) ** 3


def gate(end=1.0, *, at=None, bound=True):
    """Return a mass that moves from 0 to 0, at rest at both ends, through x = 1 after a third."""
    ocp = OptimalControlProblem("gate")
    phase = ocp.phase(time=(0, end))
    x, v = phase.state("x", initial=0, final=0), phase.state("v", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    place = phase.at(phase.start + phase.duration / 3 if at is None else at, x)
    if bound:
        ocp.subject_to(place == 1, name="gate", unit="m")
    ocp.minimise(phase.integral(u**2) + (0 if bound else 1e9 * (place - 1) ** 2))
    return ocp


@pytest.mark.parametrize(
    "formulation", ["gauss", pytest.param("radau", marks=pytest.mark.slow), "hermite-simpson"]
)
def test_a_condition_at_an_instant_has_the_closed_form(formulation):
    best = ct.solve(gate(), formulation=formulation, seed=0)
    assert best.primal_bound == pytest.approx(GATE, rel=1e-8)
    assert best.plan["x"](1 / 3) == pytest.approx(1, abs=1e-9)
    assert best.statistics["meshes"] <= 2  # the corner of the control is a knot


def test_a_global_polynomial_is_evaluated_between_its_nodes():
    options = {"refine": False, "degree": 40}
    best = ct.solve(gate(), formulation="paper", formulation_options=options)
    assert best.plan["x"](1 / 3) == pytest.approx(1, abs=1e-9)
    assert best.primal_bound == pytest.approx(GATE, rel=1e-4)


def test_a_cost_at_an_instant_approaches_the_condition():
    assert ct.solve(gate(bound=False), seed=0).primal_bound == pytest.approx(GATE, rel=1e-6)


def test_a_fraction_moves_with_a_free_end():
    best = ct.solve(gate((2.0, 2.5)), seed=0)
    assert best.plan.end == pytest.approx(2.5, rel=1e-6)  # the effort falls with the time
    assert best.primal_bound == pytest.approx(GATE / 2.5**3, rel=1e-6)
    assert best.plan["x"](2.5 / 3) == pytest.approx(1, abs=1e-8)


def slalom(halves):
    """Return a mass that passes 1 after a quarter and -1 after three, in one phase or two halves."""
    ocp = OptimalControlProblem("slalom")
    spans = [(0, 0.5), (0.5, 1)] if halves else [(0, 1)]
    phases, places, cost = [], [], 0
    for k, span in enumerate(spans):
        phase = ocp.phase(time=span)
        ends = (0 if k == 0 else None), (0 if k == len(spans) - 1 else None)
        x, v = (phase.state(name, initial=ends[0], final=ends[1]) for name in "xv")
        u = phase.control("u")
        phase.dynamics({x: v, v: u})
        times = [t for t in (0.25, 0.75) if span[0] < t < span[1]]
        places += [phase.at(t, x) for t in times]
        phases.append(phase)
        cost += phase.integral(u**2)
    if halves:
        ocp.link(*phases)
    for place, value in zip(places, (1, -1), strict=True):
        ocp.subject_to(place == value)
    ocp.minimise(cost)
    return ocp


def test_instants_in_linked_phases_are_those_of_one_motion():
    one, two = (ct.solve(slalom(halves), seed=0) for halves in (False, True))
    assert two.verification.ok
    assert two.primal_bound == pytest.approx(one.primal_bound, rel=1e-8)
    assert two.plan.phases[1]["x"](0.75) == pytest.approx(-1, abs=1e-8)


def test_more_instants_than_knots_are_interpolated():
    ocp = OptimalControlProblem("many")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1)
    rate = ocp.parameter("rate", lower=0, upper=5, guess=1)
    phase.dynamics({x: -rate * x})
    times = np.linspace(0, 1, 301)
    ocp.minimise(sum((phase.at(t, x) - np.exp(-2 * t)) ** 2 for t in times))
    best = ct.solve(ocp, seed=0)
    assert best.plan.parameters["rate"] == pytest.approx(2, rel=1e-6)
    assert best.plan.phases[0].states.intervals < 50


@pytest.mark.parametrize(
    ("make", "value", "digits", "formulation"),
    [
        (alpha_pinene, 19.8721, 5e-6, "gauss"),
        (gas_oil, 5.2366e-3, 1e-5, "hermite-simpson"),
        pytest.param(alpha_pinene, 19.8721, 5e-6, "hermite-simpson", marks=pytest.mark.slow),
        pytest.param(gas_oil, 5.2366e-3, 1e-5, "gauss", marks=pytest.mark.slow),
    ],
)
def test_published_estimates(make, value, digits, formulation):
    best = ct.solve(make(), formulation=formulation, seed=0)
    assert best.verification.ok
    assert best.primal_bound == pytest.approx(value, rel=digits)


def moved(plan, by):
    """Return the plan with a smooth bump of size `by` on x, which is 0 at both ends."""
    part = plan.phases[0]
    source, values = part.states, []
    for k, (nodes, table) in enumerate(zip(source.nodes, source.values, strict=True)):
        low, high = source.knots[k : k + 2]
        t = low + 0.5 * (nodes + 1) * (high - low)
        values.append(table + by * np.outer(np.sin(np.pi * t) ** 2, [1.0, 0.0]))
    states = Piecewise(source.knots, source.nodes, tuple(values))
    return replace(plan, phases=(replace(part, states=states),))


def test_verification_evaluates_the_plan_and_the_integrated_motion():
    ocp = gate()
    plan = ct.solve(ocp, seed=0).plan
    assert check(ocp.verify(plan), "gate").ok
    # The plan misses the gate, although its control passes it.
    off = check(ocp.verify(moved(plan, 0.1)), "gate")
    assert off.worst == pytest.approx(0.075, rel=1e-6) and not off.ok
    # The plan passes the gate, but its control does not.
    controls = plan.phases[0].controls
    weaker = replace(controls, values=tuple(0.9 * table for table in controls.values))
    part = replace(plan.phases[0], controls=weaker)
    off = check(ocp.verify(replace(plan, phases=(part,))), "gate")
    assert off.worst == pytest.approx(0.1, rel=1e-6) and "(integrated)" in off.where
    # The objective of a cost at an instant is compared, too.
    squares = gate(bound=False)
    assert not check(squares.verify(moved(plan, 0.1)), "objective").ok


def test_instants_survive_storage():
    ocp = gate()
    best = ct.solve(ocp, seed=0)
    again = type(ocp.build()).from_json(ocp.to_json())
    assert again.digest == ocp.digest
    assert again.definition.phases[0].instants == ocp.definition.phases[0].instants
    assert again.verify(best.plan).ok
    assert ct.solve(again, seed=0).primal_bound == pytest.approx(best.primal_bound, rel=1e-9)
    plain = OptimalControlProblem("plain")
    phase = plain.phase()
    phase.dynamics({phase.state("x"): 0})
    plain.minimise(phase.initial(1))
    assert "instants" not in plain.to_json()


def test_instants_at_the_ends_are_the_ends():
    ocp = OptimalControlProblem("ends")
    phase = ocp.phase(time=(2, 4))
    x = phase.state("x")
    phase.dynamics({x: 1})
    assert casadi.is_equal(phase.at(2, x), phase.initial(x))
    assert casadi.is_equal(phase.at(phase.end, x), phase.final(x))
    assert casadi.is_equal(phase.at(3, x), phase.at(phase.start + phase.duration / 2, x))
    ocp.minimise(phase.at(2.5, x * phase.time))
    assert ocp.definition.phases[0].instants == (0.25, 0.5)


ERRORS = {
    "outside": (lambda p, x: p.at(5, x), ["phase 'leg'", "between", "0 and 4", "got 5"]),
    "before": (lambda p, x: p.at(-1, x), ["between", "got -1"]),
    "control": (lambda p, x: p.at(1, p.control("u")), ["control 'u' has no value"]),
    "text": (lambda p, x: p.at("1", x), ["instant of phase 'leg'", "'1'"]),
    "nan": (lambda p, x: p.at(float("nan"), x), ["instant of phase 'leg'", "nan"]),
    "several": (lambda p, x: p.at([1, 2], x), ["must be one number", "[1, 2]"]),
    "state": (lambda p, x: p.at(x, x), ["uses 'x'", "two phases"]),
}


@pytest.mark.parametrize(("declare", "words"), ERRORS.values(), ids=ERRORS)
def test_bad_instants_are_named(declare, words):
    phase = OptimalControlProblem().phase("leg", time=(0, 4))
    with pytest.raises(InvalidData) as caught:
        declare(phase, phase.state("x"))
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_a_number_needs_fixed_times():
    ocp = OptimalControlProblem()
    phase = ocp.phase("leg", time=(0, (1, 4)))
    x = phase.state("x")
    for time in (0.5, ocp.parameter("when")):
        with pytest.raises(InvalidData, match="two phases"):
            phase.at(time, x)


def test_an_instant_is_not_a_function_of_time():
    ocp = OptimalControlProblem()
    phase = ocp.phase("leg")
    x = phase.state("x")
    phase.dynamics({x: phase.at(0.5, x)})
    ocp.minimise(phase.final(x))
    with pytest.raises(InvalidData, match=r"rate uses 'x\(fraction 0.5\)'"):
        ocp.build()


def test_diagnosis_names_the_condition():
    ocp = OptimalControlProblem("late")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    ocp.subject_to(phase.at(0.5, x) >= 2, name="early arrival")
    ocp.minimise(phase.integral(u**2))
    assert "early arrival" in str(ct.diagnose(ocp))
