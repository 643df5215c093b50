"""Files of guided tours with optional fields: tables of stops, exports and refusals."""

import csv
import json

import pytest
from guided_path.extended import CASES, random_extended

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances import read_model
from crosstrack.instances.guided_path import read_stops, write_sop, write_stops_csv, write_tour
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan

STOPS = """id,coordinate,chain,load,service [min],earliest,latest [h]
dock,0,,1,,5,
fetch,12.5,job,1,0.5,,1
bring,3,job,-1,,10,
"""


def test_columns_become_fields(tmp_path):
    path = tmp_path / "stops.csv"
    path.write_text(STOPS)
    data = read_stops(path)
    assert data["loads"] == [1, 1, -1]
    assert data["service"] == [0, 30, 0]
    assert data["windows"] == [(5, None), (0, 3600), (10, None)]
    file = tmp_path / "instance.json"
    extra = {"speed": 2.0, "capacity": 2.0, "end": "free"}
    file.write_text(
        json.dumps({"model": "guided-path-tour", "data": {"coordinates": "stops.csv", **extra}})
    )
    model = read_model(file)
    solution = ct.solve(model)
    assert solution.primal_bound == 22.0
    assert solution.verification.ok


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("dock,0,,1", "dock,0,,many", "load"),
        ("0.5,,1", "-0.5,,1", "service"),
        (",0.5,,1", ",0.5,7000,1", "windows"),
        ("latest [h]", "latest [m]", "latest"),
    ],
)
def test_errors_in_columns_name_them(tmp_path, old, new, text):
    path = tmp_path / "stops.csv"
    path.write_text(STOPS.replace(old, new))
    file = tmp_path / "instance.json"
    file.write_text(
        json.dumps({"model": "guided-path-tour", "data": {"coordinates": "stops.csv", "speed": 1}})
    )
    with pytest.raises(InvalidData, match=text):
        read_model(file, trusted=True)


@pytest.mark.parametrize("fields", CASES, ids=["+".join(case) for case in CASES])
def test_exports_state_the_length_or_refuse(tmp_path, fields):
    model = next(m for k in range(50) if ct.solve(m := random_extended([k, 8], fields)).plan)
    plan = ct.solve(model).plan
    text = write_stops_csv(plan, tmp_path / "plan.csv", model=model).read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert float(rows[-1]["walked"]) == model.verify(plan).objective
    assert ("begin" in rows[0], "load" in rows[0]) == (
        model.speed is not None,
        model.loads is not None,
    )
    assert ("vehicle" in rows[0]) == (model.vehicles is not None)
    with pytest.raises(UnsupportedFormulation, match="does not cover the fields"):
        write_sop(model, tmp_path / "line.sop")
    with pytest.raises(UnsupportedFormulation, match="does not cover the fields"):
        write_tour(plan, tmp_path / "line.tour", model=model)
    wrong = GuidedPathPlan(plan.order, () if plan.vehicles else [0] * len(plan.order))
    with pytest.raises(InvalidData, match="vehicles"):
        write_stops_csv(wrong, tmp_path / "plan.csv", model=model)


def test_the_last_row_is_the_end(tmp_path):
    model = GuidedPathTour([0, 4, 2], loads=[1, 2, 3], end="free", ids=["dock", "a", "b"])
    plan = GuidedPathPlan((2, 1))
    rows = model.details(plan)
    assert [row["customer"] for row in rows] == ["dock", "b", "a", "end"]
    assert [row["load"] for row in rows] == [1, 4, 6, 6]
    text = write_stops_csv(plan, tmp_path / "plan.csv", model=model).read_text("utf-8")
    assert text.splitlines()[-1] == "3,end,4.0,4.0,6.0"
    closed = GuidedPathTour([0, 4, 2], loads=[1, 2, -1], vehicles=[0, 9])
    assert [row["load"] for row in closed.details(GuidedPathPlan((1, 2), (1, 0)))] == [1, 3, 0, 0]
    idle = closed.details(GuidedPathPlan((1, 2), (1, 1)))
    assert [row["load"] for row in idle] == [1, 3, 2, 1]
