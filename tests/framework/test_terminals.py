"""Terminals of 40, 80 and 120 columns: no number and no word of what commands print is cut."""

import contextlib
import io
import json
import re
from pathlib import Path

import pytest
from commands import run

import crosstrack as ct
from crosstrack.__main__ import cli
from crosstrack.solvers.contract.solution import Solution
from crosstrack.solvers.report import terminal

SMALL = "error-correction/example-1"
COMMANDS = {
    "models": ["models"],
    "backends": ["backends"],
    "instances": ["instances"],
    "solve": ["solve", SMALL],
    "check": ["check", SMALL, "plan.json", "--formulation", "paper"],
    "compare": ["compare", SMALL, "--backends", "label-setting,highs:paper,labelling"],
    "compare in vain": ["compare", SMALL, "--backends", "label-setting,slsqp"],
    "demo": ["demo", "--plot", "demo.svg"],
    "reproduce": ["reproduce", "error-correction", "--rows", "1", "--time-limit", "10"],
    "diagnose": ["diagnose", "minimum-snap/corridor-infeasible"],
    "control": ["solve", "optimal-control/double-integrator-energy"],
    "trajectory": ["solve", "minimum-snap/paper"],
}


#: Commands that take seconds.
SLOW = {"compare in vain", "demo", "reproduce"}


class Terminal(io.StringIO):
    """Standard output that is a terminal."""

    def isatty(self):
        return True


def shown(parts, width, monkeypatch):
    """Return the text of `parts` on a terminal with `width` columns, without colours."""
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TERM", "xterm")
    with contextlib.redirect_stdout(Terminal()) as screen:
        terminal.show(*parts)
    return re.sub(r"\x1b\[[0-9;]*m", "", screen.getvalue())


def pieces(text):
    """All words, and all numbers with what they are made of."""
    pattern = r"[^\W\d_]{2,}|(?:(?<![0-9])[+-])?[0-9]+(?:\.[0-9]+)?(?:e[+-]?[0-9]+)?"
    return set(re.findall(pattern, text))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in COMMANDS]
)
def test_nothing_is_cut(name, monkeypatch, tmp_path):
    printed = []
    monkeypatch.setattr(terminal, "show", lambda *parts: printed.extend(parts))
    if name == "demo":
        monkeypatch.setattr(
            "crosstrack.solvers.contract.selection.fitting", lambda _: ("label-setting",)
        )
    (tmp_path / "plan.json").write_text(json.dumps([0, 1, 2, 4]))
    run(*COMMANDS[name], code=None, cwd=tmp_path)
    assert printed
    monkeypatch.undo()
    whole = pieces(shown(printed, 2000, monkeypatch))
    for width in (40, 80, 120):
        text = shown(printed, width, monkeypatch)
        # A digest, which is one word, is all that may be wider.
        lines = [line.strip() for line in text.splitlines()]
        too_wide = [line for line in lines if len(line) > width and " " in line]
        assert not too_wide, too_wide
        assert pieces(text) <= whole, (width, pieces(text) - whole)
        assert len(pieces(text)) > 5


@pytest.mark.parametrize("command", [None, *cli.commands])
def test_help_fits(command, monkeypatch):
    asked = ["--help"] if command is None else [command, "--help"]
    monkeypatch.setenv("COLUMNS", "200")
    whole = pieces(run(*asked).stdout)
    for width in (40, 80, 120):
        monkeypatch.setenv("COLUMNS", str(width))
        text = run(*asked).stdout
        assert max(map(len, text.splitlines())) <= width
        assert pieces(text) == whole


def test_long_lines_end_between_words_and_numbers():
    route = "plan: " + "-".join(map(str, range(100, 130)))
    lines = terminal.fold(route, 40).splitlines()
    assert max(map(len, lines)) <= 40
    assert "".join(lines).replace("plan:", "plan: ") in (route, route.replace("plan: ", "plan:  "))
    assert terminal.fold("a gap of 1e-05\n  kept", 11) == "a gap of\n1e-05\n  kept"
    path = "x" * 50
    assert terminal.fold(f"see {path}", 40) == f"see\n{path}", (
        "what has no place to end stays whole"
    )
    assert Path(path).name == path


def test_external_text_cannot_control_a_terminal(tmp_path, capsys):
    """Names and messages of a record and of a model reach the screen without their escapes."""
    evil = "x\x1b]0;owned\x07\x1b[2J\x9b31m\r"
    model = ct.load(SMALL)
    solution = ct.solve(model)
    row = {**solution.to_dict(), "instance": evil, "backend": evil, "message": evil, "key": "k"}
    record = tmp_path / "r.jsonl"
    record.write_text(json.dumps(row) + "\n")
    for arguments in (
        ["report", str(record), "--output", str(tmp_path / "r.html")],
        ["solve", evil],
    ):
        result = run(*arguments, code=None)
        said = result.stdout + result.stderr
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", said), said
        assert "owned" in said
    answer = Solution.from_dict(row)
    terminal.show(*answer.parts())
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", capsys.readouterr().out)
