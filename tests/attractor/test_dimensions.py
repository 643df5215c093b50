"""Dimensions of embeddings: plain loops beside, known results, strange series."""

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, logistic, lorenz, rossler, strange
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.solvers.attractor.embedding import (
    cao_curves,
    cao_dimension,
    false_shares,
    first_minimum,
    largest_dimension,
    nearest,
    saturated,
    states_of,
    thin_out,
)


@given(
    st.integers(2, 60), st.integers(1, 4), st.integers(0, 12), st.sampled_from([2, np.inf]),
    st.integers(0, 10**6), st.sampled_from([2, 7, 10**6]),
)  # fmt: skip
@settings(max_examples=150)
def test_nearest_states_are_those_of_a_plain_search(m, dimension, theiler, norm, seed, values):
    g = np.random.default_rng(seed)
    states = g.integers(values, size=(m, dimension)) / values
    times = np.sort(g.choice(4 * m, m, replace=False))
    found, apart = nearest(states, times, np.arange(m), theiler, norm)
    far = np.linalg.norm(states[:, None] - states, norm, axis=2)
    far[(abs(times[:, None] - times) <= theiler) | (far == 0)] = np.inf
    wanted = far.min(axis=1)
    np.testing.assert_allclose(apart, wanted, rtol=1e-12)
    assert ((found == -1) == np.isinf(wanted)).all()
    some = np.flatnonzero(found >= 0)
    np.testing.assert_allclose(far[some, found[some]], wanted[some], rtol=1e-12)


def test_thinned_numbers_are_one_of_each_stretch_and_at_many_phases():
    at = thin_out(10**6, 5000)
    assert (at // 200 == np.arange(5000)).all()
    # Each phase of a period as long as the stretches.
    assert np.bincount(at % 200).min() >= 20
    assert thin_out(7, 7).tolist() == thin_out(7, 99).tolist() == list(range(7))


@pytest.mark.parametrize("delay", [1, 3])
def test_curves_are_those_of_plain_loops(delay):
    x = henon(150)
    grows, moves = [], []
    for d in range(1, 6):
        a, b = [], []
        m = len(x) - d * delay
        for i in range(m):
            best, who = np.inf, -1
            for j in range(m):
                apart = max(abs(x[i + k * delay] - x[j + k * delay]) for k in range(d))
                if abs(i - j) > delay and 0 < apart < best:
                    best, who = apart, j
            new = abs(x[i + d * delay] - x[who + d * delay])
            a.append(max(best, new) / best)
            b.append(new)
        grows.append(np.mean(a))
        moves.append(np.mean(b))
    first, second = cao_curves(x, delay, 4)
    np.testing.assert_allclose(first, np.divide(grows[1:], grows[:-1]), rtol=1e-9)
    np.testing.assert_allclose(second, np.divide(moves[1:], moves[:-1]), rtol=1e-9)


@pytest.mark.parametrize(
    ("series", "low", "high"),
    [
        pytest.param(lambda: henon(1000), 2, 2, id="henon"),
        pytest.param(lambda: henon(20000), 2, 2, id="henon, long"),
        pytest.param(lambda: henon(60), 2, 3, id="henon, short"),
        pytest.param(lambda: logistic(500), 1, 2, id="logistic"),
        pytest.param(lambda: lorenz(4000, 0.02), 3, 4, id="lorenz"),
        pytest.param(lambda: rossler(4000, 0.1), 3, 4, id="rossler"),
        pytest.param(lambda: np.cos(np.arange(2000) * 0.1571), 2, 2, id="cosine"),
        pytest.param(
            lambda: np.cos(np.arange(2000) * 2 * np.pi / 40), 2, 2, id="cosine of 40 values"
        ),
        pytest.param(lambda: arma(2000, (1.8, -0.9)), 7, 10, id="noise in colours"),
    ],
)
def test_known_dimensions(series, low, high):
    series = series()
    assert low <= cao_dimension(series, first_minimum(series)[0]) <= high


@pytest.mark.parametrize(
    ("curve", "wanted"),
    [
        ([0.2, 0.95, 0.96, 0.5], 2),
        ([0.2, 0.95, 0.6, 0.93, 0.97], 4),
        ([0.2, 0.3, 0.95], 3),
        ([0.2, 0.3], 2),
        ([0.95], 1),
        ([np.nan, np.nan, np.nan], 3),
    ],
)
def test_where_a_curve_saturates(curve, wanted):
    assert saturated(np.array(curve)) == wanted


def test_noise_does_not_saturate():
    first, second = cao_curves(np.random.default_rng(0).normal(size=4000), 1, 8)
    assert (np.diff(first) > 0).all() and first[4] < 0.85
    # And the second curve is that of noise, which is 1 everywhere, while a map's is not.
    assert abs(second - 1).max() < 0.1
    assert abs(cao_curves(henon(4000), 1, 8)[1] - 1).min() > 0.15


@given(
    st.integers(0, 10**6), st.integers(50, 200), st.floats(1e-100, 1e100), st.integers(-999, 999)
)
@settings(max_examples=25)
def test_units_change_no_dimension(seed, n, scale, shift):
    x = np.round(arma(n, (0.7,), seed=seed) * 2**10)
    moved = (x + shift) * 2.0 ** np.round(np.log2(scale))
    assert cao_dimension(moved, 1) == cao_dimension(x, 1) <= largest_dimension(n, 1)


@pytest.mark.parametrize("name", strange())
def test_strange_series_have_a_dimension(name):
    x = strange()[name]
    delay = first_minimum(x)[0]
    assert 1 <= cao_dimension(x, delay) <= largest_dimension(len(x), delay) <= 10
    assert len(states_of(x, np.arange(1), delay, 2)) == 1


@pytest.mark.parametrize("delay", [1, 2])
def test_false_neighbours_are_those_of_plain_loops(delay):
    x = henon(150)
    wanted = []
    for d in range(1, 5):
        m, false = len(x) - d * delay, 0
        states = np.stack([x[k * delay : k * delay + m] for k in range(d + 1)], axis=1)
        for i in range(m):
            far = np.sqrt(((states[i, :d] - states[:, :d]) ** 2).sum(axis=1))
            far[max(i - 3, 0) : i + 4] = np.inf
            j = far.argmin()
            new = abs(states[i, d] - states[j, d])
            false += new / far[j] > 15 or np.hypot(new, far[j]) / x.std() > 2
        wanted.append(false / m)
    np.testing.assert_allclose(false_shares(x, delay, 4, 3), wanted, rtol=1e-12)


@pytest.mark.parametrize("name", ["cao", "false-neighbours"])
@pytest.mark.parametrize(
    ("series", "low", "high"),
    [
        (lambda: henon(1000), 2, 2),
        (lambda: lorenz(3000, 0.02), 3, 4),
        (lambda: rossler(2000, 0.1), 3, 4),
    ],
)
def test_backends_find_known_dimensions(name, series, low, high):
    series = series()
    model, answer = analysed(name, series)
    plan = answer.point
    assert low <= plan.dimension <= high
    assert plan.delay == first_minimum(series)[0]
    assert answer.statistics["dimension"] == plan.dimension
    assert low <= answer.statistics["dimension of the first half"] <= high + 1
    assert model.verify(plan).ok


def test_noise_is_told():
    noise = np.random.default_rng(8).normal(size=1000)
    _, answer = analysed("cao", noise)
    assert "noise" in answer.message
    _, answer = analysed("false-neighbours", noise)
    assert "no dimension" in answer.message
    _, answer = analysed("cao", henon(1000))
    assert not answer.message


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["cao", "false-neighbours"])
@pytest.mark.parametrize("series", strange())
def test_strange_series_have_an_embedding(name, series):
    model, answer = analysed(name, strange()[series], largest=6)
    assert answer.point.dimension <= 6
    assert model.verify(answer.point).ok
    assert all(np.isfinite(value) for value in answer.statistics.values())


