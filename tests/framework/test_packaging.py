"""The package as it is installed: its list of packages, its wheel, and how light it is to import."""

import importlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from imports import TOP

from crosstrack.models.problems import PROBLEMS

HEAVY = (
    "casadi", "click", "cvxpy", "gurobipy", "highspy", "matplotlib", "numba", "numpy", "ortools",
    "pandas", "pyscipopt", "rich", "scipy",
)  # fmt: skip


@pytest.fixture(scope="module")
def project(checkout):
    return tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))


def packages_of(root):
    """The packages in the tree, by dotted name."""
    own = [
        folder
        for top in TOP
        for folder in (root / top).rglob("*")
        if folder.is_dir() and folder.name != "__pycache__"
    ]
    own += [root / top for top in TOP]
    holding = [folder for folder in own if any(folder.glob("*.py"))]
    return [
        "crosstrack",
        *sorted(".".join(("crosstrack", *p.relative_to(root).parts)) for p in holding),
    ]


def test_every_package_of_the_tree_is_built(checkout, monkeypatch):
    monkeypatch.chdir(checkout)
    assert runpy.run_path("setup.py")["packages"]() == packages_of(checkout)


def test_every_package_has_an_init(checkout):
    for name in packages_of(checkout):
        folder = checkout.joinpath(*name.split(".")[1:])
        assert (folder / "__init__.py").is_file(), f"{folder} has no __init__.py"


def test_version_is_the_same_everywhere(project, checkout):
    import crosstrack

    assert project["project"]["dynamic"] == ["version"]  # read from version.py
    (newest, date) = re.findall(
        r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$",
        (checkout / "CHANGELOG.md").read_text("utf-8"),
        re.M,
    )[0]
    assert newest == crosstrack.__version__
    citation = (checkout / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {newest}\ndate-released: {date}\n" in citation


def test_the_changelog_has_each_heading_and_entry_once_per_version(checkout):
    for version in (checkout / "CHANGELOG.md").read_text("utf-8").split("\n## ")[1:]:
        headings = re.findall(r"^### .*", version, re.M)
        entries = re.findall(r"^- .*(?:\n  .*)*", version, re.M)
        assert len(set(headings)) == len(headings), version[:20]
        assert len(set(entries)) == len(entries), version[:20]
        assert all(f"\n\n{heading}\n\n" in version for heading in headings)


def test_constraints_pin_exact_versions_of_every_dependency(project, checkout):
    lines = (checkout / "constraints.txt").read_text("utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.!+-]*", line) for line in pins)
    pinned = {re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower() for line in pins}
    extras = project["project"]["optional-dependencies"].values()
    wanted = [*project["project"]["dependencies"], *(entry for extra in extras for entry in extra)]
    names = {re.match(r"[A-Za-z0-9._-]+", entry)[0].lower() for entry in wanted}
    names -= {"crosstrack", "crosstrack-weights"}  # of this checkout
    assert names <= pinned


def extras_of(project):
    """The extras that are not for work on crosstrack itself: the words each brings."""
    declared = project["project"]["optional-dependencies"]
    return {
        name: {
            word
            for entry in entries
            for word in re.findall(
                r"[a-z]+(?:-[a-z]+)*",
                entry.partition("[")[2] if "[" in entry else entry.split(">")[0],
            )
        }
        for name, entries in declared.items()
        if name not in {"test", "docs", "benchmark", "release"}
    }


def test_readme_lists_every_extra_with_its_packages(project, checkout):
    text = (checkout / "README.md").read_text("utf-8")
    rows = re.findall(r"^\| `([a-z]+)` \| (.*) \|$", text, re.M)
    listed = {name: set(re.findall(r"`([a-z-]+)`", text)) for name, text in rows}
    assert listed == extras_of(project)


def test_a_missing_package_is_installed_by_the_named_extra(project, checkout):
    """A backend's extra brings what it requires; one without an extra requires dependencies only."""
    from crosstrack.models.problems import resolve
    from crosstrack.solvers.contract.registry import _SOLVERS

    extras = extras_of(project)
    own = {re.match(r"[a-z]+", entry)[0] for entry in project["project"]["dependencies"]}
    for name, target in _SOLVERS.items():
        backend = resolve("crosstrack" + target)
        assert set(backend.requires) <= (extras[backend.extra] if backend.extra else own), name
    for file in checkout.glob("[a-z]*/**/*.py"):
        if file.relative_to(checkout).parts[0] in TOP:
            for extra in re.findall(r"crosstrack\[([a-z]+)\]", file.read_text("utf-8")):
                assert extra in {*extras, "extra"}, file


