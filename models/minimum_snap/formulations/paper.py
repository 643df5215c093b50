"""Quadratic program as printed in the paper: powers of absolute time, continuity C²."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ....errors import UnsupportedFormulation
from .piecewise import PiecewiseFormulation, power_rows

__all__ = ["PaperFormulation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PaperFormulation(PiecewiseFormulation):
    """Program of eq. 5-13 and 23-25 as printed, which demonstrates its numerical failure.

    The basis is powers of absolute time, so the last segments multiply t^7 by coefficients that
    cancel. The condition number of the optimality system grows by orders of magnitude with every
    segment. Continuity and the fixed values at the ends include position, velocity and acceleration
    only. For the problem of the paper, pass ``continuity=2`` and two rows of `start` and `end`. If
    the model requires more, this program is a relaxation: its plan is verified against the model,
    and rejected if its jerk jumps.
    """

    name = "paper"
    summary = "the paper's: powers of absolute time, continuous to the acceleration; breaks down"
    #: The paper keeps position, velocity and acceleration continuous (eq. 25).
    PAPER_CONTINUITY: ClassVar[int] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        model = self.model
        if model.periodic:
            raise UnsupportedFormulation("the paper's program has no periodic paths")
        if model.bounded:
            what = ", ".join(b.name for b in model.bounds) or "polytopes"
            raise UnsupportedFormulation(f"the paper's program does not support {what}")
        if model.conditions.shape[1] > 1 and np.isfinite(model.conditions[1:-1, 1:]).any():
            raise UnsupportedFormulation("the paper's program fixes no derivative at inner knots")

    @property
    def continuity(self) -> int:
        """Highest order of a derivative that eq. 25 keeps continuous."""
        return min(self.PAPER_CONTINUITY, self.model.continuity)

    @property
    def highest_fixed(self) -> int:
        """Highest order of a derivative that eq. 23 fixes."""
        return min(self.PAPER_CONTINUITY, self.model.highest_fixed)

    def basis_rows(self, segments: Ints, s: Floats, derivative: int) -> Floats:
        """Return the derivatives of 1, t, t², … at absolute times (eq. 6)."""
        t = np.where(s == 1.0, self.model.times[segments + 1], self.model.times[segments])
        return power_rows(t, derivative, self.model.degree)

    def gram(self) -> Floats:
        """Return the blocks Q of eq. 11: differences of powers of absolute times."""
        model = self.model
        count = model.degree + 1
        total = np.zeros((model.segments, count, count))
        for order, weight in enumerate(model.order_weights, start=1):
            if not weight:
                continue
            for i in range(order, count):
                for j in range(order, count):
                    power = i + j - 2 * order + 1
                    factor = math.perm(i, order) * math.perm(j, order) / power
                    share = model.times[1:] ** power - model.times[:-1] ** power
                    total[:, i, j] += weight * factor * share
        return total

    def to_powers(self, local: Floats) -> Floats:
        """Convert powers of absolute time to powers of s by expansion about the segment's start."""
        model = self.model
        powers = np.zeros_like(local)
        for order in range(model.degree + 1):
            rows = power_rows(model.times[:-1], order, model.degree)
            scale = model.durations**order / math.factorial(order)
            powers[:, :, order] = np.einsum("kp,kdp->kd", rows, local) * scale[:, None]
        return powers

    def from_powers(self, powers: Floats) -> Floats:
        """Convert powers of s to powers of absolute time."""
        model = self.model
        local = np.zeros_like(powers)
        start, long = model.times[:-1, None], model.durations[:, None]
        for power in range(model.degree + 1):
            # ((t - t_k) / T_k)^power, by the binomial theorem.
            for j in range(power + 1):
                factor = math.comb(power, j) * (-start) ** (power - j) / long**power
                local[:, :, j] += factor * powers[:, :, power]
        return local
