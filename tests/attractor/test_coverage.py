"""Stated deviations: the truth lies within two of them, and series without chaos are not called chaotic."""

import math
from dataclasses import replace

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, logistic, lorenz, rossler

from crosstrack.instances.attractor.systems import generate
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import Evidence, Judgement
from crosstrack.models.attractor.plan import Method, Slope
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.attractor import prediction, surrogates
from crosstrack.solvers.attractor.native import Embedding
from crosstrack.solvers.attractor.prediction import prediction_error
from crosstrack.solvers.attractor.regions import variants, widened
from crosstrack.solvers.attractor.surrogates import Ranks
from crosstrack.solvers.attractor.verdict import judge


def ikeda(n):
    z, found = 0.1 + 0.1j, []
    for _ in range(n + 500):
        z = 1 + 0.9 * z * complex(
            math.cos(0.4 - 6 / (1 + abs(z) ** 2)), math.sin(0.4 - 6 / (1 + abs(z) ** 2))
        )
        found.append(z.real)
    return np.array(found[500:])


def lozi(n):
    x, y, found = -0.1, 0.1, []
    for _ in range(n + 500):
        x, y = 1 + y - 1.7 * abs(x), 0.5 * x
        found.append(x)
    return np.array(found[500:])


def gopy(n, phase=0.1):
    """Return the strange attractor without chaos of Grebogi, Ott, Pelikan and Yorke (1984)."""
    x, found = 0.5, []
    for k in range(n + 500):
        x = 3 * math.tanh(x) * math.cos(2 * math.pi * (phase + k * 0.6180339887498949))
        found.append(x)
    return np.array(found[500:])


def slope_of(name, series, period=1.0):
    backend = find_backend(name)
    model = AttractorAnalysis(series, period=period)
    plan = backend.run(model.blinded(), Request(options=backend.checked_options({}))).point
    assert model.verify(plan).ok
    return plan.exponent or plan.correlation


#: Function of the series, period, exponent and dimension: exact, Sprott 2003, appendix A, or computed from all coordinates (Lozi).
KNOWN = {
    "logistic": (lambda: logistic(2000), 1.0, math.log(2), 1.0),
    "henon": (lambda: henon(3000), 1.0, 0.41922, 1.220),
    "ikeda": (lambda: ikeda(3000), 1.0, 0.5076, 1.690),
    "lozi": (lambda: lozi(3000), 1.0, 0.47023, 1.393),
    "lorenz": (lambda: lorenz(3000, 0.05), 0.05, 0.9056, 2.068),
    "rossler": (lambda: rossler(3000, 0.3), 0.3, 0.0714, 1.991),
}


#: Maps with both figures between those of the Hénon map and of the others, and a second flow.
SIMILAR = ("ikeda", "lozi", "rossler")
SYSTEMS = [pytest.param(one, marks=[pytest.mark.slow] * (one in SIMILAR)) for one in KNOWN]


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_known_exponent_is_within_two_deviations(name):
    series, period, exponent, _ = KNOWN[name]
    slope = slope_of("rosenstein", series(), period)
    assert abs(slope.value - exponent) <= 2 * slope.deviation
    assert slope.deviation < 0.35 * exponent


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_known_dimension_is_within_two_deviations(name):
    series, _, _, dimension = KNOWN[name]
    slope = slope_of("correlation-dimension", series())
    assert abs(slope.value - dimension) <= 2 * slope.deviation
    assert slope.deviation < 0.15 * dimension


@pytest.mark.parametrize(
    ("n", "method"), [(1000, "rosenstein"), pytest.param(1000, "kantz", marks=pytest.mark.slow)]
)
def test_a_strange_attractor_without_chaos_is_not_chaotic(n, method):
    _, answer = analysed("full-analysis", gopy(n), exponent_method=method)
    assert answer.point.surrogates.judgement is not Judgement.CHAOTIC


NULLS = {
    "autoregressive": arma(1000, (1.8, -0.9), seed=2),
    "walk": arma(1000, (), seed=4).cumsum(),
}


@pytest.mark.parametrize("name", NULLS)
def test_series_without_chaos_are_not_chaotic(name):
    _, answer = analysed("surrogates", NULLS[name])
    assert answer.point.surrogates.judgement is not Judgement.CHAOTIC


def test_all_samples_of_a_long_series_are_compared():
    series = generate("rossler", 4000).series
    model, answer = analysed("surrogates", series)
    assert answer.statistics["samples compared"] == 4000
    assert answer.statistics["deviations below"] > 20
    assert answer.point.surrogates.judgement is Judgement.CHAOTIC
    assert "compared" not in answer.message
    assert model.verify(answer.point).ok


def test_many_surrogates_of_a_long_series_compare_fewer_samples(monkeypatch):
    monkeypatch.setattr(surrogates, "VALUES", 39 * 2100)
    _, answer = analysed("surrogates", henon(3000), delay=1, dimension=1)
    assert answer.statistics["samples compared"] == 2100
    assert "compared 2100 of 3000 samples" in answer.message


def test_a_small_exponent_of_a_short_series_is_not_called_chaotic():
    clear = Ranks(39, 0, 0.1, 1.0, 50.0, 0.0)
    evidence = Evidence(1, 0.5, 0.1, 5.0, 0.0, 1, 0.9)
    slope = Slope(Method.ROSENSTEIN, 0.01, 0.001, 0.0, 5.0)
    assert judge(clear, evidence, slope, 10_000)[0].judgement is Judgement.CHAOTIC
    test, said = judge(clear, evidence, slope, 1000)
    assert test.judgement is Judgement.NONLINEAR and "10 nats over its length" in said
    test, said = judge(clear, evidence, replace(slope, deviation=0.02), 10_000)
    assert test.judgement is Judgement.NONLINEAR and "exceed 0 by 3 deviations" in said
    test, said = judge(clear, evidence, None, 10_000)
    assert test.judgement is Judgement.NONLINEAR and "no positive exponent" in said


