"""Comparison of an answer's claims about a trajectory with the exact optimum."""

from decimal import Decimal, localcontext

import numpy as np
from minimum_snap import hundred_digits

#: Largest difference of a plan reported as optimal from the optimum, relative to the objective and
#: to the extent of a segment.
OBJECTIVE, SHAPE = 1e-6, 1e-8
#: Beyond this many times the extent of what is given, the optimum runs away through free waypoints: a
#: ten-millionth of its objective moves it by more than all that is given, and only the objective is judged.
AWAY = 1e6
#: Rounding error of a position in double precision, relative to it.
ULPS = Decimal(2) ** -50
#: Places of a segment where plans are compared.
PLACES = [Decimal(k) / 8 for k in range(9)]


def shape_error(model, plan, coefficients):
    """Return how far the plan lies from the optimum at most, by segment and axis, relative.

    The scale is the extent of the segment on its axis: how far its points are from its start; a
    share of 1e-6 of the path's extent at least.
    """
    with localcontext() as context:
        context.prec = hundred_digits.DIGITS
        powers = np.array([_powers(s, coefficients.shape[1]) for s in PLACES], object)
        whole = np.ptp(np.where(np.isfinite(model.waypoints), model.waypoints, 0.0), axis=0)
        worst = 0.0
        for k in range(len(coefficients)):
            mine = np.array(
                [[Decimal(float(c)) for c in row] for row in plan.coefficients[k]], object
            )
            own = np.array([_powers(s, len(mine)) for s in PLACES], object)
            exact = powers @ coefficients[k]
            off = np.abs(exact - own @ mine).max(axis=0)
            extent = np.abs(exact - exact[0]).max(axis=0)
            # A position has no more digits than a double, however far away the path is.
            off = [
                max(o - ULPS * p, Decimal(0))
                for o, p in zip(off, np.abs(exact).max(axis=0), strict=True)
            ]
            for axis in range(len(off)):
                scale = max(float(extent[axis]), 1e-6 * float(whole[axis]), 1e-300)
                worst = max(worst, float(off[axis]) / scale)
        return worst


def judge(model, solution):
    """Return a word, and what is wrong: ``optimal``, ``feasible``, ``refused`` or ``WRONG``."""
    optimum, coefficients, unique = hundred_digits.solve(model)
    best = float(optimum)
    if solution.plan is None:
        return (
            ("refused", solution.message)
            if solution.message
            else ("WRONG", "refused without a word")
        )
    objective = model.objective(solution.plan)
    scale = max(best, 1e-4 * model.objective_scale)
    bound = solution.dual_bound
    if bound is not None and bound > best + 1e-9 * scale:
        return "WRONG", f"bound {bound:.17g} above {best:.17g}"
    off = abs(objective - best) / scale
    # If the optimum is not unique, the plan may be any optimum.
    judged = unique and not _runs_away(model, coefficients)
    shape = shape_error(model, solution.plan, coefficients) if judged else 0.0
    if str(solution.termination) != "optimal":
        return (
            ("feasible", f"{off:.1e} {shape:.1e}")
            if solution.message
            else ("WRONG", f"no reason; {off:.1e} {shape:.1e}")
        )
    if off > OBJECTIVE or shape > SHAPE:
        return "WRONG", f"objective off by {off:.1e}, shape by {shape:.1e}"
    return "optimal", f"{off:.1e} {shape:.1e}"


def _runs_away(model, coefficients):
    """Return whether the optimum leaves everything that is given far behind."""
    given = np.where(np.isfinite(model.waypoints), model.waypoints, np.nan)
    extent = np.nan_to_num(np.nanmax(given, axis=0) - np.nanmin(given, axis=0))
    powers = np.array([_powers(s, coefficients.shape[1]) for s in PLACES], object)
    path = np.array([(powers @ one).astype(float) for one in coefficients]).reshape(-1, len(extent))
    return bool((np.ptp(path, axis=0) > AWAY * np.maximum(extent, 1e-300)).any())


def _powers(s, count):
    return [Decimal(1), *(s**p for p in range(1, count))]
