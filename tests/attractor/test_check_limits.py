"""What each check of an attractor's estimate accepts: 0.9 of its tolerance, and not 1.1."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from attractor.counted import fitted, plain_divergence, plain_rows, plain_sums, scatter
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs

from crosstrack.models.attractor import (
    AttractorAnalysis,
    AttractorEstimate,
    Evidence,
    Measures,
    Slope,
    Spectrum,
    SurrogateTest,
    model as checks,
)
from crosstrack.models.attractor.evidence import SHARE
from crosstrack.solvers.attractor.measures import permutation_entropy, recurrence
from crosstrack.solvers.attractor.native import Embedding
from crosstrack.solvers.attractor.spectrum import tangents
from crosstrack.solvers.attractor.verdict import gather

TOLERANCE = 1e-6
CHAOS = [0.3]
while len(CHAOS) < 60:
    CHAOS.append(4 * CHAOS[-1] * (1 - CHAOS[-1]))
RNG = np.random.default_rng(14)
SERIES = {
    "chaos": np.array(CHAOS),
    "noise": RNG.normal(size=55),
    "ties": RNG.integers(0, 5, 60).astype(float),
}
THEILER, PERIOD = 2, 0.25


def analysis(name, scale):
    """Return a series whose values and period are `scale` times as large."""
    return AttractorAnalysis(scale * SERIES[name], scale * PERIOD)


@cache
def exponent(name, low, high, method, radius=None):
    """Return the slope in nats per 0.25 s of series that are not scaled, and what it may be off by."""
    states, steps = analysis(name, 1.0).states(1, 1), np.arange(low, high + 1)
    if name == "ties":
        rows = plain_rows(states, THEILER, steps)
        return fitted(PERIOD * steps, np.nanmean(rows, axis=0)), scatter(PERIOD * steps, rows)
    return fitted(PERIOD * steps, plain_divergence(states, THEILER, steps, radius)), 0.0


@cache
def dimension(name, method, low, high):
    """Return the slope of a correlation sum between radii; the paper's count a state with itself."""
    states = analysis(name, 1.0).states(1, 2)
    radii = np.geomspace(low, high, 2 if method == "two-points" else 16)
    sums = plain_sums(states, THEILER, radii)
    if method != "correlation":
        apart = np.abs(states[:, None] - states).max(axis=2)
        far = np.abs(np.subtract.outer(*2 * [np.arange(len(states))])) > THEILER
        sums = [(far & (apart < r)).sum() + len(states) for r in radii]
    return fitted(np.log(radii), np.log(sums))


def off(value, width, share, error=0.0):
    """Return a slope that is off by `share` of the tolerance and five standard errors."""
    least = 1.0 / width
    away = min(5.0 * error, least)
    if abs(value) + away < least:
        return value + away + share * TOLERANCE * least
    return value / (1.0 - share * TOLERANCE)


def growth(name, low, high, method="rosenstein", radius=None):
    """Return the case of an exponent."""

    def case(scale, share):
        value, error = exponent(name, low, high, method, radius)
        value = off(value, PERIOD * (high - low), share, error) / scale
        near = None if radius is None else scale * radius
        plan = AttractorEstimate(1, 1, THEILER, Slope(method, value, 0.0, low, high, near))
        return analysis(name, scale).verify(plan, tolerance=TOLERANCE)

    return case


def correlation(name, method, low=0.3, high=0.8):
    """Return the case of a correlation dimension."""

    def case(scale, share):
        value = off(dimension(name, method, low, high), np.log(high / low), share)
        slope = Slope(method, value, 0.0, scale * low, scale * high)
        plan = AttractorEstimate(1, 2, THEILER, None, slope)
        return analysis(name, scale).verify(plan, tolerance=TOLERANCE)

    return case


def judged(judgement):
    """Return the case of a p-value that exceeds 0.05."""

    def case(scale, share):
        tolerance = TOLERANCE / scale
        count = round(1e3 / tolerance)
        exceeded = count // 20 + round(50 * share) - 1
        growing = Slope("rosenstein", exponent("chaos", 1, 4, "rosenstein")[0], 0.0, 1, 4)
        test = SurrogateTest(judgement, count - 1, exceeded)
        plan = AttractorEstimate(1, 1, THEILER, growing, None, test)
        return analysis("chaos", 1.0).verify(plan, tolerance=tolerance)

    return case


def evident(scale, share):
    """Return the case of the correlation of the 0-1 test."""
    found = gather(analysis("chaos", scale), Embedding(1, 1, THEILER), 1, bool)
    value = off(found.zero_one - SHARE, 1.0, -share)
    test = SurrogateTest("noise", 39, 39, replace(found, zero_one=value))
    plan = AttractorEstimate(1, 1, THEILER, surrogates=test)
    return analysis("chaos", scale).verify(plan, tolerance=TOLERANCE)


def spectral(scale, share):
    """Return the case of the only exponent of a map in one coordinate."""
    states = analysis("chaos", 1.0).states(1, 1)
    near = tangents(states, THEILER, 1, 6)
    value = off(float(near.exponents(near.frames, 1)[0][0]) / PERIOD, PERIOD, share) / scale
    plan = AttractorEstimate(1, 1, THEILER, spectrum=Spectrum((value,), (0.0,), 1, 6, 1))
    return analysis("chaos", scale).verify(plan, tolerance=TOLERANCE)


