"""Verdicts: noise, regular and chaotic motion of known kinds, their evidence, and series of every scale."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from attractor.known import analysed, arma, flow, henon, logistic, lorenz
from attractor.test_coverage import gopy, ikeda

from crosstrack.errors import InvalidData
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import AttractorEstimate, Judgement, SurrogateTest, evidence
from crosstrack.models.attractor.evidence import (
    linear_error as plain_linear_error,
    zero_one as plain_zero_one,
)
from crosstrack.solvers.attractor import embedding, native, prediction, verdict
from crosstrack.solvers.attractor.native import RunStopped, embed
from crosstrack.solvers.attractor.prediction import choose_embeddings
from crosstrack.solvers.attractor.surrogates import Ranks, normal_scores, surrogates_of
from crosstrack.solvers.attractor.verdict import linear_error, zero_one


def sine(n, speed=0.3):
    return np.sin(speed * np.arange(n) + 0.2)


def torus(n):
    return sine(n) + 0.6 * sine(n, 0.3 * (math.sqrt(5) - 1) / 2)


@cache
def van_der_pol(n):
    return flow(lambda _, u: (u[1], 2 * (1 - u[0] ** 2) * u[1] - u[0]), n, 0.1, (1.0, 1.0))


@cache
def chen(n):
    return flow(
        lambda _, u: (35 * (u[1] - u[0]), -7 * u[0] - u[0] * u[2] + 28 * u[1], u[0] * u[1] - 3 * u[2]),
        n, 0.02, (-3.0, 2.0, 20.0),
    )  # fmt: skip


@cache
def duffing(n):
    """A driven Duffing oscillator with two wells."""
    return flow(
        lambda t, u: (u[1], u[0] - u[0] ** 3 - 0.25 * u[1] + 0.4 * math.sin(t)), n, 0.3, (0.2, 0.0)
    )


@cache
def double_pendulum(n):
    """Rate of the upper angle of two equal pendulums of 1 m, released at 2.0 and 2.5; the exponent is about 1.4."""

    def rates(_, u):
        p, q, a, b = u
        c, s = math.cos(a - b), math.sin(a - b)
        one = -s * q * q - 19.62 * math.sin(a)
        two = s * p * p - 9.81 * math.sin(b)
        return (one - c * two) / (2 - c * c), (2 * two - c * one) / (2 - c * c), p, q

    return flow(rates, n, 0.05, (0.0, 0.0, 2.0, 2.5))


def pink(n, seed=0):
    size = np.maximum(np.fft.rfftfreq(n), 1 / n) ** -0.5
    phases = np.random.default_rng(seed).random(len(size))
    return np.fft.irfft(size * np.exp(2j * np.pi * phases), n)


def judgement(series, name="surrogates", **options):
    model, answer = analysed(name, series, **options)
    assert model.verify(answer.point).ok
    return answer.point.surrogates.judgement, answer


#: Functions of the series, by motion.
REGULAR = {
    "sine": lambda: sine(500),
    "slow sine": lambda: sine(1000, 0.03),
    "fast sine": lambda: sine(1000, 1.9),
    "torus": lambda: torus(500),
    "van der pol": lambda: van_der_pol(500),
    "period 3": lambda: np.tile([0.16, 0.5, 0.96], 100),
    "noisy sine": lambda: sine(500) + 0.03 * arma(500, ()),
}
CHAOTIC = {
    "logistic": lambda: logistic(500),
    "henon": lambda: henon(500),
    "ikeda": lambda: ikeda(1000),
    "lorenz": lambda: lorenz(600, 0.05),
    "chen": lambda: chen(3000),
    "double pendulum": lambda: double_pendulum(6000),
    "sprott s": lambda: sprott_s(1000),
    "noisy henon": lambda: henon(1000) + 0.035 * arma(1000, ()),
}
NOISE = {
    "white": lambda: arma(500, (), seed=1),
    "resonant": lambda: arma(500, (1.7, -0.9), seed=2),
    "coloured": lambda: arma(500, (0.9,), seed=3),
    "1/f": lambda: pink(500),
    "exponential of coloured": lambda: np.exp(arma(500, (0.8,), seed=4) / 2),
    "cube of resonant": lambda: arma(500, (1.5, -0.8), seed=5) ** 3,
    "phases of henon": lambda: surrogates_of(henon(500), 1, np.random.default_rng(1))[0],
}
#: Cases of known motions that differ from the others in speed or length alone.
LONG = ("slow sine", "fast sine", "ikeda", "chen", "double pendulum", "sprott s")
CASES = [
    *((name, series, Judgement.REGULAR) for name, series in REGULAR.items()),
    *((name, series, Judgement.CHAOTIC) for name, series in CHAOTIC.items()),
    *((name, series, Judgement.NOISE) for name, series in NOISE.items()),
]


@pytest.mark.parametrize(
    ("name", "series", "wanted"),
    [
        pytest.param(*case, id=case[0], marks=[pytest.mark.slow] * (case[0] in LONG))
        for case in CASES
    ],
)
def test_known_motions_are_judged(name, series, wanted):
    assert judgement(series())[0] is wanted


@pytest.mark.parametrize("n", [500, pytest.param(1500, marks=pytest.mark.slow)])
def test_a_strange_motion_without_chaos_is_undecided(n):
    found, answer = judgement(gopy(n, phase=0.3))
    assert found is Judgement.NONLINEAR and "but" in answer.message


@pytest.mark.slow
def test_a_short_series_of_a_double_pendulum_is_undecided():
    found, answer = judgement(double_pendulum(2000))
    assert found is Judgement.NONLINEAR and "do not predict clearly better" in answer.message


@pytest.mark.parametrize(
    ("series", "wanted"),
    [
        (sine(300), Judgement.REGULAR),
        (henon(300), Judgement.CHAOTIC),
        (arma(300, (0.5,)), Judgement.NOISE),
    ],
)
def test_scale_shift_and_seed_keep_the_verdict(series, wanted):
    for other in (series, 1e-100 * series, 1e100 * series, -3e6 * series + 1e7):
        first, answer = judgement(other)
        assert first is wanted
    assert judgement(other)[1].point.data() == answer.point.data()


@pytest.mark.parametrize(
    ("nonlinear", "sigmas", "is_noise"), [(1.01, 6.9, True), (1.01, 7.1, False), (0.99, 6.9, False)]
)
def test_a_better_linear_prediction_means_noise_unless_the_rank_is_clear(
    nonlinear, sigmas, is_noise
):
    _, answer = judgement(henon(300))
    plan, ranking = answer.point, Ranks(39, 0, 0.1, 0.2, sigmas, 0.0)
    seen = replace(plan.surrogates.evidence, linear=0.1, nonlinear=0.1 * nonlinear)
    test, _ = verdict.judge(ranking, seen, plan.exponent, 300.0)
    assert (test.judgement is Judgement.NOISE) is is_noise


def test_full_analysis_gives_the_same_verdict():
    for series in (torus(300), henon(300), arma(300, (0.5,))):
        assert judgement(series, "full-analysis")[0] is judgement(series)[0]


def test_wild_series_end_in_a_result_or_an_error():
    spike = arma(200, ())
    spike[100] = 1e100
    jumps = np.repeat([0.0, 5.0, -3.0, 8.0], 50) + arma(200, ())
    for series in (spike, jumps, henon(50), np.r_[np.zeros(100), henon(100)]):
        assert judgement(series)[0] in Judgement
    for series in (np.full(100, 3.0), np.r_[henon(99), math.nan], henon(49)):
        with pytest.raises(InvalidData, match="series"):
            AttractorAnalysis(series)


@pytest.mark.parametrize(
    ("series", "step"), [(henon(700), 1), (torus(1000), 3), (arma(2500, (0.9,)), 2)]
)
def test_evidence_is_that_of_plain_loops(series, step):
    x = (series - series.mean()) / series.std()
    assert zero_one(x, step) == pytest.approx(plain_zero_one(x, step), abs=1e-9)
    assert linear_error(x, 2) == pytest.approx(plain_linear_error(x, 2), abs=1e-9)


@cache
def sprott_s(n):
    return flow(
        lambda _, u: (-u[0] - 4 * u[1], u[0] + u[2] ** 2, 1 + u[0]), n, 0.3, (0.1, 0.1, 0.1)
    )


def test_the_0_1_test_reads_about_six_samples_per_period():
    """With eight samples per period, chaos of Sprott's case S had a correlation of 0.002."""

    def correlation(series):
        return zero_one(series, round(embedding.mean_period(series) / verdict.PER_PERIOD))

    assert correlation(sprott_s(1000)) > 0.9 > 0.2 > abs(correlation(torus(1000)))


