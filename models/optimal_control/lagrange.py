"""Polynomials through values at nodes: weights, interpolation and differentiation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["barycentric_weights", "differentiation", "interpolation"]

Floats = NDArray[np.float64]


def barycentric_weights(nodes: ArrayLike) -> Floats:
    """Return the barycentric weights of distinct nodes, scaled to a largest magnitude of 1.

    Logarithms keep hundreds of nodes from overflow and underflow (Berrut and Trefethen,
    "Barycentric Lagrange interpolation", 2004).
    """
    x = np.asarray(nodes, float)
    if x.size == 1:
        return np.ones(1)
    distance = x[:, None] - x[None, :]
    np.fill_diagonal(distance, 1.0)
    logs = -np.log(np.abs(distance)).sum(axis=1)
    signs = np.sign(distance).prod(axis=1)
    weights: Floats = signs * np.exp(logs - logs.max())
    return weights


def interpolation(nodes: ArrayLike, points: ArrayLike, weights: Floats | None = None) -> Floats:
    """Return the matrix that maps values at `nodes` to values at `points`, shape (points, nodes)."""
    x, t = np.asarray(nodes, float), np.atleast_1d(np.asarray(points, float))
    w = barycentric_weights(x) if weights is None else weights
    distance = t[:, None] - x[None, :]
    hit = distance == 0.0
    distance[hit] = 1.0
    matrix: Floats = w / distance
    matrix /= matrix.sum(axis=1, keepdims=True)
    rows = hit.any(axis=1)
    matrix[rows] = hit[rows].astype(float)
    return matrix


def differentiation(nodes: ArrayLike) -> Floats:
    """Return the matrix that maps values at `nodes` to derivatives there, shape (nodes, nodes)."""
    x = np.asarray(nodes, float)
    w = barycentric_weights(x)
    distance = x[:, None] - x[None, :]
    np.fill_diagonal(distance, 1.0)
    matrix: Floats = (w[None, :] / w[:, None]) / distance
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix
