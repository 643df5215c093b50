"""How a solution moves with its data: the implicit function theorem at a solved program.

Where a local optimum has independent active constraints, multipliers that are not 0 with them (strict
complementarity) and curvature along all other directions (second order), it is a differentiable function
of the data; its derivative solves the KKT system. Fiacco, "Introduction to Sensitivity and Stability
Analysis in Nonlinear Programming" (1983), theorem 3.2.2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import splu

from ...errors import InvalidData, NoDerivative
from ...models.optimal_control.plan import ControlPlan, Piecewise, Signal
from ..casadi_plugins import vector
from .parametric import Point

__all__ = ["Sensitivity", "differentiate"]

Floats = NDArray[np.float64]

#: Slack and multiplier, scaled, below which they count as 0 after a Newton step, whose error is the
#: square of what a barrier leaves: at most 1e-4.
WEAK = 1e-7
DEPENDENT = "constraints that hold depend on one another: their multipliers are not unique"
#: Weights of the constraints against which curvature is tested; any that succeeds proves it.
WEIGHTS = (1e4, 1e6, 1e8)
#: The least pivot that counts as curvature, as a share of the largest second derivative.
FLAT = 1e-9
#: Relative move of the columns from which polynomials are differenced; all but slopes depend linearly.
MOVE = 1e-5


def _polynomials(signal: Signal) -> Piecewise:
    """Return the polynomials of a state or control; what is declared of them has none."""
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
    objective : ndarray, shape (size,)
        Derivative of the objective, by the multipliers.
    columns : ndarray, shape (columns, size)
        Derivatives of the program's columns.
    times : ndarray, shape (phases, 2, size)
        Derivatives of each phase's start and end.
    """

    point: Point
    name: str
    objective: Floats
    columns: Floats

    @property
    def times(self) -> Floats:
        """Derivatives of each phase's start and end."""
        phases = self.point.posed.formulation.layout.phases
        return np.stack([self.columns[one.time_columns] for one in phases])

    def __call__(self, name: str, t: ArrayLike, *, phase: str | None = None) -> Floats:
        """Return the derivative of a state or control at times `t`, shape (…, [entries,] size).

        The times stay where they are, also where the phase's ends move. A control that is cut off at
        its bound does not move.

        Parameters
        ----------
        name : str
            A state or control.
        t : array_like
            Times within the phase.
        phase : str, optional
            The phase; a plan's only one without.
        """
        parts = [plan.phases[0] if phase is None else plan.phase(phase) for plan in self._moved]
        plan = self.point.plan
        own = plan._only(repr(name)) if phase is None else plan.phase(phase)
        number = plan.phases.index(own)
        signal = own[name]
        source = _polynomials(signal)
        low, high = source.lower, source.upper
        smooth = Piecewise(source.knots, source.nodes, source.values)
        value, rate = smooth(t), smooth(t, 1)
        moves = low is None or (value > low) & (value < np.asarray(high))
        place = (np.asarray(t, float)[..., None] - own.start) / own.duration
        found = []
        for k, (before, after) in enumerate(zip(parts[::2], parts[1::2], strict=True)):
            first, second = _polynomials(before[name]), _polynomials(after[name])
            apart = 2.0 * self._length[k]
            values = zip(first.values, second.values, strict=True)
            moved = Piecewise(source.knots, source.nodes, tuple((b - a) / apart for a, b in values))
            start, end = self.times[number, :, k]
            shift = (1.0 - place) * start + place * end
            found.append(np.where(moves, moved(t) - rate * shift, 0.0))
        stacked = np.stack(found, axis=-1)[..., list(signal.entries), :]
        return stacked[..., 0, :] if signal.scalar else stacked

    @cached_property
    def _length(self) -> Floats:
        scale = self.point.posed.program.column_scale[:, None]
        size = np.abs(self.columns / scale).max(axis=0, initial=0.0)
        found: Floats = MOVE / np.maximum(size, 1e-300)
        return found

    @cached_property
    def _moved(self) -> tuple[ControlPlan, ...]:
        """The plans on both sides, entry by entry."""
        return tuple(self._plans())

    def _plans(self) -> Iterator[ControlPlan]:
        decode = self.point.posed.formulation.decode
        for k, length in enumerate(self._length):
            for side in (-length, length):
                yield decode(self.point.columns + side * self.columns[:, k])


