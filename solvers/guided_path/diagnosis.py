"""Diagnosis of long tours along a path, and of loads and windows that exclude every tour.

Without optional fields a tour always exists.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.extensions import extensions_of
from ...models.guided_path.gaps import Gaps
from ...models.guided_path.model import GuidedPathTour
from ..run.diagnosis import Diagnosis, Finding
from .field_diagnosis import diagnose_fields

__all__ = ["diagnose_tour"]

#: Maximum numbers of reported stretches, and of customers listed in a row.
_STRETCHES, _NAMED = 5, 12


def diagnose_tour(model: GuidedPathTour, time_limit: float | None = None) -> Diagnosis:
    """Return a lower bound on every tour, and the customers that force repeated crossings.

    Parameters
    ----------
    model : GuidedPathTour
        The model.
    time_limit : float, optional
        Seconds for the searches on a model with optional fields; others need no search.

    Returns
    -------
    Diagnosis
        Findings on the relation and on stretches of the path, or the limits that exclude every plan.
    """
    if extensions_of(model):
        return diagnose_fields(model, _relation(model), time_limit)
    gaps = Gaps(model)
    span = float(np.ptp(model.coordinates))
    summary = (
        "a plan exists, as whoever must precede can always be served first; no tour is shorter than "
        f"{gaps.bound:.10g} m"
    )
    if span > 0:
        summary += f", {gaps.bound / (2 * span):.3g} times the way to both ends and back"
    findings = (_relation(model), *_stretches(gaps))
    return Diagnosis(model.name, True, "how often each gap is crossed at least", summary, findings)


def _relation(model: GuidedPathData) -> Finding:
    """Return width and length of the relation."""
    chain = _longest(model)
    width = len(model.cover)
    text = (
        f"at most {width} customers are in no order among themselves; the longest chain has "
        f"{len(chain)}: {_join_labels(model, chain)}"
        if width > 1
        else f"there is only one order: {_join_labels(model, chain)}"
    )
    return Finding(text, "", "precedence", {"width": width, "longest": list(chain)})


def _longest(model: GuidedPathData) -> tuple[int, ...]:
    """Return a longest chain of direct precedence pairs."""
    before = Gaps(model).before
    length = {0: 0}
    for c in model.sorted_customers:
        length[c] = 1 + max(length[one] for one in before[c])
    chain = [max(model.sorted_customers, key=lambda c: length[c])]
    while length[chain[-1]] > 1:
        chain.append(max(before[chain[-1]], key=lambda one: length[one]))
    return tuple(reversed(chain))


def _stretches(gaps: Gaps) -> Iterator[Finding]:
    """Yield the stretches with the most crossings, and the customers that force them."""
    model, open_ = gaps.model, gaps.crossings > 1
    if not open_.any():
        yield Finding("no gap need be crossed more than once there and once back")
    for _ in range(_STRETCHES):
        if not open_.any():
            return
        counts = np.where(open_, gaps.crossings, 0)
        gap = int(np.lexsort((gaps.lengths, counts))[-1])
        forcing = gaps.forcing(gap)
        # The result is the same for all gaps between the innermost of these customers.
        places = gaps.at[[0, *forcing]]
        first, last = int(places[places <= gap].max()), int(places[places > gap].min())
        open_[first:last] &= gaps.crossings[first:last] > gaps.crossings[gap]
        low, high = (float(gaps.places[place]) for place in (first, last))
        times = 2 * int(gaps.crossings[gap])
        yield Finding(
            f"between {low:.10g} m and {high:.10g} m every tour passes at least {times} times: "
            f"customers {_join_labels(model, forcing)} are on its two sides in turn",
            where=f"{low:.10g} … {high:.10g} m",
            data={"from": low, "to": high, "crossings": times, "customers": list(forcing)},
        )


def _join_labels(model: GuidedPathData, customers: Iterable[int]) -> str:
    """Return the labels of a chain of customers, abbreviated if it is long."""
    labels = [model.label(c) for c in customers]
    more = len(labels) - _NAMED
    return " -> ".join(labels[:_NAMED]) + (f" and {more} more" if more > 0 else "")
