"""``euclidean-bound`` and ``curvature-bound``: proven lower bounds on the length of a tour."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import chase, tour
from ...models.messenger.plan import TourPlan
from ..contract.backend import Answer, Feature, Guarantee, Limit, Request, Termination
from .extensions import TourBackend

__all__ = ["CurvatureBound", "EuclideanBound"]


#: Relative gap due to the tolerance of the path solver.
ROUNDING = 1e-8


class EuclideanBound(TourBackend):
    """Lower bound: the shortest tour without curvature limit, by branch and bound over the orders.

    If a limit ends the search, the bound proven so far is valid. With a turning radius of 0 the
    tour is an optimal plan.
    """

    name = "euclidean-bound"
    guarantee = Guarantee.RELAXATION
    features = frozenset({Feature.GAP, Feature.CUTOFF, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    requires = ("clarabel",)
    summary = "a proven lower bound: the best tour without the limit on curvature; ours"
    # Without zones and windows, the minimum is not greater.
    carries = TourBackend.carries | {"no_fly", "windows"}
    curved: ClassVar[bool] = False

    def bound_leg(self, problem: MessengerTour) -> float:
        """Return a bound (m) for a single vehicle, 0 for others."""
        from .last_leg import bound_only_leg

        return (bound_only_leg(problem) or 0.0) if self.curved else 0.0

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search over the orders; return the proven bound."""
        from .bound_search import OrderSearch

        begin = clock()
        control = request.control
        cutoff = float("inf") if request.cutoff is None else request.cutoff * (1 + 1e-9)
        search = OrderSearch(problem, cutoff, curved=self.curved)

        def rising(bound: float) -> None:
            control.bound = bound

        done = search.run(lambda: control.stopped, rising, request.gap)
        best, bound = search.best, max(search.bound, self.bound_leg(problem))
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
        free = problem.no_fly is None and problem.windows is None
        flies = problem.turning_radius == 0 and free
        if flies and best is not None and best.length <= cutoff:
            plan = straight(problem, best.order, best.points)
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
    """Lower bound that includes the least turning of any tour, for free headings.

    See :mod:`.bound_kernels` for the proof. The bound of an order is at least the one without
    curvature. It equals the length of the shortest tour if legs are long, if vehicles at rest are
    met at points that are far apart, and for an open tour to one vehicle. It is weak if discs overlap,
    because their vehicles may be met at once, and if the UAV must turn by more than half a circle.
    """

    name = "curvature-bound"
    summary = "a proven lower bound that counts turns at their least: greater, and slower; ours"
    curved = True


def straight(model: MessengerTour, order: tuple[int, ...], points: NDArray[np.float64]) -> TourPlan:
    """Return the plan of straight legs to places (m), shape (n, 2), for a UAV that turns on the spot."""
    begin = points[0] if model.start is None else model.start[:2]
    path = np.vstack([begin, points])
    if model.closed:
        rate = model.home_drift
        home = begin + rate * (np.hypot(*np.diff(path, axis=0).T).sum() / model.speed)
        path = np.vstack([path, home + rate * chase(home - path[-1], rate, model.speed)])
    steps = np.diff(path, axis=0)
    moving = np.any(steps, axis=1)
    lengths, headings = np.hypot(*steps[moving].T), np.arctan2(*steps[moving, ::-1].T)
    heading = model.heading
    if heading is None:
        heading = float(headings[0]) if headings.size else 0.0
    words = ["S" if step.any() else "" for step in steps]
    return tour(model, order, words, np.append(begin, heading), lengths, headings)
