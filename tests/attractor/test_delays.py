"""Delays: known results, and what moving, stretching or bending the values changes."""

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, logistic, lorenz, rossler, strange
from hypothesis import given, settings, strategies as st
from scipy.spatial.distance import pdist

from crosstrack.errors import UnsupportedOption
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.attractor.delays import (
    CorrelationIntegral,
    Curves,
    ImprovedCorrelationIntegral,
    close_pairs,
    correlation_sums,
    curves,
    first_local_minimum,
    first_zero_crossing,
)
from crosstrack.solvers.attractor.embedding import (
    autocorrelation,
    decorrelation,
    first_minimum,
    first_zero,
    mean_period,
    mutual_information,
)


@pytest.mark.parametrize("n", [50, 301])
def test_autocorrelation_is_the_sum_of_products(n):
    x = np.random.default_rng(n).normal(size=n) ** 3 + 100
    around = x - x.mean()
    wanted = [
        sum(around[i] * around[i + lag] for i in range(n - lag)) / (around @ around)
        for lag in range(20)
    ]
    np.testing.assert_allclose(autocorrelation(x, 19), wanted, atol=1e-12)


@pytest.mark.parametrize("period", [8, 20, 41.3, 160])
def test_a_cosine_is_zero_after_a_quarter_of_its_period(period):
    x = np.cos(2 * np.pi * np.arange(4000) / period)
    assert decorrelation(x, 0.0) == pytest.approx(period / 4, abs=1)
    # Noise of as many samples is as large a little sooner.
    sooner = period / (2 * np.pi) * np.arcsin(1.96 / np.sqrt(4000))
    assert first_zero(x) == pytest.approx(period / 4 - sooner, abs=1)
    assert first_minimum(x)[0] == first_zero(x)


