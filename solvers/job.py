"""One run that is asked for: everything that decides its answer, checked before it starts."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..errors import UnsupportedFormulation, UnsupportedOption
from ..models.fields import show
from ..models.formulation import Formulation
from ..models.model import Model
from ..models.verification import TOLERANCE, check_number, check_tolerance
from . import stopping
from .backend import Backend, Feature, Guarantee
from .registry import accepted, default_formulation, find_backend, recommended
from .stopping import Criterion

__all__ = ["GAP", "LEAST_MEMORY", "UNPOLISHED", "Job", "Target", "check_memory"]

#: The relative gap that is asked of every exact backend unless another is given.
GAP = 1e-6
#: MiB below which no process of ours can run.
LEAST_MEMORY = 64.0
#: Share of the time limit that a run gets even if imports and the start of a worker took longer than the rest.
LEAST_SHARE = 0.5
#: What comparisons ask of every solver of quadratic programs: its own precision.
UNPOLISHED: Mapping[str, Any] = {"polish": False}


def check_memory(value: Any) -> float:
    """Return a memory limit in MiB; raise :class:`UnsupportedOption` if a process needs more."""
    number = check_number("memory_limit", value)
    if number < LEAST_MEMORY:
        raise UnsupportedOption(
            f"memory_limit is in MiB and must be at least {LEAST_MEMORY:g}, which Python with NumPy "
            f"needs, got {show(value)} (1 GiB is 1024 MiB)"
        )
    return number


@dataclass(frozen=True)
class Target:
    """What a backend will be given: a model of its own, or a formulation of one."""

    backend: Backend
    model: Model[Any]
    formulation: Formulation[Any, Any] | None

    @property
    def kind(self) -> type[Model[Any]]:
        """The type of the problem that the backend is given."""
        return type(self.model) if self.formulation is None else self.formulation.program_type


def _plain(limit: float | None) -> float | None:
    """Return 5 for 5.0: they are one limit, and so one key in a record."""
    return int(limit) if limit is not None and float(limit).is_integer() else limit


@dataclass(frozen=True)
class Job:
    """A model, a backend and all options; :func:`crosstrack.solve` and ``compare`` say what they mean."""

    model: Model[Any]
    backend: str | Backend = "auto"
    formulation: str | None = None
    formulation_options: Mapping[str, Any] = field(default_factory=dict)
    time_limit: float | None = None
    gap: float | None = None
    tolerance: float | None = None
    seed: int | None = None
    threads: int | None = None
    evaluations: int | None = None
    target_value: float | None = None
    stop: Criterion | None = None
    warm_start: Any = None
    starts: int = 1
    verbose: bool = False
    backend_options: Mapping[str, Any] = field(default_factory=dict)
    compiled: bool = False
    memory_limit: float | None = None
    repeat: int = 0
    #: True if `time_limit` is wall-clock time with compiling, as in one call; comparisons leave the
    #: seconds of compiling out, which only the first run of a backend has.
    counts_compilation: bool = False
    #: True if another backend continues when this one has no plan, so that time is left for it.
    has_fallback: bool = False

    def __post_init__(self) -> None:
        if self.time_limit is not None:
            check_number("time_limit", self.time_limit)
        if self.memory_limit is not None:
            check_memory(self.memory_limit)
        if self.gap is not None:
            check_number("gap", self.gap, strict=False)
        if self.tolerance is not None:
            check_tolerance(self.tolerance)
        for name, lower in (("seed", 0), ("threads", 1), ("evaluations", 1), ("starts", 1)):
            value = getattr(self, name)
            if value is None and name != "starts":
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < lower:
                raise UnsupportedOption(
                    f"{name} must be a whole number >= {lower}, got {show(value)}"
                )
        if self.target_value is not None:
            stopping.Target(self.target_value)  # raises for what is no number
        if not isinstance(self.verbose, bool):
            raise UnsupportedOption(f"verbose must be True or False, got {self.verbose!r}")
        if self.stop is not None and not isinstance(self.stop, Criterion):
            raise UnsupportedOption(f"stop must be a Criterion, got {show(self.stop)}")

    def after(self, seconds: float) -> Job:
        """Return the job with the time that is left of its limit after so many seconds of imports and starts.

        It is at least :data:`LEAST_SHARE` of the limit, so that a slow start leaves time for a plan.
        """
        if self.time_limit is None:
            return self
        left = max(self.time_limit - seconds, LEAST_SHARE * self.time_limit)
        return replace(self, time_limit=left)

    def resolved(self) -> Job:
        """Return the job with its backend looked up and ``"auto"`` decided."""
        if isinstance(self.backend, Backend):
            return self
        if isinstance(self.backend, str) and self.backend == "auto":
            if self.formulation is not None:
                self._known_formulation(self.formulation)
            return replace(self, backend=recommended(self.model, self.formulation))
        return replace(self, backend=find_backend(self.backend, self.model))

    def target(self) -> Target:
        """Return what the backend will be given; whatever it does not support raises here.

        Raises
        ------
        BackendMissing
            The backend is not installed.
        UnsupportedOption, UnsupportedFormulation, UnknownName
            Something asked for is not to be had; nothing is dropped in silence.
        """
        backend = self.resolved().backend
        assert isinstance(backend, Backend)
        backend.require()
        backend.checked_options(self.backend_options)
        for name, feature in (
            ("gap", Feature.GAP),
            ("seed", Feature.SEED),
            ("threads", Feature.THREADS),
            ("evaluations", Feature.EVALUATIONS),
            ("target_value", Feature.INCUMBENTS),
            ("stop", Feature.INCUMBENTS),
        ):
            asked = getattr(self, name)
            if asked is None or feature in backend.features:
                continue
            if name == "threads" and asked == 1 and backend.single_threaded:
                continue
            if name == "seed" and backend.deterministic:
                continue
            word = name.partition("_")[0]
            raise UnsupportedOption(f"backend {backend.name!r} does not support {word}={asked!r}")
        usable = {Feature.WARM_START, Feature.CUTOFF} & backend.features
        if self.warm_start is not None and not usable:
            raise UnsupportedOption(f"backend {backend.name!r} takes no warm start")
        if self.starts > 1 and (
            backend.guarantee is Guarantee.EXACT or Feature.SEED not in backend.features
        ):
            why = (
                "is exact: one start proves"
                if backend.guarantee is Guarantee.EXACT
                else "takes no seed"
            )
            raise UnsupportedOption(
                f"backend {backend.name!r} {why}; starts must be 1, got {self.starts}"
            )
        if self.formulation is not None:
            self._known_formulation(self.formulation)
        model = accepted(self.model, backend, self.formulation)
        if model is None:
            raise UnsupportedFormulation(self._refusal(backend))
        if self.formulation is None and isinstance(model, backend.accepts):
            if self.formulation_options:
                raise UnsupportedOption(
                    f"backend {backend.name!r} takes model {model.kind!r} itself: it has no formulation_options"
                )
            return Target(backend, model, None)
        name = self.formulation or default_formulation(model, backend)
        written = model.blinded().formulate(name, **self.formulation_options)
        return Target(backend, model, written)

    def _known_formulation(self, name: str) -> None:
        step: Model[Any] | None = self.model
        while step is not None:
            if isinstance(name, str) and name in step.formulations:
                return
            step = step.lower()
        type(self.model).formulation_type(name)  # raises UnknownName with what there is

    def _refusal(self, backend: Backend) -> str:
        takes = backend.accepted_kinds()
        if self.formulation is not None and issubclass(type(self.model), backend.accepts):
            return f"backend {backend.name!r} takes model {takes!r} itself, not its formulation {self.formulation!r}"
        what = f"formulation {self.formulation!r} of model" if self.formulation else "model"
        return (
            f"backend {backend.name!r} accepts {takes!r}; it cannot take {what} {self.model.kind!r}"
        )

    def options(self) -> dict[str, Any]:
        """Return everything asked of the run as JSON data, for the solution's record."""
        given = {
            "evaluations": self.evaluations,
            "target": self.target_value,
            "stop": None if self.stop is None else repr(self.stop),
            "files": self._files() or None,
            "memory_limit": self.memory_limit,
            "repeat": self.repeat or None,
        }
        return {
            # Written where given only, so that records of earlier versions keep their keys.
            **{name: value for name, value in given.items() if value is not None},
            "time_limit": _plain(self.time_limit),
            "gap": GAP if self.gap is None else self.gap,
            "tolerance": TOLERANCE if self.tolerance is None else self.tolerance,
            "threads": self.threads,
            "starts": self.starts,
            "warm_start": None
            if self.warm_start is None
            else self.model.plan_to_data(self.warm_start),
            "backend_options": dict(self.backend_options),
        }

    def _files(self) -> dict[str, str]:
        """Return the SHA-256 of every file that a backend option names, by the option."""
        backend = self.backend
        options = backend.options if isinstance(backend, Backend) else {}
        return {
            name: hashlib.sha256(Path(str(value)).read_bytes()).hexdigest()
            for name, value in self.backend_options.items()
            if value is not None and name in options and options[name].file
        }

    @property
    def criterion(self) -> Criterion | None:
        """What stops the run beside its time limit."""
        parts: list[Criterion] = [] if self.stop is None else [self.stop]
        if self.evaluations is not None:
            parts.append(stopping.Evaluations(self.evaluations))
        if self.target_value is not None:
            parts.append(stopping.Target(self.target_value))
        return stopping.AnyOf(tuple(parts)) if parts else None

    @property
    def verification_tolerance(self) -> float:
        """Largest violation accepted of a plan."""
        return TOLERANCE if self.tolerance is None else float(self.tolerance)

    def key(self) -> str:
        """Return what identifies the job in a campaign's record: same key, same work."""
        name = self.backend if isinstance(self.backend, str) else self.backend.name
        parts = [
            self.model.digest, name, self.formulation, dict(self.formulation_options), self.seed, self.options()
        ]  # fmt: skip
        text = json.dumps(parts, sort_keys=True, default=repr)
        return hashlib.sha256(text.encode()).hexdigest()[:24]
