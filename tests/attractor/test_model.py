"""Attractors as models: refused and hidden data, and slopes against curves that are counted pair by pair."""

import json
import math

import numpy as np
import pytest
from attractor.counted import fitted, plain_divergence, plain_sums
from hypothesis import given, settings, strategies as st

from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import Model
from crosstrack.models.attractor import (
    AttractorAnalysis,
    AttractorEstimate,
    Judgement,
    Slope,
    SurrogateTest,
)
from crosstrack.models.attractor.checks import RADII, Sample

RNG = np.random.default_rng(14)


def logistic(count, start=0.3):
    """The logistic map, whose exponent is ln 2."""
    found = np.empty(count)
    x = start
    for k in range(count):
        x = 4 * x * (1 - x)
        found[k] = x
    return found


#: Short series of every kind that neighbours have trouble with.
SHORT = {
    "chaos": logistic(60),
    "noise": RNG.normal(size=55),
    "ties": RNG.integers(0, 5, 60).astype(float),
    "two values": RNG.integers(0, 2, 50).astype(float),
    "duplicates": np.concatenate([logistic(28), logistic(28)]),
    "periodic": np.tile([0.0, 3.0, 1.0, 7.0], 13),
    "stuck": np.concatenate([logistic(20), np.full(15, 0.5), logistic(20, 0.11)]),
    "trend": np.arange(50.0) + RNG.normal(size=50),
    "ratio 1e6": np.where(np.arange(55) % 7 == 0, 1e6, 1.0) * (1 + logistic(55)),
}


def checked(model, plan):
    """The checks of a plan by their first word."""
    return {one.name.split()[0]: one for one in model.verify(plan).checks}


