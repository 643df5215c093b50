"""``track-search``: labels of partial tours for models with optional fields.

All labels with the same number of served customers form a layer. Of two labels with the same customers and
places, the one that is neither longer nor later is kept; the load follows from the customers. If a layer has
more labels than the width of the beam, those with the lowest bounds are kept. A sweep over all layers that
drops no label proves its tour optimal, or that no tour exists. Otherwise the lowest bound of the dropped labels
is a lower bound, and the next sweep is wider. The properties of the plain problem are not used: with loads,
windows or a free end, serving a customer later may be better than serving it when passing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from .track_labels import Labels, finish, first_label, grow, rest_of, without_dominated
from .track_tables import TrackTables, chains_of

__all__ = ["TrackSearch"]

#: Maximum number of customers and vehicles: distances are a dense matrix.
MOST = 3000
#: Width of the first beam, growth factor, and default of the maximum width.
NARROW, WIDER, WIDEST = 2, 8, 1 << 18
#: Largest size of all extensions of a layer in bytes; limits the width.
MEMORY = 200_000_000
#: Number of shortest labels per label of the width for which bounds are computed.
BOUNDED = 16
#: Relative safety margin of a bound if lengths are rounded.
SAFE = 1e-12


class TrackSearch(Backend):
    """Exact dynamic program over labels while it fits, otherwise a beam with the same labels and a bound."""

    name = "track-search"
    accepts = GuidedPathTour
    guarantee = Guarantee.EXACT
    features = frozenset(
        {
            Feature.GAP, Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT,
            Feature.WARM_START,
        }
    )  # fmt: skip
    deterministic = True
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "width": Option(
            WIDEST,
            "largest number of labels with the same number of customers, at most as many as 200 MB hold. Beyond "
            "it, the search is a heuristic with a proven bound.",
            int,
            lower=1,
        )
    }
    summary = (
        "labels over chains for loads, windows, free ends, loops, trees and several vehicles; ours"
    )

    def refuses(self, problem: Any) -> str:
        """Return the reason if the tables would be too large, otherwise an empty string."""
        extra = 0 if problem.vehicles is None else len(problem.vehicles)
        more = f" and {extra} vehicles" if extra else ""
        if problem.size - 1 + extra > MOST:
            return f"{problem.size - 1} customers{more}: at most {MOST}"
        if extra > 1:
            chains = len(chains_of(problem))
            if NARROW * _extension_size(problem, chains, extra) > MEMORY:
                return (
                    f"{chains} chains{more}: the extensions of {NARROW} labels exceed "
                    f"{MEMORY // 1_000_000} MB"
                )
        return ""

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Run wider and wider beams until one is exact or a limit is reached."""
        begin = clock()
        self.require_support(problem)
        search = _Search(TrackTables(problem), request)
        order = problem.sorted_customers
        simple = GuidedPathPlan(order, () if problem.vehicles is None else (0,) * len(order))
        for plan in (simple, request.warm_start):
            if plan is not None and (checked := problem.verify(plan)).ok:
                search.offer(checked.objective, plan)
        width, widest = NARROW, min(request.options.get("width", WIDEST), search.widest)
        while not search.over:
            search.sweep(min(width, widest))
            if width >= widest:
                break
            width *= WIDER
        done = search.exact or search.is_close
        if search.plan is None:
            status = Termination.INFEASIBLE if search.exact else Termination.NO_SOLUTION
        else:
            status = Termination.OPTIMAL if done else Termination.FEASIBLE
        limit = None if done else request.limit or Limit.MEMORY
        has_plan = search.plan is not None
        return Answer(
            status,
            limit,
            search.plan,
            search.value if has_plan else None,
            min(search.bound, search.value) if has_plan or not search.exact else None,
            seconds={"solve": clock() - begin},
            statistics={"labels": search.labels, "beam width": min(width, widest)},
        )


def _extension_size(model: GuidedPathTour, chains: int, fleet: int) -> int:
    """Return the size of all extensions of a label in bytes."""
    times = fleet * (model.size + 1) if fleet > 1 and model.windows is not None else 1
    return chains * fleet * (4 * chains + 12 * fleet + 8 * times + 40)


