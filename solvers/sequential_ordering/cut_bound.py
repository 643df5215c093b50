"""Lower bound on paths with precedence by a linear program over arcs with cuts.

If i precedes j, a path from i to j visits neither a predecessor of i nor a successor of j. In the graph without these
nodes, the arcs across every cut between i and j therefore sum to at least 1: the (pi, sigma)-inequalities of E. Balas,
M. Fischetti, W. R. Pulleyblank, "The precedence-constrained asymmetric traveling salesman polytope", Mathematical
Programming 68, 1995. Maximum flows find the violated ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...models.sequential_ordering.model import SequentialOrdering

__all__ = ["MOST_ARCS", "cut_bound"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Largest number of arcs: programs of this size take a tenth of a second.
MOST_ARCS = 12_000
#: Maximum number of programs, and of consecutive ones whose bound increases by less than this share.
_ROUNDS, _STALE, _LITTLE = 100, 8, 1e-4
#: Units of a flow of 1, and the smallest violation of a cut.
_UNITS, _VIOLATED = 1_000_000, 0.02
#: Margin for rounding errors, relative to the known path.
_ROUNDING = 1e-9
#: Slack above which a cut is removed when the bound increases.
_SLACK = 0.2


def cut_bound(
    model: SequentialOrdering, cost: Floats, missing: float, left: Callable[[], float]
) -> tuple[float, Truths]:
    """Return a lower bound on all paths shorter than `missing`, and the arcs that such paths may contain.

    `cost`, shape (n, n): distances; arcs of at least `missing` are not used. `missing`: length of a known path.
    `left`: function that returns the seconds left, 0 to stop. Result: the bound, from dual values, so that it
    does not depend on the tolerance of the solver. The arcs are those whose reduced costs do not exceed the
    difference of `missing` and the bound.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, vstack

    usable = cost < missing
    tails, heads = np.nonzero(usable)
    size, arcs = len(cost), np.arange(tails.size)
    if not 0 < tails.size <= MOST_ARCS:
        return 0.0, usable
    weights, ones = cost[tails, heads], np.ones(2 * arcs.size)
    ends = (np.append(tails, heads + size - 2), np.append(arcs, arcs))
    degrees = csr_array((ones, ends), shape=(2 * size - 2, arcs.size))
    cuts = csr_array((0, arcs.size))
    pairs = _pairs(model)
    best, kept, stale = 0.0, usable, 0
    for _ in range(_ROUNDS):
        if (seconds := left()) <= 0.0:
            break
        limit = {} if np.isinf(seconds) else {"time_limit": seconds}
        sides = -np.ones(cuts.shape[0])
        result = linprog(
            weights, -cuts if len(sides) else None, sides if len(sides) else None, degrees,
            np.ones(2 * size - 2), (0.0, 1.0), "highs-ds", options=limit,
        )  # fmt: skip
        if result.x is None or result.status != 0:
            break
        duals = np.maximum(-result.ineqlin.marginals, 0.0) if len(sides) else np.zeros(0)
        free = result.eqlin.marginals
        reduced = weights - degrees.T @ free - cuts.T @ duals
        bound = float(free.sum() + duals.sum() + np.minimum(reduced, 0.0).sum())
        bound -= _ROUNDING * missing
        stale = 0 if bound > best * (1.0 + _LITTLE) else stale + 1
        if bound > best:
            best, kept = bound, usable.copy()
            kept[tails, heads] = bound + reduced < missing * (1.0 + _ROUNDING)
            cuts = cuts[cuts @ result.x < 1.0 + _SLACK]
        rows = _violated(size, tails, heads, result.x, pairs, left)
        if not rows or stale >= _STALE:
            break
        cuts = vstack([cuts, csr_array(np.array(rows, float))], format="csr")
    return best, kept


def _pairs(model: SequentialOrdering) -> list[tuple[int, int, Truths]]:
    """Return pairs in order, including the first and the last node, and the nodes that may be between them."""
    last = model.size - 1
    inner = range(1, last)
    pairs = [(0, j) for j in inner] + [(j, last) for j in inner]
    return [
        (i, j, ~(model.closure[:, i] | model.closure[j]))
        for i, j in (*pairs, *map(tuple, model.links.tolist()))
    ]


def _violated(
    size: int, tails: Ints, heads: Ints, values: Floats, pairs: list[tuple[int, int, Truths]],
    left: Callable[[], float],
) -> list[Truths]:  # fmt: skip
    """Return distinct cuts that the values of the arcs violate, as masks of the arcs; fewer if no time is left."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    flows = np.rint(values * _UNITS).astype(np.int32)
    found: dict[bytes, Truths] = {}
    for i, j, between in pairs:
        if left() <= 0.0:
            break
        within = between[tails] & between[heads]
        open_ = within & (flows > 0)
        graph = csr_array((flows[open_], (tails[open_], heads[open_])), shape=(size, size))
        result = maximum_flow(graph, i, j)
        if result.flow_value > _UNITS * (1.0 - _VIOLATED):
            continue
        residual = (graph - result.flow).tocsr()
        residual.data = np.maximum(residual.data, 0)
        residual.eliminate_zeros()
        reached = np.zeros(size, bool)
        reached[breadth_first_order(residual, i, return_predecessors=False)] = True
        cut = within & reached[tails] & ~reached[heads]
        found[cut.tobytes()] = cut
    return list(found.values())
