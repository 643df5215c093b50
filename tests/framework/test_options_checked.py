"""Options that are no solve's own go through the same validators: tolerance, grace, pool, rate."""

import json
import math
from functools import cache

import numpy as np
import pytest
from framework.commands import run

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData, UnsupportedOption
from crosstrack.instances import export_plan
from crosstrack.models import sampling

BAD = [math.inf, -math.inf, math.nan, 0, -1, 1, 7.0, 10**400, "x", "1e-6", True, None, [1e-6]]
KINDS = (
    "error-correction/example-1",
    "minimum-snap/square",
    "time-allocation/lap-8s",
    "optimal-control/brachistochrone",
    "satellite-slew/paper",
)


@cache
def a_plan(name):
    """Return a plan of the right kind for the model called `name`, good or not."""
    model = ct.load(name)
    if name.startswith("satellite"):
        other = ct.load("optimal-control/brachistochrone")
        return model, ct.solve(other).plan
    if name.startswith("time"):
        square = ct.load("minimum-snap/square")
        return model, ct.solve(square).plan
    return model, ct.solve(model).plan


@pytest.mark.parametrize("name", KINDS)
def test_every_verification_refuses_an_invalid_tolerance(name):
    model, plan = a_plan(name)
    for value in BAD:
        for verify in (
            model.verify,
            lambda plan, tolerance: ct.verify(ct.load(name), plan, tolerance=tolerance),
        ):
            with pytest.raises(
                UnsupportedOption, match="tolerance must be a number > 0 and < 1, got"
            ):
                verify(plan, tolerance=value)


def test_programs_and_pictures_refuse_an_invalid_tolerance():
    route = ct.load("error-correction/example-1")
    control = ct.load("optimal-control/brachistochrone")
    for program in (route.formulate().program, control.formulate().program):
        for value in BAD:
            with pytest.raises(UnsupportedOption, match="tolerance must be"):
                program.verify(np.zeros(program.size), tolerance=value)
    for value in BAD:
        with pytest.raises(UnsupportedOption, match="tolerance must be"):
            ct.plot(control, tolerance=value)
        if value is not None:
            with pytest.raises(UnsupportedOption, match="tolerance must be"):
                ct.solve(route, tolerance=value)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"grace": -5}, "grace must be a number > 0, got -5"),
        ({"grace": 0}, "grace must be a number > 0, got 0"),
        ({"grace": math.nan}, "grace must be"),
        ({"grace": "1"}, "grace must be a number > 0, got '1'"),
        ({"pool": 5}, "pool must be a concurrent.futures.Executor, got int"),
        ({"pool": "threads"}, "pool must be a concurrent.futures.Executor, got str"),
        ({"workers": 0}, "workers must be a whole number >= 1"),
        ({"workers": 1.5}, "workers must be"),
        ({"repeats": True}, "repeats must be"),
        ({"time_limit": -1}, "time_limit must be a number > 0, got -1"),
        ({"time_limit": 10**400}, "time_limit must be"),
        ({"tolerance": 1.0}, "tolerance must be a number > 0 and < 1"),
    ],
)
def test_compare_refuses_options_invalid_for_every_row(asked, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.compare([ct.load("error-correction/example-1")], ["label-setting"], **asked)


@pytest.mark.parametrize("value", [-1, 0, math.nan, math.inf, "x", True])
def test_diagnose_refuses_an_invalid_time_limit(value):
    with pytest.raises(UnsupportedOption, match="time_limit must be a number > 0, got"):
        ct.diagnose(ct.load("error-correction/example-1"), time_limit=value)


@pytest.mark.parametrize("rate", [1e9, 1e308, math.nan, math.inf, 0, -1, "x", True, None, 10**400])
@pytest.mark.parametrize("name", ["minimum-snap/square", "optimal-control/brachistochrone"])
def test_a_rate_of_too_many_samples_is_refused(name, rate, tmp_path):
    model, plan = a_plan(name)
    with pytest.raises(InvalidData, match="rate must"):
        export_plan(model, plan, tmp_path / "a.csv", "samples", rate=rate)
    assert not list(tmp_path.iterdir())


def test_a_very_long_time_limit_is_accepted(recwarn):
    found = ct.solve(ct.load("error-correction/example-1"), "label-setting", time_limit=1e300)
    assert found.termination == "optimal" and not recwarn.list


def test_as_many_samples_as_are_allowed():
    most = sampling.MOST_SAMPLES
    assert sampling.sample_count(1.0, most - 1) == most - 1
    with pytest.raises(InvalidData, match=f"at most {most} samples, got {most}: 1e.06 samples"):
        sampling.sample_count(1.0, most)


COMMANDS = [
    *(["check", "M", "P", "--tolerance", value] for value in ("inf", "nan", "0", "-1", "1", "x")),
    *(["export", "M", "P", "--output", "O", "--tolerance", value] for value in ("inf", "nan", "0")),
    *(["export", "M", "P", "--output", "O", "--format", "samples", "--rate", value]
      for value in ("1e9", "nan", "0", "-1", "inf")),
    ["solve", "M", "--tolerance", "inf"],
    ["compare", "M", "banded", "--grace", "-5"],
    ["compare", "M", "banded", "--grace", "nan"],
    ["compare", "M", "banded", "--workers", "0"],
    ["compare", "M", "banded", "--repeats", "0"],
    ["compare", "M", "banded", "--time-limit", "nan"],
    ["diagnose", "M", "--time-limit", "-1"],
    ["reproduce", "error-correction", "--rows", "1", "--time-limit", "-1"],
    ["demo", "--time-limit", "nan"],
]  # fmt: skip


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    model, plan = a_plan("minimum-snap/square")
    path = tmp_path_factory.mktemp("plans") / "plan.json"
    path.write_text(json.dumps(model.plan_to_data(plan)))
    return str(path)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_the_command_line_refuses_with_code_2(words, stored, tmp_path):
    target = tmp_path / "out.csv"
    meant = {"M": "minimum-snap/square", "P": stored, "O": str(target)}
    found = run(*(meant.get(word, word) for word in words), code=2)
    assert "Traceback" not in found.stderr and len(found.stderr.strip().splitlines()) <= 4
    assert not target.exists()


def test_every_message_names_option_value_and_what_is_allowed():
    for value in BAD:
        with pytest.raises(CrosstrackError) as raised:
            ct.verify(ct.load("error-correction/example-1"), [0, 1], tolerance=value)
        said = str(raised.value)
        assert said.startswith("tolerance must be a number > 0 and < 1, got ") and len(said) < 120
