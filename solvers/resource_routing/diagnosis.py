"""Diagnosis of infeasible routes with resources: a minimal set of conflicting limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource
from ..contract.backend import Termination
from ..run.diagnosis import Diagnosis, Finding
from ..run.dispatch import solve

__all__ = ["diagnose_resources"]

_METHOD = "resource-labelling, then a deletion filter over the limits of the resources"


def diagnose_resources(model: ResourceRouting, time_limit: float | None = None) -> Diagnosis:
    """Return a minimal set of conflicting limits: without any one of them, a route exists.

    `time_limit` is that of each search, s.
    """
    ends, text = _ends(model, time_limit)
    if ends is not False:
        summary = f"a route exists: {text}" if ends else f"not settled: {text}"
        return Diagnosis(model.name, ends, _METHOD, summary)
    parts = [
        (k, table, word)
        for k, resource in enumerate(model.resources)
        for table in ("limits", "lower_limits")
        for word, _ in getattr(resource, table)
    ]
    if not parts or _ends(_keeping(model, []), time_limit)[0] is False:
        return Diagnosis(
            model.name, False, _METHOD, "no route: no way of arcs leads from the start to the end"
        )
    unsure = set()
    for part in list(parts):
        fewer = [other for other in parts if other != part]
        ends, _ = _ends(_keeping(model, fewer), time_limit)
        if ends is False:
            parts = fewer
        elif ends is None:
            unsure.add(part)
    findings = tuple(_finding(model, part, part in unsure) for part in parts)
    summary = f"no route keeps {'these limits together' if len(parts) > 1 else 'this limit'}"
    return Diagnosis(model.name, False, _METHOD, summary, findings)


def _ends(model: ResourceRouting, time_limit: float | None) -> tuple[bool | None, str]:
    """Return whether a route exists (None after a limit), and a description."""
    result = solve(model, "resource-labelling", time_limit=time_limit)
    if result.plan is not None:
        return True, f"{result.plan}, length {result.primal_bound:.10g}"
    settled = result.termination is Termination.INFEASIBLE
    return (False if settled else None), str(result.termination)


def _keeping(model: ResourceRouting, parts: list[tuple[int, str, str]]) -> ResourceRouting:
    """Return the model with only the limits `parts`: resource index, table and kind of each."""

    def some(k: int, table: str) -> dict[str, float]:
        values = getattr(model.resources[k], table)
        return {word: value for word, value in values if (k, table, word) in parts}

    resources = tuple(
        Resource(
            entry.name, entry.rate, entry.initial, gains=entry.gains, resets=entry.resets,
            limits=some(k, "limits"), lower_limits=some(k, "lower_limits"), floors=entry.floors,
        )
        for k, entry in enumerate(model.resources)
    )  # fmt: skip
    return replace(model, resources=resources)


def _finding(model: ResourceRouting, part: tuple[int, str, str], unsure: bool) -> Finding:
    k, table, word = part
    resource = model.resources[k]
    limit = dict(getattr(resource, table))[word]
    points = np.flatnonzero(model.codes == model.words.index(word)).tolist()
    shown = ", ".join(map(model.label, points[:5])) + (" …" if len(points) > 5 else "")
    side = "most" if table == "limits" else "least"
    text = f"{resource.name} at {side} {limit:g} at {word} (point {shown})"
    if unsure:
        text += "; whether it is needed was not settled in time"
    data = {"resource": resource.name, "kind": word, "limit": limit, "settled": not unsure}
    return Finding(text, "", f"kind {word}", data)
