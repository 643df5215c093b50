"""Mixed-integer program of a tour with arcs between customers, and the order of any two customers.

x_ij = 1 if j is served next after i, where 0 is the start. y_ij = 1 if i is served anywhere before
j. These orders enforce the relation and exclude subtours: the orders of any three customers are
acyclic, and consecutive customers have no customer between them. Arcs that violate the relation, or
that skip an intermediate customer, are omitted. Each gap between places is crossed at least as
often as a chain of the relation requires. Customers that every tour passes in time are omitted
(:mod:`.walks`).

Source: S. C. Sarin, H. D. Sherali, A. Bhootra, "New tighter polynomial length formulations for the
asymmetric traveling salesman problem with and without precedence constraints", Operations Research
Letters 33, 2005; without its arcs between pairs, E. Balas, M. Fischetti, W. R. Pulleyblank, "The
precedence-constrained asymmetric traveling salesman polytope", Mathematical Programming 68, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ..fields import Array
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .kept import KeptFormulation
from .orders import columns_of_order, follow_arcs, order_program, usable_arcs
from .plan import GuidedPathPlan
from .walks import served

__all__ = ["ArcsFormulation"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Maximum number of customers, for about 200 000 rows.
_MOST = 60


@dataclass(frozen=True, eq=False)
class ArcsFormulation(KeptFormulation):
    """Mixed-integer program with arcs between customers and pairwise orders, for few customers.

    Parameters
    ----------
    model : GuidedPathTour
        Model with at most 60 customers that affect the length.

    Raises
    ------
    UnsupportedFormulation
        The model has more such customers.
    """

    name: ClassVar[str] = "arcs"
    summary: ClassVar[str] = "arcs between customers and the order of any two; for few customers"

    def __post_init__(self) -> None:
        if self._kept.size - 1 > _MOST:
            raise UnsupportedFormulation(
                f"formulation {self.name!r} takes at most {_MOST} customers that affect the "
                f"length, got {self._kept.size - 1}: 'sweeps' takes more"
            )

    @cached_property
    def _arcs(self) -> tuple[Indices, Indices]:
        """Tails and heads of the arcs."""
        before = self._kept.closure
        free = usable_arcs(before)
        free[0, before.any(axis=0)] = False
        free[before.any(axis=1), 0] = False
        tails, heads = np.nonzero(free)
        return tails, heads

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the docstring of this module."""
        kept, b = self._kept, ProgramBuilder()
        gaps, (tails, heads) = self._gaps, self._arcs
        ways = np.concatenate([[0.0], np.cumsum(gaps.lengths)])[gaps.at]
        cost = np.abs(ways[heads] - ways[tails])
        x = order_program(b, np.array(self._numbers), kept.closure, tails, heads, cost)
        each = np.arange(gaps.lengths.size)
        crossed = (gaps.at[tails] <= each[:, None]) & (gaps.at[heads] > each[:, None])
        row, at = np.nonzero(crossed)
        b.rows(
            "gap crossed as often as a chain asks", each.size, (row, x[at], 1.0),
            lower=gaps.crossings, template="gap {0}", index=each,
        )  # fmt: skip
        return b.build(name=f"{self.model.name}:{self.name}" if self.model.name else self.name)

    def encode(self, plan: GuidedPathPlan) -> Floats:
        """Return the columns of the service order of `plan`, restricted to the relevant customers."""
        return columns_of_order(self._order(plan), self._kept.size, *self._arcs)

    def decode(self, point: Floats) -> GuidedPathPlan:
        """Return the service order along the arcs; available customers are served on the way."""
        values = Array((self.program.size,)).coerce("point", point, {})
        stops = follow_arcs(values, *self._arcs, self._kept.size)
        return GuidedPathPlan(served(self.model, [self._numbers[k] for k in stops]))
