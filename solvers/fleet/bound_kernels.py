"""The loop of the bounds on routes: a spanning tree of least weight among priced nodes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["spanning_tree"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel(interpretable=True)
def spanning_tree(
    there: Floats,
    back: Floats,
    leave: Floats,
    enter: Floats,
    tails: Ints,
    heads: Ints,
    weights: Floats,
    roots: int,
    both: bool,
) -> None:
    """Fill in trees of least weight that span all nodes, one from each root, by Prim's algorithm.

    An arc from i to j weighs ``there[i, j] - leave[i] - enter[j]``; of two opposite ones the lighter
    counts.

    Parameters
    ----------
    there, back : ndarray, shape (n, n)
        Costs, and their transpose.
    leave, enter : ndarray, shape (n,)
        Prices of leaving and of entering each node.
    tails, heads : ndarray of int, shape (n - roots,)
        Filled in with the arcs.
    weights : ndarray, shape (n - roots,)
        Filled in with their weights.
    roots : int
        The first so many nodes are kept apart; 1 makes one tree.
    both : bool
        Whether opposite arcs differ.
    """
    n = there.shape[0]
    key = np.empty(n)
    near = np.empty(n, np.int64)
    rest = np.empty(n, np.int64)
    for j in range(n):
        key[j] = math.inf
        near[j] = 0
        rest[j] = roots + j
    at = 0
    for step in range(n - 1):
        edge = step - roots + 1
        left = n - roots - max(edge, 0)
        best, place = math.inf, 0
        for k in range(left):
            j = rest[k]
            one = there[at, j] - leave[at] - enter[j]
            if one < key[j]:
                key[j] = one
                near[j] = at
            if both:
                other = back[at, j] - leave[j] - enter[at]
                if other < key[j]:
                    key[j] = other
                    near[j] = -1 - at
            if key[j] < best:
                best, place = key[j], k
        if edge < 0:
            at = step + 1
            continue
        at = rest[place]
        rest[place] = rest[left - 1]
        weights[edge] = key[at]
        # The sign says which way the arc leads.
        if near[at] >= 0:
            tails[edge] = near[at]
            heads[edge] = at
        else:
            tails[edge] = at
            heads[edge] = -1 - near[at]
