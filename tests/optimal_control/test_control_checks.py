"""The check of a plan for an optimal control problem, on plans whose exact course is known."""

import itertools
import math
from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.checks import motion, verify_control
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_spread
from crosstrack.models.optimal_control.plan import Piecewise


def lobatto(count):
    """Nodes that hold both ends."""
    return -np.cos(np.linspace(0.0, np.pi, count)) if count > 1 else np.zeros(1)


def piecewise(knots, function, count, size, **limits):
    """Functions sampled interval by interval; `function` may depend on the interval's middle."""
    nodes, values = lobatto(count), []
    for low, high in itertools.pairwise(knots):
        t = low + 0.5 * (nodes + 1.0) * (high - low)
        table = np.empty((count, size))
        for k, row in enumerate(function(t, 0.5 * (low + high))):
            table[:, k] = row
        values.append(table)
    return Piecewise(np.asarray(knots, float), (nodes,) * len(values), tuple(values), **limits)


def phase_plan(knots, states, controls=(), costates=None, *, nodes=4, name="phase 1", **limits):
    """A phase by functions of time, ``{name: f(t)}``; f(t, middle) where it jumps at knots."""

    def sampled(parts, **cut):
        def course(t, middle):
            return [f(t, middle) if f.__code__.co_argcount == 2 else f(t) for f in parts]

        return piecewise(knots, course, nodes, len(parts), **cut)

    return PhasePlan(
        name,
        sampled(list(states.values())),
        sampled(list(dict(controls).values()), **limits),
        tuple(states),
        tuple(dict(controls)),
        None if costates is None else sampled(list(costates.values())),
    )


def check(found, name):
    (one,) = [c for c in found.checks if c.name == name]
    return one


# -- rest to rest with the least effort: x = 3t² - 2t³, u = 6 - 12t, J = ∫ u²/2 = 6 ---------------------

REST = {"x": lambda t: 3 * t**2 - 2 * t**3, "v": lambda t: 6 * t - 6 * t**2}
EFFORT = {"u": lambda t: 6 - 12 * t}
#: λx' = 0, λv' = -λx, u + λv = 0.
REST_COSTATES = {"x": lambda t: -12 + 0 * t, "v": lambda t: 12 * t - 6}


def rest_problem(upper=6.0, highest=None, end=(1, 1)):
    ocp = OptimalControlProblem("rest to rest")
    phase = ocp.phase(time=(0, tuple(end)), equation="2")
    x = phase.state("x", initial=0, final=1, unit="m", upper=highest)
    v = phase.state("v", initial=0, final=0, unit="m/s")
    u = phase.control("u", lower=-upper, upper=upper, unit="m/s²")
    phase.dynamics({x: v, v: u})
    phase.path(x + v, upper=2.1, name="both", equation="7", unit="m")
    ocp.minimise(phase.integral(u**2 / 2), unit="J")
    return ocp


def rest_plan(knots=(0.0, 0.3, 1.0), states=(), controls=(), **more):
    return ControlPlan((phase_plan(knots, REST | dict(states), EFFORT | dict(controls), **more),))


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
    # x = 4.5 t² (1 - t) reaches 2/3 at t = 2/3, where no node is; nodes see at most 0.61.
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


# -- the moon lander: free fall, then full thrust ------------------------------------------------------

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
    # Other costates that obey their equation: constant still, but not 0 at a free end.
    (report,) = hamiltonian_spread(lander(), ControlPlan((landing(slope=0.4),)))
    assert report.spread < 1e-13 and report.end == pytest.approx(1.5 - 0.4 * SPEED)
    part = landing()
    rough = replace(part.costates, values=tuple(table**3 for table in part.costates.values))
    (report,) = hamiltonian_spread(lander(), ControlPlan((replace(part, costates=rough),)))
    assert report.spread > 0.1 and report.relative > 0.01


