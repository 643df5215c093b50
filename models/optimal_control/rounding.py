"""Controls that take whole numbers only, from a plan of the relaxed problem by sum-up rounding.

Sager, Bock and Reinelt, "Direct methods with maximal lower bound for mixed-integer optimal control",
Mathematical Programming 118 (2009); for sets of which exactly one is 1: Sager, Bock and Diehl, "The
integer approximation error in mixed-integer optimal control", Mathematical Programming 133 (2012).
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
from .piecewise import Piecewise
from .plan import ControlPlan, PhasePlan

if TYPE_CHECKING:
    from .model import OptimalControlProblem

__all__ = ["RoundedPlan", "round_controls"]

Floats = NDArray[np.float64]

#: Nodes of the polynomials of the flown states, and of the quadrature, in each piece.
NODES = 9
#: Relative error of a step.
ERROR = 1e-12
#: Shortest piece between two knots, relative to the phase.
SHORTEST = 1e-9
#: Most steps of the grid.
MOST = 100_000


@dataclass(frozen=True, eq=False)
class RoundedPlan:
    """A plan whose integer controls are whole numbers, beside the relaxed one.

    Parameters
    ----------
    plan : ControlPlan
        The flown plan; its integer controls are constant between the points of the grid.
    verification : Verification
        Of that plan against the problem, its objective recomputed.
    relaxed : float
        Objective of the relaxed plan, recomputed.
    deviation : float
        Largest magnitude, over time and controls, of the integral of rounded less relaxed control.
    bound : float
        What the theory allows it to be: half a step for a control by itself, n - 1 steps for n of
        which exactly one is 1.
    """

    plan: ControlPlan
    verification: Verification
    relaxed: float
    deviation: float
    bound: float

    @property
    def objective(self) -> float | None:
        """Objective of the rounded plan; None where its motion cannot be measured."""
        return self.verification.objective

    @property
    def gap(self) -> float:
        """By how much the rounded objective exceeds the relaxed one (nan where there is none).

        Where the relaxed plan is a global minimum, no plan of whole numbers is better by more.
        """
        return np.nan if self.objective is None else self.objective - self.relaxed


def sum_up(means: Floats, lower: Floats, upper: Floats, one_of: bool) -> Floats:
    """Return whole numbers, (steps, controls), whose running sums stay close to those of `means`.

    Parameters
    ----------
    means : ndarray, shape (steps, controls)
        Mean of each relaxed control over each step of an even grid.
    lower, upper : ndarray, shape (controls,)
        Bounds, whole numbers.
    one_of : bool
        Whether exactly one control is 1 in each step.
    """
    rounded, owed = np.zeros_like(means), np.zeros(means.shape[1])
    for k, mean in enumerate(means):
        owed += mean
        if one_of:
            rounded[k, int(np.argmax(owed))] = 1.0
        else:
            rounded[k] = np.clip(np.floor(owed + 0.5), lower, upper)
        owed -= rounded[k]
    return rounded


def round_controls(
    model: OptimalControlProblem,
    plan: ControlPlan,
    *,
    steps: int = 200,
    one_of: Sequence[str] = (),
    tolerance: float = TOLERANCE,
) -> RoundedPlan:
    """Return the plan whose integer controls are rounded on an even grid, flown and verified.

    Parameters
    ----------
    model : OptimalControlProblem
        A problem of one phase with controls that are declared ``integer=True``.
    plan : ControlPlan
        A plan of it, whose integer controls may take any value between their bounds.
    steps : int
        Steps of the grid.
    one_of : sequence of str
        Vector controls of which exactly one entry is 1 at every instant; their bounds are 0 and 1.
    tolerance : float
        Of the verification.

    Raises
    ------
    InvalidData
        The problem has several phases or no integer control, `one_of` names something else, or the
        rounded control's motion breaks down.

    Notes
    -----
    Final values and path constraints may be missed, by an amount that falls with the step where the
    integer controls enter linearly; the verification says so.
    """
    plan = model.attach(plan)
    if len(plan.phases) != 1:
        raise InvalidData(f"plan must have 1 phase, got {len(plan.phases)}", field="plan")
    phase, part = model.definition.phases[0], plan.phases[0]
    steps = Whole(1, MOST).coerce("steps", steps, {})
    groups, at = {}, 0
    for one in phase.controls:
        if one.integer:
            groups[one.name] = slice(at, at + one.size)
        at += one.size
    if not groups:
        raise InvalidData("model has no control that is declared integer=True", field="model")
    lower, upper = phase.bounds("controls")
    for name in one_of:
        own = groups.get(name)
        if own is None or (lower[own] != 0).any() or (upper[own] != 1).any():
            raise InvalidData(
                f"one_of must name integer controls with bounds 0 and 1, got {show(name)}",
                field="one_of",
            )
    grid = np.linspace(part.start, part.end, steps + 1)
    old = part.controls.knots
    apart = np.abs(old[:, None] - grid[np.searchsorted(grid, old)[:, None] - [[0, 1]]]).min(axis=1)
    knots = np.union1d(grid, old[apart > SHORTEST * part.duration])
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
    for name, own in groups.items():
        whole = sum_up(means[:, own], lower[own], upper[own], name in one_of)
        table[:, :, own] = whole[cell][:, None, :]
        owed = np.cumsum(2.0 * half[:, None] * whole[cell] - areas[:, own], axis=0)
        deviation = max(deviation, float(np.abs(owed).max()))
        bound = max(bound, step * (whole.shape[1] - 1 if name in one_of else 0.5))
    controls = Piecewise(knots, (tau,) * cell.size, tuple(table), lower, upper)
    states = _flown(part, controls)
    names = (phase.state_names, phase.control_names)
    rounded = ControlPlan((PhasePlan(phase.name, states, controls, *names),), plan.parameters)
    found = model.verify(plan, tolerance=tolerance).objective
    return RoundedPlan(
        plan=model.attach(rounded),
        verification=model.verify(rounded, tolerance=tolerance),
        relaxed=np.nan if found is None else found,
        deviation=deviation,
        bound=bound,
    )


def _flown(part: PhasePlan, controls: Piecewise) -> Piecewise:
    """Return the motion that `controls` make from the first state of `part`."""
    phase, p = part.declared, part.values
    assert phase is not None and p is not None
    knots, here = controls.knots, part.states(part.start)
    size = np.maximum(phase.stacked("states", "scale"), np.abs(here))
    at = np.sort(np.cos(np.linspace(0.0, np.pi, NODES)))
    values = []
    for k in range(controls.intervals):
        begin, end = knots[k], knots[k + 1]

        def rate(t: float, x: Floats, k: int = k, begin: float = begin, end: float = end) -> Floats:
            u = controls.on(k, [2.0 * (t - begin) / (end - begin) - 1.0])[0]
            found: Floats = phase.function(t, x, u, p)[0].full()[:, 0]
            return found

        times = np.clip(begin + 0.5 * (at + 1.0) * (end - begin), begin, end)
        flown = solve_ivp(rate, (begin, end), here, "DOP853", times, rtol=ERROR, atol=ERROR * size)
        if not flown.success or not np.isfinite(flown.y).all():
            raise InvalidData(
                f"the motion of the rounded controls breaks down after t = {begin:.6g}",
                field="plan",
            )
        values.append(flown.y.T)
        here = flown.y[:, -1]
    return Piecewise(knots, (at,) * len(values), tuple(values))
