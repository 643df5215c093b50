"""The command line: streams, exit codes, files."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from commands import run

import crosstrack as ct
from crosstrack.__main__ import cli

DATA = {
    "points": [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [9, 9, 9], [3.5, 0, 0]],
    "kinds": ["A", "horizontal", "vertical", "horizontal", "B"],
    "alpha1": 0.3, "alpha2": 0.3, "beta1": 0.3, "beta2": 0.3, "theta": 0.3, "delta": 0.1,
}  # fmt: skip


@pytest.fixture
def instance(tmp_path):
    def write(name="instance.json", **changes):
        path = tmp_path / name
        path.write_text(json.dumps({"model": "error-correction", "data": {**DATA, **changes}}))
        return path

    return write


def test_lists():
    names = [row["name"] for row in json.loads(run("backends", "--json").stdout)]
    assert {
        "label-setting",
        "two-stage",
        "pulse",
        "dynamic-programming",
        "labelling",
        "highs",
        "scip",
    } <= set(names)
    for row in json.loads(run("backends", "--json").stdout):
        assert {"name", "installed", "version", "accepts", "guarantee", "features"} <= set(row)
    assert "label-setting" in run("backends").stdout
    assert "error-correction" in run("models").stdout
    listed = [row["name"] for row in json.loads(run("instances", "--json").stdout)]
    numbered = [name for name in listed if name.startswith("error-correction/")]
    assert [f"error-correction/{k}" for k in range(1, 13)] == numbered[:12]
    assert "error-correction/example-1" in listed
    assert "error-correction/12" in run("instances").stdout


def test_solve_prints_only_json(instance):
    done = run("solve", instance(), "--json")
    data = json.loads(done.stdout)
    assert data["termination"] == "optimal"
    assert data["plan"] == {"route": [0, 1, 2, 4]}
    assert data["verification"]["ok"] is True
    assert done.stderr == ""


def test_solve_in_words(instance):
    text = run(
        "solve", instance(), "--backend", "highs", "--formulation", "paper", "--time-limit", 30
    ).stdout
    assert "highs : paper" in text
    assert "0-1-2-4" in text
    assert "horizontal error at B" in text


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["solve", "error-correction/99"], 2, "unknown"),
        (["solve", "no-such-file.json"], 2, "no-such-file.json"),
        (["solve", "error-correction/1", "--backend", "nope"], 2, "unknown backend"),
        (["solve", "error-correction/1", "--time-limit", "abc"], 2, "abc"),
        (["solve", "error-correction/1", "--time-limit", "-1"], 2, "time_limit"),
        (["solve"], 2, "Missing argument"),
        (["nonsense"], 2, "No such command"),
        (["solve", "error-correction/1", "--option", "x"], 2, "KEY=VALUE"),
        (["solve", "error-correction/1", "--plot", "picture.doc"], 2, "picture"),
        (["solve", "error-correction/1", "--plot", "no/such/folder/a.png"], 2, "folder"),
        (["solve", "error-correction/1", "--backend", "HIGHS"], 2, "did you mean 'highs'?"),
        (["solve", "ERROR-CORRECTION/7"], 2, "did you mean 'error-correction/7'"),
        (["solve", "error-correction/1", "--tim-limit", "1"], 2, "'--time-limit'"),
        (["slove", "error-correction/1"], 2, "Did you mean 'solve'?"),
        (
            ["solve", "error-correction/1", "--backend", "highs", "--formulation", "Paper"],
            2,
            "did you mean 'paper'?",
        ),
        (
            ["solve", "error-correction/1", "--backend", "highs", "--option", "Presolv=on"],
            2,
            "did you mean 'presolve'?",
        ),
        (["compare", "error-correction/1", "--resume"], 2, "--jsonl"),
        (
            ["solve", "fleet/example", "--formulation", "two"],
            2,
            "unknown formulation of model 'fleet-routing' 'two': did you mean 'two-index'?",
        ),
        (["models", "fleet"], 2, "did you mean 'fleet-mission' or 'fleet-routing'?"),
        (["reproduce", "nonsense"], 2, "unknown problem"),
    ],
)
def test_bad_usage_is_2(arguments, code, words, tmp_path):
    done = run(*arguments, code=code, cwd=tmp_path)
    assert words in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"theta": -1}, "theta"),
        ({"points": [[0, 0, None], *DATA["points"][1:]]}, "points[0, 2]"),
        ({"kinds": [*DATA["kinds"][:3], "up", "B"]}, "kinds[3]"),
        ({"unknown": 1}, "unknown"),
        ({"points": "missing.csv"}, "missing.csv"),
    ],
)
def test_bad_data_is_2_and_named(instance, changes, words):
    done = run("solve", instance(**changes), "--json", code=2)
    assert words in done.stderr
    assert words in json.loads(done.stdout)["error"]["message"]


def test_infeasible_is_3(instance):
    path = instance(theta=0.01)
    for backend in ("label-setting", "highs"):
        assert (
            json.loads(run("solve", path, "--backend", backend, "--json", code=3).stdout)[
                "termination"
            ]
            == "infeasible"
        )
    text = run("diagnose", path, code=3).stdout
    assert "point 2" in text
    assert "theta 0.01" in text
    findings = json.loads(run("diagnose", path, "--json", code=3).stdout)["findings"]
    assert [f["point"] for f in findings if f["threshold"] == "theta"] == [2, 1, 0]
    assert {f["equation"] for f in findings} <= {"17", "18"}
    found = json.loads(run("diagnose", path, "--backend", "highs", "--json", code=3).stdout)
    assert found["feasible"] is False
    assert {"17", "18"} & {finding["equation"] for finding in found["findings"]}
    assert run("diagnose", instance(), code=0).stdout


def test_no_answer_is_4(instance):
    # One label a point at one weight finds nothing where the shorter way to a point is a dead end.
    done = run("solve", instance(theta=0.01), "--backend", "labelling", "--json", code=4)
    assert json.loads(done.stdout)["termination"] == "no_solution"


def hidden(*modules):
    """The start of a script for a Python that lacks `modules`."""
    return (
        f"import sys, importlib.util as u; find, gone = u.find_spec, {set(modules)!r}\n"
        "sys.modules.update(dict.fromkeys(gone))\n"
        "u.find_spec = lambda name, *a: None if name in gone else find(name, *a)\n"
        "from crosstrack.__main__ import main\n"
    )


@pytest.mark.parametrize(
    ("module", "arguments", "words"),
    [
        ("pyscipopt", ["solve", "INSTANCE", "--backend", "scip"], "'crosstrack[scip]'"),
        ("matplotlib", ["solve", "INSTANCE", "--plot", "a.png"], "'crosstrack[plot]'"),
        ("matplotlib", ["demo", "--plot", "a.png"], "'crosstrack[plot]'"),
        ("casadi", ["solve", "optimal-control/bryson-denham"], "casadi"),
        ("scipy", ["solve", "satellite-slew/paper"], "pip install crosstrack"),
    ],
)
def test_a_missing_package_is_5_with_the_install_command(
    module, arguments, words, instance, tmp_path
):
    line = [str(instance()) if word == "INSTANCE" else word for word in arguments]
    done = subprocess.run(
        [sys.executable, "-c", f"{hidden(module)}main({line!r})"],
        capture_output=True, text=True, cwd=tmp_path, timeout=60,
    )  # fmt: skip
    assert done.returncode == 5, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_demo_without_matplotlib_reports_the_missing_picture(monkeypatch, tmp_path):
    monkeypatch.setattr("crosstrack.solvers.contract.selection.fitting", lambda model: ("banded",))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = run("demo", "minimum-snap", cwd=tmp_path)
    assert "nothing is drawn" in done.stderr
    assert "pip install 'crosstrack[plot]'" in done.stderr
    assert "AGREED" in done.stdout
    assert not list(tmp_path.iterdir())


def test_check_verifies_a_plan_from_another_source(instance, tmp_path):
    path = instance()
    solved = run("solve", path, "--json").stdout
    plan = tmp_path / "plan.json"
    for text in (
        solved,
        '{"route": [0, 1, 2, 4]}',
        "[0, 1, 2, 4]",
        '{"plan": {"route": [0, 1, 2, 4]}}',
    ):
        plan.write_text(text)
        found = json.loads(run("check", path, plan, "--json").stdout)
        assert found["verification"]["ok"] is True
        assert found["verification"]["objective"] == pytest.approx(3.5)
    plan.write_text('{"route": [0, 3, 4]}')
    done = run("check", path, plan, "--json", code=6)
    assert json.loads(done.stdout)["verification"]["ok"] is False
    assert "VIOLATED" in run("check", path, plan, code=6).stdout
    plan.write_text('{"route": [0, 1, 2, 4]}')
    assert "distance" in run("check", path, plan, "--formulation", "paper").stdout
    for text in (
        '{"route": [0, 77]}',
        "{",
        '{"plan": null, "termination": "infeasible"}',
        '{"way": []}',
    ):
        plan.write_text(text)
        run("check", path, plan, code=2)
    run("check", path, tmp_path / "none.json", code=2)


def test_compare_verdicts_and_resume(instance, tmp_path):
    one, two = instance("one.json"), instance("two.json", theta=0.35)
    record = tmp_path / "out.jsonl"
    arguments = [
        "compare",
        one,
        two,
        "--backends",
        "label-setting,two-stage,highs:arc-flow",
        "--jsonl",
        record,
    ]
    data = json.loads(run(*arguments, "--json").stdout)
    assert data["verdict"] == "AGREED"
    assert len(record.read_text().splitlines()) == 6
    run(*arguments, code=2)
    before = record.read_text()
    assert "AGREED" in run(*arguments, "--resume").stdout
    assert record.read_text() == before
    run("compare", one, "--backends", "labelling", code=4)
    auto = json.loads(run("compare", one, "--backends", "auto,highs", "--json").stdout)
    names = [answer["backend"] for answer in auto["instances"][0]["solutions"]]
    assert names == ["label-setting", "highs"]
    assert run("diagnose", one, "--backend", "auto").stdout


def test_interrupted_is_130_with_the_incumbent(tmp_path):
    """A program that no solver finishes within a minute, stopped by Ctrl-C."""
    from crosstrack.files import write_text
    from crosstrack.models import MixedIntegerProgram

    generator = __import__("numpy").random.default_rng(1)
    weights = generator.integers(1, 1000, (8, 80))
    program = MixedIntegerProgram(
        cost=-weights.sum(axis=0) + 0.0, matrix=weights, row_lower=[None] * 8, row_upper=weights.sum(axis=1) // 2,
        column_lower=[0] * 80, column_upper=[1] * 80, integral=[True] * 80,
    )  # fmt: skip
    path = tmp_path / "hard.json"
    write_text(path, program.to_json())
    process = subprocess.Popen(
        [sys.executable, "-m", "crosstrack", "solve", str(path), "--backend", "highs", "--json", "--verbose"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert any("incumbent" in line for line in process.stderr)
        time.sleep(0.5)
        os.kill(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    data = json.loads(output)
    assert data["limit"] == "interrupted"
    assert data["termination"] == "feasible"
    assert data["plan"] is not None


SOME = ("label-setting", "dynamic-programming", "highs")


@pytest.mark.parametrize("names", [SOME, pytest.param(None, marks=pytest.mark.slow)])
def test_demo_takes_a_csv(names, instance, tmp_path, monkeypatch):
    """With some of the backends that fit, of either kind, or with all that are installed."""
    if names is not None:
        monkeypatch.setattr("crosstrack.solvers.contract.selection.fitting", lambda model: names)
    csv = tmp_path / "points.csv"
    words = {"A": "A", "B": "B", "horizontal": "0", "vertical": "1"}
    rows = [
        f"{k},{x},{y},{z},{words[kind]}"
        for k, ((x, y, z), kind) in enumerate(zip(DATA["points"], DATA["kinds"], strict=True))
    ]
    csv.write_text("id,x,y,z,kind\n" + "\n".join(rows) + "\n")
    done = run(
        "demo", "--points", csv, "--thresholds", ".3,.3,.3,.3,.3", "--delta", 0.1, "--plot", "demo.png",
        "--time-limit", 30, cwd=tmp_path,
    )  # fmt: skip
    assert "AGREED" in done.stdout
    assert (tmp_path / "demo.png").stat().st_size > 10_000
    csv.write_text("id,x,y,kind\n0,1,2,A\n")
    assert "z" in run("demo", "--points", csv, code=2, cwd=tmp_path).stderr


def test_demo_of_its_own_options():
    done = run("demo", "--delta", 0.1, "--plot", "none/here.png", code=2)
    assert "folder" in done.stderr
    assert "must be given together with points" in run("demo", "--delta", 0.1, code=2).stderr
    assert "no option 'delta'" in run("demo", "minimum-snap", "--delta", 0.1, code=2).stderr
    assert "unknown demonstration" in run("demo", "nothing", code=2).stderr
    text = run("demo", "--help").stdout
    assert "--points FILE" in text
    assert "[default: 20,10,15,20,20]" in " ".join(text.split())


def test_help_and_version():
    """In separate processes, as a shell runs them."""
    python = [sys.executable, "-m", "crosstrack"]

    def shown(*arguments):
        return subprocess.run(
            [*python, *arguments], capture_output=True, text=True, check=True, timeout=60
        ).stdout

    assert ct.__version__ in shown("--version")
    text = shown("--help")
    for command in cli.commands:
        assert re.search(rf"^  {command} ", text, re.M), command
        assert run(command, "--help").stdout.startswith(f"Usage: crosstrack {command}")


def test_help_loads_no_library(run_python, tmp_path):
    script = (
        "import sys, crosstrack.__main__ as m\n"
        "try:\n    m.main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'numpy', 'scipy', 'rich', 'numba'} & set(sys.modules)))"
    )
    assert run_python("-c", script, cwd=tmp_path).endswith("[]\n")


def test_a_process_of_its_own_prints_only_json(instance):
    """Both streams and the exit code as a shell sees them."""
    done = subprocess.run(
        [sys.executable, "-m", "crosstrack", "solve", str(instance()), "--json"],
        capture_output=True, text=True, timeout=240, check=True,
    )  # fmt: skip
    assert json.loads(done.stdout)["plan"] == {"route": [0, 1, 2, 4]}
    assert done.stderr == ""