class _System:
    """The KKT system of a solution in scaled columns and rows, with what holds there as equations.

    What holds is read off: a bound holds whose multiplier exceeds its slack. One Newton step to the
    point where exactly that holds takes away what the solver's barrier left, and shows what was read
    wrongly or not clear.
    """

    def __init__(self, point: Point) -> None:
        self.own = point.posed
        own, program = self.own, self.own.program
        x, size = point.columns, sp.diags_array(self.own.program.column_scale[self.own.free])
        # In CasADi's signs the gradient of f + multipliers·g vanishes, up to what column bounds hold.
        multipliers = -own.duals(point.multipliers[1])
        gradient, jacobian = program.first_order(x)
        jacobian = sp.csc_array(jacobian.sparse())
        upper = sp.csc_array(program.second_order(x, 1.0, multipliers).sparse())
        hessian = sp.csc_array(upper + sp.triu(upper, 1).T)
        lagrangian = vector(gradient) + jacobian.T @ multipliers
        jacobian = sp.csr_array(sp.diags_array(1.0 / program.row_scale) @ jacobian)[own.rows]
        #: Derivatives of the Lagrangian by the data alone: those of the objective of optima.
        self.objective: Floats = lagrangian[own.given]
        self.pull = size @ lagrangian[own.free]
        self.curvature = sp.csr_array(size @ hessian[own.free][:, own.free] @ size)
        self.mixed = (size @ hessian[own.free][:, own.given]).toarray()
        self.slopes = sp.csr_array(jacobian[:, own.free] @ size)
        self.pushes = jacobian[:, own.given].toarray()
        values = program.values(x)[1] / program.row_scale
        self.sides = {
            "column": _Side(point.z, point.multipliers[0], own.bounds["lbx"], own.bounds["ubx"]),
            "row": _Side(
                values[own.rows], point.multipliers[1], own.bounds["lbg"], own.bounds["ubg"]
            ),
        }
        held = self.sides["column"].holds
        self.inner, self.rows = np.flatnonzero(~held), np.flatnonzero(self.sides["row"].holds)
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
        """Return how z and the multipliers of rows that hold move, in the objective's units."""
        whole = np.concatenate([right[self.inner], rows])
        found = self._factors.solve(whole)
        off = np.abs(self._matrix @ found - whole).max(initial=0.0)
        if not off <= 1e-6 * max(1.0, np.abs(whole).max(initial=0.0)):
            raise NoDerivative(DEPENDENT)
        z = np.zeros_like(right)
        z[self.inner] = found[: self.inner.size]
        return z, found[self.inner.size :]

    def _check_clear(self) -> None:
        """Raise where a bound neither holds with a multiplier nor has slack, after a Newton step."""
        side, scale = self.sides["row"], self.own.program.objective_scale
        z, duals = self.solve(-self.pull, side.off[self.rows])
        pulled = (self.pull + self.curvature @ z + self.slopes[self.rows].T @ duals) / scale
        multipliers = side.multipliers.copy()
        multipliers[self.rows] += duals / scale
        for what, moved, now in (
            ("column", z, -pulled),
            ("row", self.slopes @ z, multipliers),
        ):
            weak = self.sides[what].weak(moved, now)
            if weak.size:
                raise NoDerivative(
                    f"{self.own.label(what, int(weak[0]))} is at its bound without a multiplier "
                    "(strict complementarity fails): the solution may have another derivative to "
                    "either side"
                )


