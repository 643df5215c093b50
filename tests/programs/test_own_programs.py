"""The verbs around a user's own program: reports, backends, printed results, campaigns, conflicts."""

import functools
import io
import json
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from commands import run
from scipy.optimize import linprog

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.programs import highs_files
from crosstrack.models.programs import (
    Block,
    ConeBlock,
    ConeKind,
    ConicProgram,
    MixedIntegerProgram,
    QuadraticProgram,
)
from crosstrack.solvers.bench import Campaign
from crosstrack.solvers.contract.enums import Termination
from crosstrack.solvers.contract.selection import fitting
from crosstrack.solvers.contract.solution import Solution
from crosstrack.solvers.contract.stopping import Seconds, Target
from crosstrack.solvers.contract.verdict import Outcome, judge
from crosstrack.solvers.mip.scip import Scip
from crosstrack.solvers.run import conflicts

INF = np.inf

WORKSHOP = """NAME workshop
OBJSENSE
    MAX
ROWS
 N profit
 L wood
 {sense} labour
COLUMNS
    table profit 7.0 wood 3.0
    table labour 2.0
    chair profit 5.0 wood 1.0
    chair labour 4.0
RHS
    RHS wood 30.0 labour {labour}
BOUNDS
 UP BND table 9.0
 UP BND chair 9.0
ENDATA
"""


read_apart = functools.cache(highs_files.read_apart)


@pytest.fixture(autouse=True)
def cached_reading(monkeypatch):
    """Read each content once: the process that reads a file takes most of the time of these tests."""

    def read_once(reader, path, raw, suffix):
        arrays, texts = read_apart(reader, "workshop.mps", raw, suffix)
        return dict(arrays), dict(texts)

    monkeypatch.setattr(highs_files, "read_apart", read_once)


@pytest.fixture
def workshop(tmp_path):
    (tmp_path / "workshop.mps").write_text(WORKSHOP.format(sense="L", labour=40.0))
    return tmp_path / "workshop.mps"


@pytest.fixture
def matrices(tmp_path):
    """A quadratic program in OSQP's convention: minimise the squares under x0 + x1 >= 2, x0 >= 1.5."""
    data = {
        "P": sp.csc_matrix(2 * np.eye(2)), "q": np.zeros(2), "A": sp.csc_matrix([[1.0, 1], [1, 0]]),
        "l": [2.0, 1.5], "u": [1e30, 3.0],
    }  # fmt: skip
    scipy.io.savemat(tmp_path / "squares.mat", data)
    return tmp_path / "squares.mat"


def program(matrix, lower, upper, integral=(), low=0.0, high=1.0, cost=1.0, **others):
    matrix = sp.csr_array(np.atleast_2d(np.array(matrix, float)))
    size = matrix.shape[1]
    whole = np.zeros(size, bool)
    whole[list(integral)] = True
    return MixedIntegerProgram(
        np.full(size, cost), matrix, lower, upper,
        np.broadcast_to(low, size), np.broadcast_to(high, size), whole, **others,
    )  # fmt: skip


def test_description_counts_the_kinds_of_rows_and_columns():
    model = program(
        [
            [1, 1, 1, 0, 0, 0],  # set partitioning
            [1, 0, 1, 0, 0, 0],  # set packing
            [0, 1, 1, 0, 0, 0],  # set covering
            [1, 1, 1, 0, 0, 0],  # cardinality, and parallel to the first row
            [3, 5, 0, 0, 0, 0],  # knapsack
            [-6, -10, 0, 0, 0, 0],  # parallel to the knapsack, free
            [0, 0, 0, 1, -1, 0],  # flow balance
            [0, 0, 0, -1, 1, 0],  # flow balance, and parallel
            [0, 0, 0, 1e7, 0, 0],  # singleton, range
            [0, 0, 0, 0, 0, 0],
        ],
        [1, -INF, 1, -INF, -INF, -INF, 0, 0, -2, 0],
        [1, 1, INF, 2, 7, INF, 0, 0, 5, 1],
        integral=(0, 1, 2),
        low=[0, 0, 0, 0, -INF, 4],
        high=[1, 1, 1, 9, INF, 4],
        name="kinds",
    )
    report = model.describe()
    facts = report.properties
    assert facts["rows"] == {"equality": 3, "inequality": 4, "range": 2, "free": 1}
    assert facts["columns"] == {"continuous": 3, "binary": 3, "other integer": 0}
    assert facts["structure"] == {
        "fixed columns": 1, "free columns": 1, "empty rows": 1, "singleton rows": 1,
        "set partitioning rows": 1, "set packing rows": 1, "set covering rows": 1,
        "cardinality rows": 1, "knapsack rows": 1, "network rows": 2, "parallel rows": 3,
        "columns without rows": 1,
    }  # fmt: skip
    assert facts["ranges"]["matrix"] == [1, 1e7]
    assert facts["ranges"]["right sides"] == [1, 7] and facts["ranges"]["column bounds"] == [1, 9]
    assert facts["nonzeros"] == 19 and facts["density"] == pytest.approx(19 / 60)
    assert len(report.warnings) == 1 and "1e7" in report.warnings[0]
    text = str(report)
    assert "set packing rows" in text and "scale rows or columns" in text
    assert "<table>" in report._repr_html_()
    assert json.loads(json.dumps(report.to_dict()))["instance"] == "kinds"
    assert repr(model).count("\n") == 0 and len(repr(model)) < 120


