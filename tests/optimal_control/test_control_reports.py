"""Refinement: reports of meshes, the history, and the returned plan."""

import re

import numpy as np
import pytest
from transcribed import catalogue, layers

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import checks, model as problems
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_gains
from crosstrack.models.optimal_control.sampling import Course
from crosstrack.models.optimal_control.transcription.mesh import Mesh
from crosstrack.models.optimal_control.transcription.report import FINER, examine
from crosstrack.models.optimal_control.transcription.schemes import integration


def bang_singular(position=0.0, speed=1.0):
    """Return the double integrator that is damped by |u| <= 1: a bang, then a singular arc."""
    ocp = OptimalControlProblem("bang-singular")
    phase = ocp.phase(time=(0, 5))
    x, v = phase.state("x", initial=position), phase.state("v", initial=speed)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral((x**2 + v**2) / 2))
    return ocp.build()


def highest(places, values):
    """Return the largest value, including the vertices of parabolas through local maxima."""
    result = values.max()
    for k in range(1, len(values) - 1):
        if values[k] >= max(values[k - 1], values[k + 1]):
            a, b, c = np.polyfit(places[k - 1 : k + 2] - places[k], values[k - 1 : k + 2], 2)
            result = max(result, c - b**2 / (4 * a)) if a < 0 else result
    return result


@pytest.mark.parametrize("formulation", ["gauss", "radau"])
def test_a_report_equals_the_reports_of_single_intervals(formulation):
    model = catalogue("goddard")
    mesh = Mesh([0, 0.2, 0.3, 0.45, 0.8, 1], [4, 6, 4, 9, 6])
    options = {"mesh": mesh, "refine": False}
    program = model.formulation_type(formulation).of(model, options)
    # Random states that violate the dynamics and the bounds.
    shaken = 1 + 0.1 * np.random.default_rng(1).standard_normal(program.layout.size)
    part = program.decode(program.program.guess * shaken).phases[0]
    phase = model.definition.phases[0]
    found, course = examine(phase, part, np.zeros(0)), Course(phase, part, np.zeros(0))
    size = course.sizes.states
    low, high = phase.bounds("states")
    for k, count in enumerate(mesh.degrees):
        tau, onto = integration(max(part.states.nodes[k].size, int(count)) + FINER)
        rates = course.values(course.at(np.full(tau.size, k), tau))["rate"]
        half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
        off = part.states.on(k, [-1]) + half * onto @ rates - part.states.on(k, [*tau, 1])
        assert found.errors[k] == pytest.approx((np.abs(off) / size).max(), rel=1e-9)
        places = -np.cos(np.linspace(0, np.pi, 3 * part.states.nodes[k].size + 8))
        states = part.states.on(k, places)
        beyond = [
            highest(places, column)
            for excess in (
                (low - states) / np.maximum(size, np.abs(low)),
                (states - high) / np.maximum(size, np.abs(high)),
            )
            for column in excess.T
            if np.isfinite(column).all()
        ]
        assert found.violations[k] == pytest.approx(max(0.0, *beyond), rel=1e-9)
        assert -1 <= found.places[k] <= 1
    assert found.violations.max() > 1e-3 and found.errors.max() > 1e-3
    assert len(found.cuts) == len(found.windows) == found.worst.size == 5


def test_a_plan_is_verified_once(monkeypatch):
    seen, plain = [], checks.verify_control

    def counted(definition, plan, tolerance):
        seen.append((problems._fingerprint(plan), tolerance))
        return plain(definition, plan, tolerance)

    monkeypatch.setattr(problems, "verify_control", counted)
    model = catalogue("linear-regulator")
    found = ct.solve(model, isolate=False)
    assert found.termination == "locally_optimal" and len(seen) == len(set(seen)) > 0
    # The result is cached for equal arguments; another tolerance, bit or model is verified again.
    before = len(seen)
    assert model.verify(found.plan, tolerance=1e-6) is found.verification
    assert model.verify(model.plan_from_data(found.plan_data)) is found.verification
    assert len(seen) == before
    model.verify(found.plan, tolerance=1e-5)
    data = model.plan_to_data(found.plan)
    data["phases"][0]["states"]["values"][0][0][0] += 1e-3
    assert not model.verify(model.plan_from_data(data)).ok
    assert catalogue("linear-regulator").verify(found.plan).ok
    assert len(seen) == before + 3


