"""Several starts and limits of a search."""

from __future__ import annotations

import json

import pytest
from control_motions import ABOVE, BELOW, BRYSON, COARSE, CURVE

import crosstrack as ct
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.run.crosscheck import rejudged


def test_all_starts_are_kept_and_the_best_is_returned(ways):
    assert [one.seed for one in ways.starts] == [0, 5, 6]
    values = [one.primal_bound for one in ways.starts]
    assert ways.primal_bound == min(values)
    assert ways.seed == ways.starts[values.index(min(values))].seed
    assert ways.options["starts"] == 3
    # Each of them is one of the two local optima.
    for value in values:
        assert min(abs(value - BELOW), abs(value - ABOVE)) <= 2e-3 * ABOVE
    assert all(one.verification.ok and one.termination == "locally_optimal" for one in ways.starts)
    data = json.loads(ways.to_json())
    assert [one["seed"] for one in data["starts"]] == [0, 5, 6]


def test_other_starts_improve_on_a_worse_local_optimum(disc, ways):
    alone = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, seed=0)
    assert alone.primal_bound == pytest.approx(ABOVE, rel=2e-3)  # where the guess leads
    assert ways.primal_bound == pytest.approx(BELOW, rel=2e-3)


def test_the_same_seed_gives_the_same_plan(disc, ways):
    again = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, seed=ways.seed)
    assert again.plan.to_data() == ways.plan.to_data()
    other = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, seed=ways.seed + 17)
    assert other.plan.to_data() != ways.plan.to_data()


def test_compare_notes_a_worse_local_optimum(disc, ways):
    options = {"tolerance": 1e-3, "formulation_options": COARSE, "time_limit": 60}
    worse = ct.compare(disc, ["ipopt:gauss"], **options, seed=0)
    better = ct.compare(disc, ["ipopt:radau"], **options, seed=7)
    verdict = rejudged(disc, worse, better).verdicts[0]
    assert verdict.outcome == "INCONCLUSIVE"  # local searches prove nothing
    notes = [note for note in verdict.notes if "stopped at a worse point" in note]
    assert len(notes) == 1
    assert notes[0].startswith("ipopt:gauss: stopped at a worse point, 5.58")
    assert "19 % above 4.68" in notes[0] and notes[0].endswith("of ipopt:radau")
    assert verdict.best.backend == "ipopt" and verdict.best.formulation == "radau"


@pytest.mark.parametrize(
    ("name", "backend"),
    [(BRYSON, "ipopt"), (BRYSON, "slsqp"), ("satellite-slew/paper", "ipopt")],
)
def test_zero_time_is_a_limit_and_not_an_error(name, backend):
    answer = ct.solve(ct.load(name), backend, time_limit=1e-3)
    assert answer.limit == "time"
    assert answer.termination == "no_solution"
    assert answer.plan is None


@pytest.mark.parametrize("seconds", [1e-3, 1e-12])
def test_zero_time_for_several_starts(seconds):
    answer = ct.solve(ct.load(BRYSON), time_limit=seconds, starts=3)
    assert (answer.termination, answer.limit) == ("no_solution", "time")
    assert len(answer.starts) >= 1


def test_names_the_time_limit_between_starts(disc):
    answer = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, starts=1000, time_limit=0.5)
    assert len(answer.starts) < 1000
    assert answer.plan is not None
    assert answer.limit == "time"


def test_names_the_time_limit_before_its_timer_does(disc, monkeypatch):
    monkeypatch.setattr(Control, "arm", lambda control, seconds: None)
    options = {"formulation_options": COARSE, "starts": 1000, "time_limit": 0.7, "isolate": False}
    answer = ct.solve(disc, tolerance=1e-3, **options)
    assert len(answer.starts) < 1000 and answer.limit == "time"


def test_names_the_iteration_limit():
    answer = ct.solve(ct.load(CURVE), backend_options={"max_iter": 2})
    assert (answer.limit, answer.plan) == ("iterations", None)
