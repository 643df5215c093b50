"""Kernels of the inflation of corridors against plain versions and other methods."""

import numpy as np

from crosstrack import jit
from crosstrack.models.flight.corridors_kernels import approach, cover, least_norm


def test_the_least_norm_is_that_of_nonnegative_least_squares():
    from scipy.optimize import nnls

    draw, agree = np.random.default_rng(2), {True: 0, False: 0}
    for _ in range(300):
        axes, count = int(draw.integers(2, 4)), int(draw.integers(1, 8))
        rows = draw.standard_normal((count, axes))
        bounds = draw.choice([1.0, -1.0], count)
        bounds[0] = 1.0
        # Lawson and Hanson 1974, ch. 23: the residual of a nonnegative problem is the least vector.
        table, target = np.concatenate([rows.T, bounds[None]]), np.append(np.zeros(axes), 1.0)
        residual = table @ nnls(table, target)[0] - target
        least = np.full(axes, np.nan)
        feasible = least_norm.py_func(rows, bounds, count, least)
        assert feasible == (np.linalg.norm(residual) > 1e-9)
        agree[feasible] += 1
        if feasible:
            np.testing.assert_allclose(least, -residual[:-1] / residual[-1], atol=1e-7)
    assert min(agree.values()) > 30


def test_kernels_equal_their_plain_versions():
    draw = np.random.default_rng(3)
    centres, arms = draw.standard_normal((12, 3)) * 2, 0.2 * draw.standard_normal((12, 3, 3))
    points, plain = np.zeros((12, 3)), np.zeros((12, 3))
    jit.compile_always()
    approach(centres, arms, 60, points)
    approach.py_func(centres, arms, 60, plain)
    np.testing.assert_array_equal(points, plain)
    # They are points of the bodies, and no other point is nearer.
    inside = np.linalg.solve(np.swapaxes(arms, 1, 2), (points - centres)[:, :, None])
    assert np.abs(inside).max() <= 1.0 + 1e-9
    shares = draw.uniform(-1.0, 1.0, (200, 12, 3))
    others = np.linalg.norm(centres + np.einsum("snk,nkd->snd", shares, arms), axis=2)
    assert (np.linalg.norm(points, axis=1) <= others + 1e-9).all()
    results = []
    for run in (cover, cover.py_func):
        normals, owners = np.zeros((12, 3)), np.zeros(12, np.int64)
        order = np.argsort(np.linalg.norm(points, axis=1))
        count = run(
            centres, arms, 0.1, np.zeros((1, 3)), points / np.linalg.norm(points, axis=1)[:, None],
            0.01, np.zeros(3), np.eye(3), points, order, normals, owners,
        )  # fmt: skip
        results.append((normals[:count], owners[:count]))
    np.testing.assert_array_equal(results[0][1], results[1][1])
    np.testing.assert_array_equal(results[0][0], results[1][0])
    # A plane at the distance of its owner separates each body from the centre.
    normals, owners = results[0]
    spread = np.abs(np.einsum("nkd,pd->nkp", arms, normals)).sum(axis=1)
    support = centres @ normals.T - spread
    assert ((support >= support[owners, np.arange(len(owners))] - 1e-12).any(axis=1)).all()
