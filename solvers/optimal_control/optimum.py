"""Derivatives of a solved optimal control problem with respect to its data."""

from __future__ import annotations

from typing import Any

from ...errors import InvalidData, NoDerivative
from ...models.fields import show
from ...models.optimal_control.plan import ControlPlan
from ..contract.enums import Termination
from .prepared import PreparedSolver, prepare_control
from .sensitivity import Sensitivity

__all__ = ["sensitivity"]

#: Tolerance of the program whose KKT system is solved; it must separate active from inactive bounds.
TOLERANCE = 1e-8
#: Largest difference between its objective and that of the plan, relative to the objective's scale.
SAME = 1e-4
#: Even meshes that are tried, and their intervals in addition to those of the plan.
EVEN, FEWEST = 2, 4


def sensitivity(solution: Any, name: str) -> Sensitivity:
    """Return the derivatives of the optimum with respect to the data `name`.

    The program on the mesh of the plan is solved from the plan to a tolerance of 1e-8, and its KKT system
    is differentiated. A refined mesh has a knot at each instant at which a bound begins to bind, so the
    next node has almost no multiplier. If the derivative does not exist there, even meshes with more
    intervals are tried, whose objective must be that of the plan.

    Parameters
    ----------
    solution : Solution
        Locally optimal solution of an optimal control problem with data.
    name : str
        Name of the data.

    Returns
    -------
    Sensitivity
        Derivatives of the objective, times, parameters, states and controls.

    Raises
    ------
    InvalidData
        The solution has no control plan or no model, or the problem has no such data.
    NoDerivative
        The plan is not optimal, or not a differentiable function of the data: an active constraint has no
        multiplier (strict complementarity fails), active constraints are dependent, or the curvature
        vanishes, as on singular arcs.
    """
    model, plan = solution.source, solution.plan
    if not isinstance(plan, ControlPlan) or model is None:
        raise InvalidData(
            f"sensitivity needs a solution with a control plan and its model, got plan {show(plan)} of "
            f"model {solution.model!r}",
            field="plan",
        )
    if solution.termination not in (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL):
        raise NoDerivative(f"the plan is {solution.termination}: only an optimum has derivatives")
    kept = {k: v for k, v in solution.formulation_options.items() if k == "dependent"}
    count = max(part.states.intervals for part in plan.phases)
    meshes = [{"formulation": solution.formulation, "mesh": plan}]
    meshes += [{"intervals": FEWEST + count + k} for k in range(EVEN)]
    for number, mesh in enumerate(meshes):
        solver: PreparedSolver = prepare_control(model, tolerance=TOLERANCE, **mesh, **kept)
        step = solver(warm=plan)
        try:
            objective = solution.primal_bound
            scale = max(step.posed.program.objective_scale, abs(objective))
            if step.ok and not abs(step.objective - objective) <= SAME * scale:
                raise NoDerivative(
                    f"the program on the mesh of the plan has the objective {step.objective:.9g}, the plan "
                    f"{objective:.9g}: the mesh does not represent the plan"
                )
            return step.sensitivity(name)
        except NoDerivative as error:
            if number == 0:
                first = error
    raise first
