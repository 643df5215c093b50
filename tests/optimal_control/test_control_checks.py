"""Verification of optimal control plans, against exact plans."""

import math
from dataclasses import replace

import casadi
import numpy as np
import pytest
from checked import REST, check, parametric, phase_plan, piecewise, rest_plan, rest_problem, swing

from crosstrack.errors import InvalidData
from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.checks import motion, verify_control
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_spread


def test_an_exact_plan_verifies_to_rounding():
    found = rest_problem().verify(rest_plan(), tolerance=1e-12)
    assert found.ok and found.objective == pytest.approx(6.0, rel=1e-14)
    assert [one.name for one in found.checks] == [
        "motion",
        "continuity of states",
        "times",
        "initial values",
        "final values",
        "bounds of controls",
        "both",
        "objective",
    ]
    assert max(one.worst for one in found.checks) < 1e-13
    assert check(found, "motion").equation == "2"
    assert check(found, "both").equation == "7" and check(found, "both").unit == "m"
    # x + v is largest where t² + t = 1, at no point of the grid.
    assert check(found, "both").where == "t = 0.618034 s"


def test_motion_is_open_to_pictures():
    found = motion(rest_problem(), rest_plan())
    assert found.windows == 1 and found.failure == ""
    assert found.states.shape == found.deviation.shape == (found.times.size, 2)
    assert np.abs(found.deviation).max() < 1e-13
    # exp of [[0, 1], [0, 0]] over a second, in the size of the states (1 and 1.5).
    assert found.growth == pytest.approx(np.linalg.norm([[1, 1.5], [0, 1]], 2), rel=1e-3)
    assert found.integrals == pytest.approx([6.0], rel=1e-12)
    assert motion(rest_problem(), rest_plan(), "phase 1").windows == 1
    for phase in (1, "climb", None):
        with pytest.raises(InvalidData, match="phase must be"):
            motion(rest_problem(), rest_plan(), phase)


def test_extra_knots_change_nothing():
    problem = rest_problem()
    few = problem.verify(rest_plan((0.0, 1.0)))
    many = problem.verify(rest_plan(np.linspace(0, 1, 14)))
    assert many.objective == pytest.approx(few.objective, rel=1e-14)
    for one, other in zip(few.checks, many.checks, strict=True):
        assert (one.name, one.ok) == (other.name, other.ok)
        assert one.worst == pytest.approx(other.worst, abs=1e-12)


@pytest.mark.parametrize(
    ("changed", "fails", "worst"),
    [
        ({"controls": {"u": lambda t: 6.001 - 12 * t}}, {"motion", "final values"}, 1e-3),
        ({"states": {"v": lambda t: 6 * t - 5.999 * t**2}}, {"motion", "final values"}, 1e-3),
        ({"states": {"x": lambda t, m: REST["x"](t) + 1e-3 * (m > 0.3)}}, {"motion"}, 1e-3),
        ({"knots": (0.0, 0.3, 1.001)}, {"times"}, 1e-3),
    ],
)
def test_each_departure_is_found(changed, fails, worst):
    found = rest_problem(upper=7).verify(rest_plan(**changed))
    assert not found.ok
    assert fails <= {one.name for one in found.violated}
    for name in fails:
        assert check(found, name).worst == pytest.approx(worst, rel=0.5)


def test_the_control_alone_decides_where_the_motion_ends():
    # States that end as they should, with a control that does not bring them there.
    found = rest_problem(7).verify(rest_plan(controls={"u": lambda t: 6.01 - 12 * t}))
    final = check(found, "final values")
    assert final.worst == pytest.approx(0.01, rel=1e-6) and "(integrated)" in final.where
    assert check(found, "motion").where.startswith("v at t = 1 s")
    assert check(found, "objective").ok  # the integrand speaks of the control alone
    assert rest_problem(7).verify(rest_plan()).ok


