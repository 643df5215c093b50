"""Campaign declared in a TOML file: which backends run on which instances, with which options."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from fnmatch import fnmatchcase
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from ...errors import InvalidData, UnknownName, suggestion
from ...files import as_path, read_text
from ...instances.catalogue import entries, load
from ...models.fields import Flag, Optional, Real, Spec, Text, Whole, show
from ...models.model import Model
from ...models.records import Table
from ...models.verification import TOLERANCE
from ..contract.backend import Backend, Feature
from ..contract.job import GAP
from ..contract.limits import LEAST_MEMORY, Limits
from ..contract.registry import accepted, default_formulation, find_backend
from ..contract.selection import fitting, recommended
from ..contract.states import backend_states
from ..processes.scheduling import Task
from ..run.crosscheck import task_of

__all__ = ["Campaign", "Set"]

#: Largest number of jobs of a campaign. A larger number is an error in the file.
MOST = 1_000_000


def _near(name: str, known: Iterable[str]) -> str:
    """Return ``", did you mean …?"``, or an empty text if no known name is similar."""
    words = suggestion(name, known).strip()
    return f", {words}" if words else ""


@dataclass(frozen=True)
class _List(Spec):
    """Specification of a list of at least `least` entries, each of type `spec`, coerced to a tuple."""

    spec: Spec
    least: int = 0

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) < self.least:
            least = f" of at least {self.least}" if self.least else ""
            raise InvalidData(f"{name} must be a list{least}, got {show(value)}", field=name)
        return tuple(
            self.spec.coerce(f"{name}[{k}]", entry, sizes) for k, entry in enumerate(value)
        )


@dataclass(frozen=True)
class _Pair(Spec):
    """Specification of a pair of glob patterns (instance, backend)."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[str, str]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise InvalidData(
                f"{name} must be a pair of globs (instance, backend), got {show(value)}",
                field=name,
            )
        first, second = (Text().coerce(name, entry, sizes) for entry in value)
        return first, second


_SPECS: dict[str, Spec] = {
    "instances": _List(Text(), 1),
    "backends": _List(Text(), 1),
    "exclude": _List(_Pair()),
    "formulations": _List(Text()),
    "seeds": _List(Whole(0), 1),
    "repeats": Whole(1),
    "time_limit": Optional(Real(0.0, strict=True, unit="s")),
    "memory_limit": Optional(Real(LEAST_MEMORY, unit="MiB")),
    "gap": Real(0.0),
    "tolerance": Real(0.0, 1.0, strict=True),
    "threads": Optional(Whole(1)),
    "compiled": Flag(),
    "warm_up": Flag(),
    "backend_options": Table(),
}


@dataclass(frozen=True)
class Set:
    """Jobs with the same options: every backend on every instance.

    Parameters
    ----------
    instances : tuple of str
        Globs over the names of the catalogue, such as ``"error-correction/*"``, or files below the
        folder of the campaign, such as ``"./mine/*.json"`` or ``"programs/*.mps"``. A pattern that
        matches no name of the catalogue is one of files.
    backends : tuple of str
        Names or globs of installed backends. ``"name:formulation"`` selects a formulation, ``"auto"``
        the recommended backend, and ``"*"`` all that accept an instance by default.
    exclude : tuple of (str, str)
        Pairs of globs, (instance, backend) or (instance, ``"name:formulation"``), that do not run.
    formulations : tuple of str
        Backends for programs run on each of these that the model has. Default: the model's default
        formulation.
    seeds : tuple of int
        Seeds of the randomised backends. Others run once.
    repeats : int
        Number of runs of every job. Several runs make the median seconds more reliable.
    time_limit : float, optional
        Seconds per job, including the time to build the program.
    memory_limit : float, optional
        Memory limit of each job in MiB, including child processes, at least 64.
    gap, tolerance : float
        Relative gap at which exact backends may stop, and largest accepted violation in the
        verification.
    threads : int, optional
        Number of threads, for backends that support it.
    compiled : bool
        Compile the loops of the native algorithms. Compilation is not part of the measured seconds.
    warm_up : bool
        Let each process run its first job once without a record, so that imports are not measured.
    backend_options : mapping of str to mapping
        Options by name of the backend.
    """

    instances: tuple[str, ...]
    backends: tuple[str, ...] = ("*",)
    exclude: tuple[tuple[str, str], ...] = ()
    formulations: tuple[str, ...] = ()
    seeds: tuple[int, ...] = (0,)
    repeats: int = 1
    time_limit: float | None = 60.0
    memory_limit: float | None = None
    gap: float = GAP
    tolerance: float = TOLERANCE
    threads: int | None = 1
    compiled: bool = True
    warm_up: bool = True
    backend_options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = _SPECS[item.name].coerce(item.name, getattr(self, item.name), {})
            object.__setattr__(self, item.name, value)
        installed = {state.name for state in backend_states() if state.state == "installed"}
        for entry in self.backends:
            name = entry.partition(":")[0]
            if name != "auto" and not any(fnmatchcase(other, name) for other in installed):
                raise UnknownName("backend in backends", name, sorted(installed))
        for name, options in self.backend_options.items():
            if name not in installed:
                raise UnknownName("backend in backend_options", name, sorted(installed))
            Table().coerce(f"backend_options.{name}", options, {})

    def excluding(self, instance: str, *names: str) -> set[tuple[str, str]]:
        """Return the exclusions that match an instance and any of the names of a backend."""
        return {
            (of_instance, of_backend)
            for of_instance, of_backend in self.exclude
            if fnmatchcase(instance, of_instance)
            and any(fnmatchcase(name, of_backend) for name in names)
        }

    def asked(self, model: Model[Any]) -> Iterator[tuple[str, Backend, str | None]]:
        """Yield (entry of `backends`, backend, formulation) for each run on `model`."""
        usual = fitting(model)
        for entry in self.backends:
            name, _, formulation = entry.partition(":")
            if name == "auto":
                chosen = [recommended(model, formulation or None).name]
            else:
                # A named backend may need an explicit formulation, or may not accept the model at all.
                names = usual if any(sign in name for sign in "*?[") else (name,)
                chosen = [candidate for candidate in names if fnmatchcase(candidate, name)]
            for candidate in chosen:
                for backend, selected in self._formulated(model, candidate, formulation):
                    yield entry, backend, selected

    def _formulated(
        self, model: Model[Any], name: str, formulation: str
    ) -> Iterator[tuple[Backend, str | None]]:
        try:
            backend = find_backend(name, model)
        except UnknownName:
            return  # the algorithm of another problem
        names: list[str | None] = [formulation] if formulation else [*self.formulations]
        if not formulation and isinstance(model, backend.accepts):
            names = []  # it solves the model itself
        for candidate in names or [None]:
            if accepted(model, backend, candidate) is not None:
                yield backend, candidate


