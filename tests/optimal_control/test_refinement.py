"""Refinement of meshes, and options of formulations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from checked import phase_plan
from transcribed import LINEAR, catalogue, layers, regulator, solved

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models.optimal_control.plan import ControlPlan
from crosstrack.models.optimal_control.transcription import base, refinement
from crosstrack.models.optimal_control.transcription.mesh import Mesh, mesh_of
from crosstrack.models.optimal_control.transcription.refinement import History, Rules
from crosstrack.solvers.run.running import Run


@pytest.mark.parametrize(
    ("name", "formulation", "value"),
    [
        pytest.param("linear-regulator", "gauss", None, marks=pytest.mark.slow),  # smooth
        ("linear-regulator", "paper", None),
        ("double-integrator", "gauss", 2.0),  # bang-bang
        pytest.param("aly-chan", "gauss", 0.0, marks=pytest.mark.slow),  # a singular arc
        pytest.param("double-integrator", "radau", 2.0, marks=pytest.mark.slow),
        pytest.param("aly-chan", "radau", 0.0, marks=pytest.mark.slow),
        ("bryson-denham", "radau", 4.0),  # a wall
        pytest.param("catalyst-mixing", "gauss", -0.0480556858, marks=pytest.mark.slow),
        pytest.param("goddard", "gauss", -1.0128369, marks=pytest.mark.slow),
        pytest.param("goddard", "radau", -1.0128369, marks=pytest.mark.slow),
        pytest.param("hypersensitive", "gauss", 1.330806905, marks=pytest.mark.slow),
        pytest.param("hypersensitive", "radau", 1.330806905, marks=pytest.mark.slow),
        pytest.param("bryson-denham", "hermite-simpson", 4.0, marks=pytest.mark.slow),
    ],
)
def test_refinement_ends_with_a_verified_plan(name, formulation, value):
    model = catalogue(name)
    found = ct.solve(model, formulation=formulation, seed=0)
    assert found.termination == "locally_optimal" and found.verification.ok, str(found)
    if value is None:
        value = math.tanh(2 * math.sqrt(2)) / (math.sqrt(2) - math.tanh(2 * math.sqrt(2)))
    assert found.primal_bound == pytest.approx(value, abs=2e-6 if name != "goddard" else 1e-5)
    assert found.statistics["meshes"] >= 2
    assert model.verify(found.plan, tolerance=1e-6).ok
    # A larger tolerance needs fewer nodes.
    rough = ct.solve(model, formulation=formulation, tolerance=1e-3, seed=0)
    assert rough.termination == "locally_optimal"


def test_the_paper_refines_one_interval_in_degree():
    found = ct.solve(
        catalogue("linear-regulator"), formulation="paper", formulation_options={"degree": 3}
    )
    assert found.termination == "locally_optimal" and found.statistics["intervals"] == 1
    assert found.statistics["meshes"] > 2 and found.statistics["nodes"] > 6


@pytest.mark.parametrize(
    "options",
    [
        {"rounds": 1, "intervals": 1, "degree": 3},
        {"rounds": 2, "intervals": 1, "degree": 3},
        {"most_nodes": 12, "intervals": 2, "degree": 5},
        {"refine": False, "intervals": 2, "degree": 4},
        {"refine": False, "mesh": [0, 0.1, 1], "degree": 4},
    ],
)
def test_rejects_a_plan_that_the_mesh_cannot_resolve(options):
    model = layers()
    found = ct.solve(model, formulation_options=options, seed=0)
    assert found.termination == "rejected" and found.plan is None and found.primal_bound is None
    assert found.rejected_plan is not None and "violated: motion" in found.message
    assert not found.verification.ok
    worst = [check for check in found.verification.checks if not check.ok]
    assert any(check.name == "motion" and check.worst > 1e-3 for check in worst)
    again = model.verify(model.plan_from_data(found.rejected_plan))
    assert again.ok == found.verification.ok


def test_a_fixed_mesh_is_not_refined():
    ocp = regulator(*LINEAR)[0]
    found = ct.solve(
        ocp, formulation_options={"refine": False, "mesh": [0, 0.3, 1], "degree": 9}, seed=0
    )
    assert found.plan.phases[0].states.knots == pytest.approx([0, 0.6, 2])
    assert found.statistics["meshes"] == 1 and found.statistics["nodes"] == 18
    # Two phases, one mesh each.
    ocp = regulator(*LINEAR, cuts=(0.5,))[0]
    options = {"refine": False, "mesh": [[0, 1], [0, 0.25, 1]], "degree": 9}
    found = ct.solve(ocp, formulation_options=options, seed=0)
    assert [part.states.intervals for part in found.plan] == [1, 2]
    assert found.primal_bound == pytest.approx(solved(ocp, "gauss", degree=9)[0], rel=1e-8)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"intervals": 0}, ["'intervals'", "1 to 10000", "got 0"]),
        ({"intervals": 2.0}, ["'intervals'", "whole number", "2.0"]),
        ({"intervals": True}, ["'intervals'", "True"]),
        ({"degree": 0}, ["'degree'", "1 to 400", "got 0"]),
        ({"degree": "5"}, ["'degree'", "'5'"]),
        ({"rounds": 0}, ["'rounds'", "got 0"]),
        ({"most_nodes": -1}, ["'most_nodes'", "got -1"]),
        ({"refine": 1}, ["'refine'", "true or false", "1"]),
        ({"dependent": "x"}, ["'dependent'", "'drop'", "'x'"]),
        ({"mesh": [0, 0.5]}, ["increase from 0 to 1", "0.5"]),
        ({"mesh": [0, 0.7, 0.5, 1]}, ["increase from 0 to 1"]),
        ({"mesh": [0, float("nan"), 1]}, ["increase from 0 to 1", "nan"]),
        ({"mesh": [0, "a", 1]}, ["fractions from 0 to 1", "'a'"]),
        ({"mesh": []}, ["increase from 0 to 1"]),
        ({"mesh": 3}, ["fractions from 0 to 1", "3"]),
        ({"mesh": "even"}, ["fractions from 0 to 1", "'even'"]),
        ({"mesh": [[0, 1], [0, 1]]}, ["2 lists for 1 phases"]),
        ({"nodes": 3}, ["no option 'nodes'", "degree"]),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(UnsupportedOption) as caught:
        ct.solve(regulator(*LINEAR)[0], formulation_options=options)
    assert all(word in str(caught.value) for word in words), caught.value


def test_a_plan_that_does_not_verify_tightens_the_solver(monkeypatch):
    requested, next_meshes, attend = [], base.next_meshes, Run.attend

    def unverified(*arguments):
        finding = next_meshes(*arguments)
        is_first = arguments[6] is None  # no former mesh
        return replace(finding, verified=False, settled=False) if is_first else finding

    def recording(run, problem, request):
        requested.append(request.tolerance)
        return attend(run, problem, request)

    monkeypatch.setattr(base, "next_meshes", unverified)
    monkeypatch.setattr(Run, "attend", recording)
    found = ct.solve(ct.load("optimal-control/bryson-denham"), seed=0)
    assert found.termination == "locally_optimal"
    assert requested[1] == pytest.approx(0.1 * requested[0])


def test_a_plan_within_the_tolerance_is_verified_whatever_the_share_of_an_interval(monkeypatch):
    monkeypatch.setattr(refinement, "SHARE", 1e-6)
    found = ct.solve(ct.load("optimal-control/bryson-denham"), tolerance=1e-6, seed=0)
    assert found.termination == "locally_optimal", found.message
    last = found.history[-1]
    assert last["verified"] and 1e-12 < last["error"] <= 1e-6
    assert found.verification.ok


@pytest.mark.parametrize("is_verified", [True, False])
def test_a_verified_plan_is_settled_by_a_finer_mesh_with_the_same_objective(is_verified):
    model = ct.load("optimal-control/bryson-denham")
    solution = ct.solve(model, formulation="gauss", seed=0)
    meshes = tuple(map(mesh_of, solution.plan.phases))
    errors = tuple(np.zeros(mesh.intervals) for mesh in meshes)
    former = History(solution.plan, 4.0, meshes, errors, verified=is_verified)
    strains = [np.zeros(mesh.intervals) for mesh in meshes]
    finding = refinement.next_meshes(
        model, solution.plan, meshes, Rules(), 1e-6, (4.0, 1.0), former, strains,
        lambda plan, tolerance: False,
    )  # fmt: skip
    assert finding.verified is not True and finding.settled is is_verified
    assert (finding.words == "the plan of the mesh before verified and settled") is is_verified


@pytest.mark.parametrize(("former_error", "action"), [(1.0, "raised"), (5e-4, "cut about")])
def test_an_interval_is_cut_if_a_higher_degree_did_not_reduce_its_error(former_error, action):
    ocp = ct.models.OptimalControlProblem("end")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u")
    phase.dynamics({x: u})
    phase.path(x, upper=0.999, name="limit at the end, which is no node")
    ocp.minimise(phase.end)
    plan = ControlPlan((phase_plan([0, 1], {"x": lambda t: t}, {"u": lambda t: 1 + 0 * t}),))
    mesh = mesh_of(plan.phases[0])
    former = History(
        plan, 1.0, (Mesh(mesh.fractions, mesh.degrees - 1),), (np.array([former_error]),)
    )
    finding = refinement.next_meshes(
        ocp.build(), plan, (mesh,), Rules(), 1e-6, (1.0, 1.0), former, [np.zeros(1)],
        lambda plan, tolerance: False,
    )  # fmt: skip
    assert action in finding.words
