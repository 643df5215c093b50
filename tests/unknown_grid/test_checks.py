"""Verification of runs, and detection of manipulated plans."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.scenes import fewest, models
from unknown_grid.walks import PlainWorld

import crosstrack as ct
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns, Outcome

STEPS = "at most as many steps as allowed"
ENDS = "a run ends at the target"
THERE = "the target is where the run ends"
NO_WAY = "there is no way"
MISSED = "the target was not reached"

OPEN, SHUT = ["S..", "..T"], ["S@.", ".@T"]


def scenes(*drawings, steps=6):
    return UnknownGridNavigation.drawn(*drawings, view=(3, 3), steps=steps)


@pytest.mark.parametrize(
    ("drawing", "run", "outcome", "cost", "broken"),
    [
        (OPEN, "RRD", "reached", 3, ()),
        (OPEN, "URRD", "reached", 4, ()),  # the first step is a collision
        (OPEN, "RLRLRR", "reached", 7, (THERE,)),
        (OPEN, "RRLRDU", "gave up", 7, (ENDS,)),
        (OPEN, "RRDD", "reached", 4, (ENDS,)),  # stays at the target by a collision
        (OPEN, "RRDLR", "reached", 5, (ENDS,)),
        (OPEN, "LLLLRRD", "reached", 7, (STEPS,)),
        (OPEN, "RRD", "gave up", 7, (MISSED,)),
        (OPEN, "RRD", "out of steps", 7, (MISSED,)),
        (OPEN, "RRD", "no way", 7, (NO_WAY,)),
        (OPEN, "RR", "no way", 7, (NO_WAY,)),
        (OPEN, "RR", "reached", 7, (THERE,)),
        (OPEN, "", "reached", 7, (THERE,)),
        (OPEN, "RR", "out of steps", 7, (MISSED,)),
        (OPEN, "RRRRRR", "out of steps", 7, ()),
        (OPEN, "R" * 7, "out of steps", 7, (STEPS,)),
        (OPEN, "RR", "gave up", 7, ()),
        (SHUT, "", "no way", 0, ()),
        (SHUT, "D", "no way", 1, ()),
        (SHUT, "D", "gave up", 7, ()),
        (SHUT, "RRD", "reached", 7, (THERE,)),  # through the wall
        (SHUT, "D" * 7, "no way", 7, (STEPS,)),
    ],
)
def test_each_run_matches_its_outcome(drawing, run, outcome, cost, broken):
    model = scenes(drawing)
    checked = model.verify(NavigationRuns((run,), (outcome,)))
    assert checked.objective == cost
    assert tuple(one.name for one in checked.checks if not one.ok) == broken
    assert checked.ok is (not broken)


def test_a_check_names_the_scene_and_counts_them():
    model = scenes(OPEN, OPEN, SHUT, OPEN, steps=4)
    plan = NavigationRuns(("RRD", "RR", "", "RRDUDUD"), ("reached", "reached", "no way", "reached"))
    checked = {one.name: one for one in model.verify(plan).checks}
    assert (checked[THERE].worst, checked[THERE].where) == (1.0, "scene 1")
    assert (checked[STEPS].worst, checked[STEPS].where) == (3.0, "scene 3")
    assert (checked[ENDS].worst, checked[ENDS].where) == (1.0, "scene 3")
    assert checked[NO_WAY].ok and checked[MISSED].ok
    assert model.verify(plan).objective == (3 + 5 + 0 + 7) / 4
    both = model.verify(NavigationRuns(("",) * 4, ("no way",) * 4)).checks
    assert [one.worst for one in both if one.name == NO_WAY] == [3.0]


def test_no_tolerance_excuses_a_step():
    plan = NavigationRuns(("R" * 7,), ("out of steps",))
    assert not scenes(OPEN).verify(plan, tolerance=0.999).ok
    assert scenes(OPEN, steps=7).verify(plan, tolerance=1e-12).ok


@settings(max_examples=40, deadline=None)
@given(model=models(scenes=3), data=st.data())
def test_measures_are_those_of_the_rules(model, data):
    """Objective, checks and score of any plan equal those of an independent simulator."""
    runs = tuple(data.draw(st.text("UDLR", max_size=45)) for _ in range(model.scenes))
    outcomes = tuple(data.draw(st.sampled_from(list(Outcome))) for _ in range(model.scenes))
    costs, right, reached, hits, ratios = [], [], 0, 0, []
    ways = zip(model.blocked, model.starts.tolist(), model.targets.tolist(), strict=True)
    least = [fewest(*one) for one in ways]
    for k, (run, outcome) in enumerate(zip(runs, outcomes, strict=True)):
        plain, early = PlainWorld(model, k), False
        for letter in run:
            early |= plain.at == plain.target
            plain.act("UDLR".index(letter))
        there = plain.at == plain.target
        true = {
            "reached": there,
            "no way": least[k] == math.inf,
            "gave up": not there,
            "out of steps": not there and len(run) >= model.steps,
        }[outcome]
        done = true and outcome in ("reached", "no way")
        costs.append(len(run) if done else model.steps + 1)
        right.append(true and not early and len(run) <= model.steps)
        hits += plain.hit
        if there:
            reached += 1
            ratios.append(len(run) / least[k])
    plan = NavigationRuns(runs, outcomes)
    checked = ct.verify(model, plan)
    assert checked.objective == pytest.approx(np.mean(costs))
    assert checked.ok is all(right)
    assert model.fewest_steps().tolist() == least
    score = model.score(plan)
    assert score[:3] == (model.scenes, reached, hits)
    assert score.ratio == pytest.approx(np.mean(ratios) if ratios else math.nan, nan_ok=True)
