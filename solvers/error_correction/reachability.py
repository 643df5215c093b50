"""How far routes get: the points that can be reached at all, and what refuses every step beyond.

With revisits allowed a point is reached with some surviving error; of all walks that reach it, the
one that leaves it with the least error can go on wherever any other can. So a search for the
smallest surviving error alone settles what can be reached.
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
    """A step that a threshold refuses.

    Parameters
    ----------
    tail, head : int
        From a point that is reached to one that is not.
    threshold : str
        The field of the model that refuses.
    equation : str
        The paper's equation.
    error : str
        ``"horizontal error"`` or ``"vertical error"``.
    arrival, limit, excess : float
        Error on arrival, threshold, and by how much the one exceeds the other.
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
    """Return the smallest error with which a walk from A can leave each point, shape (n,).

    It is inf where no walk arrives, and 0 at B where one does.
    """
    from .reach_kernels import least_errors

    space, grid = _laid_out(model)
    least = np.full(len(model.points), np.inf)
    least[grid.ids] = least_errors(space, grid, False, np.zeros(1, np.int8))
    return least


def _laid_out(model: ErrorCorrectionRouting) -> tuple[Airspace, Grid]:
    from .airspace import airspace
    from .grid import build

    space = airspace(model)
    return space, build(space, np.ones(len(model.points), np.bool_))


def onward(model: ErrorCorrectionRouting) -> NDArray[np.bool_]:
    """Return the points from which B could be reached if they were left without any error.

    Only steps into these can matter: whoever enters another point is lost. Where finding them would
    take long, some or all of the others are returned too.
    """
    from .slots import shortest_ways

    space, grid = _laid_out(model)
    marked = np.zeros(len(model.points), bool)
    marked[grid.ids] = np.isfinite(shortest_ways(space, grid, np.zeros(1, np.int8)))
    return marked


def refusals(model: ErrorCorrectionRouting, least: NDArray[np.float64]) -> list[Refusal]:
    """Return, for each reached point, the step towards B that misses by least; nearest miss first.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model.
    least : ndarray
        What :func:`reachable` returned.
    """
    limit = model.rounded_limits[model.codes]
    beyond = ~np.isfinite(least) & onward(model)
    beyond[model.start] = False
    found = []
    for tail in np.flatnonzero(np.isfinite(least)).tolist():
        if tail == model.end or not beyond.any():
            continue
        excess = _arrivals(model, tail, float(least[tail])) - limit
        head = int(np.where(beyond, excess.max(axis=1), np.inf).argmin())
        axis = int(excess[head].argmax())
        code = int(model.codes[head])
        threshold, equation, error = _THRESHOLDS[code, axis]
        bound = float(model.limits[code, axis])
        over = float(excess[head, axis] + limit[head, axis] - bound)
        found.append(Refusal(tail, head, threshold, equation, error, bound + over, bound, over))
    return sorted(found, key=lambda r: (r.excess, r.tail))
