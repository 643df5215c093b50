"""Surrogates: their invariants, noise that is not rejected, motions that are, and the conditions of chaos."""

from dataclasses import replace

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, logistic, lorenz, rossler, strange
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import Judgement
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.attractor.native import Embedding, embed
from crosstrack.solvers.attractor.neighbour_kernels import nearest_states
from crosstrack.solvers.attractor.prediction import linear_map_error, prediction_error
from crosstrack.solvers.attractor.surrogates import (
    RANKING,
    match_ends,
    normal_scores,
    ranks,
    surrogates_of,
)

OPTIONS = {name: option.default for name, option in RANKING.items()}


@given(st.integers(20, 300), st.integers(0, 10**6), st.sampled_from([2, 5, 10**6]))
@settings(max_examples=30)
def test_surrogates_have_the_values_of_the_series(n, seed, values):
    g = np.random.default_rng(seed)
    x = g.integers(values, size=n) / values
    found = surrogates_of(x, 3, g)
    for one in found:
        assert (np.sort(one) == np.sort(x)).all()


@pytest.mark.parametrize("bend", [np.asarray, np.exp, np.tanh])
def test_surrogates_have_the_spectrum_of_the_series(bend):
    x = normal_scores(bend(arma(1000, (1.6, -0.8), seed=4)))
    size = np.abs(np.fft.rfft(x))
    found = surrogates_of(x, 5, np.random.default_rng(0))
    for one in found:
        away = np.linalg.norm(np.abs(np.fft.rfft(one)) - size) / np.linalg.norm(size)
        assert away < 0.01
        # And are other series: their phases are drawn.
        assert abs(np.corrcoef(one, x)[0, 1]) < 0.5
    shuffled = np.random.default_rng(0).permutation(x)
    away = np.linalg.norm(np.abs(np.fft.rfft(shuffled)) - size) / np.linalg.norm(size)
    assert away > 0.3


def test_surrogates_are_drawn_by_their_generator():
    x = henon(200)
    one, again, other = (surrogates_of(x, 2, np.random.default_rng(k)) for k in (1, 1, 2))
    assert (one == again).all() and (one != other).any()


@given(st.integers(0, 10**6), st.integers(5, 200), st.sampled_from([3, 10**6]))
@settings(max_examples=50)
def test_normal_scores_keep_order_and_ties(seed, n, values):
    from scipy.stats import norm, rankdata

    x = np.random.default_rng(seed).integers(values, size=n).astype(float)
    wanted = norm.ppf((rankdata(x) - 0.5) / n)
    np.testing.assert_allclose(normal_scores(x), wanted - wanted.mean(), atol=1e-9)
    np.testing.assert_allclose(normal_scores(np.exp(x / values)), normal_scores(x), atol=1e-12)


@pytest.mark.parametrize(("n", "cut"), [(60, 0.1), (301, 0.1), (301, 0.25)])
def test_the_ends_that_match_best_are_taken(n, cut, monkeypatch):
    from crosstrack.solvers.attractor import surrogates

    monkeypatch.setattr(surrogates, "_CUTS", (cut,))
    x = arma(n, (1.8, -0.9), seed=n)
    most = int(cut * n)
    wanted = min(
        (sum((x[a + k] - x[b + k]) ** 2 for k in range(3)), a, b)
        for a in range(most)
        for b in range(n - 3, n - 3 - most, -1)
    )
    first, end, jump = match_ends(x)
    assert (first, end) == wanted[1:]
    assert jump == pytest.approx(np.sqrt(wanted[0] / 3 / (np.diff(x) ** 2).mean()))


@given(
    st.integers(12, 60), st.integers(1, 3), st.integers(1, 3), st.integers(0, 8), st.integers(1, 4),
    st.integers(0, 10**6), st.sampled_from([4, 10**6]),
)  # fmt: skip
@settings(max_examples=60)
def test_the_prediction_error_is_that_of_plain_loops(n, delay, d, theiler, count, seed, values):
    x = np.random.default_rng(seed).integers(values, size=n) / values
    ahead, span = delay, (d - 1) * delay
    errors = []
    for i in range(n - span - ahead):
        near = []
        for j in range(n - span - ahead):
            if abs(i - j) > theiler:
                near.append((max(abs(x[i + c * delay] - x[j + c * delay]) for c in range(d)), j))
        near.sort()  # of equally near states the earlier ones
        if len(near) >= count:
            mean = np.mean([x[j + span + ahead] for _, j in near[:count]])
            errors.append((x[i + span + ahead] - mean) ** 2)
    found = prediction_error(x, delay, d, theiler, count)
    if errors:
        assert found == pytest.approx(np.mean(errors), rel=1e-9)
    else:
        assert np.isnan(found)


