"""``labelling``: the paper's first stage, a heuristic."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...jit import clock
from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination

if TYPE_CHECKING:
    from .airspace import Airspace
    from .grid import Grid

__all__ = ["WEIGHTS", "Labelling", "sweep"]

#: The weights of a sweep: small ones miss fewer routes, large ones find shorter ones.
WEIGHTS = tuple(k / 20 for k in range(10, 21))


def sweep(
    space: Airspace, grid: Grid, weights: tuple[float, ...], request: Request
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], float, int, int, float | None]:
    """Return the shortest route that labelling finds with any of `weights`.

    Returns
    -------
    route : ndarray of int64
        Points from A to B, empty without one.
    length : float
        Its length (m), inf without one.
    made, hits : int
        Labels made, and weights that gave a route.
    weight : float, optional
        The weight of the best route.
    """
    from .labelling_kernels import label_once

    route, length = np.empty(0, np.int64), float("inf")
    made, hits, best = 0, 0, None
    for weight in weights:
        status, found, total, count = label_once(space, grid, weight, request.control.flag)
        made += count
        hits += status == 1
        if total < length:
            route, length, best = found, total, weight
        if request.control.stopped:
            break
    return route, length, made, hits, best


class Labelling(Backend):
    """Labels of length and errors, one kept at each point, in the order of a weighted sum.

    As we read the paper's stage 1: points are labelled for good in the order of
    ``weight * length + (1 - weight) * metres flown since the surviving error was 0``. One label a
    point makes it quick and its routes simple, and lets it miss routes. Small weights miss fewer,
    large ones find shorter routes where they find any, and none is best everywhere; so by default
    all of 0.5, 0.55, …, 1 are tried and the shortest route is kept.
    (The paper's text of this stage swaps the thresholds of the two kinds of points.)
    """

    name = "labelling"
    accepts = ErrorCorrectionRouting
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    options = {
        "weight": Option(
            None, "The paper's λ, from 0.5 to 1; without it, a sweep.", float, lower=0.5, upper=1.0
        )
    }
    summary = "the paper's stage 1: one label a point, by a weighted sum; a heuristic"

    def run(self, problem: ErrorCorrectionRouting, request: Request) -> Answer:
        """Sweep over the weights."""
        from .airspace import airspace
        from .grid import build

        begin = clock()
        weight = request.options["weight"]
        space = airspace(problem)
        grid = build(space, np.ones(len(space.points), np.bool_))
        weights = WEIGHTS if weight is None else (weight,)
        route, length, made, hits, best = sweep(space, grid, weights, request)
        found = route.size > 0
        stopped = request.control.stopped
        statistics: dict[str, float | int | str] = {
            "labels made": made,
            "weights tried": len(weights),
            "weights with a route": hits,
        }
        if best is not None:
            statistics["best weight"] = best
        return Answer(
            Termination.FEASIBLE if found else Termination.NO_SOLUTION,
            (request.control.reason or Limit.INTERRUPTED) if stopped else None,
            Route(tuple(route.tolist())) if found else None,
            float(length) if found else None,
            seconds={"solve": clock() - begin},
            statistics=statistics,
        )