def test_import_is_light(run_python, tmp_path):
    script = (
        "import json, sys, time; begin = time.perf_counter(); import crosstrack; "
        "end = time.perf_counter(); "
        "print(json.dumps([end - begin, sorted(m.partition('.')[0] for m in sys.modules)]))"
    )
    runs = [json.loads(run_python("-c", script, cwd=tmp_path)) for _ in range(5)]
    assert set(HEAVY).isdisjoint(runs[0][1])
    assert min(seconds for seconds, _ in runs) < 0.2


@pytest.mark.parametrize(
    "package", ["crosstrack.models", "crosstrack.solvers", "crosstrack.instances"]
)
def test_packages_export_lazily(package, run_python, tmp_path):
    script = (
        f"import json, sys; import {package} as p; dir(p); print(json.dumps(sorted(sys.modules)))"
    )
    loaded = {name.partition(".")[0] for name in json.loads(run_python("-c", script, cwd=tmp_path))}
    assert loaded.isdisjoint(HEAVY)


@pytest.fixture(scope="module")
def distributions(checkout, tmp_path_factory):
    """Wheels and source distributions, built from a copy without files of earlier builds."""
    place = tmp_path_factory.mktemp("wheel")
    made = shutil.ignore_patterns(
        ".*", "__pycache__", "*.egg-info", "_build", "build", "dist", "gallery", "generated"
    )
    shutil.copytree(checkout, place / "checkout", ignore=made)
    command = [sys.executable, "-P", "-m", "build", "--no-isolation", "--outdir", str(place)]
    for source, options in ((".", []), ("solvers/unknown_grid/weights", ["--wheel"])):
        done = subprocess.run(
            [*command, *options, str(place / "checkout" / source)],
            capture_output=True, text=True, timeout=240, check=False, cwd=place,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return place


@pytest.fixture(scope="module")
def wheel(distributions):
    (file,) = distributions.glob("crosstrack-*.whl")
    return file


def test_wheel_holds_the_packages_and_nothing_else(wheel, checkout):
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    expected = {"crosstrack/py.typed"}
    for name in packages_of(checkout):
        folder = checkout.joinpath(*name.split(".")[1:])
        expected |= {f"{name.replace('.', '/')}/{file.name}" for file in folder.glob("*.py")}
    expected.add("crosstrack/instances/reference_systems.toml")
    expected.add("crosstrack/instances/optimal_control/benchmarks.toml")
    expected.remove("crosstrack/setup.py")  # the build script is no module of the package
    # Files of the report of a campaign.
    expected |= {f"crosstrack/solvers/bench/page.{kind}" for kind in ("html", "css", "js")}
    # Files of the page that shows a plan.
    page = ("draw.js", "panel.js", "view.js", "view.css", "view.html")
    expected |= {f"crosstrack/solvers/report/view/{name}" for name in page}
    expected |= {"crosstrack/solvers/unknown_grid/laws.json"}
    info = {name for name in held if ".dist-info/" in name}
    assert held - info == expected
    assert {"entry_points.txt", "LICENSE"} <= {name.rpartition("/")[2] for name in info}
    assert wheel.stat().st_size < 2.8e6  # 2.6 MB; 4.2 MB with the weights


def test_source_distribution_holds_the_wheel_and_the_files_to_build_it(distributions, wheel):
    (source,) = distributions.glob("crosstrack-*.tar.gz")
    with tarfile.open(source) as archive:
        held = {f.name.partition("/")[2] for f in archive.getmembers() if f.isfile()}
    with zipfile.ZipFile(wheel) as archive:
        names = {name.partition("/") for name in archive.namelist()}
    expected = {rest for package, _, rest in names if package == "crosstrack"}
    expected |= {"CHANGELOG.md", "CITATION.cff", "LICENSE", "MANIFEST.in", "PKG-INFO", "README.md"}
    expected |= {"constraints.txt", "pyproject.toml", "setup.cfg", "setup.py"}
    assert {name for name in held if not name.startswith("crosstrack.egg-info/")} == expected
    assert source.stat().st_size < 2.8e6


def test_weights_are_a_distribution_of_their_own(distributions, installed, run_python, tmp_path):
    (file,) = distributions.glob("crosstrack_weights-*.whl")
    script = (
        "from crosstrack.solvers.learning.weights import read_weights as read; "
        "from crosstrack.solvers.unknown_grid.networks import NETWORKS, shipped_weights as path; "
        "print(*(read(path(kind), kind).kind == kind for kind in NETWORKS))"
    )
    away = {"cwd": tmp_path, "PYTHONPATH": str(installed)}
    missing = script.partition("print")[0] + "path('vin')"
    with pytest.raises(
        AssertionError, match=r"weights of vin are not installed: pip install 'cross"
    ):
        run_python("-c", missing, **away)
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path / "weights")
    away["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'weights'}"
    assert run_python("-c", script, **away).split() == ["True"] * 6


@pytest.fixture(scope="module")
def installed(wheel, run_python, tmp_path_factory):
    """The folder into which the wheel was installed."""
    place = tmp_path_factory.mktemp("installed")
    options = ["-q", "--no-deps", "--no-index", "--no-compile", "--target", str(place)]
    run_python("-P", "-m", "pip", "install", *options, str(wheel), cwd=place)
    return place


def test_the_command_line_and_workers_run_from_the_wheel(installed, run_python, tmp_path):
    away = {"cwd": tmp_path, "PYTHONPATH": str(installed)}
    where = "import crosstrack.solvers.run.dispatch as m; print(m.__file__)"
    assert run_python("-c", where, **away).startswith(str(installed))
    # Interpreted, because the results are the same and compiling takes a minute.
    names = "label-setting,two-stage,highs:paper"
    arguments = ["compare", "error-correction/example-1", "--backends", names]
    plain = {**away, "NUMBA_DISABLE_JIT": "1"}
    assert "AGREED" in run_python("-m", "crosstrack", *arguments, **plain)
    script = "import sys; from importlib.metadata import distribution as d; [e] = d('crosstrack')"
    script += ".entry_points.select(group='console_scripts'); sys.exit(e.load()(['--version']))"
    assert "version" in run_python("-c", script, **plain)


def test_type_checkers_accept_right_calls_and_report_wrong_ones(installed, tmp_path):
    """mypy reads both files beside the installed wheel: right_calls.py passes, wrong_calls.py does not."""
    data = Path(__file__).parent / "data"
    files = [data / "right_calls.py", data / "wrong_calls.py"]
    # Reading all other libraries takes half of the time.
    text = "[mypy]\nfollow_imports = skip\n[mypy-crosstrack.*,matplotlib.*,numpy.*]\nfollow_imports = silent\n"
    (tmp_path / "mypy.ini").write_text(text, "utf-8")
    options = ["--strict", "--no-error-summary", "--cache-dir", os.devnull]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "mypy", *options, *files],
        capture_output=True, text=True, timeout=240, check=False, cwd=tmp_path,
        env={**os.environ, "MYPYPATH": str(installed)},
    )  # fmt: skip
    reports = re.findall(r"(\w+)\.py:(\d+): error: .*\[([a-z-]+)\]$", done.stdout, re.M)
    marks = enumerate(files[1].read_text("utf-8").splitlines(), 1)
    expected = [
        ("wrong_calls", str(number), line.rpartition("  # ")[2])
        for number, line in marks
        if "  # " in line
    ]
    assert sorted(reports) == sorted(expected), done.stdout + done.stderr


