"""Corrections that may fail, and limits on corrections: checks, programs, files, the chance of arrival."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances.error_correction import random_small, read_csv, write_csv
from crosstrack.models import Route

PUBLIC = Path(__file__).parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
#: Rows of the public points with residual 5: thresholds, length, corrections.
ROWS = {
    7: ((20, 10, 15, 20, 20), 161650.410, 21),
    8: ((25, 15, 20, 25, 30), 108149.397, 11),
    9: ((50, 50, 50, 50, 50), 103362.905, 4),
}


def drawn(seed, revisits=False):
    """A small model with suspect points, a residual of 0 to a limit, or beyond."""
    rng = np.random.default_rng([161, seed])
    model = random_small(int(rng.integers(3, 8)), seed, revisits=revisits)
    suspect = (rng.random(len(model.points)) < 0.5) & (model.codes != 0) & (model.codes != 3)
    highest = float(model.limits.max())
    residual = float(rng.choice([0.0, 0.1, 0.3, 0.6, 1.5])) * highest
    return replace(model, suspect=suspect, residual=residual, success=float(rng.random()))


def routes(model):
    """Every simple route from A to B."""
    inner = [k for k in range(len(model.points)) if k not in (model.start, model.end)]
    for count in range(len(inner) + 1):
        for between in itertools.permutations(inner, count):
            yield Route((model.start, *between, model.end))


def best(model, exactly=False):
    """The least length over all simple routes within the thresholds, by a walk of its own.

    `exactly` takes each correction that fails to leave the residual, and no less.
    """
    least = math.inf
    rates = (model.horizontal_rate, model.vertical_rate)
    for route in routes(model):
        errors, length, good = [0.0, 0.0], 0.0, True
        for i, j in itertools.pairwise(route.route):
            leg = math.dist(model.points[i], model.points[j])
            length += leg
            errors = [e + rate * leg for e, rate in zip(errors, rates, strict=True)]
            limit = model.limits[model.codes[j]]
            good &= all(e <= m * (1 + 1e-9) for e, m in zip(errors, limit, strict=True))
            axis = {"horizontal": 0, "vertical": 1}.get(str(model.kinds[j]))
            if axis is not None:
                left = model.residual if model.suspect[j] else 0.0
                errors[axis] = left if exactly else min(errors[axis], left)
        if good:
            least = min(least, length)
    return least


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(0, 60, 2))
def test_exact_by_labels_and_by_a_program(seed):
    model = drawn(seed)
    wanted = best(model)
    # A failed correction may be assumed to leave exactly the residual.
    assert best(model, exactly=True) == pytest.approx(wanted, rel=1e-12)
    for backend in ("auto", "highs") if seed < 24 else ("auto",):
        found = ct.solve(model, backend)
        if math.isinf(wanted):
            assert str(found.termination) == "infeasible"
        else:
            assert found.primal_bound == pytest.approx(wanted, rel=1e-9)
            assert str(found.termination) == "optimal"


@given(st.integers(0, 10**6), st.randoms(use_true_random=False))
@settings(max_examples=40, deadline=None)
def test_the_general_model_has_the_same_verification(seed, draw):
    model = drawn(seed)
    for route in draw.sample(list(routes(model)), k=2):
        one, other = model.verify(route), model.lower().verify(route)
        assert one.ok == other.ok
        assert one.objective == pytest.approx(other.objective, rel=1e-12)


@given(st.integers(0, 10**6), st.randoms(use_true_random=False))
@settings(max_examples=40, deadline=None)
def test_chance_of_arrival_counts_every_outcome(seed, draw):
    model = drawn(seed)
    route = draw.choice(list(routes(model)))
    unsure = [k for k in route if model.suspect[k]]
    chance = 0.0
    for outcome in itertools.product((True, False), repeat=len(unsure)):
        share = math.prod(model.success if one else 1 - model.success for one in outcome)
        works = dict(zip(unsure, outcome, strict=True))
        errors, good = [0.0, 0.0], True
        for i, j in itertools.pairwise(route.route):
            leg = math.dist(model.points[i], model.points[j])
            errors = [
                errors[0] + model.horizontal_rate * leg,
                errors[1] + model.vertical_rate * leg,
            ]
            good &= bool((errors <= model.limits[model.codes[j]] * (1 + 1e-9)).all())
            axis = {"horizontal": 0, "vertical": 1}.get(str(model.kinds[j]))
            if axis is not None:
                errors[axis] = 0.0 if works.get(j, True) else min(errors[axis], model.residual)
        chance += share * good
    assert model.walk(route)[-1].chance == pytest.approx(chance, abs=1e-12)
    if model.verify(route).ok:
        assert model.walk(route)[-1].chance == pytest.approx(1.0)


@pytest.mark.skipif(not PUBLIC.exists(), reason="the public points are not at hand")
@pytest.mark.parametrize("row", ROWS)
def test_public_rows(row):
    thresholds, length, corrections = ROWS[row]
    names = ("alpha1", "alpha2", "beta1", "beta2", "theta")
    data = dict(zip(names, map(float, thresholds), strict=True))
    model = read_csv(PUBLIC, **data, delta=0.001, residual=5)
    found = ct.solve(model)
    assert str(found.termination) == "optimal"
    assert found.primal_bound == pytest.approx(length, abs=5e-4)
    assert found.plan.corrections == corrections
    assert f"({corrections} corrections)" in str(found)
    # Without the residual the column counts for nothing.
    assert read_csv(PUBLIC, **data, delta=0.001).suspect is None


def test_limit_on_corrections_is_checked_and_kept():
    model = ct.load("error-correction/example-1")
    free = ct.solve(model)
    tight = replace(model, corrections_limit=free.plan.corrections - 1)
    assert not tight.verify(free.plan).ok
    for backend, formulation in (("auto", None), ("highs", "arc-flow"), ("highs", "paper")):
        found = ct.solve(tight, backend, formulation=formulation)
        assert found.plan is None or found.plan.corrections < free.plan.corrections
        assert str(found.termination) == str(ct.solve(tight).termination)
        same = ct.solve(
            replace(model, corrections_limit=free.plan.corrections),
            backend,
            formulation=formulation,
        )
        assert same.primal_bound == pytest.approx(free.primal_bound, rel=1e-9)


def test_paper_and_old_searches_refuse_suspects():
    model = next(m for m in map(drawn, range(99)) if not m.is_plain)
    with pytest.raises(UnsupportedFormulation, match="may fail"):
        model.formulate("paper")
    with pytest.raises(UnsupportedFormulation, match="take resource-labelling"):
        ct.solve(model, "pulse")
    assert ct.diagnose(model).feasible is (ct.solve(model).plan is not None)


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"suspect": [True] * 5, "residual": 1.0}, "suspect"),
        ({"suspect": [False, True, False, False, False]}, "residual"),
        ({"suspect": [False, True], "residual": 1.0}, "suspect"),
        ({"residual": -1.0}, "residual"),
        ({"success": 1.5}, "success"),
        ({"corrections_limit": -1}, "corrections_limit"),
        ({"corrections_limit": 1.5}, "corrections_limit"),
    ],
)
def test_bad_fields(fields, field):
    with pytest.raises(InvalidData) as raised:
        replace(ct.load("error-correction/example-1"), **fields)
    assert raised.value.field == field


def test_files_hold_which_corrections_may_fail(tmp_path):
    model = next(m for m in map(drawn, range(99)) if m.suspect.any())
    model = replace(model, residual=0.5, success=0.0)
    file = write_csv(model, tmp_path / "points.csv")
    limits = {
        name: getattr(model, name) for name in ("alpha1", "alpha2", "beta1", "beta2", "theta")
    }
    rates = {name: getattr(model, name) for name in ("horizontal_rate", "vertical_rate")}
    again = read_csv(file, **limits, **rates, residual=0.5)
    assert again == model
    text = file.read_text().replace(",1\n", ",maybe\n", 1)
    file.write_text(text)
    with pytest.raises(InvalidData, match="column fail: must be 1 or 0, got 'maybe'"):
        read_csv(file, **limits, **rates)
