"""Contract between :func:`crosstrack.solve` and every solver.

A backend receives a problem and a :class:`Request`, and returns an :class:`Answer`. The problem is
a :class:`~crosstrack.models.programs.base.Program`, or a model of the type that a native algorithm
accepts. An answer is a claim: the dispatcher decodes and verifies it before it becomes a solution.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendMissing, UnsupportedFormulation
from ...models.model import Model
from ...models.records import Table
from ...version import __version__
from .control import GRACE, Control
from .enums import PROVING, Feature, Guarantee, Limit, Termination
from .limits import Limits
from .option import Option, check_options

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
    "processors",
]


def processors() -> int:
    """Return the number of processors that this process may use, which may be fewer than exist."""
    has_affinity = hasattr(os, "sched_getaffinity")
    return len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1


@dataclass(frozen=True)
class Request:
    """Options of one run, the same for all backends.

    Parameters
    ----------
    time_limit : float, optional
        Seconds left for the run.
    gap : float
        Relative gap at which an exact backend may stop.
    tolerance : float
        Largest accepted violation of a scaled constraint and of integrality.
    seed : int, optional
        Random seed; None leaves the backend's default.
    threads : int, optional
        Number of threads; None leaves the backend's default.
    warm_start : object, optional
        Verified column vector (program backends) or plan (native algorithms) to start from.
    cutoff : float, optional
        Objective of a verified plan. Only plans at least as good, up to rounding, are of interest.
        A search that finds no such plan proves that the cutoff is a lower bound: it answers
        ``NO_SOLUTION`` with that `dual_bound`, never ``INFEASIBLE``.
    evaluations : int, optional
        Limit on the evaluations of the objective, counted with :meth:`Control.evaluated`.
    target : float, optional
        Objective at which the run stops.
    verbose : bool
        Whether the solver prints its own log, which is read from the output of its process.
    options : mapping
        The backend's options, validated, with defaults filled in.
    control : Control
        Channel for stop requests and incumbents.
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

    @property
    def available_threads(self) -> int:
        """Number of threads of the run: as requested, otherwise the processors that this process may use."""
        return self.threads or processors()

    def left(self) -> float | None:
        """Return the seconds left of the time limit, at least 0; None if there is no time limit."""
        if self.time_limit is None:
            return None
        return max(self.time_limit - (time.perf_counter() - self.control.started), 0.0)

    @property
    def limit(self) -> Limit | None:
        """Limit that ended the run, also before the timer of the control; None while the run continues."""
        return self.control.limit or (Limit.TIME if self.left() == 0.0 else None)

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

        The stage shares the clock, the stop flag and the tolerances of this run. Its seed is derived
        from this run's seed, so the same seed gives the same stages. A stage that cannot start,
        because the run was stopped or its time is used up, answers ``NO_SOLUTION`` with the limit.

        Parameters
        ----------
        backend : Backend
            The backend to run.
        problem : object
            The problem, an instance of a type that `backend` accepts.
        time_limit : float, optional
            Seconds for the stage, limited to the seconds left of this run.
        options : mapping, optional
            Options of `backend`.
        lift : callable, optional
            Function ``(objective, point) -> (objective, point)`` that maps an incumbent of the stage
            to one of this run. With None, incumbents of the stage are not reported.
        **changes
            Other fields of the stage's :class:`Request`, such as `warm_start` or `tolerance`.

        Returns
        -------
        Answer
            The answer of `backend`.

        Raises
        ------
        BackendMissing
            A package that `backend` requires is not installed.
        UnsupportedOption
            `backend` does not have one of the `options`.
        """
        backend.require()
        limits = [limit for limit in (self.left(), time_limit) if limit is not None]
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
            fields: dict[str, Any] = {
                "warm_start": None, "cutoff": None, "evaluations": None, "target": None, **changes,
            }  # fmt: skip
            request = replace(
                self, time_limit=seconds, seed=seed, options=backend.checked_options(options or {}),
                control=control, **fields,
            )  # fmt: skip
            return backend.run(problem, request)


@dataclass(frozen=True)
class Answer:
    """Claim of a backend about one run.

    Parameters
    ----------
    termination : Termination
        Any member except ``REJECTED``, which only the dispatcher assigns.
    limit : Limit, optional
        The limit that ended the run.
    point : object, optional
        Best column vector (program backends) or plan (native algorithms).
    primal_bound, dual_bound : float, optional
        Claimed objective of `point`, and claimed lower bound on the objective of every plan.
    duals : ndarray, optional
        Row multipliers of a continuous program, from which the program computes a dual bound.
    seconds : mapping
        Seconds per part: ``"solve"``, and ``"compile"`` or ``"build"`` if measured separately.
    statistics : mapping
        Counts of the backend, such as nodes, labels or iterations.
    message : str
        Remark for the user, such as a rejected licence or the status text of the solver.
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


