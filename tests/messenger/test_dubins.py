"""Shortest paths between configurations and to points, compared with OMPL, mpmath and brute force."""

from __future__ import annotations

import importlib.util
import math

import mpmath
import numpy as np
import pytest
from messenger.flights import shortest_lengths
from numba import njit

from crosstrack.models.messenger.dubins import (
    RELAXED_WORDS,
    WORDS,
    advance,
    relaxed,
    relaxed_length,
    shortest,
    word_lengths,
)

FULL = 2.0 * math.pi

OMPL = """
import sys, numpy as np
from ompl import base
rows = np.load(sys.argv[1])
found = np.empty(len(rows))
for radius in np.unique(rows[:, 6]):
    space = base.DubinsStateSpace(float(radius))
    start, end = space.allocState(), space.allocState()
    for i in np.flatnonzero(rows[:, 6] == radius):
        x0, y0, h0, x1, y1, h1, _ = rows[i].tolist()
        start.setXY(x0, y0), start.setYaw(h0), end.setXY(x1, y1), end.setYaw(h1)
        found[i] = space.distance(start, end)
np.save(sys.argv[1], found)
"""


@njit  # not cached: a cache would be stale after changes of the callees
def ends(rows, radius, off, turned):
    """Fill in distance and angle between the target and the end of each word and of the relaxed path."""
    for i in range(len(rows)):
        x0, y0, h0, x1, y1, h1 = rows[i]
        r = radius[i]
        for word in range(6):
            lengths = word_lengths(x0, y0, h0, x1, y1, h1, r, word)
            x, y, h = x0, y0, h0
            for k in range(3):
                x, y, h = advance(x, y, h, lengths[k], WORDS[word, k], r)
            off[i, word] = math.sqrt((x - x1) ** 2 + (y - y1) ** 2)
            turned[i, word] = abs(math.sin(0.5 * (h - h1)))
        a, b, code = relaxed(x0, y0, h0, x1, y1, r)
        x, y, h = advance(x0, y0, h0, a, RELAXED_WORDS[code, 0], r)
        x, y, h = advance(x, y, h, b, RELAXED_WORDS[code, 1], r)
        off[i, 6] = math.sqrt((x - x1) ** 2 + (y - y1) ** 2)


@njit
def over_headings(rows, radius, count, least, found):
    """Fill in the relaxed length, and the least shortest length over `count` final headings."""
    for i in range(len(rows)):
        x0, y0, h0, x1, y1, h1 = rows[i]
        found[i] = relaxed_length(x0, y0, h0, x1, y1, radius[i])
        least[i] = math.inf
        for k in range(count):
            heading = h1 + k * 2.0 * math.pi / count
            a, b, c, _ = shortest(x0, y0, h0, x1, y1, heading, radius[i])
            least[i] = min(least[i], a + b + c)


def wild(rng, count):
    """Return configurations and radii of all sizes, with ties, equal ends and parallel headings."""
    rows = rng.uniform(-5, 5, (count, 6))
    radius = 10 ** rng.uniform(-6, 6, count)
    rows[::7, 3:5] = rows[::7, :2]
    rows[::5, 5] = rows[::5, 2]
    rows[::3, 2] = 0
    rows[::4, 1] = rows[::4, 4]
    rows[1::6] = np.round(rows[1::6])
    radius[1::6] = np.clip(np.round(radius[1::6]), 1, 9)
    scale = np.where(np.arange(count) % 8 == 3, 10 ** rng.uniform(-3, 6, count), 1)
    rows[:, [0, 1, 3, 4]] *= scale[:, None]
    return rows, radius


def exact_lengths(row, radius):
    """Return the least length by Shkel and Lumelsky's formulas with 50 digits."""
    mp = mpmath.mp.clone()
    mp.dps = 50

    def turn(angle):
        rest = angle - 2 * mp.pi * mp.floor(angle / (2 * mp.pi))
        return mp.zero if 2 * mp.pi - rest < mp.mpf(10) ** -40 else rest

    x0, y0, h0, x1, y1, h1, r = (mp.mpf(float(one)) for one in (*row, radius))
    d, to = mp.hypot(x1 - x0, y1 - y0) / r, mp.atan2(y1 - y0, x1 - x0)
    alpha, beta = turn(h0 - to), turn(h1 - to)
    sines, cosines = (mp.sin(alpha), mp.sin(beta)), (mp.cos(alpha), mp.cos(beta))
    common, found = mp.cos(alpha - beta), []
    for side in (1, -1):  # words that begin with L, and their mirror images
        first, last = (alpha, beta) if side == 1 else (turn(-alpha), turn(-beta))
        sa, sb, (ca, cb) = side * sines[0], side * sines[1], cosines
        square = 2 + d * d - 2 * common + 2 * d * (sa - sb)
        to_end = mp.atan2(cb - ca, d + sa - sb)
        line = mp.sqrt(max(square, 0))
        found.append(turn(to_end - first) + line + turn(last - to_end))
        square = d * d - 2 + 2 * common + 2 * d * (sa + sb)
        if square >= 0:
            line = mp.sqrt(square)
            to_end = mp.atan2(-ca - cb, d + sa + sb) + mp.atan2(2, line)
            found.append(turn(to_end - first) + line + turn(to_end - last))
        cosine = (6 - d * d + 2 * common - 2 * d * (sa - sb)) / 8
        if abs(cosine) <= 1:
            middle = 2 * mp.pi - mp.acos(cosine)
            begin = turn(mp.atan2(cb - ca, d + sa - sb) - first + middle / 2)
            found.append(begin + middle + turn(last - first - begin + middle))
    return float(min(found) * r)


