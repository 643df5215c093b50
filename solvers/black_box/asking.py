"""Searches of black boxes by ask and tell: the caller evaluates the points."""

from __future__ import annotations

import threading
import weakref
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendBroken, CrosstrackError, InvalidData, UnsupportedFormulation, show
from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ...models.records import given
from ..contract.backend import Answer, Backend, Control, Feature, Limit, Request
from ..contract.job import Job
from ..contract.limits import limits_of
from .native import Ended

__all__ = ["AskTell", "prepare_black_box"]

Floats = NDArray[np.float64]

#: Options of a run that a search by ask and tell accepts.
OPTIONS = ("seed", "evaluations", "target", "warm_start")
#: Seconds to wait for the thread of a search that is closed.
_JOIN = 5.0


class _Exchange:
    """Oracle that waits for the values from the caller, and the outcome of the search."""

    def __init__(self, columns: int) -> None:
        self.changed = threading.Condition()
        self.columns, self.closed = columns, False
        #: Points of the request, their values, and which of these are known; None if there is no request.
        self.points: Floats | None = None
        self.values, self.known = np.empty((0, columns)), np.empty(0, bool)
        self.answer: Answer | None = None
        self.error: BaseException | None = None
        self.best: tuple[float, Any] | None = None

    def __call__(self, points: Floats) -> Floats:
        """Return the values at `points`, shape (m, columns), when the caller has given all of them."""
        with self.changed:
            self.points = points
            self.values, self.known = (
                np.empty((len(points), self.columns)),
                np.zeros(len(points), bool),
            )
            self.changed.notify_all()
            self.changed.wait_for(lambda: self.closed or self.known.all())
            if self.closed:
                raise Ended
            self.points = None
            return self.values

    def keep(self, objective: float, point: Any) -> None:
        """Store the best point."""
        if self.best is None or objective < self.best[0]:
            self.best = objective, point

    def run(self, backend: Backend, model: BlackBoxMinimisation, request: Request) -> None:
        """Run the search in its thread."""
        try:
            answer, error = backend.run(model, request), None
        except BaseException as caught:  # raised in the caller's thread
            answer, error = None, caught
        with self.changed:
            self.answer, self.error = answer, error
            self.changed.notify_all()

    def close(self, control: Control) -> None:
        """End the search at its next request."""
        control.stop(Limit.INTERRUPTED)
        with self.changed:
            self.closed = True
            self.changed.notify_all()


