"""Diagnosis of guided tours whose loads or windows exclude every plan."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator

import numpy as np

from ...models.guided_path.model import GuidedPathTour
from ..contract.backend import Answer, Request, Termination
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
        every plan together, from which no limit can be removed (deletion filter).

    Raises
    ------
    UnsupportedFormulation
        The model is too large for ``track-search``.
    """
    TrackSearch().require_support(model)
    ends = time.perf_counter() + (60.0 if time_limit is None else time_limit)
    method = "track-search, and a deletion filter over latest times and loads"
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
    before: dict[int, list[int]] = {}
    for a, b in model.pairs:
        before.setdefault(b, []).append(a)
    for c in model.sorted_customers:
        # Another vehicle may serve the predecessor.
        way = ways if tables.fleet == 1 else np.zeros_like(ways)
        begin[c] = max([begin[c], *(begin[a] + takes[a] + way[a, c] for a in before.get(c, ()))])
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
    """Return limits that exclude every plan together, and whether each one was tested."""
    latest = (
        [] if model.windows is None else np.flatnonzero(np.isfinite(model.windows[:, 1])).tolist()
    )
    tests: list[int | str] = [*reversed(latest), *(["capacity"] * (model.capacity is not None))]
    tests += ["loads"] * (model.loads is not None)
    findings, settled = list[Finding](), True
    for test in tests:
        if isinstance(test, int):
            assert model.windows is not None
            windows = model.windows.copy()
            windows[test, 1] = np.inf
            relaxed = dataclasses.replace(model, windows=windows)
            name = f"customer {model.label(test)}" if test else "the end of the tour"
            text, where = (
                f"{name} not later than {model.windows[test, 1]:.6g} s",
                f"windows[{test}]",
            )
        elif test == "capacity":
            relaxed = dataclasses.replace(model, capacity=None)
            text, where = f"a load in 0 … {model.capacity:.6g} (capacity)", "capacity"
        else:
            relaxed = dataclasses.replace(model, loads=None, capacity=None)
            text, where = "a load of at least 0 (loads)", "loads"
        status = _search(relaxed, ends).termination
        if status is Termination.INFEASIBLE:
            model = relaxed
            continue
        settled &= status is not Termination.NO_SOLUTION
        if where != "loads" or model.capacity is None:
            findings.append(Finding(text, where=where))
    return findings, settled