def test_descriptions_of_quadratic_conic_and_nonlinear_programs():
    square = {"matrix": sp.csr_array((0, 2)), "row_lower": [], "row_upper": []}
    bounds = {"column_lower": [-INF] * 2, "column_upper": [INF] * 2}
    convex = QuadraticProgram(np.eye(2), np.ones(2), **square, **bounds)
    assert convex.describe().properties["convexity"] == "convex"
    saddle = replace(convex, hessian=[[1, 2], [2, 1]])
    assert "smallest eigenvalue is -1" in saddle.describe().properties["convexity"]
    cones = [
        ConeBlock("psd", "", 0, 6, kind=ConeKind.SEMIDEFINITE),
        ConeBlock("balls", "", 6, 4, kind=ConeKind.SECOND_ORDER, dimension=2),
    ]
    conic = ConicProgram(np.ones(2), sp.csr_array(np.ones((10, 2))), np.zeros(10), cones)
    facts = conic.describe().properties
    assert facts["structure"]["semidefinite cones of order 3"] == 1
    assert facts["structure"]["second-order cones of size 2"] == 2
    casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
    x = casadi.MX.sym("x", 3)
    made = ct.load({"x": x, "f": casadi.sumsqr(x), "g": x[0] * x[1], "lbg": 1.0, "ubg": INF})
    facts = made.describe().properties
    assert facts["nonzeros"] == 2 and facts["convexity"] == "nonlinear"
    with pytest.raises(ct.errors.UnsupportedFormulation, match="linear rows and cones"):
        ct.diagnose(made)


def test_backends_of_a_model_are_accepting_missing_or_refusing(monkeypatch):
    model = program([[1, 1]], [1], [INF], integral=(0,))
    states = {state.name: state for state in ct.backends(model)}
    installed = {name for name, state in states.items() if state.state == "installed"}
    assert installed == set(fitting(model))
    assert states["ipopt"].state == "refused" and "nonlinear-program" in states["ipopt"].cause
    assert "column 1 is continuous" in states["cp-sat"].cause
    monkeypatch.setattr(Scip, "missing", lambda self: ("pyscipopt",))
    assert {s.name: s for s in ct.backends(model)}["scip"].cause == "pip install 'crosstrack[scip]'"
    report = model.describe()
    assert report.extras == {"scip": ("scip",)} and "scip" not in report.accepting
    assert "pip install 'crosstrack[scip]' adds scip" in str(report)
    assert len(ct.backends()) > len(states)
    own = {state.name: state.state for state in ct.backends(ct.load("resource-routing/errand"))}
    assert own["highs"] == "installed" and own["ipopt"] == "refused"


def test_printed_numbers_of_a_maximisation_are_its_authors():
    model = program([[1, 1]], [-INF], [1.5], cost=-2.0, maximise=True, name="most")
    solution = ct.solve(model, "highs")
    assert (solution.primal_bound, solution.value) == (-3.0, 3.0)
    assert solution.bound == pytest.approx(3.0)
    assert "3.00000" in solution.summary() and "-3" not in solution.summary()
    assert "objective 3\n" in str(ct.verify(model, solution))
    agreed = judge("most", [solution], model)
    assert agreed.evidence.startswith("optimum 3:") and "-3" not in str(agreed)
    wrong = replace(solution, backend="scip", dual_bound=-2.0, plan=None, stored_plan=None)
    contradiction = judge("most", [solution, wrong], model)
    assert contradiction.outcome is Outcome.CONTRADICTION
    assert "no plan is above 2, but highs has a verified plan of 3" in contradiction.evidence
    spread = judge("most", [solution, solution], model).spreads[0]
    assert spread.objective == (3.0, 3.0, 3.0)


