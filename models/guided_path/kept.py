"""What both programs of a tour share: they are stated for the customers that decide its length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from ..formulation import Formulation
from ..programs.linear import MixedIntegerProgram
from .data import GuidedPathData
from .gaps import Gaps
from .model import GuidedPathTour
from .plan import GuidedPathPlan
from .walks import kept_order, reduced

__all__ = ["KeptFormulation"]


@dataclass(frozen=True, eq=False)
class KeptFormulation(Formulation[GuidedPathTour, GuidedPathPlan]):
    """Base of formulations that leave out the customers that every tour passes in time."""

    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram

    @cached_property
    def _reduced(self) -> tuple[GuidedPathData, tuple[int, ...]]:
        return reduced(self.model)

    @property
    def _kept(self) -> GuidedPathData:
        """The customers that count, numbered anew."""
        return self._reduced[0]

    @property
    def _numbers(self) -> tuple[int, ...]:
        """What they are called in the model, the start first."""
        return self._reduced[1]

    @cached_property
    def _gaps(self) -> Gaps:
        return Gaps(self._kept)

    def _order(self, plan: GuidedPathPlan) -> list[int]:
        """Return the order in which `plan` serves them; ``InvalidData`` where it lacks a customer."""
        return kept_order(self.model, self._numbers, plan)
