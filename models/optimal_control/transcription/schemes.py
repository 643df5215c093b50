"""Collocation schemes: where the dynamics are imposed within an interval, and how.

Within an interval, mapped to τ in [-1, 1], every scheme has the form

    left @ X = (h / 2) right @ F,

with the states X at all points of the interval including both ends, the rates F at the collocated
points, and the interval's length h in time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...fields import frozen
from ..lagrange import barycentric_weights, differentiation, interpolation

__all__ = [
    "Scheme",
    "gauss",
    "gauss_points",
    "hermite_simpson",
    "integration",
    "radau",
    "radau_points",
    "trapezoid",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scheme:
    """Collocation scheme of one interval.

    `from_states` and `from_rates` give the values of the plan's polynomial at its nodes `plan_points`:
    ``from_states @ X + (h / 2) from_rates @ F``. If `shared`, the ends of intervals are collocated, and
    neighbours share their control there.
    """

    points: Floats  # of the states, from -1 to 1 inclusive
    collocated: NDArray[np.int64]  # points with controls, at which the dynamics are imposed
    left: Floats  # coefficients of the states, (rows, points)
    right: Floats  # coefficients of ``(h / 2) F``, (rows, collocated)
    weights: Floats  # of the quadrature, with sum 2
    plan_points: Floats
    from_states: Floats  # (plan points, points)
    from_rates: Floats  # (plan points, collocated)
    shared: bool = False

    def __post_init__(self) -> None:
        # Schemes are cached and shared, so their arrays are read-only.
        for name, value in tuple(vars(self).items()):
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, frozen(value))

    @property
    def control_points(self) -> Floats:
        """Positions of the controls, in [-1, 1]."""
        return self.points[self.collocated]

    def costates(self, duals: Floats) -> tuple[Floats, Floats] | None:
        """Return nodes and costates there, from row multipliers of shape (rows, states).

        The covector mapping: the multiplier of a row is the derivative of the objective with respect to
        its right-hand side. None if the scheme has no mapping.
        """
        return None


class _Gauss(Scheme):
    def costates(self, duals: Floats) -> tuple[Floats, Floats]:
        # The last row shifts the end alone. The others change the rate at a node, divided by its
        # weight (Benson 2005). The begin takes the remainder of the differentiated polynomial.
        inner, end = duals[:-1], duals[-1]
        nodes = inner / self.weights[:, None] + end
        begin = end - self.left[:-1, 0] @ inner
        return self.points, np.vstack([begin, nodes, end])


class _Radau(Scheme):
    def costates(self, duals: Floats) -> tuple[Floats, Floats]:
        begin = -self.left[:, 0] @ duals
        return self.points, np.vstack([begin, duals / self.weights[:, None]])


@cache
def gauss_points(count: int) -> tuple[Floats, Floats]:
    """Return the Legendre-Gauss nodes and weights, exact for polynomials of degree ``2 count - 1``."""
    nodes, weights = legendre.leggauss(count)
    return frozen(nodes), frozen(weights)


@cache
def radau_points(count: int) -> tuple[Floats, Floats]:
    """Return the Legendre-Gauss-Radau nodes, which include 1, and weights (degree ``2 count - 2``).

    The nodes are roots of P_count - P_(count-1), polished by Newton's method.
    """
    if count == 1:
        return frozen(np.ones(1)), frozen(np.full(1, 2.0))
    series = np.zeros(count + 1)
    series[-2:] = -1.0, 1.0
    inner = np.sort(legendre.legroots(series).real)[:-1]
    slope = legendre.legder(series)
    for _ in range(3):
        inner = inner - legendre.legval(inner, series) / legendre.legval(inner, slope)
    nodes = np.append(inner, 1.0)
    before = np.zeros(count)
    before[-1] = 1.0
    weights = (1.0 + nodes) / (count * legendre.legval(nodes, before)) ** 2
    return frozen(nodes), frozen(weights)


@cache
def gauss(count: int) -> Scheme:
    """Return the Gauss scheme with `count` Legendre-Gauss nodes (eq. 16-20 of the slew's paper).

    States are polynomials through -1 and the nodes, with Σ D_ki X_i = (h / 2) f at each node (eq. 19,
    printed with the opposite sign). The end is X(-1) + (h / 2) Σ w f (eq. 20).
    """
    nodes, weights = gauss_points(count)
    base = np.concatenate([[-1.0], nodes])
    points = np.append(base, 1.0)
    left = np.zeros((count + 1, count + 2))
    left[:count, : count + 1] = differentiation(base)[1:]
    left[count, 0], left[count, -1] = -1.0, 1.0
    right = np.vstack([np.eye(count), weights])
    onto = np.eye(count + 2), np.zeros((count + 2, count))
    return _Gauss(points, np.arange(1, count + 1), left, right, weights, points, *onto)


@cache
def radau(count: int) -> Scheme:
    """Return the Radau scheme with `count` nodes, which include the interval's end (Radau IIA).

    Garg, Patterson, Hager, Rao, Benson and Huntington, "A unified framework for the numerical solution of optimal
    control problems using pseudospectral methods", Automatica 46 (2010), mirrored: the end is collocated.
    """
    nodes, weights = radau_points(count)
    points = np.concatenate([[-1.0], nodes])
    left, onto = differentiation(points)[1:], (np.eye(count + 1), np.zeros((count + 1, count)))
    return _Radau(points, np.arange(1, count + 1), left, np.eye(count), weights, points, *onto)


@cache
def hermite_simpson(count: int = 3) -> Scheme:
    """Return the separated Hermite-Simpson scheme with 3 nodes (Betts 2010, section 4.6.6)."""
    left = np.array([[-0.5, 1.0, -0.5], [-1.0, 0.0, 1.0]])
    right = np.array([[0.25, 0.0, -0.25], [1.0 / 3.0, 4.0 / 3.0, 1.0 / 3.0]])
    # The cubic with the values and slopes of both ends, at four equidistant nodes.
    t = np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0])
    s = 0.5 * (t + 1.0)
    states = np.zeros((4, 3))
    states[:, 0] = 1.0 - 3.0 * s**2 + 2.0 * s**3
    states[:, 2] = 3.0 * s**2 - 2.0 * s**3
    rates = np.zeros((4, 3))
    rates[:, 0] = 2.0 * (s - 2.0 * s**2 + s**3)
    rates[:, 2] = 2.0 * (s**3 - s**2)
    points, weights = np.array([-1.0, 0.0, 1.0]), np.array([1.0, 4.0, 1.0]) / 3.0
    return Scheme(points, np.arange(3), left, right, weights, t, states, rates, shared=True)


@cache
def trapezoid(count: int = 2) -> Scheme:
    """Return the trapezoidal scheme with 2 nodes (Betts 2010, section 4.6.5)."""
    # The quadratic from the first state with both slopes; the rule makes it end at the second state.
    states = np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]])
    rates = np.array([[0.0, 0.0], [0.25, -0.25], [0.0, 0.0]])
    points, nodes = np.array([-1.0, 1.0]), np.array([-1.0, 0.0, 1.0])
    left, right, weights = np.array([[-1.0, 1.0]]), np.ones((1, 2)), np.ones(2)
    return Scheme(points, np.arange(2), left, right, weights, nodes, states, rates, shared=True)


@cache
def integration(count: int) -> tuple[Floats, Floats]:
    """Return `count` Legendre-Gauss nodes, and the matrix of integrals from -1 to each node and to 1.

    The matrix has the shape (count + 1, count). It is exact for polynomials through the values at
    the nodes.
    """
    nodes, weights = gauss_points(count)
    barycentric = barycentric_weights(nodes)
    matrix = np.empty((count + 1, count))
    for row, half in enumerate(
        0.5 * (np.append(nodes, 1.0) + 1.0)
    ):  # all rows at once need count³ floats
        matrix[row] = half * weights @ interpolation(nodes, half * (nodes + 1.0) - 1.0, barycentric)
    return frozen(nodes), frozen(matrix)