@dataclass(frozen=True, eq=False)
class _Side:
    """Values of columns or rows with their bounds and multipliers, all as the solver scales them."""

    value: Floats
    multipliers: Floats
    low: Floats
    high: Floats

    @cached_property
    def slack(self) -> Floats:
        """Distance to the nearer bound."""
        found: Floats = np.minimum(self.value - self.low, self.high - self.value)
        return found

    @cached_property
    def holds(self) -> NDArray[np.bool_]:
        """Whether a bound holds: that of an equation, and one whose multiplier exceeds its slack."""
        found: NDArray[np.bool_] = (np.abs(self.multipliers) > self.slack) | (self.low == self.high)
        return found

    @cached_property
    def off(self) -> Floats:
        """What is missing to the bound that holds, by the multiplier's sign."""
        bound = np.where(self.multipliers > 0, self.high, self.low)
        return np.where(np.isfinite(bound), bound - self.value, 0.0)

    def weak(self, moved: Floats, multipliers: Floats) -> NDArray[np.int64]:
        """Return where neither slack nor multiplier is left once the values have `moved`."""
        value = self.value + moved
        slack = np.minimum(value - self.low, self.high - value)
        pull = multipliers * np.sign(self.multipliers)
        left = np.where(self.holds, pull, slack)
        return np.flatnonzero((self.low < self.high) & (left < WEAK))


def differentiate(point: Point, name: str) -> Sensitivity:
    """Return the derivatives of a solution with respect to its data `name`.

    Raises
    ------
    InvalidData
        The problem has no such data.
    NoDerivative
        The solution is not a differentiable function of the data: constraints
        that hold without a multiplier, that depend on one another, or no curvature.
    """
    own = point.posed
    own.values({name: point.data.get(name, 0.0)})  # an unknown name raises
    numbers = own.named(np.arange(own.given.size))[name].astype(int)
    system = _System(point)
    right = -system.mixed[:, numbers], -system.pushes[system.rows][:, numbers]
    columns = np.zeros((own.program.size, numbers.size))
    for k in range(numbers.size):
        moved, _ = system.solve(right[0][:, k], right[1][:, k])
        columns[own.free, k] = own.program.column_scale[own.free] * moved
    columns[own.given[numbers]] = np.eye(numbers.size)
    return Sensitivity(point, name, system.objective[numbers], columns)


def _check_curvature(curvature: Any, slopes: Any) -> None:
    """Raise unless the objective curves upwards along all directions that the constraints leave.

    With a weight on the constraints' squares, the matrix is positive definite; without pivoting its
    pivots are then positive, and any such weight proves it.
    """
    size = float(np.abs(curvature.data).max(initial=0.0))
    # A column without curvature that one row alone determines, an integral mostly, goes with its row,
    # whose square would be dense.
    table = sp.csc_array(slopes)
    lone = (np.diff(table.indptr) == 1) & (np.abs(curvature).sum(axis=0) == 0.0)
    row = table.indices[table.indptr[:-1][lone]]
    row, first = np.unique(row, return_index=True)
    columns = np.delete(np.arange(lone.size), np.flatnonzero(lone)[first])
    slopes = sp.csr_array(table)[np.delete(np.arange(table.shape[0]), row)][:, columns]
    curvature = curvature[columns][:, columns]
    for weight in WEIGHTS:
        whole = sp.csc_array(curvature + weight * (slopes.T @ slopes))
        try:
            factors = splu(
                whole, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )  # fmt: skip
        except RuntimeError:
            continue  # singular: another weight may do
        same = np.array_equal(factors.perm_r, factors.perm_c)
        if same and factors.U.diagonal().min(initial=np.inf) > FLAT * max(size, 1e-300):
            return
    raise NoDerivative(
        "the objective does not curve upwards along all directions that the constraints leave (the "
        "second-order condition fails): the solution is not isolated, as on a singular arc"
    )
