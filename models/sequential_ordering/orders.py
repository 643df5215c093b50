r"""Mixed-integer program of sequential ordering: arcs, and the order of any two nodes.

The path is a closed tour of the nodes without the last one: :math:`x_{i0} = 1` if i is before the last node. The
rows are those of the guided path's ``arcs``, where their sources are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ..fields import Array
from ..formulation import Formulation
from ..guided_path.orders import columns_of_order, follow_arcs, order_program
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .model import SequentialOrdering
from .plan import SequentialOrderingPlan

__all__ = ["OrdersFormulation"]

#: Maximum number of nodes, for about 200 000 rows.
_MOST = 62


@dataclass(frozen=True, eq=False)
class OrdersFormulation(Formulation[SequentialOrdering, SequentialOrderingPlan]):
    """Mixed-integer program with arcs between nodes and pairwise orders, for few nodes.

    Parameters
    ----------
    model : SequentialOrdering
        Model with at most 62 nodes.

    Raises
    ------
    UnsupportedFormulation
        The model has more nodes.
    """

    name: ClassVar[str] = "orders"
    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    summary: ClassVar[str] = "arcs between nodes and the order of any two; for few nodes"

    def __post_init__(self) -> None:
        if self.model.size > _MOST:
            raise UnsupportedFormulation(
                f"formulation {self.name!r} takes at most {_MOST} nodes, got {self.model.size}: use a native "
                "backend"
            )

    @cached_property
    def _arcs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Tails and heads of the arcs, where arcs to the last node lead to node 0."""
        arcs = self.model.arcs[:-1].copy()
        arcs[:, 0] = arcs[:, -1]
        tails, heads = np.nonzero(arcs[:, :-1])
        return tails, heads

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the docstring of this module."""
        model, b, (tails, heads) = self.model, ProgramBuilder(), self._arcs
        closure = model.closure[:-1, :-1].copy()
        closure[0] = False
        cost = model.distances[tails, np.where(heads == 0, model.size - 1, heads)]
        order_program(b, np.arange(model.size - 1), closure, tails, heads, cost)
        return b.build(name=f"{model.name}:{self.name}" if model.name else self.name)

    def encode(self, plan: SequentialOrderingPlan) -> NDArray[np.float64]:
        """Return the columns of `plan`."""
        order, last = plan.order, self.model.size - 1
        if sorted(order) != list(range(last + 1)) or order[0] or order[-1] != last:
            raise InvalidData(
                f"order must contain the nodes 0 … {last} once, with 0 first and {last} last",
                field="order",
            )
        return columns_of_order(order[1:-1], last, *self._arcs)

    def decode(self, point: NDArray[np.float64]) -> SequentialOrderingPlan:
        """Return the order along the arcs."""
        values = Array((self.program.size,)).coerce("point", point, {})
        last = self.model.size - 1
        return SequentialOrderingPlan((0, *follow_arcs(values, *self._arcs, last), last))
