"""Job: one run with all inputs that determine its answer, validated before it starts."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...models.model import Model
from ...models.verification import TOLERANCE
from .backend import Backend
from .enums import PROVING, Guarantee
from .limits import Limits
from .registry import (
    accepted,
    default_formulation,
    find_backend,
    integral_solvers,
    integrality_refusal,
)

if TYPE_CHECKING:
    from ...models.formulation import Formulation

__all__ = ["GAP", "UNPOLISHED", "Job", "Target"]

#: Default relative gap of exact backends.
GAP = 1e-6
#: Share of the time limit that a run gets even if imports and the start of a worker took longer.
LEAST_SHARE = 0.5
#: Default options of solvers of quadratic programs in comparisons: the solver's own precision.
UNPOLISHED: Mapping[str, Any] = {"polish": False}


@dataclass(frozen=True)
class Target:
    """Input of a backend: a model that it accepts, or a formulation of a model.

    Parameters
    ----------
    backend : Backend
        The backend.
    model : Model
        The model that is solved or formulated.
    formulation : Formulation, optional
        The formulation whose program is solved; None if the backend accepts the model itself.
    """

    backend: Backend
    model: Model[Any]
    formulation: Formulation[Any, Any] | None

    @property
    def kind(self) -> type[Model[Any]]:
        """Type of the problem that the backend receives."""
        return type(self.model) if self.formulation is None else self.formulation.program_type

    @property
    def proves(self) -> bool:
        """Whether bounds and infeasibility of the program are valid for the model."""
        relaxes = self.formulation is None or self.formulation.relaxes
        return self.backend.guarantee in PROVING and relaxes


def _plain(limit: float | None) -> float | None:
    """Return 5 for 5.0, so that equal limits have equal keys in a record."""
    return int(limit) if limit is not None and float(limit).is_integer() else limit


@dataclass(frozen=True)
class Job(Limits):
    """Model, backend, limits and options of one run.

    Parameters
    ----------
    model : Model
        The model to solve.
    backend : str or Backend
        Name of a backend, a backend object, or ``"auto"``.
    formulation, formulation_options, backend_options : optional
        As in :func:`crosstrack.solve`.
    compiled : bool
        As in :func:`crosstrack.compare`.
    repeat : int
        Number of the repetition, from 0, which distinguishes equal jobs in a record.
    counts_compilation : bool
        Whether `time_limit` is wall-clock time including compilation, as in a single call. In
        comparisons compilation is excluded, because only the first run of a backend compiles.
    has_fallback : bool
        Whether another backend continues when this one has no plan, so that time is reserved.
    **limits
        Fields of :class:`~crosstrack.solvers.contract.limits.Limits`.

    Raises
    ------
    UnsupportedOption
        An option is outside its range.
    """

    model: Model[Any]
    backend: str | Backend = "auto"
    formulation: str | None = None
    formulation_options: Mapping[str, Any] = field(default_factory=dict)
    backend_options: Mapping[str, Any] = field(default_factory=dict)
    compiled: bool = False
    repeat: int = 0
    counts_compilation: bool = False
    has_fallback: bool = False

    @property
    def is_automatic(self) -> bool:
        """Whether the backend is chosen by the registry."""
        return isinstance(self.backend, str) and self.backend == "auto"

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
        if self.is_automatic:
            if self.formulation is not None:
                self._known_formulation(self.formulation)
            from .selection import recommended

            return replace(self, backend=recommended(self.model, self.formulation))
        return replace(self, backend=find_backend(self.backend, self.model))

    def find_target(self) -> Target:
        """Return the input of the backend; unsupported options raise.

        Raises
        ------
        BackendMissing
            The backend is not installed.
        UnsupportedOption, UnsupportedFormulation, UnknownName
            An option, name or formulation is not available.
        """
        backend = self.resolved().backend
        assert isinstance(backend, Backend)
        backend.require()
        backend.checked_options(self.backend_options)
        for name in backend.unsupported(self):
            value = getattr(self, name)
            if name == "threads" and value == 1 and backend.single_threaded:
                continue
            if name == "warm_start":
                raise UnsupportedOption(f"backend {backend.name!r} takes no warm start")
            if name == "starts":
                exact = backend.guarantee is Guarantee.EXACT
                why = "is exact: one start proves" if exact else "takes no seed"
                raise UnsupportedOption(
                    f"backend {backend.name!r} {why}; starts must be 1, got {value}"
                )
            raise UnsupportedOption(f"backend {backend.name!r} does not support {name}={value!r}")
        if self.formulation is not None:
            self._known_formulation(self.formulation)
        model = accepted(self.model, backend, self.formulation)
        if model is None:
            raise UnsupportedFormulation(self._refusal(backend))
        if self.formulation is None and isinstance(model, backend.accepts):
            if self.formulation_options:
                raise UnsupportedOption(
                    f"backend {backend.name!r} solves model {model.kind!r} itself: it has no formulation_options"
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
        type(self.model).formulation_type(name)  # raises UnknownName with the known names

    def _refusal(self, backend: Backend) -> str:
        kinds = backend.accepted_kinds()
        if self.formulation is None and isinstance(self.model, backend.accepts):
            return integrality_refusal(self.model, backend)
        if self.formulation is not None and issubclass(type(self.model), backend.accepts):
            return f"backend {backend.name!r} solves model {kinds!r} itself, not its formulation {self.formulation!r}"
        subject = f"formulation {self.formulation!r} of model" if self.formulation else "model"
        text = f"backend {backend.name!r} accepts {kinds!r}; it cannot solve {subject} {self.model.kind!r}"
        return ": ".join(part for part in (text, integral_solvers(self.model)) if part)

    def options(self) -> dict[str, Any]:
        """Return all options of the run as JSON data, for the record of the solution."""
        given = {
            "evaluations": self.evaluations,
            "target": self.target,
            "stop": None if self.stop is None else repr(self.stop),
            "files": self._files() or None,
            "memory_limit": self.memory_limit,
            "repeat": self.repeat or None,
        }
        return {
            # Written only if given, so that records of earlier versions keep their keys.
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
        """Return the SHA-256 digest of every file that a backend option names, by option."""
        backend = self.backend
        options = backend.options if isinstance(backend, Backend) else {}
        return {
            name: hashlib.sha256(Path(str(value)).read_bytes()).hexdigest()
            for name, value in self.backend_options.items()
            if value is not None and name in options and options[name].file
        }

    def key(self) -> str:
        """Return the key that identifies the job in a record: equal keys mean equal work."""
        name = self.backend if isinstance(self.backend, str) else self.backend.name
        parts = [
            self.model.digest, name, self.formulation, dict(self.formulation_options), self.seed, self.options()
        ]  # fmt: skip
        text = json.dumps(parts, sort_keys=True, default=repr)
        return hashlib.sha256(text.encode()).hexdigest()[:24]
