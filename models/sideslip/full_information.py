"""Full-information estimation: the most likely path of the single-track model as a quadratic program.

For a linear model with normal noise it equals the Kalman filter at the last sample and the
Rauch-Tung-Striebel smoother at all samples (Rao, Rawlings and Lee, Constrained linear state
estimation, Automatica 2001).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ..formulation import Formulation
from ..programs.blocks import Block
from ..programs.linear import QuadraticProgram
from .data import UNKNOWN, Tyre
from .dynamics import Linearised, linearise
from .model import SideslipEstimation
from .plan import SideslipEstimate

__all__ = ["Condensed", "FullInformation", "Stretch", "least_squares_program", "misfit"]

Floats = NDArray[np.float64]


#: Length (s) of the window over which errors are compared with their expected size.
WINDOW = 1.0


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples with linearised model, measurements and noise.

    `measured`, shape (n, 2), are yaw rate (rad/s) and lateral acceleration (m/s²) with the deviations
    `noise`, and `used` marks the samples whose measurements are used. `disturbance`, shape (n - 1, 2),
    are the deviations of the noise added to the state between samples. `mean` is the expected state at
    the first sample, before its measurement, and `root` the lower Cholesky factor of its covariance.
    """

    linear: Linearised
    measured: Floats
    used: NDArray[np.bool_]
    noise: Floats
    disturbance: Floats
    mean: Floats
    root: Floats

    @classmethod
    def of(cls, model: SideslipEstimation, linear: Linearised) -> Stretch:
        """Return the stretch of all samples of `model` with their linearised model."""
        drive = model.recording
        return cls(
            linear, np.stack([drive.yaw_rate, drive.lateral_acceleration], axis=1), drive.moving,
            model.sensor_noises, model.disturbance * np.sqrt(np.diff(drive.times))[:, None], model.initial,
            np.diag(model.initial_deviation),
        )  # fmt: skip

    def part(
        self, first: int, last: int, mean: Floats, root: Floats, linear: Linearised | None = None
    ) -> Stretch:
        """Return the samples `first` … `last`, both included, with a new prior and, optionally, a new model.

        `mean` and `root` are the expected state at the first sample and the lower Cholesky factor of its
        covariance.
        """
        steps, samples = slice(first, last), slice(first, last + 1)
        if linear is None:
            step, shift, slope, level = self.linear
            linear = Linearised(step[steps], shift[steps], slope[samples], level[samples])
        return Stretch(
            linear, self.measured[samples], self.used[samples], self.noise, self.disturbance[steps],
            mean, root,
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.measured)

    @cached_property
    def scale(self) -> Floats:
        """Unit of the state columns (rad, rad/s): the median disturbance, shape (2,)."""
        usual = np.median(self.disturbance, axis=0) if len(self.disturbance) else np.diag(self.root)
        return np.asarray(usual)

    @cached_property
    def deviations(self) -> Floats:
        """Standard deviation of the angle at each sample given all measurements, rad, shape (n,).

        The covariance given earlier samples is combined with the information from later ones: the two-filter
        form of a smoother (Fraser and Potter 1969).
        """
        step, _, slope, _ = self.linear
        seen = np.swapaxes(slope / self.noise[:, None], 1, 2) @ (slope / self.noise[:, None])
        seen[~self.used] = 0.0
        eye = np.eye(2)
        before = np.empty((self.count, 2, 2))
        covariance = self.root @ self.root.T
        for k in range(self.count):
            # (P⁻¹ + S)⁻¹ without inverting P, which may be nearly singular.
            before[k] = np.linalg.solve(eye + covariance @ seen[k], covariance)
            if k < self.count - 1:
                covariance = step[k] @ before[k] @ step[k].T + np.diag(self.disturbance[k] ** 2)
        after = np.zeros((2, 2))
        result = np.empty(self.count)
        for k in range(self.count - 1, -1, -1):
            result[k] = np.linalg.solve(eye + before[k] @ after, before[k])[0, 0]
            if k:
                after = after + seen[k]
                spread = np.diag(self.disturbance[k - 1] ** 2)
                after = step[k - 1].T @ after @ np.linalg.solve(eye + spread @ after, step[k - 1])
        return np.sqrt(np.maximum(result, 0.0))


