"""Base class of the backends for tours: extended fields that a backend carries, and the frame of the air."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

from ...models.messenger.model import MessengerTour
from ..contract.backend import Answer, Backend, Request

__all__ = ["TourBackend"]


class TourBackend(Backend):
    """Backend for tours, whose :meth:`fly` works relative to the air and never sees wind.

    Attributes
    ----------
    carries : frozenset of str
        Extended fields of the model that it supports. A model with another one is refused.
    """

    accepts = MessengerTour
    carries: ClassVar[frozenset[str]] = frozenset({"wind", "home_velocity"})

    def refuses(self, problem: MessengerTour) -> str:
        """Return the reason why the backend does not cover `problem`, or an empty string."""
        return problem.uncovered(self.carries)

    @abstractmethod
    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Return a claim for a problem without wind; see :meth:`run`."""

    def run(self, problem: MessengerTour, request: Request) -> Answer:
        """Solve `problem` relative to the air, an exact change of frame, and return plans over the ground."""
        self.require_support(problem)
        if problem.wind is None:
            return self.fly(problem, request)

        def forward(length: float, plan: Any) -> None:
            request.control.incumbent(length, problem.to_ground(plan))

        warm = request.warm_start
        with request.control.stage(request.left(), forward, request.control.prove) as control:
            answer = self.fly(
                problem.relative_to_air(),
                replace(
                    request, control=control, time_limit=request.left(),
                    warm_start=None if warm is None else problem.to_ground(warm, -1.0),
                ),
            )  # fmt: skip
        plan = answer.point
        return answer if plan is None else replace(answer, point=problem.to_ground(plan))