# -- the model -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"series": np.arange(49.0)}, "series must hold 50 … 10000000 samples, got 49", "series"),
        ({"series": []}, "series must hold 50 … .* got 0", "series"),
        ({"series": np.broadcast_to(1.0, 10_000_001)}, "got 10000001", "series"),
        ({"series": np.full(60, 2.5)}, "must not be constant, got 2.5 at all 60 samples", "series"),
        ({"series": np.zeros((60, 2))}, r"shape \(n\), got \(60, 2\)|shape", "series"),
        ({"series": [*range(60), math.nan]}, r"series\[60\] must be finite, got nan", "series"),
        ({"series": [math.inf, *range(60)]}, r"series\[0\] must be finite, got inf", "series"),
        ({"series": ["a"] * 60}, "series", "series"),
        ({"series": "0 1 2"}, "series must be an array of numbers", "series"),
        ({"series": np.ma.masked_less(np.arange(60.0), 3)}, "must not hold masked", "series"),
        ({"series": np.linspace(0, 2e150, 60)}, "values below 1e150", "series"),
        ({"series": np.linspace(0, 1e-151, 60)}, "differ by more than 1e-150", "series"),
        ({"series": 1e9 + 1e-5 * np.arange(60.0) ** 0.1}, "vary by more than rounding", "series"),
        ({"period": 0}, "period must be > 0 s, got 0", "period"),
        ({"period": -1.0}, "period must be > 0 s, got -1", "period"),
        ({"period": math.nan}, "period must be finite, got nan", "period"),
        ({"period": True}, "period", "period"),
        ({"unit": 3}, "unit must be a string, got 3", "unit"),
        ({"true_exponent": math.inf}, "true_exponent must be finite", "true_exponent"),
        ({"true_exponent": "0.9"}, "true_exponent", "true_exponent"),
        ({"true_dimension": -0.1}, "true_dimension must be >= 0, got -0.1", "true_dimension"),
        ({"chaotic": 1}, "chaotic must be true or false, got 1", "chaotic"),
    ],
)  # fmt: skip
def test_bad_data_is_refused_with_field_and_value(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        AttractorAnalysis(**{"series": logistic(60), **fields})
    assert caught.value.field == field


def test_the_widest_series_that_are_allowed_have_a_deviation():
    for series in (
        9e149 * RNG.choice([-1.0, 1.0], 60),
        1e-149 * RNG.normal(size=60),
        1.0 + 1e-11 * RNG.normal(size=60),
    ):
        scale = float(np.abs(series).max())
        found = AttractorAnalysis(series).deviation
        assert found == pytest.approx(scale * float(np.std(series / scale)), rel=1e-3)


def test_json_gives_the_same_model():
    model = AttractorAnalysis(logistic(60), 0.1, "m/s^2", math.log(2), 1.0, True, name="map")
    again = Model.from_json(model.to_json())
    assert again == model
    assert (again.digest, again.name, again.unit) == (model.digest, "map", "m/s^2")
    assert again.series.tobytes() == model.series.tobytes()
    assert (again.true_exponent, again.true_dimension, again.chaotic) == (math.log(2), 1.0, True)
    with pytest.raises(InvalidData, match="unknown key 'values'"):
        AttractorAnalysis.from_data({"values": [1]})
    digests = {
        AttractorAnalysis(logistic(60), *rest).digest
        for rest in [(), (2.0,), (1.0, "m"), (1.0, "", 0.5), (1.0, "", 0.5, 1.0), (1.0, "", 0.5, 1.0, False)]
    }  # fmt: skip
    assert len(digests) == 6


def test_backends_do_not_see_what_is_true():
    model = AttractorAnalysis(logistic(60), 1.0, "", math.log(2), 1.0, True)
    view = model.blinded()
    for name in ("true_exponent", "true_dimension", "chaotic"):
        with pytest.raises(HiddenData, match=f"{name} of model 'attractor' is hidden"):
            getattr(view, name)
    assert view.series is model.series
    assert view.digest == model.digest


def test_states_are_delayed_values():
    model = AttractorAnalysis(np.arange(60.0) ** 2)
    states = model.states(7, 3)
    assert states.shape == (46, 3)
    assert states.flags.c_contiguous
    assert states[45].tolist() == [45**2, 52**2, 59**2]
    assert model.states(5, 1)[:, 0].tolist() == model.series.tolist()
    with pytest.raises(
        InvalidData, match="delay 30 and dimension 3 need more than 61 samples"
    ) as e:
        model.states(30, 3)
    assert e.value.field == "dimension"


# -- curves ----------------------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SHORT)
@pytest.mark.parametrize(
    ("delay", "dimension", "theiler"),
    [(1, 1, 0), (2, 3, 5), pytest.param(1, 2, 25, marks=pytest.mark.slow)],
)
def test_slopes_are_those_of_curves_counted_by_hand(name, delay, dimension, theiler):
    model = AttractorAnalysis(SHORT[name], 0.25)
    states = model.states(delay, dimension)
    spread = float(np.ptp(model.series))
    steps = np.arange(1, 5)
    radii = np.geomspace(0.2 * spread, 0.7 * spread, RADII)
    sample = Sample(states, theiler, 0)
    claims = []
    for method, radius in (("rosenstein", None), ("kantz", 0.3 * spread)):
        ahead = np.arange(9)
        slope = Slope(method, 0.0, 0.0, 1, 4, radius)
        curve = plain_divergence(states, theiler, ahead, radius)
        assert sample.divergence(slope, ahead) == pytest.approx(curve, rel=1e-9, nan_ok=True)
        value = fitted(0.25 * steps, plain_divergence(states, theiler, steps, radius))
        claims.append((method, radius, 1, 4, value, 0.75))
    sums = plain_sums(states, theiler, radii)
    assert sample.sums(radii) == pytest.approx(sums, rel=1e-12)
    with np.errstate(divide="ignore"):
        value = fitted(np.log(radii), np.log(sums)) if sums[0] > 0 else math.nan
    claims.append(("correlation", None, radii[0], radii[-1], value, math.log(radii[-1] / radii[0])))
    for method, radius, low, high, value, width in claims:
        if not math.isfinite(value):
            found = sample.slope(Slope(method, 0.0, 0.0, low, high, radius), 0.25)[0]
            assert not math.isfinite(found)
            continue
        for off in (0.0, 1e-3, -1e-3):
            wrong = off * max(abs(value), 1 / width)
            slope = Slope(method, value + wrong, 0.0, low, high, radius)
            which = "correlation" if method == "correlation" else "exponent"
            plan = AttractorEstimate(delay, dimension, theiler, **{which: slope})
            found = checked(model, plan)[which]
            # Where neighbours are equally near, any may be taken: a slope may differ within their scatter.
            tied = method == "rosenstein" and sample.slope(slope, 0.25)[1] > 0
            assert found.ok == (off == 0 or tied), f"{method}: {found}"


def test_ties_are_excused_within_their_scatter_only():
    model = AttractorAnalysis(SHORT["ties"])
    plain = plain_divergence(model.states(1, 2), 0, np.arange(1, 4))
    value = fitted(np.arange(1, 4), plain)

    def ok(claimed):
        plan = AttractorEstimate(1, 2, 0, Slope("rosenstein", claimed, 0.0, 1, 3))
        return checked(model, plan)["exponent"].ok

    assert ok(value)
    assert not ok(value + 2.0)
    assert not ok(value - 2.0)


def test_what_has_no_neighbours_has_no_slope():
    model = AttractorAnalysis(logistic(60))
    for theiler, slope in (
        (58, Slope("rosenstein", 0.7, 0, 1, 3)),
        (0, Slope("kantz", 0.7, 0, 1, 3, 1e-9)),
    ):
        found = checked(model, AttractorEstimate(1, 1, theiler, slope))["exponent"]
        assert not found.ok
    # Steps that lead beyond the series.
    far = AttractorEstimate(1, 1, 0, Slope("rosenstein", 0.7, 0, 1, 59))
    assert not checked(model, far)["exponent"].ok
    # Radii below any distance.
    none = AttractorEstimate(1, 1, 0, None, Slope("correlation", 1.0, 0, 1e-12, 1e-11))
    assert not checked(model, none)["correlation"].ok
    # A Theiler window as long as the series.
    for theiler, good in ((58, True), (59, False), (10**9, False)):
        assert checked(model, AttractorEstimate(1, 1, theiler))["embedding"].ok == good
    with pytest.raises(InvalidData, match="need more than"):
        model.verify(AttractorEstimate(30, 3))


def test_a_sampled_slope_is_held_against_its_scatter():
    model = AttractorAnalysis(logistic(2000, 0.123))
    states, steps = model.states(1, 1), np.arange(1, 6)
    last = len(states) - 5
    apart = np.abs(states[:last] - states[:last].T)
    near = np.where(apart > 0, apart, np.inf).argmin(axis=1)
    curve = [
        np.log(np.abs(states[np.arange(last) + k] - states[near + k])).mean() for k in steps
    ]  # fmt: skip
    value = fitted(steps, curve)
    assert value == pytest.approx(math.log(2), rel=0.1)
    radii = np.geomspace(0.01, 0.1, RADII)
    sums = [(np.abs(states - states.T) <= r).mean() - 1 / 2000 for r in radii]
    dimension = fitted(np.log(radii), np.log(sums))
    kantz = np.zeros(2)
    for i, row in enumerate(apart):
        near = np.flatnonzero((row <= 0.4) & (row > 0))
        kantz += [np.log(np.abs(states[i + k] - states[near + k]).mean()) / last for k in (1, 2)]
    claims = {
        ("rosenstein", None, 1, 5): value,
        ("kantz", 0.4, 1, 2): float(kantz[1] - kantz[0]),
        ("correlation", None, 0.01, 0.1): dimension,
    }
    for (method, radius, low, high), right in claims.items():
        which = "correlation" if method == "correlation" else "exponent"
        for claimed, good in ((right, True), (right + 0.25, False), (right - 0.25, False)):
            slope = Slope(method, claimed, 0.0, low, high, radius)
            found = checked(model, AttractorEstimate(1, 1, 0, **{which: slope}))[which]
            assert found.ok == good, f"{method}: {found}"


def test_kantz_follows_many_neighbours_in_parts():
    # 20,000 states within one another's radius, of which at most 2000 are followed.
    model = AttractorAnalysis(RNG.normal(size=20_000))
    slope = Slope("kantz", 0.0, 0.0, 1, 3, 50.0)
    found = checked(model, AttractorEstimate(1, 2, 0, slope))["exponent"]
    assert found.ok  # neighbours of any kind are as far away at every step


@settings(max_examples=20, deadline=None)
@given(
    scale=st.sampled_from([1e-6, 0.3, 1.0, 7.0, 1e6]),
    shift=st.sampled_from([0.0, -3.0, 50.0]),
    period=st.sampled_from([1e-3, 1.0, 60.0]),
    seed=st.integers(0, 9),
)
def test_scale_shift_and_period_of_a_series(scale, shift, period, seed):
    series = np.random.default_rng(seed).normal(size=70).round(3)
    model = AttractorAnalysis(series)
    states = model.states(2, 2)
    moved = AttractorAnalysis(scale * (series + shift), period)
    steps = np.arange(0, 4)
    for method, radius in (("rosenstein", None), ("kantz", 1.0005)):
        slope = Slope(method, 0.0, 0.0, 0, 3, radius)
        value = fitted(steps, Sample(states, 1, 0).divergence(slope, steps))
        claimed = Slope(
            method, value / period, 0.0, 0, 3, None if radius is None else scale * radius
        )
        # Rounding decides between neighbours that are equally near.
        assert checked(moved, AttractorEstimate(2, 2, 1, claimed))["exponent"].ok
    radii = np.geomspace(0.5003, 2.0001, RADII)
    value = fitted(np.log(radii), np.log(Sample(states, 1, 0).sums(radii)))
    claimed = Slope("correlation", value, 0.0, scale * radii[0], scale * radii[-1])
    # A distance that lies at a radius but for rounding would count on one side only.
    apart = np.abs(states[:, None] - states[None]).max(axis=2)
    if np.abs(apart[..., None] / radii - 1).min() > 1e-9:
        assert checked(moved, AttractorEstimate(2, 2, 1, None, claimed))["correlation"].ok


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("feedback", [(), (-1.9, 0.96)])
def test_noise_has_a_dimension_near_the_paper_s(seed, feedback):
    from scipy.signal import lfilter

    shocks = np.random.default_rng(seed).normal(size=3000)
    series = lfilter([1.0], [1.0, *feedback], shocks)[2000:]
    spread = float(np.ptp(series))
    radii = np.geomspace(spread / 10, spread, RADII)
    states = AttractorAnalysis(series).states(8, 10)
    sums = Sample(states, 72, 0).sums(radii)
    assert 3 < fitted(np.log(radii[sums > 0]), np.log(sums[sums > 0])) < 6


# -- objective and distance ------------------------------------------------------------------------


def estimate(exponent=None, dimension=None, judgement=None, *, exceeded=0, delay=1):
    """An estimate with these figures, whatever curves say."""
    return AttractorEstimate(
        delay, 1, 0,
        None if exponent is None else Slope("rosenstein", exponent, 0.1, 1, 4),
        None if dimension is None else Slope("correlation", dimension, 0.1, 0.01, 0.1),
        None if judgement is None else SurrogateTest(judgement, 39, exceeded),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("truth", "plan", "objective"),
    [
        ((0.5, None, None), estimate(0.4), 0.2),
        ((0.5, None, None), estimate(), 1.0),
        ((0.5, None, None), estimate(-9.0), 1.0),
        ((0.0, None, None), estimate(0.01 / 4), 0.5),  # 0.01 nats a sample of 2 s
        ((None, 2.0, None), estimate(0.4, 2.5), 0.25),
        ((None, 0.0, None), estimate(None, 0.0), 0.0),
        ((0.5, 2.0, None), estimate(0.5, 1.0), 0.25),
        ((0.5, 2.0, True), estimate(0.5, 2.0, "chaotic"), 0.0),
        ((0.5, 2.0, True), estimate(0.5, 2.0, "nonlinear"), 1 / 3),
        ((0.5, 2.0, True), estimate(0.5, 2.0), 1 / 3),
        ((None, None, False), estimate(0.5, 2.0, "noise"), 0.0),
        ((None, None, False), estimate(0.5, 2.0, "nonlinear"), 0.0),
        ((None, None, False), estimate(0.5, 2.0, "chaotic"), 1.0),
        ((None, None, False), estimate(0.5), 1.0),
    ],
)
def test_the_objective_is_the_mean_relative_error_of_what_is_known(truth, plan, objective):
    model = AttractorAnalysis(logistic(60), 2.0, "", *truth)
    assert model.verify(plan).objective == pytest.approx(objective)


def test_without_truth_the_objective_is_the_error_of_prediction():
    series = logistic(300)
    model = AttractorAnalysis(series)
    plan = AttractorEstimate(2, 2, 3)
    states = model.states(2, 2)
    last, squares = len(states) - 2, []
    for i in range(last):
        apart = [
            (math.inf if abs(i - j) <= 3 else float(np.abs(states[i] - states[j]).max()))
            for j in range(last)
        ]
        j = int(np.argmin(apart))
        squares.append((states[i + 2, 1] - states[j + 2, 1]) ** 2)
    plain = math.sqrt(np.mean(squares)) / (math.sqrt(2) * states.std())
    assert model.verify(plan).objective == pytest.approx(plain)
    # A motion is predicted where noise is not, and where nothing is near, nothing is.
    noise = AttractorAnalysis(RNG.normal(size=300))
    assert model.verify(AttractorEstimate(1, 1)).objective < 0.1
    assert 0.8 < noise.verify(AttractorEstimate(1, 1)).objective < 1.2
    assert model.verify(AttractorEstimate(1, 1, 298)).objective == 1.0
    assert (
        AttractorAnalysis(np.tile([0.0, 3.0, 1.0], 20)).verify(AttractorEstimate(1, 1)).objective
        == 0
    )


@pytest.mark.parametrize(
    ("exceeded", "exponent", "judgement", "ok"),
    [
        (0, 0.5, "chaotic", True),
        (1, 0.5, "chaotic", True),  # p = 0.05
        (2, 0.5, "chaotic", False),
        (0, -0.5, "chaotic", False),
        (0, None, "chaotic", False),
        (0, None, "nonlinear", True),
        (2, 0.5, "nonlinear", False),
        (2, 0.5, "noise", True),
        (0, 0.5, "noise", True),
    ],
)
def test_a_judgement_must_follow_from_the_ranks(exceeded, exponent, judgement, ok):
    plan = estimate(exponent, None, judgement, exceeded=exceeded)
    assert checked(AttractorAnalysis(logistic(60)), plan)["judgement"].ok == ok


@pytest.mark.parametrize(
    ("one", "other", "distance"),
    [
        (estimate(0.5), estimate(0.4), 0.2),
        (estimate(0.5, 2.0), estimate(0.5, 1.0), 0.5),
        (estimate(0.5, 2.0), estimate(0.4), 0.2),
        (estimate(0.001), estimate(-0.001), 0.4),  # against 0.01 nats a sample of 2 s
        (estimate(0.5), estimate(-0.5), 2.0),
        (estimate(0.5, None, "chaotic"), estimate(0.5, None, "noise"), 1.0),
        (estimate(0.5, None, "chaotic"), estimate(0.4, None, "chaotic"), 0.2),
        (estimate(0.5), estimate(None, 2.0), 0.0),  # nothing in common but the embedding
        (estimate(delay=10), estimate(delay=8), 0.2),
        (estimate(), estimate(), 0.0),
    ],
)
def test_plans_are_as_far_apart_as_the_figures_that_both_claim(one, other, distance):
    model = AttractorAnalysis(logistic(60), 2.0)
    assert model.distance(one, other) == pytest.approx(distance)
    assert model.distance(other, one) == pytest.approx(distance)


def test_a_tolerance_is_checked_and_so_is_the_plan():
    model = AttractorAnalysis(logistic(60))
    with pytest.raises(UnsupportedOption, match="tolerance"):
        model.verify(estimate(), tolerance=0)
    with pytest.raises(InvalidData, match="plan"):
        model.verify({"delay": 1})


# -- plans -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"method": "wolf"}, "method .*rosenstein, kantz, correlation.* got 'wolf'", "method"),
        ({"value": math.nan}, "value must be finite", "value"),
        ({"deviation": -1.0}, "deviation must be >= 0, got -1", "deviation"),
        ({"low": -1}, "low must be >= 0", "low"),
        ({"high": 1}, "high must be > low = 1, got 1", "high"),
        ({"low": 0.5}, "low must be a whole number of steps, got 0.5", "low"),
        ({"high": 4.5}, "high must be a whole number of steps, got 4.5", "high"),
        ({"radius": 1.0}, "radius belongs to the method kantz, got 1.0 with rosenstein", "radius"),
        ({"method": "kantz"}, "radius belongs to the method kantz, got None with kantz", "radius"),
        ({"method": "kantz", "radius": 0}, "radius must be > 0", "radius"),
        ({"method": "correlation", "low": 0}, "low must be a radius > 0, got 0", "low"),
        ({"method": "correlation", "radius": 2.0}, "radius belongs to the method kantz", "radius"),
    ],
)
def test_slopes_that_are_none(fields, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        Slope(
            **{
                "method": "rosenstein",
                "value": 0.5,
                "deviation": 0.1,
                "low": 1,
                "high": 4,
                **fields,
            }
        )
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("make", "message", "field"),
    [
        (lambda: AttractorEstimate(0, 1), "delay must be >= 1, got 0", "delay"),
        (lambda: AttractorEstimate(1.5, 1), "delay must be a whole number", "delay"),
        (lambda: AttractorEstimate(1, 0), "dimension must be >= 1, got 0", "dimension"),
        (lambda: AttractorEstimate(1, 1001), "dimension must be <= 1000, got 1001", "dimension"),
        (lambda: AttractorEstimate(1, 1, -1), "theiler must be >= 0, got -1", "theiler"),
        (lambda: AttractorEstimate(1, 1, 0, 0.5), "exponent must be an object, got 0.5", "exponent"),
        (
            lambda: AttractorEstimate(1, 1, 0, Slope("correlation", 1, 0, 1, 2)),
            "exponent must not be a slope of a correlation sum", "exponent",
        ),
        (
            lambda: AttractorEstimate(1, 1, 0, None, Slope("rosenstein", 1, 0, 1, 2)),
            "correlation must be a slope of a correlation sum", "correlation",
        ),
        (lambda: SurrogateTest("chaos", 39, 0), "judgement .*got 'chaos'", "judgement"),
        (lambda: SurrogateTest("noise", 0, 0), "count must be >= 1, got 0", "count"),
        (lambda: SurrogateTest("noise", 9, -1), "exceeded must be >= 0, got -1", "exceeded"),
        (lambda: SurrogateTest("noise", 9, 10), "exceeded must be <= count = 9, got 10", "exceeded"),
        (lambda: AttractorEstimate.from_data([1]), r"a plan must be an object .*dimension, .*got \[1\]", "plan"),
        (lambda: AttractorEstimate.from_data({"delay": 1}), "key 'dimension' is missing", "dimension"),
        (lambda: AttractorEstimate.from_data({"delay": 1, "dimension": 1, "lag": 2}), "unknown key 'lag'", "lag"),
    ],
)  # fmt: skip
def test_estimates_that_are_none(make, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        make()
    assert caught.value.field == field


def test_json_gives_the_same_plan():
    model = AttractorAnalysis(logistic(60))
    plan = AttractorEstimate(
        8, 10, 72, Slope("kantz", 0.0831, 0.01, 3, 40, 0.5), Slope("correlation", 5.5, 0.25, 0.125, 1.5),
        SurrogateTest("chaotic", 39, 1),
    )  # fmt: skip
    text = json.dumps(model.plan_to_data(plan), allow_nan=False)
    again = model.plan_from_data(json.loads(text))
    assert again.data() == plan.data()
    assert again.surrogates.judgement is Judgement.CHAOTIC
    assert str(plan) == (
        "delay 8, dimension 10, exponent 0.0831 ± 0.01 nats/s, correlation dimension 5.5 ± 0.25, "
        "chaotic (p = 0.05)"
    )


def test_both_readings_of_the_horizon_of_the_paper():
    # The printed 0.12 as nats a second, as in equation 14.
    assert estimate(0.12).horizon == pytest.approx(8.33, abs=0.01)
    # 0.12 bits a second are 0.0832 nats a second.
    plan = estimate(0.12 * math.log(2))
    assert plan.doubling_time == pytest.approx(1 / 0.12)
    assert plan.doubling_time == pytest.approx(8.33, abs=0.01)
    assert plan.horizon == pytest.approx(12.0, abs=0.05)
    # An error that grows e-fold in the one doubles in the other.
    assert math.exp(0.12 * math.log(2) * plan.doubling_time) == pytest.approx(2.0)
    for none in (estimate(), estimate(0.0), estimate(-0.1)):
        assert none.horizon is None
        assert none.doubling_time is None


@pytest.mark.parametrize(
    ("dimension", "variables"),
    [(5.5, (6, 12)), (2.05, (3, 5)), (2.0, (3, 5)), (1.21, (2, 3)), (0.0, (1, 1)), (-0.3, (1, 1))],
)
def test_variables_that_span_an_attractor(dimension, variables):
    assert estimate(None, dimension).variables == variables
    assert estimate().variables is None
    assert AttractorEstimate(8, 10).window == 72