def test_the_0_1_test_separates_periodic_from_irregular_series():
    assert abs(zero_one(sine(1500), 1)) < 0.05
    assert zero_one(logistic(1500), 1) > 0.95 and zero_one(arma(1500, ()), 1) > 0.95


@pytest.mark.parametrize(
    "change", [{"zero_one": 0.5}, {"near": 1.0}, {"far": 1.5}, {"linear": 0.5}, {"nonlinear": 0.3}]
)
def test_a_forged_evidence_is_not_verified(change):
    model, answer = analysed("surrogates", henon(400))
    plan = answer.point
    forged = replace(plan.surrogates, evidence=replace(plan.surrogates.evidence, **change))
    result = model.verify(replace(plan, surrogates=forged))
    assert [check.name for check in result.checks if not check.ok][:1] != [] and not result.ok


@pytest.mark.parametrize(
    ("series", "word"),
    [(henon(400), "regular"), (sine(400), "chaotic"), (arma(400, ()), "chaotic")],
)
def test_a_false_verdict_is_not_verified(series, word):
    model, answer = analysed("surrogates", series)
    plan = answer.point
    assert not model.verify(
        replace(plan, surrogates=replace(plan.surrogates, judgement=Judgement(word), exceeded=0))
    ).ok


def test_the_automatic_delay_is_bounded_by_the_mean_period():
    """The mutual information of Duffing's oscillator has its first minimum far beyond a quarter of a turn."""
    model = AttractorAnalysis(duffing(3000), period=0.3)
    assert embed(model, {}).delay <= 11
    embeddings, ahead = choose_embeddings(model, {})
    assert 5 <= len(embeddings) <= 8 and ahead == embed(model, {}).delay
    assert choose_embeddings(model, {"delay": 4, "dimension": 4})[0] == [
        embed(model, {"delay": 4, "dimension": 4})
    ]


