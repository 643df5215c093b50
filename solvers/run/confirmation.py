"""Confirmation: the optimum of an approximation is compared with that of a second approximation.

The objective of one sequence of meshes can converge to a value that all its meshes share although
the model has a better one. A second discretisation with other nodes does not share that
restriction. If it is started at the plan and ends at another objective, the first has not
converged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ...timing import clock
from ..contract.backend import Answer, Request
from ..contract.enums import Feature, Termination
from .running import Run
from .starts import ITERATIONS, MORE, with_iterations

__all__ = ["Confirmation", "confirm"]

#: Iterations of the second program if the first took few.
CONFIRMING = 300
#: Terminations of the second program whose objective is compared.
CONVERGED = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)


@dataclass(frozen=True)
class Confirmation:
    """Result of the comparison with a second formulation.

    Parameters
    ----------
    statistics : dict
        Name and objective of the second formulation, added to the statistics of the solution.
    finer : Formulation, optional
        The formulation to solve next, because the two objectives differ.
    failure : str
        Reason why the answer is not confirmed; empty if it is confirmed or `finer` must be solved.
    """

    statistics: dict[str, Any]
    finer: Any = None
    failure: str = ""


def confirm(run: Run, request: Request, answer: Answer, left: float | None) -> Confirmation:
    """Solve the counterpart of the current formulation from its solution, and compare objectives.

    Parameters
    ----------
    run : Run
        The run. The seconds of the comparison are added to those of its last program.
    request : Request
        The request of the program.
    answer : Answer
        Solution of the program, which the formulation accepts.
    left : float, optional
        Seconds left.

    Returns
    -------
    Confirmation
        Empty statistics if the formulation has no counterpart.
    """
    formulation = run.target.formulation
    assert formulation is not None
    counterpart = formulation.counterpart(answer.point)
    if counterpart is None:
        return Confirmation({})
    if request.control.stopped or (left is not None and left <= 0):
        return Confirmation(
            {"confirmed_by": "none"},
            failure=f"no time was left to confirm the optimum by {counterpart.name}",
        )
    begin = clock()
    most = max(CONFIRMING, ITERATIONS * int(answer.statistics.get("iterations", 0)) + MORE)
    program = counterpart.program
    warm = program.guess if Feature.WARM_START in run.target.backend.features else None
    with request.control.stage(left) as part:
        limited = with_iterations(request, most)
        other = run.attend(
            program, replace(limited, time_limit=left, control=part, warm_start=warm)
        )
    run.spent[-1] += clock() - begin
    value = other.primal_bound
    if other.termination not in CONVERGED or value is None:
        return Confirmation(
            {"confirmed_by": "none"},
            failure=(
                f"the optimum is not confirmed by {counterpart.name}: "
                f"{other.termination} after {clock() - begin:.2g} s"
            ),
        )
    statistics = {"confirmed_by": counterpart.name, "confirmed_objective": value}
    is_better = answer.primal_bound is not None and value < answer.primal_bound
    better = counterpart.decode(other.point) if is_better and other.point is not None else None
    finer = formulation.compared(answer.point, value, run.job.verification_tolerance, better)
    if finer is not None:
        return Confirmation(statistics, finer)
    if not formulation.settled:
        return Confirmation(
            {"confirmed_by": "none"},
            failure=f"{counterpart.name} ends at the objective {value:.9g} on the same mesh",
        )
    return Confirmation(statistics)
