"""The site of crosstrack: formulas, the catalogue and its filter, the reference."""

import doctest
import inspect
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from crosstrack.instances import entries
from crosstrack.models.problems import PROBLEMS
from crosstrack.solvers.bench import read_records

nodes = pytest.importorskip("docutils.nodes", reason="the extra docs is not installed")
pytest.importorskip("sphinx", reason="the extra docs is not installed")

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.insert(0, str(DOCS / "_ext"))

import crosstrack_api  # noqa: E402
import crosstrack_entries  # noqa: E402
import crosstrack_install  # noqa: E402
import crosstrack_pages  # noqa: E402
import crosstrack_pictures  # noqa: E402
import crosstrack_site  # noqa: E402


def formula(latex, block=True):
    """The markup of a formula."""
    translator = SimpleNamespace(body=[])
    kind = nodes.math_block if block else nodes.math
    with pytest.raises(nodes.SkipNode):
        crosstrack_site._formula(translator, kind(latex, latex))
    return re.sub(r">\s+<", "><", "".join(translator.body))


def test_a_fraction_is_stacked_and_an_inline_formula_stays_in_its_line():
    assert "<mfrac><mi>a</mi><mi>b</mi></mfrac>" in formula(r"\frac{a}{b}")
    assert 'display="block"' not in formula("x", block=False)


@pytest.mark.parametrize("latex", [r"\dot q_0", r"\hat{L}_k", r"\dot\omega_r", r"\bar d^2"])
def test_an_index_beside_an_accent_is_not_below_it(latex):
    made = formula(latex)
    assert "<munder" not in made
    assert re.search("<msu[bp]>", made)


def test_spaces_stand_after_functions_and_not_within_bars():
    assert 'rspace="0.1667em">&ApplyFunction;' in formula(r"\ln r")
    assert "rspace" not in formula(r"\exp(r)")
    assert '<mo lspace="0" rspace="0" stretchy="false">|</mo>' in formula("|x|")


def test_a_formula_that_cannot_be_read_is_a_warning(caplog):
    assert r"\nosuch&lt;" in formula(r"\nosuch<")
    assert "nosuch" in caplog.text


def test_the_helpers_of_the_catalogue_work():
    assert not doctest.testmod(crosstrack_pages).failed


def test_every_published_figure_is_shown_or_left_out_on_purpose():
    shown = {"objective", "source", "formula", "table", "row", *crosstrack_pages.FIGURES}
    left_out = {
        *("analytic", "chains", "example", "q", "route", "evaluations", "tolerance"),
        *("seconds", "computing_seconds", "two_stage_seconds", "solver"),
    }
    assert {key for entry in entries() for key in entry.published} <= shown | left_out


def test_best_values_are_those_of_the_instance_and_not_of_the_papers_data():
    verdicts = {one.instance: one for one in read_records(DOCS / "campaign/records.jsonl").verdicts}
    found = {entry.name: entry for entry in entries()}

    def best(name):
        return crosstrack_pages.best_known(found[name], verdicts[name])

    paper = found["error-correction/1"].published["optimum"]
    value, source = best("error-correction/1")
    assert float(value) != paper
    assert source.endswith("proven")
    assert f"on other data {paper:g}" in crosstrack_pages.figures_of(found["error-correction/1"])
    assert best("error-correction/example-1") == ("4.5", "stated")
    assert best("resource-routing/errand")[1] == "two straight lines"
    assert best("grid-path/unreachable") == ("infeasible", "campaign, proven")
    assert best("attractor/ar1") == ("", "")
    assert crosstrack_pages.figures_of(found["attractor/ar1"]) == "by its making"
    assert "final time (s) 7.836" in crosstrack_pages.figures_of(found["satellite-slew/paper"])


def asked():
    """Modules, names and objects that the reference documents, and whether they have a page."""
    pages = [path.read_text("utf-8") for path in sorted((DOCS / "api").glob("*.md"))]
    return list(crosstrack_api._listed(pages + [crosstrack_api.problem_page(p) for p in PROBLEMS]))


def test_every_extra_lists_its_packages():
    page = SimpleNamespace(env=SimpleNamespace(app=SimpleNamespace(srcdir=DOCS)))
    rows = [line.split("|") for line in crosstrack_install.Extras.make(page).splitlines()[2:]]
    declared = tomllib.loads((DOCS.parent / "pyproject.toml").read_text("utf-8"))["project"]
    extras = declared["optional-dependencies"].keys() - crosstrack_install.OWN
    assert {row[1].strip(" `") for row in rows} == extras
    for _, _, packages, brings, _ in rows:
        assert packages.strip()
        assert brings.strip() or "the extras" in packages


