"""How backends stand on one problem: what they solved, how fast, and their profiles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import mean, median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import CrosstrackError
from ...models.problems import model_type
from ...models.verification import ROUNDING
from ..enums import Termination
from ..registry import find_backend
from ..repeats import name_backend, own_options
from ..report.fitting import FittedTable
from ..report.tables import seconds_text, table
from ..solution import Solution
from ..verdict import Outcome, Verdict, judge
from .profiles import performance_profile
from .statistics import primal_integral, shifted_geometric_mean, success_interval

__all__ = [
    "REFERENCE", "TOO_LATE", "Standing", "are_rivals", "is_reference", "measured_seconds", "rank", "slack", "who",
]  # fmt: skip

#: Why an answer of a backend that sees hidden data is not counted.
REFERENCE = "reference: sees hidden data"
#: Why an answer as good as the best is not counted.
TOO_LATE = "past its limit of time"
#: What says that there is no better answer.
_PROOFS = (Termination.OPTIMAL, Termination.INFEASIBLE, Termination.UNBOUNDED)
#: Seconds of a run as a share of its limit above which it did not keep to it.
LATE = 1.1
#: Seconds of a run at the least: no clock resolves less.
_LEAST = 1e-6
#: Share of the objective above the best from which no percentage is told.
_FAR = 9.95


class Standing(NamedTuple):
    """One backend, with its formulation, on the instances of one problem.

    Parameters
    ----------
    label : str
        The backend with its formulation.
    runs, instances, of : int
        How many runs there were, on how many instances, and how many instances there are.
    solved, proven, best, fastest : int
        How many instances more than half of the runs solved, on how many a run proved its answer, on
        how many a run's plan is the best of all, and on how many it was fastest.
    typical, median : float
        Shifted geometric mean of the seconds over all instances, and their median over its own.
    integral : float, optional
        Mean over all instances of the primal integral, as a share of the limit of time, in [0, 1]; None
        where no instance has a plan.
    profile : sequence of (float, float)
        Its performance profile.
    answers : sequence of (Solution, str)
        Its answers, each with why it is not solved, "" where it is.
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
        """Return it as JSON data, seconds in seconds, without the answers."""
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
    """Return a table of the backends that lead each problem, `most` of each."""
    rows = [
        (
            kind if place == 0 else "",
            one.label,
            f"{one.solved} of {one.of}",
            one.proven,
            one.best,
            one.fastest,
            seconds_text(one.typical),
            "" if one.integral is None else f"{100 * one.integral:.3g} %",
        )
        for kind, found in standings.items()
        for place, one in enumerate(found[:most])
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
    """Return the backend with its formulation, and the options of its own that were set."""
    return name_backend(solution.backend, solution.formulation, own_options(solution))


def measured_seconds(solution: Solution[Any]) -> float | None:
    """Return the seconds that count: of building and solving, or of the whole call where they are not known.

    What a native algorithm prepares is part of its solving, so the program of a solver counts as well.
    """
    parts = solution.seconds
    if "solve" not in parts:
        return parts.get("total")
    return parts["solve"] + parts.get("build", 0.0) + parts.get("refine", 0.0)


def rank(verdicts: Sequence[Verdict]) -> list[Standing]:
    """Return how every backend stands on the instances of one problem, the leading one first.

    What sees hidden data, such as an oracle, is a reference and no rival: it is left out. Where backends
    answer different questions, each verified plan counts as solved, and none as the best. Most solved
    first, then the least typical seconds. Repeats of a seed count as their median, and so do the seeds of an
    instance; what is not solved, or not run, counts as the largest limit of time.
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
    #: What a failure counts as on each instance, for those that did not run as well.
    limits: list[float] = []
    for index, verdict in enumerate(verdicts):
        least = verdict.best
        took: dict[str, float] = {}
        top = math.inf if least is None else _value(least) + ROUNDING * _size(least)
        for label in dict.fromkeys(map(who, verdict.solutions)):
            own = [
                (s, _failure(s, verdict, s if alone else least))
                for s in verdict.solutions
                if who(s) == label
            ]
            answers.setdefault(label, []).extend(own)
            took[label] = max(_usual(own), _LEAST)
            proven[label] += any(not why and s.termination in _PROOFS for s, why in own)
            if least is not None and not alone:
                best[label] += any(
                    not why and s.primal_bound is not None and s.primal_bound <= top
                    for s, why in own
                )
            measures.setdefault(label, {})[index] = took[label]
        first = min(took.values())
        fastest.update(label for label, value in took.items() if value == first < math.inf)
        allowed = [float(s.options.get("time_limit") or 0.0) for s in verdict.solutions]
        spent = [measured_seconds(s) or 0.0 for s in verdict.solutions]
        limits.append(max(*allowed, _LEAST) if any(allowed) else max(*spent, _LEAST))
        if least is not None:
            for label in took:
                runs = [
                    _integral(s, s if alone else least, limits[-1])
                    for s in verdict.solutions
                    if who(s) == label
                ]
                integrals.setdefault(label, {})[index] = median(runs)
    # What a backend did not run counts as not solved: nobody gains by staying away.
    profiles = performance_profile(
        {
            label: [own.get(index, math.inf) for index in range(len(verdicts))]
            for label, own in measures.items()
        }
    )
    far = max(float(places[-1]) for places, _ in profiles.values())
    found: list[Standing] = []
    planned = {index for own in integrals.values() for index in own}
    for label, own in answers.items():
        ran = measures[label]
        times = [min(ran.get(index, math.inf), limit) for index, limit in enumerate(limits)]
        found.append(
            Standing(
                label, len(own), len(ran), len(verdicts), sum(map(math.isfinite, ran.values())),
                proven[label], best[label], fastest[label], shifted_geometric_mean(times),
                median(times[index] for index in ran),
                mean(integrals.get(label, {}).get(i, 1.0) for i in planned) if planned else None, _points(*profiles[label], far), own,
            )
        )  # fmt: skip
    return sorted(found, key=lambda one: (-one.solved, one.typical))


def are_rivals(kind: str) -> bool:
    """Return whether all backends for a kind of model answer one question; where it is unknown, they do."""
    try:
        return bool(model_type(kind).rivals)
    except CrosstrackError:
        return True


def is_reference(solution: Solution[Any]) -> bool:
    """Return whether an answer's backend sees what its model hides; one that is not installed does not."""
    try:
        return find_backend(solution.backend, problem=solution.problem or None).sees_hidden
    except CrosstrackError:
        return False


def _without_references(verdict: Verdict) -> Verdict:
    """Return the verdict on the backends that see no more than a model shows."""
    fair = [one for one in verdict.solutions if not is_reference(one)]
    return verdict if len(fair) == len(verdict.solutions) else judge(verdict.instance, fair)


def _integral(solution: Solution[Any], least: Solution[Any], limit: float) -> float:
    """Return the primal integral of a run as a share of the limit of time; `least` is the best one."""
    if solution.stored_plan is None or solution.primal_bound is None:
        return 1.0
    scale = 1.0 if least.verification is None else least.verification.scale
    ended = min(measured_seconds(solution) or 0.0, limit)
    # What is claimed on the way counts as far as it does not fall below what was verified.
    course = [(i.seconds, max(i.objective, solution.primal_bound)) for i in solution.incumbents]
    course.append((ended, solution.primal_bound))
    return primal_integral(course, _value(least), limit, scale) / limit


def _value(least: Solution[Any]) -> float:
    assert least.primal_bound is not None
    return least.primal_bound


def _size(least: Solution[Any]) -> float:
    """Return what differences to the best objective are relative to."""
    scale = 1.0 if least.verification is None else least.verification.scale
    return max(abs(_value(least)), scale)


def slack(solution: Solution[Any], least: Solution[Any]) -> float:
    """Return by how much an answer may be above the best plan `least` and be as good.

    As verdicts do: relative to the objective or to its scale, beside what sampling explains.
    """
    spread = 0.0 if least.verification is None else least.verification.spread
    asked = sum(float(solution.options.get(name) or 0.0) for name in ("gap", "tolerance"))
    return max(asked, ROUNDING) * _size(least) + spread


def _usual(own: Sequence[tuple[Solution[Any], str]]) -> float:
    """Return the median over seeds of the median over the repeats of each; inf where that failed."""
    seeds: dict[int | None, list[float]] = {}
    for solution, why in own:
        seconds = math.inf if why else measured_seconds(solution) or 0.0
        seeds.setdefault(solution.seed, []).append(seconds)
    return median(median(one) for one in seeds.values())


def _failure(solution: Solution[Any], verdict: Verdict, least: Solution[Any] | None) -> str:
    """Return why an answer is not solved, "" where it is; `least` is the best one."""
    if solution.termination in (Termination.FAILED, Termination.REJECTED):
        return str(solution.termination)
    wrong = verdict.outcome is Outcome.CONTRADICTION
    claims = (Termination.INFEASIBLE, Termination.UNBOUNDED)
    if least is None or least.primal_bound is None:
        if solution.termination not in claims or verdict.outcome is Outcome.INCONCLUSIVE:
            return "no plan"
        # Agreed is one claim; the other is wrong.
        agreed = verdict.evidence.startswith(str(solution.termination))
        return "" if agreed and not wrong else "contradicted"
    size, near = _size(least), slack(solution, least)
    if wrong and solution.dual_bound is not None:
        if solution.dual_bound > least.primal_bound + near:
            return "wrong bound"
    if wrong and solution.termination in claims:
        return f"wrong: {solution.termination}"
    if solution.stored_plan is None or solution.primal_bound is None:
        return "no plan"
    worse = solution.primal_bound - least.primal_bound
    if worse <= near:
        limit = float(solution.options.get("time_limit") or math.inf)
        return TOO_LATE if (measured_seconds(solution) or 0.0) > LATE * limit else ""
    size = abs(least.primal_bound) or size
    return f"{100 * worse / size:.2g} % above best" if worse < _FAR * size else "far above best"


def _points(
    places: NDArray[np.float64], shares: NDArray[np.float64], far: float
) -> list[tuple[float, float]]:
    """Return a profile as points that end at `far`, none where nothing was solved."""
    if not shares[-1]:
        return []
    return list(zip([*places.tolist(), far], [*shares.tolist(), float(shares[-1])], strict=True))
