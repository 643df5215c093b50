"""Catalogue of named instances, and the function that loads any instance."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ..errors import InvalidData, UnknownName, UnsupportedOption
from ..models.conversion import as_model
from ..models.fields import Spec, Text, required, show
from ..models.model import Model
from ..models.problems import resolve, table
from ..models.records import Member, Table

__all__ = [
    "CatalogueEntry",
    "Provenance",
    "Row",
    "entries",
    "entry",
    "listed",
    "load",
    "register_entry",
]

log = logging.getLogger("crosstrack")

#: Entries registered by the user, by name.
_REGISTERED: dict[str, CatalogueEntry] = {}

#: Loaded entries of crosstrack, by problem and name.
_LOADED: dict[str, dict[str, CatalogueEntry]] = {}

_NAME = re.compile(r"[a-z0-9]+(?:-[a-z0-9]+)*/[A-Za-z0-9][A-Za-z0-9._-]*")


class Provenance(StrEnum):
    """Source of the data of an instance, which decides how far its results compare with the paper's."""

    #: The paper prints all data, so results compare directly.
    PAPER = "paper"
    #: The paper prints the data except for a part, which crosstrack supplies.
    COMPLETED = "completed"
    #: crosstrack generates the data from a fixed seed, with the paper's sizes if it prints some.
    SEEDED = "seeded"
    #: crosstrack computes the data from a formula.
    OURS = "ours"
    #: The data are published elsewhere.
    PUBLIC = "public"


@dataclass(frozen=True)
class CatalogueEntry:
    """Named instance with the paper's results for it.

    Parameters
    ----------
    name : str
        Name of the form ``"<problem>/<instance>"``, such as ``"error-correction/7"``.
    model : str
        Kind of the model.
    title : str
        Description in one line.
    paper : str
        Citation.
    provenance : Provenance
        Source of the data.
    builder : callable or str
        Function that returns the model, lazily as ``"module:function"``.
    published : mapping
        The paper's results as JSON data, such as the optimum, seconds by algorithm, or the table.
    note : str
        Remark for comparisons of results.

    Raises
    ------
    InvalidData
        The name is not of the form ``<problem>/<instance>``, or a field has another type.
    """

    name: str
    model: str
    title: str
    paper: str
    provenance: Provenance
    builder: Callable[[], Model[Any]] | str = field(repr=False, compare=False)
    published: Mapping[str, Any] = field(default_factory=dict, hash=False)
    note: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise InvalidData(
                f"name must be <problem>/<instance>, such as 'error-correction/7', "
                f"got {show(self.name)}",
                field="name",
            )
        for name, spec in _ENTRY.items():
            object.__setattr__(self, name, spec.coerce(name, getattr(self, name), {}))
        if not callable(self.builder) and not isinstance(self.builder, str):
            raise InvalidData(
                f"builder must be a function or 'module:function', got {show(self.builder)}",
                field="builder",
            )

    def build(self) -> Model[Any]:
        """Return the model, with the entry's name."""
        builder: Any = self.builder
        model: Model[Any] = resolve(builder)()
        return model if model.name == self.name else model.renamed(self.name)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry as JSON data, without the instance itself."""
        return {
            "name": self.name,
            "model": self.model,
            "title": self.title,
            "paper": self.paper,
            "provenance": self.provenance.value,
            "published": dict(self.published),
            "note": self.note,
        }


class Row(NamedTuple):
    """Row of a problem's table of instances: the fields in which its catalogue entries differ."""

    name: str
    title: str
    builder: Callable[[], Model[Any]] | str
    note: str = ""
    provenance: Provenance = Provenance.SEEDED
    published: Mapping[str, Any] = MappingProxyType({})
    paper: str = ""


