"""Tables fit their terminal: columns fold or go by rank, and a number is never cut."""

import json
import sys
from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.solvers.report.tables import render, solutions_table, table

NUMBERS = ("124250.503", "0.000123", "1e+09")


def sample():
    rows = [
        ("label-setting", "optimal", number, "3.1 ms", "ok, and a long sentence about what holds")
        for number in NUMBERS
    ]
    columns = ("backend", "ended", "objective", "solve", "verification")
    return table("runs", columns, rows, right=columns[2:4], drop=("solve", "ended"))


@pytest.mark.parametrize("width", [20, 30, 40, 60, 80, 120, 160])
def test_no_line_is_wider_than_the_terminal_and_no_number_is_cut(width):
    text = render(sample(), width=width)
    assert max(map(len, text.splitlines())) <= width
    for number in (*NUMBERS, "label-setting"):
        assert number in text


def test_columns_go_in_their_order():
    assert "3.1 ms" in render(sample(), width=80)
    narrow = render(sample(), width=48)
    assert "3.1 ms" not in narrow
    assert "objective" in narrow
    blocks = render(sample(), width=24)
    assert "objective: 124250.503" in blocks, "the last resort is a block a row"
    assert "solve: 3.1 ms" in blocks, "which leaves nothing out"


def test_answers_fit_eighty_columns():
    solution = ct.solve(ct.load("error-correction/example-1"), "label-setting")
    for width in (40, 80, 120):
        text = render(solutions_table([solution], "example"), width=width)
        assert max(map(len, text.splitlines())) <= width
        assert f"{solution.primal_bound:.3f}" in text
        assert "label-setting" in text


@settings(max_examples=60, deadline=None)
@given(
    cells=st.lists(
        st.tuples(
            st.text("abc ", min_size=1, max_size=30).filter(str.strip),
            st.floats(-1e12, 1e12).map(lambda x: f"{x:.6g}"),
            st.text("xyz ", max_size=60),
        ),
        min_size=1,
        max_size=4,
    ),
    width=st.integers(24, 130),
)
def test_any_table_keeps_its_numbers(cells, width):
    made = table("", ("name", "value", "words"), cells, right=("value",), drop=("words",))
    text = render(made, width=width)
    for _, number, _ in cells:
        assert number in text


# -- what a notebook and a script see ----------------------------------------------------------------


@pytest.fixture(scope="module")
def comparison():
    return ct.compare(ct.load("error-correction/example-1"), ["label-setting", "pulse"])


def test_answers_render_as_text(comparison):
    solution = comparison.solutions[0]
    for text in (solution.summary(), comparison.verdicts[0].summary(), comparison.summary()):
        assert "label-setting" in text
        assert "optimal" in text
    assert f"plan: {solution.plan_data['route'][0]}" in solution.summary()
    assert str(comparison.outcome) in comparison.summary()


def test_answers_render_as_html(comparison):
    from xml.etree import ElementTree

    solution = comparison.solutions[0]
    for shown in (solution, comparison.verdicts[0], comparison):
        tree = ElementTree.fromstring(f"<div>{shown._repr_html_().replace('<br>', '<br/>')}</div>")
        cells = ["".join(cell.itertext()) for cell in tree.iter("td")]
        assert "label-setting" in cells
    told = replace(solution, message="<script>alert(1)</script>")
    assert "<script>" not in told._repr_html_()


def test_answers_as_a_frame(comparison):
    pytest.importorskip("pandas", reason="pandas is an extra")
    frame = comparison.to_frame()
    assert list(frame["backend"]) == ["label-setting", "pulse"]
    assert frame["primal_bound"].tolist() == [s.primal_bound for s in comparison.solutions]
    assert frame["verified"].all()
    assert (frame["seconds_total"] > 0).all()
    assert comparison.solutions[0].to_frame().shape[0] == 1


def test_without_pandas_the_error_names_the_extra(comparison, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(BackendMissing, match=r"crosstrack\[pandas\]"):
        comparison.to_frame()


def test_a_route_is_a_sequence_of_points(comparison):
    solution = ct.solve(ct.load("error-correction/example-1"))
    route = solution.plan
    assert len(route) == len(list(route)) == len(route.route)
    assert (route[0], route[-1]) == (route.route[0], route.route[-1])


def test_the_packages_are_listed():
    assert {"models", "solvers", "instances", "errors", "solve"} <= set(dir(ct))


def test_a_solution_is_saved_to_a_file(comparison, tmp_path):
    solution = ct.solve(ct.load("error-correction/example-1"), "label-setting")
    model = ct.load("error-correction/example-1")
    file = solution.save(tmp_path / "kept.json")
    again = ct.Solution.load(file, model)
    assert again.plan == solution.plan
    assert again.to_dict() == solution.to_dict()
    assert ct.Solution.load(file).plan is None
    assert ct.Solution.load(file).plan_data == solution.plan_data
    with pytest.raises(InvalidData, match="digest"):
        ct.Solution.load(file, ct.load("error-correction/7"))


def test_a_saved_solution_must_verify(tmp_path):
    model = ct.load("error-correction/example-1")
    data = ct.solve(model).to_dict()
    for change, words in (
        (
            {"plan": {"route": [data["plan"]["route"][0], data["plan"]["route"][-1]]}},
            "does not hold",
        ),
        ({"primal_bound": data["primal_bound"] * 0.9}, "claims the objective"),
        (
            {
                "plan": {"route": [data["plan"]["route"][0], data["plan"]["route"][-1]]},
                "options": {**data["options"], "tolerance": 0.999},
            },
            "does not hold",
        ),
    ):
        (tmp_path / "false.json").write_text(json.dumps({**data, **change}), "utf-8")
        with pytest.raises(InvalidData, match=words):
            ct.Solution.load(tmp_path / "false.json", model)