def test_a_class_has_one_page():
    classes = [value for _, _, value, _ in asked() if inspect.isclass(value)]
    assert len(classes) == len(set(classes)) > 100


def test_roles_on_pages_name_classes_that_the_reference_documents():
    known = {value for _, _, value, _ in asked() if inspect.isclass(value)}
    for page in [*DOCS.glob("*.md"), *DOCS.glob("*/*.md")]:
        text = page.read_text("utf-8")
        for target in re.findall(r"\{class\}`(?:[^`<]*<)?~?(crosstrack[\w.]+)>?`", text):
            assert pkgutil.resolve_name(target) in known, f"{page.name}: {target}"


#: A role in a docstring, with its target.
ROLE = re.compile(
    r":(?:py:)?(?:class|func|meth|attr|data|mod|exc|obj):`(?:[^`<]*<)?[~!]?([^`>]+)>?`"
)


def members_of(value):
    """Public members that a class declares, with their docstrings."""
    for name in dir(value):
        member = inspect.getattr_static(value, name)
        if not name.startswith("_") and getattr(member, "__doc__", None):
            yield name, member


def broken_roles(objects, named):
    """Roles in the docstrings of documented objects that resolve to no documented object."""
    paths = {f"{module}.{name}": value for module, name, value in objects}
    known = crosstrack_api.homes(paths)
    everything = {*paths, *(module for module, _, _ in objects)}
    for path, value in paths.items():
        if inspect.isclass(value):
            everything |= {f"{path}.{name}" for name, _ in members_of(value)}
    for module, name, value in objects:
        texts = {"": value}
        if inspect.isclass(value):
            texts |= {
                member: text
                for member, text in members_of(value)
                if getattr(text, "__module__", value.__module__).startswith("crosstrack.")
            }
        scope = (module, name if inspect.isclass(value) else None)
        for member, documented in texts.items():
            text = getattr(documented, "__doc__", None)
            for target in ROLE.findall(text if isinstance(text, str) else ""):
                # Sphinx completes a name with a leading dot.
                ends = target.startswith(".") and any(full.endswith(target) for full in everything)
                if (
                    not ends
                    and not everything & {target, f"{module}.{target}", f"{module}.{name}.{target}"}
                    and crosstrack_api.home_of(target, scope, named, known) is None
                ):
                    yield f"{module}.{name}.{member}".rstrip("."), target


def test_roles_in_docstrings_name_objects_that_the_reference_documents():
    objects = [(module, name, value) for module, name, value, _ in asked()]
    named = crosstrack_api.unique_classes(objects)
    assert sorted(set(broken_roles(objects, named))) == []
    # The check finds a wrong role.
    wrong = type(
        "Wrong", (), {"__doc__": "See :class:`Missing`.", "__module__": "crosstrack.models"}
    )
    assert list(broken_roles([("crosstrack.models", "Wrong", wrong)], named)) == [
        ("crosstrack.models.Wrong", "Missing")
    ]


def test_the_pictures_of_the_readme_are_small_and_the_animation_lasts_half_a_minute():
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    names = re.findall(
        r"!\[[^\]]+\]\(docs/_static/([^)]+)\)", (DOCS.parent / "README.md").read_text("utf-8")
    )
    files = [DOCS / "_static" / name for name in names]
    assert sum(file.stat().st_size for file in files) < 400_000
    seconds = []
    for file in files:
        with image.open(file) as frames:
            total = 0
            for frame in range(getattr(frames, "n_frames", 1)):
                frames.seek(frame)
                frames.load()
                total += frames.info.get("duration", 0)
        seconds.append(total / 1000)
    assert sorted(seconds) == [0, pytest.approx(30, abs=1)]


def test_the_conformance_table_has_its_date_and_machine():
    data = json.loads((DOCS / "campaign/conformance.json").read_text("utf-8"))
    assert re.search(r"\d{4}-\d\d-\d\d", data["words"])
    assert data["processor"] in data["words"]


def test_the_filter_hides_headings_without_rows(tmp_path):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    raw = re.search(r"```\{raw\} html\n(.*?)```", (DOCS / "catalogue.md").read_text("utf-8"), re.S)
    sections = "".join(
        f"<section id='{name}'><h2>{name}</h2><table><thead><tr><th>instance</th></tr></thead>"
        f"<tbody>{''.join(f'<tr><td>{name}/{row}</td></tr>' for row in rows)}</tbody></table></section>"
        for name, rows in {"fleet": ("small", "large"), "messenger": ("small",)}.items()
    )
    page_file = tmp_path / "page.html"
    page_file.write_text(f"<!doctype html><section>{raw[1]}{sections}</section>", "utf-8")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(page_file.as_uri())
        for wanted, fleet, messenger, left in (
            ("LARGE", True, False, "1 left"),
            ("small", True, True, "2 left"),
            ("nothing", False, False, "0 left"),
            ("", True, True, ""),
        ):
            page.fill("#filter", wanted)
            assert page.locator("#fleet").is_visible() is fleet
            assert page.locator("#messenger").is_visible() is messenger
            assert page.locator("#left").text_content() == left
        browser.close()


