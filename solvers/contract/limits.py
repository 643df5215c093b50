"""Limits and settings of a run, which every verb accepts."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

from ...errors import UnsupportedOption, suggestion
from ...lazy import moved
from ...models.fields import show
from ...models.verification import TOLERANCE, check_number

if TYPE_CHECKING:
    from .events import Listener
    from .stopping import Criterion

__all__ = [
    "LEAST_MEMORY",
    "LimitOptions",
    "Limits",
    "check_listener",
    "check_memory",
    "limits_of",
    "merge_limits",
    "takes_limits",
]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(__name__, {".events": "Event EventKind Listener listener_of"})

#: Smallest memory limit in MiB, below which Python with NumPy cannot run.
LEAST_MEMORY = 64.0

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


class LimitOptions(TypedDict, total=False):
    """Keywords of the fields of :class:`Limits`."""

    time_limit: float | None
    memory_limit: float | None
    evaluations: int | None
    target: float | None
    gap: float | None
    tolerance: float | None
    seed: int | None
    threads: int | None
    stop: Criterion | None
    warm_start: Any
    starts: int
    verbose: bool
    on_event: Listener | None


def check_memory(value: Any) -> float:
    """Return a memory limit in MiB.

    Parameters
    ----------
    value : float
        The limit in MiB.

    Raises
    ------
    UnsupportedOption
        The value is not a number or below ``LEAST_MEMORY``.
    """
    number = check_number("memory_limit", value)
    if number < LEAST_MEMORY:
        raise UnsupportedOption(
            f"memory_limit is in MiB and must be at least {LEAST_MEMORY:g}, which Python with NumPy "
            f"needs, got {show(value)} (1 GiB is 1024 MiB)"
        )
    return number


def check_listener(value: Any) -> None:
    """Raise :class:`UnsupportedOption` if a callback is neither None nor callable."""
    if value is not None and not callable(value):
        raise UnsupportedOption(f"on_event must be callable, got {show(value)}")


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits and settings of a run, with the same meaning for every verb.

    Every verb that runs a backend accepts the fields as keywords, and a record of them as `limits`;
    a keyword overrides the field of the record. The record replaces the default limit of 60 s that
    some verbs have: with ``time_limit=None`` a run has no time limit.

    Parameters
    ----------
    time_limit : float, optional
        Wall-clock seconds per run.
    memory_limit : float, optional
        Memory limit per run in MiB, at least 64; Linux only. The run moves to a worker process, which
        is killed at the limit. Its last incumbent is kept.
    evaluations : int, optional
        Limit on the evaluations of the objective, for backends that count them.
    target : float, optional
        Objective at which the run stops, in the sense of the model's author, for backends that report
        incumbents.
    gap : float, optional
        Relative gap at which an exact backend may stop (default 1e-6).
    tolerance : float, optional
        Largest accepted violation, in the backend and in the verification (default 1e-6).
    seed, threads : int, optional
        Random seed and number of threads, for backends that support them.
    stop : Criterion, optional
        Further stopping criterion, such as ``Stalled(5.0)`` or criteria joined by ``|`` and ``&``
        (:class:`~crosstrack.solvers.Criterion`), for backends that report incumbents.
    warm_start : plan, Solution or JSON data, optional
        Plan to start from. It is verified first and bounds the objective. For formulations on
        meshes, a plan that does not verify, for example one for another initial state, is a guess.
    starts : int
        Number of starts with different seeds, for backends that are not exact. All are kept.
    verbose : bool
        Show the solver's log and each incumbent during the run, as ``INFO`` of the logger
        ``crosstrack.output``. Without a handler, the log goes to standard error.
    on_event : callable, optional
        Function called with each :class:`Event`, in the thread of the caller.

    Raises
    ------
    UnsupportedOption
        A value is outside its range.

    Examples
    --------
    >>> import crosstrack as ct
    >>> quick = ct.Limits(time_limit=5, seed=1)
    >>> ct.solve(ct.load("fleet/example"), "fleet-search", limits=quick).seed
    1
    """

    time_limit: float | None = None
    memory_limit: float | None = None
    evaluations: int | None = None
    target: float | None = None
    gap: float | None = None
    tolerance: float | None = None
    seed: int | None = None
    threads: int | None = None
    stop: Criterion | None = None
    warm_start: Any = None
    starts: int = 1
    verbose: bool = False
    on_event: Listener | None = None

    def __post_init__(self) -> None:
        if self.time_limit is not None:
            check_number("time_limit", self.time_limit)
        if self.memory_limit is not None:
            check_memory(self.memory_limit)
        if self.gap is not None:
            check_number("gap", self.gap, strict=False)
        if self.tolerance is not None:
            check_number("tolerance", self.tolerance, below=1.0)
        for name, lower in (("seed", 0), ("threads", 1), ("evaluations", 1), ("starts", 1)):
            value = getattr(self, name)
            if value is None and name != "starts":
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < lower:
                raise UnsupportedOption(
                    f"{name} must be a whole number >= {lower}, got {show(value)}"
                )
        if not isinstance(self.verbose, bool):
            raise UnsupportedOption(f"verbose must be True or False, got {self.verbose!r}")
        self.criterion  # noqa: B018 - raises if `target` or `stop` is not allowed
        check_listener(self.on_event)

    @property
    def criterion(self) -> Criterion | None:
        """Stopping criterion in addition to the time limit; None if there is none."""
        if self.stop is None and self.evaluations is None and self.target is None:
            return None
        from . import stopping

        if self.stop is not None and not isinstance(self.stop, stopping.Criterion):
            raise UnsupportedOption(f"stop must be a Criterion, got {show(self.stop)}")
        parts: list[Criterion] = [] if self.stop is None else [self.stop]
        if self.evaluations is not None:
            parts.append(stopping.Evaluations(self.evaluations))
        if self.target is not None:
            parts.append(stopping.Target(self.target))
        return stopping.AnyOf(tuple(parts))

    @property
    def verification_tolerance(self) -> float:
        """Largest accepted violation of a plan."""
        return TOLERANCE if self.tolerance is None else float(self.tolerance)

    def fields(self) -> dict[str, Any]:
        """Return the values by name of the field."""
        return {name: getattr(self, name) for name in LIMIT_NAMES}

    def changes(self) -> dict[str, Any]:
        """Return the values that differ from their defaults, by name of the field."""
        # Defaults of None are compared by identity, because a warm start may be an array.
        return {
            field.name: value
            for field in dataclasses.fields(Limits)
            if (value := getattr(self, field.name)) is not field.default
            and (field.default is None or value != field.default)
        }

    def require_only(self, owner: str, supported: Sequence[str]) -> None:
        """Raise :class:`UnsupportedOption` if a field that is not `supported` has been set.

        Parameters
        ----------
        owner : str
            Verb that does not support the other fields, for the message.
        supported : sequence of str
            Names of the supported fields.
        """
        for name, value in self.changes().items():
            if name not in supported:
                raise UnsupportedOption(
                    f"{owner} does not support {name}={show(value)}; supported: {', '.join(supported)}"
                )


