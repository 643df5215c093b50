"""A campaign as a TOML file declares it: which backends run on which instances, and how."""

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
from ..backend import Backend, Feature
from ..crosscheck import task_of
from ..job import GAP, LEAST_MEMORY
from ..registry import (
    accepted,
    backend_states,
    default_formulation,
    find_backend,
    fitting,
    recommended,
)  # fmt: skip
from ..scheduling import Task

__all__ = ["Campaign", "Set"]

#: Jobs of a campaign at most: more is a mistake in the file.
MOST = 1_000_000


def _near(name: str, known: Iterable[str]) -> str:
    """Return ``", did you mean …?"``, or nothing where no known name is near."""
    words = suggestion(name, known).strip()
    return f", {words}" if words else ""


@dataclass(frozen=True)
class _List(Spec):
    """A list of at least `least` entries, each as `spec` says, as a tuple."""

    spec: Spec
    least: int = 0

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) < self.least:
            least = f" of at least {self.least}" if self.least else ""
            raise InvalidData(f"{name} must be a list{least}, got {show(value)}", field=name)
        return tuple(self.spec.coerce(f"{name}[{k}]", one, sizes) for k, one in enumerate(value))


@dataclass(frozen=True)
class _Pair(Spec):
    """Two globs: of instances, and of backends."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[str, str]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise InvalidData(
                f"{name} must be a pair of globs, of instances and of backends, got {show(value)}",
                field=name,
            )
        first, second = (Text().coerce(name, one, sizes) for one in value)
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
    """Jobs that are asked for alike: every backend on every instance.

    Parameters
    ----------
    instances : tuple of str
        Globs over the names of the catalogue, such as ``"error-correction/*"``, or files below the
        campaign's folder, such as ``"./mine/*.json"``.
    backends : tuple of str
        Names or globs of installed backends, ``"name:formulation"`` for one on a certain formulation,
        ``"auto"`` for the recommended one; ``"*"`` are all that accept an instance by default.
    exclude : tuple of (str, str)
        Globs of instances and of backends, or of ``"name:formulation"``, that do not run together.
    formulations : tuple of str
        Backends that take programs run on each that the model has; without any, on the default.
    seeds : tuple of int
        Backends that draw run from each.
    repeats : int
        How often every job runs: medians of seconds want several.
    time_limit : float, optional
        Seconds for each job, the building of the program included.
    memory_limit : float, optional
        MiB that the process of a job and all its children may hold in memory, at least 64.
    gap, tolerance : float
        The same for all: the relative gap at which an exact backend may stop, and the largest violation
        that our own verification accepts.
    threads : int, optional
        For the backends that have the feature.
    compiled : bool
        Compile the loops of our own algorithms, which is not part of the seconds measured.
    warm_up : bool
        Let each process run a first job of its kind unrecorded, so that imports are not measured.
    backend_options : mapping of str to mapping
        Own options by the backend's name.
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
        for one in fields(self):
            value = _SPECS[one.name].coerce(one.name, getattr(self, one.name), {})
            object.__setattr__(self, one.name, value)
        installed = {state.name for state in backend_states() if state.state == "installed"}
        for asked in self.backends:
            name = asked.partition(":")[0]
            if name != "auto" and not any(fnmatchcase(one, name) for one in installed):
                raise UnknownName("backend in backends", name, sorted(installed))
        for name, options in self.backend_options.items():
            if name not in installed:
                raise UnknownName("backend in backend_options", name, sorted(installed))
            Table().coerce(f"backend_options.{name}", options, {})

    def excluding(self, instance: str, *names: str) -> set[tuple[str, str]]:
        """Return the exclusions of an instance with a backend, by any of its names; none: they run."""
        return {
            (one, two)
            for one, two in self.exclude
            if fnmatchcase(instance, one) and any(fnmatchcase(name, two) for name in names)
        }

    def asked(self, model: Model[Any]) -> Iterator[tuple[str, Backend, str | None]]:
        """Yield the backends that run on `model` with the entry that asks for them, and their formulation."""
        usual = fitting(model)
        for entry in self.backends:
            name, _, formulation = entry.partition(":")
            if name == "auto":
                chosen = [recommended(model, formulation or None).name]
            else:
                # One that is named may need a formulation of its own, or cannot take the model at all.
                names = usual if any(sign in name for sign in "*?[") else (name,)
                chosen = [one for one in names if fnmatchcase(one, name)]
            for one in chosen:
                for backend, how in self._formulated(model, one, formulation):
                    yield entry, backend, how

    def _formulated(
        self, model: Model[Any], name: str, formulation: str
    ) -> Iterator[tuple[Backend, str | None]]:
        try:
            backend = find_backend(name, model)
        except UnknownName:
            return  # the algorithm of another problem
        wanted: list[str | None] = [formulation] if formulation else [*self.formulations]
        if not formulation and isinstance(model, backend.accepts):
            wanted = []  # it takes the model itself
        for one in wanted or [None]:
            if accepted(model, backend, one) is not None:
                yield backend, one


