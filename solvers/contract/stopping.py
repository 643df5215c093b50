"""Composable stopping criteria.

``Seconds(60) | Target(120.0)`` stops if one of them is reached, ``Evaluations(5000) & Stalled(2.0)``
if both are. The design follows PyVRP's ``stop`` package (Wouda, Lan and Kool, doi
10.1287/ijoc.2023.0055).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from ...errors import UnsupportedOption
from ...models.fields import show
from .enums import Limit

__all__ = [
    "AllOf",
    "AnyOf",
    "Criterion",
    "Evaluations",
    "Progress",
    "Seconds",
    "Stalled",
    "Target",
]


@dataclass(frozen=True)
class Progress:
    """Progress of a run, as seen by the stopping criteria.

    Parameters
    ----------
    seconds : float
        Seconds since the start.
    evaluations : int
        Evaluations of the objective so far, if the backend counts them.
    best : float
        Best objective so far; infinity before the first plan.
    stalled : float
        Seconds since the last improvement, or since the start.
    """

    seconds: float
    evaluations: int
    best: float
    stalled: float


class Criterion(ABC):
    """Stopping criterion, checked after every evaluation and incumbent, and every 0.1 s."""

    @abstractmethod
    def reached(self, progress: Progress) -> Limit | None:
        """Return the limit if it is reached; None while the run may continue.

        Parameters
        ----------
        progress : Progress
            Progress of the run.
        """

    def maximising(self) -> Criterion:
        """Return the criterion for a run that minimises the negated objective."""
        return self

    def __or__(self, other: Criterion) -> AnyOf:
        return AnyOf((self, other))

    def __and__(self, other: Criterion) -> AllOf:
        return AllOf((self, other))


def _number(name: str, value: Any, lower: float, strict: bool) -> None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    # NaN fails every comparison.
    if not is_number or not (value > lower if strict else value >= lower):
        raise UnsupportedOption(
            f"{name} must be a number {'>' if strict else '>='} {lower:g}, got {show(value)}"
        )


def _criteria(value: Any) -> None:
    is_tuple = isinstance(value, tuple) and value
    if not is_tuple or not all(isinstance(criterion, Criterion) for criterion in value):
        raise UnsupportedOption(f"criteria must be a tuple of Criterion, got {show(value)}")


@dataclass(frozen=True)
class Seconds(Criterion):
    """Criterion that stops a run after `limit` seconds.

    Parameters
    ----------
    limit : float
        Seconds since the start, > 0.
    """

    limit: float

    def __post_init__(self) -> None:
        _number("limit of Seconds", self.limit, 0.0, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.TIME if progress.seconds >= self.limit else None


@dataclass(frozen=True)
class Evaluations(Criterion):
    """Criterion that stops a run after `limit` evaluations of the objective.

    Parameters
    ----------
    limit : int
        Number of evaluations, >= 1.
    """

    limit: int

    def __post_init__(self) -> None:
        _number("limit of Evaluations", self.limit, 1, False)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.EVALUATIONS if progress.evaluations >= self.limit else None


@dataclass(frozen=True)
class Target(Criterion):
    """Criterion that stops a run at a plan with an objective of at most `value`, or at least for a maximisation.

    Parameters
    ----------
    value : float
        Objective that is good enough, in the sense of the model's author.
    """

    value: float

    def __post_init__(self) -> None:
        _number("value of Target", self.value, -math.inf, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.TARGET if progress.best <= self.value else None

    def maximising(self) -> Criterion:
        return Target(-self.value)


@dataclass(frozen=True)
class Stalled(Criterion):
    """Criterion that stops a run without improvement for `limit` seconds.

    Parameters
    ----------
    limit : float
        Seconds since the last improvement, > 0.
    """

    limit: float

    def __post_init__(self) -> None:
        _number("limit of Stalled", self.limit, 0.0, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.STALLED if progress.stalled >= self.limit else None


@dataclass(frozen=True)
class AnyOf(Criterion):
    """Criterion that stops a run if one of several criteria is reached; names its limit.

    Parameters
    ----------
    criteria : tuple of Criterion
        The criteria.
    """

    criteria: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        _criteria(self.criteria)

    def reached(self, progress: Progress) -> Limit | None:
        limits = (criterion.reached(progress) for criterion in self.criteria)
        return next((limit for limit in limits if limit is not None), None)

    def maximising(self) -> Criterion:
        return AnyOf(tuple(criterion.maximising() for criterion in self.criteria))


@dataclass(frozen=True)
class AllOf(Criterion):
    """Criterion that stops a run if all of several criteria are reached; names the last limit.

    Parameters
    ----------
    criteria : tuple of Criterion
        The criteria.
    """

    criteria: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        _criteria(self.criteria)

    def reached(self, progress: Progress) -> Limit | None:
        limits = [criterion.reached(progress) for criterion in self.criteria]
        return limits[-1] if limits and None not in limits else None

    def maximising(self) -> Criterion:
        return AllOf(tuple(criterion.maximising() for criterion in self.criteria))