#: Queries for which the search lists the page of the name first, and the object on this page.
QUERIES = {
    **{f"ct.{name}": f"crosstrack.{name}" for name in ("solve", "compare", "load", "verify")},
    **{f"ct.{name}": f"crosstrack.{name}" for name in ("diagnose", "bench")},
    "FleetRouting": "crosstrack.models.fleet.FleetRouting",
    "MinimumSnap": "crosstrack.models.minimum_snap.MinimumSnap",
    "MessengerTour": "crosstrack.models.messenger.MessengerTour",
    "GridPath": "crosstrack.models.grid_path.GridPath",
}
SMALL_SITE = f"""
import sys
sys.path.insert(0, {str(DOCS / "_ext")!r})
extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "crosstrack_api"]
pages = {sorted(QUERIES.values())}
include_patterns = ["index.md", "api/verbs.md", *(f"generated/api/{{page}}.rst" for page in pages)]
autosummary_generate = numpydoc_show_class_members = False
html_theme = "basic"
"""


def test_the_search_lists_the_page_of_a_name_first(tmp_path):
    """The pages of the queries are built, since the whole site takes minutes."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    shutil.copytree(DOCS / "api", tmp_path / "api")
    text = "# Names\n\n## FleetRouting and ct.solve\n\nct.solve, ct.load, GridPath, MinimumSnap\n"
    (tmp_path / "index.md").write_text(text, "utf-8")
    (tmp_path / "conf.py").write_text(SMALL_SITE, "utf-8")
    built = tmp_path / "built"
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(tmp_path), str(built)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page()
        for query, name in QUERIES.items():
            page.goto(f"{(built / 'search.html').as_uri()}?q={query}")
            first = page.locator("ul.search > li a").first
            first.wait_for(timeout=10_000)
            target = (first.get_attribute("href") or "").partition("#")[0]
            assert target == f"generated/api/{name}.html", query
        browser.close()


def test_a_page_of_an_instance_has_its_plan_its_bound_and_its_backend():
    found = {entry.name: entry for entry in entries()}

    def body(name, **files):
        model = crosstrack_pictures.model_of(name)
        answers = crosstrack_pictures.answers_to(DOCS, model)
        return crosstrack_entries.body_of(found[name], model, answers, "picture.webp", "", files)

    page = body("fleet/max-10", **{"max-10.plan.json": "plan"})
    for text in ("3 vehicles, 10 nodes", "251.983408 m", "<td>optimal</td>", "fixed seed"):
        assert text in page
    assert page.count("251.983408 m") == 2  # the bound equals the objective
    assert "crosstrack check fleet/max-10 max-10.plan.json" in page
    assert "<td>infeasible</td>" in body("grid-path/unreachable")
    assert "two straight lines" in body("resource-routing/errand")
    assert "different quantities" in body("attractor/logistic")


def test_recorded_plans_are_verified_again():
    """A plan to download is feasible and has its stated objective; one per problem is checked."""
    lines = (DOCS / "campaign" / "plans.jsonl").read_text("utf-8").splitlines()
    rows = [row for row in map(json.loads, lines) if row["plan"] != "left out"]
    assert len(rows) > 100
    problems = set()
    for row in sorted(rows, key=lambda row: len(json.dumps(row["plan"]))):
        problem = row["instance"].partition("/")[0]
        if problem not in problems and row["verification"]["ok"]:
            problems.add(problem)
            model = crosstrack_pictures.model_of(row["instance"])
            verification = model.verify(model.plan_from_data(row["plan"]))
            assert model.digest == row["digest"]
            assert verification.objective == pytest.approx(row["primal_bound"], rel=1e-6, abs=1e-9)
    assert len(problems) > 10


@pytest.mark.slow
def test_the_campaigns_file_makes_its_records():
    """The jobs of the file are those of the records, except for backends that are not installed here."""
    from crosstrack.solvers.bench import Campaign
    from crosstrack.solvers.contract.states import backend_states

    asked = {task.job.key() for task in Campaign.read(DOCS / "campaign" / "campaign.toml").tasks}
    lines = (DOCS / "campaign" / "records.jsonl").read_text("utf-8").splitlines()
    held = {row["key"]: row["backend"] for row in map(json.loads, lines)}
    away = {one.name for one in backend_states() if one.state != "installed"}
    assert asked - held.keys() == set()
    assert {name for key, name in held.items() if key not in asked} <= away
