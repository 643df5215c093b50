"""Runs of fronts and sweeps: records, Ctrl-C, output, the command line."""

import json
import math
import os
import signal
import time

import numpy as np
import pytest
from commands import run
from fronts import MODEL, PLACES, POINTS, Given, all_loads, matrix, measured, values
from listening import solutions

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import FleetRouting
from crosstrack.solvers import Answer, Front, Limit, Termination, sweep
from crosstrack.solvers.fleet.subset_dp import SubsetDP

# -- records -------------------------------------------------------------------------------------


class Counted(SubsetDP):
    """Counts its runs, and is killed before one of them."""

    name = "counted"

    def __init__(self, dies_at=None):
        self.runs, self.dies_at = [], dies_at

    def run(self, problem, request):
        if len(self.runs) == self.dies_at:
            raise KeyboardInterrupt
        self.runs.append(problem.name)
        return super().run(problem, request)


@pytest.mark.parametrize("options", [{"step": 1e-6}, {"limits": [30, 20, 18, 1]}])
def test_a_record_is_continued(tmp_path, options):
    record = tmp_path / "record.jsonl"
    whole, first, second = Counted(), Counted(dies_at=2), Counted()
    wanted = ct.front(MODEL, "max", backend=whole, isolate=False, **options)
    asked = {"record": record, "isolate": False, **options}
    with pytest.raises(KeyboardInterrupt):
        ct.front(MODEL, "max", backend=first, **asked)
    assert len(record.read_text().splitlines()) == len(first.runs) == 2
    with record.open("a") as file:  # the machine went down in the middle of a line
        file.write('{"model": "ab')
    heard = []
    found = ct.front(
        MODEL,
        "max",
        backend=second,
        resume=True,
        on_event=solutions(lambda s: heard.append(s.instance)),
        **asked,
    )
    assert first.runs + second.runs == whole.runs == heard
    assert values(found) == values(wanted)
    assert [p.limit for p in found.points] == [p.limit for p in wanted.points]
    assert [p.proven for p in found.points] == [p.proven for p in wanted.points]
    assert len(found.dominated) == len(wanted.dominated)
    assert len(found.unsolved) == len(wanted.unsolved)
    # All is there, and a record that exists is not written over.
    before = record.read_bytes()
    again = ct.front(MODEL, "max", backend=Counted(dies_at=0), resume=True, **asked)
    assert values(again) == values(wanted)
    with pytest.raises(InvalidData, match="exists: resume it"):
        ct.front(MODEL, "max", backend=Counted(), **asked)
    assert record.read_bytes() == before


def test_records_of_other_jobs_are_not_used(tmp_path):
    record, options = tmp_path / "record.jsonl", {"limits": [20, 18], "isolate": False}
    ct.front(MODEL, "max", backend=Counted(), record=record, **options)
    other = Counted()
    ct.front(MODEL, "max", backend=other, record=record, resume=True, time_limit=9, **options)
    assert len(other.runs) == 2


def test_a_sweep_is_continued(tmp_path):
    model = FleetRouting(2, points=PLACES, objective="sum-deviation", name="six")
    asked = {"isolate": False, "record": tmp_path / "record.jsonl"}
    qs, first, second = [0.0, 0.2, 0.4, 1.0], Counted(dies_at=3), Counted()
    with pytest.raises(KeyboardInterrupt):
        sweep(model, "q", qs, "sum", "deviation", backend=first, **asked)
    found = sweep(model, "q", qs, "sum", "deviation", backend=second, resume=True, **asked)
    assert [*first.runs, *second.runs] == [f"six, q = {q}" for q in qs]
    assert len(found.points) + len(found.dominated) + len(found.repeated) == 4


# -- Ctrl-C --------------------------------------------------------------------------------------


def press():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.02)


