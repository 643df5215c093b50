"""Events that a run reports to the callback `on_event`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .solution import Incumbent, Solution

__all__ = ["Event", "EventKind", "Listener", "listener_of"]


class EventKind(StrEnum):
    """Kind of an :class:`Event`."""

    #: A job of a comparison or a campaign starts.
    STARTED = "started"
    #: The backend has an improved plan, which is not verified yet.
    INCUMBENT = "incumbent"
    #: The backend has proven a larger lower bound.
    BOUND = "bound"
    #: A run has ended with a verified solution, or without a plan.
    SOLUTION = "solution"


@dataclass(frozen=True)
class Event:
    """Report of a run to the callback `on_event`.

    Parameters
    ----------
    kind : EventKind
        Kind of the event, which selects the fields that are set.
    instance : str
        Name of the model.
    backend : str
        Name of the backend.
    incumbent : Incumbent, optional
        The improved plan of ``INCUMBENT``.
    bound : float, optional
        The lower bound of ``BOUND``, as claimed by the backend.
    solution : Solution, optional
        The solution of ``SOLUTION``.
    progress : Progress, optional
        Counts and times of a campaign, for ``STARTED`` and ``SOLUTION`` of :func:`crosstrack.bench`.
    """

    kind: EventKind
    instance: str
    backend: str
    incumbent: Incumbent[Any] | None = None
    bound: float | None = None
    solution: Solution[Any] | None = None
    progress: Any = None

    @classmethod
    def ended(cls, solution: Solution[Any], progress: Any = None) -> Event:
        """Return the event of the end of a run."""
        names = solution.instance, solution.backend
        return cls(EventKind.SOLUTION, *names, solution=solution, progress=progress)


Listener = Callable[[Event], None]


def listener_of(
    on_event: Listener | None, part: str, **former: Callable[[Any], None] | None
) -> Listener | None:
    """Return the callback of a call, which may be given in a former form.

    Parameters
    ----------
    on_event : callable, optional
        The callback of :class:`Limits`.
    part : str
        Field of :class:`Event` that the former callback receives if it is set.
    **former : callable, optional
        The former callback by the name of its keyword.
    """
    [(name, callback)] = former.items()
    if callback is None:
        return on_event
    warnings.warn(f"{name} is now on_event", DeprecationWarning, stacklevel=3)

    def listen(event: Event) -> None:
        if on_event is not None:
            on_event(event)
        if getattr(event, part) is not None:
            callback(getattr(event, part))

    return listen
