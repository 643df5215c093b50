"""Lower bounds on the routes of a fleet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective

__all__ = ["lower_bound"]


def lower_bound(model: FleetRouting, flag: NDArray[np.int8]) -> float:
    """Return a number that the objective of no plan is below.

    Some route visits each node, so the longest is as long as the way to the farthest and back.
    """
    from scipy.sparse.csgraph import floyd_warshall

    if model.objective is Objective.RANGE:
        return 0.0
    least = floyd_warshall(model.distances) if model.size <= 500 else None
    if least is None:
        return 0.0
    trips = np.min([least[h] + least[:, h] for h in set(model.homes.tolist())], axis=0)
    return float(trips[model.customers].max())
