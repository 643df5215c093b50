"""``euclidean-bound`` and ``curvature-bound``: how short a tour can be at best, with a proof; ours."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import Primitive, TourPlan
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["CurvatureBound", "EuclideanBound"]


#: What is left of the gap by the tolerance to which paths are solved.
ROUNDING = 1e-8


class EuclideanBound(Backend):
    """The shortest tour without curvature, by branch and bound over the orders.

    Its length bounds every tour from below; what has been proven when a limit ends the search does
    so as well. With a turning radius of 0 the tour is a plan, and the best one.
    """

    name = "euclidean-bound"
    accepts = MessengerTour
    guarantee = Guarantee.RELAXATION
    features = frozenset({Feature.GAP, Feature.CUTOFF, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    requires = ("clarabel",)
    summary = "a proven lower bound: the best tour without the limit on curvature; ours"
    curved: ClassVar[bool] = False

    def run(self, problem: MessengerTour, request: Request) -> Answer:
        """Search over the orders, and say what is proven."""
        from .bound_search import OrderSearch

        begin = clock()
        control = request.control
        cutoff = float("inf") if request.cutoff is None else request.cutoff * (1 + 1e-9)
        search = OrderSearch(problem, cutoff, curved=self.curved)

        def rising(bound: float) -> None:
            control.bound = bound

        done = search.run(lambda: control.stopped, rising, request.gap)
        best, bound = search.best, search.bound
        if request.cutoff is not None:
            bound = min(bound, request.cutoff)
        statistics: dict[str, Any] = {
            "nodes made": search.made,
            "nodes expanded": search.expanded,
            "programs solved": search.chains.solved,
            "tours met": len(search.tours),
        }
        if best is not None:
            statistics["shortest tour without curvature"] = best.length
        plan, termination, message = None, Termination.NO_SOLUTION, ""
        if problem.turning_radius == 0 and best is not None and best.length <= cutoff:
            plan = straight(problem, best.order, best.points, best.times / problem.speed)
            proven = plan.length - bound <= max(request.gap, ROUNDING) * plan.length
            termination = Termination.OPTIMAL if proven else Termination.FEASIBLE
        elif bound == request.cutoff:
            message = "no plan better than the cutoff"
        elif done and not search.chains.curved:
            message = "the bound is that of the best tour without the limit on curvature"
        return Answer(
            termination,
            None if done else control.reason or Limit.INTERRUPTED,
            plan,
            None if plan is None else plan.length,
            bound,
            seconds={"solve": clock() - begin},
            statistics=statistics,
            message=message,
        )


class CurvatureBound(EuclideanBound):
    """The same search with what every tour turns at least, whatever its headings.

    How that is bounded is said in :mod:`.bound_kernels`. The bound of an order is never less than
    that without curvature, and equals the shortest tour's where legs are long, or the vehicles
    at rest are met at points that lie apart. It is weak where discs overlap, as their vehicles may be
    met at once, and where the UAV must turn by more than half a circle.
    """

    name = "curvature-bound"
    summary = "a proven lower bound that counts turns at their least: greater, and slower; ours"
    curved = True


def straight(model: MessengerTour, order: tuple[int, ...], points: Any, times: Any) -> TourPlan:
    """Return the plan of straight legs, for a UAV that turns on the spot.

    Parameters
    ----------
    model : MessengerTour
        Whose turning radius is 0.
    order : tuple of int
        The vehicles.
    points, times : ndarray, shapes (n, 2) and (n,)
        Where, m, and when each is met, s.
    """
    begin = points[0] if model.start is None else model.start[:2]
    stops = np.vstack([begin, points, *([begin] if model.closed else [])])
    steps = np.diff(stops, axis=0)
    primitives = tuple(
        Primitive(leg, "S", float(np.hypot(*step)), float(np.arctan2(step[1], step[0])))
        for leg, step in enumerate(steps)
        if step.any()
    )
    heading = model.heading
    if heading is None:
        heading = primitives[0].heading if primitives else 0.0
    return TourPlan(order, times, points, np.append(begin, heading), primitives)
