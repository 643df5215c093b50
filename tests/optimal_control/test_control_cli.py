"""Command line on optimal control problems."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from control_motions import BRYSON, ENERGY, push, run, turn

#: Ctrl-C from inside the process at a defined moment, independent of the machine's load.
_INTERRUPT = """
import json, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import casadi
from crosstrack.models.optimal_control.transcription.base import Transcription
from crosstrack.__main__ import main

asked = Transcription.refined
count = 0

def refined(self, point, tolerance, duals=None):
    global count
    count += 1
    finer = asked(self, point, tolerance)
    if {when}:
        os.kill(os.getpid(), signal.SIGINT)
    return finer

Transcription.refined = refined
main(sys.argv[1:])
"""


def interrupted(when: str, tmp_path: Path, *arguments: Any) -> tuple[int, dict[str, Any]]:
    """Run the command line with Ctrl-C at `when`; return the exit code and the JSON."""
    script = tmp_path / "interrupt.py"
    script.write_text(textwrap.dedent(_INTERRUPT.replace("{when}", when)))
    done = subprocess.run(
        [sys.executable, script, *map(str, arguments), "--json", "--in-process"],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout)


def test_ctrl_c_between_two_meshes_returns_the_last_plan(tmp_path):
    code, data = interrupted("finer is not None", tmp_path, "solve", BRYSON, "--tolerance", "1e-4")
    assert code == 130
    assert data["limit"] == "interrupted"
    # The returned plan is verified even if the first mesh is not good enough.
    assert (data["plan"] is None) is (data["termination"] == "rejected")
    assert data["plan"] is None or data["verification"]["ok"]


def test_ctrl_c_between_two_starts_returns_the_best(tmp_path):
    code, data = interrupted(
        "count == 2", tmp_path, "solve", ENERGY, "--starts", 6, "--formulation-option", "intervals=2"
    )  # fmt: skip
    assert len(data["starts"]) < 6
    assert data["plan"] is not None
    assert (code, data["limit"]) == (130, "interrupted")


def test_solve_writes_its_answer_and_a_picture(solved):
    data = json.loads(solved.read_text())
    assert data["model"] == "optimal-control"
    assert data["instance"] == ENERGY
    assert (data["backend"], data["formulation"]) == ("ipopt", "gauss")
    assert (data["termination"], data["limit"]) == ("locally_optimal", None)
    assert data["primal_bound"] == pytest.approx(12.0)
    assert data["dual_bound"] is None and data["gap"] is None
    assert data["verification"]["ok"] is True
    assert set(data["plan"]) == {"phases", "parameters"}
    assert {"meshes", "intervals", "nodes", "columns"} <= set(data["statistics"])
    assert {"build", "solve", "decode", "verify", "total"} <= set(data["seconds"])
    assert solved.with_suffix(".png").stat().st_size > 10_000


def test_check_accepts_the_solution_and_rejects_a_changed_one(solved, tmp_path):
    done = run("check", ENERGY, solved, "--formulation", "gauss", "--json")
    data = json.loads(done.stdout)["verification"]
    assert data["ok"] is True
    assert "dynamics of v" in [check["name"] for check in data["checks"]]
    plan = json.loads(solved.read_text())["plan"]
    plan["phases"][0]["controls"]["values"][3][0][0] += 0.5
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(plan))
    data = json.loads(run("check", ENERGY, broken, "--json", code=6).stdout)["verification"]
    assert "motion" in [check["name"] for check in data["checks"] if not check["ok"]]


def test_export_writes_samples_and_no_pieces(solved, tmp_path):
    table = tmp_path / "samples.csv"
    run("export", ENERGY, solved, "--format", "samples", "--rate", 10, "--output", table)
    assert table.read_text().startswith("phase,t,x,v,u\n")
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    t = rows[:, 1]
    assert t == pytest.approx(np.linspace(0, 1, 11))
    want = np.stack([3 * t**2 - 2 * t**3, 6 * t - 6 * t**2, 6 - 12 * t], axis=1)
    assert rows[:, 2:] == pytest.approx(want, abs=1e-6)
    poly7 = ("--format", "poly7", "--output", tmp_path / "x.csv")
    done = run("export", ENERGY, solved, *poly7, code=2)
    assert "known: samples" in done.stderr
    assert not (tmp_path / "x.csv").exists()


def test_solves_a_declared_problem_from_its_file(tmp_path):
    from crosstrack.files import write_text

    path = tmp_path / "push.json"
    write_text(path, push(1.0).to_json())
    done = run("solve", path, "--formulation-option", "intervals=3", "--json", code=4)
    data = json.loads(done.stdout)
    assert data["termination"] == "locally_infeasible"
    assert data["plan"] is None and data["verification"] is None
    data = json.loads(run("diagnose", path, "--json", code=3).stdout)
    assert data["feasible"] is False
    assert {"text", "equation", "where", "block", "by", "unit"} <= set(data["findings"][0])
    assert {one["block"] for one in data["findings"]} == {"u", "end time", "final value of x"}


def test_dependent_equations_are_bad_data(tmp_path):
    from crosstrack.files import write_text

    path = tmp_path / "turn.json"
    write_text(path, turn().to_json())
    done = run("solve", path, "--json", "--formulation-option", "dependent=raise", code=2)
    error = json.loads(done.stdout)["error"]
    assert (error["type"], error["field"]) == ("InvalidData", "final")
    assert "dependent equations" in error["message"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "optimal-control/nope"], "unknown instance"),
        (["solve", BRYSON, "--formulation-option", "degree=0"], "'degree'"),
        (["solve", BRYSON, "--formulation-option", "dependent=maybe"], "'drop'"),
    ],
)  # fmt: skip
def test_bad_usage_is_2(arguments, words):
    done = run(*arguments, code=2)
    assert words in done.stderr
    assert done.stdout == "" and "Traceback" not in done.stderr


@pytest.mark.slow
def test_compare_is_inconclusive_without_a_bound():
    done = run("compare", ENERGY, "--backends", "ipopt:gauss,ipopt:radau", "--json", code=4)
    data = json.loads(done.stdout)
    assert data["verdict"] == "INCONCLUSIVE"
    rows = data["instances"][0]["solutions"]
    assert [row["formulation"] for row in rows] == ["gauss", "radau"]
    assert all(row["termination"] == "locally_optimal" for row in rows)


def test_models_are_listed_as_data():
    found = {one["model"]: one for one in json.loads(run("models", "--json").stdout)}
    assert set(found["optimal-control"]["formulations"]) >= {"paper", "gauss", "radau"}
