"""Measures of recurrence, order and memory: closed forms, plain loops, and the packages nolds and neurokit2."""

import math
from importlib.util import find_spec
from itertools import pairwise, permutations
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from attractor.known import analysed, henon, logistic, strange

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import AttractorEstimate, Measures
from crosstrack.models.attractor.recomputed import measures, window_sizes
from crosstrack.solvers.attractor.embedding import standardised
from crosstrack.solvers.attractor.measures import (
    memory,
    permutation_entropy,
    recurrence,
    sample_entropy,
)


def noise(n, seed=0):
    return np.random.default_rng(seed).normal(size=n)


def plain_lines(states, theiler, radius):
    """Lengths of the diagonal and the vertical lines of the recurrence plot, by loops; and the rate."""
    n = len(states)
    plot = [
        [abs(i - j) > theiler and max(abs(states[i] - states[j])) <= radius for j in range(n)]
        for i in range(n)
    ]

    def runs(cells):
        marks = [k for k, cell in enumerate([False, *cells, False]) if not cell]
        return [b - a - 1 for a, b in pairwise(marks) if b - a > 1]

    diagonals = [
        size for lag in range(1, n) for size in runs([plot[i][i + lag] for i in range(n - lag)])
    ]
    verticals = [size for row in plot for size in runs(row)]
    pairs = sum(abs(i - j) > theiler for i in range(n) for j in range(n))
    return diagonals, verticals, sum(map(sum, plot)) / pairs


# -- recurrence ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("series", "theiler"), [(henon(90), 0), (henon(90), 2), (noise(70), 1)])
def test_recurrence_beside_loops(series, theiler):
    states = AttractorAnalysis(series).states(1, 2)
    found = recurrence(states, theiler, 0.4)
    diagonals, verticals, rate = plain_lines(states, theiler, 0.4)
    lines = [size for size in diagonals if size > 1]
    shares = [lines.count(size) / len(lines) for size in set(lines)]
    expected = {
        "recurrence_rate": rate,
        "determinism": sum(lines) / sum(diagonals),
        "laminarity": sum(size for size in verticals if size > 1) / sum(verticals),
        "diagonal_mean": np.mean(lines),
        "diagonal_longest": max(lines),
        "diagonal_entropy": -sum(p * math.log(p) for p in shares),
    }
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_recurrence_of_a_periodic_series():
    """With a period of 4 the recurrent pairs are the diagonals at multiples of 4: nothing else."""
    found = recurrence(np.tile([0, 1.0, 3, 2], 25)[:, None], 0, 0.1)
    lengths = [100 - lag for lag in range(4, 100, 4)]
    assert found["recurrence_rate"] == pytest.approx(sum(lengths) / (99 * 100 / 2))
    assert found["determinism"] == 1 and found["laminarity"] == 0
    assert found["diagonal_longest"] == 96
    assert found["diagonal_mean"] == pytest.approx(np.mean(lengths))
    assert found["diagonal_entropy"] == pytest.approx(math.log(len(lengths)))


def test_the_recurrence_rate_of_noise_is_its_probability():
    """Two normal values differ by at most 0.2 with the probability erf(0.1)."""
    found = recurrence(noise(2000)[:, None], 0, 0.2)
    assert found["recurrence_rate"] == pytest.approx(math.erf(0.1), rel=0.02)
    # A point of the plot of noise is isolated on its diagonal with the probability (1 - p)².
    assert found["determinism"] == pytest.approx(1 - (1 - math.erf(0.1)) ** 2, abs=0.01)
    assert recurrence(noise(50)[:, None], 0, 1e-9) == {"recurrence_rate": 0.0}


# -- order ---------------------------------------------------------------------------------------


def test_the_published_example_of_bandt_and_pompe():
    """Physical Review Letters 88, page 174102-1: 4, 7, 9, 10, 6, 11, 3 has 0.918 and 1.522 bits."""
    series = np.array([4.0, 7, 9, 10, 6, 11, 3])
    assert permutation_entropy(series, 2) * math.log2(2) == pytest.approx(0.918, abs=5e-4)
    assert permutation_entropy(series, 3) * math.log2(6) == pytest.approx(1.522, abs=5e-4)


