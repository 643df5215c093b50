"""``time-simplex``: Nelder and Mead on log T, with an inner solver that is not ours: a cross-check."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.minimum_snap.time_allocation import TimeAllocation
from ...models.minimum_snap.trajectory import Trajectory
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination

__all__ = ["TimeSimplex"]

Floats = NDArray[np.float64]
Inner = Callable[[Floats], Trajectory | None]

#: Value of durations without a trajectory: large, and a number that differences keep.
NOWHERE = 1e100


class _Stopped(Exception):
    """Raised out of SciPy's loop when the run is asked to stop."""


class TimeSimplex(Backend):
    """SciPy's Nelder-Mead simplex, restarted until it no longer gains.

    J comes from ``scipy.interpolate.make_interp_spline`` where only positions and end derivatives
    are fixed, else from a quadratic program by another backend. It uses no gradient and proves
    nothing; beyond about ten segments it does not get far. Start and inner problem share no code
    with ``time-gradient``.
    """

    name = "time-simplex"
    accepts = TimeAllocation
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.WARM_START, Feature.INCUMBENTS, Feature.INTERRUPT})
    single_threaded = True
    natives = ("daqp", "clarabel", "piqp")
    options: ClassVar[Mapping[str, Option]] = {
        "inner": Option(
            "choose",
            "What solves the problem at given times: SciPy's spline, or the quadratic program by "
            "the backend named; the spline by default where it can.",
            str, ("choose", "spline", "daqp", "clarabel", "piqp"),
        ),
        "evaluations": Option(4000, "Most trajectories that are computed.", int, lower=1),
        "restarts": Option(8, "Most restarts of the simplex.", int, lower=0),
        "accuracy": Option(
            1e-9, "Relative change of the objective below which a simplex ends.", lower=1e-14
        ),
    }  # fmt: skip
    summary = "Nelder-Mead on log T over SciPy's spline or a quadratic program; no gradients"

    def run(self, problem: TimeAllocation, request: Request) -> Answer:
        """Search, and return the best trajectory met."""
        inner, name = _inner(problem, request.options.get("inner", "choose"), request)
        begin = time.perf_counter()
        search = _Search(problem, inner, request)
        limit: Limit | None = None
        message = ""
        try:
            start = search.start()
            if start is None:
                message = "no durations were found that leave a path within the bounds"
            else:
                search.descend(start)
        except _Stopped:
            limit = request.control.reason or Limit.ITERATIONS
        if limit is None and search.count >= search.most:
            limit = Limit.ITERATIONS
        return Answer(
            Termination.NO_SOLUTION if search.plan is None else Termination.FEASIBLE,
            limit,
            search.plan,
            None if search.plan is None else search.best,
            seconds={"solve": time.perf_counter() - begin},
            statistics={"evaluations": search.count, "inner": name, "rounds": search.rounds},
            message=message,
        )


class _Search:
    """The evaluations of one run and the best of them."""

    def __init__(self, problem: TimeAllocation, inner: Inner, request: Request) -> None:
        self.problem, self.inner, self.request = problem, inner, request
        self.most = request.options.get("evaluations", 4000)
        self.count = self.rounds = 0
        self.best = np.inf
        self.plan: Trajectory | None = None

    def durations(self, x: Floats) -> Floats:
        """Return T of the variables: logarithms, or those of the shares but the last."""
        total = self.problem.total_time
        share: Floats = np.exp(np.clip(x if total is None else np.append(x, 0.0), -40.0, 40.0))
        return share if total is None else share * float(total / share.sum())

    def variables(self, durations: Floats) -> Floats:
        """Return the variables of T."""
        free = self.problem.total_time is None
        x: Floats = np.log(durations if free else durations[:-1] / durations[-1])
        return x

    def value(self, x: Floats) -> float:
        """Return the objective at `x`, and keep the trajectory if it is the best."""
        if self.request.control.stopped or self.count >= self.most:
            raise _Stopped
        self.count += 1
        plan = self.inner(self.durations(x))
        if plan is None:
            return NOWHERE
        value = self.problem.objective(plan)
        if value < self.best:
            self.best, self.plan = value, plan
            self.request.control.incumbent(value, plan)
        return value

    def start(self) -> Floats | None:
        """Return variables at which there is a trajectory: the distances', stretched."""
        problem, request = self.problem, self.request
        if request.warm_start is not None:
            durations = np.array(request.warm_start.durations, float)
        else:
            points = np.where(np.isfinite(problem.waypoints), problem.waypoints, 0.0)
            length = np.linalg.norm(np.diff(points, axis=0), axis=1)
            durations = np.maximum(length, 1e-2 * max(float(length.mean()), 1e-6))
        if request.seed:
            draw = np.random.default_rng(request.seed).standard_normal(durations.size)
            durations = durations * np.exp(0.4 * draw)
        if problem.total_time is not None:
            x = self.variables(durations)
            return x if self.value(x) < NOWHERE else None
        # The best of a coarse row of totals; finer ones are the simplex's to find.
        rows = [(self.value(np.log(durations * f)), f) for f in 2.0 ** np.arange(-4.0, 9.0)]
        value, factor = min(rows)
        return self.variables(durations * factor) if value < NOWHERE else None

    def descend(self, x: Floats) -> None:
        """Run the simplex, and again from its best point with fresh corners, while that helps."""
        from scipy.optimize import minimize

        if x.size == 0:
            return
        accuracy = self.request.options.get("accuracy", 1e-9)
        spread = 0.3
        for _ in range(self.request.options.get("restarts", 8) + 1):
            self.rounds += 1
            before = self.best
            corners = np.vstack([x, x + spread * np.eye(x.size)])
            found: Any = minimize(
                self.value, x, method="Nelder-Mead",
                options={
                    "initial_simplex": corners, "adaptive": x.size > 4, "xatol": 1e-6,
                    "fatol": accuracy * max(abs(self.best), 1e-300), "maxfev": self.most,
                },
            )  # fmt: skip
            x = found.x
            spread = max(0.5 * spread, 0.02)
            if self.rounds > 1 and before - self.best <= 10 * accuracy * abs(self.best):
                break


