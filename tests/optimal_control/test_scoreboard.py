"""The scoreboard of the benchmarks counts wrong answers apart from failures, and applies one rule to all solvers."""

import json
import re
from pathlib import Path

import pytest
from benchmarks.optimal_control.scoreboard import interpreter, judge


def _row(**changes):
    row = {"claims": True, "verified": True, "objective": 2.0, "checked_objective": 2.0}
    return {**row, **changes}


@pytest.mark.parametrize(
    ("row", "outcome"),
    [
        (_row(), "verified"),
        (_row(claims=False), "verified"),
        (_row(checked_objective=1.5), "verified"),  # a verified plan that is better
        (_row(checked_objective=2.1), "other value"),
        (_row(checked_objective=2.1, claims=False), "failed"),
        (_row(verified=False), "rejected"),
        (_row(verified=False, checked_objective=1.5), "other value"),
        (_row(verified=False, checked_objective=None), "rejected"),
        (_row(verified=False, claims=False), "failed"),
        (_row(verified=False, checked_objective=None, objective=None), "failed"),
        ({"claims": False, "objective": None}, "failed"),  # ended without an answer
    ],
)
def test_an_answer_is_judged_by_its_plan_and_its_claim(row, outcome):
    assert judge(row, 2.0, 1e-6)[0] == outcome


def test_the_error_is_relative_and_absolute_for_a_value_of_zero():
    assert judge(_row(checked_objective=2.2), 2.0, 1e-6)[1] == pytest.approx(0.1)
    assert judge(_row(checked_objective=-3.8), -4.0, 1e-6)[1] == pytest.approx(0.05)
    assert judge(_row(checked_objective=0.25), 0.0, 1e-6)[1] == 0.25


def test_an_unknown_value_is_not_judged():
    assert judge(_row(), None, 1e-5) == ("unknown", None)
    assert judge(_row(verified=False), None, 1e-5) == ("rejected", None)


def test_each_package_has_its_own_interpreter():
    assert interpreter("ours") == interpreter("bare")
    assert interpreter("yapss").parts[-4:] == ("peers", "yapss", "bin", "python")


def test_the_page_states_the_verified_answers_before_and_after_the_stage_with_linear_controls():
    root = Path(__file__).resolve().parents[2]
    page = " ".join((root / "docs/how-well.md").read_text("utf-8").split())
    boards = json.loads((root / "docs/measured/scoreboard.json").read_text("utf-8"))
    development, frozen = (
        next(row for row in boards[half]["rows"] if row[0] == "ours")
        for half in ("development-totals", "frozen-totals")
    )
    column = list(boards["frozen-totals"]["columns"]).index("verified")
    pattern = r"there from 43 to (\d+)\. On the frozen half they fell from 53 to (\d+):"
    numbers = [int(text) for text in re.search(pattern, page).groups()]
    assert numbers == [development[column], frozen[column]]
    shown = json.loads(
        (root / "tests/benchmarks/optimal_control/scoreboard_answers.json").read_text("utf-8")
    )
    assert {row["label"] for row in shown if row["solver"] == "ours"} == {"linear-stage"}
