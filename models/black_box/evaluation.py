"""Evaluations of a Python function in a run: batches, look-ahead in workers, failures and records."""

from __future__ import annotations

import math
from collections import Counter, defaultdict, deque
from concurrent.futures import CancelledError, Future, TimeoutError as NotYet
from time import perf_counter as clock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from .record import Record
from .workers import pool_of

__all__ = ["Evaluation"]

Floats = NDArray[np.float64]
#: Values at a point, and the error of the function there or "".
Row = tuple[Floats, str]

#: Largest number of points per call of a vectorised function.
_MOST = 2**13


class Evaluation:
    """Evaluations of a Python function, answered in the order of the requests.

    A `record` has stored evaluations, which are not repeated, and receives new ones. `used` counts the points whose
    evaluation was started, and `skipped` those at which the function failed, the first time with `message`. `parallel`
    points are evaluated at once. With `is_direct`, the function takes one point in this process and returns one number.
    """

    def __init__(self, function: Any, columns: int, record: Record | None = None) -> None:
        self._function, self._columns, self._record = function, columns, record
        self.used, self.skipped, self.message = 0, 0, ""
        self._pool = pool_of(function)
        self.parallel = 1 if self._pool is None else self._pool.parallel
        self.is_direct = not (self.has_workers or function.vectorized or record or columns > 1)
        self._error: InvalidData | None = None
        #: Evaluations that were started and not requested yet, by point, and the calls in the workers.
        self._started: defaultdict[bytes, deque[Future[Row]]] = defaultdict(deque)
        self._calls: set[Future[Any]] = set()

    @property
    def has_workers(self) -> bool:
        """Whether the function is called by workers."""
        return self._pool is not None

    def fresh(self, points: Floats) -> int:
        """Return the number of rows of `points` whose evaluation has not been started."""
        return len(points) - (len(self._matched(points)) if self._started else 0)

    def start(self, points: Floats) -> None:
        """Start the evaluation of `points`, shape (m, d), in the workers; no effect without workers."""
        if self._pool is None:
            return
        missing: list[tuple[Floats, Future[Row]]] = []
        for x in points:
            future: Future[Row] = Future()
            self._started[x.tobytes()].append(future)
            stored = self._stored(x)
            if stored is None:
                missing.append((x, future))
            else:
                future.set_result(stored)
        size = min(-(-len(missing) // self.parallel), _MOST) if self._function.vectorized else 1
        for first in range(0, len(missing), max(size, 1)):
            self._call(missing[first : first + size])

    def part(self, points: Floats, seconds: float = math.inf, multiple: int = 1) -> Floats:
        """Return the values at the first rows of `points` that end within `seconds`, in multiples of `multiple`.

        Without workers they include at least the first row, and with a vectorised function all rows. If the function
        fails at one of the first `multiple` rows, the error is raised.
        """
        self.raise_error()
        end = clock() + seconds
        rows: list[Row] = []
        if self._pool is not None:
            matched = self._matched(points)
            self.start(points[[row for row in range(len(points)) if row not in matched]])
        try:
            while (done := len(rows)) < len(points):
                may_end = done % multiple == 0
                if self._pool is not None:
                    rows.append(self._next(points[done], end if may_end else math.inf))
                elif rows and may_end and clock() >= end:
                    break
                elif self._function.vectorized:
                    rows += self._batch(points[done : done + _MOST])
                else:
                    x = points[done]
                    rows.append(self._stored(x) or self._rows(x[None])[0])
        except NotYet:
            pass
        except InvalidData as error:
            if len(rows) < multiple:
                raise
            self._error = error
            del rows[len(rows) - len(rows) % multiple :]
        return self._counted(rows)

    def direct(self, points: Floats) -> Floats:
        """Return the value at one point, shape (1, d), with little overhead if :attr:`is_direct`."""
        if self._error is not None:
            return self.part(points)
        self.used += 1
        try:
            result = self._function.call(points[0].copy())
        except (Exception, SystemExit) as error:
            text = f"raised {type(error).__name__}: {error}"
            return self._counted(self._finished(points, None, text, None, error))
        value: Floats = self._function.numbers(points[0], result, 1)
        return value

    def _counted(self, rows: list[Row]) -> Floats:
        """Return the values of rows as an array, and count those that were skipped."""
        for _, text in rows:
            if text:
                self.skipped += 1
                self.message = self.message or text
        return np.array([row for row, _ in rows]).reshape(len(rows), self._columns)

    def all(self, points: Floats) -> Floats:
        """Return the values at all `points`, shape (m, columns)."""
        values = self.part(points)
        self.raise_error()
        return values

    def raise_error(self) -> None:
        """Raise the error that ended the previous request early, if there is one."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def close(self) -> None:
        """Cancel the evaluations that no worker has begun, and close the record."""
        for call in tuple(self._calls):
            call.cancel()
        if self._record is not None:
            self._record.close()

    def _stored(self, x: Floats) -> Row | None:
        """Count an evaluation at `x` and return its stored values if the record has them."""
        self.used += 1
        return None if self._record is None else self._record.take(x)

    def _rows(self, points: Floats) -> list[Row]:
        """Return the values at `points` by one call of the function in this process."""
        at, begin = (points if self._function.vectorized else points[0]), clock()
        cause: BaseException | None = None
        result, text = None, ""
        try:
            result = self._function.call(at.copy())  # protects the points from the function
        except (Exception, SystemExit) as error:
            cause, text = error, f"raised {type(error).__name__}: {error}"
        if text and len(points) > 1 and self._function.on_error == "skip":
            return [self._rows(x[None])[0] for x in points]  # finds the failing points
        return self._finished(points, result, text, clock() - begin, cause)

    def _finished(
        self,
        points: Floats,
        result: Any,
        text: str,
        seconds: float | None,
        cause: BaseException | None,
    ) -> list[Row]:
        """Return and store the values of a call, or NaN at a point that is skipped."""
        at = points if self._function.vectorized else points[0]
        if text:
            failure = self._function.failure(at, text)
            if self._function.on_error == "raise":
                raise failure from cause
            text, seconds = str(failure), None
            table = np.full((1, self._columns), np.nan)
        else:
            table = self._function.numbers(at, result, self._columns)
        if self._record is not None:
            share = None if seconds is None else seconds / len(points)
            for x, row in zip(points, table, strict=True):
                self._record.add(x, row, share, text)
        return [(row, text) for row in table]

    def _batch(self, points: Floats) -> list[Row]:
        rows = [self._stored(x) for x in points]
        missing = [k for k, row in enumerate(rows) if row is None]
        new = iter(self._rows(points[missing]) if missing else ())
        return [next(new) if row is None else row for row in rows]

    # -- in workers

    def _matched(self, points: Floats) -> dict[int, Future[Row]]:
        """Return the evaluations that were started, by row of `points`."""
        seen: Counter[bytes] = Counter()
        result: dict[int, Future[Row]] = {}
        for row, x in enumerate(points):
            key = x.tobytes()
            if seen[key] < len(self._started.get(key, ())):
                result[row] = self._started[key][seen[key]]
            seen[key] += 1
        return result

    def _call(self, rows: list[tuple[Floats, Future[Row]]]) -> None:
        assert self._pool is not None
        points = np.array([x for x, _ in rows])
        at = points if self._function.vectorized else points[0]
        self._calls.add(self._pool.submit(at.copy(), lambda call: self._end(rows, points, call)))

    def _end(
        self, rows: list[tuple[Floats, Future[Row]]], points: Floats, call: Future[Any]
    ) -> None:
        """Pass on the values of a call that has ended; runs in a thread of the executor."""
        assert self._pool is not None
        self._calls.discard(call)
        try:
            result, text, seconds = self._pool.outcome(call)
            if text and len(rows) > 1 and self._function.on_error == "skip":
                for row in rows:
                    self._call([row])
                return
            values = self._finished(points, result, text, seconds, None)
        except BaseException as error:  # also of a call that was cancelled
            for _, future in rows:
                future.set_exception(error)
        else:
            for (_, future), value in zip(rows, values, strict=True):
                future.set_result(value)

    def _next(self, x: Floats, end: float) -> Row:
        """Return the values at a point whose evaluation was started; raise ``TimeoutError`` after `end`."""
        key = x.tobytes()
        future = self._started[key][0]
        try:
            return future.result(None if end == math.inf else max(end - clock(), 0.0))
        except CancelledError:
            raise InvalidData("workers: an evaluation was cancelled", field="workers") from None
        finally:
            if future.done():
                self._started[key].popleft()
                if not self._started[key]:
                    del self._started[key]