def test_permutation_entropy_of_all_orders_of_noise_and_of_a_ramp():
    assert permutation_entropy(np.arange(100.0), 4) == 0
    # Joined by low values that are left out of the count: every order occurs equally often.
    rows = np.array([np.array(p, float) for p in permutations(range(3))])
    shares = [permutation_entropy(row, 3) for row in rows]
    assert shares == [0.0] * 6
    assert permutation_entropy(noise(200_000), 4) == pytest.approx(1.0, abs=1e-3)
    # The logistic map never has three values in descending order: five patterns remain.
    assert permutation_entropy(logistic(20_000), 3) < math.log(5) / math.log(6)


def test_sample_entropy_of_noise_is_the_logarithm_of_a_probability():
    assert sample_entropy(noise(4000), 0.2) == pytest.approx(-math.log(math.erf(0.1)), rel=0.03)
    assert sample_entropy(np.tile([0, 1.0], 50), 0.1) == pytest.approx(0.0, abs=0.02)
    assert math.isnan(sample_entropy(np.arange(60.0) ** 2, 0.1))


# -- memory --------------------------------------------------------------------------------------


def test_white_noise_and_brownian_motion():
    white = np.array([list(memory(standardised(noise(2000, k))).values()) for k in range(40)])
    error = white.std(axis=0) / math.sqrt(len(white))
    assert np.abs(white.mean(axis=0) - 0.5)[0] < 3 * error[0]
    assert white.mean(axis=0)[1] == pytest.approx(0.5, abs=0.02)
    brown = [memory(standardised(np.cumsum(noise(4000, k))))["fluctuation"] for k in range(40)]
    assert np.mean(brown) == pytest.approx(1.5, abs=0.03)


def test_fluctuation_of_noise_with_a_power_law():
    """A spectrum of 1 / f^b has the exponent (1 + b) / 2."""
    for power, expected in ((-0.4, 0.3), (0.6, 0.8), (1.0, 1.0)):
        found = []
        for k in range(20):
            shape = np.fft.rfft(noise(8192, k))
            shape[1:] *= np.arange(1, len(shape)) ** (-power / 2)
            shape[0] = 0
            found.append(memory(standardised(np.fft.irfft(shape)))["fluctuation"])
        assert np.mean(found) == pytest.approx(expected, abs=0.04)


def test_window_sizes():
    assert window_sizes(50)[0] == 4 and window_sizes(50)[-1] == 12
    assert window_sizes(10_000)[0] == 16 and window_sizes(10_000)[-1] == 2500
    assert len(window_sizes(10_000)) == 12


# -- other packages ------------------------------------------------------------------------------


def test_memory_beside_nolds():
    spec = find_spec("nolds")
    if spec is None or spec.origin is None:
        pytest.skip("the comparison needs nolds")
    # nolds looks up its files by the name of a module, but Python 3.11 requires a package.
    with mock.patch("importlib.resources.files", return_value=Path(spec.origin).parent):
        nolds = pytest.importorskip("nolds", reason="the comparison needs nolds")
    for seed, series in enumerate((noise(3000), np.cumsum(noise(3000)), henon(3000))):
        ours = memory(standardised(series))
        sizes = window_sizes(len(series))
        theirs = nolds.dfa(series, nvals=sizes, overlap=False, fit_exp="poly")
        # nolds divides the sum of squares by the number of windows in the same way.
        assert ours["fluctuation"] == pytest.approx(theirs, abs=1e-6), seed
        # nolds corrects by the expectation of Peters, whose factor (n - 1/2) / n shifts the slope.
        rescaled = nolds.hurst_rs(series, nvals=sizes, fit="poly", corrected=True, unbiased=False)
        assert ours["hurst"] == pytest.approx(rescaled, abs=0.01), seed
        radius = 0.2 * series.std()
        entropy = nolds.sampen(series[:1500], emb_dim=2, tolerance=radius, closed=True)
        assert sample_entropy(series[:1500], radius) == pytest.approx(entropy, abs=1e-9), seed