def test_a_switch_inside_an_interval_is_left_to_error_control():
    # The same control as a steep line that saturates: almost the jump, at no knot.
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
    # The states cannot follow a kink inside an interval, and that is found.
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
    # The end of the first phase is no end of the problem: with the link H need not vanish there.
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
    # A place names its phase.
    pushed = replace(last, controls=piecewise((SWITCH, LANDING), lambda t, _: [3.1 + 0 * t], 1, 1))
    wrong = ocp.verify(ControlPlan((first, pushed)))
    assert check(wrong, "bounds of controls").where.endswith("s of phase 'brake'")
    assert check(wrong, "motion").where.endswith("s of phase 'brake'")
    assert not check(wrong, "fuel").ok
    for wrong in ((last, first), (first,)):
        with pytest.raises(InvalidData, match=r"phases of the plan must be \['fall', 'brake'\]"):
            ocp.verify(ControlPlan(wrong))


# -- an oscillator: an invariant, no control ----------------------------------------------------------


def oscillator():
    ocp = OptimalControlProblem("oscillator")
    phase = ocp.phase(time=(0, 6))
    x, v = phase.state("x", initial=0), phase.state("v", initial=1)
    phase.dynamics({x: v, v: -x})
    phase.invariant("energy", x**2 + v**2, equation="4", unit="J")
    ocp.minimise(phase.final(x))
    return ocp


def swing(drift=0.0):
    return phase_plan(
        np.linspace(0, 6, 13),
        {"x": lambda t: (1 + drift * t) * np.sin(t), "v": lambda t: (1 + drift * t) * np.cos(t)},
        nodes=10,
    )


def test_a_motion_without_control_and_its_invariant():
    found = oscillator().verify(ControlPlan((swing(),)), tolerance=1e-10)
    assert found.ok and found.objective == pytest.approx(math.sin(6), abs=1e-11)
    energy = check(oscillator().verify(ControlPlan((swing(1e-4),))), "energy")
    assert energy.worst == pytest.approx((1 + 6e-4) ** 2 - 1, rel=1e-6)
    assert energy.where == "t = 6 s" and (energy.equation, energy.unit) == ("4", "J")
    # The plan's states keep the energy, its motion does not: x' = v is not what they do.
    still = phase_plan((0, 6), {"x": lambda t: 0 * t, "v": lambda t: 1 + 0 * t})
    found = oscillator().verify(ControlPlan((still,)))
    assert not check(found, "motion").ok and check(found, "energy").ok


# -- integrals and parameters ------------------------------------------------------------------------


def parametric():
    ocp = OptimalControlProblem("parameters")
    rate = ocp.parameter("rate", 2, lower=[0, -1], upper=[2, 1])
    phase = ocp.phase(time=(0, (0.5, 3)))
    x, y = phase.state("x", initial=0), phase.state("y", initial=0)
    phase.dynamics({x: rate[0], y: rate[1] * phase.time})
    root = phase.integral(casadi.fabs(phase.time - 0.7))
    ocp.subject_to(root, upper=1.0, name="distance", equation="5", unit="m s")
    ocp.minimise(phase.integral(casadi.exp(phase.time)) + phase.end + rate[0])
    return ocp


def line_plan(end=1.0, rate=(1.0, 0.5), **extra):
    part = phase_plan(
        (0, 0.4 * end, end), {"x": lambda t: rate[0] * t, "y": lambda t: rate[1] * t**2 / 2}
    )
    return ControlPlan((part,), {"rate": np.array(rate), **extra})


def test_integrals_by_quadrature_and_parameters():
    found = parametric().verify(line_plan(), tolerance=1e-11)
    assert found.ok and found.objective == pytest.approx(math.e - 1 + 1 + 1, rel=1e-14)
    # ∫ |t - 0.7| has a kink that no knot meets: 0.49/2 + 0.09/2.
    wide = parametric().verify(line_plan(end=2.5))
    one = check(wide, "distance")
    assert one.worst == pytest.approx(0.49 / 2 + 1.8**2 / 2 - 1, rel=1e-12)
    assert (one.equation, one.unit) == ("5", "m s")
    one = check(parametric().verify(line_plan(rate=(1.0, -1.25))), "bounds of parameters")
    assert one.worst == pytest.approx(0.25) and one.where == "rate[1]"
    early, late = (check(parametric().verify(line_plan(end=t)), "times") for t in (0.4, 3.3))
    assert early.worst == pytest.approx(0.1) and late.worst == pytest.approx(0.3)
    assert early.where == "end" and early.unit == "s"


