"""Comparison of randomised searches on one problem: rank tests and data profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from statistics import median
from typing import Any

from ..contract.solution import Solution
from ..contract.verdict import Verdict
from .profiles import Profile, data_profile
from .standing import Standing, is_reference, slack, who
from .statistics import FEWEST, RankTest, compare_pairs, compare_seeds, correct_tests

__all__ = ["ACCURACY", "compare_on_instance", "compare_with_leader", "profile_evaluations"]

#: Accuracy of a solved instance in a data profile: the share of the distance from the first to the
#: best value that may remain. Moré and Wild use 1e-1 to 1e-5.
ACCURACY = 1e-3
#: Value of a run without a plan, on a scale with 1 for the worst plan.
NOTHING = 2.0


def compare_with_leader(
    verdicts: Sequence[Verdict], standings: Sequence[Standing]
) -> dict[str, RankTest]:
    """Test whether the plans of the leading backend are better than those of each other backend.

    Wilcoxon's signed-rank test over the instances that both ran on, corrected by Holm's method for
    all pairs of backends, because the leader is determined from the same runs. Each value is a
    median over seeds of the objective, scaled to 0 for the best plan of the instance and 1 for the
    worst one, which is independent of units and origin. A plan as good as the best, up to gap and
    tolerance, is 0; a run without a plan is 2.

    Parameters
    ----------
    verdicts : sequence of Verdict
        One per instance.
    standings : sequence of Standing
        The backends, the leader first.

    Returns
    -------
    mapping of str to RankTest
        Tests by backend. "less" means that the leader is better. Empty without randomised runs.
    """
    labels = [standing.label for standing in standings if standing.solved]
    several = any(len(runs) > 1 for verdict in verdicts for runs in _by_backend(verdict).values())
    if len(labels) < 2 or not several:
        return {}
    shares: dict[str, dict[int, float]] = {}
    for index, verdict in enumerate(verdicts):
        for label, values in _shares(verdict).items():
            shares.setdefault(label, {})[index] = median(values)
    tests = {}
    for left, right in combinations(labels, 2):
        both = sorted(shares[left].keys() & shares[right].keys())
        if both:
            tests[left, right] = compare_pairs(
                [shares[left][index] for index in both], [shares[right][index] for index in both]
            )
    leader = labels[0]
    return {right: test for (left, right), test in correct_tests(tests).items() if left == leader}


def compare_on_instance(verdict: Verdict) -> tuple[str, dict[str, RankTest]]:
    """Test whether the runs of the best backend on one instance differ from those of the others.

    Mann and Whitney's test of the objectives, one value per seed, corrected by Holm's method for all
    pairs of backends on this instance. A run without a plan is worse than every run with one.

    Parameters
    ----------
    verdict : Verdict
        The answers on the instance.

    Returns
    -------
    best : str
        Backend with the lowest median; empty if fewer than two backends have enough runs.
    tests : mapping of str to RankTest
        Tests by backend. "less" means that the best backend is better.
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
        (left, right): compare_seeds(values[left], values[right])
        for left, right in combinations(order, 2)
    }
    tests = correct_tests(pairs)
    return order[0], {right: test for (left, right), test in tests.items() if left == order[0]}


def profile_evaluations(verdicts: Sequence[Verdict]) -> Profile:
    r"""Return data profiles of the backends that count evaluations of the objective.

    An instance is solved by the first plan with :math:`f \le f_L + \tau (f_0 - f_L)`, with the best
    value :math:`f_L` of all runs, the worst first value :math:`f_0`, and :math:`\tau` equal to
    :data:`ACCURACY`. The median over seeds is used. A run without a verified plan solves no
    instance, and claimed values below its verified objective are raised to it.

    Parameters
    ----------
    verdicts : sequence of Verdict
        One per instance.

    Returns
    -------
    mapping of str to (ndarray, ndarray)
        Profiles by backend, see :func:`data_profile`.

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
    counting = {
        label
        for runs_by_label in courses
        for label, runs in runs_by_label.items()
        if any(map(bool, runs))
    }
    for verdict, runs_by_label in zip(verdicts, courses, strict=True):
        first_values = [run[0][0] for runs in runs_by_label.values() for run in runs if run]
        variables = {
            _variables(s) for own in _by_backend(verdict).values() for s in own if _course(s)
        }
        if verdict.best is None or len(variables) != 1 or not (size := variables.pop()):
            continue
        lowest = verdict.best.primal_bound
        assert lowest is not None
        goal = lowest + ACCURACY * (max(first_values) - lowest)
        for label, runs in runs_by_label.items():
            if label in counting:
                solved_at = [next((n for f, n in run if f <= goal), math.inf) for run in runs]
                needed.setdefault(label, {})[len(sizes)] = median(solved_at)
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
    """Return the number of variables that the run reports, 0 if it reports none."""
    count = solution.statistics.get("variables")
    return count if isinstance(count, int) and count > 0 else 0


def _course(solution: Solution[Any]) -> list[tuple[float, float]]:
    """Return (objective, evaluations) of the incumbents of a verified run, if it counted them."""
    last = _objective(solution)
    if last is None:
        return []
    return [
        (max(incumbent.objective, last), float(incumbent.evaluations))
        for incumbent in solution.incumbents
        if incumbent.evaluations
    ]


def _shares(verdict: Verdict) -> dict[str, list[float]]:
    """Return one value per run and backend: 0 for the best plan, 1 for the worst one."""
    runs = _by_backend(verdict)
    best = verdict.best
    if best is None or best.primal_bound is None:
        return {label: [NOTHING] * len(own) for label, own in runs.items()}
    lowest = best.primal_bound
    highest = max(f for own in runs.values() for s in own if (f := _objective(s)) is not None)

    def share(solution: Solution[Any]) -> float:
        value = _objective(solution)
        if value is None:
            return NOTHING
        if value - lowest <= slack(solution, best):
            return 0.0
        # Of halves, because the difference may overflow.
        return (value / 2 - lowest / 2) / (highest / 2 - lowest / 2)

    return {label: [share(s) for s in own] for label, own in runs.items()}


def _objective(solution: Solution[Any]) -> float | None:
    return None if solution.stored_plan is None else solution.primal_bound


def _by_backend(verdict: Verdict) -> dict[str, list[Solution[Any]]]:
    """Return one run per backend and seed, without references: repeats of a seed give equal plans."""
    groups: dict[str, dict[int | None, Solution[Any]]] = {}
    for solution in verdict.solutions:
        if is_reference(solution):
            continue
        groups.setdefault(who(solution), {}).setdefault(solution.seed, solution)
    return {label: list(own.values()) for label, own in groups.items()}
