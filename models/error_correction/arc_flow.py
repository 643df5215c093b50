"""Arc-flow program of an error-correction route, without big M and distance columns.

After a correction one error survives: the vertical one at a horizontal point, the horizontal one
at a vertical point. The program carries it along the arcs. The columns are x_a (arc a used) and e_a
(error on leaving the tail of a, 0 for unused arcs). For an arc a from i to j of length d_a:

* the head's thresholds bound the carried error, ``e_a <= (threshold of j - rate * d_a) x_a``, without
  big M. An arc with a negative bound is omitted;
* at a point, the carried error on leaving is at least the error on arrival. An arc between points of
  the same kind passes on ``e_a + rate * d_a``; an arc between different kinds renews the error,
  ``rate * d_a``;
* at most one arc leaves a point, and the same number arrives.

The length is ``sum d_a x_a``, so no l_j is needed. The optimal value equals the paper's: a route
satisfies the rows with its errors, and integral x decomposes into one route from A to B and separate
cycles. The objective includes the cycles; :meth:`ArcFlowFormulation.decode` drops them. Along the
route the carried errors are upper bounds of the true ones.

If corrections may fail, both errors survive. The program is then that of the model with resources,
with one binary per suspect point, see :mod:`crosstrack.models.resource_routing.arc_flow`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..formulation import Formulation
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from ..resource_routing.arc_flow import ResourceFlowFormulation
from ..resource_routing.routes import follow, refuse_revisits, require_positive, require_route
from .arcs import Arcs, least_errors, possible_arcs, shortest_length
from .model import HORIZONTAL, START, VERTICAL, ErrorCorrectionRouting, Route

__all__ = ["ArcFlowFormulation"]


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
    def _general(self) -> ResourceFlowFormulation | None:
        """Program with both errors on every arc, if corrections may fail; else None."""
        suspect = self.model.suspect
        if suspect is None or not suspect.any():
            return None
        return ResourceFlowFormulation(self.model.lower(), self.length_bound)

    @cached_property
    def arcs(self) -> Arcs:
        """Arcs with columns in the program."""
        return possible_arcs(self.model, np.inf if self.length_bound is None else self.length_bound)

    @cached_property
    def floor(self) -> float:
        """Length of the shortest path from A to B over the possible arcs, m."""
        if self._general is not None:
            return self._general.floor
        return shortest_length(self.model, self.arcs)

    @cached_property
    def _carrying(self) -> NDArray[np.int64]:
        """Indices of the arcs that carry an error: all except those leaving A."""
        return np.flatnonzero(self.model.codes[self.arcs.tail] != START)

    def build(self) -> MixedIntegerProgram:
        """Return the program of the module's docstring, or the general one for suspect points."""
        if self._general is not None:
            return self._general.build()
        model, arcs, carrying = self.model, self.arcs, self._carrying
        n = len(model.points)
        limit = model.rounded_limits[model.codes]
        rates = np.array([model.horizontal_rate, model.vertical_rate])
        # The axis of the error that survives at a point of each kind.
        axis = np.where(model.codes == HORIZONTAL, 1, 0)
        index = np.column_stack([arcs.tail, arcs.head])
        corrections = np.flatnonzero((model.codes == HORIZONTAL) | (model.codes == VERTICAL))
        place = np.full(n, -1)
        place[corrections] = np.arange(len(corrections))

        b = ProgramBuilder()
        x = b.columns(
            "arc used",
            len(arcs),
            upper=1,
            cost=arcs.length,
            integral=True,
            template="arc {0}-{1}",
            index=index,
        )
        tail_axis = axis[arcs.tail[carrying]]
        room = limit[arcs.head[carrying], tail_axis] - rates[tail_axis] * arcs.length[carrying]
        e = b.columns(
            "error carried",
            len(carrying),
            upper=np.maximum(room, 0.0),
            template="on arc {0}-{1}",
            index=index[carrying],
            unit="error",
        )
        if model.corrections_limit is not None:
            most = model.corrections_limit + 1.0
            b.rows("corrections at most", 1, (0, x, 1.0), upper=most, unit="arcs")
        out, into = arcs.tail == model.start, arcs.head == model.end
        b.rows("one arc out of A", 1, (0, x[out], 1.0), lower=1, upper=1, equation="2")
        b.rows("one arc into B", 1, (0, x[into], 1.0), lower=1, upper=1, equation="3")
        heads, tails = place[arcs.head] >= 0, place[arcs.tail] >= 0
        b.rows(
            "arcs in and out",
            len(corrections),
            (place[arcs.head[heads]], x[heads], 1.0),
            (place[arcs.tail[tails]], x[tails], -1.0),
            lower=0,
            upper=0,
            equation="4-5",
            template="at point {0}",
            index=corrections,
        )
        b.rows(
            "visited at most once",
            len(corrections),
            (place[arcs.tail[tails]], x[tails], 1.0),
            upper=1,
            equation="4-5",
            template="at point {0}",
            index=corrections,
        )
        entry = np.arange(len(carrying))
        b.rows(
            "threshold at the head",
            len(carrying),
            (entry, e, 1.0),
            (entry, x[carrying], -room),
            upper=0,
            equation="9-18",
            template="along arc {0}-{1}",
            index=index[carrying],
            unit="error",
        )
        least = least_errors(model, arcs)[arcs.tail[carrying]]
        b.rows(
            "error gained at least",
            len(carrying),
            (entry, e, 1.0),
            (entry, x[carrying], -least),
            lower=0,
            equation="7-8",
            template="along arc {0}-{1}",
            index=index[carrying],
            unit="error",
        )
        same = model.codes[arcs.tail[carrying]] == model.codes[arcs.head[carrying]]
        gain = rates[axis[arcs.head[heads]]] * arcs.length[heads]
        b.rows(
            "error kept",
            len(corrections),
            (place[arcs.tail[carrying]], e, 1.0),
            (place[arcs.head[carrying[same]]], e[same], -1.0),
            (place[arcs.head[heads]], x[heads], -gain),
            lower=0,
            equation="7-8, 11-16",
            template="at point {0}",
            index=corrections,
            unit="error",
        )
        return b.build(name=f"{model.name}:arc-flow" if model.name else "arc-flow")

    def encode(self, plan: Route) -> NDArray[np.float64]:
        """Return the columns of a simple route; raise for an excluded arc."""
        if self._general is not None:
            return self._general.encode(plan)
        route = require_route(self.model, plan)
        n, arcs, carrying = len(self.model.points), self.arcs, self._carrying
        key = arcs.tail * n + arcs.head
        point = np.zeros(len(arcs) + len(carrying))
        stops = self.model.walk(plan)
        for before, i, j in zip(stops, route, route[1:], strict=False):
            arc = int(np.searchsorted(key, i * n + j))
            if arc == len(key) or key[arc] != i * n + j:
                raise InvalidData(
                    f"arc {i}-{j} of the route is excluded by thresholds or length_bound",
                    field="route",
                )
            point[arc] = 1.0
            if before.kind != "A":
                left = (
                    before.vertical_after
                    if before.kind == "horizontal"
                    else before.horizontal_after
                )
                point[len(arcs) + int(np.searchsorted(carrying, arc))] = left
        return point

    def decode(self, point: NDArray[np.float64]) -> Route:
        """Return the route formed by the used arcs; separate cycles are dropped."""
        if self._general is not None:
            return self._general.decode(point)
        arcs = self.arcs
        if point.size != len(arcs) + len(self._carrying):
            raise InvalidData(
                f"point must have {len(arcs) + len(self._carrying)} entries, got {point.size}",
                field="point",
            )
        used = point[: len(arcs)] > 0.5
        return follow(self.model, arcs.tail[used], arcs.head[used])
