"""Hermite-Simpson and trapezoidal transcription: low order, many intervals, an independent check."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from .base import Transcription
from .refinement import Rules
from .schemes import Scheme, hermite_simpson, trapezoid

__all__ = ["HermiteSimpson", "Trapezoid"]


@dataclass(frozen=True, eq=False)
class HermiteSimpson(Transcription):
    """Hermite-Simpson collocation in its separated form, refined in intervals.

    The options are those of :class:`~.base.Transcription`, without `degree`.
    """

    intervals: int = 25
    degree: int = field(init=False, default=3)

    name: ClassVar[str] = "hermite-simpson"
    summary: ClassVar[str] = "Hermite-Simpson collocation (order 4), refined in intervals"
    rules: ClassVar[Rules] = Rules(fixed_degree=3, order=4)

    @staticmethod
    def scheme(degree: int) -> Scheme:
        """Return the Hermite-Simpson scheme, whatever the degree."""
        return hermite_simpson()


@dataclass(frozen=True, eq=False)
class Trapezoid(Transcription):
    """Trapezoidal collocation, refined in intervals.

    The options are those of :class:`~.base.Transcription`, without `degree`.
    """

    intervals: int = 50
    degree: int = field(init=False, default=2)

    name: ClassVar[str] = "trapezoid"
    summary: ClassVar[str] = "trapezoidal collocation (order 2), refined in intervals"
    rules: ClassVar[Rules] = Rules(fixed_degree=2, order=2)

    @staticmethod
    def scheme(degree: int) -> Scheme:
        """Return the trapezoidal scheme, whatever the degree."""
        return trapezoid()
