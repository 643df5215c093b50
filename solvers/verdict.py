"""Do the answers on one model agree? Interval logic over verified plans and exact bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from ..models.model import Model
from ..models.verification import ROUNDING
from .backend import Guarantee, Termination
from .registry import find_backend
from .solution import Solution

__all__ = ["Outcome", "Verdict", "judge"]


#: Checks within tolerance that a note still spells out one by one.
MANY = 2
#: Excess over the best plan, in tolerances, above which a search counts as stopped at a worse point.
WORSE = 20.0


class Outcome(StrEnum):
    """What a set of answers amounts to."""

    AGREED = "AGREED"
    INCONCLUSIVE = "INCONCLUSIVE"
    CONTRADICTION = "CONTRADICTION"


@dataclass(frozen=True)
class Verdict:
    """The verdict on one model.

    Parameters
    ----------
    instance : str
        The model's name, or the start of its digest.
    outcome : Outcome
        Agreed: a verified plan and an exact proof meet, or infeasibility is proven, and nothing
        speaks against it.
    evidence : str
        Why, with the two backends of a contradiction.
    notes : tuple of str
        What a reader should know besides: plans that hang on a tolerance, backends that failed.
    solutions : tuple of Solution
        The answers.
    """

    instance: str
    outcome: Outcome
    evidence: str
    notes: tuple[str, ...]
    solutions: tuple[Solution[Any], ...]

    @property
    def best(self) -> Solution[Any] | None:
        """The best verified answer that hangs on no tolerance (any verified one failing that)."""
        ranked = sorted(
            (s for s in self.solutions if s.stored_plan is not None and s.primal_bound is not None),
            key=lambda s: (not _clean(s), s.primal_bound),
        )
        return ranked[0] if ranked else None

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON data."""
        return {
            "instance": self.instance,
            "verdict": str(self.outcome),
            "evidence": self.evidence,
            "notes": list(self.notes),
            "solutions": [solution.to_dict() for solution in self.solutions],
        }

    def __str__(self) -> str:
        from .report.tables import verdict_text

        return verdict_text(self)


def _clean(solution: Solution[Any]) -> bool:
    return solution.verification is not None and not solution.verification.within_tolerance


def _who(solution: Solution[Any]) -> str:
    return solution.backend + (f":{solution.formulation}" if solution.formulation else "")


def _exact(solution: Solution[Any], exact: frozenset[str]) -> bool:
    return solution.backend in exact


def exact_names(backends: Sequence[Any], model: Model[Any] | None = None) -> frozenset[str]:
    """Return the names of those `backends`, looked up for `model`, that are exact."""
    found = (find_backend(backend, model) for backend in backends)
    return frozenset(b.name for b in found if b.guarantee is Guarantee.EXACT)


