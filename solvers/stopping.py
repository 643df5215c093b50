"""When a run stops: criteria that compose.

``Seconds(60) | Target(120.0)`` stops at the first of both, ``Evaluations(5000) & Stalled(2.0)`` when
both hold. The same shape as PyVRP's ``stop`` package (Wouda, Lan and Kool, doi
10.1287/ijoc.2023.0055).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from ..errors import UnsupportedOption
from ..models.fields import show
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
    """How far a run is.

    Parameters
    ----------
    seconds : float
        Since its start.
    evaluations : int
        Evaluations of the objective so far, where the backend counts them.
    best : float
        The best objective met, infinity before the first plan.
    stalled : float
        Seconds since the best objective last became better, or since the start.
    """

    seconds: float
    evaluations: int
    best: float
    stalled: float


class Criterion(ABC):
    """A reason to stop, looked at after every evaluation and incumbent and several times a second."""

    @abstractmethod
    def reached(self, progress: Progress) -> Limit | None:
        """Return the limit that is reached, None while the run may go on."""

    def __or__(self, other: Criterion) -> AnyOf:
        return AnyOf((self, other))

    def __and__(self, other: Criterion) -> AllOf:
        return AllOf((self, other))


def _number(name: str, value: Any, lower: float, strict: bool) -> None:
    good = isinstance(value, int | float) and not isinstance(value, bool)
    # What is no number compares with nothing.
    if not good or not (value > lower if strict else value >= lower):
        raise UnsupportedOption(
            f"{name} must be a number {'>' if strict else '>='} {lower:g}, got {show(value)}"
        )


def _criteria(value: Any) -> None:
    known = isinstance(value, tuple) and value
    if not known or not all(isinstance(one, Criterion) for one in value):
        raise UnsupportedOption(f"criteria must be a tuple of Criterion, got {show(value)}")


@dataclass(frozen=True)
class Seconds(Criterion):
    """Stop after `limit` seconds."""

    limit: float

    def __post_init__(self) -> None:
        _number("limit of Seconds", self.limit, 0.0, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.TIME if progress.seconds >= self.limit else None


@dataclass(frozen=True)
class Evaluations(Criterion):
    """Stop after `limit` evaluations of the objective."""

    limit: int

    def __post_init__(self) -> None:
        _number("limit of Evaluations", self.limit, 1, False)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.EVALUATIONS if progress.evaluations >= self.limit else None


@dataclass(frozen=True)
class Target(Criterion):
    """Stop at a plan whose objective is at most `value`."""

    value: float

    def __post_init__(self) -> None:
        _number("value of Target", self.value, -math.inf, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.TARGET if progress.best <= self.value else None


@dataclass(frozen=True)
class Stalled(Criterion):
    """Stop when no better plan has come for `limit` seconds."""

    limit: float

    def __post_init__(self) -> None:
        _number("limit of Stalled", self.limit, 0.0, True)

    def reached(self, progress: Progress) -> Limit | None:
        return Limit.STALLED if progress.stalled >= self.limit else None


@dataclass(frozen=True)
class AnyOf(Criterion):
    """Stop at the first of several criteria; its limit is named."""

    criteria: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        _criteria(self.criteria)

    def reached(self, progress: Progress) -> Limit | None:
        found = (one.reached(progress) for one in self.criteria)
        return next((limit for limit in found if limit is not None), None)


@dataclass(frozen=True)
class AllOf(Criterion):
    """Stop when all of several criteria hold; the limit of the last one is named."""

    criteria: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        _criteria(self.criteria)

    def reached(self, progress: Progress) -> Limit | None:
        found = [one.reached(progress) for one in self.criteria]
        return found[-1] if found and None not in found else None