def _inner(problem: TimeAllocation, asked: str, request: Request) -> tuple[Inner, str]:
    """Return what gives the best trajectory of given durations, and its name."""
    refusal = _no_spline(problem)
    if asked == "spline" and refusal:
        raise UnsupportedFormulation(f"inner 'spline' does not cover {refusal}")
    if asked == "spline" or (asked == "choose" and not refusal):
        return lambda durations: _spline(problem, durations), "spline"
    from ..registry import find_backend

    names = ("daqp", "clarabel", "piqp") if asked == "choose" else (asked,)
    ready = [name for name in names if not find_backend(name).missing()]
    backend = find_backend(ready[0] if ready else names[0])
    return lambda durations: _programmed(problem, durations, backend, request), backend.name


def _no_spline(problem: TimeAllocation) -> str:
    """Return why SciPy's spline is not the optimum at given times; "" where it is."""
    r = problem.order
    if problem.bounded:
        return "corridor or limits"
    if problem.order_weights[:-1].any():
        return "a sum of several orders"
    if problem.continuity != r - 1:
        return f"continuity {problem.continuity}"
    table = problem.conditions
    if not np.isfinite(table[:, 0]).all() or np.isfinite(table[1:-1, 1:]).any():
        return "a free position, or derivatives fixed between the ends"
    ends = table[[0, -1], 1:]
    if ends.shape[1] < r - 1 or not np.isfinite(ends[:, : r - 1]).all():
        return "free derivatives at an end"
    if np.isfinite(ends[:, r - 1 :]).any():
        return f"a derivative above {r - 1} at an end"
    return ""


def _spline(problem: TimeAllocation, durations: Floats) -> Trajectory | None:
    from scipy.interpolate import make_interp_spline

    r = problem.order
    times = problem.times(durations)
    if not np.all(np.diff(times) > 0):
        return None
    table = problem.conditions
    ends = tuple([(j, table[k, j]) for j in range(1, r)] for k in (0, -1))
    try:
        found = make_interp_spline(times, table[:, 0], k=2 * r - 1, bc_type=ends)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if not np.isfinite(found.c).all():
        return None
    # Taylor's coefficients at the start of each piece, in its own time.
    long = np.diff(times)
    powers = [
        found(times[:-1], nu=j) * (long**j / math.factorial(j))[:, None] for j in range(2 * r)
    ]
    return Trajectory(times, np.stack(powers, axis=1))


def _programmed(
    problem: TimeAllocation, durations: Floats, backend: Backend, request: Request
) -> Trajectory | None:
    """Solve the Legendre program, with more instants until the bounds hold at all of them."""
    written = problem.at(problem.times(durations)).formulate("legendre")
    while True:
        answer = request.within(backend, written.program)
        if answer.termination is not Termination.OPTIMAL:
            return None
        finer = written.refined(answer.point, request.tolerance)
        if finer is None:
            plan: Trajectory = written.decode(answer.point)
            return plan
        written = finer