def test_a_jump_at_a_knot_is_found_from_both_sides():
    jump = {"x": lambda t, m: REST["x"](t) + 1e-3 * (m > 0.3)}
    found = rest_problem().verify(rest_plan(states=jump))
    one = check(found, "continuity of states")
    assert one.worst == pytest.approx(1e-3, rel=1e-9) and one.where == "x at t = 0.3 s"
    # A control may jump, and both its limits count: 6.5 is reached from the left of 0.3 only.
    spike = {"u": lambda t, m: (6 - 12 * t) * (m > 0.3) + (m < 0.3) * (2.4 + (t / 0.3) ** 3 * 4.1)}
    one = check(rest_problem().verify(rest_plan(controls=spike)), "bounds of controls")
    assert one.worst == pytest.approx(0.5, rel=1e-9) and one.where == "u at t = 0.3 s"
    assert one.unit == "m/s²" and one.tolerance == pytest.approx(6e-6)


def test_a_bound_broken_between_the_nodes_is_found():
    # x = 4.5 t² (1 - t) reaches 2/3 at t = 2/3, between the nodes, at which it is at most 0.61.
    ocp = OptimalControlProblem("hump")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", upper=0.66)
    u = phase.control("u", upper=1.4)
    phase.dynamics({x: u})
    phase.path(x**2 * u, upper=10, name="product")
    phase.path(casadi.vertcat(x, x**2), upper=[1.0, 0.44], name="pair")
    ocp.minimise(phase.final(x))
    plan = ControlPlan(
        (
            phase_plan(
                (0, 1), {"x": lambda t: 4.5 * t**2 * (1 - t)}, {"u": lambda t: 9 * t - 13.5 * t**2}
            ),
        )
    )
    assert np.abs(plan.phases[0].states.values[0]).max() < 0.65
    found = ocp.verify(plan)
    states, pair = check(found, "bounds of states"), check(found, "pair")
    assert states.worst == pytest.approx(2 / 3 - 0.66, abs=1e-12)
    assert states.where == "x at t = 0.666667 s"
    assert check(found, "bounds of controls").worst == pytest.approx(0.1, abs=1e-12)
    assert pair.worst == pytest.approx(4 / 9 - 0.44, abs=1e-12) and pair.where.startswith("entry 1")
    assert {one.name for one in found.violated} == {
        "bounds of states",
        "bounds of controls",
        "pair",
    }


SPEED = math.sqrt(17)


SWITCH, LANDING = (2 * SPEED - 4) / 3, (4 * SPEED - 4) / 3


def lander(final_time=(0, 10)):
    ocp = OptimalControlProblem("moon lander")
    phase = ocp.phase(time=(0, final_time))
    h = phase.state("h", initial=10, final=0, lower=0)
    v = phase.state("v", initial=-2, final=0)
    u = phase.control("u", lower=0, upper=3)
    phase.dynamics({h: v, v: u - 1.5})
    ocp.minimise(phase.integral(u))
    return ocp


def landing(switch=SWITCH, knots=(0.0, SWITCH, LANDING), slope=1.5 / SPEED, **more):
    fall = {"h": lambda t: 10 - 2 * t - 0.75 * t**2, "v": lambda t: -2 - 1.5 * t}
    brake = {
        "h": lambda t: 0.75 * (LANDING - t) ** 2,
        "v": lambda t: -1.5 * (LANDING - t),
    }
    return phase_plan(
        knots,
        {"h": lambda t, m: fall["h"](t) if m < switch else brake["h"](t),
         "v": lambda t, m: fall["v"](t) if m < switch else brake["v"](t)},
        {"u": lambda t, m: 0 * t if m < switch else 3 + 0 * t},
        {"h": lambda t: slope + 0 * t, "v": lambda t: -1 - slope * (t - SWITCH)},
        **more,
    )  # fmt: skip


def test_the_lander_switches_once():
    found = lander().verify(ControlPlan((landing(),)), tolerance=1e-11)
    assert found.ok and found.objective == pytest.approx(2 * SPEED, rel=1e-14)
    (report,) = hamiltonian_spread(lander(), ControlPlan((landing(),)))
    assert report.autonomous and report.vanishing
    assert report.spread < 1e-13 and report.relative < 1e-13
    assert abs(report.end) < 1e-13 and abs(report.mean) < 1e-13
    # Other costates that satisfy their equation: H is still constant, but not 0 at a free end.
    (report,) = hamiltonian_spread(lander(), ControlPlan((landing(slope=0.4),)))
    assert report.spread < 1e-13 and report.end == pytest.approx(1.5 - 0.4 * SPEED)
    part = landing()
    rough = replace(part.costates, values=tuple(table**3 for table in part.costates.values))
    (report,) = hamiltonian_spread(lander(), ControlPlan((replace(part, costates=rough),)))
    assert report.spread > 0.1 and report.relative > 0.01


