"""Delays: known results, and what moving, stretching or bending the values changes."""

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, logistic, lorenz, rossler, strange
from hypothesis import given, settings, strategies as st
from scipy.spatial.distance import pdist, squareform

from crosstrack.errors import UnsupportedOption
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.attractor.c_c_curves import (
    close_pairs,
    curves,
    slots,
    statistic,
    whole_statistic,
)
from crosstrack.solvers.attractor.information import (
    autocorrelation,
    decorrelation,
    first_minimum,
    first_zero,
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
    assert first_minimum(x) == first_zero(x)


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
        pytest.param(logistic(1000), 1, 1, id="logistic"),
        pytest.param(henon(1000), 1, 1, id="henon"),
        pytest.param(np.random.default_rng(4).normal(size=3000), 1, 2, id="noise"),
        # Between 0.14 s and 0.24 s; Fraser and Swinney's curve of the system has its minimum there.
        pytest.param(lorenz(5000, 0.01), 14, 24, id="lorenz"),
        pytest.param(lorenz(4000, 0.02), 7, 12, id="lorenz, half as many"),
        # A quarter of the period of 5.9 s.
        pytest.param(rossler(4000, 0.1), 12, 16, id="rossler"),
    ],
)
def test_first_minimum(series, low, high):
    assert low <= first_minimum(series) <= high


def test_noise_of_a_tenth_moves_the_minimum_little():
    x = lorenz(5000, 0.01)
    noisy = x + 0.1 * x.std() * np.random.default_rng(0).normal(size=len(x))
    assert 12 <= first_minimum(noisy) <= 30


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
    assert first_minimum(moved) == first_minimum(x)
    assert 1 <= first_minimum(x) <= first_zero(x) <= n // 10


@pytest.mark.parametrize("name", strange())
def test_strange_series_have_a_delay(name):
    x = strange()[name]
    assert 1 <= first_minimum(x) <= first_zero(x) <= len(x) // 10


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
            assert found[part, m - 1].tolist() == [(far < r).sum() for r in radii]


def test_compiled_pairs_are_those_of_the_plain_meaning():
    x, radii = henon(200), np.array([0.3, 1.1])
    for step in (1, 7):
        wanted = close_pairs.py_func(x, step, radii, 5)
        assert (close_pairs(x, step, radii, 5) == wanted).all()


@pytest.mark.parametrize("delay", [1, 2, 7])
def test_the_statistic_is_that_of_its_definition(delay):
    x = lorenz(400, 0.05)
    radii = x.std() * np.array([0.5, 1, 1.5, 2])

    def excess(y, t, m, r):
        return (distances(y, t, m) < r).mean() - (distances(y, t, 1) < r).mean() ** m

    wanted = [
        [np.mean([excess(x[s::delay], 1, m, r) for s in range(delay)]) for r in radii]
        for m in range(2, 6)
    ]
    np.testing.assert_allclose(statistic(x, delay), wanted, atol=1e-12)
    part = x[:250]  # all states are compared where there are no more than 300
    radii = part.std() * np.array([0.5, 1, 1.5, 2])
    wanted = [[excess(part, delay, m, r) for r in radii] for m in range(2, 6)]
    np.testing.assert_allclose(whole_statistic(slots(part), delay), wanted, atol=1e-12)


def test_some_states_stand_for_all():
    x = lorenz(1000, 0.02)
    slot = slots(x)
    for delay in (3, 40):
        m = 3
        far = squareform(distances(x, delay, m)) < x.std()
        alone = squareform(distances(x, delay, 1)) < x.std()
        np.fill_diagonal(far, False)
        np.fill_diagonal(alone, False)
        exact = far.sum() / len(far) / (len(far) - 1) - (alone.sum() / 1000 / 999) ** 3
        assert whole_statistic(slot, delay)[m - 2, 1] == pytest.approx(exact, abs=0.02)


def test_the_statistic_of_independent_values_is_0():
    found = curves(np.random.default_rng(5).normal(size=1500), 6, improved=True)
    assert abs(found.mean).max() < 0.01 and abs(found.whole).max() < 0.03
    assert found.combined.max() < 0.05


NAMES = ("c-c", "improved-c-c", "mutual-information", "autocorrelation")


@pytest.mark.parametrize(
    ("name", "samples", "delay", "dimension"),
    [
        # Kim and others find a delay of 0.18 s and a window of 1 s.
        ("c-c", 1500, (8, 10), (5, 9)),
        # The mean period is 0.75 s.
        ("improved-c-c", 1000, (7, 10), (4, 6)),
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
    assert answer.point.delay == 10 and "keeps above" in answer.message
    _, answer = analysed("mutual-information", henon(500))
    assert "no minimum" in answer.message


@pytest.mark.slow
def test_a_million_samples():
    x = np.cumsum(np.random.default_rng(1).normal(size=10**6))
    assert 1 <= first_minimum(x) <= first_zero(x) == 10**5
