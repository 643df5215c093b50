"""Moving-horizon estimation: the most likely path of the last samples as a quadratic program per sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedOption
from ...models.programs.linear import QuadraticProgram
from ...models.sideslip.data import Tyre
from ...models.sideslip.dynamics import linearise
from ...models.sideslip.full_information import Stretch, least_squares_program
from ...models.sideslip.model import SideslipEstimation
from ..contract.backend import Backend, Request, Termination
from ..contract.option import Option
from ..contract.registry import find_backend
from .kalman import claim
from .native import Estimate, SideslipBackend
from .passes import FilterPass, filter_drive

__all__ = ["MovingHorizon"]

Floats = NDArray[np.float64]

#: Change of the states, in median disturbances, at which the linearisation has converged.
CONVERGED = 1e-6


class MovingHorizon(SideslipBackend):
    """Moving-horizon estimation.

    The prior of a horizon is the Kalman filter's prediction at its first sample. For linear
    tyres every horizon therefore gives the filter's estimate (Rao, Rawlings and Lee, Constrained linear state
    estimation, Automatica 2001). Saturating tyres are relinearised about the path until it converges, which is the
    Gauss-Newton method.
    """

    name = "moving-horizon"
    summary = "moving-horizon estimation by quadratic programs"
    options = {
        "horizon": Option(
            20, "samples of a horizon; 0 is all of them as one program, which smooths", int, lower=0
        ),
        "solver": Option("clarabel", "the backend that solves the quadratic programs", str),
        "rounds": Option(
            20, "linearisations of tyres that saturate, at the most", int, lower=1, upper=1000
        ),
    }

    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the last angle of every horizon, or all angles of a single horizon.

        The Kalman filter's angle is used if a program has no solution or the run is stopped.
        """
        solver = _solver(request.options["solver"])
        count = len(problem.recording)
        horizon = request.options["horizon"]
        kalman = filter_drive(problem, request.control)
        if kalman is None:
            return None
        run = _Run(problem, request, solver, kalman)
        path = None if horizon else run.path(0, count - 1)
        if path is not None:
            point, stretch = path
            angle = point[: 2 * count : 2] * stretch.scale[0]
            result = claim(problem, kalman, angle, stretch.deviations**2, ahead=True)
            return run.report(result)
        angle = kalman.filtered[:, 0].copy()
        for last in range(count if horizon else 0):
            if request.control.stopped:
                break
            path = run.path(max(last - horizon + 1, 0), last)
            if path is not None:
                point, stretch = path
                angle[last] = point[2 * stretch.count - 2] * stretch.scale[0]
        return run.report(claim(problem, kalman, angle, kalman.filtered_covariance[:, 0, 0]))


def _solver(name: str) -> Backend:
    """Return the backend called `name`, which must accept quadratic programs."""
    backend = find_backend(name)
    kinds = backend.accepts if isinstance(backend.accepts, tuple) else (backend.accepts,)
    takes = any(issubclass(QuadraticProgram, kind) for kind in kinds)
    if not takes or QuadraticProgram.kind in backend.integral_only:
        raise UnsupportedOption(
            f"backend 'moving-horizon': option 'solver' must name a backend of quadratic programs, got "
            f"{name!r}, which takes {backend.accepted_kinds()}"
        )
    return backend


def _root(covariance: Floats, least: Floats) -> Floats:
    """Return the lower Cholesky factor of a covariance, with a diagonal of at least `least`.

    `least` is the deviation of the last disturbance, which the covariance includes up to rounding.
    """
    first = max(math.sqrt(max(covariance[0, 0], 0.0)), least[0])
    shared = covariance[1, 0] / first
    second = max(math.sqrt(max(covariance[1, 1] - shared**2, 0.0)), least[1])
    return np.array([[first, 0.0], [shared, second]])


class _Run:
    """State of a run: the result of the Kalman filter, and counts of programs."""

    def __init__(
        self, problem: SideslipEstimation, request: Request, solver: Backend, kalman: FilterPass
    ) -> None:
        self.problem, self.request, self.solver, self.kalman = problem, request, solver, kalman
        self.whole = Stretch.of(problem, kalman.model)
        self.programs = self.failed = self.unsettled = 0

    def report(self, estimate: Estimate) -> Estimate:
        """Return the estimate with statistics and message on the programs."""
        parts = [estimate.message] if estimate.message else []
        if self.failed:
            parts.append(f"{self.failed} of {self.programs} programs had no solution")
        if self.unsettled:
            parts.append(f"{self.unsettled} horizons changed still after the last linearisation")
        if self.request.control.stopped:
            parts.append("stopped: the angles that are left are the Kalman filter's")
        counts = {"programs": self.programs, "programs without a solution": self.failed}
        counts["horizons not settled"] = self.unsettled
        statistics = {**estimate.statistics, **counts}
        return estimate._replace(statistics=statistics, message="; ".join(parts))

    def path(self, first: int, last: int) -> tuple[Floats, Stretch] | None:
        """Return the optimal column vector of the samples `first` … `last`, and their stretch.

        The result is None if a program has no solution or the run is stopped.
        """
        mean, root = self.whole.mean, self.whole.root
        if first:
            mean = self.kalman.predicted[first]
            least = self.whole.disturbance[first - 1]
            root = _root(self.kalman.predicted_covariance[first], least)
        linear, before = None, np.full(2 * (last - first + 1), np.inf)
        for _ in range(self.request.options["rounds"]):
            stretch = self.whole.part(first, last, mean, root, linear)
            program = least_squares_program(stretch, "horizon")
            answer = self.request.within(self.solver, program)
            self.programs += 1
            if answer.point is None or answer.termination is not Termination.OPTIMAL:
                self.failed += not self.request.control.stopped
                return None
            point = np.asarray(answer.point)
            states = point[: len(before)]
            is_linear = self.problem.vehicle.tyre is Tyre.LINEAR
            if is_linear or np.abs(states - before).max() <= CONVERGED:
                return point, stretch
            before = states
            linear = linearise(self.problem, before.reshape(-1, 2) * stretch.scale, first)
        self.unsettled += 1
        return point, stretch