def test_a_clean_map_keeps_the_embeddings_that_predict_it():
    """Its error in eight coordinates is many times that in two; noise makes the errors similar."""
    clean, noise = henon(1000), 0.1 * arma(1000, ())
    few, many = (choose_embeddings(AttractorAnalysis(x), {})[0] for x in (clean, clean + noise))
    assert few[0].dimension == 2 and len(few) < 5 <= len(many) <= 8


def test_the_exponent_agrees_with_the_median_of_several_embeddings():
    _, answer = analysed("rosenstein", lorenz(3000, 0.05))
    figures, slope = answer.statistics, answer.point.exponent
    least, largest = figures["least in other embeddings"], figures["largest in other embeddings"]
    assert figures["other embeddings"] >= 3
    assert least - slope.deviation <= slope.value <= largest + slope.deviation
    assert slope.value == pytest.approx(0.9056 * 0.05, abs=2 * slope.deviation)


def test_ranks_of_transformed_noise_are_those_of_the_noise():
    noise = arma(400, (0.8,), seed=7)
    np.testing.assert_allclose(normal_scores(np.exp(noise)), normal_scores(noise), atol=1e-12)


def test_noise_of_a_narrow_band_is_not_regular():
    """Such noise follows a linear recursion to 1e-5, but neighbours part."""
    band = np.fft.rfft(arma(4000, (), seed=1))
    band[120:] = 0.0
    found, answer = judgement(np.fft.irfft(band)[:1000])
    assert found is Judgement.NOISE and answer.point.surrogates.evidence.linear < 1e-3


@pytest.mark.parametrize(
    ("delay", "dimension"),
    [(100, 4), (95, 4), (1, 390), (200, None), (398, None)],
)
def test_an_embedding_as_long_as_the_series_is_judged(delay, dimension):
    given = {"delay": delay} if dimension is None else {"delay": delay, "dimension": dimension}
    for name in ("surrogates", "full-analysis"):
        assert judgement(arma(400, ()), name, theiler=0, **given)[0] in Judgement


