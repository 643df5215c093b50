"""Switches of a control that a mesh places wrongly, and starts with fixed times."""

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.hamiltonian import misplaced_switches
from crosstrack.models.optimal_control.transcription import refinement
from crosstrack.models.optimal_control.transcription.mesh import Mesh
from crosstrack.models.optimal_control.transcription.methods import Radau
from crosstrack.models.optimal_control.transcription.refinement import Rules, _cut_switches
from crosstrack.solvers.contract.enums import Limit
from crosstrack.solvers.run import rescue


def to_rest():
    ocp = OptimalControlProblem("double integrator")
    phase = ocp.phase(time=(0, (0.1, 10)))
    x, v = phase.state("x", initial=0, final=1), phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.end)
    return ocp.build()


def damped(longest):
    """Return the cushioned oscillation of mintoc.de: the fastest way to rest from (2, 5)."""
    ocp = OptimalControlProblem("cushioned oscillation")
    phase = ocp.phase(time=(0, (0.1, longest)))
    x, v = phase.state("x", initial=2, final=0), phase.state("v", initial=5, final=0)
    u = phase.control("u", lower=-5, upper=5)
    phase.dynamics({x: v, v: (u - 10 * x) / 5})
    ocp.minimise(phase.end)
    return ocp


def shortest_rest():
    """Return the least time: the control changes its sign every half period."""
    w, x0, v0, first = math.sqrt(2.0), 2.0, 5.0, -0.5

    def final(unknown):
        x, v, t, centre = x0, v0, 0.0, first
        start, end = unknown
        for at in (*(start + k * math.pi / w for k in range(4)), end):
            a, b, turn = x - centre, v / w, w * (at - t)
            x = centre + a * math.cos(turn) + b * math.sin(turn)
            v = w * (b * math.cos(turn) - a * math.sin(turn))
            t, centre = at, -centre
        return x, v

    return float(fsolve(final, (0.74, 8.99), xtol=1e-13)[1])


@pytest.mark.parametrize(("knot", "interval"), [(0.48, 1), (0.52, 0)])
def test_a_switch_beside_its_knot_is_found_from_costates(knot, interval):
    model = to_rest()
    options = {"mesh": [0, knot, 1], "degree": 4, "refine": False}
    answer = ct.solve(model, formulation="gauss", formulation_options=options, tolerance=0.1)
    ((place,),) = misplaced_switches(model, answer.plan)
    assert place[0] == interval
    # The switch of the optimum is in the middle; the cut is beyond it, as seen from the knot.
    low, high = ((0.0, knot), (knot, 1.0))[interval]
    cut = low + 0.5 * (place[1] + 1.0) * (high - low)
    assert (cut - 0.5) * (knot - 0.5) < 0
    assert 0.5 < place[2] / (answer.primal_bound - 2.0) < 2.0


def test_a_switch_at_its_knot_has_no_entry():
    model = to_rest()
    options = {"mesh": [0, 0.5, 1], "degree": 4, "refine": False}
    answer = ct.solve(model, formulation="gauss", formulation_options=options, tolerance=0.1)
    assert answer.primal_bound == pytest.approx(2.0, rel=1e-7)
    assert all(gain < 1e-7 for *_, gain in misplaced_switches(model, answer.plan)[0])


def test_a_value_that_a_path_constraint_forbids_has_no_entry():
    # w alone should be 1 until 0.7, but only one of both controls may be 1, and from 0.5 u gains more.
    ocp = OptimalControlProblem("either")
    phase = ocp.phase(time=(0, 1))
    x, u, w = phase.state("x", initial=0), *(phase.control(k, lower=0, upper=1) for k in "uw")
    phase.dynamics({x: u + w})
    phase.path(u + w, upper=1)
    ocp.minimise(phase.integral((phase.time - 0.7) * w - 0.2 * u))
    options = {"mesh": [0, 0.5, 1], "degree": 6, "refine": False}
    answer = ct.solve(ocp, formulation="gauss", formulation_options=options)
    assert answer.primal_bound == pytest.approx(-0.325, rel=1e-7)
    assert misplaced_switches(ocp.build(), answer.plan) == ([],)


def test_a_false_alarm_of_switches_is_followed_by_the_other_examination(monkeypatch):
    monkeypatch.setattr(refinement, "misplaced_switches", lambda *_: ([(0, 0.1, 1.0)],))

    def gains(model, plan):
        return [np.ones(plan.phases[0].states.intervals)]

    monkeypatch.setattr(refinement, "hamiltonian_gains", gains)
    monkeypatch.setattr(Mesh, "unchanged", lambda mesh, _: np.ones(mesh.intervals, bool))
    answer = ct.solve(ct.load("optimal-control/linear-regulator"), formulation="gauss")
    assert (answer.termination, answer.verified) == ("locally_optimal", True)
    *_, switches, hamiltonian, last = [row["then"] for row in answer.history]
    assert switches.startswith("verified and settled, but switches at other instants may gain 1")
    assert hamiltonian == (
        "the objective stays, but the Hamiltonian is not constant: halved where it changes"
    )
    assert last == "the objective stays"


def test_cuts_for_switches_keep_the_other_intervals():
    mesh = Mesh([0.0, 0.25, 1.0], [7, 8], [True, True])
    cut = _cut_switches(mesh, [(1, -0.5)], Rules())
    assert cut.fractions.tolist() == [0.0, 0.25, 0.4375, 1.0]
    assert cut.degrees.tolist() == [7, 5, 5]
    assert cut.calm.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("longest", "stage"), [(50, "from fixed times"), pytest.param(20, "", marks=pytest.mark.slow)]
)
def test_the_fastest_rest_of_an_oscillator_is_found_from_its_default_guess(longest, stage):
    # The search from the guess is infeasible, because it shortens the duration too far. A mesh with a switch
    # beside its knot had verified with an objective 8.6e-6 above the optimum.
    answer = ct.solve(damped(longest))
    assert answer.termination == "locally_optimal"
    assert answer.verified
    assert answer.primal_bound == pytest.approx(shortest_rest(), rel=1e-7)
    assert stage in answer.statistics["stages"]


def test_a_limit_that_ends_the_search_with_fixed_times_is_reported(monkeypatch):
    def stop(run, formulation, request, attend, left):
        request.control.stop(Limit.TIME)
        yield from ()

    monkeypatch.setattr(rescue, "_from_fixed_times", stop)
    answer = ct.solve(damped(50))
    assert (answer.termination, answer.limit) == ("locally_infeasible", "time")


def test_times_are_fixed_at_the_guess_only_if_one_is_free():
    formulation = Radau(damped(50).build())
    program, columns = formulation.with_fixed_times(), formulation.layout.phases[0].time_columns
    assert program.column_lower[columns].tolist() == program.column_upper[columns].tolist()
    assert program.column_upper[columns[1]] == pytest.approx(25.05)
    fixed = OptimalControlProblem("fixed")
    phase = fixed.phase(time=(0, 1))
    x = phase.state("x", initial=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    fixed.minimise(phase.final(x))
    assert Radau(fixed.build()).with_fixed_times() is None
