"""Searches that draw or count evaluations, on one problem: tests of ranks and data profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import Any

from ..solution import Solution
from ..verdict import Verdict
from .profiles import Profile, data_profile
from .standing import Standing, who
from .statistics import FEWEST, RankTest, compare_pairs, compare_seeds, correct_tests

__all__ = ["ACCURACY", "compare_on_instance", "compare_with_leader", "profile_evaluations"]

#: How much of the way from the first to the best value is left where a data profile calls an
#: instance solved; Moré and Wild draw 1e-1 to 1e-5.
ACCURACY = 1e-3


def compare_with_leader(
    verdicts: Sequence[Verdict], standings: Sequence[Standing]
) -> dict[str, RankTest]:
    """Return whether the leading backend's plans are better than those of each other one.

    Wilcoxon's test over the instances that both ran on, corrected by Holm's method. Of each the median
    over its seeds of the objective counts, as a share of the way from the best plan to the worst one of
    that instance: shares neither depend on units nor on where zero is. No plan counts as 1.

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
    first, *rest = able
    for label in rest:
        both = sorted(shares[first].keys() & shares[label].keys())
        if both:
            found[label] = compare_pairs(
                [shares[first][index] for index in both], [shares[label][index] for index in both]
            )
    return correct_tests(found)


def compare_on_instance(verdict: Verdict) -> tuple[str, dict[str, RankTest]]:
    """Return which backend is best on one instance, and whether its runs differ from those of the others.

    Mann and Whitney's test of the objectives, a value a seed, corrected by Holm's method; a run without
    a plan is worse than any with one.

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
    best = min(values, key=lambda label: (median(values[label]), label))
    rest = {label: own for label, own in values.items() if label != best}
    return best, correct_tests(
        {label: compare_seeds(values[best], own) for label, own in rest.items()}
    )


def profile_evaluations(verdicts: Sequence[Verdict]) -> Profile:
    r"""Return data profiles of the backends that count evaluations of the objective.

    An instance is solved from the first plan on with
    :math:`f \le f_L + \tau (f_0 - f_L)`, where :math:`f_L` is the best value of all runs, :math:`f_0`
    the worst first one, and :math:`\tau` is :data:`ACCURACY`. Of several seeds the median counts.

    References
    ----------
    J. J. Moré, S. M. Wild, SIAM Journal on Optimization 20, 2009, (2.2).
    """
    needed: dict[str, dict[int, float]] = {}
    sizes: list[int] = []
    counting = {
        who(s)
        for one in verdicts
        for s in one.solutions
        if any(i.evaluations for i in s.incumbents)
    }
    for verdict in verdicts:
        counted = [s for s in verdict.solutions if any(i.evaluations for i in s.incumbents)]
        known = {_variables(s) for s in counted}
        if verdict.best is None or len(known) != 1 or not (size := known.pop()):
            continue
        least = verdict.best.primal_bound
        assert least is not None
        first = max(s.incumbents[0].objective for s in counted)
        goal = least + ACCURACY * (first - least)
        for label, own in _by_backend(verdict).items():
            if label in counting:  # a run without a plan is one that never gets there
                met = ((i.evaluations for i in s.incumbents if i.objective <= goal) for s in own)
                runs = [next((float(n) for n in one if n), math.inf) for one in met]
                needed.setdefault(label, {})[len(sizes)] = median(runs)
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


def _shares(verdict: Verdict) -> dict[str, list[float]]:
    """Return by backend, a value a run, how far from the best plan to the worst one its plan is."""
    objectives = {
        label: [_objective(s) for s in own] for label, own in _by_backend(verdict).items()
    }
    met = [value for own in objectives.values() for value in own if value is not None]
    least, most = min(met, default=0.0), max(met, default=0.0)
    way = most - least or 1.0
    return {
        label: [1.0 if value is None else (value - least) / way for value in own]
        for label, own in objectives.items()
    }


def _objective(solution: Solution[Any]) -> float | None:
    return None if solution.stored_plan is None else solution.primal_bound


def _by_backend(verdict: Verdict) -> dict[str, list[Solution[Any]]]:
    """Return the runs of each backend, one a seed: repeats of a seed give the same plan."""
    groups: dict[str, dict[int | None, Solution[Any]]] = {}
    for solution in verdict.solutions:
        groups.setdefault(who(solution), {}).setdefault(solution.seed, solution)
    return {label: list(own.values()) for label, own in groups.items()}