def test_mutual_information_is_that_of_the_histogram():
    x = arma(500, (0.8,), seed=3)
    lags = np.array([1, 2, 7])
    found, deviation, entropy = mutual_information(x, lags)
    count = 500 - 7
    bins = int(np.sqrt(count // 5))
    edges = np.r_[-np.inf, np.quantile(x, np.arange(1, bins) / bins), np.inf]
    for lag, value in zip(lags, found, strict=True):
        held, _, _ = np.histogram2d(x[:count], x[lag : lag + count], [edges, edges])
        p, total = held / count, 0.0
        for i in range(bins):
            for j in range(bins):
                if p[i, j]:
                    total += p[i, j] * np.log(p[i, j] / (p[i].sum() * p[:, j].sum()))
        assert value + (bins - 1) ** 2 / 2 / count == pytest.approx(total, abs=1e-12)
    assert deviation == pytest.approx((bins - 1) / np.sqrt(2) / count)
    assert entropy == pytest.approx(np.log(bins), rel=1e-3)


def test_the_deviation_of_the_information_is_that_of_independent_values():
    drawn = [
        mutual_information(np.random.default_rng(k).random(1500), np.arange(1, 6))
        for k in range(60)
    ]
    values = np.array([one[0] for one in drawn])
    deviation = drawn[0][1]
    assert abs(values.mean()) < deviation
    assert 0.8 < values.std() / deviation < 1.2


@pytest.mark.parametrize(
    ("series", "low", "high"),
    [
        pytest.param(lambda: logistic(1000), 1, 1, id="logistic"),
        pytest.param(lambda: henon(1000), 1, 1, id="henon"),
        pytest.param(lambda: np.random.default_rng(4).normal(size=3000), 1, 2, id="noise"),
        # Between 0.14 s and 0.24 s; Fraser and Swinney's curve of the system has its minimum there.
        pytest.param(lambda: lorenz(5000, 0.01), 14, 24, id="lorenz"),
        pytest.param(
            lambda: lorenz(4000, 0.02), 7, 12, id="lorenz, half as many", marks=pytest.mark.slow
        ),
        # A quarter of the period of 5.9 s.
        pytest.param(lambda: rossler(4000, 0.1), 12, 16, id="rossler"),
    ],
)
def test_first_minimum(series, low, high):
    assert low <= first_minimum(series())[0] <= high


def test_noise_of_a_tenth_moves_the_minimum_little():
    x = lorenz(5000, 0.01)
    noisy = x + 0.1 * x.std() * np.random.default_rng(0).normal(size=len(x))
    assert 12 <= first_minimum(noisy)[0] <= 30


@given(
    st.integers(0, 10**6), st.integers(50, 400), st.floats(1e-100, 1e100), st.floats(-1e6, 1e6),
    st.sampled_from([(), (0.9,), (1.8, -0.95)]),
)  # fmt: skip
@settings(max_examples=40)
def test_units_and_direction_change_no_delay(seed, n, scale, shift, back):
    x = arma(n, back, seed=seed)
    # Ranks stay whatever is rounded.
    x = np.round(x * 2**20 / np.abs(x).max())
    moved = scale * (x + np.round(shift))
    assert first_zero(moved) == first_zero(x) == first_zero(-x[::-1])
    assert first_minimum(moved)[0] == first_minimum(x)[0]
    assert 1 <= first_minimum(x)[0] <= first_zero(x) <= n // 10


@pytest.mark.parametrize("name", strange())
def test_strange_series_have_a_delay(name):
    x = strange()[name]
    assert 1 <= first_minimum(x)[0] <= first_zero(x) <= len(x) // 10


def distances(x, delay, dimension):
    """Return all distances of states by their largest difference, shape (pairs,)."""
    m = len(x) - (dimension - 1) * delay
    states = np.stack([x[k * delay : k * delay + m] for k in range(dimension)], axis=1)
    return pdist(states, "chebyshev")


@given(
    st.integers(2, 60), st.integers(1, 4), st.integers(0, 10**6), st.sampled_from([3, 10, 10**6])
)  # fmt: skip
@settings(max_examples=60)
def test_close_pairs_are_those_of_all_distances(n, step, seed, values):
    x = np.random.default_rng(seed).integers(values, size=n) / values
    radii = np.array([0.1, 0.25, 0.5])
    found = close_pairs.py_func(x, step, radii, 3)
    for part in range(min(step, n)):
        y = x[part::step]
        for m in range(1, 4):
            far = distances(y, 1, m) if len(y) > m else np.empty(0)
            assert found[part, m - 1].tolist() == [(far <= r).sum() for r in radii]


def test_compiled_pairs_are_those_of_the_plain_meaning():
    x, radii = henon(200), np.array([0.3, 1.1])
    for step in (1, 7):
        wanted = close_pairs.py_func(x, step, radii, 5)
        assert (close_pairs(x, step, radii, 5) == wanted).all()


def test_the_curves_of_a_series_by_hand():
    """Equations 2-10 for t = 2: one subseries alternates between 0 and 3, the other is 0."""
    x = np.array([0, 0, 3, 0, 0, 0, 3, 0, 0, 0, 3, 0, 0.0])  # the last sample is in no subseries
    # All four radii are between 0 and 3, so only equal states are close. Of the alternating subseries:
    # m = 1: 3 + 3 of 15 pairs; m = 2: 3 + 1 of 10; m = 3: 1 + 1 of 6; m = 4: 1 of 3; m = 5: 0 of 1.
    sums = correlation_sums(x, 2)
    assert sums.shape == (2, 5, 4)
    for radius in range(4):
        assert sums[0, :, radius] == pytest.approx([6 / 15, 4 / 10, 2 / 6, 1 / 3, 0])
    assert (sums[1] == 1).all()
    found = curves(x, 2)
    c = (4 / 10 + 2 / 6 + 1 / 3 + 0 + 4) / 8
    s = (4 / 10 - 0.4**2 + 2 / 6 - 0.4**3 + 1 / 3 - 0.4**4 + 0 - 0.4**5) / 8
    assert found.sums[1] == pytest.approx(c)
    assert found.mean[1] == pytest.approx(s)
    assert found.spread[1] == pytest.approx(0, abs=1e-15)
    assert found.combined[1] == pytest.approx(s)
    # Equation 10: sums of one coordinate alone.
    assert found.periodic[1] == pytest.approx((0.4**2 + 0.4**3 + 0.4**4 + 0.4**5 + 4) / 8)


@pytest.mark.parametrize("delay", [1, 2, 7])
def test_the_curves_are_those_of_their_definition(delay):
    x = lorenz(405, 0.05)
    length = len(x) // delay
    radii = x.std() * np.array([0.5, 1, 1.5, 2])
    s, c = np.zeros((2, 4, 4))
    for part in range(delay):
        y = x[part : length * delay : delay]
        one = np.array([(distances(y, 1, 1) <= r).mean() for r in radii])
        for m in range(2, 6):
            close = np.array([(distances(y, 1, m) <= r).mean() for r in radii])
            c[m - 2] += close / delay
            s[m - 2] += (close - one**m) / delay
    found = curves(x, delay)
    assert found.sums[-1] == pytest.approx(c.mean(), abs=1e-12)
    assert found.mean[-1] == pytest.approx(s.mean(), abs=1e-12)
    assert found.spread[-1] == pytest.approx(np.ptp(s, axis=1).mean(), abs=1e-12)


def test_delay_and_window_are_read_from_the_curves():
    assert first_local_minimum(np.array([5, 4, 3, 3.5, 1, 2])) == (3, "")
    assert first_local_minimum(np.array([5, 4, 3.0]))[0] == 3
    assert first_zero_crossing(np.array([0.3, 0.1, -0.1, 0.2])) == (3, "")
    assert first_zero_crossing(np.array([-0.3, 0.0, 0.1])) == (2, "")
    delay, message = first_zero_crossing(np.array([0.3, 0.1, 0.2]))
    assert delay == 2 and "no zero" in message
    # S_c = C - S is 0.1, 0.15, 0.1, 0.3, 0.7, 0.2, 0.8: the peak at 2 is small, the one at 5 stands out.
    sums = np.array([0.2, 0.2, 0.2, 0.4, 0.8, 0.3, 0.9])
    mean = np.array([0.1, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1])
    found = Curves(sums, mean, np.array([0.5, 0.4, 0.3, 0.2, 0.1, 0.0, 0.2]))
    assert ImprovedCorrelationIntegral().window(found, 1) == (5, "")
    assert CorrelationIntegral().window(found, 1) == (6, "")  # 0.0 + |0.1| is the least
    window, message = ImprovedCorrelationIntegral().window(found, 5)
    assert window == 6 and "no period" in message


def test_the_statistic_of_independent_values_is_0():
    found = curves(np.random.default_rng(5).normal(size=1500), 6)
    assert abs(found.mean).max() < 0.01
    assert found.combined.max() < 0.05


def test_the_mean_period_is_that_of_the_mean_frequency():
    k = np.arange(1000)
    assert mean_period(np.sin(2 * np.pi * k / 25)) == pytest.approx(25)
    # Powers 1 and 4 at the frequencies 1 / 50 and 1 / 10: mean frequency (0.02 + 0.4) / 5.
    both = np.sin(2 * np.pi * k / 50) + 2 * np.cos(2 * np.pi * k / 10)
    assert mean_period(both) == pytest.approx(5 / 0.42)


NAMES = ("c-c", "improved-c-c", "mutual-information", "autocorrelation")


@pytest.mark.parametrize(
    ("name", "samples", "delay", "dimension"),
    [
        # Kim and others find a delay of 0.18 s and a window of 1 s.
        ("c-c", 1500, (8, 10), (5, 9)),
        # The mean period is 0.75 s.
        ("improved-c-c", 1500, (8, 11), (4, 6)),
        ("mutual-information", 4000, (7, 12), (3, 4)),
        ("autocorrelation", 4000, (13, 17), (3, 4)),
    ],
)
def test_the_embedding_of_the_lorenz_system(name, samples, delay, dimension):
    model, answer = analysed(name, lorenz(samples, 0.02))
    plan = answer.point
    assert delay[0] <= plan.delay <= delay[1]
    assert dimension[0] <= plan.dimension <= dimension[1]
    assert plan.exponent is plan.correlation is plan.surrogates is None
    assert model.verify(plan).ok
    assert answer.statistics["delay"] == plan.delay
    # Halves tell how far to trust it.
    assert answer.statistics["delay of the first half"] >= 1


def test_the_improved_window_is_a_period():
    _, answer = analysed("improved-c-c", rossler(1000, 0.1))
    assert answer.statistics["window"] == pytest.approx(58.6, abs=1.5)
    _, answer = analysed("improved-c-c", np.random.default_rng(2).normal(size=60))
    assert "window is that of c-c" in answer.message or answer.statistics["window"] >= 2


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("series", strange())
def test_strange_series_have_an_embedding(name, series):
    model, answer = analysed(name, strange()[series])
    assert answer.termination is Termination.FEASIBLE
    assert model.verify(answer.point).ok
    assert all(np.isfinite(value) for value in answer.statistics.values())


@pytest.mark.parametrize("name", NAMES)
def test_what_is_given_is_taken(name):
    own = {"dimension": 7} if "correl" in name or "mutual" in name else {"lags": 5}
    _, answer = analysed(name, henon(200), theiler=3, **own)
    assert answer.point.theiler == 3
    if "dimension" in own:
        assert answer.point.dimension == 7
    else:
        assert answer.statistics["window"] <= 5
    with pytest.raises(UnsupportedOption):
        analysed(name, henon(200), delay=2)


@pytest.mark.parametrize("name", ["c-c", "improved-c-c"])
def test_a_run_that_is_stopped_has_no_answer(name):
    control = Control()
    control.stop(Limit.TIME)
    _, answer = analysed(name, henon(3000), control=control)
    assert answer.termination is Termination.NO_SOLUTION and answer.limit is Limit.TIME


def test_a_delay_that_is_never_reached_is_told():
    _, answer = analysed("autocorrelation", np.arange(100.0))
    assert answer.point.delay == 10 and "stays above" in answer.message
    _, answer = analysed("mutual-information", henon(500))
    assert "no minimum" in answer.message


@pytest.mark.slow
def test_a_million_samples():
    x = np.cumsum(np.random.default_rng(1).normal(size=10**6))
    assert 1 <= first_minimum(x)[0] <= first_zero(x) == 10**5