@dataclass(frozen=True)
class Campaign:
    """What a campaign runs.

    Parameters
    ----------
    sets : tuple of Set
        Jobs that are asked for alike, in their order.
    title : str
        For people.
    folder : str
        Where the files lie that its sets name.
    file : str
        The campaign's own, which messages name; empty where there is none.
    """

    sets: tuple[Set, ...]
    title: str = ""
    folder: str = "."
    file: str = ""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Campaign:
        """Return the campaign in a TOML file.

        The keys are the fields of :class:`Set`, and ``title``. Tables ``[[set]]`` hold what differs: each
        makes a set of its own, with what stands above them where it says nothing itself.

        Raises
        ------
        InvalidData
            Naming the file and the key at fault, or the line where it is no TOML.
        """
        file = as_path(path)
        try:
            data = tomllib.loads(read_text(file))
        except (ValueError, RecursionError) as error:  # ValueError: a number of too many digits
            if isinstance(error, InvalidData):
                raise
            raise InvalidData(f"{file} is no TOML: {error}") from None
        try:
            title = Text().coerce("title", data.pop("title", file.stem), {})
            sets = data.pop("set", [{}])
            if not isinstance(sets, list) or not sets:
                raise InvalidData(f"set must be tables [[set]], got {show(sets)}", field="set")
            made = []
            for own in sets:
                whole = {**data, **Table().coerce("set", own, {})}
                for key in whole:
                    if key not in _SPECS:
                        raise InvalidData(f"unknown key {key!r}{_near(key, _SPECS)}", field=key)
                if "instances" not in whole:
                    raise InvalidData("key 'instances' is missing", field="instances")
                made.append(Set(**whole))
            return cls(tuple(made), title, str(file.resolve().parent), str(file))
        except (InvalidData, UnknownName) as error:
            raise InvalidData(f"{file}: {error}", field=getattr(error, "field", None)) from None

    def models(self, part: Set) -> Iterator[Model[Any]]:
        """Yield the instances of a set, each once.

        Raises
        ------
        InvalidData
            A glob matches nothing, or leads out of the campaign's folder.
        """
        seen: set[str] = set()
        for pattern in part.instances:
            found = list(self._matching(pattern))
            if not found:
                near = _near(pattern, [one.name for one in entries()])
                raise InvalidData(
                    f"instances: {show(pattern)} matches nothing{near}", field="instances"
                )
            for source in found:
                if str(source) not in seen:
                    seen.add(str(source))
                    yield load(source)

    def _matching(self, pattern: str) -> Iterator[str | Path]:
        if not pattern.startswith(".") and Path(pattern).suffix != ".json":
            yield from (one.name for one in entries() if fnmatchcase(one.name, pattern))
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
        ) as error:  # as systems and versions refuse it
            raise InvalidData(
                f"instances: {show(pattern)} is no pattern of files: {getattr(error, 'strerror', None) or error}",
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
        """Every job, in order: by set, instance, backend, seed and repeat.

        Raises
        ------
        InvalidData, UnsupportedOption
            Nothing is to be run, a backend that is named accepts no instance, or an exclusion or a
            formulation fits nothing.
        """
        try:
            return tuple(self._tasks())
        except InvalidData as error:
            if not self.file:
                raise
            raise InvalidData(f"{self.file}: {error}", field=error.field) from None

    def _tasks(self) -> list[Task]:
        found: list[Task] = []
        #: What sets ask for twice runs once.
        asked_for: set[str] = set()
        columns: dict[tuple[str, str], int] = {}
        away = [one.name for one in backend_states() if one.state != "installed"]
        # What is not installed here may be elsewhere, and be excluded there.
        unused = {
            one
            for part in self.sets
            for one in part.exclude
            if not any(fnmatchcase(name, one[1].partition(":")[0]) for name in away)
        }
        row = 0
        for part in self.sets:
            met: set[str] = set()
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
                    met.add(entry)
                    resolved = _resolved(model, backend, formulation)
                    if (backend.name, resolved) in seen:
                        continue
                    seen.add((backend.name, resolved))
                    if out := part.excluding(name, backend.name, f"{backend.name}:{resolved}"):
                        unused -= out
                        continue
                    column = columns.setdefault((backend.problem, backend.name), len(columns))
                    draws = Feature.SEED in backend.features
                    seeds = part.seeds[: None if draws else 1]
                    if len(found) + len(seeds) * part.repeats > MOST:
                        raise InvalidData(
                            f"a campaign may have {MOST} jobs at most", field="instances"
                        )
                    for seed, repeat in product(seeds, range(part.repeats)):
                        # Counted over the formulations as well: a backend's column is one.
                        turn = turns[column] = turns.get(column, -1) + 1
                        place = (row, column, turn)
                        task = self._task(place, part, model, backend, formulation, seed, repeat)
                        if (key := task.job.key()) not in asked_for:
                            asked_for.add(key)
                            found.append(task)
                row += 1
            for one in part.formulations:
                if one not in known:
                    raise InvalidData(
                        f"formulations: none of the instances has {one!r}{_near(one, known)}",
                        field="formulations",
                    )
            for asked in part.backends:
                if asked not in met:
                    raise InvalidData(
                        f"backends: {asked!r} accepts none of the instances", field="backends"
                    )
        if unused:
            raise InvalidData(
                f"exclude: {show(list(min(unused)))} excludes nothing that would run",
                field="exclude",
            )
        if not found:
            raise InvalidData("exclude: everything is excluded", field="exclude")
        return found

    def _task(
        self, place: tuple[int, int, int], part: Set, model: Model[Any], backend: Backend,
        formulation: str | None, seed: int, repeat: int,
    ) -> Task:  # fmt: skip
        common: dict[str, Any] = {
            "formulation_options": {}, "time_limit": part.time_limit, "gap": part.gap,
            "tolerance": part.tolerance, "seed": seed, "threads": part.threads, "evaluations": None,
            "target_value": None, "compiled": part.compiled, "memory_limit": part.memory_limit,
            "repeat": repeat,
        }  # fmt: skip
        own = part.backend_options.get(backend.name, {})
        task = task_of(place, model, backend, formulation, common, None, own)
        task.warm_up = part.warm_up
        return task


def _resolved(model: Model[Any], backend: Backend, formulation: str | None) -> str | None:
    """Return the formulation that `backend` takes, None where it takes a model itself."""
    step = accepted(model, backend, formulation)
    if formulation is not None or step is None or isinstance(step, backend.accepts):
        return formulation
    return default_formulation(step, backend)
