"""First stage of the paper's algorithm, a heuristic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.error_correction.model import ErrorCorrectionRouting, Route
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

if TYPE_CHECKING:
    from .airspace import Airspace

__all__ = ["FACTORS", "FactorSearch", "Labelling", "Labels", "label_with_factors"]

#: Values of the paper's λ, tried in this order; the paper recommends the first one.
FACTORS = tuple(k / 20 for k in range(10, 21))


@dataclass(frozen=True)
class Labels:
    """Result of stage 1.

    Parameters
    ----------
    route : ndarray of int64
        Points from A to B, empty if no route was found.
    length : float
        Length of the route (m), inf if no route was found.
    made : int
        Number of temporary labels written, over all factors.
    factor : float
        The last factor tried, which gave the route.
    """

    route: NDArray[np.int64]
    length: float
    made: int
    factor: float


def label_with_factors(space: Airspace, factor: float | None, request: Request) -> Labels:
    """Return the route of stage 1.

    Parameters
    ----------
    space : Airspace
        The problem.
    factor : float, optional
        The paper's λ; without it, the first of :data:`FACTORS` with a route.
    request : Request
        The stop flag.
    """
    from .labelling_kernels import label_points

    route, length, made, last = np.empty(0, np.int64), np.inf, 0, 0.0
    for last in FACTORS if factor is None else (factor,):
        _, route, length, count = label_points(space, last, request.control.flag)
        made += count
        if route.size or request.control.stopped:
            break
    return Labels(route, length, made, last)


class FactorSearch(Backend):
    """Base class of the backends with the option of stage 1."""

    options = {
        "threshold_factor": Option(
            None,
            "The paper's λ, from 0.5 to 1; without it, the first of 0.5, 0.55, …, 1 with a route.",
            float,
            lower=0.5,
            upper=1.0,
        )
    }


class Labelling(FactorSearch):
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
    summary = "the paper's stage 1: Dijkstra by length, one label per point; a heuristic"

    def run(self, problem: ErrorCorrectionRouting, request: Request) -> Answer:
        """Label the points and return the route to B."""
        from .airspace import airspace

        begin = clock()
        labels = label_with_factors(airspace(problem), request.options["threshold_factor"], request)
        stopped = request.control.stopped
        return Answer(
            Termination.FEASIBLE if labels.route.size else Termination.NO_SOLUTION,
            (request.control.reason or Limit.INTERRUPTED) if stopped else None,
            Route(tuple(labels.route.tolist())) if labels.route.size else None,
            float(labels.length) if labels.route.size else None,
            seconds={"solve": clock() - begin},
            statistics={"labels made": labels.made, "threshold factor": labels.factor},
        )
