"""What scripts measured for the pages: read by one, of instances that exist, made by a script that exists."""

import itertools
import json
import math
import re
from pathlib import Path

import pytest

from crosstrack.instances import entries
from crosstrack.instances.paper import papers

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "docs" / "measured").glob("*.json"))
PAGES = "\n".join(page.read_text("utf-8") for page in (ROOT / "docs").glob("**/*.md"))
SHOWN = set(re.findall(r"^(?:```\{crosstrack-measured\}|:measured:) +(\S+)", PAGES, re.M))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_measured_values_are_shown_and_exist(file):
    names = {entry.name for entry in entries()}
    paper = papers().get(file.stem)
    labelled = {one.name for one in paper.tables} if paper else set()
    for table, found in json.loads(file.read_text("utf-8")).items():
        assert f"{file.stem}/{table}" in SHOWN, f"no page shows {file.stem}/{table}"
        assert (ROOT / found["script"]).is_file()
        assert set(found) == {
            *("script", "date", "versions", "processors", "said", "columns", "rows")
        }
        assert found["rows"]
        for row in found["rows"]:
            assert len(row) == len(found["columns"])
            for value, form in zip(row, found["columns"].values(), strict=True):
                assert value is None or isinstance(value, str) or format(value, form)
        # Result tables of a paper have its labels; test_papers.py compares their rows.
        if "instance" in found["columns"] and table not in labelled:
            at = list(found["columns"]).index("instance")
            assert {row[at] for row in found["rows"]} <= names


def test_pages_show_what_was_measured():
    there = {
        f"{file.stem}/{table}" for file in FILES for table in json.loads(file.read_text("utf-8"))
    }
    assert there >= SHOWN
    columns = re.findall(r"^:measured: +(\S+)/(\S+) (.+)$", PAGES, re.M)
    for problem, table, column in columns:
        found = json.loads((ROOT / "docs" / "measured" / f"{problem}.json").read_text("utf-8"))
        assert {"instance", "seconds", column} <= set(found[table]["columns"])


def peers(table):
    """Return the rows of a table of ``docs/how-well.md`` in groups of what each is about, ours first."""
    found = json.loads((ROOT / "docs" / "measured" / "peers.json").read_text("utf-8"))[table]
    rows = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
    heads = list(found["columns"])[: list(found["columns"]).index("package")]
    groups = itertools.groupby(rows, lambda row: [row[head] for head in heads])
    return [list(group) for _, group in groups]


@pytest.mark.parametrize(
    "table",
    ["error-correction", "resource-routing", "grid-path", "minimum-snap", "fleet", "attractor"],
)
def test_every_peer_is_shown_with_our_value(table):
    for ours, *others in peers(table):
        assert ours["package"].startswith("crosstrack, `")
        assert "rejected" not in ours["our check"]
        assert others
        for row in others:
            if row.get("times ours") is not None:
                assert row["times ours"] == pytest.approx(row["seconds"] / ours["seconds"])


def test_statements_about_peers_are_measured():
    """The sentences of ``docs/how-well.md`` below its tables."""
    for ours, cspy in [*peers("error-correction"), *peers("resource-routing")]:
        assert cspy["our check"] == "accepted"
        assert cspy["objective"] == pytest.approx(ours["objective"], rel=1e-9)
        assert cspy["times ours"] > 1
    for ours, *others in peers("minimum-snap"):
        for row in others:
            assert row["our check"] == "accepted"
            assert row["objective"] == pytest.approx(ours["objective"], rel=1e-9)
            assert (row["times ours"] < 1) == row["package"].startswith("SciPy")
    for number, (ours, bare, *others) in enumerate(peers("grid-path")):
        times = {row["package"]: row["times ours"] for row in others}
        right = {row["package"] for row in others if row["our check"] == ours["our check"]}
        assert right == {"networkx", "python-pathfinding"}
        compiled = times.pop("pyastar2d")
        assert compiled < 1
        assert bare["times ours"] < min(times.values())
        assert max(times.values()) < 1 if number < 2 else min(times.values()) > 1
        assert (bare["times ours"] < compiled) == (number >= 2)
    for _, pyvrp, ortools in peers("fleet"):
        above = pyvrp["median above ours"]
        assert above is None if "longest" in pyvrp["problem"] else -0.01 < above < 0
        assert ortools["median above ours"] > 0
    for ours, nolds in peers("attractor"):
        assert nolds["times ours"] > 1
        if ours["figure"] == "exponent":
            assert math.isclose(nolds["value"], ours["value"], rel_tol=1e-9)
        else:
            assert nolds["value"] < ours["value"] < ours["known"]
