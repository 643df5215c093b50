"""Monomial and Legendre bases in the scaled time of a segment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from ..polynomials import gauss_legendre
from .piecewise import PiecewiseFormulation, power_rows

__all__ = [
    "LegendreFormulation",
    "MonomialFormulation",
    "UnitBasisFormulation",
    "legendre_basis",
    "unit_gram",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Values of a basis function below this share of the sum of its terms' sizes are set to 0.
NOUGHT = 16 * float(np.finfo(float).eps)
#: Binary orders of magnitude of Legendre coefficients that need no unit of their own.
BALANCED = 8


@cache
def legendre_basis(order: int, degree: int) -> Floats:
    """Return the coefficients of the basis functions in powers of s, shape (degree + 1, degree + 1).

    Each column is a function: 1, s, …, s^(order-1), then the order-fold integrals from 0 of the
    Legendre polynomials that are orthonormal on [0, 1]. Integrals of Legendre polynomials of degree
    at least `order` vanish at both ends, together with their derivatives below `order`.
    """
    basis = np.zeros((degree + 1, degree + 1))
    basis[np.arange(order), np.arange(order)] = 1.0
    for number in range(degree + 1 - order):
        shifted = np.polynomial.legendre.Legendre.basis(number, domain=[0.0, 1.0])
        # The coefficients are integers. Normalisation comes last, so that each is rounded once.
        whole = np.round(shifted.convert(kind=np.polynomial.Polynomial).coef)
        integral = np.asarray(np.polynomial.polynomial.polyint(whole, order), float)
        integral *= np.sqrt(2 * number + 1.0)
        basis[: integral.size, order + number] = integral
    return basis


def unit_gram(basis: Floats, order: int) -> Floats:
    """Return ∫ φ_m^(order) φ_n^(order) ds over [0, 1] by exact quadrature, as a matrix (m, n)."""
    degree = basis.shape[0] - 1
    nodes, weights = gauss_legendre(degree + 1)
    rows = power_rows(nodes, order, degree) @ basis
    gram: Floats = (rows * weights[:, None]).T @ rows
    return gram


@dataclass(frozen=True, eq=False)
class UnitBasisFormulation(PiecewiseFormulation):
    """Base of formulations whose basis in s = (t - t_k) / T_k differs between segments by scales."""

    @cached_property
    def powers(self) -> Floats:
        """Coefficients of the basis functions in powers of s, with one column per function."""
        return np.eye(self.model.degree + 1)

    @cached_property
    def scales(self) -> Floats:
        """Scale of each basis function, shape (segments, degree + 1)."""
        return np.ones((self.model.segments, self.model.degree + 1))

    def basis_rows(self, segments: Ints, s: Floats, derivative: int) -> Floats:
        """Return the derivatives of the basis functions in time, one row per instant."""
        powers = power_rows(s, derivative, self.model.degree)
        unit = powers @ self.powers
        # Rounding noise in place of a 0 is an entry that a proof by multipliers cannot cancel.
        unit[np.abs(unit) <= NOUGHT * (np.abs(powers) @ np.abs(self.powers))] = 0.0
        long = self.model.durations[segments] ** -float(derivative)
        rows: Floats = unit * self.scales[segments] * long[:, None]
        return rows

    def gram(self) -> Floats:
        """Return the blocks of the objective, shape (segments, degree + 1, degree + 1)."""
        model = self.model
        total = np.zeros((model.segments, model.degree + 1, model.degree + 1))
        for order, weight in enumerate(model.order_weights, start=1):
            if weight:
                unit = unit_gram(self.powers, order)
                total += (weight * model.durations ** (1.0 - 2 * order))[:, None, None] * unit
        return total * self.scales[:, :, None] * self.scales[:, None, :]

    @np.errstate(over="ignore", invalid="ignore")  # Trajectory rejects values that are not finite
    def to_powers(self, local: Floats) -> Floats:
        """Convert coefficients in this basis to powers of s."""
        return (local * self.scales[:, None, :]) @ self.powers.T

    def from_powers(self, powers: Floats) -> Floats:
        """Convert powers of s to coefficients in this basis."""
        local = np.linalg.solve(self.powers, np.moveaxis(powers, -1, -2))
        return np.moveaxis(local, -1, -2) / self.scales[:, None, :]


@dataclass(frozen=True, eq=False)
class MonomialFormulation(UnitBasisFormulation):
    """Powers of the scaled time of each segment: the paper's program without absolute time."""

    name = "monomial"
    summary = "powers of a segment's own time, scaled to [0, 1]"


@dataclass(frozen=True, eq=False)
class LegendreFormulation(UnitBasisFormulation):
    """1, s, …, s^(r-1) and r-fold integrals of Legendre polynomials: the Hessian is diag(0, 1).

    Interior-point solvers solve corridors of 1000 segments in this basis. With weights for lower
    orders, only the part of order r is diagonal. If the shortest segment has an extreme duration, the
    coefficients of order r have a unit for which its Hessian instead of 1 is a power of 4.
    """

    name = "legendre"
    summary = "integrated Legendre polynomials: the Hessian is a diagonal of zeros and ones"

    @cached_property
    def powers(self) -> Floats:
        """Coefficients of the basis functions in powers of s, with one column per function."""
        return legendre_basis(self.model.order, self.model.degree)

    @cached_property
    def unit(self) -> float:
        """Unit of the coefficients of order r, a power of 2.

        They grow like the shortest duration to the power 1/2 - r, and solvers with absolute tolerances fail
        if they are far larger or smaller than the waypoints.
        """
        power = float((self.model.order - 0.5) * np.log2(self.model.durations.min()))
        return 2.0 ** round(power) if abs(power) > BALANCED else 1.0

    @cached_property
    def scales(self) -> Floats:
        """Scales for which the nonzero diagonal entries of the Hessian are 1, or 1 / unit²."""
        model = self.model
        scales = np.ones((model.segments, model.degree + 1))
        size = self.unit * np.sqrt(2.0 * model.order_weights[-1])
        scales[:, model.order :] = (model.durations ** (model.order - 0.5) / size)[:, None]
        return scales

    def gram(self) -> Floats:
        """Return the blocks of the objective, with an exact identity for order r."""
        model = self.model
        total = super().gram()
        if np.count_nonzero(model.order_weights) == 1:
            total[:] = 0.0
            own = np.arange(model.order, model.degree + 1)
            total[:, own, own] = 0.5 / self.unit**2
        return total