class Patient(SubsetDP):
    """Has a plan at once; from its second run on works until it is stopped, and presses Ctrl-C."""

    name = "patient"
    runs = 0

    def run(self, problem, request):
        self.runs += 1
        answer = super().run(problem, request)
        if self.runs == 1:
            return answer
        press()
        while not request.control.stopped:
            time.sleep(0.01)
        return Answer(Termination.FEASIBLE, request.control.reason, answer.point)


def test_ctrl_c_in_a_run_keeps_its_plan(tmp_path):
    record = tmp_path / "record.jsonl"
    found = ct.front(
        MODEL, "max", backend=Patient(), limits=[30, 20, 18], isolate=False, record=record
    )
    assert found.interrupted
    assert values(found) == [pytest.approx(pair, rel=1e-5) for pair in POINTS[:2]]
    assert [point.proven for point in found.points] == [True, False]
    assert found.points[1].solution.limit is Limit.INTERRUPTED
    assert "interrupted: missing points were not run" in str(found)
    assert found.to_dict()["interrupted"] is True
    # The interrupted run is repeated.
    assert len(record.read_text().splitlines()) == 1
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("options", [{"limits": [30, 20, 18]}, {"step": 1e-6}])
def test_ctrl_c_between_two_runs_keeps_the_first(tmp_path, options):
    record = tmp_path / "record.jsonl"
    found = ct.front(MODEL, "max", record=record, on_event=solutions(lambda s: press()), **options)
    assert found.interrupted
    assert values(found) == [pytest.approx(POINTS[0], rel=1e-5)]
    assert len(record.read_text().splitlines()) == 1
    whole = ct.front(MODEL, "max", record=record, resume=True, **options)
    assert not whole.interrupted
    assert values(whole) == [pytest.approx(pair, rel=1e-5) for pair in POINTS]


def test_ctrl_c_ends_a_sweep():
    model = FleetRouting(2, points=PLACES, objective="sum-deviation")
    found = sweep(
        model, "q", [0, 0.4, 1], "sum", "deviation", on_event=solutions(lambda s: press())
    )
    assert found.interrupted
    assert [point.limit for point in found.points] == [0.0]


# -- sweeps --------------------------------------------------------------------------------------


def test_a_sweep_names_dominated_points():
    """A weight of the deviation says nothing of the longest route."""
    costs = matrix("plane", 27)
    model = FleetRouting(3, costs=costs, objective="sum-deviation", name="swept")
    qs = np.arange(4) * 0.5
    found = sweep(model, "q", qs, "sum", "max", backend="subset-dp")
    shown = [*found.points, *found.dominated, *found.repeated]
    assert sorted(point.limit for point in shown) == qs.tolist()
    loads = all_loads(costs, 3)
    for point in shown:
        best = measured("sum-deviation", loads, point.limit).min()
        assert point.solution.primal_bound == pytest.approx(best, rel=1e-9)
        assert point.proven
        plan = point.solution.plan
        assert point.objective == pytest.approx(model.second_objective("sum", plan))
        assert point.second == pytest.approx(model.second_objective("max", plan))
    assert len(found.dominated) == 1
    (one,) = found.dominated
    assert any(p.objective <= one.objective and p.second < one.second for p in found.points)
    assert found.field == "q"
    assert "dominated" in found.summary()