def measured(name):
    """Return the case of one measure, below 1 or above."""

    def case(scale, share):
        states, values = analysis("chaos", 1.0).states(1, 1), SERIES["chaos"]
        found = recurrence(states, THEILER, 0.25)
        found["permutation_entropy"] = permutation_entropy(values, 4)
        value = off(float(found[name]), 1.0, share)
        plan = AttractorEstimate(1, 1, THEILER, measures=Measures(0.25 * scale, 4, **{name: value}))
        return analysis("chaos", scale).verify(plan, tolerance=TOLERANCE)

    return case


LIMITS = {
    "evidence follows from the series": [evident],
    "spectrum is that of the linear maps": [spectral],
    "measures are those of the series": [
        measured("permutation_entropy"),
        measured("determinism"),
        measured("diagonal_longest"),
    ],
    "exponent is the slope of its curve": [
        growth("chaos", 1, 4),
        growth("chaos", 4, 8),
        growth("noise", 2, 5, "kantz", 0.9),
        growth("ties", 1, 4),
    ],
    "correlation dimension is the slope of its curve": [
        correlation("chaos", "correlation"),
        correlation("noise", "correlation"),
        correlation("chaos", "two-points"),
        correlation("chaos", "line"),
    ],
    "judgement follows from the ranks": [judged("chaotic"), judged("nonlinear")],
}


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize("scale", SCALES)
def test_a_theiler_window_must_leave_two_states(scale):
    """59 states: the last is 58 samples after the first."""
    model = analysis("chaos", scale)
    assert model.verify(AttractorEstimate(1, 2, 57)).ok
    assert_only("embedding fits", model.verify(AttractorEstimate(1, 2, 58)))


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("growing", [False, True])
def test_chaos_needs_an_exponent_above_0(growing, scale):
    """A judgement without an exponent, and with one that is right but negative."""
    test = SurrogateTest("chaotic", 99, 0)
    value = exponent("noise", 2, 5, "kantz", 0.9)[0] / scale
    assert value < 0
    slope = Slope("kantz", value, 0.0, 2, 5, 0.9 * scale) if growing else None
    plan = AttractorEstimate(1, 1, THEILER, slope, None, test)
    assert_only("judgement follows from the ranks", analysis("noise", scale).verify(plan))
    noise = AttractorEstimate(1, 1, THEILER, slope, None, SurrogateTest("noise", 99, 99))
    assert analysis("noise", scale).verify(noise).ok


@pytest.mark.parametrize("theiler", [0, 7])
def test_correlation_sums_are_shares_of_all_pairs(theiler):
    states, radii = analysis("chaos", 1.0).states(1, 2), np.array([0.1, 0.4, 2.0])
    found = checks.Sample(states, theiler, 0).sums(radii)
    assert found == pytest.approx(plain_sums(states, theiler, radii), rel=1e-12)
    assert found[-1] == 1.0


@pytest.mark.parametrize(
    ("count", "taken"), [(1500, 1500), (1501, 500), (300_000, 333), (3_000_000, 50)]
)
def test_fewer_states_are_taken_of_long_series(count, taken):
    """All of 1500; else as many as the work allows, from 50 to 500."""
    found = checks.Sample(np.zeros((count, 1)), 0, 0).taken(count)
    assert len(np.unique(found)) == taken


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("ahead", [1, 3])
def test_the_objective_is_the_error_of_prediction(ahead, scale):
    """The nearest state by the largest difference predicts the last coordinate `ahead` samples on."""
    model = analysis("chaos", scale)
    states = model.states(ahead, 2)
    last, errors = len(states) - ahead, []
    for i in range(last):
        apart = [np.abs(states[i] - states[j]).max() for j in range(last)]
        j = min((j for j in range(last) if abs(i - j) > THEILER), key=lambda j: apart[j])
        errors.append(states[i + ahead, -1] - states[j + ahead, -1])
    wanted = np.sqrt(np.mean(np.square(errors)) / 2.0) / states.std()
    found = model.verify(AttractorEstimate(ahead, 2, THEILER))
    assert found.objective == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("fields", "objective"),
    [
        ({"true_exponent": 2.0, "chaotic": True}, 0.75),
        ({"true_exponent": 2.0, "true_dimension": 4.0}, (0.5 + 0.25) / 2),
        ({"true_exponent": 0.5, "chaotic": False}, 0.5),
        ({"true_dimension": 3.0}, 0.0),
    ],
)
def test_the_objective_is_the_mean_error_of_known_figures(fields, objective):
    """An exponent of 1 and a dimension of 3 are claimed, and noise."""
    slopes = Slope("rosenstein", 1.0, 0.0, 1, 4), Slope("line", 3.0, 0.0, 0.1, 0.2)
    plan = AttractorEstimate(1, 1, 0, *slopes, SurrogateTest("noise", 1, 1))
    found = AttractorAnalysis(SERIES["chaos"], **fields).verify(plan)
    assert found.objective == pytest.approx(objective, rel=1e-12)


def test_every_check_is_tested():
    slopes = Slope("rosenstein", 0.0, 0.0, 1, 4), Slope("line", 0.0, 0.0, 0.1, 0.2)
    further = Spectrum((0.0,), (0.0,), 1, 6, 1), Measures(0.25, 4, hurst=0.5)
    evidence = Evidence(1, 0.5, 0.5, 1.0, 0.0, 1, 0.5)
    plan = AttractorEstimate(1, 1, 0, *slopes, SurrogateTest("noise", 1, 1, evidence), *further)
    found = analysis("chaos", 1.0).verify(plan)
    assert_complete({"embedding fits", *LIMITS}, [found], checks)
