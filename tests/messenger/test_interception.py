"""Earliest interception of a moving point, compared with dense scans over time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from messenger.flights import shortest_lengths
from numba import njit

from crosstrack.models.messenger.dubins import relaxed_length, word_lengths
from crosstrack.models.messenger.elongation import elongated
from crosstrack.models.messenger.interception import intercept, intercept_heading

FULL = 2 * np.pi
#: Columns of a case.
X, Y, H, T0, PX, PY, VX, VY, SPEED, RADIUS, H1 = range(11)
LENGTHS = [X, Y, PX, PY, VX, VY, SPEED, RADIUS]


@njit  # not cached: a cache would be stale after changes of the callees
def meetings(cases, times, ok):
    """Fill in the times of interception, whether a path exists then, and whether one has that length."""
    for i in range(len(cases)):
        x, y, h, t0, px, py, vx, vy, speed, r, _ = cases[i]
        t = intercept(x, y, h, t0, px, py, vx, vy, speed, r)
        times[i] = t
        ok[i] = elongated(x, y, h, px + vx * t, py + vy * t, r, speed * (t - t0))[6]


@njit
def meetings_with_heading(cases, times, words):
    """Fill in the times and words of interception with the given heading."""
    for i in range(len(cases)):
        x, y, h, t0, px, py, vx, vy, speed, r, h1 = cases[i]
        times[i], words[i] = intercept_heading(x, y, h, t0, px, py, vx, vy, h1, speed, r)


@njit
def excesses(case, times, found):
    """Fill in the length flown minus the length of each word, at each time."""
    x, y, h, t0, px, py, vx, vy, speed, r, h1 = case
    for k in range(len(times)):
        t = times[k]
        for word in range(6):
            a, b, c = word_lengths(x, y, h, px + vx * t, py + vy * t, h1, r, word)
            found[word, k] = speed * (t - t0) - a - b - c


def drawn(rng, count, wild):
    """Return cases: points near and far, slow, fleeing and approaching, on one line, at the start."""
    cases = np.zeros((count, 11))
    cases[:, [X, Y]] = rng.uniform(-3, 3, (count, 2))
    cases[:, [H, H1]] = rng.uniform(-4, 4, (count, 2))
    cases[:, T0] = rng.uniform(0, 5, count)
    cases[:, [SPEED, RADIUS]] = 1
    if wild:
        cases[:, RADIUS] = 10 ** rng.uniform(-2, 2, count)
        cases[::11, RADIUS] = 0
    pace = rng.uniform(0, 1, count)
    pace[::3] = 0.999
    pace[1::6] = 10 ** rng.uniform(-6, -1, len(pace[1::6]))
    pace[5::40] = 0
    course = rng.uniform(0, FULL, count)
    size = np.maximum(cases[:, RADIUS], 0.1) * 10 ** rng.uniform(-1, 0.7, count)
    away = rng.normal(size=(count, 2)) * size[:, None]
    if wild:
        away[::13] = 0
        along = np.column_stack([np.cos(course), np.sin(course)])
        away[::17] = (along * rng.uniform(-3, 3, (count, 1)))[::17]
        cases[::17, H] = course[::17]
        cases[::34, H] += np.pi
    velocity = pace[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    cases[:, [VX, VY]] = velocity
    cases[:, [PX, PY]] = cases[:, [X, Y]] + away - velocity * cases[:, T0, None]
    if wild:
        cases[:, LENGTHS] *= 10 ** rng.uniform(-3, 3, (count, 1))
    return cases


def reachable(u, v, length, r):
    """Return a mask of the cases with a path of the length, by trigonometry; arrays broadcast."""
    v = np.abs(v)
    far = np.hypot(u, v + r)
    line = np.sqrt(np.maximum(u * u + v * v - 2 * v * r, 0))
    straight = r * np.mod(np.arctan2(u * r + (v - r) * line, u * line - (v - r) * r), FULL) + line
    beta = np.arccos(np.clip((3 * r * r + far**2) / (4 * far * r), -1, 1))
    delta = np.arccos(np.clip(1.25 - (far / r) ** 2 / 4, -1, 1))
    course = np.pi / 2 - np.arctan2(v + r, u)
    minor = r * (np.mod(course - beta, FULL) + delta)
    major = r * (np.mod(course + beta, FULL) + FULL - delta)
    inside = u * u + (v - r) ** 2 < r * r
    missing = (u > 0) & (far < 3 * r) & (length > minor) & (length < major)
    return np.where(inside, length >= major, (length >= straight) & ~missing)


@pytest.mark.parametrize("wild", [False, True])
def test_no_point_is_met_later_than_by_a_scan(wild):
    cases = drawn(np.random.default_rng(21 + wild), 700, wild)
    times, ok = np.empty(len(cases)), np.empty(len(cases), bool)
    meetings(cases, times, ok)
    assert ok.all() and (times >= cases[:, T0]).all() and np.isfinite(times).all()
    some = cases[:, RADIUS] > 0
    cases, times = cases[some], times[some]
    r, speed = cases[:, RADIUS, None], cases[:, SPEED, None]
    flown = np.linspace(0, 1 - 1e-8, 1000)[1:] * (times - cases[:, T0])[:, None]
    course = np.exp(-1j * cases[:, H, None])
    place = cases[:, PX] - cases[:, X] + cases[:, VX] * cases[:, T0]
    place = place + 1j * (cases[:, PY] - cases[:, Y] + cases[:, VY] * cases[:, T0])
    place = (place[:, None] + (cases[:, VX] + 1j * cases[:, VY])[:, None] * flown) * course
    u, v, way = place.real, place.imag, speed * flown
    met = [reachable(u, v, way + error * r, r) for error in (-1e-9, 1e-9)]
    assert not np.logical_and(*met).any()


def test_a_point_at_rest_is_met_by_the_shortest_path():
    cases = drawn(np.random.default_rng(23), 50, False)
    for x, y, h, t0, px, py, _, _, _, r, h1 in cases.tolist():
        way = relaxed_length(x, y, h, px, py, r)
        assert intercept(x, y, h, t0, px, py, 0.0, 0.0, 3.0, r) == pytest.approx(t0 + way / 3)
        whole = shortest_lengths((x, y, h), (px, py, h1), r)
        t, word = intercept_heading(x, y, h, t0, px, py, 0.0, 0.0, h1, 3.0, r)
        assert t == pytest.approx(t0 + whole / 3, rel=1e-13)
        assert sum(word_lengths(x, y, h, px, py, h1, r, word)) == pytest.approx(whole, rel=1e-13)


def test_with_radius_0_points_are_met_on_straight_lines():
    cases = drawn(np.random.default_rng(24), 500, False)
    cases[:, RADIUS] = 0
    times, ok = np.empty(500), np.empty(500, bool)
    meetings(cases, times, ok)
    there = cases[:, [PX, PY]] + cases[:, [VX, VY]] * times[:, None]
    away = np.linalg.norm(there - cases[:, [X, Y]], axis=1)
    np.testing.assert_allclose(away, times - cases[:, T0], rtol=1e-11)
    headed, words = np.empty(500), np.empty(500, np.int64)
    meetings_with_heading(cases, headed, words)
    np.testing.assert_allclose(headed, times, rtol=1e-11)


def test_a_point_that_flees_straight_ahead_is_followed():
    """At 0.999 of the speed it takes a thousand times as long. Through the start, the gap matters."""
    assert intercept(0.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.999, 0.0, 1.0, 5.0) == pytest.approx(
        2 + (1 + 2 * 0.999) / 0.001, rel=1e-9
    )
    assert intercept(1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 0.0, 0.0, 1.0, 5.0) == 4.0
    t = intercept(0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.9, 0.0, 1.0, 1.0)
    assert t > 2 and elongated(0.0, 0.0, 0.0, -1 + 0.9 * t, 0.0, 1.0, t)[6]
    assert not elongated(0.0, 0.0, 0.0, -1 + 0.9 * 0.99 * t, 0.0, 1.0, 0.99 * t)[6]


@pytest.mark.parametrize("pace", [1.0, 1.5])
def test_a_point_as_fast_as_the_uav_is_never_met(pace):
    assert intercept(0.0, 0.0, 0.0, 0.0, 5.0, 1.0, -pace, 0.0, 1.0, 1.0) == math.inf
    found, _ = intercept_heading(0.0, 0.0, 0.0, 0.0, 5.0, 1.0, -pace, 0.0, 1.0, 1.0, 1.0)
    assert found == math.inf


@pytest.mark.parametrize("wild", [False, True])
def test_with_a_heading_the_time_is_feasible_and_rarely_late(wild):
    cases = drawn(np.random.default_rng(25 + wild), 200, wild)
    cases = cases[cases[:, RADIUS] > 0]
    times, words = np.empty(len(cases)), np.empty(len(cases), np.int64)
    meetings_with_heading(cases, times, words)
    found = np.isfinite(times)
    assert found.mean() > 0.98
    late, excess = 0, np.empty((6, 2001))
    for case, t, word in zip(cases[found], times[found], words[found], strict=True):
        size = case[RADIUS] + case[SPEED] * (t - case[T0])
        steps = np.linspace(case[T0], t, 2001)
        excesses(case, steps, excess)
        assert abs(excess[word, -1]) <= 1e-9 * size
        before, after = excess[:, :-2], excess[:, 1:-1]
        with np.errstate(invalid="ignore"):
            crossed = (np.sign(before) * np.sign(after) < 0) & (
                np.abs(after - before) < case[RADIUS]
            )
        late += crossed.any()
    assert late <= 0.01 * len(cases)


def test_times_scale_and_shift():
    cases = drawn(np.random.default_rng(27), 500, True)
    cases[:, T0] = 0
    times, again, ok = np.empty(500), np.empty(500), np.empty(500, bool)
    meetings(cases, times, ok)
    larger = cases.copy()
    larger[:, LENGTHS] *= 2.0**20
    meetings(larger, again, ok)
    np.testing.assert_array_equal(again, times)


def test_interpreted_kernels_give_the_same_bits():
    cases = drawn(np.random.default_rng(28), 60, True)
    for case in cases.tolist():
        assert intercept.py_func(*case[:10]) == intercept.dispatcher(*case[:10])
        arguments = (*case[:8], case[H1], *case[8:10])
        assert intercept_heading.py_func(*arguments) == intercept_heading.dispatcher(*arguments)