def test_what_does_not_fit_is_refused():
    problem, plan = parametric(), line_plan()
    (part,) = plan.phases
    for parameters, words in (
        ({}, r"parameters of the plan must be \['rate'\], got \[\]"),
        ({"rate": [1.0]}, "must be 2 finite numbers"),
        ({"rate": [1.0, np.nan]}, "must be 2 finite numbers"),
        ({"rate": [1.0, 0.5], "more": [1.0]}, "parameters of the plan"),
    ):
        with pytest.raises(InvalidData, match=words) as caught:
            verify_control(problem.definition, ControlPlan((part,), parameters), 1e-6)
        assert caught.value.field == "parameters"
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


# -- motions that are hard to integrate ---------------------------------------------------------------


def unstable(rate=50.0):
    ocp = OptimalControlProblem("unstable")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=1), phase.control("u")
    phase.dynamics({x: rate * x + u})
    ocp.minimise(phase.integral(u**2))
    return ocp


@pytest.mark.parametrize(("intervals", "nodes", "windows"), [(10, 12, 10), (40, 8, 8), (1, 40, 15)])
def test_an_unstable_motion_is_integrated_in_windows(intervals, nodes, windows):
    def plan(shift=0.0):
        course = {"x": lambda t: np.exp(-t) + shift * t}
        control = {"u": lambda t: -51 * np.exp(-t)}
        return ControlPlan(
            (phase_plan(np.linspace(0, 1, intervals + 1), course, control, nodes=nodes),)
        )

    found = motion(unstable(), plan())
    assert found.windows == windows
    assert found.growth == pytest.approx(math.exp(50), rel=1e-2)
    verified = unstable().verify(plan(), tolerance=1e-9)
    assert verified.ok and check(verified, "motion").where.endswith(f"in {windows} windows")
    # Nobody integrates this from end to end, so no objective can be held against the plan's.
    assert not [one for one in verified.checks if one.name == "objective"]
    assert verified.objective == pytest.approx(51**2 * (1 - math.exp(-2)) / 2, rel=1e-12)
    # What is wrong is found all the same, in every window.
    assert not check(unstable().verify(plan(1e-4)), "motion").ok


@pytest.mark.parametrize("rate", [60.0, 1e3, 1e6])
def test_a_stiff_motion_is_integrated(rate):
    ocp = OptimalControlProblem("stiff")
    phase = ocp.phase(time=(0, 4))
    x, u = phase.state("x", initial=1), phase.control("u")
    phase.dynamics({x: rate * (u - x) - casadi.sin(phase.time)})
    ocp.minimise(phase.integral(u**2))
    knots = (0, 1, 2, 3, 4)
    part = phase_plan(knots, {"x": lambda t: np.cos(t)}, {"u": lambda t: np.cos(t)}, nodes=14)
    found = ocp.verify(ControlPlan((part,)), tolerance=1e-8)
    assert found.ok and motion(ocp, ControlPlan((part,))).windows == 1
    off = piecewise(knots, lambda t, _: [np.cos(t) + 1e-3], 14, 1)
    one = check(ocp.verify(ControlPlan((replace(part, controls=off),))), "motion")
    assert one.worst == pytest.approx(1e-3, rel=0.1) and not one.ok


def test_a_motion_that_breaks_down_is_no_solution():
    ocp = OptimalControlProblem("escape")
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=1)
    phase.dynamics({x: x**2})
    ocp.minimise(phase.integral(x))
    plan = ControlPlan((phase_plan((0, 0.5, 1.5, 2), {"x": lambda t: 1 + 0 * t}),))
    found = motion(ocp, plan)
    assert "breaks down" in found.failure and np.isnan(found.integrals).all()
    one = check(ocp.verify(plan), "motion")
    assert one.worst == np.inf and "breaks down at t = " in one.where
    assert ocp.verify(plan).to_dict()["checks"][0]["worst"] is None
    # An integrand that is not finite leaves no objective.
    log = OptimalControlProblem("log")
    phase = log.phase(time=(0, 1))
    x = phase.state("x", initial=-1)
    phase.dynamics({x: 0})
    log.minimise(phase.integral(casadi.log(x)))
    found = log.verify(ControlPlan((phase_plan((0, 1), {"x": lambda t: -1 + 0 * t}),)))
    assert found.objective is None and not found.ok


