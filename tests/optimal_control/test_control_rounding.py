"""Integer controls by sum-up rounding."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import round_controls
from crosstrack.models.optimal_control.rounding import sum_up


@pytest.mark.parametrize("seed", range(5))
def test_sums_stay_within_the_bounds_of_the_theory(seed):
    draw = np.random.default_rng(seed)
    free = draw.uniform(-1, 3, (500, 3))
    whole = sum_up(free, np.full(3, -1.0), np.full(3, 3.0), False)
    assert (whole == np.round(whole)).all()
    assert np.abs(np.cumsum(whole - free, axis=0)).max() <= 0.5 + 1e-9
    shares = draw.dirichlet(np.full(4, 0.3), 500)
    chosen = sum_up(shares, np.zeros(4), np.ones(4), True)
    assert (chosen.sum(axis=1) == 1).all()
    assert np.abs(np.cumsum(chosen - shares, axis=0)).max() <= 3


def test_gap_of_lotka_volterra_fishing_falls():
    model = ct.load("optimal-control/lotka-volterra-fishing")
    relaxed = ct.solve(model, tolerance=1e-5, seed=0)
    assert relaxed.primal_bound == pytest.approx(1.34408, abs=2e-5)
    gaps = []
    for steps in (20, 50):
        found = round_controls(model, relaxed.plan, steps=steps, tolerance=1e-5)
        assert found.verification.ok
        values = np.concatenate(found.plan.phases[0].controls.values)
        assert np.isin(values, [0.0, 1.0]).all()
        assert found.deviation <= found.bound * (1 + 1e-9)
        gaps.append(found.gap)
    assert 0 < gaps[1] < 0.3 * gaps[0]
    assert gaps[1] < 0.02


def test_integer_controls_are_checked():
    phase = OptimalControlProblem("integer").phase(time=(0, 1))
    with pytest.raises(InvalidData, match="whole numbers"):
        phase.control("w", lower=0, upper=0.5, integer=True)
    model = ct.load("optimal-control/bryson-denham")
    with pytest.raises(InvalidData, match="integer=True"):
        round_controls(model, ct.solve(model, seed=0).plan)
