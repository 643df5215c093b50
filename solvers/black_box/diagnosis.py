"""Diagnosis of a black box before a search: variables, budget, and values at a few points."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ...models.verification import Verification
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["diagnose_black_box"]

Floats = NDArray[np.float64]

#: Largest number of free variables for which all corners are evaluated; otherwise two of them.
_CORNERS = 4
#: Ratio of the widest to the narrowest range above which it is reported.
_UNEVEN = 1e3


def diagnose_black_box(model: BlackBoxMinimisation, time_limit: float | None = None) -> Diagnosis:
    """Return the values at the centre and in corners of the bounds, and remarks on bounds and budget.

    Every point within the bounds at which the function has a value is a plan, so one value proves
    that a plan exists. That no plan exists cannot be proven. At most 17 points are evaluated,
    without using the budget of runs; the time limit is not used.
    """
    free = np.flatnonzero(model.highs > model.lows)
    places = list(_places(model, free))
    checks = [model.verify(BlackBoxPoint(tuple(x.tolist()))) for _, x in places]
    values = [check.objective for check in checks]
    known = [check.objective for check in checks if check.ok and check.objective is not None]
    findings = (*_ranges(model, free), *_values(places, values), *_constraints(places, checks))
    count, unproven = len(places), "nothing is proven of the least value of all"
    has_value = any(value is not None for value in values)
    if known:
        what = "all constraints hold" if model.columns > 1 else "the function has a value"
        summary = f"a plan exists: {what} at {len(known)} of {count} points, the least {min(known):.6g}; {unproven}"
    else:
        what = (
            "constraints are violated at all" if has_value else "the function has no value at any"
        )
        where = "they are violated everywhere" if has_value else "there is none elsewhere"
        summary = (
            f"not settled: {what} of {count} points, and values alone cannot show that {where}"
        )
    method = "values at the centre and in corners"
    return Diagnosis(model.name, True if known else None, method, summary, findings)


def _places(model: BlackBoxMinimisation, free: NDArray[np.int64]) -> Iterator[tuple[str, Floats]]:
    """Yield the centre and corners with their names."""
    # The sum of both bounds may overflow, the sum of their halves does not.
    centre = np.clip(model.lows / 2 + model.highs / 2, model.lows, model.highs)
    yield "the centre", model.layout.canonical(centre)
    if not free.size:
        return
    few = free.size <= _CORNERS
    sides = itertools.product((False, True), repeat=free.size) if few else ((False,), (True,))
    for high in sides:
        corner = centre.copy()
        corner[free] = np.where(high, model.highs[free], model.lows[free])
        words = ", ".join("high" if side else "low" for side in high)
        yield f"the corner ({words}{'' if few else ', …'})", model.layout.canonical(corner)


def _ranges(model: BlackBoxMinimisation, free: NDArray[np.int64]) -> Iterator[Finding]:
    """Yield findings about bounds and budget."""
    fixed = model.dimension - free.size
    if fixed:
        first = int(np.flatnonzero(model.highs == model.lows)[0])
        several = "1 variable is" if fixed == 1 else f"{fixed} variables are"
        yield Finding(
            f"{several} fixed between equal bounds, the first x[{first}] = {model.lows[first]:g}",
            where=f"x[{first}]",
            data={"fixed": fixed},
        )
    if not free.size:
        yield Finding("every variable is fixed: there is a single point", where="bounds")
        return
    width = (model.highs - model.lows)[free]
    if width.max() > _UNEVEN * width.min():
        widest, narrowest = int(free[width.argmax()]), int(free[width.argmin()])
        yield Finding(
            f"the range of x[{widest}] is {width.max() / width.min():.3g} times that of x[{narrowest}]: searches "
            "see all ranges alike, which is right where they were chosen with care",
            where=f"x[{widest}]",
            data={"ratio": float(width.max() / width.min())},
        )
    if model.budget < 10 * free.size * model.repeats:
        yield Finding(
            f"{free.size} free variables and a budget of {model.budget}: fewer than 10 evaluations for "
            "each teach a search little",
            where="budget",
            data={"budget": model.budget, "variables": int(free.size)},
        )


def _values(places: list[tuple[str, Floats]], values: list[float | None]) -> Iterator[Finding]:
    """Yield the values, and a finding if they are all equal."""
    for (name, x), value in zip(places, values, strict=True):
        text = "there is no value" if value is None else f"the value is {value:.6g}"
        yield Finding(f"at {name} {text}", where=name, data={"x": x.tolist(), "value": value})
    if len(values) > 1 and None not in values and len(set(values)) == 1:
        yield Finding("all these values are the same: the function may not depend on its variables")


def _constraints(places: list[tuple[str, Floats]], checks: list[Verification]) -> Iterator[Finding]:
    """Yield the constraints that are violated at each place."""
    for (name, x), verification in zip(places, checks, strict=True):
        for check in verification.checks:
            if not check.ok and check.name in ("inequalities", "equalities"):
                yield Finding(
                    f"at {name} {check.where} is violated by {check.worst:.6g}",
                    where=name,
                    data={"x": x.tolist(), "constraint": check.where, "violation": check.worst},
                )
