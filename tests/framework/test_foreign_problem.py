"""A problem of another distribution works like a built-in one; a broken one affects no other."""

import itertools
import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import joined, run_all

import crosstrack as ct

SOURCE = Path(__file__).parents[2] / "docs" / "stranger"
EXAMPLE = "error-correction/example-1"


@pytest.fixture(scope="module")
def installed(tmp_path_factory, run_python):
    """The folder into which pip installed the distribution, announced by its entry point alone."""
    place = tmp_path_factory.mktemp("foreign")
    shutil.copytree(SOURCE, place / "source", ignore=shutil.ignore_patterns("__pycache__"))
    pip = ["-m", "pip", "install", "-q", "--no-deps", "--no-index", "--no-build-isolation"]
    target = place / "site"
    run_python("-P", *pip, "--target", str(target), str(place / "source"), cwd=place)
    return target


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with plans and instances of the foreign problem."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "plan.json").write_text('{"items": [0, 2]}')
    (folder / "poor.json").write_text('{"items": [0]}')
    # Each job of a foreign backend starts a process.
    campaign = (SOURCE / "campaign.toml").read_text()
    few = campaign.replace("covering/*", "covering/small").replace(', "highs"', "")
    (folder / "campaign.toml").write_text(few)
    return folder


@pytest.fixture
def covering(monkeypatch):
    """The modules of the distribution, imported from its source."""
    monkeypatch.syspath_prepend(str(SOURCE))
    from covering import enumerating, model, solving

    yield SimpleNamespace(
        Covering=model.Covering, exact=solving.CoverByWeight(), program=enumerating.Enumeration()
    )
    for name in [name for name in sys.modules if name.partition(".")[0] == "covering"]:
        del sys.modules[name]


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(40))
def test_the_exact_example_equals_brute_force_on_real_weights(seed, covering):
    """It truncated weights to whole numbers: a feasible instance was called infeasible."""
    random = np.random.default_rng(seed)
    size = int(random.integers(1, 9))
    weights = random.choice([0.1, 0.5, 0.9, 1.5, float(random.uniform(0, 3))], size)
    costs = random.choice([0.0, 1.0, 2.5, float(random.uniform(0, 5))], size)
    model = covering.Covering(costs, weights, int(random.integers(0, 6)))
    choices = itertools.product((0.0, 1.0), repeat=size)
    values = [costs @ x for x in map(np.array, choices) if weights @ x >= model.demand - 1e-9]
    for backend in (covering.exact, covering.program):
        answer = ct.solve(model, backend, isolate=False)
        if values:
            assert answer.termination == "optimal", answer
            assert answer.primal_bound == pytest.approx(min(values))
        else:
            assert answer.termination == "infeasible"


