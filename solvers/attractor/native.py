"""Base of the backends for attractors: choice of the embedding, and construction of the answer."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import OutOfTime, clock
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from ..contract.option import Option
from .embedding import cao_dimension, first_minimum, first_zero, mean_period

__all__ = [
    "EMBEDDING", "AttractorBackend", "Embedding", "Finding", "Poll", "RunStopped", "embed", "poll_of",
    "run_stage", "theiler_window",
]  # fmt: skip

Floats = NDArray[np.float64]
#: Function that raises :class:`RunStopped` after a stop request; ``bool`` does nothing.
Poll = Callable[[], object]


#: End of a backend's work by a stop request or the end of interpreted loops; :meth:`AttractorBackend.run` catches it.
RunStopped = OutOfTime


def poll_of(request: Request) -> Poll:
    """Return the function that raises :class:`RunStopped` if a stop of the run is requested."""

    def poll() -> None:
        if request.control.stopped:
            raise RunStopped

    return poll


def run_stage(
    backend: AttractorBackend,
    problem: AttractorAnalysis,
    request: Request,
    options: Mapping[str, Any] | None = None,
) -> Answer:
    """Return the answer of another backend; raise :class:`RunStopped` if it was stopped without a plan."""
    answer = request.within(backend, problem, options=options)
    if answer.point is None:
        raise RunStopped
    return answer


#: Backends that analyse one series and refuse models with further coordinates.
ONE_SERIES = frozenset(
    {
        "full-analysis", "surrogates", "mutual-information", "autocorrelation", "c-c", "improved-c-c", "cao",
        "false-neighbours", "small-data-sets", "g-p",
    }
)  # fmt: skip
#: Options for the embedding.
EMBEDDING: Mapping[str, Option] = {
    "delay": Option(None, "samples between coordinates; by default from the series", int, lower=1),
    "dimension": Option(
        None, "coordinates of a state; by default from the series", int, lower=1, upper=1000
    ),
    "theiler": Option(
        None,
        "smallest distance in time of neighbours, exclusive, samples; by default from the series",
        int,
        lower=0,
    ),
}


@dataclass(frozen=True)
class Embedding:
    """Embedding of a series, as in :class:`~crosstrack.models.attractor.AttractorEstimate`."""

    delay: int
    dimension: int
    theiler: int

    def plan(self, **parts: Any) -> AttractorEstimate:
        """Return the estimate of this embedding with further parts."""
        return AttractorEstimate(self.delay, self.dimension, self.theiler, **parts)


@dataclass(frozen=True)
class Finding:
    """Result of a backend: estimate, statistics, and a remark such as the lack of a scaling region."""

    plan: AttractorEstimate
    statistics: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""


def embed(problem: AttractorAnalysis, options: Mapping[str, Any]) -> Embedding:
    """Return the embedding of `options` (:data:`EMBEDDING`); missing parts are chosen from the series.

    The delay is the first minimum of the mutual information, at most a quarter of the mean period (rounded). The
    dimension is Cao's; with further coordinates, the smallest that yields at least as many values per state. The
    Theiler window is the larger of the span of a state and the first zero of the autocorrelation. Raise InvalidData
    if the series is too short.
    """
    series = problem.series
    delay = options.get("delay")
    if not delay:
        delay = max(min(first_minimum(series)[0], round(mean_period(series) / 4.0)), 1)
    width = len(problem.coordinates)
    dimension = options.get("dimension") or -(-cao_dimension(series, delay) // width)
    theiler = options.get("theiler")
    if theiler is None:
        theiler = theiler_window(series, delay, dimension)
    problem.states(delay, dimension)  # raises if there are too few samples
    return Embedding(delay, dimension, theiler)


def theiler_window(series: Floats, delay: int, dimension: int) -> int:
    """Return the span of a state or the first zero of the autocorrelation, whichever is larger, in samples."""
    return min(max((dimension - 1) * delay, first_zero(series)), len(series) // 10)


class AttractorBackend(Backend):
    """Base of the backends for attractors; a subclass implements `find`."""

    accepts = AttractorAnalysis
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    shares_process = True
    options = EMBEDDING

    def refuses(self, problem: AttractorAnalysis) -> str:
        """Return a reason if the model has further coordinates that the backend would ignore."""
        if problem.further is None or self.name not in ONE_SERIES:
            return ""
        return "further coordinates: it analyses one series. Omit the field further or choose another backend"

    @abstractmethod
    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Return the result; raise :class:`RunStopped` if a stop is requested before."""

    def run(self, problem: AttractorAnalysis, request: Request) -> Answer:
        """Analyse the series and return the estimate, see :meth:`Backend.run`."""
        self.require_support(problem)
        begin = clock()
        try:
            with np.errstate(all="ignore"):
                finding = self.find(problem, request)
        except RunStopped:
            reason = request.control.reason or Limit.TIME
            return Answer(Termination.NO_SOLUTION, reason, seconds={"solve": clock() - begin})
        seconds = {"solve": clock() - begin}
        plan = finding.plan
        largest = len(problem.series) - plan.window - 2
        if plan.theiler > largest:
            raise InvalidData(
                f"theiler must be <= {largest} for delay {plan.delay} and dimension {plan.dimension}, else no "
                f"state has a neighbour; got {plan.theiler}",
                field="theiler",
            )
        return Answer(
            Termination.FEASIBLE, request.control.limit, plan, None,
            seconds=seconds, statistics=finding.statistics, message=finding.message,
        )  # fmt: skip
