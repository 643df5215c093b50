"""The declarations of the papers: complete, with a status each, backed by code, shown on the pages, measured."""

import json
import pkgutil
import re
from pathlib import Path

import pytest

from crosstrack.errors import InvalidData
from crosstrack.instances.paper import Item, Paper, Status, corrected, measurement, papers, printed
from crosstrack.models.problems import declared_in

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: The texts of the papers, which are not part of the project.
TEXTS = ROOT.parent / "shared" / "papers"
PAPERS = papers()
TABLES = [(problem, table) for problem, paper in PAPERS.items() for table in paper.tables]


def test_every_paper_is_declared():
    declared = [key for _, key, _ in declared_in("crosstrack.instances", "PAPERS")]
    assert sorted(PAPERS) == sorted(declared) and PAPERS
    if TEXTS.is_dir():
        assert {path.stem for path in TEXTS.glob("*.txt")} == {one.name for one in PAPERS.values()}


@pytest.mark.parametrize("problem", PAPERS)
def test_items_name_code_that_exists_and_are_shown(problem):
    for item in PAPERS[problem].items:
        value = pkgutil.resolve_name(item.target)
        assert callable(value) or isinstance(value, property) or hasattr(value, "func"), item.target
    page = (DOCS / "problems" / f"{problem}.md").read_text("utf-8")
    assert re.search(rf"^```{{crosstrack-as-printed}} {problem}$", page, re.M)


def numbers(label, kind):
    """Return the numbers that a label names, ``"eq. 7-9, 12"`` as 7, 8, 9 and 12."""
    numbers = set()
    for part in re.findall(
        rf"\b{kind} (\d+(?:\([a-z]\))?(?:-\d+)?(?:(?:,| and) \d+(?:-\d+)?)*)", label
    ):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", part):
            numbers.update(range(int(first), int(last or first) + 1))
    return numbers


@pytest.mark.parametrize("name", sorted({paper.name for paper in PAPERS.values()}))
def test_equations_and_algorithms_are_listed_without_a_gap(name):
    labels = [item.label for paper in PAPERS.values() if paper.name == name for item in paper.items]
    # Some papers number algorithms, theorems and examples in one sequence.
    for kind in (r"eq\.", "(?:Algorithm|Theorem|Example)"):
        listed = set().union(*(numbers(label, kind) for label in labels))
        assert listed == set(range(1, max(listed, default=0) + 1)), (name, kind)


@pytest.mark.parametrize(("problem", "table"), TABLES, ids=lambda one: getattr(one, "name", one))
def test_every_printed_cell_has_a_value_of_ours(problem, table):
    assert callable(measurement(problem, table.name))
    stored = json.loads((DOCS / "measured" / f"{problem}.json").read_text("utf-8"))[table.name]
    assert stored["columns"] == table.heads
    rows = {tuple(row[: len(table.keys)]): row for row in stored["rows"]}
    assert list(rows) == list(table.rows)
    places = list(table.heads)
    for key, cells in table.rows.items():
        for name, cell in zip(table.columns, cells, strict=True):
            assert rows[key][places.index(f"{name}, paper")] == cell
            assert cell is None or rows[key][places.index(name)] is not None, (
                table.name,
                key,
                name,
            )
    page = (DOCS / "problems" / f"{problem}.md").read_text("utf-8")
    assert f"```{{crosstrack-measured}} {problem}/{table.name}\n" in page


def test_rejects_items_without_a_reason_and_labels_that_occur_twice():
    with pytest.raises(InvalidData, match="needs a reason"):
        corrected("eq. 1", "a sum", "models.model:Model", " ")
    with pytest.raises(InvalidData, match="module:object"):
        printed("eq. 1", "a sum", "models.model")
    with pytest.raises(InvalidData, match="must not be empty"):
        Item("", "a sum", "models.model:Model", Status.AS_PRINTED)
    item = printed("eq. 1", "a sum", "models.model:Model")
    with pytest.raises(InvalidData, match="2 times"):
        Paper("a", "A. Author", (item, item))