def test_the_calls_for_type_checkers_run_and_name_every_model():
    from crosstrack.models import Model
    from crosstrack.models.problems import loadable_models

    data = Path(__file__).parent / "data"
    names = runpy.run_path(str(data / "right_calls.py"))
    built = {value.kind for value in names.values() if isinstance(value, Model)}
    texts = [(data / file).read_text("utf-8") for file in ("right_calls.py", "wrong_calls.py")]
    for kind, cls in loadable_models():
        if cls.__module__.startswith("crosstrack.models.programs"):
            continue  # built with ProgramBuilder
        assert kind in built, f"right_calls.py has no model of kind {kind!r}"
        assert all(f"m.{cls.__name__}" in text for text in texts), cls


@pytest.mark.parametrize("problem", PROBLEMS)
def test_public_names_of_a_problem_are_typed_exports_of_models(problem):
    """A name that models/__init__.py lacks is Any to type checkers and missing from completion."""
    import crosstrack.models

    folder = importlib.import_module(f"crosstrack.models.{problem}")
    missing = set(folder.__all__) - set(crosstrack.models.__all__)
    assert not missing, (
        f"add to the TYPE_CHECKING block of models/__init__.py: from .{problem} import "
        + ", ".join(f"{name} as {name}" for name in sorted(missing))
    )
    assert set(folder.__all__) <= set(dir(crosstrack.models))


@pytest.mark.slow
def test_readme_and_example_run_from_the_wheel(
    installed, checkout, page_code, run_python, tmp_path
):
    away = {"cwd": tmp_path, "PYTHONPATH": str(installed)}
    (tmp_path / "readme.py").write_text(page_code(checkout / "README.md"), "utf-8")
    assert "AGREED" in run_python("readme.py", **away)
    shutil.copy(checkout / "docs" / "examples" / "plot_error_correction.py", tmp_path)
    assert "AGREED" in run_python("plot_error_correction.py", **away)