def test_integrates_a_switch_inside_an_interval_by_error_control():
    # The same control as a steep line that saturates: almost a jump, between knots.
    steep = 1e4
    limits = {"lower": np.zeros(1), "upper": np.full(1, 3.0)}
    knots = (0.0, 1.0, 2.0, LANDING)
    line = piecewise(knots, lambda t, _: [1.5 + steep * (t - SWITCH)], 2, 1, **limits)
    states = piecewise(
        knots,
        lambda t, _: [
            np.where(t < SWITCH, 10 - 2 * t - 0.75 * t**2, 0.75 * (LANDING - t) ** 2),
            np.where(t < SWITCH, -2 - 1.5 * t, -1.5 * (LANDING - t)),
        ],
        3,
        2,
    )
    plan = ControlPlan((PhasePlan("phase 1", states, line, ("h", "v"), ("u",)),))
    found = motion(lander(), plan)
    assert found.failure == ""
    # Symmetric about the switch, the ramp gives the same speed, and a height that is off by its
    # width squared.
    assert found.states[-1] == pytest.approx([0.0, 0.0], abs=1e-7)
    assert found.integrals == pytest.approx([2 * SPEED], rel=1e-10)
    verified = lander().verify(plan)
    assert verified.objective == pytest.approx(2 * SPEED, rel=1e-12)
    assert check(verified, "bounds of controls").worst == 0.0
    # The states cannot follow a kink inside an interval, which the check reveals.
    assert not check(verified, "motion").ok


def test_two_phases_with_a_link():
    ocp = OptimalControlProblem("moon lander in two phases")
    fall = ocp.phase("fall", time=(0, (0, 5)))
    brake = ocp.phase("brake", time=((0, 5), (0, 10)))
    fuel = []
    for phase, ends in ((fall, {"initial": (10, -2)}), (brake, {"final": (0, 0)})):
        fixed = [{side: value[k] for side, value in ends.items()} for k in range(2)]
        h, v = phase.state("h", **fixed[0]), phase.state("v", **fixed[1])
        u = phase.control("u", lower=0, upper=3)
        phase.dynamics({h: v, v: u - 1.5})
        fuel.append(phase.integral(u))
    ocp.link(fall, brake)
    ocp.minimise(fuel[0] + fuel[1])
    ocp.subject_to(fuel[1], upper=8.3, name="fuel", equation="9", unit="kg")
    first, last = (
        landing(knots=(0, SWITCH), name="fall"),
        landing(knots=(SWITCH, LANDING), name="brake"),
    )
    found = ocp.verify(ControlPlan((first, last)), tolerance=1e-11)
    assert found.ok and found.objective == pytest.approx(2 * SPEED, rel=1e-13)
    assert check(found, "fuel").equation == "9"
    assert check(found, "h goes on from fall to brake").worst < 1e-13
    # The end of the first phase is linked, so H may be nonzero there.
    fell, braked = hamiltonian_spread(ocp, ControlPlan((first, last)))
    assert (fell.phase, fell.vanishing) == ("fall", False)
    assert (braked.phase, braked.vanishing) == ("brake", True)
    # A gap in height and in time.
    late = phase_plan(
        (SWITCH + 0.1, LANDING + 0.1),
        {"h": lambda t: 0.75 * (LANDING + 0.1 - t) ** 2, "v": lambda t: -1.5 * (LANDING + 0.1 - t)},
        {"u": lambda t: 3 + 0 * t},
        name="brake",
    )
    late = ocp.verify(ControlPlan((first, late)))
    assert [one.name for one in late.violated] == ["time goes on from fall to brake"]
    assert late.violated[0].worst == pytest.approx(0.1)
    # The place of a violation names its phase.
    pushed = replace(last, controls=piecewise((SWITCH, LANDING), lambda t, _: [3.1 + 0 * t], 1, 1))
    wrong = ocp.verify(ControlPlan((first, pushed)))
    assert check(wrong, "bounds of controls").where.endswith("s of phase 'brake'")
    assert check(wrong, "motion").where.endswith("s of phase 'brake'")
    assert not check(wrong, "fuel").ok
    for wrong in ((last, first), (first,)):
        with pytest.raises(InvalidData, match=r"phases of the plan must be \['fall', 'brake'\]"):
            ocp.verify(ControlPlan(wrong))


