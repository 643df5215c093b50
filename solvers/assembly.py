"""Where every :class:`Solution` is made: a claim is verified, and only what stands is kept."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData, show
from ..models.fields import frozen
from ..models.verification import Verification
from ..version import __version__
from .enums import Guarantee, Limit, Termination
from .job import GAP, Job
from .refinement import CLAIMS_NONE, CLAIMS_PLAN
from .registry import find_backend
from .solution import NOTHING, Incumbent, Solution, relative_gap, without_rounding

__all__ = ["Claim", "assemble", "claim_from_data", "claim_to_data"]

log = logging.getLogger("crosstrack")


@dataclass(frozen=True)
class Claim:
    """How a run ended, before anybody has verified it.

    Parameters
    ----------
    termination : Termination
        What the backend claims, or how the run broke off.
    limit : Limit, optional
        The limit that ended it.
    plan : object, optional
        The decoded plan.
    primal_bound, dual_bound : float, optional
        Claimed objective of the plan, and the lower bound that was proven.
    proves : bool
        Whether bounds and claims of infeasibility count.
    formulation : str, optional
        Name of the formulation that was solved.
    seconds, statistics : mapping
        As in :class:`~crosstrack.solvers.solution.Solution`.
    incumbents : tuple of Incumbent
        Better plans over time.
    duals : ndarray, optional
        Row multipliers.
    messages : tuple of str
        What a person should know.
    undecodable : bool
        Whether there was a point that stands for no plan.
    history : tuple of mapping
        As in :class:`~crosstrack.solvers.solution.Solution`.
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
    """Return the solution of `job`: the claim with its plan verified, or why nothing is left of it.

    `witness` is what answered the run's questions about hidden data; it may contradict the plan.
    """
    backend = find_backend(job.backend, job.model)
    model = job.model
    termination, plan, dual = claim.termination, claim.plan, claim.dual_bound
    messages = list(claim.messages)
    verification: Verification | None = None
    rejected: Any = None
    denied = ""
    seconds = dict(claim.seconds)
    if termination in CLAIMS_NONE:
        plan = None
        exact = backend.guarantee is Guarantee.EXACT
        if not claim.proves or (termination is Termination.UNBOUNDED and not exact):
            # What a relaxation lets grow without end may be bounded in the model.
            why = f"a {backend.guarantee} backend cannot prove" if not exact else "nothing proves"
            messages.append(f"claims {termination}, which {why}")
            termination = Termination.NO_SOLUTION
    elif plan is None and termination in CLAIMS_PLAN:
        messages.append(f"claims {termination} without a point")
        termination = Termination.FAILED
    limit, started = claim.limit, plan is None and _keeps_start(job, claim, witness)
    if started:
        plan = job.warm_start
        messages.append("the plan is the warm start")
    plan = _kept(plan)
    if plan is not None:
        begin = time.perf_counter()
        try:
            verification = model.verify(plan, tolerance=job.verification_tolerance)
            if hasattr(witness, "contradiction"):
                denied = witness.contradiction(plan)
            if denied:
                messages.append(denied)
                rejected = model.plan_to_data(plan)
            elif not verification.ok:
                messages.append(f"plan {verification.summary()}")
                if claim.history:
                    messages.append(_error_left(verification, job.verification_tolerance))
                rejected = model.plan_to_data(plan)
            elif verification.near:
                # Such a plan may break what it is said to keep.
                messages.append(f"plan {verification.summary()}")
                log.warning("%s: plan of %s %s", model.name, backend.name, verification.summary())
        except InvalidData as error:
            # It is no plan of the model: nothing of it is returned.
            messages.append(f"the point is no plan: {error}")
        seconds["verify"] = seconds.get("verify", 0.0) + time.perf_counter() - begin
    bad = claim.undecodable or bool(denied)
    bad |= plan is not None and (verification is None or not verification.ok)
    if bad:
        plan = None
        if backend.guarantee is Guarantee.RELAXATION:
            # Its point need not be a plan; its bound holds all the same.
            termination, verification, rejected = Termination.NO_SOLUTION, None, None
        else:
            termination, dual = Termination.REJECTED, None
    primal = verification.objective if plan is not None and verification is not None else None
    if plan is not None and termination in (Termination.NO_SOLUTION, Termination.FAILED):
        termination = Termination.FEASIBLE  # the run ended badly, yet its last incumbent verifies
    dual = dual if claim.proves else None
    if termination is Termination.OPTIMAL and claim.proves:
        dual = claim.primal_bound if dual is None else dual
        dual = primal if dual is None else dual
        gap = relative_gap(primal, dual)
        asked = GAP if job.gap is None else job.gap
        # A relative gap says nothing of an optimum of 0.
        apart = primal is None or dual is None or primal - dual > NOTHING
        if gap is None or (gap > asked * 1.01 + 1e-6 and apart):
            messages.append(f"claims optimal, but the verified plan leaves a gap of {gap}")
            termination = Termination.FEASIBLE
    elif termination is Termination.OPTIMAL:
        messages.append("claims optimal, which nothing proves")
        termination = Termination.FEASIBLE
    if primal is not None and dual is not None:
        assert verification is not None
        dual = without_rounding(dual, verification, job.verification_tolerance)
        gap, asked = relative_gap(primal, dual), GAP if job.gap is None else job.gap
        late = claim.limit is Limit.TIME and backend.guarantee is Guarantee.EXACT
        over = (started or late) and claim.termination is not Termination.FAILED
        if over and termination is Termination.FEASIBLE and gap is not None and gap <= asked:
            # What is known besides, a floor or a search below the cutoff, leaves nothing better.
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
        statistics=dict(claim.statistics),
        message="; ".join(text for text in messages if text),
        rejected_plan=rejected,
        duals=None if plan is None else _kept(claim.duals),
        history=claim.history,
    )


