"""The paper's table of successes beside our runs: what stands where."""

import dataclasses

import numpy as np

from crosstrack.instances import entries
from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.solvers.report import reproduction
from crosstrack.solvers.report.layout import PaperTables
from crosstrack.solvers.report.tables import render
from crosstrack.solvers.unknown_grid import BACKENDS
from crosstrack.solvers.unknown_grid.paper_tables import TABLES


def test_the_rows_are_the_papers_cells():
    rows = {
        e.published["row"]: e
        for e in entries()
        if e.published.get("table") == 6 and "mcgn" in e.published
    }
    assert sorted(rows) == list(range(1, 13))
    assert [rows[k].published["mcgn"] for k in sorted(rows)] == [
        93,
        85,
        84,
        85,
        88,
        83,
        79,
        77,
        90,
        82,
        82,
        79,
    ]
    assert [rows[k].published["macn"] for k in sorted(rows)] == [
        84,
        70,
        70,
        72,
        79,
        65,
        64,
        60,
        82,
        68,
        65,
        64,
    ]
    columns = {one.backend: one.published for one in TABLES.tables[6].columns}
    assert set(columns) == set(BACKENDS) - {"a-star-replanning"}
    assert {name: key for name, key in columns.items() if key} == {"macn": "macn", "mcgn": "mcgn"}


def test_successes_stand_beside_the_papers(monkeypatch):
    layout = TABLES.tables[6]
    few = tuple(c for c in layout.columns if c.backend in ("oracle", "baseline-2", "mcgn"))
    fewer = PaperTables({6: dataclasses.replace(layout, columns=few)}, TABLES.note)
    monkeypatch.setattr(reproduction, "paper_tables", lambda problem: fewer)
    # As where it is not installed: such a row of the campaign has no plan.
    monkeypatch.setattr(
        "crosstrack.solvers.unknown_grid.learned.Mcgn.requires", ("no_such_package",)
    )
    entry = next(e for e in entries() if e.name == "unknown-grid/task-2-5")
    # The first scenes are the same however many are drawn.
    model = draw_scenes(obstacles=5, view=(9, 9), scenes=20, name=entry.name)
    result = reproduction.reproduce("unknown-grid", [(model, entry.published)])
    text = render(*reproduction.reproduction_parts(result), width=200)
    by_name = {one.backend: one for row in result.rows for part in row.answers for one in part}
    assert by_name["mcgn"].plan is None and "crosstrack[learn]" in by_name["mcgn"].message
    (line,) = (line.split() for line in text.splitlines() if "task-2-5" in line)
    successes = [by_name[name].plan.success for name in ("baseline-2", "oracle")]
    assert successes[0] < successes[1] == 100.0
    # Its fewest steps, baseline 2, the paper's figure of what could not run, the reference, the verdict.
    assert [float(x) for x in line[1:5]] == [np.mean(model.fewest_steps()), successes[0], 77, 100]
    assert "95 %" in text and "law of our own" in text