def listed(
    problem: str, model: str, paper: str, rows: Iterable[Row], *, note: str = ""
) -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of a table of instances.

    Parameters
    ----------
    problem, model : str
        Prefix of the names, and kind of the models.
    paper, note : str
        Citation and note of rows without their own.
    rows : iterable of Row
        Instances with their names without the prefix.
    """
    return tuple(
        CatalogueEntry(
            f"{problem}/{row.name}",
            model,
            row.title,
            row.paper or paper,
            row.provenance,
            row.builder,
            row.published,
            row.note or note,
        )
        for row in rows
    )


#: Specifications of the fields of an entry.
_ENTRY: dict[str, Spec] = {
    **dict.fromkeys(("model", "title", "paper", "note"), Text()),
    "provenance": Member(Provenance),
    "published": Table(),
}


def register_entry(new: CatalogueEntry) -> CatalogueEntry:
    """Add an entry to the catalogue of this session.

    Parameters
    ----------
    new : CatalogueEntry
        Entry to add.

    Returns
    -------
    CatalogueEntry
        `new`.

    Raises
    ------
    InvalidData
        The name is taken.
    """
    required("entry", new, CatalogueEntry)
    if new.name in _all():
        raise InvalidData(f"the catalogue has an entry {new.name!r} already", field="name")
    _REGISTERED[new.name] = new
    return new


def entries() -> tuple[CatalogueEntry, ...]:
    """Return all entries of the catalogue.

    Returns
    -------
    tuple of CatalogueEntry
        Entries, sorted by name with numbers in numerical order.
    """
    return tuple(sorted(_all().values(), key=lambda item: _natural(item.name)))


def entry(name: str) -> CatalogueEntry:
    """Return the entry called `name`.

    Parameters
    ----------
    name : str
        Name of the form ``"<problem>/<instance>"``.

    Returns
    -------
    CatalogueEntry
        The entry.

    Raises
    ------
    UnknownName
        The name does not exist; the message suggests similar names.
    """
    result = _find(name)
    if result is None:
        raise UnknownName("instance", name, _all())
    return result


def load(
    source: Any,
    *,
    data: Mapping[str, Any] | None = None,
    model: str | None = None,
    trusted: bool = False,
    folder: str | os.PathLike[str] | None = None,
    columns: Mapping[str, str] | None = None,
    encoding: str | None = None,
    sheet: str | int | None = None,
    missing: str | None = None,
) -> Model[Any]:
    """Return an instance by its name in the catalogue, from a file, or from an object of another library.

    Parameters
    ----------
    source : str, path-like or object
        A catalogue name such as ``"error-correction/7"``, or the path of an instance file. A model
        without a name is named after its file. If a string is both, the catalogue takes precedence:
        write ``"./error-correction/7"`` for the file. The format of a file is recognised by its
        content, otherwise by its suffix; :func:`crosstrack.instances.file_formats` lists the formats,
        such as tables, GeoJSON, maps, TSPLIB and programs. The objects that
        :func:`crosstrack.models.programs.sources.program_of` lists become programs.
    data : mapping, optional
        Data of the model that the file lacks, such as ``{"vehicles": 2}``, and options of its reader.
    model : str, optional
        Kind of the model, such as ``"fleet-routing"``, if the file can become several.
    trusted : bool
        Whether you trust the author of the file. Only then are functions in CasADi's text format
        read, which can run code; a separate process reads them first.
    folder : path-like, optional
        Folder that may contain files to which the instance refers, in addition to the instance's own
        folder.
    columns : mapping of str to str, optional
        Names in a CSV or Excel file of columns that have other names there, such as
        ``{"x": "Easting", "y": "Northing"}``.
    encoding : str, optional
        Encoding of a CSV file that is neither UTF-8 nor UTF-16, such as ``"windows-1252"``.
    sheet : str or int, optional
        Name or number, from 1, of the sheet of an Excel file; required if several have content.
    missing : str, optional
        ``"interpolate"`` fills missing cells of samples over time; by default they are errors.

    Returns
    -------
    Model
        The instance.

    Raises
    ------
    UnknownName
        The string is neither a name nor an existing file.
    UnsupportedOption
        `data`, `model` or an option of tables is given for a complete instance.
    UnsupportedFormulation
        A file or object of another library has content that no program can express.
    InvalidData
        The file cannot be read, does not contain an instance, lacks data, or can become several
        models. The message names the place, and the command with the missing data.
    """
    for name, value in (("data", data), ("columns", columns)):
        if value is not None and not isinstance(value, Mapping):
            raise InvalidData(f"{name} must be a mapping or None, got {show(value)}", field=name)
    if folder is not None and not isinstance(folder, str | os.PathLike):
        raise InvalidData(f"folder must be a path or None, got {show(folder)}", field="folder")
    given = {"columns": columns, "encoding": encoding, "sheet": sheet, "missing": missing}
    table_options: Any = {name: value for name, value in given.items() if value is not None}
    has_data = bool(data) or model is not None or bool(table_options)
    refused = ", ".join(("data", "model", *table_options))
    if not isinstance(source, str | os.PathLike):
        if has_data:
            raise UnsupportedOption(f"{refused} are for files, not for objects")
        return as_model(source)
    if isinstance(source, str):
        match = _find(source)
        if match is not None:
            if has_data:
                raise UnsupportedOption(
                    f"{source} is a whole instance: {refused} are for files that hold a part of one"
                )
            return match.build()
        if "\0" in source or not Path(source).exists():
            raise UnknownName("instance (and there is no such file)", source, _all())
    from ..files import as_path
    from .reading import read_file

    file = as_path(source)
    if file.is_dir():
        raise InvalidData(f"{file}: a folder, where an instance file was expected")
    if not file.exists():
        raise InvalidData(f"{file}: no such file")
    return read_file(
        file,
        data=data or {},
        model=model,
        trusted=trusted,
        folder=folder,
        table_options=table_options,
    )


def _find(name: Any) -> CatalogueEntry | None:
    if not isinstance(name, str):
        return None
    problem = name.partition("/")[0]
    if problem in table(__package__, "CATALOGUE"):
        match = _problem(problem).get(name)
        if match is not None:
            return match
    return _REGISTERED.get(name)


def _all() -> dict[str, CatalogueEntry]:
    result: dict[str, CatalogueEntry] = {}
    for problem in table(__package__, "CATALOGUE"):
        try:
            result.update(_problem(problem))
        except Exception as error:  # a broken third-party catalogue must not hide the others
            log.warning("the catalogue of %r cannot be loaded: %s", problem, error)
    return {**result, **_REGISTERED}


def _problem(problem: str) -> dict[str, CatalogueEntry]:
    if problem not in _LOADED:
        items = resolve(table(__package__, "CATALOGUE")[problem])()
        _LOADED[problem] = {item.name: item for item in items}
    return _LOADED[problem]


def _natural(name: str) -> list[tuple[int, int, str]]:
    parts = re.split(r"([0-9]+)", name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part]
