"""Diagnosis of sequential ordering: nodes without an arc, and the assignment bound."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...models.sequential_ordering.model import SequentialOrdering
from ..run.diagnosis import Diagnosis, Finding
from .three_exchange import costs_of, length_of, nearest_available

__all__ = ["diagnose_ordering"]


def diagnose_ordering(model: SequentialOrdering, time_limit: float | None = None) -> Diagnosis:
    """Return the nodes that missing arcs isolate, and a lower bound on every path.

    Parameters
    ----------
    model : SequentialOrdering
        The model.
    time_limit : float, optional
        Not used: the diagnosis needs no search.

    Returns
    -------
    Diagnosis
        Infeasible if a node has no arc, or if no assignment of successors exists; feasible if the path to the nearest
        available nodes is; otherwise not decided.
    """
    from scipy.optimize import linear_sum_assignment

    cost = costs_of(model)
    length = min(length_of(cost, nearest_available(model, cost)), model.missing)
    complete = length < model.missing
    # No shorter path has an arc as long as this one, and the costs of others would cause rounding errors.
    cost = np.minimum(cost, length)
    isolated = tuple(_isolated(model))
    tails, heads = linear_sum_assignment(cost[:-1, 1:])
    bound = float(cost[tails, heads + 1].sum())
    method = "arcs that the relation and the distances allow, and an assignment of successors"
    if not complete and (isolated or bound >= model.missing):
        word = "a node cannot be left or reached" if isolated else "arcs are missing"
        return Diagnosis(model.name, False, method, f"no order exists: {word}", isolated)
    word = "an order exists" if complete else "not decided, because arcs are missing"
    summary = f"{word}; no order is shorter than {bound:.10g}"
    return Diagnosis(model.name, True if complete else None, method, summary)


def _isolated(model: SequentialOrdering) -> Iterator[Finding]:
    """Yield the nodes without an arc to a successor or from a predecessor."""
    for axis, word in ((1, "successor"), (0, "predecessor")):
        ends = model.arcs[:-1, 1:].any(axis=axis)
        for node in (np.flatnonzero(~ends) + 1 - axis).tolist():
            yield Finding(
                f"node {model.label(node)} has no possible direct {word}: its arcs are missing, or the relation "
                "excludes them",
                where=f"node {model.label(node)}", data={"node": node},
            )  # fmt: skip
