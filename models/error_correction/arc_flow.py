"""Arc-flow program of an error-correction route, without big M and distance columns.

After a correction one error survives: the vertical one at a horizontal point, the horizontal one
at a vertical point. The program of the model with resources carries it along the arcs, see
:mod:`crosstrack.models.resource_routing.arc_flow`: an arc out of a point that corrects an error has no column
for that error. The columns are x_a (arc a used) and u_a (error on leaving the tail of a, 0 for unused
arcs). For an arc a from i to j of length d_a:

* the head's thresholds bound the carried error, ``u_a <= (threshold of j - rate * d_a) x_a`` (9-18), without
  big M. An arc with a negative bound is omitted;
* at a point, the carried error on leaving is at least the error on arrival (7-8, 11-16);
* at most one arc leaves a point, and the same number arrives (2-5).

The length is ``sum d_a x_a``, so no l_j is needed. The optimal value equals the paper's: a route
satisfies the rows with its errors, and integral x decomposes into one route from A to B and separate
cycles. The objective includes the cycles; :meth:`ArcFlowFormulation.decode` drops them. Along the
route the carried errors are upper bounds of the true ones.

If corrections may fail, both errors survive, and each suspect point has a binary. A limit on corrections is one
row on the number of arcs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..formulation import Formulation
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from ..resource_routing.arc_flow import ResourceFlowFormulation
from ..resource_routing.routes import refuse_revisits, require_positive
from .model import ErrorCorrectionRouting, Route

__all__ = ["ArcFlowFormulation"]


@dataclass(frozen=True, eq=False)
class _Flow(ResourceFlowFormulation):
    """Program of the errors with a limit on the number of arcs."""

    most_arcs: float | None = None

    def _add_rows(self, b: ProgramBuilder, x: NDArray[np.int64]) -> None:
        if self.most_arcs is not None:
            b.rows("corrections at most", 1, (0, x, 1.0), upper=self.most_arcs, unit="arcs")


@dataclass(frozen=True, eq=False)
class ArcFlowFormulation(Formulation[ErrorCorrectionRouting, Route]):
    """Program of the arcs that the thresholds allow, with the surviving error carried on them.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model; ``revisits`` must be off.
    length_bound : float, optional
        Length of a verified route, m; arcs that only longer routes can use are omitted.

    Raises
    ------
    UnsupportedFormulation
        The model allows revisits.
    UnsupportedOption
        `length_bound` is not a positive number.
    """

    length_bound: float | None = None

    name: ClassVar[str] = "arc-flow"
    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    summary: ClassVar[str] = "possible arcs only, errors carried on arcs, no big M"

    def __post_init__(self) -> None:
        refuse_revisits(self.model, self.name)
        require_positive(self.name, length_bound=self.length_bound)

    def bounded(self, objective: float) -> ArcFlowFormulation:
        """Return the formulation without arcs that only longer routes can use; `objective` in m."""
        return replace(self, length_bound=objective)

    @cached_property
    def _flow(self) -> _Flow:
        limit = self.model.corrections_limit
        # One row is stronger than a resource with a level on each arc.
        model = self.model if limit is None else replace(self.model, corrections_limit=None)
        return _Flow(model.lower(), self.length_bound, None if limit is None else limit + 1.0)

    @property
    def arcs(self) -> Any:
        """Arcs with columns in the program, see :class:`~..resource_routing.arcs.UsedArcs`."""
        return self._flow.arcs

    @property
    def floor(self) -> float:
        """Length of the shortest path from A to B over the possible arcs, m."""
        return self._flow.floor

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the module's docstring."""
        return self._flow.build()

    def encode(self, plan: Route) -> NDArray[np.float64]:
        """Return the columns of a simple route; raise for an excluded arc."""
        return self._flow.encode(plan)

    def decode(self, point: NDArray[np.float64]) -> Route:
        """Return the route formed by the used arcs; separate cycles are dropped."""
        return self._flow.decode(point)
