"""The verbs and the command line on trajectories: solve, compare, check, export, diagnose."""

import dataclasses
import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.__main__ import main
from crosstrack.instances import read_poly7, read_samples
from crosstrack.instances.minimum_snap import corridor, random_walk
from crosstrack.models import MinimumDerivative, MinimumSnap, Trajectory
from crosstrack.solvers.contract.verdict import judge

WAYPOINTS = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])
TIMES = np.array([0.0, 1.0, 2.5, 4.0])


class Done(NamedTuple):
    """Return the output of a command."""

    stdout: str
    stderr: str


def run(*arguments, code=0):
    """Run a command of the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    done = Done(out.getvalue(), err.getvalue())
    assert ended.value.code == code, (ended.value.code, done.stdout[-2000:], done.stderr[-2000:])
    return done


# -- solve and compare -------------------------------------------------------------------------------


def test_auto_takes_the_backend_that_covers_the_model():
    plain = MinimumSnap(WAYPOINTS, TIMES)
    assert ct.solve(plain).backend == "banded"
    limited = MinimumSnap(WAYPOINTS, TIMES, velocity_limit=4.0)
    assert ct.solve(limited).backend == "interior-point"
    smoother = MinimumSnap(WAYPOINTS, TIMES, velocity_limit=4.0, continuity=4)
    answer = ct.solve(smoother)
    assert answer.formulation == "legendre"
    assert answer.termination == "optimal"


def test_one_problem_by_every_kind_of_backend_agrees():
    model = MinimumSnap(WAYPOINTS, TIMES, velocity_limit=3.2, name="limited")
    answers = [ct.solve(model, name) for name in ("interior-point", "piqp", "daqp")]
    verdict = judge("limited", answers, model)
    assert verdict.outcome == "AGREED", verdict.evidence


def test_long_plans_are_listed_only_when_asked_for():
    answer = ct.solve(random_walk(50, seed=1))
    assert callable(answer.stored_plan)
    data = json.loads(answer.to_json())
    assert len(data["plan"]["coefficients"]) == 50
    back = Trajectory.from_data(data["plan"])
    assert np.array_equal(back.coefficients, answer.plan.coefficients)


def test_a_bound_that_no_unique_optimum_has_is_said():
    free = MinimumSnap(
        [[0.0], [None], [None]], [0.0, 1.0, 2.0], start=np.empty((0, 1)), end=np.empty((0, 1))
    )
    answer = ct.solve(free, "banded")
    assert answer.plan is None
    assert "unique" in answer.message


def test_weighted_orders_and_high_continuity_go_to_the_programs():
    model = MinimumDerivative(
        WAYPOINTS, TIMES, order=3, weights=[0.0, 1.0, 1.0], degree=8, continuity=4
    )
    answers = {name: ct.solve(model, name) for name in ("clarabel", "piqp")}
    for answer in answers.values():
        assert answer.termination == "optimal", answer.message
    values = [answer.primal_bound for answer in answers.values()]
    assert values[0] == pytest.approx(values[1], rel=1e-6)


def test_stopped_between_refinements_nothing_is_returned_as_a_plan():
    model = corridor(40, seed=3)
    answer = ct.solve(model, "highs", time_limit=0.3, isolate=False)
    if answer.termination != "optimal":  # a fast machine may finish
        assert answer.termination == "no_solution"
        assert answer.limit == "time"
        assert answer.plan is None


# -- diagnose ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("segment", [0, 4, 9])
def test_diagnose_names_the_segment(segment):
    limit = np.full((10, 1), 50.0)
    limit[segment] = 0.4
    model = MinimumSnap(
        np.cumsum(np.ones((11, 2)), axis=0), np.arange(11.0), velocity_limit=limit, name="slow"
    )
    assert ct.solve(model).termination == "infeasible"
    found = ct.diagnose(model)
    assert found.feasible is False
    assert {finding.data["segment"] for finding in found.findings} == {segment}
    assert found.findings[0].data["bound"] == "velocity limit"
    assert f"segment {segment}" in found.summary


def test_diagnose_is_minimal():
    """Removing any finding makes the problem feasible. All findings together are infeasible."""
    box = np.array([[0.0, 1.0], [1.5, 2.5]])  # two boxes that do not touch
    lower = np.column_stack([box[:, 0], [-5.0, -5.0]])
    upper = np.column_stack([box[:, 1], [5.0, 5.0]])
    model = MinimumSnap(
        [[0.5, 0.0], [None, None], [2.0, 0.0]], [0.0, 1.0, 2.0],
        corridor_lower=lower, corridor_upper=upper,
    )  # fmt: skip
    found = ct.diagnose(model)
    assert [(f.data["bound"], f.data["segment"], f.data["axis"]) for f in found.findings] == [
        ("corridor", 0, 0),
        ("corridor", 1, 0),
    ]
    for segment in (0, 1):
        wider = upper.copy(), lower.copy()
        wider[0][segment, 0], wider[1][segment, 0] = np.inf, -np.inf
        without = dataclasses.replace(model, corridor_upper=wider[0], corridor_lower=wider[1])
        assert ct.solve(without).termination == "optimal"


def test_diagnose_a_feasible_corridor():
    assert ct.diagnose(corridor(5, seed=2)).feasible is True


def test_diagnose_beyond_the_interior_point():
    limit = np.full((3, 1), 50.0)
    limit[1] = 0.2
    model = MinimumSnap(WAYPOINTS, TIMES, velocity_limit=limit, continuity=2)
    found = ct.diagnose(model)
    assert found.feasible is False
    assert any(finding.data["block"] == "velocity limit" for finding in found.findings)


def test_diagnose_names_half_spaces():
    model = MinimumSnap(
        [[0.0, 0.0], [5.0, 5.0]], [0.0, 10.0], polytope_segments=[0, 0],
        polytope_normals=[[1.0, -1.0], [-1.0, 1.0]], polytope_offsets=[0.1, 0.1],
        velocity_limit=0.7,
    )  # fmt: skip
    found = ct.diagnose(model)
    assert found.feasible is False
    assert found.findings[0].data["bound"] == "velocity limit"


# -- the command line --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def eight(tmp_path_factory):
    path = tmp_path_factory.mktemp("eight") / "solution.json"
    done = run("solve", "minimum-snap/figure-eight-yaw", "--json", "--output", path)
    answer = json.loads(done.stdout)
    assert answer["model"] == "minimum-snap"
    assert answer["termination"] == "optimal"
    return path


def test_check_accepts_what_solve_wrote(eight, tmp_path):
    data = json.loads(run("check", "minimum-snap/figure-eight-yaw", eight, "--json").stdout)
    assert data["verification"]["ok"] is True
    plan = json.loads(eight.read_text())["plan"]
    plan["coefficients"][3][0][0] += 1e-3
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(plan))
    data = json.loads(
        run("check", "minimum-snap/figure-eight-yaw", broken, "--json", code=6).stdout
    )
    wrong = [c["name"] for c in data["verification"]["checks"] if not c["ok"]]
    assert "waypoints" in wrong
    export = ("export", "minimum-snap/figure-eight-yaw", broken, "--output", tmp_path / "x.csv")
    assert "NOT verified" in run(*export, code=6).stdout
    assert json.loads(run(*export, "--json", code=6).stdout)["verification"]["ok"] is False
    assert not (tmp_path / "x.csv").exists()


def test_check_against_the_rows_of_a_program(eight):
    done = run("check", "minimum-snap/figure-eight-yaw", eight, "--formulation", "legendre")
    assert "verified" in done.stdout


def test_export_writes_poly7(eight, tmp_path):
    name = "minimum-snap/figure-eight-yaw"
    report = json.loads(run("export", name, eight, "--output", tmp_path / "f.csv", "--json").stdout)
    assert report["fits"] is True
    assert report["pieces"] == 12
    flown = read_poly7(tmp_path / "f.csv")
    plan = Trajectory.from_data(json.loads(eight.read_text())["plan"])
    t = np.linspace(0.0, flown.duration * (1 - 1e-7), 200)
    assert np.abs(flown(t) - plan(np.minimum(t, plan.duration))).max() <= 1e-5
    run("export", name, eight, "--format", "samples", "--rate", 50, "--output", tmp_path / "s.csv")
    samples = read_samples(tmp_path / "s.csv")
    assert np.abs(samples.values[0] - plan(samples.times)).max() <= 1e-9
    run("export", name, eight, "--format", "bezier", "--output", tmp_path / "b.csv", code=2)
    run("export", name, eight, "--format", "bezier", "--output", tmp_path / "b.json")


def test_exit_codes_of_an_infeasible_corridor():
    done = run("solve", "minimum-snap/corridor-infeasible", code=3)
    assert "diagnose" in done.stdout
    data = json.loads(run("diagnose", "minimum-snap/corridor-infeasible", "--json", code=3).stdout)
    assert data["feasible"] is False
    assert {finding["segment"] for finding in data["findings"]} == {6}


def test_reproduce_counts_the_items_of_a_paper_without_values():
    done = run("reproduce", "minimum-snap")
    assert re.search(r"^\d+ items of the paper: \d+ as printed, \d+ corrected", done.stdout, re.M)


def test_bad_files_are_refused(tmp_path):
    path = tmp_path / "bad.json"
    data = {"waypoints": [[0, 0], [1, 1], [2, 2]], "times": [0, 1, 1]}
    path.write_text(json.dumps({"model": "minimum-snap", "data": data}))
    done = run("solve", path, code=2)
    assert "times[2]" in done.stderr
    assert "bad.json" in done.stderr


def test_time_allocation_commands(tmp_path):
    done = run(
        "solve", "time-allocation/walk-20-limited", "--json", "--output", tmp_path / "s.json",
        "--plot", tmp_path / "s.png",
    )  # fmt: skip
    answer = json.loads(done.stdout)
    assert answer["termination"] == "locally_optimal"
    assert (tmp_path / "s.png").stat().st_size > 10_000
    checks = {c["name"]: c for c in answer["verification"]["checks"]}
    assert checks["velocity limit"]["ok"]
    assert checks["acceleration limit"]["ok"]
    run("check", "time-allocation/walk-20-limited", tmp_path / "s.json")
    run(
        "export",
        "time-allocation/walk-20-limited",
        tmp_path / "s.json",
        "--output",
        tmp_path / "f.csv",
    )
    names = "time-gradient,ipopt"
    done = run("compare", "time-allocation/lap-8s", "--backends", names, "--json", code=4)
    assert json.loads(done.stdout)["verdict"] == "INCONCLUSIVE"  # neither proves a bound
    assert "objective (" not in run("solve", "time-allocation/lap-8s").stdout
