"""The commands models, instances, backends and compare with names and globs; templates; durations."""

import json
import re

import pytest
from commands import run

import crosstrack as ct
from crosstrack.cli.options import DURATION
from crosstrack.instances.templates import template, template_formats
from crosstrack.models.declaration import Plan
from crosstrack.models.facts import field_facts
from crosstrack.models.problems import loadable_models, model_types

KINDS = [kind for kind in model_types() if kind != "conic-program"]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("10s", 10), ("2min", 120), ("1.5h", 5400), ("500ms", 0.5), ("3", 3), ("1e1", 10), ("2 s", 2)],
)
def test_durations_have_units(text, seconds):
    assert DURATION.convert(text, None, None) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["10 parsecs", "s", "", "1.2.3s", "min", "two minutes"])
def test_a_wrong_duration_names_the_units(text):
    done = run("solve", "guided-path/one", "--time-limit", text, code=2)
    assert "ms" in done.stderr and "1.5h" in done.stderr and repr(text) in done.stderr


def test_durations_reach_all_options_of_seconds():
    arguments = (
        "guided-path/one",
        "--backends",
        "a-star",
        "--time-limit",
        "0.5min",
        "--grace",
        "2s",
    )
    [result] = json.loads(run("compare", *arguments, "--json").stdout)["instances"]
    assert result["solutions"][0]["termination"] == "optimal"
    done = run("solve", "guided-path/one", "--stop", "stalled=5 parsecs", code=2)
    assert "parsecs" in done.stderr


def test_instances_and_backends_are_filtered_by_globs():
    listed = json.loads(run("instances", "fleet/max-*", "guided-path/one", "--json").stdout)
    names = [entry["name"] for entry in listed]
    assert "guided-path/one" in names and "fleet/max-10" in names
    assert all(name.startswith(("fleet/max-", "guided-path/one")) for name in names)
    listed = json.loads(run("backends", "hig*", "a-star", "--json").stdout)
    assert {state["name"] for state in listed} == {"highs", "a-star"}


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("instances", "flet/*"), "fleet/*"),
        (("instances", "guided-path/oone"), "guided-path/one"),
        (("backends", "higs"), "highs"),
        (("compare", "flet/*"), "fleet/*"),
        (("models", "flet-routing"), "fleet-routing"),
    ],
)
def test_a_pattern_without_a_match_suggests_names(arguments, hint):
    assert f"did you mean {hint!r}" in run(*arguments, code=2).stderr


def test_compare_takes_globs_of_the_catalogue_and_of_files(tmp_path):
    for number in (1, 2):
        (tmp_path / f"{number}.json").write_bytes(template("guided-path-tour")[0])
    arguments = ("guided-path/on[e]", "guided-path/one", f"{tmp_path}/*.json")
    done = run("compare", *arguments, "--backends", "a-star", "--time-limit", "1min", "--json")
    solved = [entry["instance"] for entry in json.loads(done.stdout)["instances"]]
    assert solved == ["guided-path/one"] * 3  # the files contain the instance with its name


def test_every_field_has_a_meaning_with_units_in_words():
    units = re.compile(r"(\(|, |\bin )(m|s|rad|kg|N m|m/s|m/s²|rad/s)(?=[).,;:]|$)")
    for kind, cls in loadable_models():
        facts = list(field_facts(cls))
        if issubclass(cls.plan_type, Plan):
            facts += field_facts(cls.plan_type)
        for fact in facts:
            assert fact.meaning, f"the docstring of model {kind!r} lacks field {fact.name!r}"
            text = re.sub(r"shape \([^)]*\)|Jacobian \([^)]*\)", "", fact.meaning)
            assert not units.search(text), (kind, fact)
            json.dumps(fact, allow_nan=False)


def test_models_describes_a_model():
    facts = json.loads(run("models", "fleet-routing", "--json").stdout)
    fields = {field["name"]: field for field in facts["fields"]}
    assert fields["vehicles"]["required"] and fields["points"]["unit"] == "m"
    assert fields["objective"]["default"] == "max" and "map.cell" in fields
    assert "three-index" in facts["formulations"]
    assert {"subset-dp", "highs"} <= {backend["backend"] for backend in facts["backends"]}
    assert facts["templates"] == ["json", "csv", "xlsx"]
    text = run("models", "fleet-routing").stdout
    assert all(
        word in text for word in ("required", "subset-dp", "two-index", "--template json|csv")
    )
    fields = {fact.name: fact for fact in field_facts(ct.models.TimeAllocation)}
    assert fields["velocity_limit"].unit == "m/s"  # described by another class
    assert "knots" in fields["start"].meaning or "knot" in fields["start"].meaning


@pytest.mark.parametrize("kind", KINDS)
def test_templates_are_read_back(kind, tmp_path):
    models = {}
    for form in template_formats(kind):
        content, data = template(kind, form)
        file = tmp_path / f"template.{form}"
        file.write_bytes(content)
        if form == "json":
            models[form] = ct.load(file, trusted=True)
        else:
            models[form] = ct.load(file, data=data, model=kind)
        assert models[form].kind == kind
    if "csv" in models:
        assert models["csv"].digest == models["json"].digest


@pytest.mark.parametrize("kind", ["guided-path-tour", "grid-path", "minimum-snap"])
def test_an_unchanged_template_is_solved(kind, tmp_path):
    file = tmp_path / "template.json"
    run("models", kind, "--template", "json", "--output", file)
    assert run("solve", file, "--json").stdout
    assert run("models", kind, "--template", "json").stdout == file.read_text("utf-8")


def test_a_table_names_the_data_that_it_lacks(tmp_path):
    file = tmp_path / "nodes.xlsx"
    done = run("models", "fleet-routing", "--template", "xlsx", "--output", file)
    command = done.stderr.split("solve it: crosstrack ")[1].split()
    assert json.loads(run(*command, "--json").stdout)["plan"]["routes"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("grid-path", "--template", "csv"), "json"),
        (("fleet-routing", "--template", "xlsx"), "--output"),
        (("fleet-routing", "--template", "csv", "--output", "nodes.json"), ".csv"),
        (("fleet-routing", "--output", "nodes.json"), "--template"),
        (("--template", "json"), "NAME"),
        (("conic-program", "--template", "json"), "register_entry"),
    ],
)
def test_impossible_templates_are_refused(arguments, words, tmp_path):
    assert words in run("models", *arguments, code=2, cwd=tmp_path).stderr