def test_values_are_printed_by_name_the_largest_twenty():
    labels = tuple(f"part{k}" for k in range(25))
    model = program(
        np.eye(25), np.arange(25.0), np.arange(25.0), high=99.0,
        columns=(Block("column", "", 0, 25, labels=labels),),
    )  # fmt: skip
    solution = ct.solve(model, "highs")
    text = solution.summary()
    assert "4 smaller nonzero values" in text and "part24" in text
    assert "part5" in text and "part4 " not in text
    assert [row["variable"] for row in model.details(solution.plan)] == list(labels[:0:-1])
    loaded = Solution.from_dict(solution.to_dict())
    assert loaded.plan is None and "part24" not in loaded.summary()


def test_every_command_takes_a_file_of_a_program(workshop, tmp_path):
    done = run("solve", workshop, "--in-process", "--json")
    data = json.loads(done.stdout)
    assert data["primal_bound"] == -86 and data["plan"] == [8, 6] and data["maximise"]
    plan = tmp_path / "plan.json"
    plan.write_text(done.stdout)
    text = run("solve", workshop, "--in-process", "--details").stdout
    assert "table" in text and "86.0000" in text and "-86" not in text
    assert text.count("variable") == 1
    text = run("compare", workshop, "--backend", "highs", "--backend", "scipy").stdout
    assert "optimum 86: plan by highs, scipy" in text
    run("compare", workshop, "--backend", "highs", "--backends", "scipy", code=2)
    assert "verified, objective 86" in run("check", workshop, plan).stdout
    run("export", workshop, plan, "--format", "sol", "--output", tmp_path / "plan.sol")
    assert (tmp_path / "plan.sol").read_text() == "# Objective value = 86.0\ntable 8.0\nchair 6.0\n"
    front = json.loads(run("front", workshop, "labour", "--limits", "20,30", "--json").stdout)
    assert [(p["second"], p["objective"]) for p in front["points"]] == [(30, -78), (20, -65.5)]
    assert "unknown second objective" in run("front", workshop, "steel", code=2).stderr
    text = run("backends", "--for", workshop).stdout
    assert "highs" in text and "refuse" in text and "accepts nonlinear-program" in text
    workshop.write_text(WORKSHOP.format(sense="G", labour=60.0))
    text = run("diagnose", workshop, "--in-process", code=3).stdout
    assert "row labour: 2 table + 4 chair >= 60" in text and "wood" not in text
    assert "bound table <= 9" in text and "bound chair <= 9" in text


def test_an_exact_check_reads_multipliers_from_standard_input(workshop, monkeypatch):
    answer = run("solve", workshop, "--backend", "highs", "--in-process", "--json").stdout
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(answer.encode())))
    assert "bound 86 (exact)" in run("check", workshop, "-", "--exact").stdout


def test_commands_take_matrices(matrices, tmp_path):
    done = run("solve", matrices, "--backend", "clarabel", "--in-process", "--json")
    data = json.loads(done.stdout)
    assert data["primal_bound"] == pytest.approx(2.5) and data["plan"] == pytest.approx([1.5, 0.5])
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps(data["plan"]))
    assert "verified" in run("check", matrices, plan).stdout
    run("export", matrices, plan, "--output", tmp_path / "plan.csv")
    lines = (tmp_path / "plan.csv").read_text().splitlines()
    assert lines[0] == "variable,value" and [line.split(",")[0] for line in lines[1:]] == [
        "x[0]", "x[1]",
    ]  # fmt: skip
    assert "a plan exists" in run("diagnose", matrices, "--in-process").stdout


def test_campaigns_mix_files_of_programs_with_the_catalogue(tmp_path):
    (tmp_path / "programs").mkdir()
    for name, sense, labour in (("first", "L", 40.0), ("second", "G", 60.0)):
        text = WORKSHOP.format(sense=sense, labour=labour)
        (tmp_path / "programs" / f"{name}.mps").write_text(text)
    file = tmp_path / "campaign.toml"
    file.write_text(
        'instances = ["programs/*.mps", "resource-routing/errand"]\nbackends = ["highs"]\n'
    )
    campaign = Campaign.read(file)
    names = [task.job.model.name for task in campaign.tasks]
    assert names == ["first", "second", "resource-routing/errand"]
    file.write_text('instances = ["programs/*.nl"]\n')
    with pytest.raises(ct.errors.InvalidData, match="matches nothing"):
        _ = Campaign.read(file).tasks
    file.write_text('instances = ["../programs/*.mps"]\n')
    with pytest.raises(ct.errors.InvalidData, match="below the campaign's folder"):
        _ = Campaign.read(file).tasks