def judge(instance: str, solutions: Sequence[Solution[Any]], exact: frozenset[str]) -> Verdict:
    """Return the verdict on the answers to one model.

    Every verified plan that violates nothing by more than rounding bounds the optimum from above;
    every bound of an exact backend claims to bound it from below. A claim above a plan is a
    contradiction, as is a claim of infeasibility beside a plan. A plan that is only within
    tolerance contradicts nobody, and the notes name the threshold it hangs on.

    Parameters
    ----------
    instance : str
        How to call the model.
    solutions : sequence of Solution
        The answers, plans verified.
    exact : frozenset of str
        Names of the exact backends, whose bounds and claims of infeasibility count.
    """
    plans = [s for s in solutions if s.stored_plan is not None and s.primal_bound is not None]
    clean = [s for s in plans if _clean(s)]
    bounds = [s for s in solutions if s.dual_bound is not None and _exact(s, exact)]
    empty = [s for s in solutions if s.termination is Termination.INFEASIBLE and _exact(s, exact)]
    unbounded = [
        s for s in solutions if s.termination is Termination.UNBOUNDED and _exact(s, exact)
    ]
    notes = _notes(solutions, plans, clean, exact)

    def verdict(outcome: Outcome, evidence: str) -> Verdict:
        return Verdict(instance, outcome, evidence, tuple(notes), tuple(solutions))

    # Contradictions first: one is enough.
    if clean and empty:
        return verdict(
            Outcome.CONTRADICTION,
            f"{_who(empty[0])} claims infeasible, but {_who(clean[0])} has a verified plan of {clean[0].primal_bound:.10g}",
        )
    best = min(clean, key=lambda s: s.primal_bound, default=None)  # type: ignore[arg-type, return-value]
    proof = max(bounds, key=lambda s: s.dual_bound, default=None)  # type: ignore[arg-type, return-value]
    if best is not None and proof is not None:
        assert best.primal_bound is not None and proof.dual_bound is not None
        slack = _slack(best, proof)
        if proof.dual_bound > best.primal_bound + slack:
            return verdict(
                Outcome.CONTRADICTION,
                f"{_who(proof)} claims that no plan is below {proof.dual_bound:.10g}, but {_who(best)} has a "
                f"verified plan of {best.primal_bound:.10g}",
            )
    if unbounded and (empty or bounds):
        other = (empty or bounds)[0]
        return verdict(
            Outcome.CONTRADICTION,
            f"{_who(unbounded[0])} claims unbounded, {_who(other)} claims {other.termination}",
        )
    if best is not None and proof is not None:
        assert best.primal_bound is not None and proof.dual_bound is not None
        if proof.dual_bound >= best.primal_bound - _slack(best, proof):
            provers = [s for s in bounds if s.dual_bound >= best.primal_bound - _slack(best, s)]  # type: ignore[operator]
            holders = [s for s in clean if s.primal_bound <= best.primal_bound + _slack(best, s)]  # type: ignore[operator]
            return verdict(
                Outcome.AGREED,
                f"optimum {best.primal_bound:.10g}: plan by {_names(holders)}; bound by {_names(provers)}",
            )
        return verdict(
            Outcome.INCONCLUSIVE,
            f"best plan {best.primal_bound:.10g} ({_who(best)}), best bound {proof.dual_bound:.10g} ({_who(proof)}): "
            "no proof that they meet",
        )
    if empty:
        return verdict(Outcome.AGREED, f"infeasible, proven by {_names(empty)}")
    if unbounded:
        return verdict(Outcome.AGREED, f"unbounded, claimed by {_names(unbounded)}")
    if best is not None:
        return verdict(
            Outcome.INCONCLUSIVE,
            f"best plan {best.primal_bound:.10g} ({_who(best)}), but no exact bound",
        )
    if plans:
        least = min(plans, key=lambda s: s.primal_bound)  # type: ignore[arg-type, return-value]
        return verdict(
            Outcome.INCONCLUSIVE,
            f"the only plans hang on a tolerance: best {least.primal_bound:.10g} ({_who(least)}), "
            "no exact bound",
        )
    return verdict(Outcome.INCONCLUSIVE, "no verified plan and no proof of infeasibility")


def _names(solutions: Sequence[Solution[Any]]) -> str:
    return ", ".join(dict.fromkeys(_who(s) for s in solutions))


def _slack(plan: Solution[Any], bound: Solution[Any]) -> float:
    """Return how far a claimed bound may stand from a plan without a word: its gap and tolerance."""
    gap = max(float(bound.options.get("gap") or 0.0), ROUNDING)
    tolerance = float(bound.options.get("tolerance") or 0.0)
    return (gap + tolerance) * max(1.0, abs(plan.primal_bound or 0.0), abs(bound.dual_bound or 0.0))


def _notes(
    solutions: Sequence[Solution[Any]],
    plans: Sequence[Solution[Any]],
    clean: Sequence[Solution[Any]],
    exact: frozenset[str],
) -> list[str]:
    notes = []
    for solution in solutions:
        if (
            solution.verification is not None
            and solution.stored_plan is not None
            and not _clean(solution)
        ):
            near = solution.verification.within_tolerance
            head = f"{_who(solution)}: its plan of {solution.primal_bound:.10g} is within_tolerance only"
            if len(near) > MANY:
                notes.append(f"{head}: {', '.join(check.name for check in near)}")
            else:
                notes += [f"{head}: {check}" for check in near]
        elif solution.termination in (Termination.FAILED, Termination.REJECTED):
            notes.append(f"{_who(solution)}: {solution.termination}: {solution.message}")
    best = min(clean or plans, key=lambda s: s.primal_bound, default=None)  # type: ignore[arg-type, return-value]
    for solution in plans:
        if best is None or _exact(solution, exact):
            continue
        # A local search may be content far from the optimum; its own success says nothing of that.
        assert solution.primal_bound is not None and best.primal_bound is not None
        more = solution.primal_bound - best.primal_bound
        size = max(1.0, abs(best.primal_bound))
        if more > WORSE * max(float(solution.options.get("tolerance") or 0.0), ROUNDING) * size:
            notes.append(
                f"{_who(solution)}: stopped at a worse point, {solution.primal_bound:.10g}: "
                f"{100.0 * more / size:.2g} % above {best.primal_bound:.10g} of {_who(best)}"
            )
    return notes
