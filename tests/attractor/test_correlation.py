"""Correlation dimensions: counts against all pairs and a KD-tree, known systems, and series that have none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from attractor.known import henon, lorenz
from attractor.test_exponents import WILD, run, wild_states
from hypothesis import given, settings, strategies as st
from scipy.spatial import cKDTree

from crosstrack.errors import InvalidData
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor.checks import RADII, Sample
from crosstrack.models.attractor.plan import Method, Slope
from crosstrack.solvers.attractor.correlation import (
    CorrelationDimension,
    Counts,
    correlation_counts,
    drawn_radii,
)
from crosstrack.solvers.contract.backend import Control, Limit, Request

BACKEND = CorrelationDimension()


def pair_counts(states, radii, theiler):
    """Return the exact number of unordered pairs within each radius."""
    counts = correlation_counts(states, radii, theiler, references=len(states))
    return counts.counts.sum(axis=0) // 2


def plain_counts(states: np.ndarray, radii: np.ndarray, theiler: int) -> list[int]:
    """Return the counts by all pairs."""
    one, two = np.triu_indices(len(states), theiler + 1)
    apart = np.abs(states[one] - states[two]).max(axis=1)
    return [int((apart <= r).sum()) for r in radii]


@pytest.mark.parametrize("seed", range(30))
def test_counts_are_those_of_all_pairs(seed: int) -> None:
    states = wild_states(seed)
    theiler = seed % 6
    # Distances that occur are radii too, so that "at most as far" is tried.
    apart = np.abs(states[:1] - states).max(axis=1)
    radii = np.unique(np.concatenate([apart[apart > 0][:5], np.geomspace(1e-7, 1e7, 9)]))
    assert pair_counts(states, radii, theiler).tolist() == plain_counts(states, radii, theiler)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.sampled_from([0.0, 0.1, 0.2, 0.3, 1e-6, 2e5]), min_size=6, max_size=40),
    st.integers(1, 3),
    st.integers(0, 8),
)
def test_counts_of_tied_values(values: list[float], columns: int, theiler: int) -> None:
    states = np.lib.stride_tricks.sliding_window_view(np.array(values), columns).copy()
    radii = np.array([0.1, 0.2, 0.30000000000000004, 1.0, 2e5])
    assert pair_counts(states, radii, theiler).tolist() == plain_counts(states, radii, theiler)


def test_counts_are_those_of_a_tree() -> None:
    series = np.round(henon(2500), 3)
    states = np.ascontiguousarray(np.stack([series[:-1], series[1:]], axis=1))
    radii = np.array([1e-3, 4e-3, 0.02, 0.1, 0.5])
    tree = cKDTree(states)
    every = (tree.count_neighbors(tree, radii, p=np.inf) - len(states)) // 2
    near = sum(
        (np.abs(states[k:] - states[:-k]).max(axis=1)[:, None] <= radii).sum(axis=0)
        for k in range(1, 8)
    )
    assert pair_counts(states, radii, 7).tolist() == (every - near).tolist()


@pytest.mark.parametrize("seed", range(12))
def test_slopes_are_those_that_verification_computes(seed: int) -> None:
    states = wild_states(seed)
    drawn = drawn_radii(states, seed % 4, None, None)
    if drawn is None:
        assert seed % 4 == 1  # no first coordinate that differs, and no other
        return
    low, high = float(drawn[-1]) / 4, float(drawn[-1])
    counts = correlation_counts(states, np.geomspace(low, high, RADII), seed % 4)
    assert counts is not None
    value, _ = counts.slope()
    found = Sample(states, seed % 4, 0).slope(Slope(Method.CORRELATION, 1.0, 0.0, low, high), 1.0)
    assert found[1] == 0
    if np.isfinite(found[0]):
        assert value == pytest.approx(found[0], rel=1e-9, abs=1e-9)
    else:
        assert not np.isfinite(value)


def test_jackknife_is_the_plain_one() -> None:
    random = np.random.default_rng(0)
    radii = np.geomspace(0.1, 1.0, 9)
    counts = random.integers(1, 50, (6, 9)).cumsum(axis=1)
    x, fitted = np.log(radii), lambda n: np.polyfit(np.log(radii), np.log(n), 1)[0]
    value, deviation = Counts(radii, counts, 6).slope()
    assert value == pytest.approx(fitted(counts.sum(axis=0)))
    left_out = [fitted(np.delete(counts, k, 0).sum(axis=0)) for k in range(6)]
    y = np.log(counts.sum(axis=0))
    bend = (np.polyfit(x[4:], y[4:], 1)[0] - np.polyfit(x[:5], y[:5], 1)[0]) / 2
    assert deviation == pytest.approx(math.hypot(math.sqrt(5 * np.var(left_out)), bend))


@pytest.mark.parametrize("start", [0.1, 0.2, 0.3])
def test_henon_has_its_known_dimension(start: float) -> None:
    """1.21 to 0.05 with 5000 samples."""
    answer = run(BACKEND, henon(5000, start), delay=1, dimension=2, theiler=1)
    found = answer.point.correlation
    assert found.value == pytest.approx(1.21, abs=0.05)
    assert 0.02 < found.deviation < 0.1
    assert abs(answer.statistics["one dimension more"] - found.value) < 0.1


@pytest.mark.slow
def test_lorenz_has_its_known_dimension() -> None:
    """2.05 to 0.1 with 5000 samples."""
    found = run(BACKEND, lorenz(5000, 0.05), delay=3, dimension=3, theiler=30).point.correlation
    assert found.value == pytest.approx(2.05, abs=0.1)


@pytest.mark.parametrize(
    ("series", "known"),
    [
        (np.sin(np.arange(1500) * 0.1), 1.0),
        (np.sin(np.arange(4000) * 0.1) + np.sin(np.arange(4000) * 0.1618), 2.0),
    ],
    ids=["circle", "torus"],
)
def test_regular_motions_have_whole_dimensions(series: np.ndarray, known: float) -> None:
    found = run(BACKEND, series, delay=10, dimension=4, theiler=30).point.correlation
    assert found.value == pytest.approx(known, abs=0.3)


@pytest.mark.parametrize(
    "name",
    [
        "white",
        "ar2",
        "walk",
        "period 4",
        "trend",
        "binary",
        "constant pieces",
        "one spike",
        "noise over a map",
    ],
)
def test_series_without_a_dimension_say_so(name: str) -> None:
    answer = run(BACKEND, WILD[name], delay=3, dimension=3, theiler=10)
    assert answer.point.correlation is None
    assert "no correlation dimension" in answer.message


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.sampled_from([0.0, 1.0, 1.5, -2.0, 1e-6, 3e6]), min_size=50, max_size=80),
    st.integers(1, 4),
    st.integers(1, 4),
    st.integers(0, 60),
)
def test_no_answer_is_a_nan(values: list[float], delay: int, dimension: int, theiler: int) -> None:
    values[0], values[1] = 0.0, 1.5
    model = AttractorAnalysis(values)
    theiler = min(theiler, len(values) - (dimension - 1) * delay - 2)  # more is refused
    for ends in ({}, {"low": 0.5, "high": 2.5}):
        options = {"delay": delay, "dimension": dimension, "theiler": theiler, **ends}
        answer = BACKEND.run(model, Request(options=BACKEND.checked_options(options)))
        found = answer.point.correlation
        if found is None:
            assert answer.message
        else:
            assert math.isfinite(found.value) and math.isfinite(found.deviation)


def test_given_regions_are_taken_or_refused() -> None:
    series = henon(1000)
    how: dict[str, Any] = {"delay": 1, "dimension": 2, "theiler": 1}
    found = run(BACKEND, series, **how, low=0.02, high=0.2).point.correlation
    assert (found.low, found.high) == (0.02, 0.2)
    assert run(BACKEND, series, **how, low=0.02).point.correlation.low == 0.02
    assert run(BACKEND, series, **how, high=0.15).point.correlation.high == 0.15
    with pytest.raises(InvalidData) as caught:
        run(BACKEND, series, **how, low=0.2, high=0.2)
    assert caught.value.field == "low"


def test_scaling_the_series_scales_the_radii() -> None:
    series = henon(1000)
    one = run(BACKEND, series, delay=1, dimension=2, theiler=1).point.correlation
    two = run(BACKEND, series * 1024, delay=1, dimension=2, theiler=1).point.correlation
    assert two.value == pytest.approx(one.value, rel=1e-6)
    assert two.low == pytest.approx(1024 * one.low)


def test_a_stopped_run_has_no_plan() -> None:
    control = Control()
    control.stop(Limit.TIME)
    options = BACKEND.checked_options({"delay": 1, "dimension": 2, "theiler": 1})
    answer = BACKEND.run(AttractorAnalysis(henon(500)), Request(options=options, control=control))
    assert answer.point is None


def test_samples_of_references_pass_verification() -> None:
    answer = run(BACKEND, henon(6000), delay=1, dimension=2, theiler=1, references=800)
    assert answer.statistics["references"] == 800
    assert answer.point.correlation.value == pytest.approx(1.21, abs=0.06)


@pytest.mark.slow
def test_a_million_samples() -> None:
    found = run(BACKEND, henon(1_000_000), delay=1, dimension=2, theiler=1).point.correlation
    assert found.value == pytest.approx(1.21, abs=0.05)
