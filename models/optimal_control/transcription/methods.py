"""Available transcriptions: Gauss, Radau, Hermite-Simpson and trapezoidal.

Their parameters are those of :class:`~.base.Transcription`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from .base import Transcription
from .refinement import Rules
from .schemes import gauss, hermite_simpson, radau, trapezoid

__all__ = ["Gauss", "HermiteSimpson", "PaperGauss", "Radau", "Trapezoid"]


@dataclass(frozen=True, eq=False)
class Gauss(Transcription):
    """Legendre-Gauss collocation on several intervals, refined in degree and in intervals."""

    name: ClassVar[str] = "gauss"
    summary: ClassVar[str] = "Gauss pseudospectral (LG) on several intervals, hp-refined"
    scheme = staticmethod(gauss)


@dataclass(frozen=True, eq=False)
class PaperGauss(Gauss):
    """The paper's Gauss pseudospectral method: one interval, refined in degree alone (eq. 14-21)."""

    intervals: int = 1
    degree: int = 20
    most_nodes: int = 200

    name: ClassVar[str] = "paper"
    summary: ClassVar[str] = "the paper's Gauss pseudospectral method: one interval, degree raised"
    rules: ClassVar[Rules] = Rules(split=False, most_degree=200)


@dataclass(frozen=True, eq=False)
class Radau(Transcription):
    """Legendre-Gauss-Radau collocation on several intervals, refined in degree and in intervals.

    The end of every interval is collocated.
    """

    name: ClassVar[str] = "radau"
    summary: ClassVar[str] = "Radau pseudospectral (LGR) on several intervals, hp-refined"
    scheme = staticmethod(radau)


@dataclass(frozen=True, eq=False)
class HermiteSimpson(Transcription):
    """Hermite-Simpson collocation in its separated form, refined in intervals."""

    intervals: int = 25
    degree: int = field(init=False, default=3)

    name: ClassVar[str] = "hermite-simpson"
    summary: ClassVar[str] = "Hermite-Simpson collocation (order 4), refined in intervals"
    rules: ClassVar[Rules] = Rules(fixed_degree=3, order=4)
    scheme = staticmethod(hermite_simpson)


@dataclass(frozen=True, eq=False)
class Trapezoid(Transcription):
    """Trapezoidal collocation, refined in intervals."""

    intervals: int = 50
    degree: int = field(init=False, default=2)

    name: ClassVar[str] = "trapezoid"
    summary: ClassVar[str] = "trapezoidal collocation (order 2), refined in intervals"
    rules: ClassVar[Rules] = Rules(fixed_degree=2, order=2)
    scheme = staticmethod(trapezoid)


Gauss.confirmed_by = Radau
Radau.confirmed_by = Gauss
HermiteSimpson.confirmed_by = Radau
Trapezoid.confirmed_by = HermiteSimpson
