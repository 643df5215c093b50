"""The paper's G-P algorithm and its method of small data sets."""

import math

import numpy as np
import pytest
from attractor.known import analysed, henon, logistic, lorenz, strange

from crosstrack.errors import InvalidData
from crosstrack.models.attractor.plan import AttractorEstimate, Method, Slope
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.attractor.paper_methods import all_pairs, slope_of

NAMES = ("g-p", "small-data-sets")


def test_the_pairs_of_equation_15_by_hand():
    """Three states at 0, 1 and 3: each is within any radius of itself, and a distance of 1 is not below 1."""
    counts = all_pairs(np.array([[0.0], [1.0], [3.0]]), np.array([1.0, 1.5, 2.5, 4.0]), bool)
    assert counts.counts.sum(axis=0).tolist() == [3, 5, 7, 9]


def test_the_slope_of_equation_17_by_hand():
    """Forty states at 0, 1, …, 39; a quarter of the deviation is set to 10.5."""
    found = slope_of(np.arange(40.0)[:, None], 42.0, Method.TWO_POINTS, bool)
    assert found.high == 10.5
    # Within 10.5 are 40 + 2 (39 + … + 30) = 730 pairs. Within a radius in (1, 2] are 40 + 2 x 39 = 118, a share
    # of 1 / 6.2, within one in (2, 3] 194, a share of 1 / 3.8: the first is nearer to a fifth.
    assert 1 < found.low < 1.02
    assert found.value == pytest.approx(math.log(730 / 118) / math.log(10.5 / found.low))
    assert found.method is Method.TWO_POINTS
    lonely = slope_of(np.eye(4), 1.0, Method.TWO_POINTS, bool)
    assert "fifth" in lonely


def test_the_dimension_is_the_largest_slope():
    series = lorenz(1000, 0.05)
    model, answer = analysed("g-p", series, delay=3)
    plan = answer.point
    slopes = {int(name.split()[-1]): value for name, value in answer.statistics.items()}
    assert list(slopes) == list(range(2, 2 + len(slopes))) and len(slopes) > 3
    assert plan.correlation.value == max(slopes.values()) == slopes[plan.dimension]
    assert (plan.delay, plan.theiler) == (3, 0)
    # Pair by pair, by equations 15-17.
    states = model.states(3, plan.dimension)
    apart = np.abs(states[:, None] - states).max(axis=2)
    low, high = plan.correlation.low, plan.correlation.high
    assert high == pytest.approx(series.std() / 4)
    one, two = (apart < high).mean(), (apart < low).mean()
    assert one / two == pytest.approx(5, rel=0.05)
    assert plan.correlation.value == pytest.approx(math.log(one / two) / math.log(high / low))
    assert model.verify(plan).ok
    wrong = Slope(Method.TWO_POINTS, plan.correlation.value + 0.1, 0.0, low, high)
    assert not model.verify(AttractorEstimate(3, plan.dimension, 0, correlation=wrong)).ok


def test_a_line_through_the_same_radii():
    model, answer = analysed("g-p", lorenz(1000, 0.05), delay=3, fit="line", largest=4)
    found = answer.point.correlation
    assert found.method is Method.LINE and model.verify(answer.point).ok
    states = model.states(3, answer.point.dimension)
    apart = np.abs(states[:, None] - states).max(axis=2)
    radii = np.geomspace(found.low, found.high, 16)
    sums = [(apart < np.nextafter(r, 0)).mean() for r in radii]
    assert found.value == pytest.approx(np.polyfit(np.log(radii), np.log(sums), 1)[0], rel=1e-3)
    with pytest.raises(InvalidData, match="exponent must not"):
        AttractorEstimate(3, 4, 0, exponent=found)


def test_noise_has_no_slope_in_high_dimensions():
    """A state is its own and only neighbour there, so equation 17 has no second radius."""
    _, answer = analysed("g-p", np.random.default_rng(0).normal(size=1000), delay=8)
    assert "slope, dimension 2" in answer.statistics and "no slope from dimension" in answer.message


def test_the_embedding_of_a_sine_by_hand():
    """Steps 1 and 2 for a sine with a period of 25 samples."""
    _, answer = analysed("small-data-sets", np.sin(2 * np.pi * np.arange(1000) / 25))
    plan = answer.point
    # cos(2 pi k / 25) first falls below 1 - 1 / e at k = 25 acos(0.632) / (2 pi) = 3.5.
    assert (plan.delay, plan.theiler) == (4, 25)
    # m >= 2 d + 1 with d near 1, the dimension of a closed curve.
    assert plan.dimension in (3, 4)


@pytest.mark.parametrize(("series", "known"), [(logistic(1000), math.log(2)), (henon(1000), 0.419)])
def test_the_exponent_of_maps(series, known):
    model, answer = analysed("small-data-sets", series, dimension=2)
    assert answer.point.exponent.value == pytest.approx(known, rel=0.1)
    assert answer.point.exponent.low == 0
    assert model.verify(answer.point).ok


def test_noise_has_a_positive_exponent():
    """A line through the beginning of the curve has a positive slope for every series."""
    noise = np.random.default_rng(1).normal(size=1000)
    _, answer = analysed("small-data-sets", noise, delay=8, dimension=10)
    assert answer.point.exponent.value > 0.1
    assert analysed("rosenstein", noise, delay=8, dimension=10)[1].point.exponent is None


@pytest.mark.parametrize("name", NAMES)
def test_strange_series_have_a_plan(name):
    for label, series in strange().items():
        model, answer = analysed(name, series)
        assert answer.termination is Termination.FEASIBLE, label
        assert model.verify(answer.point).ok, label


@pytest.mark.parametrize("name", NAMES)
def test_a_run_that_is_stopped_has_no_answer(name):
    control = Control()
    control.stop(Limit.TIME)
    _, answer = analysed(name, henon(2000), control=control)
    assert answer.termination is Termination.NO_SOLUTION and answer.limit is Limit.TIME