def least_squares_program(stretch: Stretch, name: str) -> QuadraticProgram:
    """Return the program that minimises half the sum of squared relative errors.

    Columns are the states, divided by :attr:`Stretch.scale`, and the relative errors of the expected
    first state, of the transitions and of the measurements. Each error is divided by its standard
    deviation. The rows define the errors.
    """
    count = stretch.count
    linear, scale = stretch.linear, stretch.scale
    used = np.flatnonzero(stretch.used)
    inverse = np.linalg.inv(stretch.root)
    weight = 1.0 / stretch.disturbance[:, :, None]
    # Blocks of 2 x 2 that map states to relative errors, with their block rows and columns.
    after = np.arange(1, count)
    parts = (
        (-inverse[None] * scale, [0], [0]),
        (-linear.step * scale * weight, after, after - 1),
        (np.eye(2) * scale * weight, after, after),
        (
            -linear.slope[used] * scale / stretch.noise[:, None],
            np.arange(count, count + len(used)),
            used,
        ),
    )
    values, row, column = (
        np.concatenate([np.asarray(part[k]) for part in parts]) for k in range(3)
    )
    errors, states = 2 * (count + len(used)), 2 * count
    row = np.broadcast_to(2 * row[:, None, None] + [[0], [1]], values.shape).ravel()
    column = np.broadcast_to(2 * column[:, None, None] + [0, 1], values.shape).ravel()
    diagonal = np.arange(errors)
    entries = (
        np.concatenate([values.ravel(), np.full(errors, -1.0)]),
        (np.concatenate([row, diagonal]), np.concatenate([column, states + diagonal])),
    )
    right = np.concatenate(
        [
            -inverse @ stretch.mean,
            np.ravel(linear.shift / stretch.disturbance),
            np.ravel((linear.level[used] - stretch.measured[used]) / stretch.noise),
        ]
    )
    size = states + errors
    free = np.full(size, np.inf)
    late = np.arange(states, size)
    return QuadraticProgram(
        hessian=sp.csr_array((np.ones(errors), (late, late)), shape=(size, size)),
        cost=np.zeros(size), matrix=sp.csr_array(entries, shape=(errors, size)), row_lower=right,
        row_upper=right, column_lower=-free, column_upper=free, name=name,
    )  # fmt: skip


def _label(program: QuadraticProgram, stretch: Stretch) -> QuadraticProgram:
    """Return a program of :func:`least_squares_program` with its rows and columns labelled."""
    count = stretch.count
    rows, columns = [], [_block("state", 0, np.arange(count))]
    at = 0
    for kind, places in (
        ("first state", np.arange(1)),
        ("step", np.arange(count - 1)),
        ("measurement", np.flatnonzero(stretch.used)),
    ):
        rows.append(_block(kind, at, places))
        columns.append(_block(f"error of {kind}", 2 * count + at, places))
        at += 2 * len(places)
    return replace(program, rows=tuple(rows), columns=tuple(columns))


def _block(name: str, start: int, samples: NDArray[np.int64]) -> Block:
    """Return a block with two entries per sample."""
    index = np.stack([samples.repeat(2), np.tile([0, 1], len(samples))], axis=1)
    return Block(name, "", start, len(index), "sample {0}, component {1}", index)


@dataclass(frozen=True, eq=False)
class FullInformation(Formulation[SideslipEstimation, SideslipEstimate]):
    """Most likely path, given all measurements.

    The optimum of the program is unrelated to the distance from the truth, so it gives no bound on the objective.

    Raises
    ------
    UnsupportedFormulation
        The tyres saturate, so the program would not be quadratic. Use the backend ``moving-horizon``.
    """

    name = "full-information"
    summary = "the most likely path, given all that was measured"
    program_type = QuadraticProgram
    relaxes = False

    def __post_init__(self) -> None:
        if self.model.vehicle.tyre is not Tyre.LINEAR:
            raise UnsupportedFormulation(
                "formulation 'full-information' covers linear tyres alone; the backend moving-horizon "
                "takes tyres that saturate"
            )

    @cached_property
    def stretch(self) -> Stretch:
        """All samples of the recording with their linearised model."""
        states = np.zeros((len(self.model.recording), 2))  # unused for linear tyres
        return Stretch.of(self.model, linearise(self.model, states))

    @cached_property
    def rows(self) -> QuadraticProgram:
        """Program whose rows define the errors."""
        name = f"{self.model.name or self.model.kind}, {self.name}"
        return _label(least_squares_program(self.stretch, name), self.stretch)

    def build(self) -> QuadraticProgram:
        """Return the program."""
        return self.rows

    def encode(self, plan: SideslipEstimate) -> Floats:
        """Return the column vector of an estimate, with the measured yaw rate."""
        return self._with_errors(self.rows, self._states(plan))

    def _states(self, plan: SideslipEstimate) -> Floats:
        states = np.stack([plan.sideslip, self.model.recording.yaw_rate], axis=1)
        return np.ravel(states / self.stretch.scale)

    @staticmethod
    def _with_errors(program: QuadraticProgram, states: Floats) -> Floats:
        """Return the states followed by the errors that the rows assign to them."""
        errors = program.matrix[:, : states.size] @ states - program.row_lower
        return np.concatenate([states, errors])

    def decode(self, point: Floats) -> SideslipEstimate:
        """Return the estimate of a column vector; its deviations follow from curvature and misfit."""
        return _read(self.stretch, point, self.model.recording.times)


