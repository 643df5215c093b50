"""Sequential ordering problem: shortest path through all nodes with precedence constraints.

Source: L. F. Escudero, "An inexact algorithm for the sequential ordering problem", European Journal of Operational
Research 37, 1988; the files of G. Reinelt, "TSPLIB: a traveling salesman problem library", ORSA Journal on
Computing 3, 1991.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, declared
from ..guided_path.orders import usable_arcs
from ..guided_path.relation import closure_of, listed_pairs, sorted_customers
from ..inputs import Field, FloatArray, Names, Numbers
from ..labels import Ids
from ..model import Model
from ..verification import TOLERANCE, Verification
from .checks import verify_ordering
from .plan import SequentialOrderingPlan

__all__ = ["MOST", "SequentialOrdering"]

#: Maximum number of nodes: the distances and the relation are dense matrices.
MOST = 3000


@dataclass(frozen=True, eq=False, repr=False)
class SequentialOrdering(Model[SequentialOrderingPlan]):
    r"""Shortest path from the first node through all others to the last node, with precedence.

    With the distances :math:`d_{ij}`, minimise :math:`\sum_k d_{\pi_k \pi_{k+1}}` over the orders :math:`\pi` of
    the nodes 0 … n - 1 that begin with 0, end with n - 1 and satisfy every precedence pair. The asymmetric
    travelling salesman problem is the special case without pairs.

    Parameters
    ----------
    distances : ndarray, shape (n, n)
        Distance from i to j, at least 0, in any unit. inf (null in JSON) if j cannot follow i directly. The
        diagonal is not used.
    precedence : ndarray of int, shape (p, 2)
        Pairs (i, j): i must precede j, not necessarily directly. The relation must be acyclic.
    ids : sequence of int or str, optional
        Names of the nodes.

    Raises
    ------
    InvalidData
        Fewer than 2 or more than 3000 nodes, a matrix that is not square, a negative distance or NaN, an unknown
        node, a pair that contradicts the first or the last node, or a cycle. The message contains field, place
        and value.

    Examples
    --------
    >>> from crosstrack.models import SequentialOrdering
    >>> model = SequentialOrdering(
    ...     [[0, 3, 1, 9], [9, 0, 2, 5], [9, 4, 0, 1], [9, 9, 9, 0]], precedence=[[1, 2]]
    ... )
    >>> print(model.describe())
    4 nodes, 1 pair
    >>> print(model.verify(model.as_plan({"order": [0, 1, 2, 3]})).objective)
    6.0
    """

    kind: ClassVar[str] = "sequential-ordering"
    objective_unit: ClassVar[str] = ""
    plan_type: ClassVar[type] = SequentialOrderingPlan
    formulations: ClassVar[dict[str, Any]] = {
        "orders": ".models.sequential_ordering.orders:OrdersFormulation",
    }
    default_formulation: ClassVar[str] = "orders"

    distances: FloatArray = declared(Array(("n", "n"), lower=0.0, infinity=1))
    precedence: Field[Numbers, NDArray[np.int64]] = declared(
        Array(("pairs", 2), int, lower=0), default=()
    )
    ids: Names = declared(Optional(Ids()), default=None)

    def check(self) -> None:
        """Validate the numbers of the nodes, and reject pairs that no order satisfies."""
        size, last = self.size, self.size - 1
        if not 2 <= size <= MOST:
            raise InvalidData(
                f"distances must be those of 2 … {MOST} nodes, got {size}", field="distances"
            )
        # Dual values are at most twice the sum over a path of missing arcs.
        if not np.isfinite(4.0 * self.missing * size):
            raise InvalidData("distances must be small enough to be added up", field="distances")
        for row, column in np.argwhere(self.precedence > last)[:1]:
            raise InvalidData(
                f"precedence[{row}, {column}] must be in 0 … {last}, got {self.precedence[row, column]}",
                field="precedence",
            )
        for column, node, words in (
            (1, 0, "the first node 0 no predecessor"),
            (0, last, f"the last node {last} no successor"),
        ):
            for row in np.flatnonzero(self.precedence[:, column] == node)[:1]:
                before, after = self.precedence[row]
                raise InvalidData(
                    f"precedence[{row}] must give {words}, got {before} before {after}",
                    field="precedence",
                )
        # Computed here because it rejects cycles.
        _ = self.sorted_nodes

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.distances)

    def label(self, node: int) -> str:
        """Return the name of `node`: its id, or its number if the model has no ids."""
        return str(node if self.ids is None else self.ids[node])

    @cached_property
    def missing(self) -> float:
        """Length that is longer than every path, a substitute for missing arcs in computations."""
        longest = self.distances.max(initial=0.0, where=np.isfinite(self.distances))
        return float(longest * (self.size + 1)) or 1.0

    @cached_property
    def _inner(self) -> NDArray[np.int64]:
        """Distinct pairs between inner nodes, sorted, shape (k, 2)."""
        inner = (self.precedence[:, 0] > 0) & (self.precedence[:, 1] < self.size - 1)
        pairs: NDArray[np.int64] = np.unique(self.precedence[inner], axis=0)
        return pairs

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Distinct pairs between inner nodes, sorted."""
        return tuple(map(tuple, self._inner.tolist()))

    @cached_property
    def sorted_nodes(self) -> tuple[int, ...]:
        """Nodes in a topological order of the relation, from the first to the last node."""
        before, after = (
            listed_pairs(self.size - 1, links) for links in (self._inner[:, ::-1], self._inner)
        )
        return (0, *sorted_customers(before, after), self.size - 1)

    @cached_property
    def closure(self) -> NDArray[np.bool_]:
        """Transitive closure: True if i must precede j, with the first and the last node, shape (n, n)."""
        closure = np.zeros((self.size, self.size), bool)
        closure[:-1, :-1] = closure_of(
            listed_pairs(self.size - 1, self._inner), self.sorted_nodes[1:-1]
        )
        closure[0, 1:] = closure[:-1, -1] = True
        closure.flags.writeable = False
        return closure

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """Pairs between inner nodes that no other pairs imply, shape (k, 2), sorted."""
        inner = self.closure[:-1, :-1].copy()
        inner[0] = False
        return np.argwhere(inner & usable_arcs(inner))

    @cached_property
    def arcs(self) -> NDArray[np.bool_]:
        """Whether a feasible order may contain j directly after i, as far as pairs and distances show."""
        arcs = usable_arcs(self.closure) & np.isfinite(self.distances)
        arcs.flags.writeable = False
        return arcs

    @np.errstate(all="ignore")  # overflow yields inf or NaN, which is a violation
    def verify(self, plan: SequentialOrderingPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the length of the path and the violation of every constraint.

        Parameters
        ----------
        plan : SequentialOrderingPlan
            The plan.
        tolerance : float
            Largest relative violation accepted. All checks count, so it has no effect.

        Returns
        -------
        Verification
            Objective and checks.
        """
        return verify_ordering(self.distances, self.precedence, self.label, plan, tolerance)

    def describe(self) -> str:
        """Return a short description of the size."""
        words = [f"{self.size} nodes"]
        if self.pairs:
            words.append(f"{len(self.pairs)} pair{'s' if len(self.pairs) > 1 else ''}")
        return ", ".join(words)
