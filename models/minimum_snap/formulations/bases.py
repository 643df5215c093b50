"""The monomial and the Legendre basis, each in a segment's own time."""

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

#: Share of the sum of the terms' sizes below which a value of a basis function is 0.
NOUGHT = 16 * float(np.finfo(float).eps)


@cache
def legendre_basis(order: int, degree: int) -> Floats:
    """Return the powers of the basis functions, a column each, shape (degree + 1, degree + 1).

    1, s, …, s^(order-1), then the order-fold integrals from 0 of the Legendre polynomials that are
    orthonormal on [0, 1]. Those of a Legendre degree from `order` vanish, with their derivatives
    below `order`, at both ends.
    """
    basis = np.zeros((degree + 1, degree + 1))
    basis[np.arange(order), np.arange(order)] = 1.0
    for number in range(degree + 1 - order):
        shifted = np.polynomial.legendre.Legendre.basis(number, domain=[0.0, 1.0])
        # The coefficients are whole numbers; the norm comes last, so that nothing is rounded twice.
        whole = np.round(shifted.convert(kind=np.polynomial.Polynomial).coef)
        integral = np.asarray(np.polynomial.polynomial.polyint(whole, order), float)
        integral *= np.sqrt(2 * number + 1.0)
        basis[: integral.size, order + number] = integral
    return basis


def unit_gram(basis: Floats, order: int) -> Floats:
    """Return ∫ φ_m^(order) φ_n^(order) ds over [0, 1] by an exact quadrature."""
    degree = basis.shape[0] - 1
    nodes, weights = gauss_legendre(degree + 1)
    rows = power_rows(nodes, order, degree) @ basis
    gram: Floats = (rows * weights[:, None]).T @ rows
    return gram


@dataclass(frozen=True, eq=False)
class UnitBasisFormulation(PiecewiseFormulation):
    """Base of the bases in s = (t - t_k) / T_k, the same on every segment up to column scales."""

    @cached_property
    def powers(self) -> Floats:
        """Powers of the basis functions, a column each."""
        return np.eye(self.model.degree + 1)

    @cached_property
    def scales(self) -> Floats:
        """What multiplies each column, shape (segments, degree + 1)."""
        return np.ones((self.model.segments, self.model.degree + 1))

    def basis_rows(self, segments: Ints, s: Floats, derivative: int) -> Floats:
        """Return the derivatives in time, one row an instant."""
        powers = power_rows(s, derivative, self.model.degree)
        unit = powers @ self.powers
        # What rounding left of a 0 would be an entry on which no proof by multipliers cancels.
        unit[np.abs(unit) <= NOUGHT * (np.abs(powers) @ np.abs(self.powers))] = 0.0
        long = self.model.durations[segments] ** -float(derivative)
        rows: Floats = unit * self.scales[segments] * long[:, None]
        return rows

    def gram(self) -> Floats:
        """Return the blocks of the objective."""
        model = self.model
        total = np.zeros((model.segments, model.degree + 1, model.degree + 1))
        for order, weight in enumerate(model.order_weights, start=1):
            if weight:
                unit = unit_gram(self.powers, order)
                total += (weight * model.durations ** (1.0 - 2 * order))[:, None, None] * unit
        return total * self.scales[:, :, None] * self.scales[:, None, :]

    @np.errstate(over="ignore", invalid="ignore")  # a trajectory refuses what is beyond floats
    def to_powers(self, local: Floats) -> Floats:
        """Return the coefficients as powers of s."""
        return (local * self.scales[:, None, :]) @ self.powers.T

    def from_powers(self, powers: Floats) -> Floats:
        """Return powers of s in this basis."""
        local = np.linalg.solve(self.powers, np.moveaxis(powers, -1, -2))
        return np.moveaxis(local, -1, -2) / self.scales[:, None, :]


@dataclass(frozen=True, eq=False)
class MonomialFormulation(UnitBasisFormulation):
    """Powers of each segment's scaled time: the paper's program without its absolute time."""

    name = "monomial"
    summary = "powers of a segment's own time, scaled to [0, 1]"


@dataclass(frozen=True, eq=False)
class LegendreFormulation(UnitBasisFormulation):
    """1, s, …, s^(r-1) and r-fold integrals of Legendre polynomials: the Hessian is diag(0, 1).

    Interior-point solvers get corridors of 1000 segments right in it. With weights for lower orders, only the part of the order r is diagonal.
    """

    name = "legendre"
    summary = "integrated Legendre polynomials: the Hessian is a diagonal of zeros and ones"

    @cached_property
    def powers(self) -> Floats:
        """Powers of the basis functions, a column each."""
        return legendre_basis(self.model.order, self.model.degree)

    @cached_property
    def scales(self) -> Floats:
        """Scales that make the Hessian's nonzero diagonal 1."""
        model = self.model
        scales = np.ones((model.segments, model.degree + 1))
        weight = 2.0 * model.order_weights[-1]
        scales[:, model.order :] = (model.durations ** (model.order - 0.5) / np.sqrt(weight))[
            :, None
        ]
        return scales

    def gram(self) -> Floats:
        """Return the blocks of the objective, the identity written exactly."""
        model = self.model
        total = super().gram()
        if np.count_nonzero(model.order_weights) == 1:
            total[:] = 0.0
            own = np.arange(model.order, model.degree + 1)
            total[:, own, own] = 0.5
        return total
