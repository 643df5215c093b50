"""What a backend is: the contract between :func:`crosstrack.solve` and every solver.

A backend receives a problem (a :class:`~crosstrack.models.programs.base.Program`, or a model of the
type that a native algorithm knows) with a :class:`Request`, and returns an :class:`Answer`. An
answer is a claim: the dispatcher decodes and verifies it before anybody sees a solution.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import BackendMissing, UnsupportedOption, suggestion
from ..models.model import Model
from ..models.records import Table
from ..version import __version__
from .control import GRACE, Control
from .enums import PROVING, Feature, Guarantee, Limit, Termination
from .option import Option

__all__ = [
    "PROVING",
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
    evaluations : int, optional
        Evaluations of the objective that are granted, counted with :meth:`Control.evaluated`.
    target : float, optional
        The objective of a plan that is good enough to stop at.
    verbose : bool
        Whether the solver is to print its own log, which is then read from its process's output.
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
    evaluations: int | None = None
    target: float | None = None
    verbose: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    control: Control = field(default_factory=Control)

    def left(self) -> float | None:
        """Return the seconds left of the time limit, at least 0; None where there is no limit."""
        if self.time_limit is None:
            return None
        return max(self.time_limit - (time.perf_counter() - self.control.started), 0.0)

    def within(
        self,
        backend: Backend,
        problem: Any,
        *,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
        lift: Callable[[float, Any], tuple[float, Any]] | None = None,
        **changes: Any,
    ) -> Answer:
        """Run `backend` on `problem` as a stage or a restart of this run, and return its answer.

        The stage has this run's clock, stop flag and tolerances, and a seed of its own that follows
        from this run's: the same seed gives the same stages. A stage that may not begin, because
        the run was stopped or its time is used up, answers ``NO_SOLUTION`` with the limit.

        Parameters
        ----------
        backend : Backend
            What runs.
        problem : object
            An instance of what it accepts.
        time_limit : float, optional
            Seconds for the stage; never more than what the run has left.
        options : mapping, optional
            The backend's own options.
        lift : callable, optional
            ``(objective, point) -> (objective, point)`` of this run, for the stage's incumbents;
            None does not report them.
        **changes
            Other fields of the stage's request, such as ``warm_start`` or ``tolerance``.
        """
        backend.require()
        limits = [one for one in (self.left(), time_limit) if one is not None]
        seconds = min(limits) if limits else None
        if self.control.stopped or seconds == 0.0:
            return Answer(Termination.NO_SOLUTION, self.control.reason or Limit.TIME)
        seed = changes.pop("seed", None)
        if seed is None and self.seed is not None and Feature.SEED in backend.features:
            sequence = np.random.SeedSequence([self.seed, self.control.stages])
            seed = int(sequence.generate_state(1)[0])

        def forward(objective: float, point: Any) -> None:
            assert lift is not None
            self.control.incumbent(*lift(objective, point))

        with self.control.stage(seconds, None if lift is None else forward) as control:
            asked: dict[str, Any] = {
                "warm_start": None, "cutoff": None, "evaluations": None, "target": None, **changes,
            }  # fmt: skip
            request = replace(
                self, time_limit=seconds, seed=seed, options=backend.checked_options(options or {}),
                control=control, **asked,
            )  # fmt: skip
            return backend.run(problem, request)


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
        Only ``EXACT`` and ``RELAXATION`` backends may claim infeasibility or a dual bound.
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
        The distribution whose version is reported; by default the first of `requires`, and
        crosstrack's own where there is none.
    extra : str
        The extra of ``pip install crosstrack[extra]`` that brings the packages.
    sees_hidden : bool
        Whether it is given what a model hides from backends: a reference that bounds the others, which
        ``"auto"`` never means.
    conflict_group : str
        Backends of one group whose :attr:`natives` differ break one another in a process; empty
        where no clash is known.
    natives : tuple of str
        The modules whose presence in ``sys.modules`` means that the native library is loaded.
    options : mapping of str to Option
        Its own options.
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
    sees_hidden: ClassVar[bool] = False
    conflict_group: ClassVar[str] = ""
    natives: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[Mapping[str, Option]] = {}
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

    def hides(self, model: Model[Any]) -> bool:
        """Return whether `model` has data that this backend must not see."""
        return bool(model.hidden_fields()) and not self.sees_hidden

    def prepare(self) -> None:
        """Do what only the first run needs, such as compiling; timed apart as ``seconds.compile``.

        The clock of a time limit starts after it. It never trains: what is learned is a file that an
        option names. Kernels of :mod:`crosstrack.jit` need no preparation: they are compiled
        when a run has use for it, with its clock standing still.
        """

    def refuses(self, problem: Any) -> str:
        """Return why this backend cannot take `problem`, an instance of :attr:`accepts`; else ``""``.

        A cheap look for lists of what could solve a model; :meth:`run` raises
        :class:`~crosstrack.errors.UnsupportedFormulation` for the same reasons and for others.
        """
        return ""

    def starter(self, problem: Any) -> str:
        """Return the heuristic of the same problem whose plan a run with a time limit begins with.

        It gets a share of the time, and its plan is the answer if the run has no better one. Empty
        for none: runs that end soon need no heuristic.
        """
        return ""

    #: Whether no other exact backend can do what this one cannot, so that ``"auto"`` does not go on.
    conclusive: ClassVar[bool] = False

    def is_brief(self, problem: Any) -> bool:
        """Return whether a run on `problem` ends within about a tenth of a second, whatever it holds.

        It is run in the caller's thread then, without a deadline: another thread and a timer take
        longer to start than such a run.
        """
        return False

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return whether a run on a problem of this `kind` can be stopped from within its process.

        Where it cannot, the run moves to a process of its own, which can.
        """
        return Feature.INTERRUPT in self.features

    def patience(self, kind: type[Model[Any]]) -> float:
        """Return the seconds that a run on a problem of this `kind` may take to stop.

        Then it is given up, and what it has reported by then is its answer.
        """
        return GRACE

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        """Return what :func:`crosstrack.compare` sets of its own options where the user gives none.

        A verdict on a solver judges the solver, and nothing that crosstrack adds to it. `kind` is
        the type of the problem that it is given.
        """
        return {}

    def missing(self) -> tuple[str, ...]:
        """Names of the required packages that are not installed; nothing is imported."""
        return tuple(name for name in self.requires if importlib.util.find_spec(name) is None)

    def version(self) -> str | None:
        """Version of the solver's distribution, None where it is not installed."""
        distribution = self.distribution or next(iter(self.requires), "")
        if not distribution:
            return __version__
        try:
            return importlib.metadata.version(distribution)
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
        given = Table().coerce("backend_options", given, {})
        for name in given:
            if name not in self.options:
                known = ", ".join(sorted(self.options)) or "none"
                raise UnsupportedOption(
                    f"backend {self.name!r} has no option {name!r}; "
                    f"{suggestion(name, self.options)}its own options: {known}"
                )
        return {
            name: option.check(f"backend {self.name!r}", name, given[name])
            if name in given
            else option.default
            for name, option in self.options.items()
        }