@cache
def _installed(distribution: str) -> str | None:
    """Return the version of a distribution, read from its files once; None if it is not installed."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


class Backend(ABC):
    """Base class of every solver and algorithm, of this package or of another one.

    The class attributes describe the backend without importing its solver. :meth:`run` imports what
    it needs.

    Attributes
    ----------
    name : str
        Name that users pass.
    accepts : type or tuple of types
        Program types, or the model type that a native algorithm solves.
    guarantee : Guarantee
        Strength of its claims. Only ``EXACT`` and ``RELAXATION`` backends may claim infeasibility or
        a dual bound.
    features : frozenset of Feature
        Options of the common request that it supports. Other options raise ``UnsupportedOption``.
    deterministic : bool
        Whether it uses no random numbers, so that any ``seed`` is accepted without the feature.
    single_threaded : bool
        Whether it always runs on one thread, so that ``threads=1`` is accepted without the feature.
    requires : tuple of str
        Import names of the required packages, which are looked up without importing them.
    distribution : str
        Distribution whose version is reported. Default: the first of `requires`, or crosstrack
        itself if `requires` is empty.
    extra : str
        Extra of ``pip install crosstrack[extra]`` that installs the packages.
    integral_kinds : tuple of str
        Kinds of programs with an optional field ``integral`` (``"quadratic-program"``,
        ``"nonlinear-program"``) whose integral columns it respects. The dispatcher refuses such a
        program with integral columns for every other backend, which would solve the relaxation. A
        backend for mixed-integer programs always respects their integral columns.
    integral_only : tuple of str
        Kinds of :attr:`integral_kinds` that it refuses without integral columns.
    sees_hidden : bool
        Whether it receives the hidden data of a model. Such a backend is a reference for the others,
        and ``"auto"`` never selects it.
    shares_process : bool
        Whether its code reads hidden data only with :meth:`Control.ask`, so that its runs need no process
        without the data. It has an effect only for classes in the tables of crosstrack.
    is_automatic : bool
        Whether ``"auto"`` may select it although other backends accept the model.
    conflict_group : str
        Group of backends whose native libraries break each other in one process if their
        :attr:`natives` differ; empty if no conflict is known.
    natives : tuple of str
        Modules whose presence in ``sys.modules`` shows that the native library is loaded.
    options : mapping of str to Option
        Options of this backend alone.
    summary : str
        Description of one line for lists.
    problem : str
        Problem of a native algorithm; empty for a solver of programs. Set by the registry.
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
    integral_kinds: ClassVar[tuple[str, ...]] = ()
    integral_only: ClassVar[tuple[str, ...]] = ()
    sees_hidden: ClassVar[bool] = False
    shares_process: ClassVar[bool] = False
    is_automatic: ClassVar[bool] = True
    conflict_group: ClassVar[str] = ""
    natives: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[Mapping[str, Option]] = {}
    summary: ClassVar[str] = ""

    @abstractmethod
    def run(self, problem: Any, request: Request) -> Answer:
        """Solve `problem` and return a claim.

        Parameters
        ----------
        problem : Model
            An instance of :attr:`accepts`.
        request : Request
            Limits, tolerances, options and the channel to the caller.

        Returns
        -------
        Answer
            At a limit, the best point found so far, with the limit named.

        Raises
        ------
        BackendBroken
            The solver fails for a reason unrelated to the problem, such as a missing licence or
            shared library.
        UnsupportedFormulation
            The solver cannot solve this problem.
        """

    def unsupported(self, limits: Limits) -> dict[str, Any]:
        """Return the fields of `limits` that this backend does not support, with their defaults."""
        exact, features = self.guarantee is Guarantee.EXACT, self.features
        supported = {
            "gap": Feature.GAP in features,
            "seed": Feature.SEED in features or self.deterministic,
            "threads": Feature.THREADS in features,
            "evaluations": Feature.EVALUATIONS in features,
            "target": Feature.INCUMBENTS in features,
            "stop": Feature.INCUMBENTS in features,
            "warm_start": not features.isdisjoint({Feature.WARM_START, Feature.CUTOFF}),
            "starts": Feature.SEED in features and not exact,
        }
        defaults = Limits()
        return {
            name: getattr(defaults, name)
            for name in limits.changes()
            if not supported.get(name, True)
        }

    def accepted_kinds(self) -> str:
        """Return the accepted kinds of models as text, separated by commas."""
        types = self.accepts if isinstance(self.accepts, tuple) else (self.accepts,)
        names = [kind.kind or kind.__name__ for kind in types]
        return ", ".join(f"integer {n}" if n in self.integral_only else n for n in names)

    def hides(self, model: Model[Any]) -> bool:
        """Return True if `model` has data that this backend must not see."""
        return bool(model.hidden_fields()) and not self.sees_hidden

    def prepare(self) -> None:
        """Do the work that only the first run needs, such as compiling.

        Its time is reported as ``seconds.compile`` and does not count towards the time limit. It must
        not train: learned parameters are a file named by an option. Kernels of ``crosstrack.jit``
        need no preparation, because they are compiled during a run while its clock is paused.
        """

    def refuses(self, problem: Any) -> str:
        """Return the reason why this backend cannot solve `problem`; ``""`` if it can.

        `problem` is an instance of :attr:`accepts`. The check is cheap, for lists of suitable
        backends. :meth:`run` raises :class:`~crosstrack.errors.UnsupportedFormulation` for the same
        and for further reasons.
        """
        return ""

    def require_support(self, problem: Any) -> None:
        """Raise :class:`~crosstrack.errors.UnsupportedFormulation` if the backend :meth:`refuses`."""
        if refusal := self.refuses(problem):
            raise UnsupportedFormulation(f"backend {self.name!r} does not cover {refusal}")

    def starter(self, problem: Any) -> str:
        """Return the name of the heuristic that runs first if there is a time limit; ``""`` for none.

        The heuristic belongs to the same problem and gets a share of the time. Its plan is the answer
        if this backend finds no better one. Short runs need no heuristic.
        """
        return ""

    #: Whether ``"auto"`` stops after this backend, because no other exact backend can do better.
    conclusive: ClassVar[bool] = False

    def is_brief(self, problem: Any) -> bool:
        """Return True if every run on `problem` ends within about 0.1 s.

        Such a run uses the caller's thread without a deadline, because starting a thread and a timer
        takes longer than the run.
        """
        return False

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return True if a run on a model of type `kind` can be stopped from within its process.

        Otherwise the run moves to a worker process, which can be killed.
        """
        return Feature.INTERRUPT in self.features

    def patience(self, kind: type[Model[Any]]) -> float:
        """Return the seconds that a run on a model of type `kind` may take to stop.

        After that time the run is abandoned, and its last reported incumbent is its answer.
        """
        return GRACE

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        """Return the defaults that :func:`crosstrack.compare` uses for this backend's options.

        They switch off what crosstrack adds to a solver, so that a comparison measures the solver
        alone. Values given by the user take precedence. `kind` is the type of the problem.
        """
        return {}

    def missing(self) -> tuple[str, ...]:
        """Return the required packages that are not installed, without importing any."""
        return tuple(name for name in self.requires if importlib.util.find_spec(name) is None)

    def version(self) -> str | None:
        """Return the version of the solver's distribution; None if it is not installed."""
        distribution = self.distribution or next(iter(self.requires), "")
        if not distribution:
            return __version__
        return _installed(distribution)

    def require(self) -> None:
        """Raise :class:`BackendMissing` with the install command if a required package is missing."""
        missing = self.missing()
        if missing:
            how = f"crosstrack[{self.extra}]" if self.extra else " ".join(missing)
            raise BackendMissing(
                f"backend {self.name!r} needs {', '.join(missing)}: pip install '{how}'"
            )

    def checked_options(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all options of this backend, with `given` validated and defaults filled in.

        Parameters
        ----------
        given : mapping of str to object
            Values by option name.

        Raises
        ------
        UnsupportedOption
            A name is unknown or a value is not allowed.
        """
        values = Table().coerce("backend_options", given, {})
        return check_options(f"backend {self.name!r}", self.options, values)