def test_a_sweep_of_whole_numbers_and_of_words():
    model = FleetRouting(2, points=PLACES, objective="sum-deviation")
    found = sweep(model, "q", np.array([0, 1]), "sum", "max")
    assert {point.limit for point in (*found.points, *found.dominated)} == {0.0, 1.0}
    words = sweep(model, "objective", ["sum", "max"], "sum", "max")
    assert [point.limit for point in words.points] == [None, None]
    assert words.solutions[0].instance == "fleet-routing, objective = sum"
    json.dumps(words.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (("weight", [0], "sum", "max"), UnknownName, "field of model 'fleet-routing'"),
        (("name", ["a"], "sum", "max"), UnknownName, "field of model"),
        ((None, [0], "sum", "max"), UnknownName, "field of model"),
        (("q", [0], "total", "max"), UnknownName, "second objective"),
        (("q", [0], "sum", "most"), UnknownName, "second objective"),
        (("q", [0, -1], "sum", "max"), InvalidData, "q must be >= 0"),
        (("q", [0, math.nan], "sum", "max"), InvalidData, "q must be finite"),
        (("q", ["0"], "sum", "max"), InvalidData, "q must be a number"),
        (("q", [], "sum", "max"), InvalidData, "values must hold 1"),
        (("q", 0.5, "sum", "max"), InvalidData, "values must be a list"),
    ],
)
def test_invalid_sweeps_are_rejected(arguments, error, words, tmp_path):
    model = FleetRouting(2, points=PLACES, objective="sum-deviation")
    ran = []
    with pytest.raises(error) as raised:
        sweep(model, *arguments, record=tmp_path / "record.jsonl", on_event=solutions(ran.append))
    assert words in str(raised.value)
    assert ran == []
    assert not any(tmp_path.iterdir())
    with pytest.raises(UnsupportedFormulation, match="declares no second"):
        sweep(ct.load("grid-path/maze"), "theta", [1.0], "sum", "max")


def test_an_unsupported_value_raises_first():
    model, ran = FleetRouting(2, points=PLACES, objective="sum-deviation"), []
    with pytest.raises(UnsupportedFormulation, match="takes q up to"):
        sweep(
            model, "q", [0, 99], "sum", "max", backend="subset-dp", on_event=solutions(ran.append)
        )
    assert ran == []


# -- what is shown -------------------------------------------------------------------------------


def test_json_holds_all():
    found = ct.front(MODEL, "max", limits=[30, 29, 18, 1])
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data == found.to_dict()
    assert (data["model"], data["instance"]) == ("fleet-routing", "six")
    assert (data["second"], data["field"], data["interrupted"]) == ("max", "battery", False)
    assert data["digest"] == MODEL.digest
    assert [len(data[key]) for key in ("points", "dominated", "repeated", "unsolved")] == [
        2,
        0,
        1,
        1,
    ]
    for point, row in zip(found.points, data["points"], strict=True):
        assert (row["objective"], row["second"]) == (point.objective, point.second)
        again = ct.Solution.from_dict(row["solution"], MODEL.limited("max", row["limit"]))
        assert again.plan.routes == point.solution.plan.routes
    assert data["unsolved"][0]["termination"] == "infeasible"


def test_a_notebook_shows_a_table():
    named = MODEL.renamed("<b>six & more</b>")
    found = ct.front(named, "max", limits=[30, 1])
    text = found._repr_html_()
    assert "<table>" in text
    assert "&lt;b&gt;six &amp; more&lt;/b&gt;" in text
    assert "<b>" not in text
    assert "30.2265" in text
    assert "proven" in text
    assert "infeasible" in text


def test_nothing_found_is_a_front_too():
    found = ct.front(FleetRouting(2, points=PLACES, objective="sum", battery=1.0), "max")
    assert (found.points, found.solutions) == ((), ())
    assert len(found.unsolved) == 1
    # Without a name the kind of the model says what it is.
    assert "fleet-routing: infeasible" in str(found)
    assert found._repr_html_()
    json.dumps(found.to_dict(), allow_nan=False)
    with pytest.raises(InvalidData, match="at least one point"):
        ct.plot(found)


def test_fronts_are_drawn():
    exact = ct.front(MODEL, "max", limits=[30, 20, 18])
    assert isinstance(exact, Front)
    figure = ct.plot(exact)
    assert figure.axes[0].get_xlabel().startswith("max")
    rival = ct.front(MODEL, "max", backend=Given(((1, 2, 3), (4, 5))), limits=[300])
    both = ct.plot({"exact": exact, "rival": rival}, title="both")
    shown = [text.get_text() for legend in both.legends for text in legend.get_texts()]
    assert {"exact", "rival", "proven", "not proven"} <= set(shown)
    with pytest.raises(UnsupportedOption, match="no option 'colour'"):
        ct.plot(exact, colour="red")


