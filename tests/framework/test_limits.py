"""Limits and events are the same for all verbs."""

import dataclasses
import inspect
import json
import logging
import re

import pytest
from commands import run
from listening import incumbents

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.solvers import Backend, EventKind, Guarantee, Stalled
from crosstrack.solvers.bench import Campaign, Set
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.contract.limits import LimitOptions

FIELDS = [field.name for field in dataclasses.fields(ct.Limits)]
MODEL = FleetRouting(
    2, points=[[0, 0], [4, 0], [5, 5], [5, -5], [-1, 1], [-2, -1]], objective="sum", name="six"
)


@pytest.mark.parametrize("verb", ["solve", "compare", "front", "bench", "diagnose"])
def test_every_verb_has_every_limit_as_a_keyword(verb):
    parameters = inspect.signature(getattr(ct, verb)).parameters
    assert [name for name in FIELDS if name not in parameters] == []
    assert "limits" in parameters


def test_every_limit_has_a_type_for_callers_and_a_line_in_the_docstring():
    assert sorted(LimitOptions.__annotations__) == sorted(FIELDS)
    lines = re.findall(r"^ *([\w, ]+) : ", ct.Limits.__doc__, re.M)
    assert sorted(name for line in lines for name in line.split(", ")) == sorted(FIELDS)


#: A value of every limit that differs from its default.
SET = {
    "time_limit": 5.0, "memory_limit": 500.0, "evaluations": 9, "target": 1.0, "gap": 0.1,
    "tolerance": 1e-5, "seed": 1, "threads": 2, "stop": Stalled(1.0),
    "warm_start": FleetPlan(((1, 2), (3, 4, 5))), "starts": 2, "verbose": True, "on_event": print,
}  # fmt: skip
#: Limits that the run applies to every backend.
APPLIED_BY_THE_RUN = {"time_limit", "memory_limit", "tolerance", "verbose", "on_event"}


class Bare(Backend):
    """Backend without features."""

    name = "bare"
    guarantee = Guarantee.HEURISTIC

    def run(self, problem, request):
        raise NotImplementedError


def test_no_limit_is_ignored():
    """A backend refuses each limit that needs a feature, see `Backend.unsupported`."""
    limits = ct.Limits(**SET)
    assert sorted(SET) == sorted(FIELDS)
    refused = set(Bare().unsupported(limits))
    assert sorted(refused) == sorted(set(FIELDS) - APPLIED_BY_THE_RUN)


def test_every_limit_that_changes_an_answer_is_recorded():
    """Jobs of a resumed campaign are equal if `Job.options` and the seed are."""
    recorded = Job(model=MODEL, **SET).options()
    assert set(FIELDS) - set(recorded) == {"seed", "verbose", "on_event"}


def test_a_keyword_overrides_the_record():
    record = ct.Limits(time_limit=5, seed=3)
    assert ct.solve(MODEL, "fleet-search", limits=record).seed == 3
    changed = ct.solve(MODEL, "fleet-search", limits=record, seed=4)
    assert changed.seed == 4
    assert changed.options["time_limit"] == 5


def test_compare_and_front_take_a_record():
    record = ct.Limits(time_limit=5, seed=3, tolerance=1e-5)
    (verdict,) = ct.compare(MODEL, ["fleet-search", "subset-dp"], limits=record).verdicts
    assert {s.options["tolerance"] for s in verdict.solutions} == {1e-5}
    front = ct.front(MODEL, "max", limits=record, points=1)
    assert front.points[0].solution.options["time_limit"] == 5


def test_starts_reach_the_heuristics_of_a_comparison_alone():
    (verdict,) = ct.compare(MODEL, ["fleet-search", "subset-dp"], starts=2, seed=1).verdicts
    assert [s.options["starts"] for s in verdict.solutions] == [2, 1]


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"time_limt": 3}, TypeError, "did you mean 'time_limit'"),
        ({"limits": {"time_limit": 3}}, UnsupportedOption, "limits must be a Limits record"),
        ({"on_event": 3}, UnsupportedOption, "on_event must be callable"),
        ({"starts": 0}, UnsupportedOption, "starts must be a whole number >= 1"),
        ({"stop": 3}, UnsupportedOption, "stop must be a Criterion"),
    ],
)
def test_a_wrong_limit_raises(options, error, words):
    with pytest.raises(error, match=words):
        ct.solve(MODEL, **options)
    if "limits" not in options:  # those of a front may also be numbers
        with pytest.raises(error, match=words):
            ct.front(MODEL, "max", **options)


def test_diagnose_refuses_limits_that_have_no_effect():
    with pytest.raises(
        UnsupportedOption,
        match=r"diagnose of model .* does not support seed=3; supported: time_limit",
    ):
        ct.diagnose(MODEL, seed=3)
    with pytest.raises(UnsupportedOption, match="does not support stop="):
        ct.diagnose(MODEL, "highs", stop=Stalled(1.0))
    assert ct.diagnose(
        MODEL, "highs", formulation="two-index", tolerance=1e-5, time_limit=20
    ).feasible


def test_prepare_takes_the_record_of_its_limits():
    model = ct.load("optimal-control/brachistochrone")
    solver = ct.prepare(model, limits=ct.Limits(tolerance=1e-5, time_limit=20))
    assert solver.request.time_limit == 20
    with pytest.raises(UnsupportedOption, match="prepare does not support seed=3; supported: time"):
        ct.prepare(model, limits=ct.Limits(seed=3))


