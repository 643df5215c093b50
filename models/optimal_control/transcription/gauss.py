"""The Gauss pseudospectral transcription: the paper's, in one interval, and its multi-interval kin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .base import Transcription
from .refinement import Rules
from .schemes import Scheme, gauss

__all__ = ["Gauss", "PaperGauss"]


@dataclass(frozen=True, eq=False)
class Gauss(Transcription):
    """Legendre-Gauss collocation on several intervals, refined in degree and in intervals."""

    name: ClassVar[str] = "gauss"
    summary: ClassVar[str] = "Gauss pseudospectral (LG) on several intervals, hp-refined"

    @staticmethod
    def scheme(degree: int) -> Scheme:
        """Return the Gauss scheme with `degree` nodes."""
        return gauss(degree)


@dataclass(frozen=True, eq=False)
class PaperGauss(Transcription):
    """The paper's Gauss pseudospectral method: one interval, refined in degree alone (eq. 14-21)."""

    intervals: int = 1
    degree: int = 20
    most_nodes: int = 200

    name: ClassVar[str] = "paper"
    summary: ClassVar[str] = "the paper's Gauss pseudospectral method: one interval, degree raised"
    rules: ClassVar[Rules] = Rules(split=False, most_degree=200)

    @staticmethod
    def scheme(degree: int) -> Scheme:
        """Return the Gauss scheme with `degree` nodes."""
        return gauss(degree)