class _Search:
    """State of one run: incumbent and bound."""

    def __init__(self, tables: TrackTables, request: Request) -> None:
        self.tables, self.request, self.control = tables, request, request.control
        self.plan: GuidedPathPlan | None = None
        self.value, self.exact, self.labels = math.inf, False, 0
        self.bound = float(rest_of(tables, first_label(tables))[0]) * (1.0 - SAFE)
        self.control.prove(self.bound)

    @property
    def widest(self) -> int:
        """Largest width whose extensions fit the memory."""
        tables = self.tables
        return max(
            MEMORY // _extension_size(tables.model, len(tables.chains), tables.fleet), NARROW
        )

    @property
    def is_close(self) -> bool:
        """True if the incumbent is within the requested gap."""
        shut = self.value - self.bound <= self.request.gap * abs(self.value)
        return self.plan is not None and shut

    @property
    def over(self) -> bool:
        """True if the incumbent is proven or a limit is reached."""
        return self.exact or self.is_close or self.request.limit is not None

    def offer(self, value: float | None, plan: GuidedPathPlan) -> None:
        """Store `plan` if it is shorter than the incumbent."""
        if value is not None and value < self.value:
            self.value, self.plan = value, plan
            self.control.incumbent(value, plan)

    def sweep(self, width: int) -> None:
        """Extend labels layer by layer, and keep at most `width` of them per layer."""
        tables, labels = self.tables, first_label(self.tables)
        layers: list[tuple[Any, Any, Any]] = []
        dropped, total = math.inf, np.full(1, self.bound)
        for _ in range(tables.model.size - 1):
            if self.over:
                return
            labels = without_dominated(tables, grow(tables, labels))
            self.labels += len(labels.cost)
            if len(labels.cost) > BOUNDED * width:
                # The bound of a label is also one for its extensions.
                kept = np.zeros(len(labels.cost), bool)
                kept[np.argsort(labels.cost, kind="stable")[: BOUNDED * width]] = True
                dropped = min(dropped, float(total[labels.parent[~kept]].min()))
                labels = labels.take(kept)
            total = labels.cost + rest_of(tables, labels, lambda: self.over)
            if self.over:
                return
            useful = total < self.value * (1.0 - SAFE)
            if not useful.all():
                labels, total = labels.take(useful), total[useful]
            if len(total) > width:
                kept = self._select(labels, total, width)
                dropped = min(dropped, float(total[~kept].min()))
                labels = labels.take(kept)
            layers.append((labels.parent, labels.stop, labels.vehicle))
        lengths = finish(tables, labels)
        if len(lengths) and np.isfinite(lengths.min()):
            self._trace(int(lengths.argmin()), layers, float(lengths.min()))
        self.exact = dropped == math.inf
        self.bound = max(self.bound, min(dropped * (1.0 - SAFE), self.value))
        if self.exact:
            self.bound = self.value
        self.control.prove(self.bound if math.isfinite(self.bound) else None)

    def _select(self, labels: Labels, total: Any, width: int) -> Any:
        """Return the mask of the labels with the lowest bounds; half of them the earliest, with windows."""
        kept = np.zeros(len(total), bool)
        timed = self.tables.model.windows is not None and labels.ready.ndim == 1
        kept[np.argsort(total, kind="stable")[: width - width // 2 * timed]] = True
        if timed:
            rest = np.flatnonzero(~kept)
            early = np.argsort(labels.ready[rest], kind="stable")[: width // 2]
            kept[rest[early]] = True
        return kept

    def _trace(self, row: int, layers: list[tuple[Any, Any, Any]], length: float) -> None:
        """Offer the tour that ends with label `row` of the last layer."""
        order, vehicles = [], []
        for parent, stop, vehicle in reversed(layers):
            order.append(int(stop[row]))
            vehicles.append(int(vehicle[row]))
            row = int(parent[row])
        several = self.tables.model.vehicles is not None
        plan = GuidedPathPlan(tuple(order[::-1]), tuple(vehicles[::-1]) if several else ())
        self.offer(length, plan)