def test_every_command_works_on_it(installed, place):
    small, dynamic = "covering/small", "dynamic-programming"
    commands = {
        "models": ["models", "--json"],
        "model": ["models", "covering", "--json"],
        "template": ["models", "covering", "--template", "json"],
        "instances": ["instances", "--json"],
        "backends": ["backends", "--json"],
        "backends in words": ["backends"],
        "solve": ["solve", small, "--json", "--plot", "small.png", "--output", "small.json"],
        "solve a program": ["solve", small, "--backend", "highs", "--warm-start", "small.json"],
        "infeasible": ["solve", "covering/heavy"],
        "diagnose": ["diagnose", "covering/heavy", "--json"],
        "filter": ["diagnose", "covering/heavy", "--backend", "highs", "--json"],
        "enumerate": ["solve", small, "--backend", "enumeration", "--json"],
        "enumerate ours": ["solve", EXAMPLE, "--backend", "enumeration"],
        "bench": ["bench", "campaign.toml", "--record", "record.jsonl", "--json"],
        "report": ["report", "record.jsonl", "--output", "page.html"],
        "both": ["compare", small, EXAMPLE, "--backends", dynamic, "--json"],
        "reproduce": ["reproduce", "covering"],
        "check": ["check", small, "plan.json", "--formulation", "paper", "--plot", "plan.png"],
        "check poor": ["check", small, "poor.json"],
        "export": ["export", small, "plan.json", "--output", "plan.txt", "--option", "first=1"],
        "export poor": ["export", small, "poor.json", "--output", "poor.txt"],
        "export nothing": ["export", EXAMPLE, "plan.json", "--output", "none.txt"],
        "export with rate": ["export", small, "plan.json", "--output", "r.txt", "--rate", "3"],
        "export as poly7": ["export", small, "plan.json", "--output", "p.csv", "--format", "poly7"],
        "export to csv": ["export", small, "plan.json", "--output", "p.csv"],
        "demo help": ["demo", "--help"],
        "demo": ["demo", "covering", "--demand", "5", "--plot", "demo.png"],
        "demo of another": ["demo", "covering", "--points", "a.csv"],
    }
    # The demonstration compares all backends: two solvers of programs suffice.
    many = ("cvxpy", "gurobipy", "ortools", "pyscipopt")
    finished = run_all(commands.values(), place, installed, hidden=many)
    done = dict(zip(commands, finished, strict=True))
    codes = {name: one.returncode for name, one in done.items()}
    expected = {"infeasible": 3, "diagnose": 3, "filter": 3, "check poor": 6, "export poor": 6}
    expected |= dict.fromkeys(
        ["export nothing", "export with rate", "export as poly7", "export to csv"], 2
    )
    expected |= {"demo of another": 2, "enumerate ours": 2}
    errors = {name: one.stderr for name, one in done.items() if one.stderr}
    assert codes == {name: expected.get(name, 0) for name in commands}, errors

    def data(name):
        return json.loads(done[name].stdout)

    listed = {one["model"]: one for one in data("models")}
    assert listed["covering"]["formulations"] == {"paper": "one column per item"}
    assert "error-correction" in listed
    assert {"costs", "weights", "demand"} <= {field["name"] for field in data("model")["fields"]}
    assert {dynamic, "highs"} <= {backend["backend"] for backend in data("model")["backends"]}
    assert data("template")["model"] == "covering"
    assert {small, EXAMPLE} <= {one["name"] for one in data("instances")}
    owners = {one["problem"] for one in data("backends") if one["name"] == dynamic}
    assert owners == {"covering", "error_correction", "guided_path"}
    assert done["backends in words"].stdout.count(dynamic) == 3
    assert data("solve")["backend"] == dynamic
    assert data("solve")["plan"] == {"items": [0, 2]}
    assert (place / "small.png").stat().st_size > 1000
    assert "all items together are 3 kg short" in done["diagnose"].stdout
    assert data("filter")["findings"][0]["equation"] == "2"
    assert data("enumerate")["primal_bound"] == data("solve")["primal_bound"]
    assert "at most 18 columns" in done["enumerate ours"].stderr
    assert data("bench")["verdict"] == "AGREED"
    assert data("bench")["answers"] == 2
    page = (place / "page.html").read_text()
    assert "covering/small" in page and "enumeration" in page and "<svg" in page
    both = [one["solutions"][0] for one in data("both")["instances"]]
    assert [one["model"] for one in both] == ["covering", "error-correction"]
    assert [one["termination"] for one in both] == ["optimal", "optimal"]
    assert data("both")["verdict"] == "AGREED"
    assert "The paper used another machine." in done["reproduce"].stdout
    assert "1.5" in done["reproduce"].stdout
    assert "item chosen" in done["check"].stdout or "demand" in done["check"].stdout
    assert (place / "plan.txt").read_text() == "1\n3\n"
    assert not (place / "poor.txt").exists()
    assert "no format" in done["export nothing"].stderr
    assert "no option 'rate'; its options: first" in done["export with rate"].stderr
    assert "'poly7'" in done["export as poly7"].stderr
    assert "list" in done["export as poly7"].stderr
    assert ".txt" in done["export to csv"].stderr
    assert "--demand" in done["demo help"].stdout
    assert "--points" in done["demo help"].stdout
    # Without names, every backend is compared, their own before the solvers of programs.
    assert f"AGREED: optimum 4: plan by {dynamic}, highs:paper, " in done["demo"].stdout
    assert (place / "demo.png").stat().st_size > 1000
    assert "no option 'points'; its options: demand" in done["demo of another"].stderr


