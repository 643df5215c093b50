"""Random corridors, and the structured interior point beside other solvers on them."""

import math
from dataclasses import replace

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models.minimum_snap import MinimumDerivative

OURS = "interior-point"
INF = math.inf


def solved(model, **options):
    """Return our solution, its bounds checked against one another."""
    answer = ct.solve(model, OURS, **options)
    if answer.primal_bound is not None and answer.dual_bound is not None:
        assert answer.dual_bound <= answer.primal_bound + 1e-7 * abs(answer.primal_bound) + 1e-7, (
            answer
        )
    return answer


def agree(model, *others, rel=1e-6):
    """Solve with ours and with others; all must be optimal and alike."""
    ours = solved(model)
    assert ours.termination == "optimal", ours
    assert ours.verification.ok
    assert ours.gap <= 1.1e-6
    for name in others:
        other = ct.solve(model, name, formulation="legendre")
        assert other.termination == "optimal", other
        assert ours.primal_bound == pytest.approx(other.primal_bound, rel=rel, abs=1e-9), name
    return ours


def corridor(seed, *, count=6, axes=2, order=4, width=0.3, **options):
    """Return a walk with boxes about its legs, and limits that bite a little."""
    generator = np.random.default_rng(seed)
    points = np.cumsum(generator.normal(size=(count + 1, axes)), axis=0)
    times = np.concatenate([[0], np.cumsum(generator.uniform(0.6, 1.8, count))])
    lower = np.minimum(points[:-1], points[1:]) - width
    upper = np.maximum(points[:-1], points[1:]) + width
    return MinimumDerivative(
        points, times, order=order, corridor_lower=lower, corridor_upper=upper, **options
    )


def limited(model, share=0.96):
    """Return `model` with limits at a share of what it needs without them."""
    answer = solved(model)
    assert answer.termination == "optimal", answer
    free, limits = answer.plan, {}
    for order, name in ((1, "velocity_limit"), (2, "acceleration_limit")):
        found = free.extremes(order)
        limits[name] = share * np.maximum(-found.least, found.largest).max(axis=0) + 0.05
        share = (1 + share) / 2
    return replace(model, **limits)
