"""What all searches of a black box share: values in the unit cube, counted, with the best kept."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ...jit import clock
from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["BlackBoxBackend", "Ended", "Objective", "latin_hypercube"]

Floats = NDArray[np.float64]

#: Seconds that one question takes about where the function is slow; the run hears nothing meanwhile.
_QUESTION = 0.1
#: Points in one question at the most.
_MOST = 2**13


class Ended(Exception):
    """The evaluations are used up, or the run was stopped: raised through the search that asks for more."""


class Objective:
    """The function as a search sees it: over the unit cube of the variables that are free.

    So a search gives the same points, but for rounding, whatever the variables are moved by and
    multiplied with.

    Parameters
    ----------
    problem : BlackBoxMinimisation
        The model without its function.
    request : Request
        Whose control is asked for values and told of better points.

    Attributes
    ----------
    options : mapping
        The backend's own options.
    generator : numpy.random.Generator
        Of the run's seed.
    start : ndarray, shape (dimension,), optional
        Where a warm start lies in the unit cube; its value is known already.
    dimension : int
        The number of free variables.
    left, granted : int
        Evaluations that are left, and that were granted.
    best : float
        The least value so far, infinity before the first.
    x : ndarray, shape (d,), optional
        Where it is, all variables.
    missing : int
        Points at which the function has no value.
    """

    def __init__(self, problem: BlackBoxMinimisation, request: Request) -> None:
        self.problem, self.control, self.options = problem, request.control, request.options
        self.generator = np.random.default_rng(0 if request.seed is None else request.seed)
        self.start: Floats | None = None
        self.free = np.flatnonzero(problem.highs > problem.lows)
        self.dimension = self.free.size
        self._lower = problem.lows[self.free]
        self._width = problem.highs[self.free] - self._lower
        asked = request.evaluations
        self.granted = self.left = problem.budget if asked is None else min(problem.budget, asked)
        self.best, self.missing = math.inf, 0
        self.target, self._several = request.target, 1
        self.x: Floats | None = None

    @property
    def progress(self) -> float:
        """Share of the evaluations that are used, from 0 to 1."""
        return 1.0 - self.left / self.granted

    @property
    def origin(self) -> Floats:
        """Where the origin of the variables lies in the unit cube, or beyond it."""
        found: Floats = -self._lower / self._width
        return found

    def unit(self, x: Floats) -> Floats:
        """Return points of all variables, shape (…, d), in the unit cube of the free ones."""
        found: Floats = (x[..., self.free] - self._lower) / self._width
        return found

    def point(self, unit: Floats) -> Floats:
        """Return points of the unit cube, shape (…, dimension), in all variables."""
        x = np.broadcast_to(self.problem.lows, (*unit.shape[:-1], self.problem.dimension)).copy()
        x[..., self.free] += unit * self._width
        found: Floats = np.clip(x, self.problem.lows, self.problem.highs)
        return found

    def __call__(self, unit: Floats) -> Floats:
        """Return the values at points of the unit cube, infinite where there is none.

        Parameters
        ----------
        unit : ndarray, shape (m, dimension)
            What lies beyond the cube is moved to its border.

        Returns
        -------
        ndarray, shape (m,)

        Raises
        ------
        Ended
            The run must end; points for which evaluations were left count.
        """
        return self.at(self.point(unit))

    def at(self, points: Floats) -> Floats:
        """Return the values at points of all variables, shape (m, d), as for those of the unit cube."""
        x = points[: self.left]
        values = np.full(len(x), np.inf)
        done = 0
        while done < len(x) and not self.control.stopped:
            begin = clock()
            answers = self.control.ask(x[done : done + self._several])[:, 0]
            self._pace(clock() - begin)
            values[done : done + len(answers)] = self._counted(x[done:], answers)
            done += len(answers)
        if self.control.stopped or done < len(points):
            raise Ended
        return values

    def _pace(self, seconds: float) -> None:
        """Ask for so many points at once that a question takes about :data:`_QUESTION`."""
        if seconds > _QUESTION:
            self._several = max(self._several // 2, 1)
        elif seconds < _QUESTION / 4:
            self._several = min(self._several * 2, _MOST)

    def _counted(self, x: Floats, answers: Floats) -> Floats:
        """Return the answers, infinite where they are no numbers; count them and keep the best.

        What was asked together with a point that reaches the target, but after it, counts for nothing:
        how points are shared out among questions depends on the speed of the function, and no
        answer may.
        """
        bad = ~np.isfinite(answers)
        values = np.where(bad, np.inf, answers)
        count = len(values)
        if self.target is not None and values.min() <= self.target:
            count = int((values <= self.target).argmax()) + 1
        self.left -= count
        self.missing += int(bad[:count].sum())
        k = int(values[:count].argmin())
        if values[k] < self.best:
            self.best, self.x = float(values[k]), x[k]
            place = self.granted - self.left - count + k + 1
            self.control.incumbent(self.best, BlackBoxPoint(tuple(x[k].tolist())), place)
        self.control.evaluated(count)
        found: Floats = values
        return found


def latin_hypercube(generator: np.random.Generator, count: int, dimension: int) -> Floats:
    """Return points of the unit cube, shape (count, dimension), one in each slice of each variable.

    SciPy's sampler would load its statistics, which takes longer than most searches.
    """
    slices = np.tile(np.arange(count), (dimension, 1))
    drawn: Floats = generator.permuted(slices, axis=1).T + generator.random((count, dimension))
    return drawn / count


class BlackBoxBackend(Backend):
    """Base of the searches; a subclass only says which points it wants to know the values of."""

    accepts = BlackBoxMinimisation
    guarantee = Guarantee.HEURISTIC
    features = frozenset(
        {
            *(Feature.SEED, Feature.EVALUATIONS, Feature.INCUMBENTS, Feature.INTERRUPT),
            Feature.WARM_START,
        }
    )
    single_threaded = True
    #: Free variables at the most, and why; 0 where any number will do.
    most: ClassVar[int] = 0
    grows: ClassVar[str] = ""

    def refuses(self, problem: BlackBoxMinimisation) -> str:
        """Return why there are too many variables."""
        free = int((problem.highs > problem.lows).sum())
        if not self.most or free <= self.most:
            return ""
        return f"it takes at most {self.most} variables that are free, got {free}: {self.grows}"

    @abstractmethod
    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Ask for values until the search ends itself or ``Ended`` is raised through it.

        Parameters
        ----------
        objective : Objective
            At least one variable is free.

        Returns
        -------
        mapping
            Statistics of its own.
        """

    def run(self, problem: BlackBoxMinimisation, request: Request) -> Answer:
        """Search, and answer with the best point met."""
        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r}: {refusal}")
        begin = clock()
        objective = Objective(problem, request)
        own: Mapping[str, Any] = {}
        limit: Limit | None = None
        message = ""
        try:
            if request.warm_start is not None or not objective.dimension:
                given = problem.lows if request.warm_start is None else request.warm_start.x
                # The point itself, which the way through the unit cube would round.
                x = np.clip(np.asarray(given, float), problem.lows, problem.highs)
                objective.start = np.clip(objective.unit(x), 0.0, 1.0)
                objective.at(x[None])
            if objective.dimension:
                own = self.search(objective)
        except Ended:
            limit = request.control.reason or Limit.EVALUATIONS
        except InvalidData as error:
            if objective.x is None:
                raise
            message = str(error)  # what the function raised; the points before it are not lost
        used = objective.granted - objective.left
        counts: dict[str, Any] = {"evaluations": used, "variables": objective.dimension}
        if objective.missing:
            counts["points without a value"] = objective.missing
            lacking = f"the function has no value at {objective.missing} of {used} points"
            message = f"{message}; {lacking}" if message else lacking
        found = objective.x is not None
        return Answer(
            Termination.FEASIBLE if found else Termination.NO_SOLUTION,
            limit,
            BlackBoxPoint(tuple(objective.x.tolist())) if objective.x is not None else None,
            objective.best if found else None,
            seconds={"solve": clock() - begin},
            statistics={**counts, **own},
            message=message,
        )
