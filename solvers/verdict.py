"""Do the answers on one model agree? Interval logic over verified plans and exact bounds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from ..errors import CrosstrackError
from ..models.model import Model
from ..models.verification import ROUNDING
from .enums import PROVING, Guarantee, Termination
from .registry import find_backend, recommended
from .repeats import Spread, name_backend, spreads, spreads_table
from .report.tables import frame, markup, render, solutions_table
from .solution import Solution

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Outcome", "Verdict", "judge"]


#: Checks within tolerance that a note still spells out one by one.
MANY = 2
#: Excess over the best plan, in tolerances, above which a search counts as stopped at a worse point.
WORSE = 20.0
#: Excess of the default backend's plan over another, relative, above which the verdict names it.
CLEARLY = 0.05


class Outcome(StrEnum):
    """What a set of answers amounts to."""

    #: A verified plan and a proof meet, infeasibility is proven, or estimates agree.
    AGREED = "AGREED"
    #: No verified plan, or no proof that it is the best.
    INCONCLUSIVE = "INCONCLUSIVE"
    #: A proof speaks against a verified plan: one of the two backends is wrong.
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
        What a reader should know besides: plans that depend on a tolerance, backends that failed.
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
        """The best verified answer that depends on no tolerance (any verified one failing that)."""
        ranked = sorted(
            (s for s in self.solutions if s.stored_plan is not None and s.primal_bound is not None),
            key=lambda s: (not _clean(s), s.primal_bound),
        )
        return ranked[0] if ranked else None

    @property
    def spreads(self) -> tuple[Spread, ...]:
        """Quartiles and successes of every backend that ran more than once."""
        return spreads(self.solutions)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON data."""
        repeated = [spread.to_dict() for spread in self.spreads]
        return {
            "instance": self.instance,
            "verdict": str(self.outcome),
            "evidence": self.evidence,
            "notes": list(self.notes),
            **({"repeats": repeated} if repeated else {}),
            "solutions": [solution.to_dict() for solution in self.solutions],
        }

    def parts(self) -> list[Any]:
        """Return what to print: a table of the answers, the verdict and its notes."""
        lines = [f"{self.outcome}: {self.evidence}", *(f"  note: {note}" for note in self.notes)]
        repeated = self.spreads
        return [
            solutions_table(self.solutions, self.instance),
            *([spreads_table(repeated)] if repeated else []),
            "\n".join(lines),
        ]

    def summary(self) -> str:
        """Return the answers and the verdict as text."""
        return render(*self.parts(), width=140)

    def to_frame(self) -> DataFrame:
        """Return the answers as a pandas frame, one a row; needs pandas."""
        return frame(self.solutions)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return markup(*self.parts())


def _clean(solution: Solution[Any]) -> bool:
    return solution.verification is not None and not solution.verification.within_tolerance


def _who(solution: Solution[Any]) -> str:
    return name_backend(solution.backend, solution.formulation)


def _guarantee(solution: Solution[Any], model: Model[Any] | None) -> Guarantee | None:
    """Return what the backend of a solution proves; records of earlier versions do not say."""
    if solution.guarantee is not None:
        return solution.guarantee
    try:
        return find_backend(solution.backend, model).guarantee
    except CrosstrackError:
        return None  # a record of a backend that is not here any more proves nothing


def judge(
    instance: str, solutions: Sequence[Solution[Any]], model: Model[Any] | None = None
) -> Verdict:
    """Return the verdict on the answers to one model.

    Every verified plan that violates nothing by more than rounding bounds the optimum from above;
    every bound of an exact backend or of a relaxation claims to bound it from below. A claim above a
    plan is a contradiction, as is a claim of infeasibility beside a plan. A plan that is only within
    tolerance contradicts nobody, and the notes name the threshold it depends on; one whose objective
    is sampled contradicts nobody inside its spread. Where nobody proves a bound, plans agree when
    the model's own distance between them is within its :attr:`~crosstrack.models.Model.agreement`.

    Parameters
    ----------
    instance : str
        How to call the model.
    solutions : sequence of Solution
        The answers, plans verified.
    model : Model, optional
        What was asked; without it plans are not compared with one another.
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

    def verdict(outcome: Outcome, evidence: str) -> Verdict:
        return Verdict(instance, outcome, evidence + warning, tuple(notes), tuple(solutions))

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
    agreement = _agreement(plans, model)
    if agreement is not None:
        return verdict(*agreement)
    if best is not None:
        return verdict(
            Outcome.INCONCLUSIVE,
            f"best plan {best.primal_bound:.10g} ({_who(best)}), but no exact bound",
        )
    if plans:
        least = min(plans, key=lambda s: s.primal_bound)  # type: ignore[arg-type, return-value]
        return verdict(
            Outcome.INCONCLUSIVE,
            f"the only plans depend on a tolerance: best {least.primal_bound:.10g} ({_who(least)}), "
            "no exact bound",
        )
    return verdict(Outcome.INCONCLUSIVE, "no verified plan and no proof of infeasibility")


def _default_is_worse(model: Model[Any] | None, clean: Sequence[Solution[Any]]) -> str:
    """Return a clause if the recommended backend's plan is clearly worse than another one."""
    # The objective of an estimate does not rank estimates by their distance to the truth.
    if model is None or model.agreement is not None or len(clean) < 2:
        return ""
    try:
        default = recommended(model).name
    except CrosstrackError:
        return ""
    own = [s for s in clean if s.backend == default]
    best = min(clean, key=_value)
    if not own or best.backend == default:
        return ""
    mine = min(own, key=_value)
    more = _value(mine) - _value(best)
    more -= 0.0 if mine.verification is None else mine.verification.spread
    size = max(_scale(best), abs(_value(best)))
    if more <= CLEARLY * size:
        return ""
    far = f"{100.0 * more / size:.0f} %" if size > 0 else f"{more:.3g}"
    return (
        f"; the default backend {_who(mine)} has {_value(mine):.10g}, {far} worse than {_who(best)}"
    )