def feasible(model, rows, lower, upper):
    """Return whether a point satisfies some rows and column bounds, computed without crosstrack."""
    low, high = np.full(model.size, -INF), np.full(model.size, INF)
    low[list(lower)], high[list(upper)] = (
        model.column_lower[list(lower)],
        model.column_upper[list(upper)],
    )
    part = model.matrix.toarray()[list(rows)]
    sides = [(part, model.row_upper[list(rows)]), (-part, -model.row_lower[list(rows)])]
    matrix = np.vstack([side[np.isfinite(bound)] for side, bound in sides])
    bounds = np.concatenate([bound[np.isfinite(bound)] for _, bound in sides])
    zero = np.zeros(model.size)
    found = linprog(zero, matrix, bounds, bounds=np.column_stack([low, high]))
    assert found.status in (0, 2)
    return found.status == 0


def parts_of(diagnosis, model):
    """Return the rows, lower bounds and upper bounds of a diagnosis."""
    data = [finding.data for finding in diagnosis.findings]
    rows = [model.row_labels.index(entry["row"]) for entry in data if "row" in entry]
    lower, upper = (
        [model.column_labels.index(e["column"]) for e in data if e.get("bound") == sign]
        for sign in (">=", "<=")
    )
    return rows, lower, upper


def test_conflicts_are_irreducible():
    rng = np.random.default_rng(3)
    checked = 0
    while checked < 4:
        matrix = rng.integers(-3, 4, (9, 4)) * (rng.random((9, 4)) < 0.6)
        lower = np.where(rng.random(9) < 0.6, rng.integers(-4, 9, 9), -INF)
        model = program(matrix, lower, np.maximum(lower, 1.0) + 1.0, high=2.0)
        everything = (range(9), range(4), range(4))
        if feasible(model, *everything):
            continue
        checked += 1
        diagnosis = ct.diagnose(model)
        found = parts_of(diagnosis, model)
        assert diagnosis.feasible is False and "removing any one of them" in diagnosis.summary
        assert not feasible(model, *found)
        for k, part in enumerate(found):
            for entry in part:
                fewer = [*found[:k], [one for one in part if one != entry], *found[k + 1 :]]
                assert feasible(model, *fewer), (entry, str(diagnosis))


def test_a_conflict_that_a_limit_ends_still_excludes_every_point(monkeypatch):
    matrix = np.vstack([np.eye(6), np.ones((1, 6))])
    model = program(matrix, [*[0.5] * 6, -INF], [*[1.0] * 6, 1.0])
    monkeypatch.setattr(conflicts, "MOST", 2)
    diagnosis = ct.diagnose(model)
    assert "the reduction was not completed" in diagnosis.summary
    assert not feasible(model, *parts_of(diagnosis, model))
    monkeypatch.undo()
    rows = parts_of(ct.diagnose(model), model)[0]
    assert len(rows) == 4 and rows[-1] == 6


def test_the_time_limit_holds_for_all_programs_of_a_reduction(monkeypatch):
    limits = []

    def solve(*arguments, **options):
        limits.append(options["limits"].time_limit)
        return ct.solve(*arguments, **options)

    monkeypatch.setattr("crosstrack.solvers.run.diagnosis.solve", solve)
    model = program([[1, 1], [1, 0], [0, 1]], [-INF, 0.5, 0.5], [0.5, 1, 1])
    ct.diagnose(model, time_limit=30.0)
    reduction = [limit for limit in limits if limit < 30.0]
    assert len(reduction) > 3 and sorted(reduction, reverse=True) == reduction
    limits.clear()
    ct.diagnose(model, time_limit=None)
    assert set(limits) == {None}


