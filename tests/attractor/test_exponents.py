"""Exponents: curves against all pairs, known systems, and series that have none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from attractor.known import henon, logistic
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import AttractorEstimate
from crosstrack.models.attractor.checks import Sample
from crosstrack.models.attractor.plan import Method, Slope
from crosstrack.solvers.attractor.exponents import Kantz, Rosenstein
from crosstrack.solvers.attractor.partings import (
    Curve,
    Neighbours,
    kantz_curve,
    kantz_radius,
    rosenstein_curve,
)
from crosstrack.solvers.contract.backend import Answer, Control, Limit, Request

BACKENDS = [Rosenstein(), Kantz()]
NAMES = [one.name for one in BACKENDS]


def run(backend: Any, series: Any, period: float = 1.0, **options: Any) -> Answer:
    """Run a backend in this process; its plan must pass verification."""
    model = AttractorAnalysis(series, period=period)
    answer = backend.run(
        model.blinded(), Request(options=backend.checked_options(options), control=Control())
    )
    if answer.point is not None:
        assert model.verify(answer.point).ok
    return answer


def wild_states(seed: int) -> np.ndarray:
    """Return states with ties, duplicates, steps and scales of all kinds."""
    random = np.random.default_rng(seed)
    count, columns = int(random.integers(8, 70)), int(random.integers(1, 5))
    states = random.standard_normal((count, columns))
    if seed % 3 == 0:
        states = np.round(states)
    if seed % 4 == 1:
        states[:, 0] = states[0, 0]
    if seed % 5 == 2:
        states[count // 2 :] = states[: count - count // 2]
    return np.ascontiguousarray(states * 10.0 ** random.integers(-6, 7))


def plain_nearest(
    states: np.ndarray, i: int, theiler: int, last: int, rank: int
) -> tuple[int, float]:
    """Return the neighbour of a state by all pairs, ties to the earlier."""
    squares = np.zeros(last)
    for column in states.T:
        squares += (column[i] - column[:last]) ** 2
    squares[np.abs(np.arange(last) - i) <= theiler] = np.inf
    squares[squares == 0] = np.inf
    order = np.argsort(squares, kind="stable")
    if rank > last or not np.isfinite(squares[order[rank - 1]]):
        return -1, math.inf
    return int(order[rank - 1]), float(squares[order[rank - 1]])


@pytest.mark.parametrize("seed", range(30))
def test_nearest_states_are_those_of_all_pairs(seed: int) -> None:
    states = wild_states(seed)
    theiler, last, rank = seed % 7, len(states) - seed % 5, 1 + seed % 3
    pool = Neighbours(states, theiler, last)
    which, squares, visits = pool.nearest(np.arange(last), rank)
    plain = [plain_nearest(states, i, theiler, last, rank) for i in range(last)]
    assert [(int(a), float(b)) for a, b in zip(which, squares, strict=True)] == plain
    assert visits <= last * last


@pytest.mark.parametrize("seed", range(20))
def test_curves_are_those_that_verification_computes(seed: int) -> None:
    states = wild_states(seed)
    theiler, high = seed % 4, 3
    last = len(states) - high
    sample = Sample(states, theiler, 0)
    middle = kantz_radius(states, theiler, last)
    for radius in (None, middle):
        if radius is None:
            curve = rosenstein_curve(states, theiler, last, high)
            slope = Slope(Method.ROSENSTEIN, 1.0, 0.0, 0.0, float(high))
        else:
            curve = kantz_curve(states, theiler, last, high, radius=radius)
            slope = Slope(Method.KANTZ, 1.0, 0.0, 0.0, float(high), radius)
        assert curve is not None
        found, error, _ = sample.slope(slope, 0.5)
        value, _ = curve.slope(0, high, 0.5)
        if not np.isfinite(found):
            assert not np.isfinite(value)
        elif not error:  # else neighbours are tied to rounding
            assert value == pytest.approx(found, rel=1e-9, abs=1e-9)


def test_blocks_of_a_curve_add_up_and_their_jackknife_is_the_plain_one() -> None:
    random = np.random.default_rng(0)
    sums, counts = random.random((6, 9)), random.integers(1, 9, (6, 9))
    curve = Curve(sums, counts, 6)
    x = np.arange(2, 8) * 0.1
    fitted = lambda y: np.polyfit(x, y, 1)[0]  # noqa: E731
    part = slice(2, 8)
    value, deviation = curve.slope(2, 7, 0.1)
    assert value == pytest.approx(fitted(sums.sum(0)[part] / counts.sum(0)[part]))
    left_out = [
        fitted(np.delete(sums, k, 0).sum(0)[part] / np.delete(counts, k, 0).sum(0)[part])
        for k in range(6)
    ]
    y = curve.values[part]
    bend = (np.polyfit(x[2:], y[2:], 1)[0] - np.polyfit(x[:3], y[:3], 1)[0]) / 2
    assert deviation == pytest.approx(math.hypot(math.sqrt(5 * np.var(left_out)), bend))


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]
)
@pytest.mark.parametrize("backend", BACKENDS, ids=NAMES)
def test_maps_have_their_known_exponents(backend: Any, seed: int) -> None:
    """Logistic ln 2 (N = 5000) and Hénon 0.419 (N = 5000), to 5 %."""
    for series, known in (
        (logistic(5000, 0.1 + seed / 10), math.log(2)),
        (henon(5000, 0.1 + seed / 10), 0.4192),
    ):
        found = run(backend, series, delay=1, dimension=2, theiler=1).point.exponent
        assert found.value == pytest.approx(known, rel=0.05)
        assert 0 < found.deviation < 0.1 * known


def test_seconds_and_units_scale() -> None:
    series = henon(1200, 0.5)
    one = run(Rosenstein(), series, delay=1, dimension=2, theiler=1).point.exponent
    two = run(Rosenstein(), series * 1024 - 5, 0.25, delay=1, dimension=2, theiler=1).point.exponent
    assert two.value == pytest.approx(4 * one.value, rel=1e-6)
    assert (two.low, two.high) == (one.low, one.high)


def wild_series() -> dict[str, np.ndarray]:
    """Return series with no exponential parting, by name."""
    random = np.random.default_rng(1)
    t = np.arange(1200)
    ar = np.zeros(1500)
    for k in range(2, 1500):
        ar[k] = 2 * 0.98 * math.cos(0.3) * ar[k - 1] - 0.98**2 * ar[k - 2] + random.normal()
    steps = np.zeros(400)
    steps[200:] = 1
    return {
        "white": random.standard_normal(1000),
        "ar2": ar[300:],
        "walk": random.standard_normal(1500).cumsum(),
        "sine": np.sin(t * 0.1),
        "period 4": np.tile([0.0, 1.0, 3.0, 2.0], 100),
        "trend": t * 1e-3 + random.standard_normal(1200) * 0.1,
        "line": t[:200].astype(float),
        "binary": random.integers(0, 2, 800).astype(float),
        "quantised": np.round(3 * np.sin(t * 0.1)),
        "constant pieces": steps,
        "one spike": np.eye(1, 300, 7)[0],
        "fifty": random.standard_normal(50),
        "noise over a map": henon(800, 0.1) + 10**0.5 * 0.72 * random.standard_normal(800),
    }


WILD = wild_series()


@pytest.mark.sample(2)
@pytest.mark.parametrize("backend", BACKENDS, ids=NAMES)
@pytest.mark.parametrize("name", WILD)
def test_series_without_an_exponent_say_so(name: str, backend: Any) -> None:
    answer = run(
        backend, WILD[name], delay=1 if len(WILD[name]) < 100 else 3, dimension=3, theiler=10
    )
    assert answer.point is not None and answer.point.exponent is None
    assert "no exponent" in answer.message


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.sampled_from([0.0, 1.0, 1.5, -2.0, 1e-6, 3e6]), min_size=50, max_size=80),
    st.integers(1, 4),
    st.integers(1, 4),
    st.integers(0, 60),
    st.sampled_from([0, 1]),
)
def test_no_answer_is_a_nan(
    values: list[float], delay: int, dimension: int, theiler: int, which: int
) -> None:
    values[0], values[1] = 0.0, 1.5
    theiler = min(theiler, len(values) - (dimension - 1) * delay - 2)  # more is refused
    backend = BACKENDS[which]
    model = AttractorAnalysis(values)
    for ends in ({}, {"low": 0, "high": 4}):
        options = {"delay": delay, "dimension": dimension, "theiler": theiler, **ends}
        answer = backend.run(model, Request(options=backend.checked_options(options)))
        plan = answer.point
        if plan.exponent is None:
            assert answer.message
        else:
            assert math.isfinite(plan.exponent.value) and math.isfinite(plan.exponent.deviation)


def test_given_regions_are_taken_or_refused() -> None:
    series = logistic(600, 0.3)
    how: dict[str, Any] = {"delay": 1, "dimension": 1, "theiler": 1}
    found = run(Rosenstein(), series, **how, low=1, high=4).point.exponent
    assert (found.low, found.high) == (1, 4)
    half = run(Rosenstein(), series, **how, low=1).point.exponent
    assert half.low == 1 and half.high > 4
    ended = run(Rosenstein(), series, **how, high=6).point.exponent
    assert ended.high == 6 and ended.low < 3
    near = run(Kantz(), series, **how, low=0, high=3, radius=1e-2).point.exponent
    assert near.radius == 1e-2
    for low, high, field in ((4, 4, "low"), (5, 4, "low"), (0, 599, "high"), (600, None, "high")):
        ends = {"low": low} if high is None else {"low": low, "high": high}
        with pytest.raises(InvalidData) as caught:
            run(Rosenstein(), series, **how, **ends)
        assert caught.value.field == field


def test_radius_holds_five_neighbours_of_half_of_the_states() -> None:
    series = henon(1000, 0.2)
    states = np.ascontiguousarray(np.stack([series[:-1], series[1:]], axis=1))
    radius = kantz_radius(states, 5, 900)
    assert radius is not None
    far = np.sqrt(((states[:900, None] - states[None, :900]) ** 2).sum(axis=2))
    far[np.abs(np.subtract.outer(np.arange(900), np.arange(900))) <= 5] = np.inf
    crowd = ((far <= radius) & (far > 0)).sum(axis=1)
    assert 0.45 < (crowd >= 5).mean() < 0.55
    assert kantz_radius(states[:10], 5, 10) is None


@pytest.mark.parametrize("backend", BACKENDS, ids=NAMES)
def test_a_stopped_run_has_no_plan(backend: Any) -> None:
    control = Control()
    control.stop(Limit.TIME)
    options = backend.checked_options({"delay": 1, "dimension": 2, "theiler": 1})
    answer = backend.run(
        AttractorAnalysis(henon(500, 0.1)), Request(options=options, control=control)
    )
    assert answer.point is None


def test_samples_of_references_pass_verification() -> None:
    series = henon(6000, 0.4)
    for backend in BACKENDS:
        answer = run(backend, series, delay=1, dimension=2, theiler=1, references=800)
        assert answer.statistics["references"] == 800
        assert answer.point.exponent.value == pytest.approx(0.4192, rel=0.06)


def test_solve_and_compare_through_the_front_door() -> None:
    model = AttractorAnalysis(henon(1200, 0.6), true_exponent=0.4192)
    found = ct.solve(
        model, "rosenstein", backend_options={"delay": 1, "dimension": 2, "theiler": 1}
    )
    assert isinstance(found.plan, AttractorEstimate)
    assert found.verified and found.primal_bound < 0.1


@pytest.mark.slow
def test_a_million_samples() -> None:
    series = henon(1_000_000, 0.1)
    for backend in BACKENDS:
        found = run(backend, series, delay=1, dimension=2, theiler=1).point.exponent
        assert found.value == pytest.approx(0.4192, rel=0.05)


@pytest.mark.parametrize("radius", [0, -1.0, 1e-310])
def test_a_radius_that_is_none_is_refused(radius):
    with pytest.raises(UnsupportedOption, match=r"'radius' must lie in \[1e-300"):
        Kantz().checked_options({"radius": radius})