@dataclass(frozen=True)
class Campaign:
    """Campaign: sets of jobs.

    Parameters
    ----------
    sets : tuple of Set
        Sets of jobs, in the order of their runs.
    title : str
        Title of the report.
    folder : str
        Folder of the files that the sets name.
    file : str
        Name of the campaign's file, for messages; empty without a file.
    limits : mapping
        Fields of :class:`~crosstrack.solvers.contract.limits.Limits` that replace those of the sets.
    """

    sets: tuple[Set, ...]
    title: str = ""
    folder: str = "."
    file: str = ""
    limits: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Campaign:
        """Return the campaign in a TOML file.

        Keys are the fields of :class:`Set`, and ``title``. Each table ``[[set]]`` declares a set; keys
        above the tables are its defaults.

        Parameters
        ----------
        path : str or path-like
            Name of the file.

        Raises
        ------
        InvalidData
            The file is not TOML, or a key is invalid. The message names the file and the key or line.
        """
        file = as_path(path)
        try:
            data = tomllib.loads(read_text(file))
        except (ValueError, RecursionError) as error:  # ValueError: a number with too many digits
            if isinstance(error, InvalidData):
                raise
            raise InvalidData(f"{file} is no TOML: {error}") from None
        try:
            title = Text().coerce("title", data.pop("title", file.stem), {})
            sets = data.pop("set", [{}])
            if not isinstance(sets, list) or not sets:
                raise InvalidData(f"set must be tables [[set]], got {show(sets)}", field="set")
            declared = []
            for entry in sets:
                merged = {**data, **Table().coerce("set", entry, {})}
                for key in merged:
                    if key not in _SPECS:
                        raise InvalidData(f"unknown key {key!r}{_near(key, _SPECS)}", field=key)
                if "instances" not in merged:
                    raise InvalidData("key 'instances' is missing", field="instances")
                declared.append(Set(**merged))
            return cls(tuple(declared), title, str(file.resolve().parent), str(file))
        except (InvalidData, UnknownName) as error:
            raise InvalidData(f"{file}: {error}", field=getattr(error, "field", None)) from None

    def models(self, part: Set) -> Iterator[Model[Any]]:
        """Yield the instances of a set without duplicates.

        Parameters
        ----------
        part : Set
            The set.

        Raises
        ------
        InvalidData
            A glob matches nothing, or leads out of the folder of the campaign.
        """
        seen: set[str] = set()
        for pattern in part.instances:
            sources = list(self._matching(pattern))
            if not sources:
                near = _near(pattern, [item.name for item in entries()])
                raise InvalidData(
                    f"instances: {show(pattern)} matches nothing{near}", field="instances"
                )
            for source in sources:
                if str(source) not in seen:
                    seen.add(str(source))
                    yield load(source)

    def _matching(self, pattern: str) -> Iterator[str | Path]:
        if not pattern.startswith("."):
            names = [item.name for item in entries() if fnmatchcase(item.name, pattern)]
            yield from names
            if names or not (Path(pattern).suffix or "/" in pattern):
                return
        root = Path(self.folder).resolve()
        if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
            raise InvalidData(
                f"instances: {show(pattern)} must lie below the campaign's folder",
                field="instances",
            )
        try:
            files = sorted(root.glob(pattern))
        except (
            OSError,
            ValueError,
            IndexError,
            AttributeError,
        ) as error:  # exceptions differ between systems and Python versions
            raise InvalidData(
                f"instances: {show(pattern)} is not a file pattern: {getattr(error, 'strerror', None) or error}",
                field="instances",
            ) from None
        for file in files:
            if not file.resolve().is_relative_to(root):
                raise InvalidData(
                    f"instances: {str(file)!r} leads out of the campaign's folder",
                    field="instances",
                )
            yield file

    @cached_property
    def tasks(self) -> tuple[Task, ...]:
        """All jobs, ordered by set, instance, backend, seed and repeat.

        Raises
        ------
        InvalidData, UnsupportedOption
            There is no job, a named backend accepts no instance, or an exclusion or a formulation
            matches nothing.
        """
        try:
            return tuple(self._tasks())
        except InvalidData as error:
            if not self.file:
                raise
            raise InvalidData(f"{self.file}: {error}", field=error.field) from None

    def _tasks(self) -> list[Task]:
        tasks: list[Task] = []
        #: Keys of the jobs, because a job in several sets runs once.
        keys: set[str] = set()
        columns: dict[tuple[str, str], int] = {}
        missing = [state.name for state in backend_states() if state.state != "installed"]
        # A backend that is missing here may be installed, and excluded, on another machine.
        unused = {
            pair
            for part in self.sets
            for pair in part.exclude
            if not any(fnmatchcase(name, pair[1].partition(":")[0]) for name in missing)
        }
        row = 0
        for part in self.sets:
            matched: set[str] = set()
            known: set[str] = set()
            for model in self.models(part):
                name = model.name or model.digest[:12]
                turns: dict[int, int] = {}
                step: Model[Any] | None = model
                while step is not None:
                    known.update(step.formulations)
                    step = step.lower()
                seen: set[tuple[str, str | None]] = set()
                for entry, backend, formulation in part.asked(model):
                    matched.add(entry)
                    resolved = _resolved(model, backend, formulation)
                    if (backend.name, resolved) in seen:
                        continue
                    seen.add((backend.name, resolved))
                    if excluded := part.excluding(name, backend.name, f"{backend.name}:{resolved}"):
                        unused -= excluded
                        continue
                    column = columns.setdefault((backend.problem, backend.name), len(columns))
                    draws = Feature.SEED in backend.features
                    seeds = part.seeds[: None if draws else 1]
                    if "seed" in self.limits:
                        seeds = (self.limits["seed"],)
                    if len(tasks) + len(seeds) * part.repeats > MOST:
                        raise InvalidData(
                            f"a campaign may have at most {MOST} jobs", field="instances"
                        )
                    for seed, repeat in product(seeds, range(part.repeats)):
                        # Counted over all formulations, because a backend has a single column.
                        turn = turns[column] = turns.get(column, -1) + 1
                        place = (row, column, turn)
                        task = self._task(place, part, model, backend, formulation, seed, repeat)
                        if (key := task.job.key()) not in keys:
                            keys.add(key)
                            tasks.append(task)
                row += 1
            for formulation_name in part.formulations:
                if formulation_name not in known:
                    raise InvalidData(
                        f"formulations: none of the instances has {formulation_name!r}{_near(formulation_name, known)}",
                        field="formulations",
                    )
            for entry in part.backends:
                if entry not in matched:
                    raise InvalidData(
                        f"backends: {entry!r} accepts none of the instances", field="backends"
                    )
        if unused:
            raise InvalidData(
                f"exclude: {show(list(min(unused)))} excludes nothing that would run",
                field="exclude",
            )
        if not tasks:
            raise InvalidData("exclude: everything is excluded", field="exclude")
        return tasks

    def _task(
        self, place: tuple[int, int, int], part: Set, model: Model[Any], backend: Backend,
        formulation: str | None, seed: int, repeat: int,
    ) -> Task:  # fmt: skip
        given = {
            "time_limit": part.time_limit, "memory_limit": part.memory_limit, "gap": part.gap,
            "tolerance": part.tolerance, "seed": seed, "threads": part.threads, **self.limits,
        }  # fmt: skip
        options = part.backend_options.get(backend.name, {})
        others = {"compiled": part.compiled, "repeat": repeat}
        task = task_of(place, model, backend, formulation, Limits(**given), options, **others)
        task.warm_up = part.warm_up
        return task


def _resolved(model: Model[Any], backend: Backend, formulation: str | None) -> str | None:
    """Return the formulation that `backend` solves; None if it accepts a model itself."""
    step = accepted(model, backend, formulation)
    if formulation is not None or step is None or isinstance(step, backend.accepts):
        return formulation
    return default_formulation(step, backend)
