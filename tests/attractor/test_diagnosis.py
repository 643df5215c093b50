"""The diagnosis of a series: every finding where it belongs, none where it does not."""

import json

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models.attractor import AttractorAnalysis
from crosstrack.solvers.run.diagnosis import Diagnosis

RNG = np.random.default_rng(41)
NOISE = RNG.normal(size=1000)


def found(series, period=1.0):
    """The diagnosis, and everything it tells as data."""
    diagnosis = ct.diagnose(AttractorAnalysis(series, period, name="series"))
    told = {}
    for finding in diagnosis.findings:
        assert not set(told) & set(finding.data)
        told |= finding.data
    return diagnosis, told


def words(series):
    """The diagnosis as text."""
    return str(found(series)[0])


def test_white_noise_has_no_rhythm_and_nothing_else_to_tell():
    diagnosis, told = found(NOISE, 0.25)
    assert diagnosis.feasible is True
    assert diagnosis.instance == "series"
    assert str(diagnosis).startswith("series: a plan exists")
    assert set(told) == {
        "samples", "largest_dimension", "correlation_time", "first_zero", "period", "share", "flatness",
    }  # fmt: skip
    assert told["correlation_time"] == 1
    assert told["flatness"] > 0.8
    assert "no rhythm stands out" in str(diagnosis)
    assert "falls to 1/e after 1 sample (0.25 s)" in str(diagnosis)


def test_a_diagnosis_survives_json():
    diagnosis = found(np.repeat([0.0, 1.0], 30))[0]
    again = Diagnosis.from_dict(json.loads(json.dumps(diagnosis.to_dict(), allow_nan=False)))
    assert again == diagnosis


@pytest.mark.parametrize(("count", "dimension"), [(50, 3.4), (1000, 6.0), (10_000, 8.0)])
def test_the_length_bounds_the_dimension(count, dimension):
    told = found(np.resize(NOISE, count) + RNG.normal(size=count))[1]
    assert told["samples"] == count
    assert told["largest_dimension"] == pytest.approx(dimension, abs=0.01)


def test_the_correlation_times_of_a_cosine():
    # cos(2π k / 200) falls to 1/e at arccos(1/e) / 2π periods, and to 0 at a quarter of one.
    diagnosis, told = found(np.cos(2 * np.pi * np.arange(2000) / 200), 0.5)
    assert told["correlation_time"] == pytest.approx(
        200 * np.arccos(np.exp(-1)) / (2 * np.pi), abs=1
    )
    assert told["first_zero"] == pytest.approx(50, abs=1)
    assert told["correlation_times"] == pytest.approx(2000 / told["correlation_time"])
    assert told["period"] == pytest.approx(200)
    assert told["share"] > 0.99
    assert told["repeats"] == pytest.approx(200, abs=1)
    assert "a period of 200 samples (100 s) and 100.0% of the power" in str(diagnosis)
    assert "sampled densely; one sample in" in str(diagnosis)


@pytest.mark.parametrize(
    ("series", "period"),
    [
        (np.tile([1.0, 2.0, 5.0], 40), 3),
        (np.tile([0.0, 1.0], 40), 2),
        (np.tile(RNG.normal(size=17), 20), 17),
        (np.arange(400) % 40.0, 40),
        (1e100 * np.tile([0.0, 0.0, 0.0, 1.0], 30), 4),
        (np.sin(np.arange(1000) * 2 * np.pi / 50.3), 50),
    ],
)
def test_periodic_series_are_called_so(series, period):
    diagnosis, told = found(series)
    assert told["repeats"] == period
    assert f"repeats itself after {period} samples" in str(diagnosis)


@pytest.mark.parametrize(
    "series", [NOISE, np.cumsum(NOISE), np.convolve(NOISE, np.ones(20), "valid"), NOISE**3]
)
def test_noise_is_not_called_periodic(series):
    assert "repeats itself" not in words(series)


