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
        before = self._kept.closure.copy()
        between = before.astype(float) @ before > 0
        free = ~(np.eye(len(before), dtype=bool) | before.T | between)
        free[0, before.any(axis=0)] = False
        free[before.any(axis=1), 0] = False
        tails, heads = np.nonzero(free)
        return tails, heads

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the docstring of this module."""
        kept, b = self._kept, ProgramBuilder()
        labels = np.array(self._numbers)
        gaps, size = self._gaps, kept.size
        tails, heads = self._arcs
        ways = np.concatenate([[0.0], np.cumsum(gaps.lengths)])[gaps.at]
        x = b.columns(
            "served next", tails.size, upper=1, integral=True,
            cost=np.abs(ways[heads] - ways[tails]), template="{1} after {0}",
            index=labels[np.column_stack([tails, heads])],
        )  # fmt: skip
        first, second = np.triu_indices(size - 1, 1)
        first, second = first + 1, second + 1
        pairs = labels[np.column_stack([first, second])]
        y = b.columns(
            "served before", first.size, lower=kept.closure[first, second].astype(float),
            upper=1.0 - kept.closure[second, first], integral=True, template="{0} before {1}",
            index=pairs,
        )  # fmt: skip
        for name, ends in (("left once", tails), ("reached once", heads)):
            b.rows(name, size, (ends, x, 1.0), lower=1, upper=1, template="{0}", index=labels)
        # Order of any two customers as a column, a sign and a constant.
        column = np.zeros((size, size), np.int64)
        sign, constant = np.ones((size, size)), np.zeros((size, size))
        column[first, second] = column[second, first] = y
        sign[second, first], constant[second, first] = -1.0, 1.0
        inner = np.flatnonzero((tails > 0) & (heads > 0))
        i, j = tails[inner], heads[inner]
        rows = np.arange(inner.size)
        b.rows(
            "next is after", rows.size, (rows, x[inner], 1.0), (rows, column[i, j], -sign[i, j]),
            upper=constant[i, j], template="{1} after {0}", index=labels[np.column_stack([i, j])],
        )  # fmt: skip
        arc = np.full((size, size), -1)
        arc[tails, heads] = x
        i, j, k = (part.ravel() + 1 for part in np.indices((size - 1,) * 3))
        may = ~kept.closure.T
        count = (arc[j, i] >= 0).astype(int) + may[i, j] + may[j, k] + may[k, i]
        i, j, k = np.stack([i, j, k])[:, (i != j) & (j != k) & (k != i) & (count > 2)]
        rows = np.arange(i.size)
        back = arc[j, i] >= 0
        orders = [(i, j), (j, k), (k, i)]
        b.rows(
            "no circle of three", i.size, (rows[back], arc[j, i][back], 1.0),
            *((rows, column[at], sign[at]) for at in orders),
            upper=2.0 - sum(constant[at] for at in orders), template="{0}, {1} and {2}",
            index=labels[np.column_stack([i, j, k])],
        )  # fmt: skip
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
        order = self._order(plan)
        size = self._kept.size
        after = np.zeros((size, size))
        after[[0, *order], [*order, 0]] = 1.0
        place = np.empty(size)
        place[order] = np.arange(size - 1)
        first, second = np.triu_indices(size - 1, 1)
        return np.concatenate([after[self._arcs], place[first + 1] < place[second + 1]])

    def decode(self, point: Floats) -> GuidedPathPlan:
        """Return the service order along the arcs; available customers are served on the way."""
        values = Array((self.program.size,)).coerce("point", point, {})
        tails, heads = (ends[values[: ends.size] > 0.5] for ends in self._arcs)
        follows = dict(zip(tails.tolist(), heads.tolist(), strict=True))
        numbers, stops, customer = self._numbers, list[int](), 0
        for _ in numbers:
            customer = follows.get(customer, 0)
            if not customer:
                break
            stops.append(numbers[customer])
        return GuidedPathPlan(served(self.model, stops))
