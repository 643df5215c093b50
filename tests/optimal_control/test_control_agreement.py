"""One motion by several transcriptions and backends, external plans, tables and pictures."""

from __future__ import annotations

import pytest
from control_motions import BELOW, BRYSON, COARSE, CURVE, ENERGY, FALL, push

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.models import ControlPlan
from crosstrack.solvers.contract.verdict import judge


@pytest.mark.parametrize(
    ("name", "value", "formulations"),
    [
        pytest.param(CURVE, FALL, ["gauss", "hermite-simpson"], marks=pytest.mark.slow),
        pytest.param(CURVE, FALL, ["radau"], marks=pytest.mark.slow),
        pytest.param(BRYSON, 4.0, ["gauss", "radau", "hermite-simpson"], marks=pytest.mark.slow),
        pytest.param(CURVE, FALL, ["paper", "trapezoid"], marks=pytest.mark.slow),
    ],
)
def test_transcriptions_agree(name, value, formulations):
    backends = [f"ipopt:{formulation}" for formulation in formulations]
    found = ct.compare(ct.load(name), backends, time_limit=60, workers=2)
    assert [s.formulation for s in found.solutions] == formulations
    for solution in found.solutions:
        assert solution.termination == "locally_optimal", solution.message
        assert solution.verification.ok
        assert solution.primal_bound == pytest.approx(value, rel=1e-6)
    (verdict,) = found.verdicts
    assert verdict.outcome == "INCONCLUSIVE"
    assert "no exact bound" in verdict.evidence
    assert not any("worse" in note for note in verdict.notes)
    # A dependence on the tolerance is reported with the name of the row.
    for note in verdict.notes:
        assert "within_tolerance only" in note and note.partition(":")[0] == "ipopt"


@pytest.mark.parametrize(
    ("names", "able"),
    [
        (("ipopt", "slsqp"), {"ipopt", "slsqp"}),
        pytest.param(
            ("uno", "sqpmethod", "blocksqp", "bonmin", "fatrop", "sleqp", "trust-constr"),
            {"trust-constr"},
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_backends_return_a_verified_motion_or_a_reason(names, able):
    """Check that all backends find the smallest effort from rest to rest, 12."""
    usable = [one.name for one in ct.backends() if one.name in names and one.state == "installed"]
    assert able <= set(usable)
    options = {"tolerance": 1e-5, "formulation_options": {"intervals": 2, "degree": 4}}
    model = ct.load(ENERGY)
    found = judge(
        ENERGY, [ct.solve(model, name, time_limit=30, **options) for name in usable], model
    )
    solved = []
    for solution in found.solutions:
        if solution.plan is None and solution.stored_plan is None:
            assert solution.message, solution.backend
            assert solution.primal_bound is None
        else:
            assert solution.verification.ok
            assert solution.primal_bound == pytest.approx(12.0, rel=1e-5), solution.backend
            solved.append(solution.backend)
    assert able <= set(solved)
    assert found.outcome == "INCONCLUSIVE"


@pytest.mark.parametrize("name", [ENERGY, BRYSON])
def test_sqp_solvers_find_the_smallest_effort(name):
    mesh = {"intervals": 2, "degree": 4, "refine": False}
    answer = ct.solve(
        ct.load(name), "sqpmethod", tolerance=0.99, formulation_options=mesh, time_limit=20
    )
    assert answer.termination == "locally_optimal", answer.message


def test_a_failing_backend_names_itself():
    answer = ct.solve(push(1.0), "slsqp", formulation_options={"intervals": 1, "degree": 4})
    assert answer.plan is None
    assert answer.termination in ("locally_infeasible", "failed", "no_solution")
    assert "violated most" in answer.message


@pytest.fixture(scope="module")
def fastest() -> ct.Solution[ControlPlan]:
    return ct.solve(ct.load(CURVE), seed=0)


@pytest.mark.parametrize(
    "formulation", ["radau", pytest.param("hermite-simpson", marks=pytest.mark.slow), "paper"]
)
def test_the_plan_of_one_transcription_starts_another(fastest, formulation):
    answer = ct.solve(ct.load(CURVE), formulation=formulation, warm_start=fastest.plan, seed=0)
    assert answer.termination == "locally_optimal", answer.message
    assert answer.formulation == formulation
    assert answer.primal_bound == pytest.approx(FALL, rel=1e-6)
    assert answer.options["warm_start"] is not None


def test_starts_from_a_plan_within_the_tolerance(disc, ways):
    answer = ct.solve(
        disc, formulation="radau", warm_start=ways, tolerance=1e-3, formulation_options=COARSE
    )
    assert answer.primal_bound == pytest.approx(BELOW, rel=2e-3)


def test_rejects_a_warm_start_of_another_problem(fastest):
    with pytest.raises(InvalidData, match=r"phase 'phase 1'|states|warm_start"):
        ct.solve(ct.load(ENERGY), warm_start=fastest.plan)


@pytest.mark.parametrize("formulation", ["gauss", "radau"])
def test_verify_checks_the_rows_of_a_formulation(fastest, formulation):
    model = ct.load(CURVE)
    found = ct.verify(model, fastest, tolerance=1e-4, formulation=formulation)
    assert found.ok, str(found)
    names = [check.name for check in found.checks]
    assert {"motion", "final values", "dynamics of x", "dynamics of v", "end time"} <= set(names)
    # The JSON data of the plan is accepted as well.
    assert ct.verify(model, fastest.plan.to_data()).objective == found.objective


def test_rows_of_a_formulation_reveal_a_changed_plan(fastest):
    data = fastest.plan.to_data()
    data["phases"][0]["controls"]["values"][2][1][0] += 0.1
    found = ct.verify(ct.load(CURVE), data, tolerance=1e-4, formulation="gauss")
    wrong = {check.name for check in found.checks if not check.ok}
    assert {"motion", "dynamics of v"} <= wrong


@pytest.mark.slow
def test_rows_of_the_slew_are_those_of_its_lowered_problem():
    model = ct.load("satellite-slew/paper")
    answer = ct.solve(model, tolerance=1e-3, formulation_options={"intervals": 6, "degree": 4})
    found = ct.verify(model, answer, tolerance=1e-3, formulation="gauss")
    assert found.ok, str(found)
    assert "dynamics of q" in " ".join(check.name for check in found.checks)


def test_unknown_formulations_are_named(fastest):
    with pytest.raises(UnknownName, match=r"nonsense.*gauss"):
        ct.verify(ct.load(CURVE), fastest, formulation="nonsense")


def test_a_table_has_the_unit_of_the_problem():
    found = ct.compare(push(10.0), ["ipopt"], formulation_options=COARSE)
    assert "property object" not in str(found)


def test_a_picture_uses_the_tolerance_of_the_solution(tmp_path):
    """Check that a plan valid at its own tolerance is not drawn as invalid."""
    model = ct.load(CURVE)
    coarse = {"intervals": 2, "degree": 3, "refine": False}
    loose = ct.solve(model, formulation="radau", tolerance=1e-1, formulation_options=coarse)
    assert not ct.verify(model, loose.plan, tolerance=1e-6).ok

    def title(**options):
        figure = ct.plot(model, options.pop("plan", loose), **options)
        return " ".join(
            text.get_text() for text in figure.findobj(match=lambda a: hasattr(a, "get_text"))
        )

    assert "NOT VALID" not in title()
    assert "NOT VALID" in title(tolerance=1e-6)
    assert "NOT VALID" in title(plan=loose.plan)
