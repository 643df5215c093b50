"""Verdict on the answers to one model, by interval logic over verified plans and proven bounds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from ...errors import CrosstrackError
from ...models.model import Model
from ...models.verification import ROUNDING
from ..report.tables import Printable, frame, solutions_table
from .enums import PROVING, Guarantee, Termination
from .evidence import kind_of_proof, strongest
from .registry import find_backend
from .repeats import Spread, name_backend, spreads, spreads_table
from .selection import recommended
from .solution import Solution

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Outcome", "Verdict", "judge", "worst_outcome"]


#: Number of checks within tolerance up to which a note describes each of them.
MANY = 2
#: Excess over the best plan, in tolerances, above which a note reports that a search stopped early.
WORSE = 20.0
#: Relative excess of the default backend's plan above which the verdict reports it.
CLEARLY = 0.05


class Outcome(StrEnum):
    """Result of comparing a set of answers."""

    #: A verified plan and a proof agree, infeasibility is proven, or estimates agree.
    AGREED = "AGREED"
    #: There is no verified plan, or no proof that the best one is optimal.
    INCONCLUSIVE = "INCONCLUSIVE"
    #: A proof contradicts a verified plan: one of the two backends is wrong.
    CONTRADICTION = "CONTRADICTION"


@dataclass(frozen=True)
class Verdict(Printable):
    """Verdict on the answers to one model.

    Parameters
    ----------
    instance : str
        Name of the model, or the start of its digest.
    outcome : Outcome
        The outcome.
    evidence : str
        Reason of the outcome; for a contradiction, with both backends.
    notes : tuple of str
        Further remarks, such as plans that depend on a tolerance, and failed backends.
    solutions : tuple of Solution
        The answers.
    proof : str
        Kind of evidence for the best bound, or for infeasibility, of a program: a value of
        :class:`~crosstrack.models.programs.certificates.Proof`. It is "solver's bound, cross-checked" if
        exact backends of two different solvers agree. Empty for other models and without a bound.
    """

    instance: str
    outcome: Outcome
    evidence: str
    notes: tuple[str, ...]
    solutions: tuple[Solution[Any], ...]
    proof: str = ""

    @property
    def best(self) -> Solution[Any] | None:
        """Best verified answer, preferably one that does not depend on a tolerance; None without any."""
        ranked = sorted(
            (s for s in self.solutions if s.stored_plan is not None and s.primal_bound is not None),
            key=lambda s: (not _clean(s), s.primal_bound),
        )
        return ranked[0] if ranked else None

    @property
    def spreads(self) -> tuple[Spread, ...]:
        """Quartiles and success rates of every backend that ran more than once."""
        return spreads(self.solutions)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON data."""
        repeated = [spread.to_dict() for spread in self.spreads]
        return {
            "instance": self.instance,
            "verdict": str(self.outcome),
            "evidence": self.evidence,
            "notes": list(self.notes),
            **({"proof": self.proof} if self.proof else {}),
            **({"repeats": repeated} if repeated else {}),
            "solutions": [solution.to_dict() for solution in self.solutions],
        }

    def parts(self) -> list[Any]:
        """Return the printable parts: a table of the answers, the verdict and its notes."""
        lines = [f"{self.outcome}: {self.evidence}", *(f"  note: {note}" for note in self.notes)]
        repeated = self.spreads
        return [
            solutions_table(self.solutions, self.instance),
            *([spreads_table(repeated)] if repeated else []),
            "\n".join(lines),
        ]

    def to_frame(self) -> DataFrame:
        """Return the answers as a pandas data frame with one row per answer. Requires pandas."""
        return frame(self.solutions)


def worst_outcome(verdicts: Sequence[Verdict], interrupted: bool) -> Outcome:
    """Return the worst outcome of all verdicts, so that a single contradiction decides."""
    outcomes = {verdict.outcome for verdict in verdicts}
    for outcome in (Outcome.CONTRADICTION, Outcome.INCONCLUSIVE):
        if outcome in outcomes:
            return outcome
    return Outcome.AGREED if outcomes and not interrupted else Outcome.INCONCLUSIVE


def _clean(solution: Solution[Any]) -> bool:
    return solution.verification is not None and not solution.verification.within_tolerance


def _who(solution: Solution[Any]) -> str:
    return name_backend(solution.backend, solution.formulation)


def _guarantee(solution: Solution[Any], model: Model[Any] | None) -> Guarantee | None:
    """Return the guarantee of a solution's backend, which records of earlier versions do not store."""
    if solution.guarantee is not None:
        return solution.guarantee
    try:
        return find_backend(solution.backend, model).guarantee
    except CrosstrackError:
        return None  # a backend that is no longer installed proves nothing


