"""Instance files from untrusted sources: files they may refer to, and the content shown of those."""

import json
import os
from pathlib import Path

import pytest
from commands import run

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import storage

SECRET = "zq7:x:0:0"
LIMITS = {"alpha1": 9, "alpha2": 9, "beta1": 9, "beta2": 9, "theta": 9, "delta": 1}
POINTS = "id,x,y,z,kind\n0,0,0,0,A\n1,1,0,0,0\n2,1,1,0,1\n3,2,0,0,B\n"
MODELS = {
    "error-correction": ("points", POINTS, LIMITS),
    "minimum-snap": ("waypoints", "x,y\n0,0\n1,2\n", {"times": [0, 1]}),
}


@pytest.fixture(params=sorted(MODELS))
def instance(request, tmp_path):
    """Return a function that writes an instance file which refers to another file."""
    field, table, rest = MODELS[request.param]
    home = tmp_path / "home"
    (home / "below").mkdir(parents=True)
    (home / "below" / "table.csv").write_text(table)
    (tmp_path / "secret.csv").write_text(f"{SECRET},a,b\n{SECRET}\n")
    (tmp_path / "table.csv").write_text(table)

    def write(reference):
        path = home / "instance.json"
        content = {"model": request.param, "data": {field: reference, **rest}}
        path.write_text(json.dumps(content))
        return path

    return write


def test_a_file_below_the_folder_or_below_the_one_named_is_read(instance, tmp_path):
    want = ct.load(instance("below/table.csv")).digest
    (tmp_path / "home" / "link.csv").symlink_to("below/table.csv")
    assert ct.load(instance("link.csv")).digest == want
    assert ct.load(instance("below/../below/table.csv")).digest == want
    outside = instance("../table.csv")
    with pytest.raises(InvalidData, match=r"must lie below the instance's folder.*folder="):
        ct.load(outside)
    assert ct.load(outside, folder=tmp_path).digest == want
    assert ct.load(instance("below/table.csv"), folder=tmp_path / "home").digest == want


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("../secret.csv", "must lie below the instance's folder"),
        ("below/../../secret.csv", "must lie below the instance's folder"),
        ("out.csv", "must lie below the instance's folder"),
        ("up/secret.csv", "must lie below the instance's folder"),
        ("../no-such-file", "must lie below the instance's folder"),
        ("/dev/zero", "must be named relative"),
        ("/etc/passwd", "must be named relative"),
        ("zero", "must lie below the instance's folder"),
        ("pipe", "must be a regular file"),
        ("below", "must be a regular file"),
        ("", "must be a regular file"),
        ("round", "cannot be read|no such file"),
        ("a\0b", "must be named relative"),
        ("x" * 300, "cannot be read: File name too long|no such file"),
        ("large.csv", "is too large: 1000000 bytes may be read in all"),
    ],
)
def test_other_files_are_refused_without_naming_their_content(
    instance, reference, message, tmp_path, monkeypatch
):
    home = tmp_path / "home"
    monkeypatch.setattr(storage, "LARGEST_FILE", 1_000_000)
    (home / "out.csv").symlink_to("../secret.csv")
    (home / "up").symlink_to("..")
    (home / "zero").symlink_to("/dev/zero")
    (home / "round").symlink_to("round")
    os.mkfifo(home / "pipe")
    with (home / "large.csv").open("wb") as stream:
        stream.truncate(1_000_001)
    path = instance(reference)
    for trusted in (False, True):
        with pytest.raises(InvalidData, match=message) as caught:
            ct.load(path, trusted=trusted)
        assert SECRET not in str(caught.value)
        assert str(caught.value).startswith(str(path))


def test_the_content_of_other_files_is_shown_with_consent_only(instance, tmp_path):
    for name, content in {
        "first.csv": f"{SECRET},y\n1,2\n",
        "later.csv": MODELS["minimum-snap"][1] + f"{SECRET},7\n",
        "binary.csv": b"id,x\xff\xfe" + SECRET.encode(),
        "column.csv": "id,x,y,z,kind\n0,0,0,0,A\n1,qqq,0,0,zq7\n",
    }.items():
        raw = content if isinstance(content, bytes) else content.encode()
        (tmp_path / "home" / name).write_bytes(raw)
        path = instance(name)
        with pytest.raises(InvalidData, match=rf"{name}(, line \d)?: not in the form") as caught:
            ct.load(path)
        for word in ("zq7", "qqq", "0xff"):
            assert word not in str(caught.value)
        with pytest.raises(InvalidData) as told:
            ct.load(path, trusted=True)
        assert "not in the form" not in str(told.value)


def test_two_references_share_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "LARGEST_FILE", 1500)
    monkeypatch.setattr(storage, "_REGISTERED", {})
    storage.register_references(
        "error-correction", lambda data, find: [find(name) for name in data["names"]]
    )
    for name in ("a", "b"):
        (tmp_path / name).write_text("x" * 1000)
    path = tmp_path / "i.json"
    path.write_text(json.dumps({"model": "error-correction", "data": {"names": ["a", "b"]}}))
    with pytest.raises(InvalidData, match="the file 'b' that the instance refers to is too large"):
        ct.load(path)


@pytest.mark.timeout(20)
def test_the_instance_file_itself_may_be_a_pipe_but_not_endless(instance, tmp_path, monkeypatch):
    read, write = os.pipe()
    os.write(write, instance("below/table.csv").read_bytes())
    os.close(write)
    pipe = tmp_path / "home" / "pipe"
    pipe.symlink_to(f"/dev/fd/{read}")
    assert len(ct.load(pipe).digest) == 64
    os.close(read)
    monkeypatch.setattr("crosstrack.files.LARGEST_FILE", 1_000_000)
    with pytest.raises(InvalidData, match="/dev/zero: holds more than 1000000 bytes"):
        ct.load("/dev/zero")


def test_the_command_line_takes_both_consents(tmp_path):
    field, table, rest = MODELS["error-correction"]
    (tmp_path / "home").mkdir()
    (tmp_path / "table.csv").write_text(table)
    (tmp_path / "plan.json").write_text("[0, 1, 2, 3]")
    path = tmp_path / "home" / "instance.json"
    path.write_text(
        json.dumps({"model": "error-correction", "data": {field: "../table.csv", **rest}})
    )
    assert "--folder" in run("check", path, tmp_path / "plan.json", code=2).stderr
    run("check", path, tmp_path / "plan.json", "--folder", tmp_path)
    stored = Path(__file__).parent / "data" / "version-0.1"
    old = ("check", stored / "control.model.json", stored / "control.plan.json")
    assert "--trusted" in run(*old, code=2).stderr
    run(*old, "--trusted")
    for command in ("solve", "check", "compare", "export", "diagnose"):
        words = run(command, "--help").stdout
        assert "--trusted" in words and "--folder" in words
