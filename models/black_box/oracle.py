"""Oracle of a black box: counted and checked evaluations of one run."""

from __future__ import annotations

import math
from contextvars import copy_context
from operator import le
from time import perf_counter as clock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from .functions import PythonFunction

__all__ = ["Oracle"]

Floats = NDArray[np.float64]

#: Seconds after which a partial answer returns, so that the search can end.
_QUESTION = 0.1
#: Fields of the model that a record must have.
_HEADER = ("bounds", "variables", "objectives", "inequalities", "equalities")


class Oracle:
    """Counted evaluations of one run, called with points of shape (m, d); `left` evaluations remain."""

    def __init__(self, model: Any) -> None:
        self.model = model
        #: Duration of all partial answers.
        self._seconds = 0.0
        self.left = model.budget
        self._lows, self._highs = model.lows, model.highs
        self._noise = np.random.default_rng(model.scene_seeds(1)[0])
        # The function runs with the settings of the caller, for example of NumPy errors.
        self._context = copy_context()
        self._evaluation: Any = None
        self._has_workers = self._is_simple = False
        self._shape = 1, model.dimension
        self._least, self._most = self._lows.tolist(), self._highs.tolist()
        if isinstance(model.function, PythonFunction):
            fields = {name: (spec, value) for name, spec, value in model._content()}
            header = {
                name: fields[name][0].encode(fields[name][1]) for name in _HEADER if name in fields
            }
            self._evaluation = model.function.evaluation(model.columns, model.dimension, header)
            self._has_workers = self._evaluation.has_workers
            plain = model.variables is None and model.repeats == 1
            self._is_simple = plain and self._evaluation.is_direct
        elif model.function.type == "none":
            model.function.values(model.lows[None])  # raises

    def __call__(self, points: Floats) -> Floats:
        """Return the values at `points`, shape (m, columns), including the noise.

        A point that is not allowed, a used-up budget and a failed function raise ``InvalidData``.
        """
        return self._answer(points, math.inf)

    def part(self, points: Floats) -> Floats:
        """Return the values at the first rows of `points`, those that end within a tenth of a second.

        In this process one point is evaluated at least, and all points if the function is vectorised.
        """
        if self._is_simple and points.shape == self._shape and self.left:
            x = points[0].tolist()
            # Faster than comparisons of arrays, which the other path makes.
            if all(map(le, self._least, x)) and all(map(le, x, self._most)):
                self.left -= 1
                result: Floats = self._context.copy().run(self._evaluation.direct, points)
                return result
        # The first answers return at once, so that they are known if a later call hangs.
        begin = clock()
        answers = self._answer(points, min(_QUESTION, self._seconds))
        self._seconds += clock() - begin
        return answers

    def start(self, points: Floats) -> Floats:
        """Start evaluations that will be requested, if there are workers; return how many run at once, shape (1, 1)."""
        evaluation = self._evaluation
        if evaluation is None:
            return np.ones((1, 1))
        if len(points) and self._has_workers:
            points = self._admitted(points, new=True)
            self.left -= len(points)
            evaluation.start(points)
        return np.full((1, 1), float(evaluation.parallel))

    def close(self) -> None:
        """End the evaluations that were not requested."""
        if self._evaluation is not None:
            self._evaluation.close()

    def remarks(self) -> tuple[dict[str, Any], str]:
        """Return statistics and a message for the solution: the number of skipped points."""
        if self._evaluation is None or not self._evaluation.skipped:
            return {}, ""
        count = self._evaluation.skipped
        return {
            "skipped evaluations": count
        }, f"{count} evaluations skipped, the first: {self._evaluation.message}"

    def _answer(self, points: Floats, seconds: float) -> Floats:
        model, evaluation = self.model, self._evaluation
        if evaluation is not None:
            evaluation.raise_error()
        repeated = self._admitted(points)
        if evaluation is None:
            self.left -= len(repeated)
            values = np.asarray(model.function.table(repeated, model.columns), np.float64)
            if model.function.noise:
                values = values + self._noise.normal(0.0, model.function.noise, (len(values), 1))
        else:
            before = evaluation.used
            try:
                run = self._context.copy().run
                if seconds == math.inf:
                    values = run(evaluation.all, repeated)
                else:
                    values = run(evaluation.part, repeated, seconds, model.repeats)
            finally:
                self.left -= evaluation.used - before
        if model.repeats == 1:
            return values
        means: Floats = values.reshape(-1, model.repeats, model.columns).mean(axis=1)
        return means

    def _admitted(self, points: Floats, *, new: bool = False) -> Floats:
        """Return allowed points, each as often as it is evaluated; `new` if none was started."""
        model = self.model
        if points.ndim != 2 or points.shape[1] != len(self._lows):
            raise InvalidData(
                f"points must have shape (m, {model.dimension}), got {points.shape}", field="x"
            )
        repeated = points if model.repeats == 1 else np.repeat(points, model.repeats, axis=0)
        count = len(repeated)
        if self._has_workers and not new:
            count = self._evaluation.fresh(repeated)
        if count > self.left:
            raise InvalidData(
                f"budget: {count} evaluations asked for, {self.left} of {model.budget} left",
                field="budget",
            )
        is_inside = (points >= self._lows) & (points <= self._highs)
        if not np.logical_and.reduce(is_inside, axis=None):
            row, k = np.argwhere(~is_inside)[0].tolist()
            raise InvalidData(
                f"x[{k}] must lie in [{self._lows[k]:g}, {self._highs[k]:g}], got "
                f"{show(float(points[row, k]))}",
                field="x",
            )
        if model.variables is not None:
            wrong = points != model.layout.canonical(points)
            if wrong.any():
                row, k = np.argwhere(wrong)[0].tolist()
                raise InvalidData(
                    f"x[{k}] must be a value of its variable, at its lower bound if its condition fails, got "
                    f"{show(float(points[row, k]))}",
                    field="x",
                )
        return repeated
