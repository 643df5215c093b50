"""The paper's tables beside ours: columns with options, runs by seed and by evaluations, what is shown."""

import json
import statistics

import numpy as np
import pytest

from crosstrack.instances import entries
from crosstrack.models import AttractorAnalysis, BlackBoxMinimisation
from crosstrack.solvers.report import reproduction
from crosstrack.solvers.report.layout import Column, PaperTable, PaperTables
from crosstrack.solvers.report.tables import render

#: Two columns of one backend that its options tell apart, between them another backend.
COLUMNS = (
    Column("iafsa", options={"shrink": True, "fish": 20}),
    Column("random-search"),
    Column("iafsa", options={"fish": 20}),
)


@pytest.fixture
def tables(monkeypatch):
    """Return what sets the tables that are reproduced, by number."""

    def put(**numbered):
        found = PaperTables({int(key[1:]): value for key, value in numbered.items()}, note="Mind.")
        monkeypatch.setattr(reproduction, "paper_tables", lambda problem: found)

    return put


def model(name="somewhere/bowl", budget=300):
    return BlackBoxMinimisation("sum-squares", [[-10, 10]] * 6, budget, name=name)


def shown(result):
    """Return the rows of the only table as printed, cells in order, empty ones left out."""
    text = render(*reproduction.reproduction_parts(result), width=200)
    return text, [line.split() for line in text.splitlines() if "INCONCLUSIVE" in line]


def test_columns_of_one_backend_differ_by_options_and_seeds_by_medians(tables):
    tables(t7=PaperTable("A table", COLUMNS, repeats=5, known="known"))
    told = []
    result = reproduction.reproduce(
        "any", [(model(), {"table": 7, "optimum": 0.0})], on_solution=told.append
    )
    (row,) = result.rows
    assert [len(answers) for answers in row.answers] == [5, 5, 5]
    assert len(told) == 15
    for column, answers in zip(COLUMNS, row.answers, strict=True):
        assert {answer.backend for answer in answers} == {column.backend}
        assert all(answer.options["backend_options"] == column.options for answer in answers)
        assert [answer.seed for answer in answers] == [0, 1, 2, 3, 4]
        assert all(answer.statistics["evaluations"] == 300 for answer in answers)
    medians = [statistics.median(s.primal_bound for s in answers) for answers in row.answers]
    # The optimum lies at the origin, to which the printed swarm is pulled.
    assert medians[0] < min(medians[1:])
    text, lines = shown(result)
    assert lines == [
        ["bowl", "0.000", lines[0][2], *(f"{one:.3g}" for one in medians), "INCONCLUSIVE"]
    ]
    for word in ("A table", "shrink=True", "known", "Mind."):
        assert word in text
    # Quartiles in the JSON data are of one column each.
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    spreads = data["rows"][0]["repeats"]
    assert sorted(one["objective"][1] for one in spreads) == pytest.approx(sorted(medians))
    assert {one["runs"] for one in spreads} == {5}
    assert "evaluations" not in data["rows"][0]


def test_a_row_for_each_number_of_evaluations(tables):
    tables(t1=PaperTable("A table", (Column("random-search"),), repeats=2))
    published = {"table": 1, "evaluations": [10, 300]}
    result = reproduction.reproduce("any", [(model(), published)])
    assert [row.evaluations for row in result.rows] == [10, 300]
    for row in result.rows:
        used = {answer.statistics["evaluations"] for answer in row.answers[0]}
        assert used == {row.evaluations}
    assert [line[:2] for line in shown(result)[1]] == [["bowl,", "10"], ["bowl,", "300"]]
    assert [row["evaluations"] for row in result.to_dict()["rows"]] == [10, 300]


def test_one_run_a_cell_unless_asked_for_more(tables):
    tables(t1=PaperTable("A table", (Column("random-search"),)))
    result = reproduction.reproduce("any", [(model(), {"table": 1})])
    ((answer,),) = result.rows[0].answers
    _, (line,) = shown(result)
    # The best value, then our cell: the value of the only run, and its seconds.
    assert line[1] == line[2]
    assert float(line[1]) == pytest.approx(answer.primal_bound, rel=1e-5)
    assert line[3] == "in"
    assert "repeats" not in result.to_dict()["rows"][0]


def test_runs_that_find_nothing(tables):
    def nowhere(x):
        return float("nan")

    tables(t1=PaperTable("A table", (Column("random-search"),), repeats=3))
    none = BlackBoxMinimisation(nowhere, [[0, 1]], 5, name="none")
    result = reproduction.reproduce("any", [(none, {"table": 1})])
    _, (line,) = shown(result)
    assert line == ["none", "no_solution", "INCONCLUSIVE"]


def test_every_row_of_a_paper_has_a_number_to_ask_for():
    rows = {}
    for entry in entries():
        if "table" in entry.published:
            rows.setdefault(entry.name.partition("/")[0], []).append(entry.published["row"])
    assert {"fleet", "guided-path", "black-box"} <= set(rows)
    for numbers in rows.values():
        assert len(set(numbers)) == len(numbers)


def test_figures_of_plans_beside_the_papers(tables):
    columns = (
        Column("autocorrelation", "delay", figure="delay"),
        Column("autocorrelation", figure="exponent.value"),
        Column("surrogates", figure="surrogates.judgement"),
        Column("surrogates", figure="objective"),
    )
    tables(t1=PaperTable("A table", columns))
    noise = np.random.default_rng(3).normal(size=300)
    white = AttractorAnalysis(noise, 2.0, chaotic=False, name="somewhere/noise")
    result = reproduction.reproduce("any", [(white, {"table": 1, "row": 1, "delay": 8})])
    (row,) = result.rows
    # A backend whose columns differ by their figures alone runs once.
    assert [answers[0].backend for answers in row.answers] == [one.backend for one in columns]
    assert len(row.verdict.solutions) == 2
    delay = row.answers[0][0].plan.delay
    text = render(*reproduction.reproduction_parts(result), width=200)
    for word in ("delay", "exponent", "judgement"):
        assert word in text
    (line,) = (line.split() for line in text.splitlines() if line.startswith(" noise "))
    # Autocorrelation gives no exponent.
    assert line[2:5] == ["8.00000", f"{delay}.00000", "noise"]
    assert [float(line[k]) for k in (1, 5)] == [0.0, 0.0]
