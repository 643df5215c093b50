"""Programs in standard form: their check, their bound, their JSON, and what other tools read."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.models import Block, MixedIntegerProgram, Model, ProgramBuilder
from crosstrack.models.programs.base import row_maxima
from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Request, Termination
from crosstrack.solvers.conformance import Case, Expectation, Run, all_cases, run_suite
from crosstrack.solvers.mip.highs import Highs

INF = math.inf
CASES = [
    case
    for case in all_cases().values()
    if isinstance(case.program, MixedIntegerProgram) and not case.arguments
]


def knapsack(**changes):
    data = {
        "cost": [-5.0, -4.0, -3.0], "matrix": [[2.0, 3.0, 1.0], [4.0, 1.0, 2.0]], "row_lower": [-INF, 1.0],
        "row_upper": [5.0, 11.0], "column_lower": [0.0, 0.0, -INF], "column_upper": [1.0, INF, 2.0],
        "integral": [True, False, True], "offset": 7.0,
    }  # fmt: skip
    return MixedIntegerProgram(**{**data, **changes})


def test_blocks_name_rows_in_the_papers_words():
    b = ProgramBuilder()
    x = b.columns(
        "arc used", 2, upper=1, template="arc {0}-{1}", index=[[0, 4], [4, 40]], equation="22"
    )
    b.rows(
        "horizontal error", 1, (0, x, [2.0, 3.0]), upper=4, equation="13", template="at point {0}",
        index=[40], unit="error",
    )  # fmt: skip
    program = b.build()
    assert program.row_name(0) == "eq. 13, horizontal error at point 40"
    assert program.column_name(1) == "eq. 22, arc used arc 4-40"
    found = program.verify(np.array([1.0, 1.0]))
    check = next(c for c in found.checks if c.name == "horizontal error")
    assert (check.equation, check.where, check.unit) == ("13", "point 40", "error")
    assert check.worst == pytest.approx(1.0)
    assert not found.ok
    assert program.without_rows(["horizontal error"]).verify(np.array([1.0, 1.0])).ok


@pytest.mark.parametrize("key", ["name", "size", "template", "index", "unit"])
def test_a_block_in_a_file_has_every_key(key):
    b = ProgramBuilder()
    b.columns("arc used", 2, upper=1)
    data = b.build().to_dict()
    del data["data"]["columns"][0][key]
    with pytest.raises(InvalidData, match=rf"columns\[0\]: key '{key}' is missing") as caught:
        MixedIntegerProgram.from_dict(data)
    assert caught.value.field == "columns"


def test_verify_measures_rows_bounds_and_wholeness():
    program = knapsack()
    assert program.verify(np.array([1.0, 0.0, 2.0])).objective == pytest.approx(-5 - 6 + 7)
    assert program.verify(np.array([1.0, 0.0, 2.0])).ok
    for point, name in (
        ([1.0, 5.0, 2.0], "row"),
        ([1.5, 0.0, 2.0], "column"),
        ([0.5, 0.0, 2.0], "integrality"),
        ([0.0, -1.0, 2.0], "column"),
    ):
        found = program.verify(np.array(point))
        assert name in [check.name for check in found.violated], point
    with pytest.raises(InvalidData, match="shape"):
        program.verify(np.zeros(2))
    with pytest.raises(InvalidData, match=r"point\[1\] must be finite"):
        program.verify(np.array([0.0, np.nan, 0.0]))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cost": [1.0, np.nan, 0.0]}, r"cost\[1\] must be finite"),
        ({"row_upper": [1.0]}, "entries"),
        ({"integral": [1, 0, 2]}, r"integral\[2\] must be true or false, got 2"),
        ({"matrix": [[1.0, 2.0]]}, "matrix has 2 entries where cost has 3"),
        ({"matrix": sp.csr_array(np.array([[1.0, np.inf, 0], [0, 0, 1]]))}, "finite"),
        ({"column_lower": [INF, 0.0, 0.0]}, r"column_lower\[0\] must be finite"),
        ({"rows": (Block("a", "", 0, 1),)}, "cover 1 of 2"),
        ({"rows": (Block("a", "", 0, 1), Block("a", "", 1, 1))}, "one name"),
    ],
)
def test_bad_programs_are_refused(changes, words):
    with pytest.raises(InvalidData, match=words):
        knapsack(**changes)


numbers = st.floats(-1e6, 1e6, allow_nan=False)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_json_is_exact(data):
    m, n = data.draw(st.integers(0, 4)), data.draw(st.integers(1, 4))
    row = st.lists(st.one_of(st.just(0.0), numbers), min_size=n, max_size=n)
    low = st.one_of(st.just(-INF), numbers)
    high = st.one_of(st.just(INF), numbers)
    program = MixedIntegerProgram(
        cost=data.draw(row),
        matrix=np.array(data.draw(st.lists(row, min_size=m, max_size=m))).reshape(m, n),
        row_lower=data.draw(st.lists(low, min_size=m, max_size=m)),
        row_upper=data.draw(st.lists(high, min_size=m, max_size=m)),
        column_lower=data.draw(st.lists(low, min_size=n, max_size=n)),
        column_upper=data.draw(st.lists(high, min_size=n, max_size=n)),
        integral=data.draw(st.lists(st.booleans(), min_size=n, max_size=n)),
        offset=data.draw(numbers),
        rows=(Block("r", "3", 0, m),) if m else (),
    )
    again = Model.from_json(program.to_json())
    assert again.digest == program.digest
    assert again.rows == () or again.rows[0].equation == "3"


@settings(max_examples=80, deadline=None)
@given(
    duals=st.lists(st.floats(-50, 50), min_size=2, max_size=2),
    point=st.tuples(st.integers(0, 1), st.floats(0, 20), st.integers(-20, 2)),
)
def test_no_multipliers_prove_more_than_a_point_has(duals, point):
    """Weak duality: for all multipliers, the bound is below every feasible point."""
    program = knapsack()
    x = np.array(point, float)
    if program.verify(x, tolerance=1e-12).ok:
        assert program.dual_bound(np.array(duals)) <= program.objective(x) + 1e-7


@pytest.mark.sample(2)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("how", ["mps", "lp"])
def test_other_tools_read_the_same_program(case, how, tmp_path):
    """HiGHS reads the text that we write, and ends as it does on the arrays."""
    import highspy

    program = case.program
    if not program.size:
        pytest.skip("a program without columns has no text in these formats")
    path = tmp_path / f"program.{how}"
    path.write_text(program.to_mps() if how == "mps" else program.to_lp())
    highs = highspy.Highs()
    highs.setOptionValue("output_flag", False)
    highs.setOptionValue("mip_rel_gap", 0.0)
    assert highs.readModel(str(path)) in (highspy.HighsStatus.kOk, highspy.HighsStatus.kWarning)
    assert highs.getLp().num_col_ == program.size
    highs.run()
    ours = ct.solve(program, Highs(), gap=0.0)
    status = highs.modelStatusToString(highs.getModelStatus())
    if ours.termination == "optimal":
        assert status == "Optimal"
        found = highs.getInfo().objective_function_value
        assert found == pytest.approx(ours.primal_bound, abs=1e-6)
    else:
        assert ours.termination in ("infeasible", "unbounded")
        assert status in (
            "Infeasible",
            "Unbounded",
            "Primal infeasible or unbounded",
            "Bound conflict",
        )


def test_a_linear_program_is_certified_by_its_multipliers():
    program = replace(knapsack(), integral=np.zeros(3, bool))
    answer = ct.solve(program, Highs())
    assert answer.termination == "optimal"
    assert answer.duals is not None
    assert answer.dual_bound == pytest.approx(program.dual_bound(answer.duals))
    assert answer.gap <= 1e-9


class Flawed(Backend):
    """Correct on most programs, wrong with an offset, and crashes on one column."""

    name = "flawed"
    accepts = MixedIntegerProgram
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.DUAL_BOUND})

    def run(self, problem, request):
        import os

        if problem.size == 1:
            os._exit(7)
        answer = Highs().run(problem, request)
        if problem.offset and answer.primal_bound is not None:
            return Answer(Termination.OPTIMAL, point=answer.point, primal_bound=0.0, dual_bound=1e9)
        return answer


def test_the_suite_tests_an_external_backend():
    import sys

    import cloudpickle

    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    matrix = run_suite([Flawed()])
    wrong = {result.case: result.reason for result in matrix.failures}
    assert wrong
    assert any("exit code 7" in reason for reason in wrong.values()), wrong
    lied = [name for name in wrong if all_cases()[name].program.offset]
    assert lied, wrong
    passed = [r for r in matrix.results if r.status == "pass"]
    assert len(passed) > 20
    assert "flawed" in str(matrix)
    assert "FAIL" in str(matrix)


def test_an_expected_backend_must_not_be_skipped():
    with pytest.raises(BackendMissing, match="'gurobi' is expected"):
        run_suite([], expected=["gurobi"])


@pytest.mark.parametrize(
    ("seconds", "cpu", "late"), [(2.9, 2.9, False), (20, 1, False), (20, 9, True), (40, 0, True)]
)
def test_a_busy_machine_does_not_make_a_solver_late(seconds, cpu, late):
    program = replace(knapsack(), row_lower=[-INF, -INF])
    value = program.objective(np.zeros(3))
    answer = Answer(Termination.OPTIMAL, point=np.zeros(3), primal_bound=value, dual_bound=value)
    case = Case("limit", program, Expectation((Termination.OPTIMAL,)))
    request = Request(time_limit=0.2)
    reason = case.judge(Run(answer, request, frozenset({Feature.DUAL_BOUND}), (), seconds, cpu))
    assert reason is None if not late else reason.startswith("took")


def test_the_largest_magnitude_of_each_row():
    matrix = sp.csr_array(
        np.array([[0, 0, 0], [1, -7, 2], [0, 0, 0], [-0.5, 0, 0.25], [0, 0, 0.0]])
    )
    assert row_maxima(matrix).tolist() == [0, 7, 0, 0.5, 0]
    assert row_maxima(sp.csr_array((2, 3))).tolist() == [0, 0]
    assert row_maxima(sp.csr_array((0, 3))).size == 0


class Claiming(Backend):
    """Return the first unit vector as optimal, with the objective at 0 as the bound."""

    name = "claiming"
    accepts = MixedIntegerProgram
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.DUAL_BOUND})

    def run(self, problem, request):
        point = np.eye(problem.size)[0]
        value = problem.objective(point)
        return Answer(
            Termination.OPTIMAL, point=point, primal_bound=value, dual_bound=problem.offset
        )


@pytest.mark.parametrize("unit", [1e-11, 1.0, 1e9])
def test_a_gap_is_not_excused_by_a_small_unit_of_the_objective(unit):
    """Differences below 1e-9 were rounding in any unit."""
    program = knapsack(cost=[unit, 0.0, 0.0], offset=0.0)
    answer = ct.solve(program, Claiming())
    assert answer.termination == "feasible" and "leaves a gap" in answer.message
    assert program.verify(answer.plan).scale == min(unit, 1.0)
    free = replace(program, cost=[0.0, 0.0, 0.0])
    assert ct.solve(free, Claiming()).termination == "optimal"