def judge(
    instance: str, solutions: Sequence[Solution[Any]], model: Model[Any] | None = None
) -> Verdict:
    """Return the verdict on the answers to one model.

    Every verified plan without violations beyond rounding is an upper bound on the optimum. Every
    bound of an exact backend or a relaxation is a claimed lower bound. A claim above a plan is a
    contradiction, as is a claim of infeasibility if there is a plan. A plan that satisfies its
    checks only within tolerance contradicts no claim, and a note names the check. A plan with a
    sampled objective contradicts no claim within its spread. If no backend proves a bound, plans
    agree if the model's distance between them is at most its
    :attr:`~crosstrack.models.Model.agreement`.

    Parameters
    ----------
    instance : str
        Name for the model in the verdict.
    solutions : sequence of Solution
        The answers, with verified plans.
    model : Model, optional
        The model. Without it, plans are not compared with each other.
    """
    kinds = {id(s): _guarantee(s, model) for s in solutions}
    plans = [s for s in solutions if s.stored_plan is not None and s.primal_bound is not None]
    clean = [s for s in plans if _clean(s)]
    proving = [s for s in solutions if kinds[id(s)] in PROVING]
    bounds = [s for s in proving if s.dual_bound is not None]
    empty = [s for s in proving if s.termination is Termination.INFEASIBLE]
    unbounded = [
        s
        for s in proving
        if s.termination is Termination.UNBOUNDED and kinds[id(s)] is Guarantee.EXACT
    ]
    searches = [s for s in plans if kinds[id(s)] is not Guarantee.EXACT]
    if model is not None and model.agreement is not None:
        searches = []  # an estimate that is further from the truth has not stopped too early
    notes = _notes(solutions, plans, clean, searches)
    warning = _default_is_worse(model, clean)

    def verdict(outcome: Outcome, evidence: str, proof: str = "") -> Verdict:
        kind = f" ({proof})" if proof else ""
        text = f"{evidence}{kind}{warning}"
        return Verdict(instance, outcome, text, tuple(notes), tuple(solutions), proof)

    # Contradictions first, because a single one decides.
    if clean and empty:
        return verdict(
            Outcome.CONTRADICTION,
            f"{_who(empty[0])} claims infeasible, but {_who(clean[0])} has a verified plan of {clean[0].value:.10g}",
        )
    best = min(clean, key=lambda s: s.primal_bound, default=None)  # type: ignore[arg-type, return-value]
    proof = max(bounds, key=lambda s: s.dual_bound, default=None)  # type: ignore[arg-type, return-value]
    if best is not None and proof is not None:
        assert best.primal_bound is not None and proof.dual_bound is not None
        slack = _slack(best, proof)
        if proof.dual_bound > best.primal_bound + slack:
            return verdict(
                Outcome.CONTRADICTION,
                f"{_who(proof)} claims that no plan is {'above' if proof.maximise else 'below'} "
                f"{proof.bound:.10g}, but {_who(best)} has a verified plan of {best.value:.10g}",
            )
    if unbounded and (empty or bounds):
        other = (empty or bounds)[0]
        return verdict(
            Outcome.CONTRADICTION,
            f"{_who(unbounded[0])} claims unbounded, {_who(other)} claims {other.termination}",
        )
    if best is not None and proof is not None:
        assert best.primal_bound is not None and proof.dual_bound is not None
        least = proof.dual_bound - _slack(best, proof)
        exact = [s for s in bounds if kinds[id(s)] is Guarantee.EXACT]
        near = [s for s in exact if s.dual_bound is not None and s.dual_bound >= least]
        if proof.dual_bound >= best.primal_bound - _slack(best, proof):
            provers = [s for s in bounds if s.dual_bound >= best.primal_bound - _slack(best, s)]  # type: ignore[operator]
            holders = [s for s in clean if s.primal_bound <= best.primal_bound + _slack(best, s)]  # type: ignore[operator]
            return verdict(
                Outcome.AGREED,
                f"optimum {best.value:.10g}: plan by {_names(holders)}; bound by {_names(provers)}",
                kind_of_proof(proof, near),
            )
        return verdict(
            Outcome.INCONCLUSIVE,
            f"best plan {best.value:.10g} ({_who(best)}), best bound {proof.bound:.10g} ({_who(proof)}): "
            "no proof that they meet",
            kind_of_proof(proof, near),
        )
    if empty:
        kind = strongest(s.proof for s in empty)
        return verdict(Outcome.AGREED, f"infeasible, proven by {_names(empty)}", kind)
    if unbounded:
        kind = strongest(s.proof for s in unbounded)
        return verdict(Outcome.AGREED, f"unbounded, claimed by {_names(unbounded)}", kind)
    agreement = _agreement(plans, model)
    if agreement is not None:
        return verdict(*agreement)
    if best is not None:
        return verdict(
            Outcome.INCONCLUSIVE,
            f"best plan {best.value:.10g} ({_who(best)}), but no exact bound",
        )
    if plans:
        lowest = min(plans, key=lambda s: s.primal_bound)  # type: ignore[arg-type, return-value]
        return verdict(
            Outcome.INCONCLUSIVE,
            f"the only plans depend on a tolerance: best {lowest.value:.10g} ({_who(lowest)}), "
            "no exact bound",
        )
    return verdict(Outcome.INCONCLUSIVE, "no verified plan and no proof of infeasibility")


