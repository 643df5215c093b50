"""Rows of programs with arcs between customers and the order of any two, for tours and sequential ordering.

Customer 0 is the start and the end. Sources: see :mod:`.arcs`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..programs.builder import ProgramBuilder

__all__ = ["columns_of_order", "follow_arcs", "order_program", "usable_arcs"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Truths = NDArray[np.bool_]


def usable_arcs(closure: Truths) -> Truths:
    """Return whether j can follow i directly, shape (n, n): without violation and with none that must be between."""
    between = closure.astype(np.float32) @ closure > 0
    return ~(np.eye(len(closure), dtype=bool) | closure.T | between)


def order_program(
    b: ProgramBuilder, labels: Indices, closure: Truths, tails: Indices, heads: Indices, cost: Floats,
) -> Indices:  # fmt: skip
    """Add the columns and rows of a closed tour through all customers, and return the columns of the arcs.

    Parameters
    ----------
    b : ProgramBuilder
        The program.
    labels : ndarray of int, shape (n,)
        Numbers of the customers in names.
    closure : ndarray of bool, shape (n, n)
        True if i must precede j. Row and column 0 are False.
    tails, heads, cost : ndarray, shape (arcs,)
        The arcs.
    """
    size = len(labels)
    x = b.columns(
        "served next", tails.size, upper=1, integral=True, cost=cost, template="{1} after {0}",
        index=labels[np.column_stack([tails, heads])],
    )  # fmt: skip
    first, second = np.triu_indices(size - 1, 1)
    first, second = first + 1, second + 1
    pairs = labels[np.column_stack([first, second])]
    y = b.columns(
        "served before", first.size, lower=closure[first, second].astype(float),
        upper=1.0 - closure[second, first], integral=True, template="{0} before {1}",
        index=pairs,
    )  # fmt: skip
    for name, ends in (("left once", tails), ("reached once", heads)):
        b.rows(name, size, (ends, x, 1.0), lower=1, upper=1, template="{0}", index=labels)
    # Order of any two customers as a column, a sign and a constant.
    column = np.zeros((size, size), np.int64)
    sign, constant = np.ones((size, size)), np.zeros((size, size))
    column[first, second] = column[second, first] = y
    sign[second, first], constant[second, first] = -1.0, 1.0
    inner = np.flatnonzero((tails > 0) & (heads > 0))
    i, j = tails[inner], heads[inner]
    rows = np.arange(inner.size)
    b.rows(
        "next is after", rows.size, (rows, x[inner], 1.0), (rows, column[i, j], -sign[i, j]),
        upper=constant[i, j], template="{1} after {0}", index=labels[np.column_stack([i, j])],
    )  # fmt: skip
    arc = np.full((size, size), -1)
    arc[tails, heads] = x
    i, j, k = (part.ravel() + 1 for part in np.indices((size - 1,) * 3))
    may = ~closure.T
    count = (arc[j, i] >= 0).astype(int) + may[i, j] + may[j, k] + may[k, i]
    i, j, k = np.stack([i, j, k])[:, (i != j) & (j != k) & (k != i) & (count > 2)]
    rows = np.arange(i.size)
    back = arc[j, i] >= 0
    orders = [(i, j), (j, k), (k, i)]
    b.rows(
        "no circle of three", i.size, (rows[back], arc[j, i][back], 1.0),
        *((rows, column[at], sign[at]) for at in orders),
        upper=2.0 - sum(constant[at] for at in orders), template="{0}, {1} and {2}",
        index=labels[np.column_stack([i, j, k])],
    )  # fmt: skip
    return x


def columns_of_order(order: Sequence[int], size: int, tails: Indices, heads: Indices) -> Floats:
    """Return the columns of :func:`order_program` for the tour through 0, `order` and 0."""
    after = np.zeros((size, size))
    after[[0, *order], [*order, 0]] = 1.0
    place = np.empty(size)
    place[list(order)] = np.arange(size - 1)
    first, second = np.triu_indices(size - 1, 1)
    return np.concatenate([after[tails, heads], place[first + 1] < place[second + 1]])


def follow_arcs(values: Floats, tails: Indices, heads: Indices, size: int) -> list[int]:
    """Return the customers along the arcs with value 1 from the start, which columns begin with."""
    tails, heads = (ends[values[: ends.size] > 0.5] for ends in (tails, heads))
    follows = dict(zip(tails.tolist(), heads.tolist(), strict=True))
    stops, customer = list[int](), 0
    while len(stops) < size and (customer := follows.get(customer, 0)):
        stops.append(customer)
    return stops
