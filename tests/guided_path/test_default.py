"""Backend that "auto" selects for tours along a path, and its starter."""

from __future__ import annotations

import pytest
from guided_path.enumerated import chains_tour

import crosstrack as ct
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.walks import reduced
from crosstrack.solvers.contract.selection import recommended


@pytest.mark.parametrize("as_pairs", [False, True])
def test_two_chains_prefer_the_dynamic_program(as_pairs):
    model = chains_tour(2, 20, 1)
    if as_pairs:
        model = GuidedPathTour(model.coordinates, precedence=model.pairs)
    assert recommended(model).name == "dynamic-programming"
    assert recommended(chains_tour(3, 20, 1)).name == "a-star"
    crossed = GuidedPathTour([0, 1, 2, 3, 4], precedence=[(1, 2), (3, 4), (1, 4)])
    assert recommended(crossed).name == "a-star"


@pytest.mark.parametrize("chains", [pytest.param(5, marks=pytest.mark.slow), 50])
def test_the_default_is_no_worse_than_its_starter_on_large_tours(chains):
    model = chains_tour(chains, 2000 // chains, 1)
    first = ct.solve(model, "insert-nearest")
    found = ct.solve(model, time_limit=1.0)
    assert found.primal_bound <= first.primal_bound
    objectives = [one.objective for one in found.incumbents]
    assert objectives == sorted(objectives, reverse=True)


def test_the_smaller_model_is_computed_once():
    model = chains_tour(5, 20, 1)
    assert reduced(model) is reduced(model)
    assert reduced(model, passing=False) is not reduced(model)
