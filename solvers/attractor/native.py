"""What all backends of an attractor share: the embedding they work in, and how an answer is made."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import clock
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from ..option import Option

__all__ = ["EMBEDDING", "AttractorBackend", "Embedding", "Finding", "embed"]

Floats = NDArray[np.float64]

#: Options of the backends that work in an embedding.
EMBEDDING: Mapping[str, Option] = {
    "delay": Option(None, "samples between coordinates; chosen from the series", int, lower=1),
    "dimension": Option(
        None, "coordinates of a state; chosen from the series", int, lower=1, upper=1000
    ),
    "theiler": Option(
        None,
        "samples that neighbours must be more than apart; chosen from the series",
        int,
        lower=0,
    ),
}


@dataclass(frozen=True)
class Embedding:
    """How states are made of a series.

    Parameters
    ----------
    delay, dimension, theiler : int
        As in :class:`~crosstrack.models.attractor.AttractorEstimate`.
    """

    delay: int
    dimension: int
    theiler: int


@dataclass(frozen=True)
class Finding:
    """What a backend found.

    Parameters
    ----------
    plan : AttractorEstimate
        The estimate.
    statistics : mapping
        Counts and figures of its own.
    message : str
        What a person should know, such as that there is no scaling region.
    """

    plan: AttractorEstimate
    statistics: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""


def embed(problem: AttractorAnalysis, options: Mapping[str, Any]) -> Embedding:
    """Return the embedding that `options` ask for; what they leave open is chosen from the series.

    The delay is the first minimum of the mutual information, the dimension Cao's, and the Theiler window the longest
    of the span of a state and the first zero of the autocorrelation.

    Raises
    ------
    InvalidData
        The series is too short for it.
    """
    from .information import first_minimum, first_zero
    from .unfolding import cao_dimension

    series = problem.series
    delay = options.get("delay") or first_minimum(series)
    dimension = options.get("dimension") or cao_dimension(series, delay)
    theiler = options.get("theiler")
    if theiler is None:
        theiler = min(max((dimension - 1) * delay, first_zero(series)), len(series) // 10)
    problem.states(delay, dimension)  # raises where there are too few samples
    return Embedding(delay, dimension, theiler)


class AttractorBackend(Backend):
    """Base of the backends; a subclass only says what it finds."""

    accepts = AttractorAnalysis
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    options = EMBEDDING

    @abstractmethod
    def find(self, problem: AttractorAnalysis, request: Request) -> Finding | None:
        """Return what is found, or None where the run was stopped before."""

    def run(self, problem: AttractorAnalysis, request: Request) -> Answer:
        """Analyse the series, and answer with the estimate."""
        begin = clock()
        with np.errstate(all="ignore"):
            found = self.find(problem, request)
        seconds = {"solve": clock() - begin}
        if found is None:
            reason = request.control.reason or Limit.TIME
            return Answer(Termination.NO_SOLUTION, reason, seconds=seconds)
        plan = found.plan
        most = len(problem.series) - plan.window - 2
        if plan.theiler > most:
            raise InvalidData(
                f"theiler must be <= {most} for delay {plan.delay} and dimension {plan.dimension}, else no "
                f"state has a neighbour; got {plan.theiler}",
                field="theiler",
            )
        limit = request.control.reason if request.control.stopped else None
        return Answer(
            Termination.FEASIBLE, limit, plan, None,
            seconds=seconds, statistics=found.statistics, message=found.message,
        )  # fmt: skip
