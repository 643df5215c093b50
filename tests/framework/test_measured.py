"""What scripts measured for the pages: read by one, of instances that exist, made by a script that exists."""

import json
import re
from pathlib import Path

import pytest

from crosstrack.instances import entries

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "docs" / "measured").glob("*.json"))
PAGES = "\n".join(page.read_text("utf-8") for page in (ROOT / "docs").glob("**/*.md"))
SHOWN = set(re.findall(r"^(?:```\{crosstrack-measured\}|:measured:) +(\S+)", PAGES, re.M))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_measured_values_are_shown_and_exist(file):
    names = {entry.name for entry in entries()}
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
        if "instance" in found["columns"]:
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
