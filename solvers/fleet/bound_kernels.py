"""Loop of the Lagrangian bound: a minimum spanning tree with node prices."""

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
    """Compute a minimum spanning forest of costs `there` and their transpose `back` by Prim's algorithm.

    The weight of the arc from i to j is ``there[i, j] - leave[i] - enter[j]``, with the prices of leaving
    and entering a node. The lighter of two opposite arcs is used; `both` states whether they differ. The
    first `roots` nodes are in different trees. `tails`, `heads` and `weights`, shape (n - roots,), are
    outputs.
    """
    n = there.shape[0]
    key = np.empty(n)
    near = np.empty(n, np.int64)
    rest = np.empty(n, np.int64)
    for j in range(n):
        key[j] = math.inf
        near[j] = 0
        rest[j] = roots + j
    node = 0
    for step in range(n - 1):
        edge = step - roots + 1
        remaining = n - roots - max(edge, 0)
        best, place = math.inf, 0
        for k in range(remaining):
            j = rest[k]
            weight = there[node, j] - leave[node] - enter[j]
            if weight < key[j]:
                key[j] = weight
                near[j] = node
            if both:
                other = back[node, j] - leave[j] - enter[node]
                if other < key[j]:
                    key[j] = other
                    near[j] = -1 - node
            if key[j] < best:
                best, place = key[j], k
        if edge < 0:
            node = step + 1
            continue
        node = rest[place]
        rest[place] = rest[remaining - 1]
        weights[edge] = key[node]
        # A negative entry encodes an arc from the new node to the tree.
        if near[node] >= 0:
            tails[edge] = near[node]
            heads[edge] = node
        else:
            tails[edge] = node
            heads[edge] = -1 - near[node]
