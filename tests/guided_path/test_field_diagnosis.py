"""Diagnoses of guided tours with optional fields: the limits that exclude every plan."""

import dataclasses

import numpy as np
import pytest
from guided_path.extended import CASES, best_extended, random_extended

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.models import GuidedPathTour
from crosstrack.solvers.guided_path import field_diagnosis


def test_a_late_customer_is_named():
    model = GuidedPathTour(
        [0, 10, 4],
        chains=[[1, 2]],
        speed=2,
        windows=[[0, None], [0, 9], [0, 7]],
        ids=["dock", "a", "b"],
    )
    found = ct.diagnose(model)
    assert found.feasible is False
    (finding,) = found.findings
    assert finding.text == "customer b cannot be served before 8 s, its latest time is 7 s"
    assert finding.data == {"customer": 2, "begin": 8.0, "latest": 7.0}


def test_windows_that_exclude_each_other_are_named():
    model = GuidedPathTour([0, 10, -10, 5], speed=1, windows=[[0, None], [0, 12], [0, 15], [0, 99]])
    found = ct.diagnose(model)
    assert found.feasible is False
    assert found.summary.endswith("each of them is needed for that")
    assert [one.where for one in found.findings] == ["windows[1]", "windows[2]"]


def test_loads_that_exclude_every_plan_are_named():
    found = ct.diagnose(GuidedPathTour([0, 1, 2], loads=[0, 2, 2], capacity=3))
    assert [one.where for one in found.findings] == ["loads"]
    assert "is 4 in all, it must be in 0 … 3" in found.findings[0].text
    stuck = GuidedPathTour(
        [0, 1, 2, 3, 4], chains=[[1, 2, 3, 4]], loads=[0, 1, 1, -1, -1], capacity=1
    )
    assert [one.where for one in ct.diagnose(stuck).findings] == ["capacity"]
    empty = GuidedPathTour([0, 1, 2], chains=[[1, 2]], loads=[0, -1, 1])
    assert [one.where for one in ct.diagnose(empty).findings] == ["loads"]


def test_a_feasible_model_has_a_plan():
    found = ct.diagnose(GuidedPathTour([0, 1, 2], end="free", loads=[0, 1, 1], capacity=3))
    assert found.feasible
    assert found.summary == "a plan exists, 2 m long; none is shorter than 2 m"


@pytest.mark.parametrize(
    "fields", [("windows",), ("loads",), ("loads", "windows"), ("vehicles", "loads")]
)
def test_diagnoses_agree_with_enumeration(fields):
    assert fields in CASES
    excluded = 0
    for seed in range(12):
        model = random_extended([seed, 21], fields)
        found = ct.diagnose(model)
        assert found.feasible == (best_extended(model) < np.inf), model.data()
        if not found.feasible:
            excluded += 1
            assert found.findings
        if "each of them" in found.summary and "windows" in fields:
            # Without one of these limits a plan exists if all other limits are removed.
            needed = {
                int(one.where[8:-1]) for one in found.findings if one.where.startswith("windows")
            }
            limits = {one.where for one in found.findings} - {f"windows[{k}]" for k in needed}
            for k in needed:
                windows = model.windows.copy()
                windows[[c for c in range(model.size) if c == k or c not in needed], 1] = np.inf
                relaxed = dataclasses.replace(model, windows=windows)
                if not limits:
                    relaxed = dataclasses.replace(relaxed, loads=None, capacity=None)
                    assert best_extended(relaxed) < np.inf
    assert excluded


def test_models_too_large_for_the_search_are_refused():
    model = GuidedPathTour(np.arange(3002), loads=np.zeros(3002), capacity=1)
    with pytest.raises(UnsupportedFormulation, match="3001 customers: at most 3000"):
        ct.diagnose(model)


def test_few_limits_among_many_are_found_by_few_searches(monkeypatch):
    windows = [[0, None], [0, 12], [0, 15], *[[0, 900]] * 60]
    model = GuidedPathTour([0, 10, -10, *[5] * 60], chains=[range(3, 63)], speed=1, windows=windows)
    calls, search = [], field_diagnosis._search
    monkeypatch.setattr(
        field_diagnosis, "_search", lambda *given: calls.append(1) or search(*given)
    )
    found = ct.diagnose(model)
    assert [one.where for one in found.findings] == ["windows[1]", "windows[2]"]
    assert len(calls) < 30
