"""Known systems, noises and signals as series: their equations, statistics, seeds and known figures."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from crosstrack.errors import InvalidData
from crosstrack.instances.attractor import generate, motions, systems
from crosstrack.instances.attractor.motions import largest_exponent, orbit
from crosstrack.instances.attractor.systems import SYSTEMS, System, motion_of

NAMES = [str(one) for one in System]


def make_motion(name: str, seed: int = 0) -> motions.Motion:
    return motion_of(System(name), np.random.default_rng(seed))


def lorenz(t, x):
    return [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]]


def rossler(t, x):
    return [-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)]


# -- what the series obey ------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_maps_obey_their_equations(seed):
    x = generate("logistic", 3000, seed=seed).series
    assert x[1:] == pytest.approx(4 * x[:-1] * (1 - x[:-1]), abs=2e-13)
    assert x.min() > 0 and x.max() < 1
    y = generate("henon", 3000, seed=seed).series
    assert y[2:] == pytest.approx(1 - 1.4 * y[1:-1] ** 2 + 0.3 * y[:-2], abs=1e-14)


@pytest.mark.parametrize(("name", "rates"), [("lorenz", lorenz), ("rossler", rossler)])
@pytest.mark.parametrize("period", [0.003, 0.1, 0.73])
def test_flows_agree_with_scipy(name, rates, period):
    states = orbit(make_motion(name, 4), 8, period)
    for one, following in itertools.pairwise(states):
        found = solve_ivp(rates, (0, period), one, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        assert following == pytest.approx(found, rel=1e-5, abs=1e-5)
    assert generate(name, 60, seed=4, period=period).series[:8].tolist() == states[:, 0].tolist()


def test_the_delayed_equation_is_followed():
    period = 0.1
    x = generate("mackey-glass", 2000, period=period).series
    delayed = x[:-170]
    force = 0.2 * delayed / (1 + delayed**10)
    slope = np.gradient(x, period)[170:]
    assert slope[1:-1] == pytest.approx((force - 0.1 * x[170:])[1:-1], abs=2e-4)
    assert np.ptp(x) > 0.7


def test_signals_are_what_they_say():
    times = np.arange(500)
    wave = generate("sine", 500).series
    basis = np.stack([np.sin(0.25 * times), np.cos(0.25 * times)], axis=1)
    fit, rest, *_ = np.linalg.lstsq(basis, wave, rcond=None)
    assert math.hypot(*fit) == pytest.approx(1, abs=1e-9) and rest < 1e-18
    more = 0.25 * math.sqrt(2) * times
    basis = np.column_stack([basis, np.sin(more), np.cos(more)])
    assert np.linalg.lstsq(basis, generate("two-sines", 500).series, rcond=None)[1] < 1e-18
    teeth = generate("sawtooth", 500).series
    assert np.array_equal(teeth[20:], teeth[:-20]) and len(set(teeth.tolist())) == 20


def test_noises_have_their_statistics():
    count = 50_000
    white = generate("white-noise", count, seed=2).series
    assert (abs(white.mean()), white.std()) == (
        pytest.approx(0, abs=0.01),
        pytest.approx(1, abs=0.01),
    )
    assert (white**4).mean() == pytest.approx(3, abs=0.2)
    walk = np.diff(generate("random-walk", count, seed=2).series)
    assert walk == pytest.approx(white[1:], abs=1e-9)
    for name, feedback in (
        ("ar1", [0.9]),
        ("ar2", [2 * 0.98 * math.cos(0.25), -(0.98**2)]),
    ):
        x = generate(name, count, seed=3).series
        order = len(feedback)
        past = np.stack([x[order - 1 - k : -1 - k] for k in range(order)], axis=1)
        fit = np.linalg.lstsq(past, x[order:], rcond=None)[0]
        assert fit == pytest.approx(feedback, abs=1e-2)
        driven = x[order:] - past @ feedback
        assert driven.std() == pytest.approx(1, abs=0.02)
        assert abs(np.corrcoef(driven[1:], driven[:-1])[0, 1]) < 0.02


def test_a_longer_period_leaves_values_out():
    for name in ("logistic", "henon"):
        every = generate(name, 200).series
        assert np.array_equal(generate(name, 60, period=2).series, every[:120:2])
    for name in ("sine", "sawtooth"):
        assert generate(name, 60, period=2).series == pytest.approx(
            generate(name, 120).series[::2], abs=1e-9
        )
    assert generate("ar2", 60, period=4).period == 4
    assert len(generate("random-walk", 60, period=7).series) == 60


# -- known figures -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_known_figures_are_hidden_until_asked(name):
    model, known = generate(name, 60, name="x"), SYSTEMS[System(name)]
    assert (model.true_exponent, model.true_dimension) == (known.exponent, known.dimension)
    assert (model.chaotic, model.period, model.name) == (known.chaotic, known.period, "x")
    assert set(model.hidden_fields()) == {"true_exponent", "true_dimension", "chaotic"}
    assert known.exponent is None or (known.exponent > 0) == known.chaotic


def test_the_exponent_of_the_logistic_map():
    x = generate("logistic", 1_000_000, seed=1).series
    assert np.log(np.abs(4 - 8 * x)).mean() == pytest.approx(math.log(2), abs=2e-3)
    # The density of its values is known: half of them are below sin²(π/4), a third below sin²(π/6).
    assert (x < 0.5).mean() == pytest.approx(1 / 2, abs=2e-3)
    assert (x < 0.25).mean() == pytest.approx(1 / 3, abs=2e-3)


def test_rounding_ends_no_orbit():
    for seed in range(3):
        x = generate("logistic", 1_000_000, seed=seed).series
        assert len(np.unique(x)) > 999_000
        assert len(np.unique(x[-1000:])) == 1000


@pytest.mark.parametrize(
    ("name", "duration", "within"), [("henon", 20_000, 8e-3), ("lorenz", 1000, 3e-2)]
)
def test_exponents_by_the_tangent_vector(name, duration, within):
    found = largest_exponent(make_motion(name), duration)
    assert found.exponent == pytest.approx(SYSTEMS[System(name)].exponent, abs=within)
    assert 0 < found.deviation < within


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "duration", "within"),
    [("henon", 2e6, 1e-3), ("lorenz", 2e5, 2e-3), ("rossler", 5e5, 1e-3)],
)
def test_long_orbits_have_the_exponents_that_are_known(name, duration, within):
    for seed in range(2):
        found = largest_exponent(make_motion(name, seed), duration)
        assert found.exponent == pytest.approx(SYSTEMS[System(name)].exponent, abs=within)
        assert found.deviation < within


@pytest.mark.parametrize("name", ["henon", "lorenz", "rossler"])
def test_the_tangent_vector_is_that_of_nearby_orbits(name):
    motion = make_motion(name, 2)
    motion = motion._replace(start=orbit(motion, 1, 1.0)[0], transient=0.0)
    count = len(motion.start)
    inner, step = motions._steps(motion, 1.0)
    tangent = np.arange(1.0, count + 1)
    ends = []
    for sign in (1, -1):
        state = motion.start + sign * 1e-6 * tangent
        motions._advance.py_func(
            motion.kind, motion.constants, state, np.zeros(count), step, inner, np.empty((6, count))
        )
        ends.append(state)
    moved = tangent.copy()
    motions._advance.py_func(
        motion.kind, motion.constants, motion.start.copy(), moved, step, inner, np.empty((6, count))
    )
    assert moved == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-5)


def test_compiled_loops_mean_what_they_say():
    motion = make_motion("lorenz", 3)._replace(transient=0.0)
    inner, step = motions._steps(motion, 0.02)
    for name, shape in (("_orbit", (50, 3)), ("_growth", (50,))):
        kernel = getattr(motions, name)
        plain, compiled = np.empty(shape), np.empty(shape)
        given = (motion.kind, motion.constants, motion.start, step, inner, 2)
        kernel.py_func(*given, plain)
        kernel.dispatcher(*given, compiled)
        assert np.array_equal(plain, compiled)
    draws = np.random.default_rng(1).random(500)
    plain, compiled = np.empty(500), np.empty(500)
    systems._iterate_logistic.py_func(draws, plain)
    systems._iterate_logistic.dispatcher(draws, compiled)
    assert np.array_equal(plain, compiled)
    start = 0.5 + draws[:171]
    systems._iterate_delayed.py_func(start, 0.1, 200, 3, plain)
    systems._iterate_delayed.dispatcher(start, 0.1, 200, 3, compiled)
    assert np.array_equal(plain, compiled)


# -- seeds, and what spoils a series -------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_means_the_same_series(name):
    one = generate(name, 80, seed=5)
    assert one.digest == generate(name, 80, seed=5).digest
    if name != "sawtooth":
        assert one.digest != generate(name, 80, seed=6).digest
    longer = generate(name, 300, seed=5).series
    if SYSTEMS[System(name)].period != 1.0:
        assert np.array_equal(longer[:80], one.series)


@pytest.mark.parametrize("ratio", [0.1, math.sqrt(10)])
def test_noise_is_as_loud_as_asked(ratio):
    plain, noisy = generate("lorenz", 20_000), generate("lorenz", 20_000, noise=ratio)
    added = noisy.series - plain.series
    assert added.std() / plain.deviation == pytest.approx(ratio, rel=0.02)
    assert abs(np.corrcoef(added, plain.series)[0, 1]) < 0.03
    assert (noisy.true_exponent, noisy.true_dimension, noisy.chaotic) == (None, None, True)


def test_trends_spikes_levels_and_scales():
    plain = generate("henon", 5000)
    deviation = plain.deviation
    rising = generate("henon", 5000, trend=-4.0).series - plain.series
    assert rising == pytest.approx(np.linspace(0, -4 * deviation, 5000), rel=1e-5)
    away = generate("henon", 5000, spikes=0.02).series - plain.series
    hit = away != 0
    assert np.abs(away[hit]) == pytest.approx(10 * deviation, rel=1e-5)
    assert 60 < hit.sum() < 140 and (away > 0).any() and (away < 0).any()
    three = generate("henon", 5000, levels=3)
    assert len(set(three.series.tolist())) == 3 and three.true_exponent is None
    fine = generate("henon", 5000, levels=1001).series
    assert np.abs(fine - plain.series).max() <= np.ptp(plain.series) / 2000 * (1 + 1e-9)
    for scale in (1e-6, 1e6):
        scaled = generate("henon", 5000, scale=scale)
        assert scaled.series == pytest.approx(scale * plain.series, rel=1e-15)
        assert scaled.true_exponent == plain.true_exponent
        assert scaled.true_dimension == plain.true_dimension


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"system": "lorentz"}, "system must be one of logistic, henon, lorenz"),
        ({"count": 49}, "count must be >= 50, got 49"),
        ({"count": 10**8}, "count must be <= 10000000"),
        ({"seed": -1}, "seed must be >= 0"),
        ({"period": 0}, "period must be >= 0.0001 s"),
        ({"period": 0.5}, "period must be a whole number"),
        ({"system": "ar1", "period": 1e9}, "period must be <= 1e\\+06 s"),
        ({"system": "ar1", "period": 1e6}, "period must be <= 166666"),
        ({"system": "lorenz", "period": 1e5}, "period must be shorter, or samples fewer"),
        ({"system": "mackey-glass", "count": 10**7, "period": 100}, "period must be shorter"),
        ({"noise": -0.1}, "noise must be >= 0"),
        ({"trend": math.inf}, "trend must be finite"),
        ({"spikes": 1.5}, "spikes must be <= 1"),
        ({"levels": 1}, "levels must be >= 2"),
        ({"scale": 0}, "scale must be > 0"),
        ({"scale": 1e200}, "below 1e150"),
    ],
)
def test_the_generator_refuses(options, message):
    with pytest.raises(InvalidData, match=message):
        generate(**{"system": "henon", "count": 60, **options})


def test_exponents_are_refused_without_equations_or_time():
    with pytest.raises(InvalidData, match="henon, lorenz, rossler, got ar1"):
        make_motion("ar1")
    with pytest.raises(InvalidData, match="duration must be >= 20 s, got 5"):
        largest_exponent(make_motion("lorenz"), 5)
    with pytest.raises(InvalidData, match="interval must be > 0"):
        largest_exponent(make_motion("lorenz"), 100, 0)
    away = make_motion("henon")._replace(start=np.array([9.0, 9.0]))
    with pytest.raises(InvalidData, match="must stay bounded"):
        largest_exponent(away, 1000)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_million_samples(name):
    series = generate(name, 1_000_000).series
    assert len(series) == 1_000_000 and np.isfinite(series).all()
