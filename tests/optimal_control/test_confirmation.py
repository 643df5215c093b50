"""Confirmation of an optimum by a second scheme with the same objective."""

import pytest
from checked import check, phase_plan
from control_declared import rest_to_rest, two_phases

import crosstrack as ct
from crosstrack.models import ControlPlan, OptimalControlProblem
from crosstrack.models.optimal_control.transcription import base
from crosstrack.solvers.run import starts


def path_tracking_robot():
    """Return the two-phase path tracking robot of the PSOPT manual: convex, with an unpenalised control."""
    ocp = OptimalControlProblem("two-phase path tracking robot")
    phases, error = [], 0
    for name, times, ends, reference in (
        ("along", (0, 1), {"initial": [0, 0, 0.5, 0]}, lambda t: (t / 2, 0, 0.5, 0)),
        ("across", (1, 2), {"final": [0.5, 0.5, 0, 0.5]}, lambda t: (0.5, (t - 1) / 2, 0, 0.5)),
    ):
        phase = ocp.phase(name, time=times)
        x = phase.state("x", 4, **ends)
        u = phase.control("u", 2, lower=-10, upper=10)
        phase.dynamics({x: [x[2], x[3], u[0], u[1]]})
        wanted = reference(phase.time)
        terms = (w * (x[k] - wanted[k]) ** 2 for k, w in enumerate((100, 100, 500, 500)))
        error = error + phase.integral(sum(terms))
        phases.append(phase)
    ocp.link(*phases)
    ocp.minimise(error)
    return ocp


# 1.04168615 on a uniform mesh of 400 intervals, by either scheme; another package has 1.041686.
@pytest.mark.parametrize(
    ("scheme", "other"),
    [("radau", "gauss"), pytest.param("gauss", "radau", marks=pytest.mark.slow)],
)
def test_finds_the_optimum_that_calm_controls_would_hide(scheme, other):
    found = ct.solve(path_tracking_robot(), formulation=scheme, time_limit=120)
    assert found.termination == "locally_optimal" and found.verified, found.message
    assert found.primal_bound == pytest.approx(1.041686, abs=1e-6)
    assert found.statistics["confirmed_by"] == other
    assert found.statistics["confirmed_objective"] == pytest.approx(found.primal_bound, rel=1e-5)


@pytest.mark.parametrize(
    "scheme",
    [
        "gauss",
        "trapezoid",
        "paper",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("radau", "hermite-simpson")),
    ],
)
def test_every_scheme_is_confirmed_by_another(scheme):
    found = ct.solve(rest_to_rest().ocp, formulation=scheme, tolerance=1e-4)
    assert found.termination == "locally_optimal", found.message
    assert found.statistics["confirmed_by"] not in (scheme, "none")


def test_reports_feasible_if_the_other_scheme_has_another_optimum(monkeypatch):
    monkeypatch.setattr(base, "AGREED", -1.0)
    options = {"intervals": 2, "degree": 4, "rounds": 4}
    found = ct.solve(two_phases()[0], formulation="gauss", formulation_options=options)
    assert found.termination == "feasible" and found.verified
    assert "radau ends at the objective" in found.message
    assert found.statistics["confirmed_by"] == "none"
    assert any("radau ends at" in row["then"] for row in found.history)


def test_skips_the_confirmation_without_refinement():
    found = ct.solve(rest_to_rest().ocp, formulation_options={"refine": False})
    assert "confirmed_by" not in found.statistics


def test_names_a_skipped_confirmation(monkeypatch):
    monkeypatch.setattr(starts, "ROOM", 1e9)
    found = ct.solve(ct.load("optimal-control/brachistochrone"), time_limit=60)
    assert found.statistics["second look"] == "skipped"
    assert "other starts were skipped" in found.message


@pytest.mark.parametrize(("shift", "accepted"), [(1e-3, False), (1e-9, True)])
def test_accepts_a_fixed_time_up_to_rounding_for_any_horizon(shift, accepted):
    ocp = OptimalControlProblem("long")
    phase = ocp.phase(time=(0, 1e4))
    x, u = phase.state("x", initial=0), phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.final(x) ** 2)
    plan = ControlPlan((phase_plan([shift, 1e4], {"x": lambda t: 0 * t}, {"u": lambda t: 0 * t}),))
    assert check(ocp.verify(plan), "times").ok is accepted
