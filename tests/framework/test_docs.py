"""The code in the documentation runs, and its links lead to existing targets."""

import re
import runpy
from pathlib import Path

import click
import pytest
from scripts import Scripts

from crosstrack.__main__ import cli
from crosstrack.models.problems import PROBLEMS

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    + [
        p
        for p in (ROOT / "docs").rglob("*.md")
        if not {"_build", "gallery", "generated"} & set(p.parts)
    ]
)
#: How a block begins that is run, and shown with what it prints, when the site is built.
EXAMPLE = "```{crosstrack-example}"
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
#: Examples and pages that run for two seconds and more; `make docs` runs all examples for the gallery.
SLOW = {
    *(
        "plot_attractor.py",
        "plot_bases_and_backends.py",
        "plot_black_box.py",
        "plot_clearance.py",
        "plot_gain_tuning.py",
        "plot_gripper.py",
        "plot_corridors.py",
        "plot_error_correction.py",
        "plot_flight.py",
        "plot_gates.py",
        "plot_general_case.py",
        "plot_guided_path.py",
        "plot_map_to_flight.py",
        "plot_messenger.py",
        "plot_minimum_snap.py",
        "plot_scenarios.py",
        "plot_unknown_grid.py",
    ),
    *("plot_fleet_mission.py", "plot_own_control_problem.py", "plot_satellite_slew.py"),
    *("plot_own_program.py", "plot_sequential_ordering.py", "plot_sideslip.py"),
    "plot_times_by_black_box.py",
    *(
        "algorithm.md",
        "answers.md",
        "attractor.md",
        "black-box.md",
        "campaign.md",
        "fleet.md",
        "fleet-mission.md",
        "flight.md",
        "grid-path.md",
        "guided-path.md",
        "minimum-snap.md",
        "own-program.md",
        "sequential-ordering.md",
        "unknown-grid.md",
    ),
    *("cluster.md", "messenger.md", "optimal-control.md", "satellite-slew.md", "sideslip.md"),
    *("corridors.md", "export.md", "instance.md", "limits.md"),
    *(
        "model-predictive.md",
        "program-backend.md",
        "program-files.md",
        "pyomo-pulp.md",
        "verdict.md",
    ),
}


@pytest.fixture(scope="module")
def scripts():
    with Scripts() as started:
        yield started


def test_readme_lists_every_problem():
    """The table follows from the docstrings of the problems."""
    written = runpy.run_path(str(ROOT / "docs" / "_ext" / "crosstrack_readme.py"))["written"]
    text = (ROOT / "README.md").read_text("utf-8")
    assert written(text) == text, "run 'make readme'"
    assert len(re.findall(r"^\| \[[a-z-]+\]\(docs/problems/", text, re.M)) == len(PROBLEMS)


def named(page):
    """The name of a page in the list of tests."""
    return str(page.relative_to(ROOT))


def commands():
    """The command line's subcommands with their options."""
    return {
        name: {
            option
            for parameter in command.get_params(click.Context(command))
            for option in (*parameter.opts, *parameter.secondary_opts)
        }
        for name, command in cli.commands.items()
    }


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=named(page), marks=[pytest.mark.slow] if page.name in SLOW else [])
        for page in PAGES
        if "\n```python\n" in page.read_text("utf-8")
    ],
)
def test_python_on_a_page_runs(page, page_code, scripts, tmp_path):
    (tmp_path / "page.py").write_text(page_code(page), "utf-8")
    scripts.run(tmp_path / "page.py", tmp_path, strict=True)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if EXAMPLE in page.read_text("utf-8")], ids=named
)
def test_code_that_runs_when_a_page_is_built_runs(page, scripts, tmp_path):
    blocks = re.findall(rf"^{EXAMPLE}\n(.*?)^```", page.read_text("utf-8"), re.S | re.M)
    (tmp_path / "page.py").write_text("\n".join(blocks), "utf-8")
    printed = scripts.run(tmp_path / "page.py", tmp_path)
    assert printed.strip() and ("AGREED" in printed or page.name != "index.md")


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, id=named(path), marks=[pytest.mark.slow] if path.name in SLOW else [])
        for path in EXAMPLES
    ],
)
def test_examples_run(example, scripts, tmp_path):
    printed = scripts.run(example, tmp_path)
    # Local searches agree without proving it.
    assert "AGREED" in printed or "INCONCLUSIVE" in printed
    assert "CONTRADICTION" not in printed


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_between_files_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.S | re.M)
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not re.match(r"[a-z]+:", target):
            # The gallery is made from the examples when the site is built.
            made = re.sub(r"gallery/(.+)\.(?:md|rst)$", r"examples/\1.py", target)
            assert (page.parent / made).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_on_a_page_exist(page):
    known = commands()
    blocks = "\n".join(re.findall(r"^```console\n(.*?)^```", page.read_text("utf-8"), re.S | re.M))
    for line in re.findall(r"^\$ crosstrack ([^|>\n]+)", blocks, re.M):
        name, *rest = line.split()
        if name.startswith("-"):
            continue
        assert name in known, f"no command {name!r}"
        for word in rest:
            if word.startswith("--"):
                assert word.partition("=")[0] in {*known[name], "--help"}, (
                    f"{name} has no option {word}"
                )


def test_readme_lists_every_command():
    text = (ROOT / "README.md").read_text("utf-8")
    listed = re.findall(r"^\| `crosstrack ([a-z]+)", text, re.M)
    assert sorted(listed) == sorted(commands())


def test_pages_name_targets_that_make_has():
    makefile = (ROOT / "Makefile").read_text("utf-8")
    pages = ("README.md", "CONTRIBUTING.md", "docs/install.md")
    text = "".join((ROOT / name).read_text("utf-8") for name in pages)
    for target in set(re.findall(r"(?:`|\$ )make ([a-z]+)", text)):
        assert re.search(rf"^{target}:", makefile, re.M), f"no target {target!r}"
    ci = (ROOT / ".ci" / "run").read_text("utf-8")
    assert re.search(r"^make test$", ci, re.M)
