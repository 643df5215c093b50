"""Trajectories without bounds against an elimination in a hundred digits."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from minimum_snap import hundred_digits
from minimum_snap.drawn_trajectories import drawn
from minimum_snap.judged import judge

import crosstrack as ct
from crosstrack.models import MinimumDerivative, MinimumSnap

#: Where answers were wrong once, or withheld: long segments off by a share, bounds far below.
KNOWN = [
    (MinimumDerivative([[0], [0], [1]], [0, 1e3, 1000.001], order=5), "a waypoint missed by 5e8 m"),
    (
        MinimumSnap([[0], [0], [1], [0.5]], [0, 20, 20.05, 40.05]),
        "only feasible, the bound too low",
    ),
    (
        MinimumDerivative([[0], [1], [0], [2]], np.cumsum([0, 1e3, 1e-3, 1e3]), order=5),
        "only feasible, the objective right",
    ),
    (MinimumSnap([[0], [0], [0]], [0, 1, 2]), "an optimum of 0 with a gap of 1"),
]


@pytest.mark.parametrize("case", range(len(KNOWN)))
def test_known(case):
    model, fault = KNOWN[case]
    word, why = judge(model, ct.solve(model))
    assert word in ("optimal", "refused"), f"{fault}: {word} {why}"


@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_small(seed):
    model = drawn(seed, most=12)
    word, why = judge(model, ct.solve(model))
    assert word != "WRONG", why


def test_elimination_itself():
    """Two segments of order 2 by hand: x = 0, 1, 0 at t = 0, 1, 2 from rest to rest."""
    optimum, coefficients, unique = hundred_digits.solve(
        MinimumDerivative([[0], [1], [0]], [0, 1, 2], order=2)
    )
    assert unique
    # Rest in the middle, by symmetry: 3 s² - 2 s³ twice, each with ∫ (6 - 12 s)² = 12.
    assert float(optimum) == pytest.approx(24, abs=1e-14)
    assert coefficients[0, :, 0].astype(float).tolist() == pytest.approx([0, 0, 3, -2], abs=1e-14)