def _error_left(verification: Verification, tolerance: float) -> str:
    """Return which check is violated most, by how much, and what would accept the plan."""
    excess = verification.excess
    if not math.isfinite(excess):
        return ""
    check = max(verification.violated, key=lambda one: one.worst / one.tolerance)
    text = f"the error left: {check}, {excess:.3g} times what is accepted"
    # What the digits of the plan cannot resolve makes a check's tolerance more than its share.
    needed = 1.01 * tolerance * excess
    return f"{text}; tolerance={needed:.2g} would accept the plan" if needed < 1.0 else text


def _keeps_start(job: Job, claim: Claim, witness: Any) -> bool:
    """Return whether the warm start, where it verifies, is the plan of a run that left none."""
    backend = find_backend(job.backend, job.model)
    return (
        job.warm_start is not None
        and witness is None  # which has not seen the start
        and not claim.undecodable
        and claim.termination in (Termination.NO_SOLUTION, Termination.FAILED)
        and backend.guarantee is not Guarantee.RELAXATION
        # It may have been a guess only.
        and job.model.verify(job.warm_start, tolerance=job.verification_tolerance).ok
    )


def _kept(value: Any) -> Any:
    """Return an array of numbers as one that its backend, which may still hold it, cannot change."""
    numbers = isinstance(value, np.ndarray) and value.dtype.kind in "biuf"
    return frozen(value) if numbers else value


def claim_to_data(job: Job, claim: Claim) -> dict[str, Any]:
    """Return a claim as JSON data, for a worker that must not verify it itself."""
    plan, undecodable, messages = None, claim.undecodable, list(claim.messages)
    if claim.plan is not None:
        try:
            plan = job.model.plan_to_data(claim.plan)
        except Exception as error:  # whatever a backend that is not ours calls a plan
            undecodable = True
            messages.append(f"the point {show(claim.plan)} is no plan: {error}")
    return {
        "termination": str(claim.termination),
        "limit": None if claim.limit is None else str(claim.limit),
        "plan": plan,
        "primal_bound": claim.primal_bound,
        "dual_bound": claim.dual_bound,
        "proves": claim.proves,
        "formulation": claim.formulation,
        "seconds": dict(claim.seconds),
        "statistics": dict(claim.statistics),
        "incumbents": [[one.seconds, one.objective, one.evaluations] for one in claim.incumbents],
        "duals": None if claim.duals is None else claim.duals.tolist(),
        "messages": messages,
        "undecodable": undecodable,
        "history": [dict(row) for row in claim.history],
    }


def claim_from_data(job: Job, data: Mapping[str, Any]) -> Claim:
    """Return the claim that :func:`claim_to_data` wrote; a plan that cannot be read is none."""
    plan, undecodable, messages = None, data["undecodable"], list(data["messages"])
    if data["plan"] is not None:
        try:
            plan = job.model.plan_from_data(data["plan"])
        except InvalidData as error:
            undecodable = True
            messages.append(f"the point is no plan: {error}")
    return Claim(
        termination=Termination(data["termination"]),
        limit=None if data["limit"] is None else Limit(data["limit"]),
        plan=plan,
        primal_bound=data["primal_bound"],
        dual_bound=data["dual_bound"],
        proves=data["proves"],
        formulation=data["formulation"],
        seconds=data["seconds"],
        statistics=data["statistics"],
        incumbents=tuple(
            Incumbent(seconds, objective, evaluations=count)
            for seconds, objective, count in data["incumbents"]
        ),
        duals=None if data["duals"] is None else np.array(data["duals"], float),
        messages=tuple(messages),
        undecodable=undecodable,
        history=tuple(data["history"]),
    )