def oscillator():
    ocp = OptimalControlProblem("oscillator")
    phase = ocp.phase(time=(0, 6))
    x, v = phase.state("x", initial=0), phase.state("v", initial=1)
    phase.dynamics({x: v, v: -x})
    phase.invariant("energy", x**2 + v**2, equation="4", unit="J")
    ocp.minimise(phase.final(x))
    return ocp


def test_a_motion_without_control_and_its_invariant():
    found = oscillator().verify(ControlPlan((swing(),)), tolerance=1e-10)
    assert found.ok and found.objective == pytest.approx(math.sin(6), abs=1e-11)
    energy = check(oscillator().verify(ControlPlan((swing(1e-4),))), "energy")
    assert energy.worst == pytest.approx((1 + 6e-4) ** 2 - 1, rel=1e-6)
    assert energy.where == "t = 6 s" and (energy.equation, energy.unit) == ("4", "J")
    # The plan's states conserve the energy, but they violate x' = v, so the motion does not.
    still = phase_plan((0, 6), {"x": lambda t: 0 * t, "v": lambda t: 1 + 0 * t})
    found = oscillator().verify(ControlPlan((still,)))
    assert not check(found, "motion").ok and check(found, "energy").ok


def line_plan(end=1.0, rate=(1.0, 0.5), **extra):
    part = phase_plan(
        (0, 0.4 * end, end), {"x": lambda t: rate[0] * t, "y": lambda t: rate[1] * t**2 / 2}
    )
    return ControlPlan((part,), {"rate": np.array(rate), **extra})


def test_quadrature_of_integrals_and_parameters():
    found = parametric().verify(line_plan(), tolerance=1e-11)
    assert found.ok and found.objective == pytest.approx(math.e - 1 + 1 + 1, rel=1e-14)
    # ∫ |t - 0.7| has a kink between knots: 0.49/2 + 0.09/2.
    wide = parametric().verify(line_plan(end=2.5))
    one = check(wide, "distance")
    assert one.worst == pytest.approx(0.49 / 2 + 1.8**2 / 2 - 1, rel=1e-12)
    assert (one.equation, one.unit) == ("5", "m s")
    one = check(parametric().verify(line_plan(rate=(1.0, -1.25))), "bounds of parameters")
    assert one.worst == pytest.approx(0.25) and one.where == "rate[1]"
    early, late = (check(parametric().verify(line_plan(end=t)), "times") for t in (0.4, 3.3))
    assert early.worst == pytest.approx(0.1) and late.worst == pytest.approx(0.3)
    assert early.where == "end" and early.unit == "s"


def test_rejects_plans_that_do_not_fit_the_problem():
    problem, plan = parametric(), line_plan()
    (part,) = plan.phases
    for parameters, words in (
        ({}, r"parameters of the plan must be \['rate'\], got \[\]"),
        ({"rate": [1.0]}, "must be 2 finite numbers"),
        ({"rate": [1.0, np.nan]}, r"parameters\['rate'\]\[1\] must be finite"),
        ({"rate": [1.0, 0.5], "more": [1.0]}, "parameters of the plan"),
    ):
        with pytest.raises(InvalidData, match=words) as caught:
            verify_control(problem.definition, ControlPlan((part,), parameters), 1e-6)
        assert caught.value.field.startswith("parameters")
    with pytest.raises(InvalidData, match="state_names of phase 'phase 1'"):
        problem.verify(replace(plan, phases=(replace(part, state_names=("y", "x")),)))
    with pytest.raises(InvalidData, match="control_names of phase 'phase 1'"):
        rest_problem().verify(ControlPlan((phase_plan((0, 1), REST, {"w": lambda t: t}),)))
    with pytest.raises(InvalidData, match="phases of the plan"):
        problem.verify(replace(plan, phases=(replace(part, name="climb"),)))
    with pytest.raises(InvalidData, match="must be a ControlPlan"):
        problem.verify(3)
    with pytest.raises(InvalidData, match="knots must increase"):
        phase_plan((1.0, 0.0), REST)
    with pytest.raises(InvalidData, match="finite"):
        phase_plan((0.0, 1.0), {"x": lambda t: t + np.inf})
