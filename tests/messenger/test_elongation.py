"""Paths of a given length, and the lengths that no path has."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from scipy.optimize import minimize

from crosstrack.models.messenger.dubins import advance, local, relaxed_length
from crosstrack.models.messenger.elongation import elongated, gap_local


@njit
def gap(x0, y0, h0, x1, y1, r):
    """Return the open interval of lengths above the shortest that no path to a point attains."""
    u, v, slack = local(x0, y0, h0, x1, y1, r)
    return gap_local(u, v, r, slack)


@njit  # not cached: a cache would be stale after changes of the callees
def limits(rows, radius, found):
    """Fill in the shortest length and the gap."""
    for i in range(len(rows)):
        x0, y0, h0, x1, y1 = rows[i]
        found[i, 0] = relaxed_length(x0, y0, h0, x1, y1, radius[i])
        found[i, 1], found[i, 2] = gap(x0, y0, h0, x1, y1, radius[i])


@njit
def walks(rows, radius, wanted, found):
    """Fill in distance to the target, total and smallest length of the path, and whether it exists."""
    for i in range(len(rows)):
        x0, y0, h0, x1, y1 = rows[i]
        r = radius[i]
        a, b, c, s1, s2, s3, ok = elongated(x0, y0, h0, x1, y1, r, wanted[i])
        x, y, h = advance(x0, y0, h0, a, s1, r)
        if r == 0.0:  # the turn leads to the target
            h = math.atan2(y1 - y, x1 - x)
        x, y, h = advance(x, y, h, b, s2, r)
        x, y, h = advance(x, y, h, c, s3, r)
        found[i, 0] = math.sqrt((x - x1) ** 2 + (y - y1) ** 2)
        found[i, 1], found[i, 2], found[i, 3] = a + b + c, min(a, b, c), 1.0 if ok else 0.0


def drawn(rng, count):
    """Return starts, targets and radii: near, far, ahead and equal, from mm to thousands of km."""
    radius = 10 ** rng.uniform(-3, 3, count)
    rows = rng.uniform(-3, 3, (count, 5))
    away = rng.normal(size=(count, 2)) * radius[:, None] * 10 ** rng.uniform(-2, 1.5, (count, 1))
    away[::4] = rng.uniform(-3, 3, (len(away[::4]), 2)) * radius[::4, None]
    rows[::6, 2], away[::6, 1] = 0, 0  # straight ahead or behind
    away[::101] = 0
    radius[::31] = 0
    rows[:, 3:] = rows[:, :2] + away
    scale = 10 ** rng.choice([-3.0, 0.0, 4.0], count)
    rows[:, [0, 1, 3, 4]] *= scale[:, None]
    return rows, radius * scale


def lengths_of(rng, least, low, high, radius):
    """Return a length outside the gap for each target, often next to a limit."""
    part, kind = rng.uniform(0, 1, len(least)), rng.integers(0, 6, len(least))
    has = np.isfinite(low)
    low, high = np.where(has, low, 2 * least), np.where(has, high, 2 * least)
    wanted = np.select(
        [kind == k for k in range(5)],
        [least, least + part * (low - least), low, high, high + part * 7 * radius],
        least + 10 ** (4 * part) * radius,
    )
    return np.where(has & (wanted > low) & (wanted < high), high, wanted)


def test_every_length_outside_the_gap_is_attained():
    rng = np.random.default_rng(11)
    rows, radius = drawn(rng, 100_000)
    known, found = np.empty((len(rows), 3)), np.empty((len(rows), 4))
    limits(rows, radius, known)
    assert 0.1 < np.isfinite(known[:, 1]).mean() < 0.5
    assert (known[:, 0] <= known[:, 1] * (1 + 1e-12)).all()
    wanted = lengths_of(rng, *known.T, radius)
    walks(rows, radius, wanted, found)
    size = np.maximum(wanted, radius) + 1e-6 * np.abs(rows[:, :2]).max(axis=1)
    assert (found[:, 3] == 1).all()
    assert (found[:, 2] >= 0).all()
    assert (np.abs(found[:, 1] - wanted) <= 1e-9 * np.maximum(wanted, radius)).all()
    assert (found[:, 0] <= 1e-9 * size).all()


def test_lengths_in_the_gap_and_below_the_shortest_are_refused():
    rng = np.random.default_rng(12)
    rows, radius = drawn(rng, 30_000)
    known, found = np.empty((len(rows), 3)), np.empty((len(rows), 4))
    limits(rows, radius, known)
    least, low, high = known.T
    part = rng.uniform(1e-3, 1 - 1e-3, len(rows))
    wide = np.isfinite(low)
    wide[wide] = high[wide] - low[wide] > 1e-6 * radius[wide]
    wanted = part * least
    wanted[wide] = low[wide] + part[wide] * (high[wide] - low[wide])
    walks(rows, radius, wanted, found)
    some = least > 1e-6 * radius
    assert some.sum() > 20_000
    assert (found[some, 3] == 0).all()


def test_below_the_gap_paths_vary_without_a_jump():
    """Straight ahead by r: the shortest is r, then the gap between both RL, and u + 2 π r beyond."""
    low, high = gap(0.0, 0.0, 0.0, 1.0, 0.0, 1.0)
    beta, delta = math.acos(5 / math.sqrt(32)), math.acos(0.75)
    assert low == pytest.approx(math.pi / 4 - beta + delta, rel=1e-14)
    assert high == pytest.approx(math.pi / 4 + beta + 2 * math.pi - delta, rel=1e-14)
    assert 1 < low < high < 1 + 2 * math.pi
    assert gap(0.0, 0.0, 0.0, 0.0, 0.0, 2.0) == pytest.approx((0, 4 * math.pi))
    for place in ((0.5, 2.5), (0.1, 0.9), (-1.0, 1.0), (3.0, 0.0), (-3.0, 0.0)):
        assert gap(0.0, 0.0, 0.0, *place, 1.0) == (math.inf, math.inf)


def test_a_gap_is_that_of_the_mirror_image_and_scales():
    rows, radius = drawn(np.random.default_rng(13), 5000)
    rows[:, :3] = 0
    known, other = np.empty((5000, 3)), np.empty((5000, 3))
    limits(rows, radius, known)
    rows[:, 4] *= -1
    limits(rows * 2.0**20, radius * 2.0**20, other)
    np.testing.assert_array_equal(other, known * 2.0**20)


def misses(curvatures, length, target):
    """Return the squared distance from the end of equally long arcs to a target, and its derivatives."""
    piece = length / len(curvatures)
    half = 0.5 * piece * curvatures
    heading = np.cumsum(2 * half) - half
    chord = piece * np.sinc(half / math.pi)
    safe = np.where(np.abs(half) < 1e-6, 1e-6, half)
    slope = 0.5 * piece**2 * (np.cos(safe) * safe - np.sin(safe)) / safe**2
    x, y = chord * np.cos(heading), chord * np.sin(heading)
    off = np.array([x.sum(), y.sum()]) - target
    rest_x, rest_y = (np.cumsum(one[::-1])[::-1] - 0.5 * one for one in (x, y))
    slopes = np.array(
        [slope * np.cos(heading) - piece * rest_y, slope * np.sin(heading) + piece * rest_x]
    )
    return off @ off, 2 * off @ slopes


def nearest(rng, length, target, starts, pieces=16):
    """Return the least distance to a target over paths of a length, by random local searches."""
    best = math.inf
    for start in range(starts):
        curvatures = rng.uniform(-1, 1, pieces)
        if start % 2:
            curvatures = np.repeat(rng.choice([-1.0, 0.0, 1.0], 4), pieces // 4)
        bounds = [(-1, 1)] * pieces
        done = minimize(misses, curvatures, (length, target), jac=True, bounds=bounds)
        best = min(best, math.sqrt(done.fun))
    return best


def compare_with_searches(rng, targets, starts):
    """Assert that searches reach targets outside the gap only, up to a margin at its ends."""
    seen = 0
    while seen < targets:
        target = rng.uniform((-0.5, -2), (3, 2))
        least = relaxed_length(0.0, 0.0, 0.0, *target, 1.0)
        low, high = gap(0.0, 0.0, 0.0, *target, 1.0)
        if math.isfinite(low) and high - low < 1:
            continue
        seen += 1
        if math.isfinite(low):
            for part in (0.15, 0.5, 0.85):
                assert nearest(rng, low + part * (high - low), target, starts) > 5e-3
            assert nearest(rng, high + 0.5, target, 8 * starts) < 1e-2
        else:
            for more in (0.3, 1.0, 2.0, 4.0):
                assert nearest(rng, least + more, target, 8 * starts) < 1e-2


def test_no_path_has_a_length_in_the_gap():
    compare_with_searches(np.random.default_rng(14), 5, 2)


@pytest.mark.slow
def test_no_path_of_many_has_a_length_in_the_gap():
    compare_with_searches(np.random.default_rng(15), 60, 12)


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -1.0])
def test_rejects_an_invalid_length(wanted):
    assert elongated(0.0, 0.0, 0.0, 3.0, 1.0, 1.0, wanted) == (0, 0, 0, 0, 0, 0, False)


def test_interpreted_kernels_give_the_same_bits():
    rows, radius = drawn(np.random.default_rng(16), 150)
    known = np.empty((len(rows), 3))
    limits(rows, radius, known)
    wanted = lengths_of(np.random.default_rng(17), *known.T, radius)
    for row, r, d in zip(rows.tolist(), radius.tolist(), wanted.tolist(), strict=True):
        assert elongated.py_func(*row, r, d) == elongated.dispatcher(*row, r, d)
        u, v, slack = local(*row, r)
        assert gap_local.py_func(u, v, r, slack) == gap_local.dispatcher(u, v, r, slack)
