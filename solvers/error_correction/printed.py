"""The paper's algorithms: labelling (stage 1), pulse, the two-stage algorithm and the dynamic program."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Option,
    Request,
    Termination,
)
from ..resource_routing.elementary import Found
from ..resource_routing.outcomes import FOUND, NOTHING, OPEN, STOPPED
from .native import RoutingBackend

if TYPE_CHECKING:
    from .airspace import Airspace

__all__ = [
    "FACTORS",
    "DynamicProgramming",
    "Labelling",
    "Labels",
    "Pulse",
    "TwoStage",
    "label_with_factors",
]

#: Values of the paper's λ, tried in this order; the paper recommends the first one.
FACTORS = tuple(k / 20 for k in range(10, 21))
#: Option of stage 1.
OPTIONS: Mapping[str, Option] = {
    "threshold_factor": Option(
        None,
        "The paper's λ, from 0.5 to 1; without it, the first of 0.5, 0.55, …, 1 with a route.",
        float,
        lower=0.5,
        upper=1.0,
    )
}


@dataclass(frozen=True)
class Labels:
    """Result of stage 1: points from A to B and length (m), empty and inf without a route.

    `made` is the number of temporary labels written, over all factors, and `factor` the last one tried,
    which gave the route.
    """

    route: NDArray[np.int64]
    length: float
    made: int
    factor: float


def label_with_factors(space: Airspace, factor: float | None, request: Request) -> Labels:
    """Return the route of stage 1; without the paper's λ, `factor`, by the first of :data:`FACTORS` with a route."""
    from .printed_kernels import label_points

    route, length, made, last = np.empty(0, np.int64), np.inf, 0, 0.0
    for last in FACTORS if factor is None else (factor,):
        _, route, length, count = label_points(space, last, request.control.flag)
        made += count
        if route.size or request.control.stopped:
            break
    return Labels(route, length, made, last)


class Labelling(Backend):
    """Dijkstra's search by length with one label per point, section 3.1 of the paper.

    A correction point accepts a label only if the vertical error uses at most the share λ of its threshold.
    A shorter label replaces the label of a point even if its errors are larger, so routes may be missed.
    """

    name = "labelling"
    accepts = ErrorCorrectionRouting
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    options = OPTIONS
    summary = "the paper's stage 1: Dijkstra by length, one label per point; a heuristic"

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return which part of `problem` the labels do not cover."""
        return problem.additions and f"{problem.additions}: take resource-labelling"

    def run(self, problem: ErrorCorrectionRouting, request: Request) -> Answer:
        """Label the points and return the route to B."""
        from .airspace import airspace

        self.require_support(problem)
        begin = clock()
        labels = label_with_factors(airspace(problem), request.options["threshold_factor"], request)
        return Answer(
            Termination.FEASIBLE if labels.route.size else Termination.NO_SOLUTION,
            request.control.limit,
            Route(tuple(labels.route.tolist())) if labels.route.size else None,
            float(labels.length) if labels.route.size else None,
            seconds={"solve": clock() - begin},
            statistics={"labels made": labels.made, "threshold factor": labels.factor},
        )


class PrintedSearch(RoutingBackend):
    """Base of the paper's algorithms, which return the route that the printed algorithm finds.

    Their dominance check does not compare the points of the routes, so it may drop the only label that the
    shortest route extends. The result is therefore compared with the shortest walk, which may visit points
    twice and is a lower bound: equal lengths are a proof. Otherwise the answer is a feasible route and that
    bound. The comparison takes milliseconds and is not part of ``search_seconds`` in the statistics.
    """

    def refuses(self, problem: ErrorCorrectionRouting) -> str:
        """Return which part of `problem` the paper's algorithms do not cover."""
        if problem.revisits:
            return "revisits, which the paper excludes: take label-setting"
        return super().refuses(problem)

    def search(
        self, problem: ErrorCorrectionRouting, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the printed algorithm and compare its route with the shortest walk."""
        from .ceiling_kernels import climb

        result, own = self.find_as_printed(space, ceiling, request)
        if result.status not in (FOUND, NOTHING):
            return result, own
        least = min(ceiling, result.length) * (1 + 1e-12)
        walk = Found(*climb(space, least, request.control.flag))
        if walk.status == NOTHING:
            bound = min(walk.bound, result.length)
            return replace(result, bound=bound), own
        if walk.status == FOUND and walk.length >= result.length * (1 - 1e-12):
            return replace(result, bound=result.length), own
        status = OPEN if walk.status == FOUND else STOPPED
        return replace(result, status=status, bound=walk.bound), own

    @abstractmethod
    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Return the route of the printed algorithm, at most `ceiling` m long (inf as printed), and statistics."""


class Pulse(PrintedSearch):
    """Depth-first search with the paper's three checks: feasibility, dominance and bound.

    Section 3.2. The bound on the rest of a route is the straight line to B.
    """

    name = "pulse"
    summary = "the paper's pulse algorithm: depth first, straight line to B as bound"

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the pulse algorithm from A without a known route."""
        from .printed_kernels import send_pulses

        begin = clock()
        result = Found(*send_pulses(space, ceiling, request.control.flag))
        return result, {"search_seconds": clock() - begin}


class DynamicProgramming(PrintedSearch):
    """Label correcting with labels that carry their route, section 4.

    EFF keeps the labels of a point that no other label dominates in length and both errors. No bound on
    the length limits the search. As printed, a point enters the set E if it has any label, and the algorithm
    never ends; here a point enters E if its labels have changed.
    """

    name = "dynamic-programming"
    summary = "the paper's dynamic program: label correcting with routes in the labels"

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Correct labels until no label changes."""
        from .printed_kernels import correct_labels

        begin = clock()
        result = Found(*correct_labels(space, ceiling, request.control.flag))
        return result, {"search_seconds": clock() - begin}


class TwoStage(PrintedSearch):
    """Two-stage algorithm: ``labelling``, then ``pulse`` with the length of its route as bound."""

    name = "two-stage"
    options = OPTIONS
    summary = "the paper's algorithm: labelling for a bound, then pulses below it"

    def starter(self, problem: Any) -> str:
        """Return "", as the first stage is a heuristic."""
        return ""

    def find_as_printed(
        self, space: Airspace, ceiling: float, request: Request
    ) -> tuple[Found, Mapping[str, Any]]:
        """Run the two stages."""
        from .printed_kernels import send_pulses

        begin = clock()
        first = label_with_factors(space, request.options.get("threshold_factor"), request)
        between = clock()
        has_route = first.route.size > 0 and first.length <= ceiling
        bound = first.length if has_route else ceiling
        result = Found(*send_pulses(space, bound, request.control.flag))
        if has_route and not result.route.size:
            status = FOUND if result.status == NOTHING else result.status
            result = replace(result, status=status, route=first.route, length=first.length)
        statistics = {
            "stage1_seconds": between - begin,
            "stage2_seconds": clock() - between,
            "search_seconds": clock() - begin,
            "stage1 length": float(first.length) if first.route.size else "none",
            "stage1 labels": first.made,
            "threshold factor": first.factor,
        }
        return result, statistics
