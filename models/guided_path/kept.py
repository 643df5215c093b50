"""Base of the programs of a tour, which contain only the customers that affect its length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from ...errors import UnsupportedFormulation
from ..formulation import Formulation
from ..programs.linear import MixedIntegerProgram
from .data import GuidedPathData
from .extensions import name_unsupported
from .gaps import Gaps
from .model import GuidedPathTour
from .plan import GuidedPathPlan
from .walks import kept_order, reduced

__all__ = ["KeptFormulation"]


@dataclass(frozen=True, eq=False)
class KeptFormulation(Formulation[GuidedPathTour, GuidedPathPlan]):
    """Base of formulations without the customers that every tour passes in time.

    Models with optional fields that change the feasible plans raise ``UnsupportedFormulation``.
    """

    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram

    @cached_property
    def _reduced(self) -> tuple[GuidedPathData, tuple[int, ...]]:
        if reason := name_unsupported(self.model):
            raise UnsupportedFormulation(f"formulation {self.name!r} does not cover {reason}")
        return reduced(self.model)

    @property
    def _kept(self) -> GuidedPathData:
        """Model of the relevant customers, renumbered."""
        return self._reduced[0]

    @property
    def _numbers(self) -> tuple[int, ...]:
        """Numbers of the relevant customers in the model, the start first."""
        return self._reduced[1]

    @cached_property
    def _gaps(self) -> Gaps:
        return Gaps(self._kept)

    def _order(self, plan: GuidedPathPlan) -> list[int]:
        """Return the service order of `plan` in the reduced numbering.

        Raises ``InvalidData`` if `plan` lacks a customer.
        """
        return kept_order(self.model, self._numbers, plan)
