"""Infeasible problems: rejection before a search, termination of a search, and diagnosis."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from control_motions import COARSE, push

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import Model, OptimalControlProblem


def undriven() -> OptimalControlProblem:
    ocp = OptimalControlProblem("undriven")
    phase = ocp.phase()
    x, v = phase.state("x", initial=0), phase.state("v")
    phase.dynamics({x: v})
    ocp.minimise(phase.end)
    return ocp


def misshapen() -> OptimalControlProblem:
    ocp = OptimalControlProblem("misshapen")
    phase = ocp.phase()
    q, u = phase.state("q", 3, initial=[0, 0, 0]), phase.control("u", 2)
    phase.dynamics({q: u})
    return ocp


def wrong_ends() -> OptimalControlProblem:
    ocp = OptimalControlProblem("wrong ends")
    ocp.phase().state("q", 3, initial=[0, 0])
    return ocp


@pytest.mark.parametrize(
    ("declare", "words"),
    [
        (lambda: push(1, (1, None)), ["end of phase 'phase 1'"]),
        (lambda: push(1, (1, np.inf)), ["end of phase 'phase 1'", "finite"]),
        (undriven, ["v", "dynamics"]),
        (misshapen, ["dynamics of 'q'", "3 entries", "got 2"]),
        (wrong_ends, ["initial value of 'q'", "(2,)"]),
    ],
)
def test_rejects_unsolvable_problems_before_a_search(declare, words):
    with pytest.raises(InvalidData) as error:
        ct.solve(declare())
    for word in words:
        assert word in str(error.value)


def test_too_far_for_the_time_is_locally_infeasible():
    answer = ct.solve(push(1.0), formulation_options=COARSE)
    assert answer.termination == "locally_infeasible"
    assert answer.plan is None and answer.primal_bound is None
    assert "violated most: dynamics of x" in answer.message
    assert "interval" in answer.message


@pytest.mark.slow
def test_the_infeasible_slew_is_locally_infeasible_in_the_papers_words():
    answer = ct.solve(ct.load("satellite-slew/infeasible"), time_limit=60)
    assert answer.termination == "locally_infeasible"
    assert "violated most: eq. 3 and 10, dynamics of q[1]" in answer.message


@pytest.mark.slow
def test_diagnose_explains_the_infeasible_slew():
    found = ct.diagnose(ct.load("satellite-slew/infeasible"), time_limit=60)
    assert found.feasible is False
    # With the limited torque it takes at least 8.39 s, but 8 s are allowed.
    assert any("end time" in finding.text for finding in found.findings)


def given_way(model: Model[Any]) -> dict[str, float]:
    """Return the limits that diagnose relaxes, and by how much."""
    found = ct.diagnose(model)
    assert found.feasible is False
    return {str(one.data["block"]): float(one.data["by"]) for one in found.findings if one.data}


def test_diagnose_names_limit_time_and_end_with_their_shortfall():
    # With |u| <= 1 a second is good for 1/4 m; 1 m takes 2 s, or |u| <= 4.
    gives = given_way(push(1.0))
    assert gives == pytest.approx({"final value of x": 0.75, "end time": 1.0, "u": 3.0}, rel=1e-3)
    # Up to 0.9 m/s at 8 m/s²: 0.9 (1 - 0.9/8) m. Relaxing u alone is not enough, so u is not named.
    gives = given_way(push(8.0, speed=0.9))
    want = {
        "final value of x": 1 - 0.9 * (1 - 0.9 / 8),
        "end time": 1 / 0.9 + 0.9 / 8 - 1,
        "v": 4 - 2 * math.sqrt(2) - 0.9,
    }
    assert gives == pytest.approx(want, rel=0.02)


def test_diagnose_states_units_and_bounds():
    found = ct.diagnose(push(1.0, (0.5, 1.0)))
    text = str(found)
    assert "u: the limits -1 to 1 m/s² would have to give by 3 m/s²" in text
    assert "final value of x: the value 1 m would have to give by 0.75 m" in text
    assert "end time: the limits 0.5 to 1 s would have to give by 1 s" in text


@pytest.mark.parametrize("strength", [4.05, 10.0])
def test_diagnose_finds_an_existing_motion(strength):
    found = ct.diagnose(push(strength))
    assert found.feasible is True
    assert found.findings == ()


def test_diagnose_without_time_is_undecided():
    found = ct.diagnose(push(1.0), time_limit=1e-3)
    assert found.feasible is None
    assert "not settled" in found.summary


@pytest.mark.parametrize("backend", ["highs", "ipopt"])
def test_diagnose_rejects_backends_that_filter_linear_rows(backend):
    with pytest.raises(UnsupportedFormulation):
        ct.diagnose(push(1.0), backend)