def test_a_reduction_is_incomplete_if_a_program_of_it_is_not_settled(monkeypatch):
    model = program([[1, 1], [1, 0], [0, 1]], [-INF, 0.5, 0.5], [0.5, 1, 1])
    assert "removing any one of them" in ct.diagnose(model).summary

    def solve(part, *arguments, **options):
        answer = ct.solve(part, *arguments, **options)
        fails = part.row_count < model.row_count and answer.plan is not None
        return replace(answer, termination=Termination.FAILED) if fails else answer

    monkeypatch.setattr("crosstrack.solvers.run.diagnosis.solve", solve)
    assert "the reduction was not completed" in ct.diagnose(model).summary


def test_conflicts_of_a_backend_without_continuous_columns():
    pytest.importorskip("ortools", reason="ortools is not installed")
    model = program([[1, 1, 0], [0, 1, 1]], [2, -INF], [INF, 0], integral=range(3), high=1.0)
    diagnosis = ct.diagnose(model, "cp-sat")
    assert diagnosis.feasible is False and "the reduction was not completed" in diagnosis.summary
    assert not feasible(model, *parts_of(diagnosis, model))


def test_conflicts_name_constraints_of_cvxpy_first():
    cp = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    x = cp.Variable(3, name="x")
    limits = [(cp.sum(x) <= 1).set_label("budget"), (x >= 1).set_label("least"), x <= 9]
    findings = ct.diagnose(cp.Problem(cp.Minimize(cp.norm(x)), limits)).findings
    assert [finding.text for finding in findings] == [
        "budget: x[0] + x[1] + x[2] <= 1",
        "least (3 of 3 rows)",
        *(f"row least[{k}]: -x[{k}] <= -1" for k in range(3)),
    ]
    ball = [(cp.norm(x) <= 1).set_label("ball"), (x[0] >= 2).set_label("far"), x[1] <= 9]
    diagnosis = ct.diagnose(cp.Problem(cp.Minimize(x[0]), ball))
    names = {finding.where for finding in diagnosis.findings}
    assert diagnosis.feasible is False and "far" in names and "ball" in names


def test_conflicts_state_that_integers_take_part():
    model = program([[2, 2], [1, 0]], [3, -INF], [3, 9], integral=(0, 1), low=-INF, high=INF)
    diagnosis = ct.diagnose(model)
    assert "no point with integer columns satisfies these rows" in diagnosis.summary
    assert [finding.data["row"] for finding in diagnosis.findings] == ["row[0]"]
    relaxed = replace(model, integral=[False, False])
    assert ct.diagnose(relaxed).feasible is True


def test_a_target_has_the_sense_of_the_author():
    draw = np.random.default_rng(1)
    weights = draw.integers(5, 100, (8, 120))
    hard = MixedIntegerProgram(
        cost=-(weights.mean(axis=0) + draw.integers(0, 15, 120)),
        matrix=sp.csr_array(weights.astype(float)),
        row_lower=np.full(8, -INF),
        row_upper=weights.sum(axis=1) / 3,
        column_lower=np.zeros(120),
        column_upper=np.ones(120),
        integral=np.ones(120, bool),
        maximise=True,
    )
    early = ct.solve(hard, "scip", time_limit=30, target=10)
    assert early.limit == "target" and early.value >= 10
    late = ct.solve(hard, "scip", time_limit=0.3, target=1e6)
    assert late.limit == "time" and late.value >= early.value
    late = ct.solve(hard, "scip", stop=Seconds(0.3) | (Target(1e6) & Seconds(0.1)))
    assert late.limit == "time"


def test_a_saved_solution_is_loaded_with_the_object_of_another_library(tmp_path):
    x = cp.Variable((2, 2), name="x")
    problem = cp.Problem(cp.Maximize(3 - cp.sum(x)), [x >= np.arange(4).reshape(2, 2)])
    path = ct.solve(problem).save(tmp_path / "answer.json")
    alone = Solution.load(path)
    assert alone.value == pytest.approx(-3) and alone.maximise
    with pytest.raises(InvalidData, match="loaded without its model"):
        _ = alone.values
    loaded = Solution.load(path, problem)
    assert loaded.values["x"] == pytest.approx(np.arange(4.0).reshape(2, 2))
    x.value = None
    loaded.assign()
    assert x.value == pytest.approx(np.arange(4.0).reshape(2, 2))


@pytest.mark.parametrize("backend", ["clarabel", "scs"])
def test_an_unbounded_objective_without_a_ray_has_no_bound(backend):
    x = cp.Variable(2)
    answer = ct.solve(cp.Problem(cp.Maximize(cp.log(x[0])), [x[1] >= 0]), backend)
    assert answer.termination == "feasible" and answer.bound is None and answer.proof == ""
