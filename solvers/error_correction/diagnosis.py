"""Diagnosis of infeasible error-correction instances: the points without a feasible extension."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...models.error_correction.model import ErrorCorrectionRouting
from ..contract.backend import Termination
from ..resource_routing.diagnosis import diagnose_resources
from ..run.diagnosis import Diagnosis, Finding
from ..run.dispatch import solve
from .reachability import Refusal, reachable, refusals

__all__ = ["diagnose_routing"]

_METHOD = "search for the points that any walk from A can reach"


def diagnose_routing(model: ErrorCorrectionRouting, time_limit: float | None = None) -> Diagnosis:
    """Return the points or limits that make the model infeasible, and by how much; `time_limit` (s) per search.

    If B is unreachable even with revisits, each reachable point is reported with its least infeasible next step.
    If only the ban on revisits makes the model infeasible, the points that a route must visit twice are reported.
    With additions to the paper's problem, conflicting limits are reported.
    """
    if not model.is_plain:
        # Both errors survive a correction that may fail, and corrections are counted.
        return diagnose_resources(model.lower(), time_limit)
    least = reachable(model)
    reached = np.flatnonzero(np.isfinite(least))
    if not np.isfinite(least[model.end]):
        excluded = refusals(model, least)
        summary = (
            f"no route: {reached.size} of {len(model.points)} points can be reached, "
            "and from each of them a threshold refuses every step that leads on to B"
        )
        return Diagnosis(
            model.name, False, _METHOD, summary, tuple(_finding(model, r) for r in excluded)
        )
    answer = solve(model, "label-setting", time_limit=time_limit)
    if answer.plan is not None:
        summary = f"a route exists: {answer.plan}, {answer.primal_bound:.10g} m"
        return Diagnosis(model.name, True, "label-setting", summary)
    if answer.termination is not Termination.INFEASIBLE:
        return Diagnosis(model.name, None, "label-setting", f"not settled: {answer.termination}")
    relaxed = solve(replace(model, revisits=True), "label-setting", time_limit=time_limit)
    walk = relaxed.plan
    if walk is None:
        return Diagnosis(
            model.name, False, "label-setting",
            f"no route; which points it would visit twice is not settled: {relaxed.termination}",
        )  # fmt: skip
    points, times = np.unique(walk.route, return_counts=True)
    repeated = points[times > 1].tolist()
    names = ", ".join(model.label(point) for point in repeated)
    finding = Finding(
        f"the shortest walk {walk} visits point {names} more than once, which revisits=False forbids",
        "4-5",
        f"point {names}",
        {"points": repeated, "walk": list(walk.route)},
    )
    return Diagnosis(
        model.name,
        False,
        "label-setting with and without revisits",
        "no route: B can only be reached by visiting a point more than once",
        (finding,),
    )


def _finding(model: ErrorCorrectionRouting, refusal: Refusal) -> Finding:
    tail, head = model.label(refusal.tail), model.label(refusal.head)
    text = (
        f"point {tail} ({model.kinds[refusal.tail]}): the nearest step on, to point {head} "
        f"({model.kinds[refusal.head]}), arrives with {refusal.error} {refusal.arrival:.6g} > "
        f"{refusal.threshold} {refusal.limit:.6g}, over by {refusal.excess:.4g}"
    )
    data = {
        "point": refusal.tail,
        "next": refusal.head,
        "threshold": refusal.threshold,
        "arrival": refusal.arrival,
        "limit": refusal.limit,
        "excess": refusal.excess,
    }
    return Finding(text, refusal.equation, f"point {tail}", data)
