"""Files that earlier versions wrote are read, and mean the same."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from listening import solutions

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import read_bezier, read_plan, read_poly7, write_model
from crosstrack.solvers import Solution

STORED = Path(__file__).parent / "data" / "version-0.1"
NAMES = sorted({path.name.partition(".model.json")[0] for path in STORED.glob("*.model.json*")})


def stored_model(name, folder):
    """Return a model of version 0.1, which wrote functions as CasADi's own text."""
    packed = STORED / f"{name}.model.json.gz"
    if not packed.exists():
        return ct.load(STORED / f"{name}.model.json", trusted=True)
    path = folder / f"{name}.model.json"
    path.write_bytes(gzip.decompress(packed.read_bytes()))
    return ct.load(path, trusted=True)


def test_every_kind_of_model_is_stored():
    assert {json.loads(path.read_text())["model"] for path in STORED.glob("*.solution.json")} == {
        *("error-correction", "minimum-snap", "time-allocation", "optimal-control"),
        *("satellite-slew", "mixed-integer-program", "quadratic-program", "nonlinear-program"),
    }


@pytest.mark.parametrize("name", NAMES)
def test_a_model_its_plan_and_its_solution(name, tmp_path):
    model = stored_model(name, tmp_path)
    data = json.loads((STORED / f"{name}.solution.json").read_text("utf-8"))
    assert model.digest == data["digest"]
    solution = Solution.from_dict(data, model)
    assert {key: value for key, value in solution.to_dict().items() if key in data} == data
    alone = STORED / f"{name}.plan.json"
    plan = read_plan(model, alone if alone.exists() else STORED / f"{name}.solution.json")
    # Version 0.1 held a limit of 0.125 rad/s against 1 rad/s.
    tolerance = data["options"]["tolerance"] * (8 if name == "slew" else 1)
    for one in (plan, solution.plan):
        found = model.verify(one, tolerance=tolerance)
        assert found.ok, found
        # An integral is as exact as the integrator, and its steps follow the machine.
        assert found.objective == pytest.approx(data["primal_bound"], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", ["control", "nlp"])
def test_functions_of_version_01_are_read_with_consent_and_written_as_graphs(name, tmp_path):
    model = stored_model(name, tmp_path)
    path = write_model(model, tmp_path / "new.json")
    assert ct.load(path).digest == model.digest
    with pytest.raises(InvalidData, match=r"function.*CasADi's own text.*trusted=True.*--trusted"):
        ct.load(STORED / "control.model.json")


def test_files_for_other_software():
    model = ct.load(STORED / "trajectory.model.json")
    plan = read_plan(model, STORED / "trajectory.plan.json")
    times = np.linspace(plan.times[0], plan.duration * (1 - 1e-7), 50)
    assert np.array_equal(read_bezier(STORED / "trajectory.bezier.json").times, plan.times)
    assert read_bezier(STORED / "trajectory.bezier.json")(times) == pytest.approx(plan(times))
    flown = read_poly7(STORED / "trajectory.poly7.csv")
    dimension = plan(times).shape[-1]
    # Four-byte floats hold seven digits.
    assert flown(times)[..., :dimension] == pytest.approx(plan(times), abs=1e-5)


def test_a_campaign_continues_without_repeating_runs(tmp_path):
    record = tmp_path / "campaign.jsonl"
    shutil.copy(STORED / "campaign.jsonl", record)
    models = [ct.load("error-correction/example-1"), ct.load("error-correction/3")]
    names = ["label-setting", "two-stage", "dynamic-programming"]
    anew = []
    result = ct.compare(
        models, names, time_limit=30, record=record, resume=True, on_event=solutions(anew.append)
    )
    assert anew == []
    assert result.outcome == "AGREED"
    assert len(result.solutions) == 6
    assert record.read_bytes() == (STORED / "campaign.jsonl").read_bytes()
