"""Diagnoses of guided path tours, which always exist."""

import itertools

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, extensions, random_tour

import crosstrack as ct
from crosstrack.models import GuidedPathTour
from crosstrack.solvers import Diagnosis


def test_the_papers_example():
    model = GuidedPathTour(
        [0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]], ids=["hub", "a", "b", "c", "d"], name="example"
    )
    found = ct.diagnose(model)
    assert found.feasible
    assert str(found) == (
        "example: a plan exists, as whoever must precede can always be served first; no tour is "
        "shorter than 8 m, 1 times the way to both ends and back\n"
        "  - at most 2 customers are in no order among themselves; the longest chain has 2: c -> a\n"
        "  - no gap need be crossed more than once there and once back"
    )
    assert Diagnosis.from_dict(found.to_dict()) == found


def test_the_forcing_customers_are_listed():
    model = GuidedPathTour([0, 10, 2, 8, 4, 5], chains=[[1, 2, 3, 4]], precedence=[(4, 5)])
    relation, *stretches = ct.diagnose(model).findings
    assert relation.text == "there is only one order: 1 -> 2 -> 3 -> 4 -> 5"
    assert relation.data == {"width": 1, "longest": [1, 2, 3, 4, 5]}
    assert [one.data for one in stretches] == [
        {"from": 4.0, "to": 5.0, "crossings": 6, "customers": [1, 2, 3, 4, 5]},
        {"from": 2.0, "to": 8.0, "crossings": 4, "customers": [1, 2, 3]},
    ]
    assert stretches[0].text == (
        "between 4 m and 5 m every tour passes at least 6 times: customers 1 -> 2 -> 3 -> 4 -> 5 are "
        "on its two sides in turn"
    )


@pytest.mark.parametrize("seed", range(60))
def test_findings_hold_for_all_tours(seed):
    model = random_tour(seed, most=7)
    found = ct.diagnose(model)
    assert found.feasible
    assert len(found.findings) <= 6
    relation, *stretches = found.findings
    assert relation.data["width"] == len(model.cover)
    longest = relation.data["longest"]
    closure = model.closure
    assert all(closure[a, b] for a, b in itertools.pairwise(longest))
    antichains = (
        set(one) for size in range(1, model.size)
        for one in itertools.combinations(range(1, model.size), size)
        if not closure[np.ix_(one, one)].any()
    )  # fmt: skip
    assert max(map(len, antichains)) == relation.data["width"]
    stops = model.coordinates[np.pad(extensions(model), ((0, 0), (1, 1)))]
    for one in stretches:
        if one.data is None:
            assert len(stretches) == 1
            continue
        assert one.data["from"] < one.data["to"]
        between = stops > one.data["from"]
        changes = (between[:, :-1] != between[:, 1:]).sum(axis=1)
        assert changes.min() >= one.data["crossings"]


def test_the_bound_is_below_all_tours():
    for seed in range(40):
        model = random_tour(seed, kind="integers")
        data = ct.diagnose(model).summary
        bound = float(data.partition("shorter than ")[2].split(" m")[0])
        assert bound <= best(model)


def test_many_customers_are_named_in_part():
    found = ct.diagnose(chains_tour(2, 40, 1))
    assert "and 28 more" in found.findings[0].text
    assert len(found.findings[0].data["longest"]) == 40
