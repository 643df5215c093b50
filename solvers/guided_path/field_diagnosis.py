"""Diagnosis of guided tours whose loads or windows exclude every plan."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence

import numpy as np

from ...models.guided_path.model import GuidedPathTour
from ..contract.backend import Answer, Request, Termination
from ..run.conflicts import quick_explanation
from ..run.diagnosis import Diagnosis, Finding
from .track_search import TrackSearch
from .track_tables import TrackTables

__all__ = ["diagnose_fields"]


def diagnose_fields(
    model: GuidedPathTour, relation: Finding, time_limit: float | None
) -> Diagnosis:
    """Return whether loads and windows permit a plan, and the limits that exclude all of them.

    Parameters
    ----------
    model : GuidedPathTour
        Model with optional fields.
    relation : Finding
        Finding that is reported if a plan exists.
    time_limit : float, optional
        Seconds for all searches together.

    Returns
    -------
    Diagnosis
        If no plan exists: limits that cannot be satisfied by themselves; otherwise a set of limits that exclude
        every plan together, each of them needed for that (QuickXplain).

    Raises
    ------
    UnsupportedFormulation
        The model is too large for ``track-search``.
    """
    TrackSearch().require_support(model)
    ends = time.perf_counter() + (60.0 if time_limit is None else time_limit)
    method = "track-search, and QuickXplain over latest times and loads"
    findings = (*_late(model), *_overloaded(model))
    answer = None if findings else _search(model, ends)
    if answer is not None and answer.point is not None:
        summary = (
            f"a plan exists, {answer.primal_bound:.10g} m long; none is shorter than "
            f"{answer.dual_bound:.10g} m"
        )
        return Diagnosis(model.name, True, method, summary, (relation,))
    if answer is not None and answer.termination is not Termination.INFEASIBLE:
        summary = "the search found no plan and no proof: give it more time"
        return Diagnosis(model.name, None, method, summary, (relation,))
    if findings:
        summary = "no plan exists: a limit cannot be satisfied, whatever the order"
        return Diagnosis(model.name, False, method, summary, findings)
    limits, settled = _needed(model, ends)
    summary = "no plan exists: these limits exclude every plan together"
    summary += ", and each of them is needed for that" if settled else " (not all could be tested)"
    return Diagnosis(model.name, False, method, summary, tuple(limits))


def _search(model: GuidedPathTour, ends: float) -> Answer:
    """Return the answer of a search that stops at the first plan."""
    left = max(ends - time.perf_counter(), 0.0)
    return TrackSearch().run(model, Request(time_limit=left, gap=1e300))


def _late(model: GuidedPathTour) -> Iterator[Finding]:
    """Yield the customers that cannot be reached in time after all their predecessors."""
    if model.windows is None or model.speed is None:
        return
    tables, size = TrackTables(model), model.size
    takes = np.zeros(size) if model.service is None else model.service
    ways = tables.ways / model.speed
    begin = np.maximum(
        model.windows[:, 0], model.windows[0, 0] + takes[0] + ways[tables.homes, :size].min(axis=0)
    )
    for c in model.sorted_customers:
        # Another vehicle may serve the predecessor.
        way = ways if tables.fleet == 1 else np.zeros_like(ways)
        begin[c] = max([begin[c], *(begin[a] + takes[a] + way[a, c] for a in model.before[c])])
        if begin[c] > tables.limits[c]:
            yield Finding(
                f"customer {model.label(c)} cannot be served before {begin[c]:.6g} s, its latest time is "
                f"{model.windows[c, 1]:.6g} s",
                where=f"windows[{c}]",
                data={
                    "customer": c,
                    "begin": float(begin[c]),
                    "latest": float(model.windows[c, 1]),
                },
            )


def _overloaded(model: GuidedPathTour) -> Iterator[Finding]:
    """Yield a final load outside 0 … capacity, and customers with more than the capacity."""
    if model.loads is None:
        return
    fleet = 1 if model.vehicles is None else len(model.vehicles)
    most = np.inf if model.capacity is None else model.capacity
    scale = 1e-9 * float(np.abs(model.loads).sum())
    last = fleet * float(model.loads[0]) + float(model.loads[1:].sum())
    if not -scale <= last <= fleet * most + scale:
        yield Finding(
            f"the load after all customers is {last:.6g} in all, it must be in 0 … {fleet * most:.6g}",
            where="loads",
            data={"load": last},
        )
    for c in np.flatnonzero(np.abs(model.loads[1:]) > most + scale) + 1:
        yield Finding(
            f"customer {model.label(int(c))} changes the load by {model.loads[c]:.6g}, the capacity is {most:.6g}",
            where=f"loads[{c}]",
            data={"customer": int(c), "load": float(model.loads[c])},
        )


def _needed(model: GuidedPathTour, ends: float) -> tuple[list[Finding], bool]:
    """Return limits that exclude every plan together, and whether each one is needed for that."""
    size, late = model.size, model.windows
    limits = [] if late is None else np.flatnonzero(np.isfinite(late[:, 1])).tolist()
    limits += [size] * (model.loads is not None) + [size + 1] * (model.capacity is not None)
    settled = True

    def excludes(chosen: Sequence[int]) -> bool:
        nonlocal settled
        status = _search(_keep(model, chosen), ends).termination
        settled &= status is not Termination.NO_SOLUTION
        return status is Termination.INFEASIBLE

    needed = quick_explanation([], limits, excludes, lambda: time.perf_counter() < ends)
    settled &= time.perf_counter() < ends
    findings = []
    for limit in sorted(needed):
        if late is not None and limit < size:
            name = f"customer {model.label(limit)}" if limit else "the end of the tour"
            text, where = f"{name} not later than {late[limit, 1]:.6g} s", f"windows[{limit}]"
        elif limit > size:
            text, where = f"a load in 0 … {model.capacity:.6g} (capacity)", "capacity"
        elif size + 1 in needed:
            continue
        else:
            text, where = "a load of at least 0 (loads)", "loads"
        findings.append(Finding(text, where=where))
    return findings, settled


def _keep(model: GuidedPathTour, limits: Sequence[int]) -> GuidedPathTour:
    """Return the model with only these limits: latest times by customer, then loads and capacity."""
    loads = model.loads if model.size in limits else None
    capacity = model.capacity if loads is not None and model.size + 1 in limits else None
    windows = model.windows
    if windows is not None:
        windows = windows.copy()
        windows[np.setdiff1d(np.arange(model.size), limits), 1] = np.inf
    return dataclasses.replace(model, loads=loads, capacity=capacity, windows=windows)