@pytest.mark.skipif(importlib.util.find_spec("ompl") is None, reason="OMPL is not installed")
def test_shortest_lengths_are_those_of_ompl(tmp_path, run_python):
    rng = np.random.default_rng(2)
    rows = rng.uniform(-10, 10, (100_000, 7))
    rows[:, [2, 5]] *= math.pi / 10
    rows[:, 6] = 10 ** rng.integers(-1, 2, len(rows)).astype(float)
    np.save(tmp_path / "rows.npy", rows)
    run_python("-c", OMPL, "rows.npy", cwd=tmp_path)
    theirs = np.load(tmp_path / "rows.npy")
    ours = shortest_lengths(rows[:, :3], rows[:, 3:6], rows[:, 6])
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_wild_lengths_are_those_of_long_numbers():
    rows, radius = wild(np.random.default_rng(3), 100)
    ours = shortest_lengths(rows[:, :3], rows[:, 3:], radius)
    exact = [exact_lengths(row, r) for row, r in zip(rows, radius, strict=True)]
    np.testing.assert_allclose(ours, exact, rtol=1e-14)


def test_every_word_ends_at_its_target():
    rows, radius = wild(np.random.default_rng(4), 20_000)
    off, turned = np.empty((len(rows), 7)), np.empty((len(rows), 6))
    ends(rows, radius, off, turned)
    size = np.abs(rows[:, [0, 1, 3, 4]]).sum(axis=1) + radius
    exists = np.isfinite(off)
    assert exists[:, [0, 1, 6]].all() and not exists.all(axis=0)[2:6].any()
    assert np.where(exists, off / size[:, None], 0).max() < 1e-12
    assert np.where(exists[:, :6], turned, 0).max() < 1e-11


def test_a_path_to_a_point_is_the_best_over_end_headings():
    rng = np.random.default_rng(5)
    rows, radius = rng.uniform(-2.5, 2.5, (1000, 6)), np.ones(1000)
    least, found, count = np.empty(1000), np.empty(1000), 600
    over_headings(rows, radius, count, least, found)
    assert (found < least + 1e-12).all()
    # At the best final heading the length is flat, or has a kink if a turn vanishes.
    assert (least - found).max() < 2 * FULL / count
    assert np.median(least - found) < 2 * FULL / count**1.5


@pytest.mark.parametrize("radius", [0.0, 1e-9, 1.0, 1e12])
@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi, -7.3, 1e3])
@pytest.mark.parametrize("place", [(0.0, 0.0), (1e7, -3e6), (1e-3, 2e-3)])
def test_equal_ends_have_length_0(radius, heading, place):
    start = (*place, heading)
    assert shortest_lengths(start, start, radius) == 0.0
    assert shortest(*start, *start, radius)[:3] == (0.0, 0.0, 0.0)
    assert relaxed_length(*start, *place, radius) == 0.0


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("turned", [1e-15, -1e-15])
def test_rounding_makes_no_full_circle(radius, turned):
    """Straight ahead, along an arc, and from an arc, with errors in the last bits of the coordinates."""
    h = 0.7
    ahead = (1e6 + 5 * math.cos(h), -2e6 + 5 * math.sin(h), h + turned)
    assert shortest_lengths((1e6, -2e6, h), ahead, radius) == pytest.approx(5, abs=1e-8)
    assert relaxed_length(1e6, -2e6, h, *ahead[:2], radius) == pytest.approx(5, abs=1e-8)
    for angle in (0.5, 3.0, 6.0):
        end = advance(1e6, -2e6, h, radius * angle, 1, radius)
        length = shortest_lengths((1e6, -2e6, h), (end[0], end[1], end[2] + turned), radius)
        assert length == pytest.approx(radius * angle, abs=1e-7 + 1e-7 * radius)


def test_lengths_scale_with_the_plane():
    rows, radius = wild(np.random.default_rng(6), 5000)
    scale = 2.0**30  # a power of two keeps every bit
    larger = rows.copy()
    larger[:, [0, 1, 3, 4]] *= scale
    ours = shortest_lengths(rows[:, :3], rows[:, 3:], radius)
    np.testing.assert_array_equal(shortest_lengths(larger[:, :3], larger[:, 3:], radius * scale), ours * scale)  # fmt: skip


def test_with_radius_0_paths_are_straight():
    rows, _ = wild(np.random.default_rng(7), 2000)
    straight = np.hypot(rows[:, 3] - rows[:, 0], rows[:, 4] - rows[:, 1])
    np.testing.assert_allclose(
        shortest_lengths(rows[:, :3], rows[:, 3:], 0.0), straight, rtol=1e-14
    )
    assert shortest(0.0, 0.0, 0.0, -1.0, 1.0, 2.0, 0.0)[:3] == (0.0, math.sqrt(2.0), 0.0)


def test_interpreted_kernels_give_the_same_bits():
    rows, radius = wild(np.random.default_rng(8), 100)
    for row, r in zip(rows.tolist(), radius.tolist(), strict=True):
        for function, arguments in ((shortest, (*row, r)), (relaxed, (*row[:5], r))):
            assert function.py_func(*arguments) == function.dispatcher(*arguments)