@pytest.mark.parametrize(
    ("change", "least"),
    [
        ({}, 3.0),
        ({"step": 2}, 2.0),
        ({"step": 2, "nonlinear": 0.21}, 4.0),
        ({"step": 2, "nonlinear": 0.22, "edition": 1}, 2.0),
        ({"step": 2, "nonlinear": 0.23, "edition": 1}, 4.0),
    ],
)
def test_the_exponent_of_chaos_is_clear(change, least):
    clear = Ranks(39, 0, 0.1, 1.0, 50.0, 0.0)
    evidence = replace(Evidence(1, 0.5, 0.18, 5.0, 0.0, 1, 0.9, 2), **change)
    slope = Slope(Method.ROSENSTEIN, 1.0, 0.99 / least, 0.0, 5.0)
    assert judge(clear, evidence, slope, 10_000)[0].judgement is Judgement.CHAOTIC
    test, said = judge(clear, evidence, replace(slope, deviation=1.01 / least), 10_000)
    assert test.judgement is Judgement.NONLINEAR and f"exceed 0 by {least:g} deviations" in said


@pytest.mark.parametrize(
    ("edition", "nonlinear", "judgement"),
    [
        (2, 0.15, Judgement.CHAOTIC),
        (2, 0.16, Judgement.NONLINEAR),
        (1, 0.15, Judgement.NONLINEAR),
    ],
)
def test_slow_partings_are_left_out_of_a_clear_deviation(edition, nonlinear, judgement):
    """12 of 1,000 nats are in the deviation: 0.025 is 1.7 deviations, and 2.8 without them."""
    evidence = Evidence(1, 0.5, nonlinear, 5.0, 0.0, 2, 0.9, edition)
    slope = Slope(Method.ROSENSTEIN, 0.025, 0.015, 0.0, 5.0)
    test, why = judge(Ranks(39, 0, 0.1, 1.0, 50.0, 0.0), evidence, slope, 1000.0)
    assert test.judgement is judgement
    assert ("exceed 0 by 2 deviations" in why) is (judgement is Judgement.NONLINEAR)


@pytest.mark.parametrize(
    ("change", "judgement", "said"),
    [
        ({"far": 4.5}, Judgement.REGULAR, ""),
        ({"linear": 0.001, "near": 1.0, "far": 0.5}, Judgement.REGULAR, ""),
        ({"far": 2.0}, Judgement.NONLINEAR, "have not parted"),
        ({"zero_one": 0.1}, Judgement.NONLINEAR, "0-1 test gives 0.1"),
        ({"nonlinear": 0.45}, Judgement.NONLINEAR, "clearly better than a linear"),
        ({"nonlinear": 0.55}, Judgement.NONLINEAR, "clearly better than a linear"),
    ],
)
def test_evidence_decides(change, judgement, said):
    clear = Ranks(39, 0, 0.1, 1.0, 50.0, 0.0)
    evidence = replace(Evidence(1, 0.5, 0.1, 5.0, 0.0, 1, 0.9), **change)
    slope = Slope(Method.ROSENSTEIN, 0.01, 0.001, 0.0, 5.0)
    test, why = judge(clear, evidence, slope, 10_000)
    assert test.judgement is judgement and said in why
    close = replace(clear, sigmas=5.0)
    weak = replace(evidence, linear=0.5, nonlinear=0.55, far=0.0)
    assert judge(close, weak, slope, 10_000)[0].judgement is Judgement.NOISE
    drifts, why = judge(replace(clear, jump=2.0), evidence, slope, 10_000)
    assert drifts.judgement is Judgement.NOISE and "drifts" in why


@pytest.mark.parametrize(("delay", "dimension", "theiler"), [(1, 2, 1), (3, 6, 20)])
def test_the_sampled_error_is_near_that_of_all_states(delay, dimension, theiler, monkeypatch):
    series = arma(1500, (1.6, -0.8), seed=5)
    wanted = prediction_error(series, delay, dimension, theiler, 5)
    for name in ("ASKED", "ASKED_HIGH"):
        monkeypatch.setattr(prediction, name, 700)
    found = prediction_error(series, delay, dimension, theiler, 5)
    assert found != wanted and found == pytest.approx(wanted, rel=0.1)


def test_deviations_add_in_squares():
    slope = Slope(Method.ROSENSTEIN, 2.0, 0.3, 0.0, 5.0)
    found = widened(slope, 0.4, [2.5, 1.5], relative=0.5, unconfirmed=9.0, absolute=0.2)
    assert found.deviation == pytest.approx(math.sqrt(0.09 + 0.16 + 0.25 + 1.0 + 0.04))
    alone = widened(slope, 0.0, [math.nan], relative=0.0, unconfirmed=0.2)
    assert alone.deviation == pytest.approx(0.5)
    assert replace(found, deviation=0.3).data() == slope.data()


def test_other_embeddings_fit_the_series():
    assert list(variants(Embedding(1, 2, 1), 1000)) == [Embedding(1, 3, 2), Embedding(1, 4, 3)]
    many = list(variants(Embedding(4, 6, 20), 1000))
    assert [(one.delay, one.dimension) for one in many] == [(4, 7), (4, 8), (2, 7), (4, 3)]
    assert list(variants(Embedding(5, 5, 5), 50)) == [Embedding(2, 6, 5)]
