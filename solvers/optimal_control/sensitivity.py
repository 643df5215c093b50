"""Derivatives of a solution with respect to its data, by the implicit function theorem.

A local optimum is a differentiable function of the data if its active constraints are independent,
their multipliers are not 0 (strict complementarity), and the Lagrangian has curvature along all other
directions (second order). The derivative solves the KKT system. Fiacco, "Introduction to Sensitivity
and Stability Analysis in Nonlinear Programming" (1983), theorem 3.2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import splu

from ...errors import InvalidData, NoDerivative
from ...models.fields import Text
from ...models.optimal_control.definition import entry_slices
from ...models.optimal_control.plan import ControlPlan, Piecewise, Signal
from ..programs.casadi_plugins import vector
from .parametric import Point

__all__ = ["Sensitivity", "differentiate"]

Floats = NDArray[np.float64]

#: Scaled slack and multiplier that are treated as 0 after a Newton step. The error of the step is the square
#: of the error left by a barrier, which is at most 1e-4.
WEAK = 1e-7
DEPENDENT = "constraints that hold depend on one another: their multipliers are not unique"
#: Weights of the constraints for the test of curvature; success with any of them is a proof.
WEIGHTS = (1e4, 1e6, 1e8)
#: Smallest pivot that proves curvature, relative to the largest second derivative.
FLAT = 1e-9
#: Relative move of the columns for differences of polynomials, on which all but slopes depend linearly.
MOVE = 1e-5


def _polynomials(signal: Signal) -> Piecewise:
    """Return the polynomials of a state or control; declared expressions have none."""
    if not isinstance(signal.source, Piecewise):
        raise InvalidData(
            "the sensitivity of a signal is that of a state or control; an output, path constraint or "
            "invariant follows from theirs",
            field="name",
        )
    return signal.source


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a solution with respect to the entries of one of its data.

    Attributes
    ----------
    point : Point
        Solution.
    name : str
        Name of the data.
    objective : ndarray, shape (size,)
        Derivative of the objective, from the multipliers.
    columns : ndarray, shape (columns, size)
        Derivatives of the program's columns.
    times : ndarray, shape (phases, 2, size)
        Derivatives of each phase's start and end.
    parameters : dict of str to ndarray, shape (entries, size)
        Derivatives of the optimised parameters by name.
    """

    point: Point
    name: str
    objective: Floats
    columns: Floats

    @property
    def times(self) -> Floats:
        """Derivatives of each phase's start and end."""
        phases = self.point.posed.formulation.layout.phases
        return np.stack([self.columns[phase.time_columns] for phase in phases])

    @property
    def parameters(self) -> dict[str, Floats]:
        """Derivatives of the optimised parameters by name."""
        columns = self.point.posed.formulation.layout.parameter_columns
        result = {}
        for item, places in entry_slices(self.point.posed.model.definition.parameters):
            if not item.given:
                result[item.name] = self.columns[columns[places]]
        return result

    def __call__(self, name: str, t: ArrayLike, *, phase: str | None = None) -> Floats:
        """Return the derivative of a state or control at times `t`, shape (…, [entries,] size).

        The times are fixed, even if the phase's ends depend on the data. The derivative of a saturated
        control is 0.

        Parameters
        ----------
        name : str
            Name of a state or control.
        t : array_like
            Times within the phase.
        phase : str, optional
            Name of the phase; may be omitted for a plan with one phase.

        Raises
        ------
        InvalidData
            `name` is a declared expression, or the plan has several phases.
        UnknownName
            The state, control or phase does not exist.
        """
        parts = [plan.phases[0] if phase is None else plan.phase(phase) for plan in self._perturbed]
        plan = self.point.plan
        part = plan._only(repr(name)) if phase is None else plan.phase(phase)
        number = plan.phases.index(part)
        signal = part[name]
        source = _polynomials(signal)
        low, high = source.lower, source.upper
        smooth = Piecewise(source.knots, source.nodes, source.values)
        value, rate = smooth(t), smooth(t, 1)
        moves = low is None or (value > low) & (value < np.asarray(high))
        place = (np.asarray(t, float)[..., None] - part.start) / part.duration
        derivatives = []
        for k, (before, after) in enumerate(zip(parts[::2], parts[1::2], strict=True)):
            first, second = _polynomials(before[name]), _polynomials(after[name])
            gap = 2.0 * self._length[k]
            values = zip(first.values, second.values, strict=True)
            derivative = Piecewise(
                source.knots, source.nodes, tuple((b - a) / gap for a, b in values)
            )
            start, end = self.times[number, :, k]
            shift = (1.0 - place) * start + place * end
            derivatives.append(np.where(moves, derivative(t) - rate * shift, 0.0))
        stacked = np.stack(derivatives, axis=-1)[..., list(signal.entries), :]
        return stacked[..., 0, :] if signal.scalar else stacked

    @cached_property
    def _length(self) -> Floats:
        scale = self.point.posed.program.column_scale[:, None]
        size = np.abs(self.columns / scale).max(axis=0, initial=0.0)
        result: Floats = MOVE / np.maximum(size, 1e-300)
        return result

    @cached_property
    def _perturbed(self) -> tuple[ControlPlan, ...]:
        """Plans at positive and negative moves of each entry."""
        decode = self.point.posed.formulation.decode
        return tuple(
            decode(self.point.columns + side * self.columns[:, k])
            for k, length in enumerate(self._length)
            for side in (-length, length)
        )


