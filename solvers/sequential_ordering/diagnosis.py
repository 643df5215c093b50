"""Diagnosis of sequential ordering: nodes without an arc, the assignment bound, the relation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...models.sequential_ordering.model import SequentialOrdering
from ..run.diagnosis import Diagnosis, Finding
from .three_exchange import costs_of, length_of, nearest_available

__all__ = ["diagnose_ordering"]


def diagnose_ordering(model: SequentialOrdering, time_limit: float | None = None) -> Diagnosis:
    """Return the nodes that missing arcs isolate, a lower bound on every path, and the longest chain.

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
    isolated = tuple(_isolated(model))
    tails, heads = linear_sum_assignment(cost[:-1, 1:])
    bound = float(cost[tails, heads + 1].sum())
    method = "arcs that the relation and the distances allow, and an assignment of successors"
    if isolated or bound >= model.missing:
        word = "a node cannot be left or reached" if isolated else "arcs are missing"
        return Diagnosis(model.name, False, method, f"no order exists: {word}", isolated)
    complete = length_of(cost, nearest_available(model, cost)) < model.missing
    word = "an order exists" if complete else "not decided, because arcs are missing"
    findings = (_chain(model),) if model.pairs else ()
    summary = f"{word}; no order is shorter than {bound:.10g}"
    return Diagnosis(model.name, True if complete else None, method, summary, findings)


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


def _chain(model: SequentialOrdering) -> Finding:
    """Return the number of ordered pairs of inner nodes, and the longest chain of the relation."""
    length, former = np.ones(model.size, np.int64), np.full(model.size, -1)
    for node in model.sorted_nodes[1:-1]:
        before = model.links[model.links[:, 1] == node, 0]
        if before.size:
            former[node] = before[length[before].argmax()]
            length[node] = 1 + length[former[node]]
    chain = [int(length[:-1].argmax())]
    while former[chain[-1]] >= 0:
        chain.append(int(former[chain[-1]]))
    inner, ordered = model.size - 2, int(model.closure[1:-1, 1:-1].sum())
    names = " -> ".join(map(model.label, chain[::-1][:12])) + " …" * (len(chain) > 12)
    return Finding(
        f"the relation orders {ordered} of {inner * (inner - 1) // 2} pairs of inner nodes; its longest chain has "
        f"{len(chain)}: {names}",
        where="precedence", data={"ordered": ordered, "longest": chain[::-1]},
    )  # fmt: skip
