"""``surrogate-search``: a Gaussian process in a trust region, for functions that few evaluations must minimise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..contract.option import Option
from .constraints import FLOOR
from .gaussian_process import GaussianProcess
from .native import Objective, latin_hypercube
from .scipy_searches import DualAnnealing, _SciPy

__all__ = ["SurrogateSearch"]

Floats = NDArray[np.float64]

#: Side of the trust region at the start of a search, its largest value, and the value that ends the search.
_START, _LARGEST, _SMALLEST = 0.8, 1.6, 1e-7
#: Largest number of points that the process uses: those next to the centre of the trust region.
_POINTS = 250
#: Share of the values, the smallest ones, that are not compressed by a logarithm.
_LINEAR = 0.9
#: Share of points that a random multiple of the standard deviation chooses, and the multiple for the others.
_EXPLORING, _EXPLOITING = 0.25, 0.1
#: Growth of the number of points after which the process is fitted again.
_REFIT = 1.05
#: Iterations of the first fit and of later ones.
_FIRST, _LATER = 40, 8
#: Largest number of random candidates; the best one starts the minimisation of the lower bound.
_CANDIDATES = 500
#: Largest number of constraints with processes of their own. A model with more has one process of the merit.
_CONSTRAINTS = 12
#: Expected violation up to which a point is feasible, relative to the deviation of the values of a constraint.
_SLACK = 1e-6


class SurrogateSearch(_SciPy):
    """Gaussian process that chooses the next points in a trust region around the best one.

    After D. Eriksson, M. Pearce, J. Gardner, R. D. Turner and M. Poloczek, "Scalable global optimization via local
    Bayesian optimization", NeurIPS 2019 (TuRBO), with a quadratic trend in the process, lower confidence bounds
    instead of samples, and a region that ends only when it is tiny. The effort per point grows with the number of
    points, so `dual-annealing` uses the evaluations beyond option `surrogate`.
    """

    name = "surrogate-search"
    summary = "Gaussian process in a trust region, for at most 500 evaluations"
    options: ClassVar[Mapping[str, Option]] = {
        "batch": Option(
            None,
            "Points per round. By default a new point is chosen for each value that arrives, with one and a half "
            "points per worker in evaluation.",
            int,
            lower=1,
            upper=100,
        ),
        "surrogate": Option(500, "Evaluations before annealing.", int, lower=1, upper=2000),
    }
    most = 1000
    grows = "its process has one length per variable"

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Search in trust regions until the evaluations of the process are used, then anneal."""
        last = objective.left - objective.options["surrogate"]
        restarted = False
        while objective.left > last:
            region, restarted = _Region(objective, restarted), True
            while region.side > _SMALLEST and objective.left > last:
                region.step()
            region.evaluate(len(region.pending))
        return objective.continue_with(DualAnnealing())


