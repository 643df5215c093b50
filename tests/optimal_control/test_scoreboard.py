"""The scoreboard of the benchmarks counts wrong answers apart from failures, and applies one rule to all solvers."""

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
