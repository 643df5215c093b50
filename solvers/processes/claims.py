"""Claims as JSON data, for the channel between a worker process and its caller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...errors import InvalidData, show
from ..contract.enums import Limit, Termination
from ..contract.job import Job
from ..contract.solution import Incumbent
from ..run.assembly import Claim

__all__ = ["claim_from_data", "claim_to_data"]


def claim_to_data(job: Job, claim: Claim) -> dict[str, Any]:
    """Return a claim as JSON data, for the channel between a worker process and its caller.

    Parameters
    ----------
    job : Job
        The run, whose model encodes the plan.
    claim : Claim
        The claim. It is not verified here.
    """
    plan, undecodable, messages = None, claim.undecodable, list(claim.messages)
    if claim.plan is not None:
        try:
            plan = job.model.plan_to_data(claim.plan)
        except Exception as error:  # the plan of an external backend can be any object
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
        "incumbents": [
            [incumbent.seconds, incumbent.objective, incumbent.evaluations]
            for incumbent in claim.incumbents
        ],
        "duals": None if claim.duals is None else claim.duals.tolist(),
        "messages": messages,
        "undecodable": undecodable,
        "history": [dict(row) for row in claim.history],
    }


def claim_from_data(job: Job, data: Mapping[str, Any]) -> Claim:
    """Return the claim written by :func:`claim_to_data`.

    Parameters
    ----------
    job : Job
        The run, whose model decodes the plan.
    data : mapping
        JSON data.

    Returns
    -------
    Claim
        If the plan cannot be decoded, `undecodable` is true and a message gives the reason.
    """
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