def test_trends_and_drifts():
    line = np.linspace(-2, 2, 1000)
    told = found(NOISE + line)[1]
    assert told["trend"] == pytest.approx(np.corrcoef(line, NOISE + line)[0, 1] ** 2)
    deviation = (NOISE + line).std()
    halves = ((NOISE + line)[500:].mean() - (NOISE + line)[:500].mean()) / deviation
    assert told["shift"] == pytest.approx(halves)
    # Downward as well, and not where it is faint.
    assert found(NOISE - line)[1]["shift"] == pytest.approx(
        ((NOISE - line)[500:].mean() - (NOISE - line)[:500].mean()) / (NOISE - line).std()
    )
    assert "trend" not in found(NOISE + line / 20)[1]
    louder = np.concatenate([NOISE[:500], 3 * NOISE[500:]])
    told = found(louder)[1]
    ratio = 9 * NOISE[500:].var() / NOISE[:500].var()
    assert told["variance_ratio"] == pytest.approx(ratio)
    assert "means" not in words(louder)
    assert "one does not vary at all" in words(np.concatenate([np.zeros(50), NOISE[:50]]))


def test_grids_and_ties():
    told = found(np.round(NOISE * 4) / 4)[1]
    assert told["distinct"] == len(np.unique(np.round(NOISE * 4)))
    assert told["step"] == pytest.approx(0.25)
    assert told["grid"] is True
    assert told["repeated"] > 0
    # Two values whose distance is no multiple of the other.
    told = found(RNG.choice([0.0, 1.0, np.pi], 300))[1]
    assert (told["distinct"], told["grid"]) == (3, False)
    assert "distinct" not in found(NOISE)[1]
    assert "repeated" not in found(NOISE)[1]
    # The same but for rounding is the same; far from 0 as well.
    many = RNG.integers(0, 5, 300) * 0.1 + 1e3 + RNG.normal(size=300) * 1e-14
    assert found(many)[1]["distinct"] == 5
    tiny = found(1e-140 * RNG.integers(0, 3, 300).astype(float))[1]
    assert tiny["step"] == pytest.approx(1e-140)


def test_states_that_are_repeated():
    once = NOISE[:100]
    # Of 98 + 102 triples of values, the ones over the seam occur once.
    told = found(np.concatenate([once, once]))[1]
    assert told["repeated"] == pytest.approx(196 / 198)
    few = RNG.integers(0, 4, 80).astype(float)
    triples = [tuple(few[k : k + 3]) for k in range(78)]
    share = np.mean([triples.count(one) > 1 for one in triples])
    assert found(few)[1]["repeated"] == pytest.approx(share)


def test_a_sensor_that_stuck():
    series = NOISE.copy()
    series[300:307] = series[300]
    diagnosis, told = found(series)
    assert (told["run"], told["start"]) == (7, 300)
    assert "series[300]" in [finding.where for finding in diagnosis.findings]
    series = NOISE.copy()
    series[300:303] = series[300]
    assert "run" not in found(series)[1]


def test_outliers_are_named():
    series = NOISE.copy()
    series[[17, 400]] = 1e6, -30
    told = found(series)[1]
    assert (told["outliers"], told["worst"]) == (2, 17)
    assert "2 values lie more than 8 robust deviations" in words(series)
    assert "the farthest at sample 17: 1e+06" in words(series)
    assert "outliers" not in found(NOISE)[1]
    mostly = np.zeros(100)
    mostly[[3, 50]] = 1.0, -2.0
    assert "98.0% of the values are the same, 0" in words(mostly)


@pytest.mark.filterwarnings("error")
def test_series_that_hardly_move():
    last = np.zeros(60)
    last[-1] = 1.0
    assert found(last)[1]["run"] == 59
    told = found(np.exp(-np.arange(60.0)))[1]
    assert told["trend"] > 0.1
    assert told["variance_ratio"] is None
    for step in range(1, 60, 7):
        assert found(1.0 * (np.arange(60) >= step))[1]["distinct"] == 2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e-148, 1.0, 1e146])
@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_strange_sizes_tell_the_same(scale, shift):
    series = (NOISE[:60] + shift) * scale
    plain, strange = found(NOISE[:60])[1], found(series)[1]
    assert set(plain) == set(strange)
    for name, value in plain.items():
        assert strange[name] == pytest.approx(value, rel=1e-6), name


def test_a_million_samples():
    told = found(np.resize(NOISE, 1_000_000) + RNG.normal(size=1_000_000))[1]
    assert told["largest_dimension"] == pytest.approx(12.0)
    assert told["repeats"] % 1000 == 0 if "repeats" in told else told["correlation_time"] == 1
