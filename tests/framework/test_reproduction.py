"""A paper's result tables beside our values: cells, rows, verdicts, errors."""

import json

import pytest

from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances.paper import ResultTable, measurement, paper_of
from crosstrack.models import BlackBoxMinimisation
from crosstrack.solvers.report import reproduction
from crosstrack.solvers.report.tables import render

BOX = BlackBoxMinimisation("sum-squares", [[-10, 10]] * 2, 100, name="somewhere/bowl")


def result_table(**changed):
    fields = {
        "name": "table-2",
        "title": "Table 2: a table",
        "keys": ("instance", "size"),
        "columns": {"best": ".2f", "seconds": ".1f"},
        "rows": {("bowl", "2"): (1.25, None), ("bowl", "3"): (2.5, "none")},
        "ours": {"runs": "d"},
        "note": "Mind the units.",
    }
    return ResultTable(**fields | changed)


def measure(row, trials):
    if row[1] == "3":
        return {"best": 2.0}
    answers = trials.run(BOX, "random-search", evaluations=20)
    best = min(answer.primal_bound for answer in answers)
    return {"best": best, "seconds": "not measured", "runs": len(answers)}


def test_shows_both_values_of_each_cell_and_judges_the_runs():
    result = reproduction.reproduce("any", [(result_table(), measure)], runs=3)
    first, second = result.rows
    assert [row.number for row in result.rows] == [1, 2]
    assert first.values["runs"] == 3
    assert [answer.seed for answer in first.verdicts[0].solutions] == [0, 1, 2]
    assert second.values == {"best": 2.0}
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["rows"][1]["published"] == {"best": 2.5, "seconds": "none"}
    assert data["rows"][1]["key"] == {"instance": "bowl", "size": "3"}
    assert data["note"] == "Mind the units."
    text = render(*reproduction.reproduction_parts(result), width=160)
    (line,) = (line.split() for line in text.splitlines() if line.split()[:2] == ["bowl", "2"])
    assert line[:4] == ["bowl", "2", "1.25", f"{first.values['best']:.2f}"]
    for words in ("Table 2: a table", "Mind the units.", "not measured", "INCONCLUSIVE"):
        assert words in text


def test_measures_only_the_requested_rows():
    numbers = []
    result = reproduction.reproduce(
        "any",
        [(result_table(), measure)],
        rows={2, 9},
        on_row=lambda row: numbers.append(row.number),
    )
    assert numbers == [2]
    assert result.rows[0].key == ("bowl", "3")


def test_accepts_the_former_callback():
    solutions, events, tables = [], [], [(result_table(), measure)]
    with pytest.warns(DeprecationWarning, match="on_solution is now on_event"):
        reproduction.reproduce("any", tables, on_solution=solutions.append, on_event=events.append)
    assert [event.solution for event in events if event.solution] == solutions
    assert [solution.backend for solution in solutions] == ["random-search"]


def test_an_interrupt_keeps_the_finished_rows():
    def interrupted(row, trials):
        if row[1] == "3":
            raise KeyboardInterrupt
        return {"best": 1.0}

    result = reproduction.reproduce("any", [(result_table(), interrupted)])
    assert result.interrupted
    assert [row.key for row in result.rows] == [("bowl", "2")]
    assert "interrupted" in render(*reproduction.reproduction_parts(result), width=160)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"worst": 1.0}, "no column 'worst'"),
        ({"best": float("nan")}, "finite"),
        ({"best": [1]}, "a text"),
    ],
)
def test_rejects_values_that_are_not_cells(values, words):
    with pytest.raises(InvalidData, match=words):
        result_table().check_values(("bowl", "2"), values)


@pytest.mark.parametrize(
    "changed",
    [{"rows": {("bowl", "2"): (1.0,)}}, {"rows": {("bowl",): (1.0, 2.0)}}, {"ours": {"best": "d"}}],
)
def test_rejects_tables_whose_rows_and_columns_do_not_fit(changed):
    with pytest.raises(InvalidData):
        result_table(**changed)


def test_rows_of_measured_files_hold_both_values():
    one = result_table()
    assert list(one.heads) == [
        *("instance", "size", "best, paper", "best", "seconds, paper", "seconds", "runs")
    ]
    cells = one.cells(("bowl", "3"), {"best": 2.6, "runs": 4})
    assert cells == ["bowl", "3", 2.5, 2.6, "none", None, 4]
    assert one.printed_cells == 3


def test_unknown_names_are_errors():
    with pytest.raises(UnknownName, match="problem to reproduce"):
        paper_of("nothing")
    with pytest.raises(UnknownName, match="table to measure"):
        measurement("messenger", "table-99")
