"""Assembly of a :class:`Solution`: the claim of a run is verified before it is returned."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...lazy import moved
from ...models.fields import frozen
from ...models.verification import Verification
from ...version import __version__
from ..contract.enums import CLAIMS_NONE, CLAIMS_PLAN, Guarantee, Limit, Termination
from ..contract.job import GAP, Job
from ..contract.registry import find_backend
from ..contract.solution import Incumbent, Solution, relative_gap, without_rounding

__all__ = ["Claim", "assemble"]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(__name__, {"..processes.claims": "claim_from_data claim_to_data"})

log = logging.getLogger("crosstrack")

#: Kinds of models whose claims of infeasibility and unboundedness have a kind of proof.
PROGRAMS = ("conic-program", "mixed-integer-program", "quadratic-program")
#: Terminations of runs without a plan that do not claim that none exists.
_NO_PLAN = (Termination.NO_SOLUTION, Termination.FAILED, Termination.LOCALLY_INFEASIBLE)


@dataclass(frozen=True)
class Claim:
    """Result of a run as the backend claims it, before verification.

    Parameters
    ----------
    termination : Termination
        Termination that the backend claims, or the way the run was cut short.
    limit : Limit, optional
        The limit that ended it.
    plan : object, optional
        The decoded plan.
    primal_bound, dual_bound : float, optional
        Claimed objective of the plan, and the lower bound that was proven.
    proves : bool
        Whether the dual bound and a claim of infeasibility are proofs.
    formulation : str, optional
        Name of the formulation that was solved.
    seconds, statistics : mapping
        As in :class:`~crosstrack.solvers.contract.solution.Solution`.
    incumbents : tuple of Incumbent
        Better plans over time.
    duals : ndarray, optional
        Row multipliers.
    messages : tuple of str
        Remarks for the user.
    undecodable : bool
        Whether a point could not be decoded to a plan of the model.
    history : tuple of mapping
        As in :class:`~crosstrack.solvers.contract.solution.Solution`.
    """

    termination: Termination
    limit: Limit | None = None
    plan: Any = None
    primal_bound: float | None = None
    dual_bound: float | None = None
    proves: bool = False
    formulation: str | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    statistics: Mapping[str, Any] = field(default_factory=dict)
    incumbents: tuple[Incumbent[Any], ...] = ()
    duals: NDArray[Any] | None = None
    messages: tuple[str, ...] = ()
    undecodable: bool = False
    history: tuple[Mapping[str, Any], ...] = ()


def assemble(job: Job, claim: Claim, witness: Any = None) -> Solution[Any]:
    """Verify a claim and return the solution.

    Parameters
    ----------
    job : Job
        The run that was requested.
    claim : Claim
        The claim of the backend.
    witness : object, optional
        Oracle that answered the questions of the run about hidden data. Its method ``contradiction``
        returns a text if the plan contradicts its answers, and its method ``remarks`` statistics and a message.

    Returns
    -------
    Solution
        With a plan only if the plan verifies. A claim that is not proven is weakened: ``OPTIMAL``
        becomes ``FEASIBLE``, and ``INFEASIBLE`` becomes ``NO_SOLUTION``. The message gives the
        reason.
    """
    backend = find_backend(job.backend, job.model)
    model = job.model
    termination, plan, dual = claim.termination, claim.plan, claim.dual_bound
    messages, statistics = list(claim.messages), dict(claim.statistics)
    if hasattr(witness, "remarks"):
        counts, remark = witness.remarks()
        statistics.update(counts)
        messages.append(remark)
    verification: Verification | None = None
    rejected: Any = None
    contradiction = ""
    seconds = dict(claim.seconds)
    if termination in CLAIMS_NONE:
        plan = None
        exact = backend.guarantee is Guarantee.EXACT
        if not claim.proves or (termination is Termination.UNBOUNDED and not exact):
            # An unbounded relaxation does not imply an unbounded model.
            why = f"a {backend.guarantee} backend cannot prove" if not exact else "nothing proves"
            messages.append(f"claims {termination}, which {why}")
            termination = Termination.NO_SOLUTION
    elif plan is None and termination in CLAIMS_PLAN:
        messages.append(f"claims {termination} without a point")
        termination = Termination.FAILED
    limit = claim.limit
    starts_from_warm_start = (
        plan is None
        and termination in _NO_PLAN
        and not claim.undecodable
        and _verified_warm_start(job, witness) is not None
    )
    if starts_from_warm_start:
        plan = job.warm_start
        messages.append("the plan is the warm start")
        statistics["returned plan"] = "warm start"
    plan = _read_only(plan)
    if plan is not None:
        begin = time.perf_counter()
        try:
            verification = model.verify(plan, tolerance=job.verification_tolerance)
            if hasattr(witness, "contradiction"):
                contradiction = witness.contradiction(plan)
            if contradiction:
                messages.append(contradiction)
                rejected = model.plan_to_data(plan)
            elif not verification.ok:
                messages.append(f"plan {verification.summary()}")
                if claim.history:
                    messages.append(_error_left(verification, job.verification_tolerance))
                rejected = model.plan_to_data(plan)
            elif verification.near:
                # Within the tolerance of the solver, but not strictly feasible: warn.
                messages.append(f"plan {verification.summary()}")
                log.warning("%s: plan of %s %s", model.name, backend.name, verification.summary())
        except InvalidData as error:
            # The decoded object is not a plan of the model, so no part of it is returned.
            messages.append(f"the point is no plan: {error}")
        seconds["verify"] = seconds.get("verify", 0.0) + time.perf_counter() - begin
    bad = claim.undecodable or bool(contradiction)
    bad |= plan is not None and (verification is None or not verification.ok)
    if bad and backend.guarantee is not Guarantee.EXACT:
        # The run must not lose a plan that it was given. A wrong answer of an exact backend stays visible.
        checked = _verified_warm_start(job, witness)
        if checked is not None:
            messages.append("the plan is the warm start, because that of the run is rejected")
            statistics["returned plan"] = "warm start"
            plan, rejected, dual, bad = _read_only(job.warm_start), None, None, False
            verification = checked
            termination, claim = Termination.FEASIBLE, replace(claim, duals=None)
    if bad:
        plan = None
        if backend.guarantee is Guarantee.RELAXATION:
            # The point of a relaxation need not be a plan. Its bound is valid anyway.
            termination, verification, rejected = Termination.NO_SOLUTION, None, None
        else:
            termination, dual = Termination.REJECTED, None
    primal = verification.objective if plan is not None and verification is not None else None
    if plan is not None and termination in _NO_PLAN:
        termination = Termination.FEASIBLE  # the warm start or the last incumbent verifies
    dual = dual if claim.proves else None
    if termination is Termination.OPTIMAL and claim.proves:
        dual = claim.primal_bound if dual is None else dual
        dual = primal if dual is None else dual
        gap = relative_gap(primal, dual)
        gap_limit = GAP if job.gap is None else job.gap
        # The relative gap is meaningless for an optimum of 0.
        differs = (
            verification is None
            or primal is None
            or dual is None
            or primal - dual > verification.negligible
        )
        if gap is None or (gap > gap_limit * 1.01 + 1e-6 and differs):
            messages.append(f"claims optimal, but the verified plan leaves a gap of {gap}")
            termination = Termination.FEASIBLE
    elif termination is Termination.OPTIMAL:
        messages.append("claims optimal, which nothing proves")
        termination = Termination.FEASIBLE
    proof = ""
    if dual is not None and hasattr(model, "proven"):  # a program
        dual, proof = model.proven(dual, claim.duals, plan)
    elif termination in CLAIMS_NONE and model.kind in PROGRAMS:
        from .proofs import evidence  # loads SciPy, which native algorithms may not need

        begin = time.perf_counter()
        proof = evidence(model, termination, seconds.get("solve", 0.0))
        seconds["verify"] = seconds.get("verify", 0.0) + time.perf_counter() - begin
    if primal is not None and dual is not None:
        assert verification is not None
        dual = without_rounding(dual, verification, job.verification_tolerance)
        gap, gap_limit = relative_gap(primal, dual), GAP if job.gap is None else job.gap
        late = claim.limit is Limit.TIME and backend.guarantee is Guarantee.EXACT
        may_close = (starts_from_warm_start or late) and claim.termination is not Termination.FAILED
        if (
            may_close
            and termination is Termination.FEASIBLE
            and gap is not None
            and gap <= gap_limit
        ):
            # The bound of the starting heuristic or of the search below the cutoff closes the gap.
            termination, limit = Termination.OPTIMAL, None
    return Solution(
        model=model.kind,
        instance=model.name,
        digest=model.digest,
        backend=backend.name,
        formulation=claim.formulation,
        problem=backend.problem,
        guarantee=backend.guarantee,
        termination=termination,
        limit=limit,
        primal_bound=primal,
        dual_bound=dual,
        plan=plan,
        stored_plan=None if plan is None else partial(model.plan_to_data, plan),
        verification=verification,
        seconds=seconds,
        incumbents=claim.incumbents,
        backend_version=backend.version(),
        version=__version__,
        options=job.options(),
        formulation_options=dict(job.formulation_options),
        seed=job.seed,
        statistics=statistics,
        message="; ".join(text for text in messages if text),
        rejected_plan=rejected,
        duals=None if plan is None else _read_only(claim.duals),
        maximise=model.maximise,
        proof=proof,
        source=model,
        history=claim.history,
    )


def _error_left(verification: Verification, tolerance: float) -> str:
    """Return the check with the largest violation and the tolerance that would accept the plan."""
    excess = verification.excess
    if not math.isfinite(excess):
        return ""
    check = max(verification.violated, key=lambda item: item.worst / item.tolerance)
    text = f"the error left: {check}, {excess:.3g} times what is accepted"
    # The factor allows for the digits of the plan, which enter a check's tolerance.
    needed = 1.01 * tolerance * excess
    return f"{text}; tolerance={needed:.2g} would accept the plan" if needed < 1.0 else text


def _verified_warm_start(job: Job, witness: Any) -> Verification | None:
    """Return the verification of the warm start; None without one, or if it is infeasible."""
    if (
        job.warm_start is None
        or witness is not None  # the witness did not answer questions about the warm start
        or find_backend(job.backend, job.model).guarantee is Guarantee.RELAXATION
    ):
        return None
    checked = job.model.verify(job.warm_start, tolerance=job.verification_tolerance)
    return checked if checked.ok else None


def _read_only(value: Any) -> Any:
    """Return a numeric array as a read-only copy, because the backend may still refer to it."""
    numbers = isinstance(value, np.ndarray) and value.dtype.kind in "biuf"
    return frozen(value) if numbers else value
