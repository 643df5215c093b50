"""A threshold is its own scale: multiplying all lengths and thresholds changes no verdict."""

from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.instances.error_correction import random_small
from crosstrack.models import ErrorCorrectionRouting, Route
from crosstrack.solvers.contract.verdict import judge

FACTORS = (1e-9, 1.0, 1e9)
THRESHOLDS = ("alpha1", "alpha2", "beta1", "beta2", "theta")


def scaled(model, factor):
    """Return `model` in another unit of length, errors included."""
    limits = {name: getattr(model, name) * factor for name in THRESHOLDS}
    return replace(model, points=model.points * factor, **limits)


def leg(limit, share):
    """Return a model of one leg, at whose end the error is `share` of the limit."""
    return ErrorCorrectionRouting(
        points=[[0, 0, 0], [share * limit, 0, 0]], kinds=["A", "B"], delta=1,
        **dict.fromkeys(THRESHOLDS, limit),
    )  # fmt: skip


@pytest.mark.parametrize("limit", [1e-300, 1e-9, 1e-3, 1.0, 1e9, 1e150])
@pytest.mark.parametrize(
    ("share", "state"),
    [
        (0.5, "ok"), (1.0, "ok"), (1 + 1e-10, "ok"), (1 + 5e-7, "within tolerance"),
        (1 + 2e-6, "violated"), (1.1, "violated"), (10.0, "violated"),
    ],
)  # fmt: skip
def test_a_violation_is_a_share_of_the_threshold(limit, share, state):
    found = leg(limit, share).verify(Route((0, 1)))
    assert found.summary().partition(":")[0] == state
    checks = {check.name: check for check in found.checks}
    at_the_end = checks["horizontal error at B"]
    assert at_the_end.scale == at_the_end.limit == limit
    assert at_the_end.tolerance == pytest.approx(1e-6 * limit, rel=1e-12)


@pytest.mark.parametrize("limit", [0.0, 5e-324])
def test_a_zero_threshold_has_no_tolerance(limit):
    model = leg(limit, 1.0)
    assert model.verify(Route((0, 1))).ok
    assert not replace(model, points=[[0, 0, 0], [1e-12, 0, 0]]).verify(Route((0, 1))).ok


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(2, 7),
    factor=st.sampled_from((1e-9, 1e9)),
    order=st.permutations(range(7)),
    length=st.integers(0, 5),
)
def test_no_unit_of_length_changes_a_verdict(seed, n, factor, order, length):
    """Of any route, good or not: the same checks hold, and are broken by the same share."""
    model = random_small(n, seed)
    inner = [k for k in order if k < n and k not in (model.start, model.end)]
    plan = Route((model.start, *inner[:length], model.end))
    here, there = model.verify(plan), scaled(model, factor).verify(plan)
    for one, other in zip(here.checks, there.checks, strict=True):
        if one.unit == "error" and abs(one.worst - one.tolerance) < 1e-12 * one.scale:
            continue  # on the edge, where the last digit decides
        assert (one.ok, one.name) == (other.ok, other.name)
        if one.unit == "error" and one.scale:
            assert other.worst / other.scale == pytest.approx(one.worst / one.scale, abs=1e-12)
    assert there.objective == pytest.approx(here.objective * factor, rel=1e-12)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 7), factor=st.sampled_from((1e-9, 1e9)))
def test_native_backends_do_not_depend_on_the_unit_of_length(seed, n, factor):
    model = random_small(n, seed)
    other = scaled(model, factor)
    for backend in ("label-setting", "pulse", "dynamic-programming", "two-stage"):
        here, there = ct.solve(model, backend), ct.solve(other, backend)
        assert here.termination == there.termination
        if here.plan is not None:
            assert there.primal_bound == pytest.approx(here.primal_bound * factor, rel=1e-9)


@pytest.mark.parametrize("factor", FACTORS)
def test_exact_backends_agree_at_every_scale(factor):
    """The programs' solvers as well, whose tolerances are absolute."""
    for seed in range(4):
        model = scaled(random_small(7, seed, name=str(seed)), factor)
        asked = (("label-setting", None), ("highs", "arc-flow"), ("highs", "paper"))
        found = [ct.solve(model, backend, formulation=name) for backend, name in asked]
        verdict = judge(model.name, found, model)
        assert verdict.outcome == "AGREED", verdict
        assert {str(one.termination) for one in found} in ({"optimal"}, {"infeasible"}), found
