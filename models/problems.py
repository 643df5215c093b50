"""List of the problems, and access to the tables that declare their parts.

A problem is a folder of the same name in ``models``, ``solvers`` and ``instances``. The ``__init__``
of each contains plain tables of ``"module:object"`` strings, which are imported at first use:

========================= ============= =====================================================
folder                    table         keys and objects
========================= ============= =====================================================
``models/<problem>``      MODELS        model kind: the :class:`~crosstrack.models.Model` type
``models/<problem>``      PICTURES      model kind: function ``(model, plan, **options)``
``models/<problem>``      ANIMATIONS    model kind: function ``(model, plan, **options)``
``solvers/<problem>``     BACKENDS      name: native backend, in order of preference
``solvers/<problem>``     DIAGNOSES     model kind: function ``(model, time_limit) -> Diagnosis``
``solvers/<problem>``     DESCRIPTIONS  any: function ``(program)`` that returns the report of a program
``solvers/<problem>``     TRAININGS     name of a backend that learns: a ``Training``
``instances/<problem>``   CATALOGUE     catalogue prefix: function that returns the entries
``instances/<problem>``   REFERENCES    model kind: function that reads the files it refers to
``instances/<problem>``   TABLE_FILES   model kind: function ``(file) -> data`` of a CSV or Excel file
``instances/<problem>``   TABLE_COLUMNS model kind: attributes of the columns of such a file by label, to write one
``instances/<problem>``   TEMPLATES     model kind: catalogue name of the instance in templates (default: the smallest)
``instances/<problem>``   HINTS         any: function ``(file, header) -> str`` with a hint on a CSV file
``instances/<problem>``   EXPORTS       format: an ``ExportFormat``
``instances/<problem>``   DEMOS         name: a ``Demo``, or the catalogue name of an instance
``instances/<problem>``   EXAMPLES      any: generator of the examples for trainings
``instances/<problem>``   PAPERS        catalogue prefix: a ``Paper``, its items and result tables
``instances/<problem>``   PAPER_TABLES  ``<prefix>/<table>``: function that measures a row of a result table
``models/<problem>``      OBJECTS       root module of a library: function of its object that returns a model
``instances/<problem>``   OBJECTS       the same, for objects that are converted through files
``instances/<problem>``   FILES         suffix: function ``(path) -> model`` that reads such a file
``instances/<problem>``   FORMATS       name: a ``FileFormat``, which recognises files by their content
========================= ============= =====================================================

A string that begins with a dot is relative to the package that declares it. Another distribution
registers a problem in the entry-point group ``crosstrack.problems``. The entry point names one module
with all tables of the problem.
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

#: Problems of crosstrack, as names of their folders.
PROBLEMS = (
    *(
        "attractor",
        "black_box",
        "error_correction",
        "fleet",
        "fleet_mission",
        "flight",
        "grid_path",
    ),
    *("guided_path", "messenger", "minimum_snap", "optimal_control", "resource_routing"),
    *("satellite_slew", "sequential_ordering", "sideslip", "unknown_grid"),
)
#: Entry-point group of problems in other distributions.
GROUP = "crosstrack.problems"
#: Packages in each room that declare parts outside of any problem.
KITS = ("programs",)

#: Names of the tables that a problem may declare, explained in the module's docstring.
TABLES = (
    *("MODELS", "PICTURES", "ANIMATIONS", "BACKENDS", "DIAGNOSES", "DESCRIPTIONS", "TRAININGS"),
    *("CATALOGUE", "REFERENCES", "TABLE_FILES", "TABLE_COLUMNS", "TEMPLATES", "HINTS", "EXPORTS"),
    *("DEMOS", "EXAMPLES", "PAPERS", "PAPER_TABLES", "OBJECTS", "FILES", "FORMATS"),
)

#: Model types registered by the user in this session, by kind.
_SESSION: dict[str, Any] = {}


def resolve(target: Any) -> Any:
    """Return the object named by a ``"module:object"`` string; other values are returned unchanged.

    A module that begins with a dot is relative to crosstrack.

    Raises
    ------
    BackendBroken
        The module or the object cannot be loaded; the message names the cause.
    """
    if not isinstance(target, str):
        return target
    module, _, name = target.partition(":")
    try:
        return getattr(importlib.import_module(module, __package__.rpartition(".")[0]), name)
    except Exception as error:  # third-party modules may raise anything
        ours = module.partition(".")[0] in ("", __name__.partition(".")[0])
        missing = ours and isinstance(error, ModuleNotFoundError)
        hint = ": 'pip install crosstrack' brings all that crosstrack needs" if missing else ""
        raise BackendBroken(f"{target} cannot be loaded: {error}{hint}") from error


def loadable(room: str, name: str) -> Iterator[tuple[str, Any]]:
    """Yield ``(key, object)`` of every table called `name`; loading errors are logged."""
    for key, target in table(room, name).items():
        try:
            yield key, resolve(target)
        except BackendBroken as error:  # a broken third-party entry must not hide the others
            log.warning("%s %r: %s", name, key, error)


@cache
def _foreign() -> Mapping[str, ModuleType]:
    """Return the problem modules of other distributions by entry-point name."""
    result = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        try:
            module = importlib.import_module(point.value.partition(":")[0])
            for name in TABLES:
                if not isinstance(getattr(module, name, {}), Mapping):
                    raise TypeError(f"{name} is no table")
            result[point.name] = module
        except Exception as error:  # a broken third-party problem must not stop the others
            log.warning("problem %r (%s) cannot be loaded: %s", point.name, point.value, error)
    return result


def _folders(room: str) -> Iterator[tuple[str, ModuleType]]:
    for name in (*PROBLEMS, *KITS):
        yield name, importlib.import_module(f"{room}.{name}")
    yield from _foreign().items()


def declared_in(room: str, name: str) -> Iterator[tuple[str, str, Any]]:
    """Yield ``(problem, key, target)`` of every table called `name` in the folders of a package.

    Parameters
    ----------
    room : str
        Package of the folders, such as ``crosstrack.solvers``.
    name : str
        Name of the table, such as ``"BACKENDS"``.
    """
    for problem, module in _folders(room):
        for key, target in getattr(module, name, {}).items():
            if isinstance(target, str) and target.startswith("."):
                module_name, _, attribute = target.partition(":")
                target = f"{importlib.util.resolve_name(module_name, module.__name__)}:{attribute}"
            yield problem, key, target


@cache
def _declared_table(room: str, name: str) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for problem, key, target in declared_in(room, name):
        if key in result:
            log.warning("%s of problem %r declares %r, which is taken", name, problem, key)
        else:
            result[key] = target
    return result


def table(room: str, name: str) -> dict[str, Any]:
    """Return the merged tables called `name` of all problems; the first of equal keys counts."""
    return dict(_declared_table(room, name))


def problem_of(kind: str) -> str:
    """Return the problem that declares the model `kind`; empty if a user registered it."""
    return _owners().get(kind, "")


@cache
def _owners() -> dict[str, str]:
    """Return the first problem that declares each model kind."""
    owners: dict[str, str] = {}
    for problem, kind, _ in declared_in(__package__, "MODELS"):
        owners.setdefault(kind, problem)
    return owners


def model_types() -> tuple[str, ...]:
    """Return the kinds of all models.

    Returns
    -------
    tuple of str
        Names of the models in JSON, sorted, including those registered by the user.
    """
    return tuple(sorted({**table(__package__, "MODELS"), **_SESSION}))


def loadable_models() -> Iterator[tuple[str, Any]]:
    """Yield ``(kind, type)`` of every model, sorted by kind; loading errors are logged."""
    yield from sorted({**dict(loadable(__package__, "MODELS")), **_SESSION}.items())


def model_type(kind: str) -> Any:
    """Return the model type of a kind.

    Parameters
    ----------
    kind : str
        Name of the model in JSON.

    Returns
    -------
    type
        Subclass of :class:`~crosstrack.models.Model`.

    Raises
    ------
    UnknownName
        The kind is unknown.
    BackendBroken
        The module of the type cannot be loaded.
    """
    types = {**table(__package__, "MODELS"), **_SESSION}
    if not isinstance(kind, str) or kind not in types:
        raise UnknownName("model", kind, types)
    return resolve(types[kind])


def register_model(cls: Any) -> Any:
    """Register a model type, so that JSON of its ``kind`` can be read; usable as a decorator.

    Parameters
    ----------
    cls : type
        Subclass of :class:`~crosstrack.models.Model`.

    Returns
    -------
    type
        `cls`.
    """
    _SESSION[cls.kind] = cls
    return cls