class _Region:
    """Trust region: its points and values, its centre, which is the best of them, and its side.

    The first points form a Latin hypercube, which contains the warm start or the centre of the cube. The process
    also uses the points of earlier stages and regions. With constraints, each one has a process of its own: D.
    Eriksson and M. Poloczek, "Scalable constrained Bayesian optimization", AISTATS 2021. The next point has the
    lowest bound of the objective subject to the means of all constraints.
    """

    def __init__(self, objective: Objective, restarted: bool) -> None:
        self.objective, self.d = objective, objective.dimension
        self.generator = objective.generator
        workers = objective.parallel
        self.batch = objective.options["batch"] or workers + workers // 2
        #: Points that were chosen and whose values are not known, and how many values one step awaits.
        self.pending = np.empty((0, self.d))
        self.awaited = objective.options["batch"] or 1
        count = objective.constraints.scales.size
        self.constraints = count if count <= _CONSTRAINTS else 0
        self.processes = [GaussianProcess(self.d) for _ in range(1 + self.constraints)]
        self.side, self.failures, self.spread, self.fitted = _START, 0, 1.0, 0
        count = max(min(2 * self.d, objective.granted // 4), 2)
        points = latin_hypercube(self.generator, count, self.d)
        x, table = objective.earlier()
        if objective.start is not None and not len(table):
            points[0] = objective.start
        elif objective.x is None:
            points[0] = 0.5
        objective.start = None
        discrete = objective.problem.layout.discrete[objective.free]
        #: Share of the cube for each value of a discrete variable, 0 for a real variable.
        self.cells: Floats = (
            discrete / (objective.problem.highs - objective.problem.lows + 1.0)[objective.free]
        )
        #: Objective and constraints of each point, and their merit.
        self.table = np.vstack([objective.table(objective.point(points), points), table])
        self.x = self._canonical(np.vstack([points, x]))
        self.y = objective.constraints.merit(self.x, self.table)
        # A region after a converged one starts at its own points.
        self.centre = int((self.y[:count] if restarted else self.y).argmin())

    def _canonical(self, unit: Floats) -> Floats:
        """Return points of the unit cube with discrete variables in the middle of their cells."""
        unit = np.clip(unit, 0.0, 1.0)
        return self.objective.unit(self.objective.point(unit)) if self.cells.any() else unit

    def step(self) -> None:
        """Choose the next points with the process, await values and resize the region."""
        points = self._choose(*self._neighbours())
        if self.awaited < self.batch:  # otherwise one request has all points
            self.objective.begin(points)
        self.pending = np.vstack([self.pending, points])
        self.evaluate(self.awaited)

    def evaluate(self, count: int) -> None:
        """Request the values of the oldest points and resize the region."""
        points, self.pending = self.pending[:count], self.pending[count:]
        if not len(points):
            return
        table = self.objective.table(self.objective.point(points), points)
        answers = self.objective.constraints.merit(points, table)
        k = int(answers.argmin())
        success = bool(answers[k] < self.y[self.centre])
        at_border = bool(np.abs(points[k] - self.x[self.centre]).max() > 0.3 * self.side)
        if success:
            self.centre = len(self.y) + k
            self.failures = 0
            if at_border:
                self.side = min(self.side * 1.5, _LARGEST)
        else:
            self.failures += 1
            if self.failures >= max(min(self.d, 10) // (2 * self.awaited), 1):
                self.side, self.failures = self.side / 2, 0
        self.x, self.y = np.vstack([self.x, points]), np.append(self.y, answers)
        self.table = np.vstack([self.table, table])

    def _neighbours(self) -> tuple[Floats, Floats]:
        """Fit the processes to the points next to the centre; return their scaled offsets and values, shape (k, n)."""
        offsets = self.x - self.x[self.centre]
        far = np.abs(offsets).max(axis=1)
        order = np.argsort(far, kind="stable")[:_POINTS]
        inside = int((far[order] <= self.side).sum())
        # As many as a quadratic polynomial of 8 variables needs, if the region has fewer.
        order = order[: max(inside, 2 * self.d + 2 + self.d * min(self.d, 8))]
        spread = max(float(far[order].max()), 1e-12)
        near, table = offsets[order] / spread, self.table[order]
        values = [_transformed(table[:, 0] if self.constraints else self.y[order])]
        values += [_signed(column) for column in table[:, 1:].T] if self.constraints else []
        fits = len(self.y) >= _REFIT * self.fitted
        for process, column in zip(self.processes, values, strict=True):
            process.theta[: self.d] += math.log(self.spread / spread)
            if fits:
                process.fit(near, column, _LATER if self.fitted else _FIRST)
            else:
                process.condition(near, column)
        self.spread, self.fitted = spread, len(self.y) if fits else self.fitted
        return near, np.array(values)

    def _choose(self, near: Floats, values: Floats) -> Floats:
        """Return the next points, shape (batch, d), each after the expected values at those before it."""
        lengths = np.exp(self.processes[0].theta[: self.d])
        sides = np.clip(lengths / np.exp(np.log(lengths).mean()), 0.1, 10.0)
        sides *= 0.5 * self.side / np.exp(np.log(sides).mean())
        sides = np.maximum(sides, 1.01 * self.cells)  # reaches the next integer
        kinds = self.objective.problem.layout.variables
        sides[[bool(kinds and kinds[k].values) for k in self.objective.free]] = 1.0
        centre = self.x[self.centre]
        low = (np.maximum(centre - sides, 0.0) - centre) / self.spread
        high = (np.minimum(centre + sides, 1.0) - centre) / self.spread
        chosen = (self.pending - centre) / self.spread
        near, values = self._believe(near, values, chosen)
        while len(chosen) < self.batch:
            explores = len(chosen) or self.generator.random() < _EXPLORING
            kappa = abs(self.generator.standard_normal()) if explores else _EXPLOITING
            point = self._minimise(low, high, float(kappa))[None]
            chosen = np.vstack([chosen, point])
            if len(chosen) < self.batch:
                near, values = self._believe(near, values, point)
        return self._canonical(centre + chosen[len(self.pending) :] * self.spread)

    def _believe(self, near: Floats, values: Floats, points: Floats) -> tuple[Floats, Floats]:
        """Add points with their expected values to the processes, and return all offsets and values."""
        if len(points):
            near = np.vstack([near, points])
            values = np.hstack([values, [p.predict(points)[0] for p in self.processes]])
            for process, column in zip(self.processes, values, strict=True):
                process.condition(near, column)
        return near, values

    def _minimise(self, low: Floats, high: Floats, kappa: float) -> Floats:
        """Return the point of the box with the smallest lower confidence bound that is found."""
        from scipy.optimize import minimize

        count = min(100 * self.d, _CANDIDATES)
        candidates = self.generator.uniform(low, high, (count, self.d))
        moved = self.generator.random((count, self.d)) < min(1.0, 20.0 / self.d)
        # The origin is the best point so far.
        candidates = np.where(moved, candidates, 0.0) * self.generator.random((count, 1)) ** 0.5
        discrete = self.cells > 0
        if discrete.any():
            candidates = self._new(candidates)
        mean, deviation = self.processes[0].predict(candidates)
        bound = mean - kappa * deviation
        excess = self._excess(candidates)
        start = candidates[int(np.where(excess > excess.min(), np.inf, bound).argmin())]
        low, high = np.where(discrete, start, low), np.where(discrete, start, high)
        box = np.column_stack([low, high])
        result = minimize(
            self.processes[0].lower, start, args=(kappa,), jac=True, bounds=box, **self._method()
        )
        z: Floats = np.clip(result.x, low, high)
        lacks = bool(self._excess(z[None]) > max(excess.min(), _SLACK))
        if lacks or np.abs(z).max() * self.spread < 1e-3 * self.side:
            z = start  # no second evaluation at the best point
        return z

    def _method(self) -> dict[str, Any]:
        """Return the method of SciPy for the lower bound, with the means of the constraints if there are any."""
        if not self.constraints:
            options = {"maxiter": 100, "maxfun": 120, "ftol": 1e-12, "gtol": 1e-10}
            return {"method": "L-BFGS-B", "options": options}
        last = self.objective.problem.inequalities
        parts = [
            ("ineq", -1.0, self.processes[1 : 1 + last]),
            ("eq", 1.0, self.processes[1 + last :]),
        ]

        def means(processes: list[GaussianProcess], sign: float, k: int) -> Any:
            return lambda z: sign * np.array([p.lower(z, 0.0)[k] for p in processes])

        rows = [
            {"type": kind, "fun": means(group, sign, 0), "jac": means(group, sign, 1)}
            for kind, sign, group in parts
            if group
        ]
        return {"method": "SLSQP", "constraints": rows, "options": {"maxiter": 50, "ftol": 1e-9}}

    def _excess(self, points: Floats) -> Floats:
        """Return the sum of the expected violations, shape (m,)."""
        result = np.zeros(len(points))
        for k, process in enumerate(self.processes[1:]):
            mean = process.predict(points)[0]
            is_equality = k >= self.objective.problem.inequalities
            result += np.abs(mean) if is_equality else np.maximum(mean, 0.0)
        return result

    def _new(self, candidates: Floats) -> Floats:
        """Return the candidates with values of their variables, without evaluated ones unless all are."""
        centre = self.x[self.centre]
        points = self._canonical(centre + candidates * self.spread)
        known = {x.tobytes() for x in self.x}
        new = np.array([x.tobytes() not in known for x in points])
        result: Floats = (points[new] if new.any() else points) - centre
        return result / self.spread


def _signed(values: Floats) -> Floats:
    """Return values of a constraint relative to their size, the large ones compressed; 0 and signs remain.

    Points without a value have the largest one.
    """
    finite = np.isfinite(values)
    size = np.abs(values[finite])
    scale = float(np.median(size[size > 0])) if (size > 0).any() else 1.0
    with np.errstate(over="ignore"):
        shown = np.where(
            finite, np.minimum(np.abs(np.where(finite, values, 0.0)) / scale, 1e300), 0.0
        )
    shown = np.copysign(np.log1p(shown), values)
    shown[~finite] = shown[finite].max(initial=0.0) + 0.5
    result: Floats = shown / (shown.std() or 1.0)
    return result


def _transformed(values: Floats) -> Floats:
    """Return standardised values, the largest ones compressed by a logarithm.

    Infeasible points are above all others, in the order of the logarithm of their merit, and points without a value
    above these.
    """
    worse, missing = (values >= FLOOR) & np.isfinite(values), ~np.isfinite(values)
    rest = ~(worse | missing)
    shown = np.zeros(len(values))
    if rest.any():
        halves = 0.5 * values[rest]  # whose differences are finite
        best, linear, worst = np.quantile(halves, (0.0, _LINEAR, 1.0))
        with np.errstate(over="ignore"):
            ratio = (halves - best) / (linear - best or worst - best or 1.0)
        ratio = np.minimum(ratio, 1e300)
        shown[rest] = np.where(ratio > 1.0, 1.0 + np.log(np.maximum(ratio, 1.0)), ratio)
    if worse.any():
        size = np.log(values[worse])
        shown[worse] = shown.max() + 0.5 + (size - size.min()) / (np.ptp(size) or 1.0)
    if missing.any():
        shown[missing] = shown.max() + 0.5
    result: Floats = (shown - shown.mean()) / (shown.std() or 1.0)
    return result