def test_every_verb_works_on_it(installed, run_python, place):
    script = """
import crosstrack as ct
from crosstrack.instances import export_formats, export_plan
model = ct.load("covering/small")
best = ct.solve(model)
assert best.backend == "dynamic-programming" and best.plan.items == (0, 2), best
ct.plot(model, best, title="mine").savefig("mine.png")
result = ct.compare([model, ct.load("error-correction/example-1")], ["dynamic-programming"])
assert result.outcome == "AGREED", result
assert ct.verify(model, best, formulation="paper").ok
assert ct.diagnose(ct.load("covering/heavy")).feasible is False
assert list(export_formats(model)) == ["list"]
export_plan(model, best, "mine.txt")
again = ct.models.Model.from_json(model.to_json())
assert again.digest == model.digest
print(type(again).__module__)
"""
    (place / "verbs.py").write_text(script)
    printed = run_python("verbs.py", cwd=place, PYTHONPATH=joined(installed))
    assert printed == "covering.model\n"


def announce(folder, name, code):
    """Write a distribution that announces the problem `name`, whose module holds `code`."""
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.py").write_text(code)
    info = folder / f"{name}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(f"[crosstrack.problems]\n{name} = {name}\n")


#: Tables of a problem none of whose objects exists, and one whose module raises a bug of its own.
HOLLOW = """
MODELS = {"hollow": "hollow:Nothing"}
PICTURES = {"hollow": "hollow:draw"}
BACKENDS = {"hollow": "hollow:Nothing", "dynamic-programming": "hollow_parts:Nothing"}
DIAGNOSES = {"hollow": "hollow:diagnose"}
PAPERS = {"hollow": "hollow:PAPER"}
CATALOGUE = {"hollow": "hollow:entries"}
REFERENCES = {"hollow": "hollow:references"}
HINTS = {"hollow": "hollow:describe"}
EXPORTS = {"hollow": "hollow:EXPORT"}
DEMOS = {"hollow": "hollow:DEMO"}
"""


def test_broken_problems_affect_no_other_problem(tmp_path):
    site, work = tmp_path / "site", tmp_path / "work"
    announce(site, "absent", "import no_such_module\n")
    announce(site, "hollow", HOLLOW)
    announce(site, "tables", "MODELS = None\n")
    (site / "hollow_parts.py").write_text("raise NameError('a bug of theirs')\n")
    work.mkdir()
    (work / "hollow.json").write_text('{"model": "hollow", "data": {}}')
    (work / "table.csv").write_text("a,b\n1,2\n")
    (work / "plan.json").write_text("[0, 1, 2, 4]")
    commands = {
        "models": ["models", "--json"],
        "instances": ["instances", "--json"],
        "backends": ["backends", "--json"],
        "solve": ["solve", EXAMPLE, "--backend", "dynamic-programming", "--plot", "a.png"],
        "auto": ["solve", EXAMPLE],
        "check": ["check", EXAMPLE, "plan.json"],
        "diagnose": ["diagnose", EXAMPLE],
        "demo": ["demo", "--help"],
        "compare": ["compare", EXAMPLE, "--backends", "dynamic-programming,highs", "--json"],
        "theirs": ["solve", "hollow.json"],
        "their instance": ["solve", "hollow/1"],
        "their backend": ["solve", EXAMPLE, "--backend", "hollow"],
        "their paper": ["reproduce", "hollow"],
        "their demo": ["demo", "hollow"],
        "a table": ["solve", "table.csv"],
        "a name": ["solve", "no/such"],
    }
    finished = run_all(commands.values(), work, site)
    done = dict(zip(commands, finished, strict=True))
    codes = {name: one.returncode for name, one in done.items()}
    broken = dict.fromkeys(["theirs", "their instance", "their backend", "their paper"], 5)
    expected = broken | dict.fromkeys(["their demo", "a table", "a name"], 2)
    errors = {name: one.stderr for name, one in done.items() if one.stderr}
    assert codes == {name: expected.get(name, 0) for name in commands}, errors
    assert all("Traceback" not in text for text in errors.values())
    heard = "".join(errors.values())
    assert "problem 'absent' (absent) cannot be loaded: No module named 'no_such_module'" in heard
    assert "problem 'tables' (tables) cannot be loaded: MODELS is no table" in heard
    assert "hollow:Nothing cannot be loaded" in done["models"].stderr
    assert "hollow:entries cannot be loaded" in done["instances"].stderr
    states = {(one["problem"], one["name"]): one for one in json.loads(done["backends"].stdout)}
    assert states["hollow", "hollow"]["state"] == "broken"
    assert "a bug of theirs" in states["hollow", "dynamic-programming"]["cause"]
    assert states["error_correction", "dynamic-programming"]["state"] == "installed"
    assert json.loads(done["compare"].stdout)["verdict"] == "AGREED"
