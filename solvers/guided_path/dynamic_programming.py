"""``dynamic-programming``: the paper's Algorithm 3, over the customers served per chain.

Source: "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints",
Mathematical Problems in Engineering 2016, article 5040513: f*(t, S) is the length of the shortest
path from the start through the customers of S that ends at the last one of chain t. With k chains
of l_1, …, l_k customers the table has k · Π (l_i + 1) entries, each the minimum of at most k sums.

A general relation is covered by the fewest chains, and each entry checks the pairs between chains.
Property 1 of the paper, and its generalisation (:func:`.walks.reduced`), is applied first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import OutOfTime, clock
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..contract.backend import Answer, Feature, Guarantee, Limit, Option, Request, Termination
from .bound import SAFE, Tables, needs_of
from .insertion import LineBackend

__all__ = ["MOST_ENTRIES", "DynamicProgramming", "Table"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Maximum number of entries of the table, 0.8 GB: nine chains of five customers have 91 million.
MOST_ENTRIES = 100_000_000
#: Number of entries above which a run with a time limit starts with the paper's Algorithm 6 and a
#: bound:
#: a compiled loop fills 10 million of them per second.
LARGE = 100_000


@dataclass(frozen=True, eq=False)
class Table:
    """Table of the shortest lengths f*(t, S) of a tour whose customers are in chains.

    Parameters
    ----------
    chains : tuple of tuples of int
        Customers of each chain.
    start : float
        Coordinate of the start, in m.
    places : ndarray, shape (n,)
        Coordinates of the customers, chain after chain, in m.
    need : ndarray of int, shape (n, k)
        Number of customers of each chain that must be served before each customer.
    """

    chains: tuple[Sequence[int], ...]
    start: float
    places: Floats
    need: Ints

    @classmethod
    def of(cls, model: GuidedPathData) -> Table:
        """Return the table of all customers, in the minimum chain cover."""
        members = [c for chain in model.cover for c in chain]
        need = needs_of(model, model.cover, plain=True).astype(np.int64)
        return cls(model.cover, float(model.coordinates[0]), model.coordinates[members], need)

    @property
    def states(self) -> int:
        """Number of states S."""
        return math.prod(len(chain) + 1 for chain in self.chains)

    @property
    def strides(self) -> Ints:
        """Increment of a state's number per customer of each chain, shape (k,)."""
        return np.cumprod([1, *(len(chain) + 1 for chain in self.chains[:-1])])

    @property
    def starts(self) -> Ints:
        """Index of the first customer of each chain, and n, shape (k + 1,)."""
        return np.cumsum([0, *map(len, self.chains)])

    def filled(self, flag: NDArray[np.int8]) -> Floats | None:
        """Return all entries, shape (states, k), with inf for infeasible ones; None if stopped."""
        from .table_kernels import fill_table

        values = np.empty((self.states, len(self.chains)))
        done = fill_table(
            self.start, self.places, self.starts, self.strides, self.need, values, flag
        )
        return values if done else None

    def best(self, values: Floats) -> tuple[int, ...]:
        """Return the order of a shortest tour, given the entries."""
        from .table_kernels import trace_table

        order = np.empty(len(self.places), np.int64)
        trace_table(self.start, self.places, self.starts, self.strides, values, order)
        members = [c for chain in self.chains for c in chain]
        return tuple(members[k] for k in order.tolist())


class DynamicProgramming(LineBackend):
    """Exact dynamic program: Algorithm 3 of the paper."""

    name = "dynamic-programming"
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    summary = "the paper's Algorithm 3, over how far each chain has been served"
    options = {
        "passing": Option(
            True,
            "leave out every customer that any tour passes in time, rather than only what Property 1 does",
            bool,
        ),
    }

    def refuses(self, problem: Any) -> str:
        """Return optional fields that the table does not cover, or the reason if it would be too large."""
        if reason := super().refuses(problem):
            return reason
        small, _ = reduced(problem)
        return _too_large(small.cover)

    def starter(self, problem: Any) -> str:
        """Return the paper's Algorithm 6 for tables that take long to fill."""
        if name_unsupported(problem):
            return ""
        small, _ = reduced(problem)
        return "insert-nearest" if _entries(small.cover) > LARGE else ""

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Fill the table, and trace the shortest tour."""
        begin = clock()
        self.require_support(problem)
        flag = request.control.flag
        small, numbers = reduced(problem, passing=request.options["passing"])
        if reason := _too_large(small.cover):  # without `passing` it is larger
            raise UnsupportedFormulation(f"backend {self.name!r}: {reason}")
        table = Table.of(small)
        bound: float | None = None
        if request.time_limit is not None and table.states * len(table.chains) > LARGE:
            with suppress(OutOfTime):
                tables = Tables.of(small, flag)
                bound = tables.root() * tables.unit * (1.0 - SAFE)
                request.control.prove(bound)
        values = table.filled(flag)
        statistics = {
            "customers left out": problem.size - small.size,
            "states": table.states,
            "table entries": table.states * len(table.chains),
        }
        if values is not None:
            order = served(problem, [numbers[c] for c in table.best(values)])
        else:  # any feasible order
            order = served(problem, problem.sorted_customers)
        length = length_of(problem, order)
        return Answer(
            Termination.FEASIBLE if values is None else Termination.OPTIMAL,
            (request.control.reason or Limit.INTERRUPTED) if values is None else None,
            GuidedPathPlan(order),
            length,
            bound if values is None else length,
            seconds={"solve": clock() - begin},
            statistics=statistics,
        )


def _entries(chains: Sequence[Sequence[int]]) -> int:
    return len(chains) * math.prod(len(chain) + 1 for chain in chains)


def _too_large(chains: Sequence[Sequence[int]]) -> str:
    entries = _entries(chains)
    if entries <= MOST_ENTRIES:
        return ""
    return (
        f"its table may have {MOST_ENTRIES:,} entries, and would have {float(min(entries, 10**300)):.3g} for "
        f"{len(chains)} chains that matter"
    )
