"""Searches that draw or count evaluations, on one problem: tests of ranks and data profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from statistics import median
from typing import Any

from ..solution import Solution
from ..verdict import Verdict
from .profiles import Profile, data_profile
from .standing import Standing, is_reference, slack, who
from .statistics import FEWEST, RankTest, compare_pairs, compare_seeds, correct_tests

__all__ = ["ACCURACY", "compare_on_instance", "compare_with_leader", "profile_evaluations"]

#: How much of the way from the first to the best value is left where a data profile calls an
#: instance solved; Moré and Wild draw 1e-1 to 1e-5.
ACCURACY = 1e-3
#: What no plan counts as, where the worst plan is 1.
NOTHING = 2.0


def compare_with_leader(
    verdicts: Sequence[Verdict], standings: Sequence[Standing]
) -> dict[str, RankTest]:
    """Return whether the leading backend's plans are better than those of each other one.

    Wilcoxon's test over the instances that both ran on, corrected by Holm's method for all pairs of backends,
    since which of them leads is read off the same runs. Of each the median over its seeds of the objective
    counts, as a share of the way from the best plan to the worst one of that instance: shares neither
    depend on units nor on where zero is. A plan that is as good as the best, to the gap and tolerance asked
    for, counts as 0, and no plan as 2.

    Returns
    -------
    mapping of str to RankTest
        By backend; "less" says that the leading one is better. Empty where nothing draws.
    """
    able = [one.label for one in standings if one.solved]
    several = any(len(own) > 1 for one in verdicts for own in _by_backend(one).values())
    if len(able) < 2 or not several:
        return {}
    shares: dict[str, dict[int, float]] = {}
    for index, verdict in enumerate(verdicts):
        for label, values in _shares(verdict).items():
            shares.setdefault(label, {})[index] = median(values)
    found = {}
    for one, other in combinations(able, 2):
        both = sorted(shares[one].keys() & shares[other].keys())
        if both:
            found[one, other] = compare_pairs(
                [shares[one][index] for index in both], [shares[other][index] for index in both]
            )
    return {other: test for (one, other), test in correct_tests(found).items() if one == able[0]}


def compare_on_instance(verdict: Verdict) -> tuple[str, dict[str, RankTest]]:
    """Return which backend is best on one instance, and whether its runs differ from those of the others.

    Mann and Whitney's test of the objectives, a value a seed, corrected by Holm's method for all pairs of
    backends on this instance; a run without a plan is worse than any with one.

    Returns
    -------
    best : str
        The backend with the least median; "" where no two have runs enough.
    tests : mapping of str to RankTest
        By backend; "less" says that the best one is better.
    """
    values = {
        label: [math.inf if (f := _objective(s)) is None else f for s in own]
        for label, own in _by_backend(verdict).items()
        if len(own) >= FEWEST
    }
    if len(values) < 2:
        return "", {}
    order = sorted(values, key=lambda label: (median(values[label]), label))
    pairs = {
        (one, other): compare_seeds(values[one], values[other])
        for one, other in combinations(order, 2)
    }
    tests = correct_tests(pairs)
    return order[0], {other: test for (one, other), test in tests.items() if one == order[0]}


def profile_evaluations(verdicts: Sequence[Verdict]) -> Profile:
    r"""Return data profiles of the backends that count evaluations of the objective.

    An instance is solved from the first plan on with
    :math:`f \le f_L + \tau (f_0 - f_L)`, where :math:`f_L` is the best value of all runs, :math:`f_0`
    the worst first one, and :math:`\tau` is :data:`ACCURACY`. Of several seeds the median counts. A run
    that ends without a verified plan solves nothing, and no value counts below what was verified at its end.

    References
    ----------
    J. J. Moré, S. M. Wild, SIAM Journal on Optimization 20, 2009, (2.2).
    """
    needed: dict[str, dict[int, float]] = {}
    sizes: list[int] = []
    courses = [
        {label: [_course(s) for s in own] for label, own in _by_backend(verdict).items()}
        for verdict in verdicts
    ]
    counting = {label for found in courses for label, runs in found.items() if any(map(bool, runs))}
    for verdict, found in zip(verdicts, courses, strict=True):
        begun = [run[0][0] for runs in found.values() for run in runs if run]
        known = {_variables(s) for own in _by_backend(verdict).values() for s in own if _course(s)}
        if verdict.best is None or len(known) != 1 or not (size := known.pop()):
            continue
        least = verdict.best.primal_bound
        assert least is not None
        goal = least + ACCURACY * (max(begun) - least)
        for label, runs in found.items():
            if label in counting:
                met = [next((n for f, n in run if f <= goal), math.inf) for run in runs]
                needed.setdefault(label, {})[len(sizes)] = median(met)
        sizes.append(size)
    if not needed:
        return {}
    return data_profile(
        {
            label: [own.get(index, math.inf) for index in range(len(sizes))]
            for label, own in needed.items()
        },
        sizes,
    )


def _variables(solution: Solution[Any]) -> int:
    """Return the number of variables as the run counts them, 0 where it says nothing of the kind."""
    count = solution.statistics.get("variables")
    return count if isinstance(count, int) and count > 0 else 0


def _course(solution: Solution[Any]) -> list[tuple[float, float]]:
    """Return the better plans of a run that was verified, with their evaluations, where these were counted."""
    last = _objective(solution)
    if last is None:
        return []
    return [
        (max(one.objective, last), float(one.evaluations))
        for one in solution.incumbents
        if one.evaluations
    ]


def _shares(verdict: Verdict) -> dict[str, list[float]]:
    """Return by backend, a value a run, how far from the best plan to the worst one its plan is."""
    runs = _by_backend(verdict)
    best = verdict.best
    if best is None or best.primal_bound is None:
        return {label: [NOTHING] * len(own) for label, own in runs.items()}
    least = best.primal_bound
    most = max(f for own in runs.values() for s in own if (f := _objective(s)) is not None)

    def share(solution: Solution[Any]) -> float:
        value = _objective(solution)
        if value is None:
            return NOTHING
        if value - least <= slack(solution, best):
            return 0.0
        return (value / 2 - least / 2) / (most / 2 - least / 2)  # of halves: the way may overflow

    return {label: [share(s) for s in own] for label, own in runs.items()}


def _objective(solution: Solution[Any]) -> float | None:
    return None if solution.stored_plan is None else solution.primal_bound


def _by_backend(verdict: Verdict) -> dict[str, list[Solution[Any]]]:
    """Return the runs of each backend but for references, one a seed: repeats of a seed give the same plan."""
    groups: dict[str, dict[int | None, Solution[Any]]] = {}
    for solution in verdict.solutions:
        if is_reference(solution):
            continue
        groups.setdefault(who(solution), {}).setdefault(solution.seed, solution)
    return {label: list(own.values()) for label, own in groups.items()}