def test_a_warm_start_may_be_an_array():
    program = ct.load("error-correction/example-1").formulate("arc-flow").program
    point = ct.solve(program, "highs").plan
    assert set(ct.Limits(warm_start=point, starts=1, seed=0).changes()) == {"warm_start", "seed"}
    with pytest.raises(UnsupportedOption, match="does not support warm_start=array"):
        ct.diagnose(program, "highs", warm_start=point)
    assert ct.compare(program, ["scipy", "highs"], warm_start=point).outcome == "AGREED"


def test_a_diagnosis_in_a_worker_reports_no_events():
    with pytest.raises(UnsupportedOption, match="does not support on_event="):
        ct.diagnose(MODEL, "highs", formulation="two-index", memory_limit=900, on_event=print)


@pytest.mark.parametrize("verb", ["solve", "compare", "front", "bench"])
def test_every_verb_shows_the_log_of_the_solver(verb, monkeypatch, tmp_path):
    """The level of the logger lets the lines pass for the time of the call."""
    records, handler = [], logging.Handler()
    monkeypatch.setattr(handler, "emit", records.append)
    output = logging.getLogger("crosstrack.output")
    output.addHandler(handler)
    try:
        if verb == "solve":
            ct.solve(MODEL, "fleet-search", time_limit=2, verbose=True)
        elif verb == "compare":
            ct.compare(MODEL, ["fleet-search"], time_limit=2, verbose=True)
        elif verb == "front":
            ct.front(MODEL, "max", backend="fleet-search", points=1, time_limit=2, verbose=True)
        else:
            campaign = Campaign((Set(("fleet/example",), ("fleet-search",), time_limit=2),))
            ct.bench(campaign, record=tmp_path / "r.jsonl", verbose=True)
    finally:
        output.removeHandler(handler)
    assert any("incumbent" in record.getMessage() for record in records)
    assert not output.isEnabledFor(logging.INFO)


@pytest.mark.parametrize("isolate", [False, True])
def test_a_run_reports_incumbents_and_bounds(isolate):
    events = []
    best = ct.solve(MODEL, "highs", time_limit=20, isolate=isolate, on_event=events.append)
    assert {(event.instance, event.backend) for event in events} == {("six", "highs")}
    found = [e.incumbent.objective for e in events if e.kind is EventKind.INCUMBENT]
    assert found[-1] == pytest.approx(best.primal_bound, rel=1e-6)
    bounds = [event.bound for event in events if event.kind is EventKind.BOUND]
    assert bounds == sorted(bounds)
    assert all(bound <= best.primal_bound * (1 + 1e-6) for bound in bounds)


def test_a_search_with_a_bound_reports_it():
    events = []
    ct.solve(MODEL, "fleet-search", time_limit=5, on_event=events.append)
    assert EventKind.BOUND in {event.kind for event in events}


def test_a_comparison_reports_solutions():
    events = []
    ct.compare(MODEL, ["subset-dp", "fleet-search"], time_limit=5, on_event=events.append)
    assert [event.kind for event in events] == [EventKind.SOLUTION] * 2
    assert {event.backend for event in events} == {"subset-dp", "fleet-search"}


def test_a_campaign_takes_limits_and_reports_progress(tmp_path):
    campaign = Campaign((Set(("fleet/example",), ("subset-dp", "fleet-search"), time_limit=20),))
    events = []
    records = ct.bench(
        campaign, record=tmp_path / "r.jsonl", seed=7, time_limit=4, on_event=events.append
    )
    assert {s.options["time_limit"] for s in records.solutions} == {4}
    assert {s.seed for s in records.solutions if s.backend == "fleet-search"} == {7}
    kinds = [event.kind for event in events]
    assert sorted(kinds) == [EventKind.SOLUTION] * 2 + [EventKind.STARTED] * 2
    assert events[-1].progress.done == 2


def test_the_former_callbacks_warn_and_are_called(tmp_path):
    seen = []
    with pytest.warns(DeprecationWarning, match="on_incumbent is now on_event"):
        ct.solve(MODEL, "fleet-search", time_limit=2, on_incumbent=seen.append)
    assert seen[-1].objective > 0
    with pytest.warns(DeprecationWarning, match="on_solution is now on_event"):
        ct.compare(MODEL, ["subset-dp"], on_solution=lambda s: seen.append(s.backend))
    with pytest.warns(DeprecationWarning, match="on_point is now on_event"):
        ct.front(MODEL, "max", points=1, on_point=lambda s: seen.append(s.instance))
    assert seen[-2:] == ["subset-dp", "six"]


def test_an_exception_of_the_callback_is_raised():
    def fail(event):
        raise ZeroDivisionError(event.backend)

    with pytest.raises(ZeroDivisionError, match="fleet-search"):
        ct.solve(MODEL, "fleet-search", time_limit=5, on_event=fail)
    both = []
    ct.solve(MODEL, "fleet-search", time_limit=2, on_event=incumbents(both.append))
    assert both


@pytest.mark.parametrize("command", ["solve", "compare", "front", "bench", "diagnose"])
def test_the_command_line_has_a_flag_per_limit(command):
    from crosstrack.__main__ import cli

    options = cli.get_command(None, command).params
    flags = {flag for option in options for flag in option.opts}
    left_out = {"on_event"} | ({"warm_start"} if command in ("bench", "diagnose") else set())
    missing = [n for n in FIELDS if n not in left_out and f"--{n.replace('_', '-')}" not in flags]
    assert missing == []


def test_the_command_line_combines_stopping_criteria():
    booth = ("solve", "black-box/booth", "--backend", "random-search", "--seed", "1", "--json")
    done = run(*booth, "--stop", "evaluations=50", "--stop", "stalled=9")
    assert json.loads(done.stdout)["limit"] == "evaluations"
    wrong = run(*booth, "--stop", "stale=9", code=2)
    assert "'stale' is unknown; known: seconds, evaluations, target, stalled" in wrong.stderr