class _System:
    """KKT system of a solution in scaled columns and rows, with its active constraints as equations.

    A constraint is active if its multiplier exceeds its slack. One Newton step to the point with
    exactly these active constraints removes the error that the solver's barrier left, and reveals
    wrong or ambiguous classifications.
    """

    def __init__(self, point: Point) -> None:
        self.posed = posed = point.posed
        program, x = posed.program, point.columns
        size = sp.diags_array(program.column_scale[posed.free])
        # With CasADi's signs, the gradient of f + multipliers·g is 0 except at active column bounds.
        multipliers = -posed.duals(point.multipliers[1])
        gradient, jacobian = program.first_order(x)
        jacobian = sp.csc_array(jacobian.sparse())
        upper = sp.csc_array(program.second_order(x, 1.0, multipliers).sparse())
        hessian = sp.csc_array(upper + sp.triu(upper, 1).T)
        lagrangian = vector(gradient) + jacobian.T @ multipliers
        jacobian = sp.csr_array(sp.diags_array(1.0 / program.row_scale) @ jacobian)[posed.rows]
        #: Derivatives of the Lagrangian by the data alone: those of the optimal objective.
        self.objective: Floats = lagrangian[posed.given]
        self.pull = size @ lagrangian[posed.free]
        self.curvature = sp.csr_array(size @ hessian[posed.free][:, posed.free] @ size)
        self.mixed = (size @ hessian[posed.free][:, posed.given]).toarray()
        self.slopes = sp.csr_array(jacobian[:, posed.free] @ size)
        self.pushes = jacobian[:, posed.given].toarray()
        values = program.values(x)[1] / program.row_scale
        (of_columns, of_rows), bounds = point.multipliers, posed.bounds
        self.sides = {
            "column": _Side(point.z, of_columns, bounds["lbx"], bounds["ubx"]),
            "row": _Side(values[posed.rows], of_rows, bounds["lbg"], bounds["ubg"]),
        }
        active = self.sides["column"].holds
        self.inner, self.rows = np.flatnonzero(~active), np.flatnonzero(self.sides["row"].holds)
        inner = self.curvature[self.inner][:, self.inner]
        slopes = self.slopes[self.rows][:, self.inner]
        _check_curvature(inner, slopes)
        self._matrix = sp.block_array([[inner, slopes.T], [slopes, None]], format="csc")
        try:
            self._factors = splu(self._matrix)
        except RuntimeError as error:
            raise NoDerivative(DEPENDENT) from error
        self._check_clear()

    def solve(self, right: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """Return the moves of z and of the active rows' multipliers, in the objective's units."""
        vector = np.concatenate([right[self.inner], rows])
        solution = self._factors.solve(vector)
        residual = np.abs(self._matrix @ solution - vector).max(initial=0.0)
        if not residual <= 1e-6 * max(1.0, np.abs(vector).max(initial=0.0)):
            raise NoDerivative(DEPENDENT)
        z = np.zeros_like(right)
        z[self.inner] = solution[: self.inner.size]
        return z, solution[self.inner.size :]

    def _check_clear(self) -> None:
        """Raise if a bound has neither a multiplier nor slack after a Newton step."""
        side, scale = self.sides["row"], self.posed.program.objective_scale
        z, duals = self.solve(-self.pull, side.off[self.rows])
        pulled = (self.pull + self.curvature @ z + self.slopes[self.rows].T @ duals) / scale
        multipliers = side.multipliers.copy()
        multipliers[self.rows] += duals / scale
        for what, moves, current in (("column", z, -pulled), ("row", self.slopes @ z, multipliers)):
            weak = self.sides[what].weak(moves, current)
            if weak.size:
                raise NoDerivative(
                    f"{self.posed.label(what, int(weak[0]))} is at its bound without a multiplier (strict complementarity "
                    "fails): the bound stays active for data on one side only, so the derivatives to either side may "
                    "differ; difference quotients of solutions on both sides approximate them"
                )


@dataclass(frozen=True, eq=False)
class _Side:
    """Values of columns or rows with their bounds and multipliers, as scaled for the solver."""

    value: Floats
    multipliers: Floats
    low: Floats
    high: Floats

    @cached_property
    def slack(self) -> Floats:
        """Distance to the nearer bound."""
        return np.minimum(self.value - self.low, self.high - self.value)

    @cached_property
    def holds(self) -> NDArray[np.bool_]:
        """Whether a bound is active: that of an equation, or with a multiplier that exceeds its slack."""
        result: NDArray[np.bool_] = (np.abs(self.multipliers) > self.slack) | (
            self.low == self.high
        )
        return result

    @cached_property
    def off(self) -> Floats:
        """Difference from the active bound, chosen by the multiplier's sign."""
        bound = np.where(self.multipliers > 0, self.high, self.low)
        return np.where(np.isfinite(bound), bound - self.value, 0.0)

    def weak(self, moved: Floats, multipliers: Floats) -> NDArray[np.int64]:
        """Return the indices without slack or multiplier after the values have `moved`."""
        value = self.value + moved
        slack = np.minimum(value - self.low, self.high - value)
        pull = multipliers * np.sign(self.multipliers)
        remaining = np.where(self.holds, pull, slack)
        return np.flatnonzero((self.low < self.high) & (remaining < WEAK))


def differentiate(point: Point, name: str) -> Sensitivity:
    """Return the derivatives of a solution with respect to its data `name`.

    It raises the errors of :meth:`~.prepared.Step.sensitivity`.
    """
    posed = point.posed
    name = Text().coerce("name", name, {})
    posed.values({name: point.data.get(name, 0.0)})  # an unknown name raises
    numbers = posed.named(np.arange(float(posed.given.size)))[name].astype(int)
    system = _System(point)
    right = -system.mixed[:, numbers], -system.pushes[system.rows][:, numbers]
    columns = np.zeros((posed.program.size, numbers.size))
    for k in range(numbers.size):
        move, _ = system.solve(right[0][:, k], right[1][:, k])
        columns[posed.free, k] = posed.program.column_scale[posed.free] * move
    columns[posed.given[numbers]] = np.eye(numbers.size)
    return Sensitivity(point, name, system.objective[numbers], columns)


def _check_curvature(curvature: Any, slopes: Any) -> None:
    """Raise unless the objective has positive curvature along all directions that the constraints leave.

    With a weight on the squared constraints, the matrix is then positive definite. Its pivots without
    pivoting are positive, and any weight with positive pivots is a proof.
    """
    size = float(np.abs(curvature.data).max(initial=0.0))
    # A column without curvature that a single row determines, usually an integral, is eliminated with
    # its row, whose square would be dense.
    table = sp.csc_array(slopes)
    is_single = (np.diff(table.indptr) == 1) & (np.abs(curvature).sum(axis=0) == 0.0)
    row = table.indices[table.indptr[:-1][is_single]]
    row, first = np.unique(row, return_index=True)
    columns = np.delete(np.arange(is_single.size), np.flatnonzero(is_single)[first])
    slopes = sp.csr_array(table)[np.delete(np.arange(table.shape[0]), row)][:, columns]
    curvature = curvature[columns][:, columns]
    for weight in WEIGHTS:
        weighted = sp.csc_array(curvature + weight * (slopes.T @ slopes))
        try:
            factors = splu(
                weighted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )  # fmt: skip
        except RuntimeError:
            continue  # singular: another weight may succeed
        is_symmetric = np.array_equal(factors.perm_r, factors.perm_c)
        if is_symmetric and factors.U.diagonal().min(initial=np.inf) > FLAT * max(size, 1e-300):
            return
    raise NoDerivative(
        "the objective does not curve upwards along all directions that the constraints leave (the "
        "second-order condition fails): the solution is not isolated, as on a singular arc"
    )
