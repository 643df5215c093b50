"""What a black box is like before anything is searched: its variables, its budget, values at a few points."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ..diagnosis import Diagnosis, Finding

__all__ = ["diagnose_black_box"]

Floats = NDArray[np.float64]

#: Free variables up to which all corners are tried; of more, the two ends of the diagonal.
_CORNERS = 4
#: Ratio of the widest to the narrowest range that is worth a word.
_UNEVEN = 1e3


def diagnose_black_box(model: BlackBoxMinimisation, time_limit: float | None = None) -> Diagnosis:
    """Return what the values at the centre and in corners of the bounds say, and what they cannot.

    A point within the bounds is a plan wherever the function has a value, so there is one as soon as a
    value is found; that there is none cannot be shown. At most 17 points are tried, beside the budget of
    runs.

    Parameters
    ----------
    model : BlackBoxMinimisation
        What is asked.
    time_limit : float, optional
        Not used.
    """
    free = np.flatnonzero(model.highs > model.lows)
    places = list(_places(model, free))
    checks = [model.verify(BlackBoxPoint(tuple(x.tolist()))) for _, x in places]
    values = [check.objective for check in checks]
    known = [value for value in values if value is not None]
    findings = (*_ranges(model, free), *_values(places, values))
    if known:
        summary = (
            f"a plan exists: the function has a value at {len(known)} of {len(places)} points, the least "
            f"{min(known):.6g}; nothing is proven of the least value of all"
        )
    else:
        summary = (
            f"not settled: the function has no value at any of {len(places)} points, and values alone "
            "cannot show that there is none elsewhere"
        )
    method = "values at the centre and in corners"
    return Diagnosis(model.name, True if known else None, method, summary, findings)


def _places(model: BlackBoxMinimisation, free: NDArray[np.int64]) -> Iterator[tuple[str, Floats]]:
    """Yield the centre and corners, each with its name."""
    # The sum of both bounds may be too large for a number, their halves are not.
    centre = np.clip(model.lows / 2 + model.highs / 2, model.lows, model.highs)
    yield "the centre", centre
    if not free.size:
        return
    few = free.size <= _CORNERS
    sides = itertools.product((False, True), repeat=free.size) if few else ((False,), (True,))
    for high in sides:
        corner = centre.copy()
        corner[free] = np.where(high, model.highs[free], model.lows[free])
        words = ", ".join("high" if side else "low" for side in high)
        yield f"the corner ({words}{'' if few else ', …'})", corner


def _ranges(model: BlackBoxMinimisation, free: NDArray[np.int64]) -> Iterator[Finding]:
    """Yield what bounds and budget say."""
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
        one, other = int(free[width.argmax()]), int(free[width.argmin()])
        yield Finding(
            f"the range of x[{one}] is {width.max() / width.min():.3g} times that of x[{other}]: searches "
            "see all ranges alike, which is right where they were chosen with care",
            where=f"x[{one}]",
            data={"ratio": float(width.max() / width.min())},
        )
    if model.budget < 10 * free.size:
        yield Finding(
            f"{free.size} free variables and a budget of {model.budget}: fewer than 10 evaluations for "
            "each teach a search little",
            where="budget",
            data={"budget": model.budget, "variables": int(free.size)},
        )


def _values(places: list[tuple[str, Floats]], values: list[float | None]) -> Iterator[Finding]:
    """Yield the values, and whether they are all the same."""
    for (name, x), value in zip(places, values, strict=True):
        told = "there is no value" if value is None else f"the value is {value:.6g}"
        yield Finding(f"at {name} {told}", where=name, data={"x": x.tolist(), "value": value})
    if len(values) > 1 and None not in values and len(set(values)) == 1:
        yield Finding("all these values are the same: the function may not depend on its variables")
