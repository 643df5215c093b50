"""Which problems there are, and the tables that declare what belongs to each.

A problem is a folder of the same name in ``models``, ``solvers`` and ``instances``. The ``__init__``
of each holds plain tables of ``"module:object"`` strings, which nothing loads before it is used:

========================= ============= =====================================================
folder                    table         keys and objects
========================= ============= =====================================================
``models/<problem>``      MODELS        model kind: the :class:`~crosstrack.models.Model` type
``models/<problem>``      PICTURES      model kind: function ``(model, plan, **options)``
``solvers/<problem>``     BACKENDS      name: native backend, in order of preference
``solvers/<problem>``     DIAGNOSES     model kind: function ``(model, time_limit) -> Diagnosis``
``solvers/<problem>``     TRAININGS     name of a backend that learns: a ``Training``
``instances/<problem>``   CATALOGUE     catalogue prefix: function that returns the entries
``instances/<problem>``   REFERENCES    model kind: function that reads the files it refers to
``instances/<problem>``   TABLE_FILES   model kind: function ``(file) -> data`` of a CSV or Excel file
``instances/<problem>``   HINTS         any: function ``(file, header) -> str`` about a CSV file
``instances/<problem>``   EXPORTS       format: an ``ExportFormat``
``instances/<problem>``   DEMOS         name: a ``Demo``
``instances/<problem>``   EXAMPLES      any: function that draws what trainings learn from
``instances/<problem>``   PAPERS        catalogue prefix: a ``Paper``, its items and result tables
``instances/<problem>``   PAPER_TABLES  ``<prefix>/<table>``: function that measures a row of a result table
========================= ============= =====================================================

A string that begins with a dot is relative to the package that declares it. Another distribution
announces a problem in the entry-point group ``crosstrack.problems``; the entry point names one
module, which holds all tables that the problem has.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import logging
from collections.abc import Iterator, Mapping
from functools import cache
from types import ModuleType
from typing import Any

from ..errors import BackendBroken, UnknownName

__all__ = [
    "GROUP",
    "PROBLEMS",
    "declared_in",
    "loadable",
    "loadable_models",
    "model_type",
    "model_types",
    "problem_of",
    "register_model",
    "resolve",
    "table",
]

log = logging.getLogger("crosstrack")

#: The problems of crosstrack: the names of their folders.
PROBLEMS = (
    *("attractor", "black_box", "error_correction", "fleet", "fleet_mission", "grid_path"),
    *("guided_path", "messenger", "minimum_snap", "optimal_control", "resource_routing"),
    *("satellite_slew", "sideslip", "unknown_grid"),
)
#: Entry-point group in which other distributions announce problems.
GROUP = "crosstrack.problems"
#: The kits whose folder in `models` declares models that belong to no problem.
KITS = ("programs",)

#: The tables that a problem may have; the docstring above says what each holds.
TABLES = (
    *("MODELS", "PICTURES", "BACKENDS", "DIAGNOSES", "TRAININGS"),
    *("CATALOGUE", "REFERENCES", "TABLE_FILES", "HINTS", "EXPORTS", "DEMOS", "EXAMPLES"),
    *("PAPERS", "PAPER_TABLES"),
)

#: Model types that a user registered in this session, by kind.
_SESSION: dict[str, Any] = {}


def resolve(target: Any) -> Any:
    """Return what a ``"module:object"`` string names; anything else as it is.

    A module that begins with a dot is taken from within crosstrack.

    Raises
    ------
    BackendBroken
        The module or the object cannot be loaded; the cause is named.
    """
    if not isinstance(target, str):
        return target
    module, _, name = target.partition(":")
    try:
        return getattr(importlib.import_module(module, __package__.rpartition(".")[0]), name)
    except Exception as error:  # whatever a stranger's module raises, the cause is named
        ours = module.partition(".")[0] in ("", __name__.partition(".")[0])
        gone = ours and isinstance(error, ModuleNotFoundError)
        hint = ": 'pip install crosstrack' brings all that crosstrack needs" if gone else ""
        raise BackendBroken(f"{target} cannot be loaded: {error}{hint}") from error


def loadable(room: str, name: str) -> Iterator[tuple[str, Any]]:
    """Yield ``(key, object)`` of every table called `name`; what cannot be loaded is logged."""
    for key, target in table(room, name).items():
        try:
            yield key, resolve(target)
        except BackendBroken as error:  # a stranger's fault must not hide the others
            log.warning("%s %r: %s", name, key, error)


@cache
def _foreign() -> Mapping[str, ModuleType]:
    """Return the modules of problems that other distributions announce, by their names."""
    found = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        try:
            module = importlib.import_module(point.value.partition(":")[0])
            for name in TABLES:
                if not isinstance(getattr(module, name, {}), Mapping):
                    raise TypeError(f"{name} is no table")
            found[point.name] = module
        except Exception as error:  # a stranger's fault must not stop the other problems
            log.warning("problem %r (%s) cannot be loaded: %s", point.name, point.value, error)
    return found


def _folders(room: str) -> Iterator[tuple[str, ModuleType]]:
    names = (*PROBLEMS, *KITS) if room.endswith(".models") else PROBLEMS
    for name in names:
        yield name, importlib.import_module(f"{room}.{name}")
    yield from _foreign().items()


def declared_in(room: str, name: str) -> Iterator[tuple[str, str, Any]]:
    """Yield ``(problem, key, target)`` of every table called `name` in the folders of a room.

    Parameters
    ----------
    room : str
        The room's package, ``__package__`` of the caller.
    name : str
        The table, such as ``"BACKENDS"``.
    """
    for problem, module in _folders(room):
        for key, target in getattr(module, name, {}).items():
            if isinstance(target, str) and target.startswith("."):
                module_name, _, attribute = target.partition(":")
                target = f"{importlib.util.resolve_name(module_name, module.__name__)}:{attribute}"
            yield problem, key, target


@cache
def _declared_table(room: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for problem, key, target in declared_in(room, name):
        if key in found:
            log.warning("%s of problem %r declares %r, which is taken", name, problem, key)
        else:
            found[key] = target
    return found


def table(room: str, name: str) -> dict[str, Any]:
    """Return the tables called `name` of all problems as one, the first of equal keys."""
    return dict(_declared_table(room, name))


def problem_of(kind: str) -> str:
    """Return the problem that declares the model `kind`, empty where a user registered it."""
    return _owners().get(kind, "")


@cache
def _owners() -> dict[str, str]:
    """Return the problem of every model kind, the first that declares it."""
    owners: dict[str, str] = {}
    for problem, kind, _ in declared_in(__package__, "MODELS"):
        owners.setdefault(kind, problem)
    return owners


def model_types() -> tuple[str, ...]:
    """Return the JSON names of all model types."""
    return tuple(sorted({**table(__package__, "MODELS"), **_SESSION}))


def loadable_models() -> Iterator[tuple[str, Any]]:
    """Yield ``(kind, type)`` of every model, by kind; a type that cannot be loaded is logged."""
    yield from sorted({**dict(loadable(__package__, "MODELS")), **_SESSION}.items())


def model_type(kind: str) -> Any:
    """Return the model type with the JSON name `kind`; ``UnknownName`` where there is none."""
    types = {**table(__package__, "MODELS"), **_SESSION}
    if not isinstance(kind, str) or kind not in types:
        raise UnknownName("model", kind, types)
    return resolve(types[kind])


def register_model(cls: Any) -> Any:
    """Make a user's model type readable from JSON by its ``kind``; usable as a decorator."""
    _SESSION[cls.kind] = cls
    return cls