def test_entropies_beside_neurokit():
    neurokit = pytest.importorskip("neurokit2", reason="the comparison needs neurokit2")
    for series in (noise(1500), henon(1500), np.cumsum(noise(1500))):
        radius = 0.2 * series.std()
        theirs = neurokit.entropy_permutation(series, delay=1, dimension=4, corrected=True)[0]
        assert permutation_entropy(series, 4) == pytest.approx(theirs, abs=1e-9)
        theirs = neurokit.entropy_sample(series, delay=1, dimension=2, tolerance=radius)[0]
        assert sample_entropy(series, radius) == pytest.approx(theirs, rel=1e-9)


def test_recurrence_beside_neurokit():
    """Laminarity is not compared: neurokit2 counts the pairs of a state with itself in vertical lines."""
    neurokit = pytest.importorskip("neurokit2", reason="the comparison needs neurokit2")
    for series in (noise(400), henon(400)):
        found = recurrence(series[:, None], 0, 0.3 * series.std())
        theirs = neurokit.complexity_rqa(
            series, dimension=1, delay=1, tolerance=0.3 * series.std(), method="python"
        )[0].iloc[0]
        for ours, name in (
            ("recurrence_rate", "RecurrenceRate"), ("determinism", "Determinism"), ("diagonal_mean", "L"),
            ("diagonal_entropy", "LEn"),
        ):  # fmt: skip
            assert found[ours] == pytest.approx(theirs[name], rel=1e-9), name
        assert found["diagonal_longest"] == pytest.approx(1 / theirs["Divergence"])


# -- the backend ---------------------------------------------------------------------------------


def test_the_checks_equal_the_backend():
    model, answer = analysed("measures", henon(700))
    plan = answer.point
    again = measures(
        model.states(plan.delay, plan.dimension), model.series, plan.theiler, plan.measures
    )
    assert again == pytest.approx(plan.measures.values, rel=1e-9, abs=1e-12)
    assert len(plan.measures.values) == 10 and not answer.message
    assert plan.measures.radius == pytest.approx(0.2 * model.series.std())


def test_each_wrong_measure_is_rejected():
    model = AttractorAnalysis(henon(300))
    plan = ct.solve(model, "measures").plan
    assert AttractorEstimate.from_data(plan.to_data()) == plan and model.verify(plan).ok
    for name, value in plan.measures.values.items():
        claim = {**plan.measures.data(), name: value + 0.01}
        result = model.verify(AttractorEstimate(1, 2, 1, measures=claim))
        assert not result.ok
        check = next(c for c in result.checks if c.name.startswith("measures"))
        assert name in check.where
    for change in ({"radius": 0.5}, {"order": 5}):
        claim = {**plan.measures.data(), **change}
        assert not model.verify(AttractorEstimate(1, 2, 1, measures=claim)).ok
    undefined = Measures(1e-9, 4, determinism=0.5)
    assert not model.verify(AttractorEstimate(1, 2, 1, measures=undefined)).ok
    with pytest.raises(InvalidData, match="radius must be > 0"):
        Measures(0.0, 4)
    with pytest.raises(InvalidData, match="unknown key 'entropy'"):
        Measures.from_data({"radius": 1, "order": 4, "entropy": 1})


def test_measures_do_not_depend_on_the_unit():
    first, second = (
        ct.solve(AttractorAnalysis(scale * henon(300)), "measures").plan.measures.values
        for scale in (1.0, 2.0**-300)
    )
    assert second == pytest.approx(first, rel=1e-9)


def test_measures_are_compared():
    model = AttractorAnalysis(henon(400))

    def plan(**options):
        return ct.solve(model, "measures", backend_options=options).plan

    first = plan()
    assert model.distance(first, plan()) == 0
    data = first.measures.data()
    other = AttractorEstimate(1, 2, 1, measures={**data, "determinism": data["determinism"] / 2})
    assert model.distance(first, other) == pytest.approx(0.5)
    # Values of other radii are different quantities.
    assert model.distance(first, plan(radius=0.4)) == 0


@pytest.mark.parametrize("name", strange())
def test_strange_series(name):
    model, answer = analysed("measures", strange()[name])
    plan = answer.point
    assert all(math.isfinite(value) for value in plan.measures.values.values())
    missing = 10 - len(plan.measures.values)
    assert answer.message.count(",") == max(missing - 1, 0)
    assert bool(missing) == ("undefined" in answer.message)
    assert model.verify(plan).ok
