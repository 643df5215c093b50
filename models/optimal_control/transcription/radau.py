"""The Radau pseudospectral transcription, with the end of every interval collocated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .base import Transcription
from .schemes import Scheme, radau

__all__ = ["Radau"]


@dataclass(frozen=True, eq=False)
class Radau(Transcription):
    """Legendre-Gauss-Radau collocation on several intervals, refined in degree and in intervals."""

    name: ClassVar[str] = "radau"
    summary: ClassVar[str] = "Radau pseudospectral (LGR) on several intervals, hp-refined"

    @staticmethod
    def scheme(degree: int) -> Scheme:
        """Return the Radau scheme with `degree` nodes."""
        return radau(degree)