@pytest.mark.slow
def test_a_million_samples():
    assert cao_dimension(henon(10**6), 1) == 2


@pytest.mark.parametrize("name", ["autocorrelation", "c-c", "rosenstein", "surrogates"])
def test_a_theiler_window_that_leaves_no_neighbour_is_refused(name):
    series = np.random.default_rng(0).normal(size=60)
    with pytest.raises(InvalidData, match=r"theiler must be <= \d+ for delay .* got 58") as error:
        analysed(name, series, theiler=58)
    assert error.value.field == "theiler"


@pytest.mark.parametrize("kind", ["spike", "binary", "few", "pairs"])
@pytest.mark.parametrize("theiler", [0, 7])
def test_nearest_states_among_repeats(kind, theiler):
    draw = np.random.default_rng(4)
    x = {
        "spike": np.eye(1, 150, 70).ravel(),
        "binary": draw.integers(0, 2, 150) * 1.0,
        "few": draw.integers(0, 6, 150) / 7,
        "pairs": np.repeat(draw.normal(size=75), 2),
    }[kind]
    states = np.stack([x[:-2], x[1:-1], x[2:]], axis=1)
    times = np.arange(len(states))
    found, apart = nearest(states, times, times, theiler)
    far = np.abs(states[:, None] - states).max(axis=2)
    far[(np.abs(times[:, None] - times) <= theiler) | (far == 0)] = np.inf
    np.testing.assert_array_equal(apart, far.min(axis=1))
    held = found >= 0
    assert (held == np.isfinite(far.min(axis=1))).all()
    np.testing.assert_array_equal(far[times[held], found[held]], apart[held])