@given(
    st.integers(20, 60), st.integers(1, 2), st.integers(1, 3), st.integers(0, 5), st.integers(0, 10**6)
)  # fmt: skip
@settings(max_examples=30)
def test_the_error_of_linear_maps_is_that_of_regressions(n, delay, d, theiler, seed):
    x = np.random.default_rng(seed).normal(size=n)
    last, span, errors = n - d * delay, (d - 1) * delay, []
    states = np.stack([x[k * delay : k * delay + last] for k in range(d)], axis=1)
    for i in range(last):
        apart = np.abs(states - states[i]).max(axis=1)
        apart[max(i - theiler, 0) : i + theiler + 1] = np.inf
        near = np.argsort(apart, kind="stable")[: 2 * (d + 1)]
        if np.isfinite(apart[near[-1]]):
            rows = np.column_stack([states[near] - states[i], np.ones(len(near))])
            later = x[near + span + delay]
            errors.append((x[i + span + delay] - np.linalg.lstsq(rows, later)[0][-1]) ** 2)
    # The penalty changes well-determined maps little.
    assert linear_map_error(x, delay, d, theiler, delay) == pytest.approx(np.mean(errors), rel=1e-2)


def test_linear_maps_need_neighbours_and_few_dimensions():
    x = henon(150)
    assert linear_map_error(x, 1, 2, 0, 1) < 0.1 * prediction_error(x, 1, 2, 0, 5)
    assert np.isnan(linear_map_error(x, 1, 21, 0, 1)) and np.isnan(
        linear_map_error(x, 1, 2, 148, 1)
    )
    assert np.isnan(linear_map_error(x, 100, 3, 0, 1))
    assert np.isfinite(linear_map_error(np.ones(50), 1, 2, 0, 1))


