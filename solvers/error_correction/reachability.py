"""Reachable points, and the thresholds that exclude all further steps.

With revisits, the walk that leaves a point with the least surviving error can be extended wherever any
other walk can. So the least surviving errors determine which points are reachable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...models.error_correction.model import END, HORIZONTAL, VERTICAL, ErrorCorrectionRouting

if TYPE_CHECKING:
    from .airspace import Airspace
    from .grid import Grid

__all__ = ["Refusal", "onward", "reachable", "refusals"]

#: Maximum number of arcs scanned for the remaining lengths, at most about 1 s of work.
MOST_ARCS = 200_000_000
#: Names of the thresholds by the head's kind and the axis: 0 horizontal, 1 vertical error.
_THRESHOLDS = {
    (VERTICAL, 0): ("alpha2", "9", "horizontal error"),
    (VERTICAL, 1): ("alpha1", "10", "vertical error"),
    (HORIZONTAL, 0): ("beta2", "13", "horizontal error"),
    (HORIZONTAL, 1): ("beta1", "14", "vertical error"),
    (END, 0): ("theta", "17", "horizontal error"),
    (END, 1): ("theta", "18", "vertical error"),
}


@dataclass(frozen=True)
class Refusal:
    """Step from a reachable point to an unreachable one, excluded by a threshold.

    `threshold` is the field of the model that holds it, `equation` that of the paper, and `error` is
    ``"horizontal error"`` or ``"vertical error"``. `excess` is the difference of error on arrival and
    threshold.
    """

    tail: int
    head: int
    threshold: str
    equation: str
    error: str
    arrival: float
    limit: float
    excess: float


def _arrivals(model: ErrorCorrectionRouting, tail: int, left: float) -> NDArray[np.float64]:
    """Return the (horizontal, vertical) error on arrival at every point from `tail`; shape (n, 2)."""
    length = np.linalg.norm(model.points - model.points[tail], axis=1)
    errors = np.column_stack([model.horizontal_rate * length, model.vertical_rate * length])
    if model.codes[tail] == HORIZONTAL:
        errors[:, 1] += left
    elif model.codes[tail] == VERTICAL:
        errors[:, 0] += left
    return errors


def reachable(model: ErrorCorrectionRouting) -> NDArray[np.float64]:
    """Return the least error on leaving each point by walks from A, shape (n,).

    It is inf at unreachable points, and 0 at a reachable B.
    """
    from .steps import least_errors

    space, grid = _arrays(model)
    least = np.full(len(model.points), np.inf)
    least[grid.ids] = least_errors(space, grid, False, np.zeros(1, np.int8))
    return least


def _arrays(model: ErrorCorrectionRouting) -> tuple[Airspace, Grid]:
    from .airspace import airspace
    from .grid import build

    space = airspace(model)
    return space, build(space, np.ones(len(model.points), np.bool_))


def onward(model: ErrorCorrectionRouting) -> NDArray[np.bool_]:
    """Return a mask of the points from which B is reachable without an initial error, shape (n,).

    Steps to other points are dead ends. The search has a limit on its work, so the mask may include
    additional points.
    """
    from .steps import remaining

    space, grid = _arrays(model)
    marked = np.zeros(len(model.points), bool)
    marked[grid.ids] = np.isfinite(remaining(space, grid, False, MOST_ARCS, np.zeros(1, np.int8)))
    return marked


def refusals(model: ErrorCorrectionRouting, least: NDArray[np.float64]) -> list[Refusal]:
    """Return the step towards B of least excess for each reachable point, sorted by excess.

    `least` is the result of :func:`reachable`.
    """
    limit = model.rounded_limits[model.codes]
    beyond = ~np.isfinite(least) & onward(model)
    beyond[model.start] = False
    excluded = []
    for tail in np.flatnonzero(np.isfinite(least)).tolist():
        if tail == model.end or not beyond.any():
            continue
        excess = _arrivals(model, tail, float(least[tail])) - limit
        head = int(np.where(beyond, excess.max(axis=1), np.inf).argmin())
        axis = int(excess[head].argmax())
        code = int(model.codes[head])
        threshold, equation, error = _THRESHOLDS[code, axis]
        bound = float(model.limits[code, axis])
        difference = float(excess[head, axis] + limit[head, axis] - bound)
        excluded.append(
            Refusal(tail, head, threshold, equation, error, bound + difference, bound, difference)
        )
    return sorted(excluded, key=lambda r: (r.excess, r.tail))
