"""Integer controls from a plan of the relaxed problem, by sum-up rounding.

Sager, Bock and Reinelt, "Direct methods with maximal lower bound for mixed-integer optimal control",
Mathematical Programming 118 (2009). For sets with exactly one control equal to 1: Sager, Bock and
Diehl, "The integer approximation error in mixed-integer optimal control", Mathematical Programming
133 (2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ...errors import InvalidData
from ..fields import Whole, show
from ..verification import TOLERANCE, Verification
from .definition import entry_slices
from .piecewise import Piecewise
from .plan import ControlPlan, PhasePlan

if TYPE_CHECKING:
    from .model import OptimalControlProblem

__all__ = ["RoundedPlan", "round_controls"]

Floats = NDArray[np.float64]

#: Number of nodes per piece, of the polynomials of the simulated states and of the quadrature.
NODES = 9
#: Relative error of a step.
ERROR = 1e-12
#: Shortest distance between two knots, relative to the phase.
SHORTEST = 1e-9
#: Largest number of steps of the grid.
MOST = 100_000


@dataclass(frozen=True, eq=False)
class RoundedPlan:
    """Plan with integer-valued controls, compared with the relaxed plan.

    Parameters
    ----------
    plan : ControlPlan
        Simulated plan with integer controls that are constant between grid points.
    verification : Verification
        Verification of that plan.
    relaxed : float
        Recomputed objective of the relaxed plan.
    deviation : float
        Largest magnitude, over time and controls, of the integral of the difference between rounded
        and relaxed control.
    bound : float
        Theoretical bound of `deviation`: half a step for a separate control, n - 1 steps for n
        controls with exactly one equal to 1.
    """

    plan: ControlPlan
    verification: Verification
    relaxed: float
    deviation: float
    bound: float

    @property
    def objective(self) -> float | None:
        """Objective of the rounded plan; None if its motion cannot be computed."""
        return self.verification.objective

    @property
    def gap(self) -> float:
        """Difference between the rounded and the relaxed objective; NaN without a rounded objective.

        If the relaxed plan is a global minimum, no integer plan is better by more than this.
        """
        return np.nan if self.objective is None else self.objective - self.relaxed


def sum_up(means: Floats, lower: Floats, upper: Floats, one_of: bool) -> Floats:
    """Return integers, shape (steps, controls), whose running sums stay close to those of `means`.

    `means` are the means of the relaxed controls over the steps of an equidistant grid. If `one_of`, exactly one
    control is 1 in each step.
    """
    rounded, remainder = np.zeros_like(means), np.zeros(means.shape[1])
    for k, mean in enumerate(means):
        remainder += mean
        if one_of:
            rounded[k, int(np.argmax(remainder))] = 1.0
        else:
            rounded[k] = np.clip(np.floor(remainder + 0.5), lower, upper)
        remainder -= rounded[k]
    return rounded


def round_controls(
    model: OptimalControlProblem,
    plan: ControlPlan,
    *,
    steps: int = 200,
    one_of: Sequence[str] = (),
    tolerance: float = TOLERANCE,
) -> RoundedPlan:
    """Return the plan with its integer controls rounded on an equidistant grid, simulated and verified.

    Parameters
    ----------
    model : OptimalControlProblem
        Problem with one phase and controls that are declared ``integer=True``.
    plan : ControlPlan
        Plan of the problem with relaxed integer controls.
    steps : int
        Number of steps of the grid.
    one_of : sequence of str
        Vector controls with exactly one entry equal to 1 at every instant; their bounds are 0 and 1.
    tolerance : float
        Tolerance of the verification.

    Returns
    -------
    RoundedPlan
        The plan, its verification and its difference from the relaxed plan.

    Raises
    ------
    InvalidData
        The problem has several phases or no integer control, `one_of` is not allowed, or the motion
        with the rounded controls breaks down.

    Notes
    -----
    The rounded plan may violate final values and path constraints. If the integer controls enter
    linearly, the violation decreases with the step. The verification reports it.
    """
    plan = model.attach(plan)
    if len(plan.phases) != 1:
        raise InvalidData(f"plan must have 1 phase, got {len(plan.phases)}", field="plan")
    phase, part = model.definition.phases[0], plan.phases[0]
    steps = Whole(1, MOST).coerce("steps", steps, {})
    groups = {item.name: part for item, part in entry_slices(phase.controls) if item.integer}
    if not groups:
        raise InvalidData("model has no control that is declared integer=True", field="model")
    if any(item.algebraic for item in phase.controls):
        raise InvalidData(
            "model must have no algebraic variables, whose values would change with rounded controls",
            field="model",
        )
    lower, upper = phase.bounds("controls")
    for name in one_of:
        columns = groups.get(name)
        if columns is None or (lower[columns] != 0).any() or (upper[columns] != 1).any():
            raise InvalidData(
                f"one_of must name integer controls with bounds 0 and 1, got {show(name)}",
                field="one_of",
            )
    grid = np.linspace(part.start, part.end, steps + 1)
    previous = part.controls.knots
    distance = np.abs(
        previous[:, None] - grid[np.searchsorted(grid, previous)[:, None] - [[0, 1]]]
    ).min(axis=1)
    knots = np.union1d(grid, previous[distance > SHORTEST * part.duration])
    cell = np.searchsorted(grid, 0.5 * (knots[:-1] + knots[1:])) - 1
    tau, weights = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * np.diff(knots)
    inner = 0.5 * (knots[:-1] + knots[1:])[:, None] + half[:, None] * tau
    relaxed = part.controls(inner)
    areas = np.einsum("kr,kri->ki", half[:, None] * weights, relaxed)
    means = np.zeros((steps, areas.shape[1]))
    np.add.at(means, cell, areas / np.diff(grid)[cell][:, None])
    deviation, bound, step = 0.0, 0.0, float(part.duration / steps)
    table = relaxed.copy()
    for name, columns in groups.items():
        rounded_values = sum_up(means[:, columns], lower[columns], upper[columns], name in one_of)
        table[:, :, columns] = rounded_values[cell][:, None, :]
        difference = np.cumsum(
            2.0 * half[:, None] * rounded_values[cell] - areas[:, columns], axis=0
        )
        deviation = max(deviation, float(np.abs(difference).max()))
        bound = max(bound, step * (rounded_values.shape[1] - 1 if name in one_of else 0.5))
    controls = Piecewise(knots, (tau,) * cell.size, tuple(table), lower, upper)
    states = _simulate(part, controls)
    names = (phase.state_names, phase.control_names)
    rounded = ControlPlan((PhasePlan(phase.name, states, controls, *names),), plan.parameters)
    objective = model.verify(plan, tolerance=tolerance).objective
    return RoundedPlan(
        plan=model.attach(rounded), verification=model.verify(rounded, tolerance=tolerance),
        relaxed=np.nan if objective is None else objective, deviation=deviation, bound=bound,
    )  # fmt: skip


def _simulate(part: PhasePlan, controls: Piecewise) -> Piecewise:
    """Return the motion that `controls` produce from the initial state of `part`."""
    phase, p = part.declared, part.values
    assert phase is not None and p is not None
    knots, current = controls.knots, part.states(part.start)
    size = np.maximum(phase.stacked("states", "scale"), np.abs(current))
    positions = np.sort(np.cos(np.linspace(0.0, np.pi, NODES)))
    values = []
    for k in range(controls.intervals):
        begin, end = knots[k], knots[k + 1]

        def rate(t: float, x: Floats, k: int = k, begin: float = begin, end: float = end) -> Floats:
            u = controls.on(k, [2.0 * (t - begin) / (end - begin) - 1.0])[0]
            rates: Floats = phase.function(t, x, u, p)[0].full()[:, 0]
            return rates

        times = np.clip(begin + 0.5 * (positions + 1.0) * (end - begin), begin, end)
        solution = solve_ivp(
            rate, (begin, end), current, "DOP853", times, rtol=ERROR, atol=ERROR * size
        )
        if not solution.success or not np.isfinite(solution.y).all():
            raise InvalidData(
                f"the motion of the rounded controls breaks down after t = {begin:.6g}",
                field="plan",
            )
        values.append(solution.y.T)
        current = solution.y[:, -1]
    return Piecewise(knots, (positions,) * len(values), tuple(values))
