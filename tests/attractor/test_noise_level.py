"""The estimated measurement noise, and its effect on the deviation of an exponent."""

import numpy as np
import pytest
from attractor.known import analysed, henon, logistic, rossler, strange

from crosstrack.models import AttractorAnalysis
from crosstrack.solvers.attractor.prediction import noise_level
from crosstrack.solvers.attractor.regions import NOISE_ERROR


def noisy(series, share):
    return series + share * series.std() * np.random.default_rng(5).normal(size=len(series))


def level_of(series, delay=1, dimension=3):
    return noise_level(AttractorAnalysis(series).states(delay, dimension), (dimension - 1) * delay)


@pytest.mark.parametrize(
    ("series", "delay", "shares"),
    # Noise of 2 % in 2,000 samples of a flow is not found.
    [
        (lambda: henon(2000), 1, (0.02, 0.1)),
        (lambda: logistic(2000), 1, (0.02, 0.1)),
        (lambda: rossler(2000, 0.3), 2, (0.1,)),
    ],
    ids=["henon", "logistic", "rossler"],
)
def test_clean_series_have_no_noise_and_noise_raises_the_level(series, delay, shares):
    series = series()
    levels = [level_of(noisy(series, share), delay) for share in shares]
    assert level_of(series, delay) < 2e-3 < levels[0]
    assert levels == sorted(levels) and levels[-1] < 0.15


@pytest.mark.parametrize("scale", [1e-140, 1e-6, 1e6, 1e149])
def test_the_level_does_not_depend_on_the_unit(scale):
    series = noisy(henon(400), 0.05)
    assert level_of(scale * series) == pytest.approx(level_of(series), rel=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", strange())
def test_strange_series_have_a_finite_level(name):
    assert 0.0 <= level_of(strange()[name]) < 2.0


def test_noise_widens_the_deviation_until_it_covers_the_exponent():
    clean, disturbed = (analysed("rosenstein", noisy(henon(3000), share)) for share in (0.0, 0.05))
    slopes = [answer.point.exponent for _, answer in (clean, disturbed)]
    share = disturbed[1].statistics["relative noise"]
    assert clean[1].statistics["relative noise"] < 1e-3 < share
    assert slopes[1].deviation >= NOISE_ERROR * np.sqrt(share) * slopes[1].value
    assert slopes[1].value < 0.9 * 0.41922 < slopes[0].value
    for slope in slopes:
        assert abs(slope.value - 0.41922) <= 2 * slope.deviation
