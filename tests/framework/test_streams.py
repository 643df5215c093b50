"""Where output goes: files before words, and streams that are full, closed or of few letters."""

import io
import json
import os
import resource
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from commands import run

from crosstrack.errors import InvalidData
from crosstrack.files import writable, write_text
from crosstrack.solvers.report.terminal import emit

INSTANCE = "error-correction/example-1"
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


def shell(line, cwd, **environment):
    """Run a shell command with $X as the command line; the loops are not compiled."""
    given = {"X": f"{sys.executable} -m crosstrack", "NUMBA_DISABLE_JIT": "1", **environment}
    return subprocess.run(
        ["bash", "-c", line], cwd=cwd, env={**os.environ, **given},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def answered(path):
    return json.loads(path.read_text("utf-8"))["termination"] == "optimal"


@needs_full
def test_a_full_disk_is_one_line_and_loses_no_answer(tmp_path):
    done = shell(f"$X solve {INSTANCE} --output a.json --plot a.svg > /dev/full", tmp_path)
    assert done.returncode == 2
    said = done.stderr.splitlines()
    assert said == [
        "picture: a.svg",
        "error: standard output cannot be written: No space left on device",
    ]
    assert answered(tmp_path / "a.json")
    assert "</svg>" in (tmp_path / "a.svg").read_text("utf-8")
    # Output of click, and an error message that cannot be written, have the same exit codes.
    done = shell("$X --help > /dev/full; echo $?; $X solve nothing 2> /dev/full; echo $?", tmp_path)
    assert done.stdout.split() == ["2", "2"]
    assert len(done.stderr.splitlines()) == 1


def test_a_closed_stream_is_one_line_and_loses_no_answer(tmp_path):
    done = shell(f"$X solve {INSTANCE} --output a.json >&-", tmp_path)
    assert done.returncode == 2
    assert done.stderr == "error: standard output cannot be written: Bad file descriptor\n"
    assert answered(tmp_path / "a.json")
    done = shell(f"$X solve {INSTANCE} --output b.json <&- >&- 2>&-", tmp_path)
    assert done.returncode == 2
    assert answered(tmp_path / "b.json")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.json", "b.json"]


def test_a_closed_pipe_loses_no_answer(tmp_path):
    done = shell(f"$X solve {INSTANCE} --output a.json | true; echo ${{PIPESTATUS[0]}}", tmp_path)
    assert done.stdout == "2\n"
    assert done.stderr == "error: standard output cannot be written: Broken pipe\n"
    assert answered(tmp_path / "a.json")


def test_an_encoding_of_few_letters_is_no_error(tmp_path):
    ascii_only = {"PYTHONIOENCODING": "ascii"}
    done = shell("$X models && $X instances --json > i.json", tmp_path, **ascii_only)
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
    raw = (tmp_path / "i.json").read_bytes()
    assert raw.isascii()
    assert any("²" in entry["title"] for entry in json.loads(raw)), "JSON escapes and loses nothing"


def test_json_escapes_characters_that_its_stream_lacks(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", stream)
    emit({"name": "\udcff"})
    emit({"name": "四"})
    assert (
        stream.buffer.getvalue() == b'{\n  "name": "\\udcff"\n}\n{\n  "name": "\xe5\x9b\x9b"\n}\n'
    )


@needs_full
@pytest.mark.parametrize(
    "arguments",
    [
        ("solve", INSTANCE, "--output", FULL),
        ("compare", INSTANCE, "--backends", "label-setting", "--jsonl", FULL),
        ("solve", INSTANCE, "--plot", "device.png"),
        ("export", "minimum-snap/helix", "plan.json", "--output", "device.csv"),
    ],
)
def test_only_regular_files_are_written(arguments, tmp_path):
    for name in ("device.png", "device.csv"):
        (tmp_path / name).symlink_to(FULL)
    done = run(*arguments, code=2, cwd=tmp_path)
    assert "regular file" in done.stderr
    assert done.stdout == ""
    assert stat.S_ISCHR(FULL.stat().st_mode)
    with pytest.raises(InvalidData, match="no regular file"):
        write_text(FULL, "text")


def test_an_existing_file_keeps_its_mode_and_a_new_one_follows_the_umask(tmp_path):
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.touch()
    old.chmod(0o640)
    before = os.umask(0o027)
    try:
        for file in (old, new):
            run("solve", INSTANCE, "--output", file)
    finally:
        os.umask(before)
    assert [stat.S_IMODE(file.stat().st_mode) for file in (old, new)] == [0o640, 0o640]
    old.chmod(0o600)
    write_text(old, "again")
    assert stat.S_IMODE(old.stat().st_mode) == 0o600


def test_a_read_only_folder_is_detected_before_the_work(tmp_path, monkeypatch):
    file = tmp_path / "a.json"
    file.touch()
    monkeypatch.setattr(os, "access", lambda path, how: path != tmp_path)
    with pytest.raises(InvalidData, match="cannot be written"):
        writable(file)


def test_a_disk_that_fills_leaves_nothing_half_written(tmp_path):
    """With a limit on the size of files, which fails as a full disk does."""
    kept, record = tmp_path / "kept.json", tmp_path / "record.jsonl"
    kept.write_text("kept")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, old[1]))
    try:
        done = run("solve", INSTANCE, "--output", kept, code=2)
        assert "kept.json: cannot be written: File too large" in done.stderr
        arguments = ("compare", INSTANCE, "--backends", "label-setting", "--jsonl", record)
        assert "record.jsonl cannot be written" in run(*arguments, code=2).stderr
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert kept.read_text() == "kept"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["kept.json", "record.jsonl"]


def test_a_hyphen_is_standard_output(tmp_path):
    done = run("solve", INSTANCE, "--output", "-", cwd=tmp_path)
    assert json.loads(done.stdout)["termination"] == "optimal"
    helix = "minimum-snap/helix"
    run("solve", helix, "--backend", "banded", "--output", "plan.json", cwd=tmp_path)
    export = ("export", helix, "plan.json", "--output")
    done = run(*export, "-", cwd=tmp_path)
    assert done.stdout.startswith("duration,x^0")
    assert "-: 24 pieces" in done.stderr
    run(*export, "plan.csv", cwd=tmp_path)
    assert (tmp_path / "plan.csv").read_text("utf-8") == done.stdout
    assert "standard output" in run(*export, "-", "--json", code=2, cwd=tmp_path).stderr
    assert "takes a file" in run("compare", INSTANCE, "--jsonl", "-", code=2, cwd=tmp_path).stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["plan.csv", "plan.json"]


def test_a_plan_that_fails_is_exported_as_json_only(tmp_path):
    """Nor is anything written."""
    helix = "minimum-snap/helix"
    solved = run("solve", helix, "--backend", "banded", "--json").stdout
    plan = json.loads(solved)["plan"]
    plan["coefficients"][0][0][0] += 1.0
    (tmp_path / "poor.json").write_text(json.dumps(plan))
    export = ("export", helix, "poor.json", "--output")
    done = run(*export, "poor.csv", "--json", code=6, cwd=tmp_path)
    assert json.loads(done.stdout)["verification"]["ok"] is False
    done = run(*export, "-", code=6, cwd=tmp_path)
    assert done.stdout == ""
    assert "NOT verified" in done.stderr
    assert not (tmp_path / "poor.csv").exists()