# -- the command line ----------------------------------------------------------------------------


@pytest.fixture
def instance(tmp_path):
    path = tmp_path / "six.json"
    path.write_text(MODEL.to_json())
    return path


def test_command_prints_a_table_draws_and_records(instance, tmp_path):
    line = ["front", instance, "max", "--step", "1e-6", "--jsonl", "runs.jsonl"]
    done = run(*line, "--plot", "front.png", cwd=tmp_path)
    for objective, second in POINTS:
        assert f"{objective}" in done.stdout
        assert f"{second}" in done.stdout
    assert (tmp_path / "front.png").read_bytes().startswith(b"\x89PNG")
    record = (tmp_path / "runs.jsonl").read_text()
    assert len(record.splitlines()) == 5
    assert "exists: resume it" in run(*line, cwd=tmp_path, code=2).stderr
    again = run(*line, "--resume", "--json", cwd=tmp_path)
    data = json.loads(again.stdout)
    assert [(p["objective"], p["second"]) for p in data["points"]] == [
        pytest.approx(pair, rel=1e-5) for pair in POINTS
    ]
    assert again.stderr == ""
    assert (tmp_path / "runs.jsonl").read_text() == record


def test_command_sweeps(instance, tmp_path):
    (tmp_path / "q.json").write_text(
        FleetRouting(2, points=PLACES, objective="sum-deviation").to_json()
    )
    line = ["front", "q.json", "deviation", "--sweep", "q=0,0.2,0.4", "--first", "sum", "--json"]
    data = json.loads(run(*line, cwd=tmp_path).stdout)
    assert data["field"] == "q"
    assert [p["limit"] for p in data["points"]] == [0.0, 0.4]
    assert [p["limit"] for p in data["repeated"]] == [0.2]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["maximum"], 2, "unknown second objective"),
        (["max", "--limits", "20,abc"], 2, "20,abc"),
        (["max", "--limits", ""], 2, "not a list of numbers"),
        (["max", "--limits", "nan"], 2, "limits[0] must be finite"),
        (["max", "--limits", "20,-1"], 2, "limits[1] must be >= 0"),
        (["max", "--points", "0"], 2, "points"),
        (["max", "--step", "2"], 2, "step"),
        (["max", "--time-limit", "-1"], 2, "time_limit"),
        (["max", "--resume"], 2, "--jsonl"),
        (["max", "--first", "sum"], 2, "--sweep and --first"),
        (["max", "--sweep", "q=0,1"], 2, "--sweep and --first"),
        (["max", "--sweep", "q=0,x", "--first", "sum"], 2, "0,x"),
        (["max", "--sweep", "q", "--first", "sum"], 2, "KEY=VALUE"),
        (["max", "--sweep", "weight=0", "--first", "sum"], 2, "unknown field"),
        (["max", "--sweep", "q=0", "--first", "sum", "--points", "3"], 2, "takes no"),
        (["max", "--plot", "front.doc"], 2, "front.doc"),
        (["max", "--backend", "nope"], 2, "unknown backend"),
        (["max", "--limits", "2,1", "--plot", "none.png"], 3, "infeasible"),
        (["max", "--limits", "30", "--backend", "subset-dp"], 0, "30.2265"),
    ],
)
def test_exit_codes(instance, tmp_path, arguments, code, words):
    done = run("front", instance, *arguments, code=code, cwd=tmp_path)
    assert words in (done.stderr if code == 2 else done.stdout)
    assert (done.stdout == "") == (code == 2)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["six.json"]
    data = json.loads(run("front", instance, *arguments, "--json", code=code, cwd=tmp_path).stdout)
    assert ("error" in data) == (code == 2)


def test_a_model_without_second_objectives_is_2():
    done = run("front", "grid-path/maze", "max", code=2)
    assert "declares no second objective" in done.stderr