@pytest.mark.parametrize(
    ("count", "theiler", "largest"), [(5, 0, True), (1, 10, True), (2, 3, False)]
)
def test_compiled_nearest_states_are_those_of_the_plain_meaning(count, theiler, largest):
    x = np.sort(henon(150))
    states, times = np.stack([x, x[::-1]], axis=1), np.random.default_rng(0).permutation(150)
    given = states, times, np.arange(0, 150, 7), theiler, count, largest
    for found, wanted in zip(nearest_states(*given), nearest_states.py_func(*given), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_map_is_predicted_by_its_nearest_states():
    x = henon(150)
    assert prediction_error(x, 1, 2, 0, 3) < 0.01 * x.var()


def noisy(x, share=0.1, seed=0):
    return x + share * x.std() * np.random.default_rng(seed).normal(size=len(x))


@pytest.mark.parametrize(
    "series",
    [
        pytest.param(lambda: noisy(logistic(1000)), id="logistic", marks=pytest.mark.slow),
        pytest.param(lambda: noisy(henon(1000)), id="henon"),
        pytest.param(lambda: noisy(lorenz(1000, 0.05)), id="lorenz", marks=pytest.mark.slow),
        pytest.param(lambda: noisy(rossler(1000, 0.2)), id="rossler", marks=pytest.mark.slow),
        pytest.param(lambda: noisy(henon(500), 0.5), id="henon in half as much noise"),
        pytest.param(lambda: np.exp(henon(300)), id="bent"),
    ],
)
def test_motions_with_a_tenth_of_noise_are_rejected(series):
    model, answer = analysed("surrogates", series())
    found = answer.point.surrogates
    assert (found.count, found.exceeded) == (39, 0)
    assert found.judgement in (Judgement.NONLINEAR, Judgement.CHAOTIC)
    assert model.verify(answer.point).ok


@pytest.mark.parametrize("series", [logistic(500), henon(500)])
def test_chaos_is_judged_chaotic(series):
    model, answer = analysed("surrogates", series)
    plan = answer.point
    assert plan.surrogates.judgement is Judgement.CHAOTIC
    assert plan.exponent.value > 2 * plan.exponent.deviation
    assert model.verify(plan).ok


NOISE = {
    "white": (),
    "red": (0.9,),
    "a peak": (1.79, -0.95),
    "a sharp peak": (1.9108, -0.9801),
}


@pytest.mark.parametrize("name", NOISE)
def test_linear_noise_is_hardly_ever_rejected(name):
    """Check 5 seeds each, at most one of them rejected; 400 of more kinds in the slow test."""
    rejected = 0
    for seed in range(5):
        x = arma(300, NOISE[name], seed=seed)
        found = ranks(x, embed(AttractorAnalysis(x), {}), OPTIONS, seed)
        rejected += found.rejected
    assert rejected <= 1


@given(st.integers(0, 10**6))
@settings(max_examples=5)
def test_the_rank_of_white_noise_is_any(seed):
    """The share of surrogates that are more predictable is even, so the extremes are rare together."""
    g = np.random.default_rng(seed)
    few = {**OPTIONS, "count": 19}
    found = [ranks(g.normal(size=100), Embedding(1, 2, 1), few, k).exceeded for k in range(8)]
    # All at one end: 8 times the same third, 1 of 3 ** 7.
    assert 0 <= min(found) < 13 and 6 < max(found) <= 19


@pytest.mark.parametrize("name", strange())
def test_strange_series_are_judged(name):
    model, answer = analysed("surrogates", strange()[name])
    found = answer.point.surrogates
    assert model.verify(answer.point).ok
    assert all(np.isfinite(value) for value in answer.statistics.values())
    if name not in ("huge", "tiny", "far off"):  # which are a map
        assert found.judgement is not Judgement.CHAOTIC
    if name in ("a step", "a trend", "a noisy trend", "a walk"):
        assert found.judgement is Judgement.NOISE and "drifts" in answer.message


def test_units_and_a_bend_change_no_rank():
    x = henon(200)
    wanted = ranks(x, Embedding(1, 2, 1), OPTIONS, 0)
    for other in (1e6 * x - 3e8, 1e-100 * x, np.exp(x)):
        found = ranks(other, Embedding(1, 2, 1), OPTIONS, 0)
        assert found.exceeded == wanted.exceeded and found.rejected
    assert ranks(1e6 * x, Embedding(1, 2, 1), OPTIONS, 0).error == pytest.approx(wanted.error)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_false_positives_are_at_most_5_percent(capsys):
    """400 series of ten kinds, some of them with memories as long as themselves."""

    def peak(r, angle):
        return 2 * r * np.cos(angle), -r * r

    kinds = [
        ((0.5,), (), None),
        ((0.98,), (), None),
        (peak(0.9, 0.6), (), None),
        (peak(0.97, 0.4), (), None),
        (peak(0.99, 0.3), (), None),
        (peak(0.995, 0.5), (), None),
        ((0.7, -0.2), (0.6, 0.3), None),
        (peak(0.95, 0.5), (), np.exp),
        ((0.9,), (), lambda x: x**3),
        (peak(0.98, 0.3), (), np.tanh),
    ]
    rejected = ranked = 0
    for seed in range(40):
        for k, (back, ahead, bend) in enumerate(kinds):
            n = (300, 500, 1000, 2000)[(seed + k) % 4]
            x = arma(n, back, ahead, seed=100 * seed + k)
            if bend is not None:
                x = bend(x / x.std())
            found = ranks(x, embed(AttractorAnalysis(x), {}), OPTIONS, seed)
            rejected, ranked = rejected + found.rejected, ranked + (found.exceeded <= 1)
    with capsys.disabled():
        print(f"\nof 400 series of noise {rejected} rejected, by the rank alone {ranked}")
    assert rejected <= 0.05 * 400


def test_long_delays_are_thinned():
    x = np.repeat(henon(300), 40)
    x = np.convolve(x, np.ones(40) / 40, "valid")
    found = ranks(x, Embedding(40, 2, 40), OPTIONS, 0)
    assert found.rejected


def test_the_seed_decides():
    x = arma(200, (0.5,), seed=1)
    answers = [analysed("surrogates", x, seed=seed)[1].statistics for seed in (None, 0, 1)]
    assert answers[0] == answers[1] != answers[2]


def test_options():
    _, answer = analysed("surrogates", henon(150), count=99, dimension=2, delay=1, theiler=4)
    plan = answer.point
    assert plan.surrogates.count == 99
    assert (plan.delay, plan.dimension, plan.theiler) == (1, 2, 4)
    with pytest.raises(UnsupportedOption):
        analysed("surrogates", henon(150), count=18)


def test_a_run_that_is_stopped_has_no_answer():
    control = Control()
    control.stop(Limit.TIME)
    _, answer = analysed("surrogates", henon(500), control=control)
    assert answer.termination is Termination.NO_SOLUTION and answer.limit is Limit.TIME


def test_the_message_says_how_much_of_a_long_series_was_compared():
    """20,000 samples were judged by their first 2,000 without a word."""
    model = ct.load("attractor/henon")
    long = replace(model, series=np.tile(model.series, -(-1200 // len(model.series)))[:1200])
    answer = ct.solve(long, "surrogates", backend_options={"samples": 500, "count": 19}, seed=0)
    assert "compared 500 of 1200 samples" in answer.message
    assert answer.statistics["samples compared"] == 500
    whole = ct.solve(long, "surrogates", backend_options={"samples": 1200, "count": 19}, seed=0)
    assert "compared" not in whole.message