@dataclass(frozen=True, eq=False)
class Condensed(FullInformation):
    """Full-information program without rows: the errors are eliminated, so only the states are columns.

    The Hessian is positive definite, which some solvers require. Its condition number is squared.
    """

    name = "condensed"
    summary = "the most likely path, with the states alone as columns"

    def build(self) -> QuadraticProgram:
        """Return the program."""
        full, count = self.rows, 2 * self.stretch.count
        errors, right = full.matrix[:, :count], full.row_lower
        hessian = sp.csr_array(errors.T @ errors)
        free = np.full(count, np.inf)
        return QuadraticProgram(
            hessian=(hessian + hessian.T) / 2, cost=-(errors.T @ right),
            matrix=sp.csr_array((0, count)), row_lower=np.empty(0), row_upper=np.empty(0),
            column_lower=-free, column_upper=free, offset=float(right @ right) / 2,
            columns=full.columns[:1], name=full.name,
        )  # fmt: skip

    def encode(self, plan: SideslipEstimate) -> Floats:
        """Return the column vector of an estimate, with the measured yaw rate."""
        return self._states(plan)

    def decode(self, point: Floats) -> SideslipEstimate:
        """Return the estimate of a column vector."""
        return super().decode(self._with_errors(self.rows, point))


def _read(stretch: Stretch, point: Floats, times: Floats) -> SideslipEstimate:
    """Return the estimate that a column vector of the program with rows represents.

    The claimed deviation is that of the normal distribution whose negative logarithm the program
    minimises, times the misfit of the errors nearby, see :func:`misfit`.
    """
    count = 2 * stretch.count
    angle = point[:count].reshape(-1, 2)[:, 0] * stretch.scale[0]
    first, after, seen = np.split(point[count:] ** 2, [2, count])
    squares = np.zeros(stretch.count)
    squares[0] += first.sum()
    squares[1:] += after.reshape(-1, 2).sum(axis=1)
    squares[stretch.used] += seen.reshape(-1, 2).sum(axis=1)
    # The degrees of freedom are the number of measurements: the states absorb the other errors.
    factor = misfit(times, squares, np.where(stretch.used, 2.0, 0.0))
    deviation = np.where(stretch.used, stretch.deviations * factor, UNKNOWN)
    angle = np.clip(angle, -np.pi / 2, np.pi / 2)
    return SideslipEstimate(angle, np.minimum(deviation, UNKNOWN))


def misfit(times: Floats, squares: Floats, degrees: Floats) -> Floats:
    """Return the factor by which deviations must grow to match the errors of the model, shape (n,).

    The factor is R. Birge's ratio (Physical Review 40, 1932): the square root of the mean squared
    relative error per degree of freedom within half a second on both sides, and at least 1. It is about
    1 if the model is right. `squares` are the sums of squared relative errors at each sample, and
    `degrees` their degrees of freedom.
    """
    first = np.searchsorted(times, times - WINDOW / 2)
    last = np.searchsorted(times, times + WINDOW / 2, side="right")

    def within(values: Floats) -> Floats:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(total[last] - total[first])

    ratio = within(squares) / np.maximum(within(degrees), 1.0)
    return np.sqrt(np.maximum(ratio, 1.0))