@pytest.mark.parametrize("size", [0.0, 1e-13])
def test_a_sensor_that_starts_late_is_judged(size, monkeypatch):
    """The predictions compare the first samples, here 500. Cao's method is slow for equal states."""
    for module, name in ((prediction, "SAMPLES"), (verdict, "SAMPLES"), (evidence, "LEADING")):
        monkeypatch.setattr(module, name, 500)
    if size:
        monkeypatch.setattr(native, "cao_dimension", lambda *_: 2)
    assert judgement(np.r_[size * arma(501, ()), arma(250, ())])[0] in Judgement


@pytest.mark.parametrize(
    ("changed", "change"),
    [
        ({}, {"step": 5}),
        ({}, {"step": 10**6}),
        ({}, {"ahead": 396}),
        ({}, {"ahead": 10**6}),
        ({"delay": 130, "dimension": 4}, {}),
        ({"theiler": 395}, {"near": 5.0, "far": 5.0}),
    ],
)
def test_evidence_of_other_samples_is_not_verified(changed, change):
    model, answer = analysed("surrogates", henon(400))
    plan = replace(answer.point, exponent=None, **changed)
    forged = replace(plan.surrogates, evidence=replace(plan.surrogates.evidence, **change))
    result = model.verify(replace(plan, surrogates=forged))
    assert "evidence follows from the series" in [one.name for one in result.checks if not one.ok]


@pytest.mark.parametrize(("series", "step"), [(henon(400), 2), (sine(400), 1)])
def test_another_step_of_the_0_1_test_is_not_verified(series, step):
    """The step is that of the mean period, and selects the separation that chaos needs."""
    model, answer = analysed("surrogates", series)
    test = answer.point.surrogates
    assert test.evidence.step != step
    other = replace(test.evidence, step=step, zero_one=zero_one(series, step))
    result = model.verify(replace(answer.point, surrogates=replace(test, evidence=other)))
    assert "evidence follows from the series" in [one.name for one in result.checks if not one.ok]


def test_a_stop_ends_the_choice_of_embeddings():
    def poll():
        raise RunStopped

    with pytest.raises(RunStopped):
        choose_embeddings(AttractorAnalysis(henon(400)), {}, poll)


@pytest.mark.parametrize(
    "series",
    [np.exp(arma(1500, (0.9,)) / 2), np.round(10 * sine(300, 0.0731))],
    ids=["heavy tails", "ties"],
)
def test_evidence_of_heavy_tails_and_ties_is_verified(series):
    assert judgement(series)[0] in Judgement


def test_chaos_of_too_few_nats_is_not_verified():
    model, answer = analysed("surrogates", henon(400))
    test = answer.point.surrogates
    assert test.judgement is Judgement.CHAOTIC and test.evidence.needed == 80.0
    shorter = AttractorAnalysis(model.series[:150])
    result = shorter.verify(answer.point)
    assert "judgement follows from the ranks" in [one.name for one in result.checks if not one.ok]


def test_plans_without_evidence_keep_their_json_form():
    old = {"judgement": "noise", "count": 39, "exceeded": 4}
    assert SurrogateTest.from_data(old).data() == old


@pytest.mark.parametrize("series", [henon(400), lorenz(600, 0.05)], ids=["map", "flow"])
def test_plans_of_the_first_edition_are_verified_by_its_rules(series, monkeypatch):
    monkeypatch.setattr(verdict, "EDITION", 1)
    monkeypatch.setattr(verdict, "PER_PERIOD", 8)
    monkeypatch.setattr(verdict, "linear_map_error", lambda *_: math.nan)
    model, answer = analysed("surrogates", series)
    data = answer.point.data()
    assert "edition" not in data["surrogates"]["evidence"]
    assert model.verify(AttractorEstimate.from_data(data)).ok
    data["surrogates"]["evidence"]["edition"] = 2
    result = model.verify(AttractorEstimate.from_data(data))
    assert "evidence follows from the series" in [one.name for one in result.checks if not one.ok]
    data["surrogates"]["evidence"]["edition"] = 3
    with pytest.raises(InvalidData, match="edition must be <= 2, got 3"):
        AttractorEstimate.from_data(data)