class AskTell:
    """Search of a black box whose points the caller evaluates; created by :func:`crosstrack.prepare`.

    The points equal those of :func:`crosstrack.solve` with the same seed and the same values. The search runs in a
    thread, which waits for values; use the object in a ``with`` block or call :meth:`close`.

    Parameters
    ----------
    job : Job
        Model, backend and options.

    Raises
    ------
    CrosstrackError
        The backend does not support the model or an option.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import BlackBoxMinimisation
    >>> box = BlackBoxMinimisation(None, [[-1, 2], [-1, 2]], budget=60)
    >>> with ct.prepare(box, "differential-evolution", seed=1) as search:
    ...     while not search.done:
    ...         xs = search.ask()
    ...         search.tell(xs, (xs**2).sum(axis=1))
    >>> search.value < 0.1
    True
    """

    def __init__(self, job: Job) -> None:
        job = job.resolved()
        job.find_target()  # raises for unsupported options
        model, backend = job.model, job.backend
        assert isinstance(backend, Backend) and isinstance(model, BlackBoxMinimisation)
        if refusal := backend.refuses(model):
            raise UnsupportedFormulation(f"backend {backend.name!r}: {refusal}")
        exchange = self._exchange = _Exchange(model.columns)
        control = self._control = Control(job.criterion, exchange.keep, oracle=exchange)
        self._name, self._dimension = backend.name, model.dimension
        backend.prepare()
        request = Request(
            seed=job.seed if Feature.SEED in backend.features else None, evaluations=job.evaluations, target=job.target, warm_start=job.warm_start,
            options=backend.checked_options(job.backend_options), control=control,
        )  # fmt: skip
        arguments = backend, model.blinded(), request
        self._thread = threading.Thread(target=exchange.run, args=arguments, daemon=True)
        self._thread.start()
        weakref.finalize(self, exchange.close, control)

    @property
    def done(self) -> bool:
        """Whether the search has ended: by its budget, its target, itself or :meth:`close`."""
        return self._settled().points is None

    @property
    def best(self) -> BlackBoxPoint | None:
        """Best point of the requests whose values are complete; None before the first one with a value."""
        exchange = self._settled()
        if exchange.answer is not None and exchange.answer.point is not None:
            point: BlackBoxPoint = exchange.answer.point
            return point
        return None if exchange.best is None else exchange.best[1]

    @property
    def value(self) -> float:
        """Objective of :attr:`best`, infinite without one."""
        best = self._settled().best
        return np.inf if best is None else best[0]

    @property
    def message(self) -> str:
        """Remark of the search after its end, such as the limit that ended it."""
        answer = self._settled().answer
        if answer is None:
            return ""
        limit = f"limit: {answer.limit}" if answer.limit else ""
        return "; ".join(text for text in (limit, answer.message) if text)

    def ask(self) -> Floats:
        """Return the points whose values the search needs next.

        Returns
        -------
        ndarray, shape (m, d)
            All points of the current request without a value, such as the rest of a generation. Empty after
            the end of the search.

        Raises
        ------
        CrosstrackError
            The search has failed.
        """
        exchange = self._settled()
        if exchange.points is None:
            return np.empty((0, self._dimension))
        return exchange.points[~exchange.known].copy()

    def tell(self, xs: ArrayLike, values: ArrayLike) -> None:
        """Pass values to the search, in any order and in several parts.

        Parameters
        ----------
        xs : array_like, shape (k, d) or (d,)
            Points from :meth:`ask`.
        values : array_like, shape (k,), (k, columns) or (columns,)
            Their values: objectives, inequalities, equalities. NaN or infinity marks a point without a value. With
            `repeats` the value of a point is the mean of its evaluations, and each of them counts.

        Raises
        ------
        InvalidData
            A point was not asked for or has its value, or the shapes differ. Nothing is stored then.
        """
        exchange = self._settled()
        points = np.atleast_2d(_numbers("xs", xs))
        table = _numbers("values", values)
        if points.ndim != 2 or points.shape[1] != self._dimension:
            raise InvalidData(
                f"xs must have shape (k, {self._dimension}), got {points.shape}", field="xs"
            )
        shape = len(points), exchange.columns
        if table.size != shape[0] * shape[1] or (table.ndim > 1 and table.shape != shape):
            raise InvalidData(f"values must have shape {shape}, got {table.shape}", field="values")
        with exchange.changed:
            rows: defaultdict[bytes, list[int]] = defaultdict(list)
            if exchange.points is not None:
                for row in np.flatnonzero(~exchange.known)[::-1].tolist():
                    rows[_key(exchange.points[row])].append(row)
            places = []
            for k, x in enumerate(points):
                if not rows[_key(x)]:
                    raise InvalidData(
                        f"xs[{k}] must be a point from ask() without a value, got {show(x.tolist())}",
                        field="xs",
                    )
                places.append(rows[_key(x)].pop())
            exchange.values[places] = table.reshape(shape)
            exchange.known[places] = True
            exchange.changed.notify_all()

    def close(self) -> None:
        """End the search; :attr:`best` remains."""
        self._exchange.close(self._control)
        self._thread.join(_JOIN)

    def __enter__(self) -> AskTell:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _settled(self) -> _Exchange:
        """Return the exchange when the search waits for values or has ended, or raise its error."""
        exchange = self._exchange

        def waits() -> bool:
            return (
                exchange.points is not None and not exchange.known.all()
            ) or not self._thread.is_alive()

        with exchange.changed:
            while not (exchange.closed or exchange.answer or exchange.error or waits()):
                exchange.changed.wait(1.0)
            if exchange.closed:
                exchange.points = None
        if exchange.error is None or exchange.closed:
            return exchange
        if isinstance(exchange.error, CrosstrackError):
            raise exchange.error
        text = f"{type(exchange.error).__name__}: {exchange.error}"
        raise BackendBroken(f"backend {self._name!r} failed: {text}") from exchange.error


def _key(x: Floats) -> bytes:
    return (x + 0.0).tobytes()  # without negative zeros


def _numbers(name: str, value: ArrayLike) -> Floats:
    try:
        raw = np.asarray(value)
        if raw.dtype.kind in "biuf":
            return raw.astype(np.float64)
    except ValueError:  # rows of different length
        pass
    raise InvalidData(f"{name} must be an array of numbers, got {show(value)}", field=name)


def prepare_black_box(
    model: BlackBoxMinimisation, backend: Any = "auto", backend_options: Any = None, **options: Any
) -> AskTell:
    """Return a search by ask and tell; refuse options that it does not have.

    The function of the model is not called and may be None. The options are `seed`, `evaluations`, `target` and
    `warm_start`, as in :func:`crosstrack.solve`.
    """
    limits = limits_of("prepare", options.pop("limits", None), options)
    limits.require_only("prepare for a black box", OPTIONS)
    fields = limits.changes()
    if "warm_start" in fields:
        fields["warm_start"] = start = model.as_plan(fields["warm_start"])
        x = np.array(start.x)
        if len(x) != model.dimension or (model.layout.canonical(x) != x).any():
            raise InvalidData(
                f"warm_start must be a point of the {model.dimension} variables within their bounds, got "
                f"{show(list(start.x))}",
                field="warm_start",
            )
    own = given("backend_options", backend_options)
    return AskTell(Job(model, backend, backend_options=own, **fields))
