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
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..programs.builder import ProgramBuilder
from ..resource_routing.arc_flow import ResourceFlowFormulation
from ..resource_routing.model import ResourceRouting
from .model import ErrorCorrectionRouting

__all__ = ["ArcFlowFormulation"]


@dataclass(frozen=True, eq=False)
class ArcFlowFormulation(ResourceFlowFormulation):
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

    summary: ClassVar[str] = "possible arcs only, errors carried on arcs, no big M"

    @cached_property
    def _routing(self) -> ResourceRouting:
        """Equivalent route with resources, without the limit on corrections.

        One row is stronger than a resource with a level on each arc.
        """
        model: ErrorCorrectionRouting = self.model
        plain = model.corrections_limit is None
        return (model if plain else replace(model, corrections_limit=None)).lower()

    def _add_rows(self, b: ProgramBuilder, x: NDArray[np.int64]) -> None:
        limit = self.model.corrections_limit
        if limit is not None:
            b.rows("corrections at most", 1, (0, x, 1.0), upper=limit + 1.0, unit="arcs")