# -- the Hamiltonian ----------------------------------------------------------------------------------


def test_the_hamiltonian_is_constant_on_an_exact_solution():
    (report,) = hamiltonian_spread(rest_problem(), rest_plan(costates=REST_COSTATES))
    assert report.autonomous and not report.vanishing  # the time is fixed
    assert report.mean == pytest.approx(-18.0, rel=1e-13) and report.end == pytest.approx(-18.0)
    assert report.spread < 1e-12
    off = REST_COSTATES | {"v": lambda t: 12.1 * t - 6}
    (report,) = hamiltonian_spread(rest_problem(), rest_plan(costates=off))
    assert report.spread > 0.1 and report.relative == pytest.approx(report.spread / 54, rel=0.1)
    assert hamiltonian_spread(rest_problem(), rest_plan()) == ()
    assert not hamiltonian_spread(
        parametric(), ControlPlan((replace(swing(), state_names=("x", "y"), costates=swing().states),),
                                  {"rate": [1.0, 1.0]})
    )[0].autonomous  # fmt: skip


def test_the_weight_of_an_integral_is_in_the_hamiltonian():
    # The square root of the same integral: costates are those of J over 2 √J.
    ocp = rest_problem(end=(0.5, 2))
    free = OptimalControlProblem("root")
    phase = free.phase(time=(0, (0.5, 2)))
    x, v, u = phase.state("x"), phase.state("v"), phase.control("u")
    phase.dynamics({x: v, v: u})
    free.minimise(casadi.sqrt(phase.integral(u**2 / 2)) + phase.end)
    scaled = {
        "x": lambda t: REST_COSTATES["x"](t) / math.sqrt(24),
        "v": lambda t: REST_COSTATES["v"](t) / math.sqrt(24),
    }
    (report,) = hamiltonian_spread(free, rest_plan(costates=scaled))
    assert report.mean == pytest.approx(-18 / math.sqrt(24), rel=1e-12) and report.spread < 1e-12
    assert not report.vanishing  # the objective speaks of the end time itself
    assert hamiltonian_spread(ocp, rest_plan(costates=REST_COSTATES))[0].vanishing


# -- any polynomial course of a chain of integrators --------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(-2, 2), min_size=2, max_size=6),
    st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5),
    st.integers(1, 3),
    st.integers(1, 4),
)
def test_any_polynomial_course_of_integrators_verifies(coefficients, lengths, order, splits):
    ocp = OptimalControlProblem("chain")
    phase = ocp.phase(time=(0, float(sum(lengths))))
    states = [phase.state(f"x{k}") for k in range(order)]
    u = phase.control("u")
    phase.dynamics(dict(zip(states, [*states[1:], u], strict=True)))
    ocp.minimise(phase.integral(u**2))
    course = np.polynomial.Polynomial(coefficients)

    def plan(knots):
        parts = [course.deriv(k) if k else course for k in range(order + 1)]
        x = piecewise(knots, lambda t, _: [one(t) for one in parts[:-1]], 7, order)
        u = piecewise(knots, lambda t, _: [parts[-1](t)], 7, 1)
        names = tuple(f"x{k}" for k in range(order))
        return ControlPlan((PhasePlan("phase 1", x, u, names, ("u",)),))

    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    knots[-1] = sum(lengths)
    finer = np.interp(
        np.linspace(0, len(lengths), splits * len(lengths) + 1), np.arange(knots.size), knots
    )
    coarse, fine = ocp.verify(plan(knots), tolerance=1e-9), ocp.verify(plan(finer), tolerance=1e-9)
    assert coarse.ok and fine.ok
    squared = (course.deriv(order) ** 2).integ()
    exact = squared(knots[-1]) - squared(0.0)
    for found in (coarse, fine):
        assert found.objective == pytest.approx(exact, rel=1e-10, abs=1e-10)