def _default_is_worse(model: Model[Any] | None, clean: Sequence[Solution[Any]]) -> str:
    """Return a clause if the plan of the recommended backend is clearly worse than another one."""
    # The objective of an estimate does not rank estimates by their distance to the truth.
    if model is None or model.agreement is not None or len(clean) < 2:
        return ""
    try:
        default = recommended(model).name
    except CrosstrackError:
        return ""
    of_default = [s for s in clean if s.backend == default]
    best = min(clean, key=_value)
    if not of_default or best.backend == default:
        return ""
    default_plan = min(of_default, key=_value)
    excess = _value(default_plan) - _value(best)
    excess -= 0.0 if default_plan.verification is None else default_plan.verification.spread
    size = max(_scale(best), abs(_value(best)))
    if excess <= CLEARLY * size:
        return ""
    text = f"{100.0 * excess / size:.0f} %" if size > 0 else f"{excess:.3g}"
    return f"; the default backend {_who(default_plan)} has {default_plan.value:.10g}, {text} worse than {_who(best)}"


def _value(solution: Solution[Any]) -> float:
    return math.inf if solution.primal_bound is None else float(solution.primal_bound)


def _agreement(
    plans: Sequence[Solution[Any]], model: Model[Any] | None
) -> tuple[Outcome, str] | None:
    """Return the outcome for plans of different backends; None if the model defines no agreement."""
    if model is None or model.agreement is None:
        return None
    first = {_who(s): s for s in reversed(plans) if s.plan is not None}
    pairs = list(itertools.combinations(first.values(), 2))
    if not pairs:
        return None
    difference, left, right = max(
        ((model.distance(a.plan, b.plan), a, b) for a, b in pairs), key=lambda entry: entry[0]
    )
    if difference <= model.agreement:
        return Outcome.AGREED, (
            f"plans of {_names(list(first.values()))} agree within {difference:.3g} (allowed "
            f"{model.agreement:g}): agreement, not optimality"
        )
    return Outcome.INCONCLUSIVE, (
        f"plans of {_who(left)} and {_who(right)} differ by {difference:.3g} (allowed {model.agreement:g}), "
        "and no bound says which is right"
    )


def _names(solutions: Sequence[Solution[Any]]) -> str:
    return ", ".join(dict.fromkeys(_who(s) for s in solutions))


def _slack(plan: Solution[Any], bound: Solution[Any]) -> float:
    """Return how far a bound may exceed a plan: its gap and tolerance, and the plan's spread."""
    gap = max(float(bound.options.get("gap") or 0.0), ROUNDING)
    tolerance = float(bound.options.get("tolerance") or 0.0)
    spread = 0.0 if plan.verification is None else plan.verification.spread
    size = max(_scale(plan), abs(plan.primal_bound or 0.0), abs(bound.dual_bound or 0.0))
    return (gap + tolerance) * size + spread


def _scale(plan: Solution[Any]) -> float:
    """Return the smallest scale of the objective, for relative differences of small objectives."""
    return 1.0 if plan.verification is None else plan.verification.scale


def _notes(
    solutions: Sequence[Solution[Any]],
    plans: Sequence[Solution[Any]],
    clean: Sequence[Solution[Any]],
    searches: Sequence[Solution[Any]],
) -> list[str]:
    notes = []
    for solution in solutions:
        if (
            solution.verification is not None
            and solution.stored_plan is not None
            and not _clean(solution)
        ):
            near = solution.verification.within_tolerance
            head = f"{_who(solution)}: its plan of {solution.value:.10g} is within_tolerance only"
            if len(near) > MANY:
                notes.append(f"{head}: {', '.join(check.name for check in near)}")
            else:
                notes += [f"{head}: {check}" for check in near]
        elif solution.termination in (Termination.FAILED, Termination.REJECTED):
            notes.append(f"{_who(solution)}: {solution.termination}: {solution.message}")
    best = min(clean or plans, key=lambda s: s.primal_bound, default=None)  # type: ignore[arg-type, return-value]
    lowest: dict[str, Solution[Any]] = {}
    for solution in searches:
        former = lowest.setdefault(_who(solution), solution)
        if (solution.primal_bound or 0.0) < (former.primal_bound or 0.0):
            lowest[_who(solution)] = solution
    for solution in lowest.values():
        if best is None:
            continue
        # A local search may stop far from the optimum without noticing it.
        assert solution.primal_bound is not None and best.primal_bound is not None
        excess = solution.primal_bound - best.primal_bound
        size = max(_scale(best), abs(best.primal_bound))
        excess -= 0.0 if solution.verification is None else solution.verification.spread
        if excess > WORSE * max(float(solution.options.get("tolerance") or 0.0), ROUNDING) * size:
            text = f"{100.0 * excess / size:.2g} %" if size > 0 else f"{excess:.3g}"
            notes.append(
                f"{_who(solution)}: stopped at a worse point, {solution.value:.10g}: "
                f"{text} {'below' if best.maximise else 'above'} {best.value:.10g} of {_who(best)}"
            )
    return notes