def test_refines_further_if_the_hamiltonian_jumps():
    # A calm control over the switch verifies and converges, 8e-5 above the optimum.
    model = bang_singular()
    found = ct.solve(model, formulation="radau", isolate=False)
    assert found.termination == "locally_optimal"
    assert found.primal_bound == pytest.approx(0.3769919309, abs=1e-8)
    assert any("Hamiltonian" in row["then"] or "released" in row["then"] for row in found.history)
    assert sum(map(np.sum, hamiltonian_gains(model, found.plan))) < 3e-6
    # An easy problem needs no additional mesh.
    assert ct.solve(catalogue("linear-regulator")).statistics["meshes"] == 2


def test_keeps_a_noisy_singular_control_calm_instead_of_cutting():
    # With cuts at the largest noise, this took 2658 nodes and did not converge.
    options = {"rounds": 8}
    found = ct.solve(
        catalogue("aly-chan"), formulation="radau", tolerance=1e-8, formulation_options=options
    )
    assert found.termination == "locally_optimal" and found.statistics["nodes"] < 200
    assert found.primal_bound == pytest.approx(0.0, abs=1e-9)
    assert any("held calm" in row["then"] for row in found.history[1:])


def test_the_history_has_one_row_per_mesh():
    found = ct.solve(catalogue("bryson-denham"))
    assert len(found.history) == found.statistics["meshes"]
    assert [row["mesh"] for row in found.history] == [1, 2, 3, 4]
    last = found.history[-1]
    assert last["nodes"] == found.statistics["nodes"] and last["verified"] is True
    assert last["intervals"] == found.statistics["intervals"]
    assert last["objective"] == pytest.approx(found.primal_bound, abs=1e-9)
    assert last["change"] == pytest.approx(found.statistics["objective_change"], rel=0.01)
    assert last["then"] == "verified and settled" and last["error"] < 2e-7
    assert found.history[0]["change"] is None
    assert re.search(r"\d cut where a bound begins or ceases to bind", found.history[0]["then"])
    assert 0 < sum(row["seconds"] for row in found.history) < found.seconds["total"]
    again = ct.Solution.from_dict(found.to_dict())
    assert again.history == found.history
    older = {key: value for key, value in found.to_dict().items() if key != "history"}
    assert ct.Solution.from_dict(older).history == ()


def test_returns_the_best_plan_if_refinement_does_not_converge():
    model = bang_singular()
    found = ct.solve(model, tolerance=1e-5, formulation_options={"rounds": 5})
    assert found.termination == "feasible" and found.verification.ok
    assert (
        "did not settle: given up after 5 meshes; the plan is that of mesh 3 of 5" in found.message
    )
    assert found.history[2]["verified"] is True and found.history[4]["error"] > 2e-6


def test_names_the_remaining_error_and_the_tolerance_that_accepts_it():
    model = layers()
    options = {"rounds": 3, "intervals": 2, "degree": 4}
    found = ct.solve(model, formulation_options=options, tolerance=1e-6)
    assert found.termination == "rejected" and "the error left: motion" in found.message
    assert "given up after 3 meshes" in found.message
    needed = float(re.search(r"tolerance=(\S+) would accept", found.message)[1])
    plan = model.plan_from_data(found.rejected_plan)
    assert model.verify(plan, tolerance=1.1 * needed).ok
    assert not model.verify(plan, tolerance=0.8 * needed).ok
