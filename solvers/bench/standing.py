"""Standings of the backends on one problem: solved instances, seconds and profiles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from statistics import mean, median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import CrosstrackError
from ...models.problems import model_type
from ...models.verification import ROUNDING
from ..contract.backend import Backend
from ..contract.enums import Termination
from ..contract.registry import find_backend, session
from ..contract.repeats import name_backend, own_options
from ..contract.solution import Solution
from ..contract.verdict import Outcome, Verdict, judge
from ..report.fitting import FittedTable
from ..report.tables import seconds_text, table
from .profiles import performance_profile
from .statistics import primal_integral, shifted_geometric_mean, success_interval

__all__ = [
    "REFERENCE", "TOO_LATE", "Standing", "are_rivals", "is_reference", "measured_seconds", "rank", "slack", "who",
]  # fmt: skip

#: Reason why an answer of a backend that sees hidden data is not ranked.
REFERENCE = "reference: sees hidden data"
#: Reason why an answer as good as the best is not solved.
TOO_LATE = "past its time limit"
#: Terminations that prove that no better answer exists.
_PROOFS = (Termination.OPTIMAL, Termination.INFEASIBLE, Termination.UNBOUNDED)
#: Share of the time limit above which a run has exceeded it.
LATE = 1.1
#: Smallest seconds of a run, the resolution of a clock.
_LEAST = 1e-6
#: Relative excess over the best objective above which no percentage is given.
_FAR = 9.95


class Standing(NamedTuple):
    """Results of one backend, with its formulation, on the instances of one problem.

    Parameters
    ----------
    label : str
        Backend with its formulation.
    runs, instances, of : int
        Number of runs, of instances with runs, and of all instances.
    solved, proven, best, fastest : int
        Number of instances that more than half of the runs solved, that have a run with a proven
        answer, that have a run with the best plan of all, and on which the backend was fastest.
    typical, median : float
        Shifted geometric mean of the seconds over all instances, and median over the instances with
        runs.
    integral : float, optional
        Mean over all instances of the primal integral, as a share of the time limit, in [0, 1]; None
        if no instance has a plan.
    profile : sequence of (float, float)
        Performance profile.
    answers : sequence of (Solution, str)
        Answers, each with the reason why it is not solved, empty if it is.
    """

    label: str
    runs: int
    instances: int
    of: int
    solved: int
    proven: int
    best: int
    fastest: int
    typical: float
    median: float
    integral: float | None
    profile: Sequence[tuple[float, float]]
    answers: Sequence[tuple[Solution[Any], str]]

    def to_dict(self) -> dict[str, Any]:
        """Return the results as JSON data, without the answers."""
        low, high = success_interval(self.solved, self.of)
        return {
            "backend": self.label,
            "runs": self.runs,
            "instances": self.instances,
            "of": self.of,
            "solved": self.solved,
            "proven": self.proven,
            "rate": [low, high],
            "best": self.best,
            "fastest": self.fastest,
            "typical": self.typical,
            "median": self.median,
            "gap_over_time": self.integral,
            "profile": [list(point) for point in self.profile],
        }


def standings_table(standings: Mapping[str, Sequence[Standing]], most: int = 3) -> FittedTable:
    """Return a table of the best `most` backends of each problem."""
    rows = [
        (
            kind if place == 0 else "",
            standing.label,
            f"{standing.solved} of {standing.of}",
            standing.proven,
            standing.best,
            standing.fastest,
            seconds_text(standing.typical),
            "" if standing.integral is None else f"{100 * standing.integral:.3g} %",
        )
        for kind, ranked in standings.items()
        for place, standing in enumerate(ranked[:most])
    ]
    columns = (
        "problem",
        "backend",
        "solved",
        "proven",
        "best\nplan",
        "fastest",
        "typical\ntime",
        "gap over\ntime",
    )
    return table("", columns, rows, right=columns[2:])


def who(solution: Solution[Any]) -> str:
    """Return the name of the backend with its formulation and its options."""
    return name_backend(solution.backend, solution.formulation, own_options(solution))


def measured_seconds(solution: Solution[Any]) -> float | None:
    """Return the seconds to build and solve, or of the whole call if the parts are unknown.

    Building is included because native algorithms do their preparation while solving.

    Parameters
    ----------
    solution : Solution
        The answer.
    """
    parts = solution.seconds
    if "solve" not in parts:
        return parts.get("total")
    return parts["solve"] + parts.get("build", 0.0) + parts.get("refine", 0.0)


def rank(verdicts: Sequence[Verdict]) -> list[Standing]:
    """Return the standings of all backends on the instances of one problem, the leading one first.

    They are sorted by the number of solved instances, then by typical seconds. Backends that see
    hidden data, such as an oracle, are references and are omitted. If backends answer different
    questions, each verified plan is solved, and none is the best. The median over repeats, and then
    over seeds, represents an instance. An instance that is not solved, or not run, has the largest
    time limit.

    Parameters
    ----------
    verdicts : sequence of Verdict
        One per instance.
    """
    verdicts = [fair for verdict in verdicts if (fair := _without_references(verdict)).solutions]
    if not verdicts:
        return []
    alone = not are_rivals(verdicts[0].solutions[0].model)
    answers: dict[str, list[tuple[Solution[Any], str]]] = {}
    measures: dict[str, dict[int, float]] = {}
    best: Counter[str] = Counter()
    fastest: Counter[str] = Counter()
    proven: Counter[str] = Counter()
    integrals: dict[str, dict[int, float]] = {}
    #: Seconds of a failure on each instance, also for backends that did not run on it.
    limits: list[float] = []
    for index, verdict in enumerate(verdicts):
        best_answer = verdict.best
        seconds: dict[str, float] = {}
        top = (
            math.inf if best_answer is None else _value(best_answer) + ROUNDING * _size(best_answer)
        )
        runs: dict[str, list[Solution[Any]]] = {}
        for s in verdict.solutions:
            runs.setdefault(who(s), []).append(s)
        for label, solutions in runs.items():
            own = [(s, _failure(s, verdict, s if alone else best_answer)) for s in solutions]
            answers.setdefault(label, []).extend(own)
            seconds[label] = max(_usual(own), _LEAST)
            proven[label] += any(not why and s.termination in _PROOFS for s, why in own)
            if best_answer is not None and not alone:
                best[label] += any(
                    not why and s.primal_bound is not None and s.primal_bound <= top
                    for s, why in own
                )
            measures.setdefault(label, {})[index] = seconds[label]
        first = min(seconds.values())
        fastest.update(label for label, value in seconds.items() if value == first < math.inf)
        allowed = [float(s.options.get("time_limit") or 0.0) for s in verdict.solutions]
        spent = [measured_seconds(s) or 0.0 for s in verdict.solutions]
        limits.append(max(*allowed, _LEAST) if any(allowed) else max(*spent, _LEAST))
        if best_answer is not None:
            for label, solutions in runs.items():
                integrals.setdefault(label, {})[index] = median(
                    _integral(s, s if alone else best_answer, limits[-1]) for s in solutions
                )
    # An instance without a run is not solved, so that omitting it is no advantage.
    profiles = performance_profile(
        {
            label: [own.get(index, math.inf) for index in range(len(verdicts))]
            for label, own in measures.items()
        }
    )
    far = max(float(places[-1]) for places, _ in profiles.values())
    standings: list[Standing] = []
    planned = {index for own in integrals.values() for index in own}
    for label, own in answers.items():
        measured = measures[label]
        times = [min(measured.get(index, math.inf), limit) for index, limit in enumerate(limits)]
        standings.append(
            Standing(
                label, len(own), len(measured), len(verdicts), sum(map(math.isfinite, measured.values())),
                proven[label], best[label], fastest[label], shifted_geometric_mean(times),
                median(times[index] for index in measured),
                mean(integrals.get(label, {}).get(i, 1.0) for i in planned) if planned else None, _points(*profiles[label], far), own,
            )
        )  # fmt: skip
    return sorted(standings, key=lambda standing: (-standing.solved, standing.typical))


def are_rivals(kind: str) -> bool:
    """Return True if all backends for a kind of model answer the same question, or if it is unknown."""
    try:
        return bool(model_type(kind).rivals)
    except CrosstrackError:
        return True


def is_reference(solution: Solution[Any]) -> bool:
    """Return True if the backend of an answer sees hidden data; False if it is not installed."""
    return _sees_hidden(solution.backend, solution.problem or None, tuple(session()))


@lru_cache
def _sees_hidden(backend: str, problem: str | None, _session: tuple[Backend, ...]) -> bool:
    """Cached: a campaign has many answers per backend. A backend of the session may hide another."""
    try:
        return find_backend(backend, problem=problem).sees_hidden
    except CrosstrackError:
        return False


def _without_references(verdict: Verdict) -> Verdict:
    """Return the verdict on the backends that do not see hidden data."""
    fair = [solution for solution in verdict.solutions if not is_reference(solution)]
    return verdict if len(fair) == len(verdict.solutions) else judge(verdict.instance, fair)


def _integral(solution: Solution[Any], best_answer: Solution[Any], limit: float) -> float:
    """Return the primal integral of a run as a share of the time limit."""
    if solution.stored_plan is None or solution.primal_bound is None:
        return 1.0
    scale = 1.0 if best_answer.verification is None else best_answer.verification.scale
    ended = min(measured_seconds(solution) or 0.0, limit)
    # Claimed objectives are raised to the verified one.
    course = [(i.seconds, max(i.objective, solution.primal_bound)) for i in solution.incumbents]
    course.append((ended, solution.primal_bound))
    return primal_integral(course, _value(best_answer), limit, scale) / limit


def _value(best_answer: Solution[Any]) -> float:
    assert best_answer.primal_bound is not None
    return best_answer.primal_bound


def _size(best_answer: Solution[Any]) -> float:
    """Return the magnitude to which differences from the best objective are relative."""
    scale = 1.0 if best_answer.verification is None else best_answer.verification.scale
    return max(abs(_value(best_answer)), scale)


def slack(solution: Solution[Any], best_answer: Solution[Any]) -> float:
    """Return the excess over the best plan up to which an answer is as good as the best.

    As in verdicts, it is relative to the objective or its scale, plus the spread of sampling.

    Parameters
    ----------
    solution : Solution
        The answer, whose gap and tolerance are used.
    best_answer : Solution
        The best answer.
    """
    spread = 0.0 if best_answer.verification is None else best_answer.verification.spread
    accepted = sum(float(solution.options.get(name) or 0.0) for name in ("gap", "tolerance"))
    return max(accepted, ROUNDING) * _size(best_answer) + spread


def _usual(own: Sequence[tuple[Solution[Any], str]]) -> float:
    """Return the median over seeds of the median over repeats; inf for a failure."""
    seeds: dict[int | None, list[float]] = {}
    for solution, why in own:
        seconds = math.inf if why else measured_seconds(solution) or 0.0
        seeds.setdefault(solution.seed, []).append(seconds)
    return median(median(times) for times in seeds.values())


def _failure(solution: Solution[Any], verdict: Verdict, best_answer: Solution[Any] | None) -> str:
    """Return the reason why an answer is not solved, empty if it is."""
    if solution.termination in (Termination.FAILED, Termination.REJECTED):
        return str(solution.termination)
    wrong = verdict.outcome is Outcome.CONTRADICTION
    claims = (Termination.INFEASIBLE, Termination.UNBOUNDED)
    if best_answer is None or best_answer.primal_bound is None:
        if solution.termination not in claims or verdict.outcome is Outcome.INCONCLUSIVE:
            return "no plan"
        # The verdict agrees on one of the two claims; the other is wrong.
        agreed = verdict.evidence.startswith(str(solution.termination))
        return "" if agreed and not wrong else "contradicted"
    size, accepted = _size(best_answer), slack(solution, best_answer)
    if wrong and solution.dual_bound is not None:
        if solution.dual_bound > best_answer.primal_bound + accepted:
            return "wrong bound"
    if wrong and solution.termination in claims:
        return f"wrong: {solution.termination}"
    if solution.stored_plan is None or solution.primal_bound is None:
        return "no plan"
    excess = solution.primal_bound - best_answer.primal_bound
    if excess <= accepted:
        limit = float(solution.options.get("time_limit") or math.inf)
        return TOO_LATE if (measured_seconds(solution) or 0.0) > LATE * limit else ""
    size = abs(best_answer.primal_bound) or size
    side = "below best" if solution.maximise else "above best"
    return f"{100 * excess / size:.2g} % {side}" if excess < _FAR * size else f"far {side}"


def _points(
    places: NDArray[np.float64], shares: NDArray[np.float64], far: float
) -> list[tuple[float, float]]:
    """Return a profile as points that end at `far`; empty if no instance was solved."""
    if not shares[-1]:
        return []
    return list(zip([*places.tolist(), far], [*shares.tolist(), float(shares[-1])], strict=True))