#: Names of the fields of :class:`Limits`.
LIMIT_NAMES = tuple(field.name for field in dataclasses.fields(Limits))


def merge_limits(verb: str, limits: Limits | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a record and the keywords of a call, which override them.

    The values of the keywords are checked by :class:`Limits`. The parameters are those of
    :func:`limits_of`.
    """
    for name in options:
        if name not in LIMIT_NAMES:
            raise TypeError(
                f"{verb}() got an unexpected keyword argument {name!r}; "
                f"{suggestion(name, LIMIT_NAMES)}limits: {', '.join(LIMIT_NAMES)}"
            )
    if limits is not None and not isinstance(limits, Limits):
        raise UnsupportedOption(f"limits must be a Limits record, got {show(limits)}")
    return {**({} if limits is None else limits.fields()), **options}


def limits_of(
    verb: str, limits: Limits | None, options: Mapping[str, Any], **defaults: Any
) -> Limits:
    """Return the limits of a call, joined from a record, keywords and the defaults of the verb.

    Parameters
    ----------
    verb : str
        Name of the verb, for messages.
    limits : Limits, optional
        Record that the caller passes as a whole.
    options : mapping
        Keywords, which override the record.
    **defaults
        Values that replace those of :class:`Limits` if neither record nor keyword is given.

    Raises
    ------
    TypeError
        A keyword is not a field of :class:`Limits`.
    UnsupportedOption
        `limits` is not a record, or a value is outside its range.
    """
    return Limits(**{**defaults, **merge_limits(verb, limits, options)})


def takes_limits(**defaults: Any) -> Callable[[FunctionT], FunctionT]:
    """Return a decorator that writes the fields of :class:`Limits` into a function's signature.

    Type checkers read the keywords from :class:`LimitOptions`; ``help`` and
    :func:`inspect.signature` read them from here.

    Parameters
    ----------
    **defaults
        Default values of the verb that differ from those of :class:`Limits`.
    """

    def write(function: FunctionT) -> FunctionT:
        signature = inspect.signature(function)
        entries = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        known = {entry.name for entry in entries}
        entries += [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=defaults.get(field.name, field.default),
                annotation=field.type,
            )
            for field in dataclasses.fields(Limits)
            if field.name not in known
        ]
        function.__signature__ = signature.replace(parameters=entries)  # type: ignore[attr-defined]
        return function

    return write
