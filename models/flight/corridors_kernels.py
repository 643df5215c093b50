"""Kernels of the inflation of a corridor: nearest points of bodies, and planes around an ellipsoid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["approach", "cover", "least_norm"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Maximum number of cuts per plane, and accuracy of the constraints of a least norm.
CUTS, EXACT = 12, 1e-9


@kernel(interpretable=True)
def approach(centres: Floats, arms: Floats, sweeps: int, points: Floats) -> None:
    """Write the points of bodies nearest to the origin by coordinate descent; `points`: zeros, shape (n, d)."""
    count, axes = centres.shape
    kinds = arms.shape[1]
    shares, before = np.zeros(kinds), np.zeros(axes)
    for body in range(count):
        for axis in range(axes):
            points[body, axis] = centres[body, axis]
        for k in range(kinds):
            shares[k] = 0.0
        for _ in range(sweeps):
            for axis in range(axes):
                before[axis] = points[body, axis]
            for k in range(kinds):
                along, square = 0.0, 0.0
                for axis in range(axes):
                    along += points[body, axis] * arms[body, k, axis]
                    square += arms[body, k, axis] * arms[body, k, axis]
                share = shares[k] - along / max(square, 1e-300)
                share = min(max(share, -1.0), 1.0)
                for axis in range(axes):
                    points[body, axis] += (share - shares[k]) * arms[body, k, axis]
                shares[k] = share
            change = 0.0
            for axis in range(axes):
                change = max(change, abs(points[body, axis] - before[axis]))
            if kinds < 2 or change < 1e-12:
                break


@kernel(interpretable=True)
def least_norm(rows: Floats, bounds: Floats, count: int, least: Floats) -> bool:
    """Write the least a with ``rows @ a >= bounds`` for the first rows, d = 2 or 3; return False without one.

    A bound must be positive. At the optimum, a is a combination of at most d rows that bind, with positive
    weights. All of them are tried.
    """
    axes = rows.shape[1]
    table, weights, chosen = np.zeros((3, 4)), np.zeros(3), np.zeros(3, np.int64)
    for i in range(count):
        for j in range(i, count):
            for k in range(j, count):
                chosen[0], chosen[1], chosen[2] = i, j, k
                size = 1 if i == k else (2 if j == k else 3)
                if size > axes or (i == j and j < k):
                    continue
                for p in range(size):
                    table[p, size] = bounds[chosen[p]]
                    for q in range(size):
                        table[p, q] = 0.0
                        for axis in range(axes):
                            table[p, q] += rows[chosen[p], axis] * rows[chosen[q], axis]
                good = True
                for p in range(size):  # elimination of a positive definite matrix
                    first = table[p, p]
                    for axis in range(axes):
                        first -= 1e-12 * rows[chosen[p], axis] * rows[chosen[p], axis]
                    if not first > 0.0:
                        good = False
                        break
                    for q in range(p + 1, size):
                        factor = table[q, p] / table[p, p]
                        for c in range(p, size + 1):
                            table[q, c] -= factor * table[p, c]
                if not good:
                    continue
                for p in range(size - 1, -1, -1):
                    weights[p] = table[p, size]
                    for q in range(p + 1, size):
                        weights[p] -= table[p, q] * weights[q]
                    weights[p] /= table[p, p]
                    good = good and weights[p] >= 0.0
                if not good:
                    continue
                for axis in range(axes):
                    least[axis] = 0.0
                    for p in range(size):
                        least[axis] += weights[p] * rows[chosen[p], axis]
                for row in range(count):
                    value = 0.0
                    for axis in range(axes):
                        value += rows[row, axis] * least[axis]
                    if value < bounds[row] - EXACT:
                        good = False
                        break
                if good:
                    return True
    return False


@kernel
def _support(centres: Floats, arms: Floats, body: int, normal: Floats) -> float:
    """Return the lowest offset of a body along a normal."""
    offset = 0.0
    for axis in range(normal.size):
        offset += centres[body, axis] * normal[axis]
    for k in range(arms.shape[1]):
        along = 0.0
        for axis in range(normal.size):
            along += arms[body, k, axis] * normal[axis]
        offset -= abs(along)
    return offset


@kernel
def _touch(
    centres: Floats, arms: Floats, radius: float, body: int, normal: Floats, vertex: Floats
) -> None:
    """Write the point of an enlarged body with the lowest offset along a unit normal."""
    for axis in range(normal.size):
        vertex[axis] = centres[body, axis] - radius * normal[axis]
    for k in range(arms.shape[1]):
        along = 0.0
        for axis in range(normal.size):
            along += arms[body, k, axis] * normal[axis]
        for axis in range(normal.size):
            vertex[axis] -= np.sign(along) * arms[body, k, axis]


@kernel(interpretable=True)
def cover(
    centres: Floats, arms: Floats, radius: float, seeds: Floats, away: Floats, margin: float,
    centre: Floats, inverse: Floats, points: Floats, order: Ints, normals: Floats, owners: Ints,
) -> int:  # fmt: skip
    """Write unit normals of planes that separate all bodies, and the body of each; return their number.

    Each plane touches its body and is as far as possible from the centre of an ellipsoid, in its metric:
    {y : a @ y = 1} with the least norm of a. It keeps the margin from the segment. Bodies are enlarged by a
    radius, so that their constraints are added one at a time.

    `away`, shape (n, d): normals of bodies without such a plane. `inverse`: inverse of the ellipsoid's factor.
    `points`, shape (n, d): first vertices in its metric. `order`: bodies by their distance. `normals`, shape
    (n, d), and `owners`, shape (n,), receive the result.
    """
    count, axes = centres.shape
    left = np.ones(count, np.uint8)
    rows, bounds = np.zeros((2 * CUTS + 1, axes)), np.zeros(2 * CUTS + 1)
    least, normal = np.zeros(axes), np.zeros(axes)
    vertex, limit = np.zeros(axes), np.zeros(axes)
    found = 0
    for at in range(count):
        body = order[at]
        if left[body] == 0:
            continue
        number, fits, offset, nearest = 1, True, 0.0, 0.0
        for axis in range(axes):
            rows[0, axis] = points[body, axis]
        bounds[0] = 1.0
        for _ in range(CUTS):
            fits = least_norm(rows, bounds, number, least)
            if not fits:
                break
            size = 0.0
            for axis in range(axes):
                normal[axis] = 0.0
                for other in range(axes):
                    normal[axis] += inverse[other, axis] * least[other]
                size += normal[axis] * normal[axis]
            for axis in range(axes):
                normal[axis] /= np.sqrt(size)
            _touch(centres, arms, radius, body, normal, vertex)
            nearest, seed = -np.inf, 0
            for k in range(seeds.shape[0]):
                along = 0.0
                for axis in range(axes):
                    along += seeds[k, axis] * normal[axis]
                if along > nearest:
                    nearest, seed = along, k
            offset, reached, kept = 0.0, 0.0, 0.0
            for axis in range(axes):
                offset += vertex[axis] * normal[axis]
                rows[number, axis] = limit[axis] = 0.0
                for other in range(axes):
                    share = vertex[other] - centre[other]
                    rows[number, axis] += inverse[axis, other] * share
                    share = seeds[seed, other] + margin * normal[other] - centre[other]
                    limit[axis] += inverse[axis, other] * share
                reached += rows[number, axis] * least[axis]
                kept += limit[axis] * least[axis]
            added = number
            if reached < 1.0 - 1e-6:
                bounds[number] = 1.0
                number += 1
            if kept > 1.0 + 1e-6:
                bounds[number] = -1.0
                for axis in range(axes):
                    rows[number, axis] = -limit[axis]
                number += 1
            if added == number:
                break
        if fits:
            middle = 0.0
            for axis in range(axes):
                middle += centre[axis] * normal[axis]
            fits = nearest + 0.5 * margin <= offset and middle < offset
        for axis in range(axes):
            normals[found, axis] = normal[axis] if fits else away[body, axis]
        first = _support(centres, arms, body, normals[found])
        for other in range(count):
            if left[other] != 0 and _support(centres, arms, other, normals[found]) >= first:
                left[other] = 0
        left[body] = 0
        owners[found] = body
        found += 1
    return found
