"""Certification: a plan that a solver of programs calls optimal is compared with the certified optimum.

The objective of an ill-conditioned program can agree with its bound to 1e-12 although the plan is far from
the optimum. A model names the exact backend that certifies plans themselves, see
:attr:`~crosstrack.models.Model.certifier`.
"""

from __future__ import annotations

from dataclasses import replace

from ...errors import InvalidData
from ...timing import OutOfTime
from ..contract.backend import Answer, Request
from ..contract.enums import Limit, Termination
from ..contract.registry import find_backend
from .running import Run

__all__ = ["DISTANCE", "SHAPE", "UNCERTIFIED", "certified"]

#: Key of the statistics: distance between the plan and the certified optimum.
DISTANCE = "distance to the certified plan"
#: Key of the statistics: why the shape of the plan is not certified.
SHAPE = "shape"
#: Its value if the certificate failed; a reason follows if the certifier does not cover the model.
UNCERTIFIED = "not certified"
#: Part of the remaining time that the certifier may take.
SHARE = 0.5


def certified(run: Run, request: Request, answer: Answer) -> Answer:
    """Return the answer, ``FEASIBLE`` instead of ``OPTIMAL`` if its plan is not the certified optimum.

    Parameters
    ----------
    run : Run
        The run, whose model names the certifier.
    request : Request
        Time limit and control of the run.
    answer : Answer
        Answer of the backend.
    """
    model, backend = run.job.model, run.target.backend
    optimal = answer.termination is Termination.OPTIMAL and answer.point is not None
    if not optimal or not model.certifier or backend.name == model.certifier:
        return answer
    certifier = find_backend(model.certifier, model)
    refusal = certifier.refuses(model)
    if refusal:
        return _noted(answer, f"{UNCERTIFIED}: {certifier.name} does not cover {refusal}")
    if request.control.stopped:
        return answer
    try:
        plan = run.decode(answer.point)
    except InvalidData:  # reported when the claim is judged
        return answer
    left = request.left()
    try:
        with run.clock("certify"):
            reference = request.within(
                certifier, model, time_limit=None if left is None else SHARE * left
            )
    except OutOfTime:  # its kernels cannot be compiled in time
        reference = Answer(Termination.NO_SOLUTION, Limit.TIME, message="no time is left")
    if reference.statistics.get("unique") == "no":
        return answer
    optimal = reference.termination is Termination.OPTIMAL
    if optimal and SHAPE in reference.statistics:  # it proves the objective only
        return _noted(answer, str(reference.statistics[SHAPE]))
    if not optimal or reference.point is None:
        reason = reference.message or f"it ended with {reference.termination}"
        doubt = f"{certifier.name} cannot certify the plan: {reason}"
        return replace(answer, termination=Termination.FEASIBLE, message=_joined(answer, doubt))
    distance = model.distance(plan, reference.point)
    statistics = {**answer.statistics, DISTANCE: distance}
    answer = replace(answer, statistics=statistics)
    if distance <= model.certified_distance:
        return answer
    doubt = (
        f"the plan is {distance:.2g} of the extent away from the optimum that {certifier.name} certifies "
        f"(accepted: {model.certified_distance:g}); take {certifier.name}"
    )
    return replace(answer, termination=Termination.FEASIBLE, message=_joined(answer, doubt))


def _noted(answer: Answer, shape: str) -> Answer:
    return replace(answer, statistics={**answer.statistics, SHAPE: shape})


def _joined(answer: Answer, doubt: str) -> str:
    return "; ".join(filter(None, (answer.message, doubt)))
