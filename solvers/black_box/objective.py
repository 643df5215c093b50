"""Objective of a search of a black box: counted values in the unit cube, and the best point."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ..contract.backend import Limit, Request
from .archive import Archive
from .constraints import PARTS, Constraints

__all__ = ["Ended", "Objective", "latin_hypercube"]

Floats = NDArray[np.float64]

#: Largest number of points per request.
_MOST = 2**13
#: Largest number of evaluations whose points are kept for models of later stages.
_REMEMBERED = 2000


def latin_hypercube(generator: np.random.Generator, count: int, dimension: int) -> Floats:
    """Return points of the unit cube, shape (count, dimension), one in each slice of each variable.

    SciPy's sampler would import its statistics, which takes longer than most searches.
    """
    slices = np.tile(np.arange(count), (dimension, 1))
    points: Floats = generator.permuted(slices, axis=1).T + generator.random((count, dimension))
    return points / count


class Ended(Exception):
    """The run ends: its evaluations are used up or it was stopped; raised through the search."""


class Objective:
    """Objective of a search: the function over the unit cube of the `dimension` free variables.

    The search therefore produces the same points, up to rounding, if the variables are shifted or
    scaled. `granted` points may be evaluated, and `left` remain; each is evaluated `repeats` times. `x` and `best` are
    the best point and its objective, or minus the hypervolume of `archive`. `start` is a warm start in the unit cube, whose
    value is known. `missing` counts the points without a value, and `counts` the evaluations of each stage.
    """

    def __init__(self, problem: BlackBoxMinimisation, request: Request) -> None:
        self.problem, self.control, self.options = problem, request.control, request.options
        self.generator = np.random.default_rng(0 if request.seed is None else request.seed)
        self.start: Floats | None = None
        self.free = np.flatnonzero(problem.highs > problem.lows)
        self.dimension = self.free.size
        # Each value of a discrete variable has the same share of the cube.
        half = 0.5 * problem.layout.discrete[self.free]
        self._lower = problem.lows[self.free] - half
        self._width = problem.highs[self.free] + half - self._lower
        self._upper = problem.highs[self.free]
        #: Whether all variables are free and real, and whether a point has one value.
        self._is_plain = problem.variables is None and self.dimension == problem.dimension
        self._is_single = problem.columns == 1
        limit = request.evaluations
        limit = problem.budget if limit is None else min(problem.budget, limit)
        self.granted = self.left = limit // problem.repeats
        self.best, self.missing = math.inf, 0
        self.target = request.target
        self._ahead, self._parallel = 0, 0
        self.counts: dict[str, int] = {}
        #: Points of the unit cube and their columns, if at most ``_REMEMBERED`` are possible.
        self._history: list[tuple[Floats, Floats]] = []
        self.x: Floats | None = None
        self.constraints = Constraints(problem)
        self.archive: Archive | None = None
        if problem.reference is not None:
            self.archive = Archive(problem.reference, self.options.get("front", 100))
        left = request.left()
        self._seconds = math.inf if left is None else max(left, 1e-9)
        self._end = None if left is None else time.perf_counter() + left
        #: Share of the evaluations and of the time after which the present stage ends, and the
        #: evaluations of later stages.
        self._share, self._reserve = 1.0, 0

    @property
    def progress(self) -> float:
        """Share of the evaluations that are used, from 0 to 1."""
        return 1.0 - (self.left + self._reserve) / self.granted

    @property
    def origin(self) -> Floats:
        """Origin of the variables in the coordinates of the unit cube, possibly outside of it."""
        result: Floats = -self._lower / self._width
        return result

    def unit(self, x: Floats) -> Floats:
        """Return points of all variables, shape (…, d), in the unit cube of the free variables."""
        result: Floats = (x[..., self.free] - self._lower) / self._width
        return result

    def point(self, unit: Floats) -> Floats:
        """Return points of the unit cube, shape (…, dimension), as points of all variables."""
        if self._is_plain:
            x = self._lower + unit * self._width
            np.maximum(x, self._lower, out=x)
            return np.minimum(x, self._upper, out=x)
        x = np.broadcast_to(self.problem.lows, (*unit.shape[:-1], self.problem.dimension)).copy()
        x[..., self.free] = self._lower + unit * self._width
        return self.problem.layout.canonical(x)

    def __call__(self, unit: Floats) -> Floats:
        """Return the values at points of the unit cube, shape (m,), infinite for no value.

        Points outside of the cube are moved to its border. ``Ended`` is raised if the run must end.
        """
        return self.at(self.point(unit), unit)

    def _remember(self, points: Floats, unit: Floats | None, table: Floats) -> None:
        if self.granted <= _REMEMBERED:
            unit = self.unit(points) if unit is None else unit.copy()  # searches reuse arrays
            self._history.append((unit[: len(table)], table))

    def earlier(self) -> tuple[Floats, Floats]:
        """Return the evaluated points of the unit cube and their columns, none for a large number of evaluations."""
        if not self._history:
            return np.empty((0, self.dimension)), np.empty((0, self.problem.columns))
        unit, table = map(np.vstack, zip(*self._history, strict=True))
        return np.clip(unit, 0.0, 1.0), table

    def at(self, points: Floats, unit: Floats | None = None) -> Floats:
        """Return the values at points of all variables, shape (m, d); see :meth:`__call__`."""
        if len(points) == 1 and self._is_single and self.left:
            return np.array([self._at_one(points, unit)])
        table = self.table(points, unit)
        return self.constraints.merit(points, table) if table.shape[1] > 1 else table[:, 0]

    def table(self, points: Floats, unit: Floats | None = None) -> Floats:
        """Return objectives, inequalities and equalities, infinite for no value, shape (m, columns)."""
        x = points[: self.left]
        table = np.full((len(x), self.problem.columns), np.inf)
        done = 0
        # A request is a whole generation. The oracle returns after a while with the answers so far, so that the
        # run can stop.
        while done < len(x) and not self._must_end():
            answers = self.control.ask(x[done : done + _MOST], partial=True)
            if len(answers):
                table[done : done + len(answers)] = self._count(x[done:], answers)
                done += len(answers)
        self._ahead = max(self._ahead - done, 0)
        self._remember(x, unit, table[:done])
        if self.archive is not None and self.archive.add(
            x[:done],
            table[:done, : self.problem.objectives],
            self.constraints.feasible(table[:done]),
        ):
            self.best, self.x = -self.archive.volume, self.archive.compromise()
            used = (self.granted - self._reserve - self.left) * self.problem.repeats
            self.control.incumbent(self.best, self.plan(), used)
        stage_ends = self._share < 1.0 and self._used_time() >= self._share
        if self.control.stopped or done < len(points) or stage_ends:
            raise Ended
        return table

    def plan(self) -> BlackBoxPoint | None:
        """Return the best point, with the front of several objectives; None before the first."""
        if self.x is None:
            return None
        front = None if self.archive is None else tuple(map(tuple, self.archive.x.tolist()))
        return BlackBoxPoint(tuple(self.x.tolist()), front)

    def search_in_parts(self, search: Any) -> Mapping[str, Any]:
        """Run a search that uses the size of values; with constraints in parts with fixed multipliers."""
        if not self.constraints.scales.size:
            statistics: Mapping[str, Any] = search.search(self)
            return statistics
        count = max(min(10 + 2 * self.dimension, self.left // 20), 1)
        sample = latin_hypercube(self.generator, count, self.dimension)
        self.constraints.begin(self.table(self.point(sample)))
        try:
            for part in range(PARTS):
                share, now = 1 / (PARTS - part), self._used_time()
                points = max(int(self.left * share), min(self.left, 1))
                with self.limited(points, now + (self._share - now) * share):
                    search.search(self)
                if self.constraints.best is not None:
                    self.start = np.clip(self.unit(self.constraints.best[1]), 0.0, 1.0)
                self.constraints.update()
        finally:
            self.constraints.multipliers = None
        return {}

    @contextmanager
    def limited(self, points: int, until: float) -> Iterator[None]:
        """Limit a block to some of the remaining points and to a share of the time limit.

        ``Ended`` leaves the block only if the whole run, or the stage around the block, must end.
        """
        outer, reserve = self._share, max(self.left - points, 0)
        self.left, self._reserve, self._share = self.left - reserve, self._reserve + reserve, until
        ended = False
        try:
            yield
        except Ended:
            ended = True
        finally:
            # Evaluations that the search has begun and not requested are used.
            self.left = max(self.left - self._ahead, 0) + reserve
            self._ahead, self._reserve, self._share = 0, self._reserve - reserve, outer
        late = outer < 1.0 and self._used_time() >= outer
        if ended and (self.control.stopped or not self.left or late):
            raise Ended

    def _at_one(self, points: Floats, unit: Floats | None) -> float:
        """Return the value at one point, without the cost of arrays."""
        control = self.control
        answers = points[:0]
        while not len(answers):
            if control.stopped and self._must_end():
                raise Ended
            answers = control.ask(points, partial=True)
        value = answers.item()
        if not math.isfinite(value):
            value = math.inf
            self.missing += 1
        self.left -= 1
        self._remember(points, unit, answers)
        self._ahead = max(self._ahead - 1, 0)
        if value < self.best:
            self._improve(value, points[0], self.granted - self._reserve - self.left)
        control.evaluated(self.problem.repeats)
        if control.stopped or (self._share < 1.0 and self._used_time() >= self._share):
            raise Ended
        return value

    def _improve(self, value: float, x: Floats, place: int) -> None:
        """Store and report a better point, that of evaluation number `place`."""
        self.best, self.x = value, x
        point = BlackBoxPoint(tuple(x.tolist()))
        self.control.incumbent(value, point, place * self.problem.repeats)

    @property
    def parallel(self) -> int:
        """Number of points that are evaluated at once."""
        if not self._parallel:
            points = np.empty((0, self.problem.dimension))
            self._parallel = max(self.control.start(points) // self.problem.repeats, 1)
        return self._parallel

    def filled(self, count: int) -> int:
        """Return the size of a generation of at least `count` points that leaves no worker idle."""
        return -(-count // self.parallel) * self.parallel

    def begin(self, unit: Floats) -> None:
        """Start the evaluation of points that are requested later, in their order, if there are workers.

        Values then arrive without waiting for the slowest point of a batch. Requests have the same answers as
        without this call.
        """
        if self.parallel > 1:
            points = self.point(unit[: max(self.left - self._ahead, 0)])
            self._ahead += len(points)
            self.control.start(points)

    def run_stage(self, share: float, search: Any, **options: Any) -> None:
        """Run a search from the best point until a share of all evaluations, or of the time limit, is used.

        The options are those that differ from the defaults of the search.
        """
        points, before = self.left - min(int(self.granted * (1.0 - share)), self.left), self.left
        # The last stage begins in any case, because its first request raises at a limit.
        if share < 1.0 and ((not points and before) or self._used_time() >= share):
            return
        try:
            with self.limited(points, share):
                self.continue_with(search, **options)
        finally:
            self.counts[search.name] = before - self.left

    def continue_with(self, search: Any, **options: Any) -> Mapping[str, Any]:
        """Run a search from the best point, with its default options except for `options`."""
        self.options = search.checked_options(options)
        if self.x is not None:
            self.start = np.clip(self.unit(self.x), 0.0, 1.0)
        statistics: Mapping[str, Any] = search.explore(self)
        return statistics

    def affordable(self, seconds: float) -> int:
        """Return how many of the granted evaluations the time limit allows if each takes `seconds`."""
        return max(int(min(self._seconds / max(seconds, 1e-9), self.granted)), 1)

    def _must_end(self) -> bool:
        """Return whether the run was stopped; a time limit does not prevent the first evaluation."""
        first = self.left + self._reserve == self.granted and self.control.reason is Limit.TIME
        return self.control.stopped and not first

    def _used_time(self) -> float:
        """Return the used share of the time limit, 0 without a limit."""
        if self._end is None:
            return 0.0
        return 1.0 - (self._end - time.perf_counter()) / self._seconds

    def _count(self, x: Floats, answers: Floats) -> Floats:
        """Return the answers, infinite in rows without a value; count them and store the best.

        Points after one that reaches the target in the same request are ignored: the grouping of points
        into requests depends on the speed of the function, and the result must not.
        """
        missing = np.logical_not(np.isfinite(answers).all(axis=1))
        table = np.where(missing[:, None], np.inf, answers)
        values = table[:, 0]
        if table.shape[1] > 1:
            values = np.where(self.constraints.feasible(table), values, np.inf)
        if self.archive is not None:
            values = np.full(len(values), np.inf)  # the front is updated after the request
        count = len(values)
        if self.target is not None and values.min() <= self.target:
            count = int((values <= self.target).argmax()) + 1
        self.left -= count
        self.missing += int(missing[:count].sum())
        k = int(values[:count].argmin())
        if values[k] < self.best:
            place = self.granted - self._reserve - self.left - count + k + 1
            self._improve(float(values[k]), x[k], place)
        self.control.evaluated(count * self.problem.repeats)
        result: Floats = table
        return result
