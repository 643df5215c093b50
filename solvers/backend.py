"""What a backend is: the contract between :func:`crosstrack.solve` and every solver.

A backend receives a problem (a :class:`~crosstrack.models.programs.base.Program`, or a model of the
type that a native algorithm knows) with a :class:`Request`, and returns an :class:`Answer`. An
answer is a claim: the dispatcher decodes and verifies it before anybody sees a solution.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import queue
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import BackendMissing, UnsupportedOption
from ..models.model import Model
from ..version import __version__

__all__ = [
    "Answer",
    "Backend",
    "Control",
    "Feature",
    "Guarantee",
    "Limit",
    "Option",
    "Request",
    "Termination",
]


class Guarantee(StrEnum):
    """What an answer of the backend proves, if its claims are right."""

    EXACT = "exact"
    LOCAL = "local"
    HEURISTIC = "heuristic"
    RELAXATION = "relaxation"


class Feature(StrEnum):
    """What a backend understands of the common request."""

    GAP = "gap"
    SEED = "seed"
    THREADS = "threads"
    WARM_START = "warm start"
    CUTOFF = "cutoff"
    INCUMBENTS = "incumbents"
    DUAL_BOUND = "dual bound"
    DUALS = "duals"
    INTERRUPT = "interrupt"


class Termination(StrEnum):
    """How a run ended, apart from the limit that may have ended it."""

    OPTIMAL = "optimal"
    LOCALLY_OPTIMAL = "locally_optimal"
    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    LOCALLY_INFEASIBLE = "locally_infeasible"
    UNBOUNDED = "unbounded"
    NO_SOLUTION = "no_solution"
    REJECTED = "rejected"
    FAILED = "failed"


class Limit(StrEnum):
    """The limit that ended a run."""

    TIME = "time"
    MEMORY = "memory"
    ITERATIONS = "iterations"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Option:
    """One option of a backend's own.

    Parameters
    ----------
    default : object
        The value when nothing is given.
    help : str
        One sentence: what it does, and its unit.
    kind : type
        The type that a value must have (``float`` takes integers too).
    choices : tuple
        The values allowed; empty when any is.
    lower, upper : float, optional
        The closed range allowed, for numbers.
    """

    default: Any
    help: str
    kind: type = float
    choices: tuple[Any, ...] = ()
    lower: float | None = None
    upper: float | None = None

    def check(self, owner: str, name: str, value: Any) -> Any:
        """Return `value` coerced to :attr:`kind`, or raise :class:`UnsupportedOption`."""
        if value is None and self.default is None:
            return None
        wrong = isinstance(value, bool) is not (self.kind is bool)
        if self.kind is float and isinstance(value, int | float | np.number) and not wrong:
            value = float(value)
        elif self.kind is int and isinstance(value, np.integer):
            value = int(value)
        if wrong or not isinstance(value, self.kind):
            raise UnsupportedOption(
                f"{owner}: option {name!r} must be a {self.kind.__name__}, got {value!r}"
            )
        if self.choices and value not in self.choices:
            allowed = ", ".join(map(repr, self.choices))
            raise UnsupportedOption(
                f"{owner}: option {name!r} must be one of {allowed}, got {value!r}"
            )
        number: Any = value
        low = self.lower is not None and not number >= self.lower
        high = self.upper is not None and not number <= self.upper
        if low or high:
            raise UnsupportedOption(
                f"{owner}: option {name!r} must lie in [{self.lower}, {self.upper}], got {value!r}"
            )
        return value


class Control:
    """The line between a running backend and the caller: stop requests in, incumbents out.

    A kernel without the interpreter's lock polls :attr:`flag` (one ``int8``, nonzero means stop);
    Python callbacks read :attr:`stopped`. The dispatcher sets it at the deadline or on Ctrl-C.
    """

    def __init__(self) -> None:
        self.flag: NDArray[np.int8] = np.zeros(1, np.int8)
        self.reason: Limit | None = None
        self.events: queue.SimpleQueue[tuple[float, float, Any] | None] = queue.SimpleQueue()
        self.started = time.perf_counter()
        self._timer: threading.Timer | None = None

    @property
    def stopped(self) -> bool:
        """Whether the run has been asked to stop."""
        return bool(self.flag[0])

    def stop(self, reason: Limit) -> None:
        """Ask the run to stop; the first reason given is kept."""
        if self.reason is None:
            self.reason = reason
        self.flag[0] = 1

    def arm(self, seconds: float | None) -> None:
        """Restart the clock and stop the run after `seconds` (never, when None)."""
        self.started = time.perf_counter()
        if seconds is not None:
            self._timer = threading.Timer(max(seconds, 0.0), self.stop, (Limit.TIME,))
            self._timer.daemon = True
            self._timer.start()

    def disarm(self) -> None:
        """Forget the deadline."""
        if self._timer is not None:
            self._timer.cancel()

    def incumbent(self, objective: float, point: Any) -> None:
        """Report a better feasible point (a column vector, or a native algorithm's plan)."""
        self.events.put((time.perf_counter() - self.started, float(objective), point))


@dataclass(frozen=True)
class Request:
    """What is asked of a run, the same for all backends.

    Parameters
    ----------
    time_limit : float, optional
        Seconds left for the run.
    gap : float
        Relative gap at which an exact backend may stop.
    tolerance : float
        Largest violation of a scaled constraint, and of integrality.
    seed : int, optional
        Seed of whatever the backend draws; None leaves its default.
    threads : int, optional
        Threads it may use; None leaves its default.
    warm_start : object, optional
        A column vector for a program's backend, a plan for a native algorithm; verified.
    cutoff : float, optional
        The objective of a verified plan: only plans at least as good, rounding aside, are wanted.
        A search that finds none proves that the cutoff is a lower bound: it answers
        ``NO_SOLUTION`` with that `dual_bound`, never ``INFEASIBLE``.
    options : mapping
        The backend's own options, checked, defaults filled in.
    control : Control
        Stop requests and incumbents.
    """

    time_limit: float | None = None
    gap: float = 1e-6
    tolerance: float = 1e-6
    seed: int | None = None
    threads: int | None = None
    warm_start: Any = None
    cutoff: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    control: Control = field(default_factory=Control)


@dataclass(frozen=True)
class Answer:
    """What a backend claims.

    Parameters
    ----------
    termination : Termination
        Never ``REJECTED``: that is the dispatcher's word.
    limit : Limit, optional
        The limit that ended the run.
    point : object, optional
        The best column vector (program backends) or plan (native algorithms).
    primal_bound, dual_bound : float, optional
        Claimed objective of `point`, and claimed lower bound on every plan's objective.
    duals : ndarray, optional
        Row multipliers of a continuous program, for the program's own dual bound.
    seconds : mapping
        The run in parts: ``"solve"``, and ``"compile"`` or ``"build"`` where it knows them apart.
    statistics : mapping
        Counts of the backend's own: nodes, labels, iterations.
    message : str
        What a person should know: a licence's refusal, a solver's own status.
    """

    termination: Termination
    limit: Limit | None = None
    point: Any = None
    primal_bound: float | None = None
    dual_bound: float | None = None
    duals: NDArray[np.float64] | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    statistics: Mapping[str, float | int | str] = field(default_factory=dict)
    message: str = ""


class Backend(ABC):
    """A solver or an algorithm: the base class of every backend, ours or a stranger's.

    The class attributes describe it without loading any solver; :meth:`run` does the work and
    imports what it needs itself.

    Attributes
    ----------
    name : str
        The name people type.
    accepts : type or tuple of types
        Program types, or the model type that a native algorithm knows.
    guarantee : Guarantee
        Only ``EXACT`` backends may claim infeasibility or a dual bound.
    features : frozenset of Feature
        What of the common request it understands; asking for anything else raises.
    deterministic : bool
        Whether it draws nothing, so that any ``seed`` is granted without the feature.
    single_threaded : bool
        Whether it runs on one thread whatever is asked, so that ``threads=1`` is granted without
        the feature.
    requires : tuple of str
        Import names of the packages it needs, probed without importing them.
    distribution : str
        The distribution whose version is reported; empty for crosstrack's own.
    extra : str
        The extra of ``pip install crosstrack[extra]`` that brings the packages.
    conflict_group : str
        Backends of one group whose :attr:`natives` differ break one another in a process; empty
        where no clash is known.
    natives : tuple of str
        The modules whose presence in ``sys.modules`` means that the native library is loaded.
    options : mapping of str to Option
        Its own options.
    comparison_options : mapping of str to object
        Values of its own options that :func:`crosstrack.compare` sets where the user gives none, so
        that a verdict on the solver judges the solver and nothing that crosstrack adds to it.
    summary : str
        One line for lists.
    problem : str
        The problem whose native algorithm it is; empty for a solver of programs. Set when the
        backend is looked up.
    """

    problem: str = ""

    name: ClassVar[str]
    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]]
    guarantee: ClassVar[Guarantee]
    features: ClassVar[frozenset[Feature]] = frozenset()
    deterministic: ClassVar[bool] = False
    single_threaded: ClassVar[bool] = False
    requires: ClassVar[tuple[str, ...]] = ()
    distribution: ClassVar[str] = ""
    extra: ClassVar[str] = ""
    conflict_group: ClassVar[str] = ""
    natives: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[Mapping[str, Option]] = {}
    comparison_options: ClassVar[Mapping[str, Any]] = {}
    summary: ClassVar[str] = ""

    @abstractmethod
    def run(self, problem: Any, request: Request) -> Answer:
        """Solve `problem`, an instance of :attr:`accepts`, as `request` asks.

        A limit is no error: the best point so far comes back with the limit named. Raises
        :class:`~crosstrack.errors.BackendBroken` where the solver refuses for a reason that has
        nothing to do with the problem (a licence, a missing shared library).
        """

    def accepted_kinds(self) -> str:
        """Return what it accepts in words: kinds of models, separated by commas."""
        types = self.accepts if isinstance(self.accepts, tuple) else (self.accepts,)
        return ", ".join(one.kind or one.__name__ for one in types)

    def prepare(self) -> None:
        """Do what only the first run needs, such as compiling; timed apart as ``seconds.compile``.

        The clock of a time limit starts after it.
        """

    def refuses(self, problem: Any) -> str:
        """Return why this backend cannot take `problem`, an instance of :attr:`accepts`; else ``""``.

        A cheap look for lists of what could solve a model; :meth:`run` raises
        :class:`~crosstrack.errors.UnsupportedFormulation` for the same reasons and for others.
        """
        return ""

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return whether a run on a problem of this `kind` can be stopped from within its process.

        Where it cannot, the run moves to a process of its own, which can.
        """
        return Feature.INTERRUPT in self.features

    def missing(self) -> tuple[str, ...]:
        """Names of the required packages that are not installed; nothing is imported."""
        return tuple(name for name in self.requires if importlib.util.find_spec(name) is None)

    def version(self) -> str | None:
        """Version of the solver's distribution, None where it is not installed."""
        if not self.distribution:
            return __version__
        try:
            return importlib.metadata.version(self.distribution)
        except importlib.metadata.PackageNotFoundError:
            return None

    def require(self) -> None:
        """Raise :class:`BackendMissing`, saying what to install, unless all is there."""
        missing = self.missing()
        if missing:
            how = f"crosstrack[{self.extra}]" if self.extra else " ".join(missing)
            raise BackendMissing(
                f"backend {self.name!r} needs {', '.join(missing)}: pip install '{how}'"
            )

    def checked_options(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all own options with `given` filled in; raise on an unknown name or value."""
        for name in given:
            if name not in self.options:
                known = ", ".join(sorted(self.options)) or "none"
                raise UnsupportedOption(
                    f"backend {self.name!r} has no option {name!r}; its own options: {known}"
                )
        return {
            name: option.check(f"backend {self.name!r}", name, given[name])
            if name in given
            else option.default
            for name, option in self.options.items()
        }