def _value(solution: Solution[Any]) -> float:
    return math.inf if solution.primal_bound is None else float(solution.primal_bound)


def _agreement(
    plans: Sequence[Solution[Any]], model: Model[Any] | None
) -> tuple[Outcome, str] | None:
    """Return whether plans of different backends agree, None where the model cannot say."""
    if model is None or model.agreement is None:
        return None
    first = {_who(s): s for s in reversed(plans) if s.plan is not None}
    pairs = list(itertools.combinations(first.values(), 2))
    if not pairs:
        return None
    far, one, other = max(
        ((model.distance(a.plan, b.plan), a, b) for a, b in pairs), key=lambda found: found[0]
    )
    if far <= model.agreement:
        return Outcome.AGREED, (
            f"plans of {_names(list(first.values()))} agree within {far:.3g} (allowed "
            f"{model.agreement:g}): agreement, not optimality"
        )
    return Outcome.INCONCLUSIVE, (
        f"plans of {_who(one)} and {_who(other)} differ by {far:.3g} (allowed {model.agreement:g}), "
        "and no bound says which is right"
    )


def _names(solutions: Sequence[Solution[Any]]) -> str:
    return ", ".join(dict.fromkeys(_who(s) for s in solutions))


def _slack(plan: Solution[Any], bound: Solution[Any]) -> float:
    """Return how far a bound may stand above a plan: its gap and tolerance, and the plan's spread."""
    gap = max(float(bound.options.get("gap") or 0.0), ROUNDING)
    tolerance = float(bound.options.get("tolerance") or 0.0)
    spread = 0.0 if plan.verification is None else plan.verification.spread
    size = max(_scale(plan), abs(plan.primal_bound or 0.0), abs(bound.dual_bound or 0.0))
    return (gap + tolerance) * size + spread


def _scale(plan: Solution[Any]) -> float:
    """Return what differences of objectives are held against where the objectives are less."""
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
            head = f"{_who(solution)}: its plan of {solution.primal_bound:.10g} is within_tolerance only"
            if len(near) > MANY:
                notes.append(f"{head}: {', '.join(check.name for check in near)}")
            else:
                notes += [f"{head}: {check}" for check in near]
        elif solution.termination in (Termination.FAILED, Termination.REJECTED):
            notes.append(f"{_who(solution)}: {solution.termination}: {solution.message}")
    best = min(clean or plans, key=lambda s: s.primal_bound, default=None)  # type: ignore[arg-type, return-value]
    least: dict[str, Solution[Any]] = {}
    for solution in searches:
        held = least.setdefault(_who(solution), solution)
        if (solution.primal_bound or 0.0) < (held.primal_bound or 0.0):
            least[_who(solution)] = solution
    for solution in least.values():
        if best is None:
            continue
        # A local search may be content far from the optimum; its own success says nothing of that.
        assert solution.primal_bound is not None and best.primal_bound is not None
        more = solution.primal_bound - best.primal_bound
        size = max(_scale(best), abs(best.primal_bound))
        more -= 0.0 if solution.verification is None else solution.verification.spread
        if more > WORSE * max(float(solution.options.get("tolerance") or 0.0), ROUNDING) * size:
            far = f"{100.0 * more / size:.2g} %" if size > 0 else f"{more:.3g}"
            notes.append(
                f"{_who(solution)}: stopped at a worse point, {solution.primal_bound:.10g}: "
                f"{far} above {best.primal_bound:.10g} of {_who(best)}"
            )
    return notes
