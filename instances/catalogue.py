"""The instances that crosstrack knows by name, and the one verb that finds any instance."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..errors import InvalidData, UnknownName
from ..models.fields import Spec, Text, required, show
from ..models.model import Model
from ..models.problems import loadable, resolve, table
from ..models.records import Member, Table

__all__ = ["CatalogueEntry", "Provenance", "entries", "entry", "load", "register_entry"]

log = logging.getLogger("crosstrack")

#: Entries of users, by name.
_REGISTERED: dict[str, CatalogueEntry] = {}

#: Entries of crosstrack, by problem and name, once loaded.
_LOADED: dict[str, dict[str, CatalogueEntry]] = {}

_NAME = re.compile(r"[a-z0-9]+(?:-[a-z0-9]+)*/[A-Za-z0-9][A-Za-z0-9._-]*")


class Provenance(StrEnum):
    """Where the data of an instance comes from."""

    #: Printed in the paper.
    PAPER = "paper"
    #: Printed in the paper but for something that is left open, which is ours.
    COMPLETED = "completed"
    #: Ours, drawn by a fixed seed; with the paper's sizes where it prints some.
    SEEDED = "seeded"
    #: Ours, by a formula.
    OURS = "ours"
    #: Published elsewhere.
    PUBLIC = "public"


@dataclass(frozen=True)
class CatalogueEntry:
    """An instance with a name, and what its paper says of it.

    Parameters
    ----------
    name : str
        ``"<problem>/<instance>"``, such as ``"error-correction/7"``.
    model : str
        The model's JSON name.
    title : str
        What it is, in a line.
    paper : str
        The citation.
    provenance : Provenance
        Whether the data is the paper's, completed by us, ours by seed or by formula, or public.
    builder : callable or str
        Returns the model; lazily as ``"module:function"``.
    published : mapping
        The paper's figures for it, as JSON data: optimum, seconds by algorithm, table.
    note : str
        What to mind when figures are compared.

    Raises
    ------
    InvalidData
        The name is not of the form ``<problem>/<instance>``.
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
        """Return the model, which bears the entry's name."""
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


#: How the fields of an entry are checked.
_ENTRY: dict[str, Spec] = {
    **dict.fromkeys(("model", "title", "paper", "note"), Text()),
    "provenance": Member(Provenance),
    "published": Table(),
}


def register_entry(new: CatalogueEntry) -> CatalogueEntry:
    """Put a user's entry into the catalogue of this session; a name that exists raises."""
    required("entry", new, CatalogueEntry)
    if new.name in _all():
        raise InvalidData(f"the catalogue has an entry {new.name!r} already", field="name")
    _REGISTERED[new.name] = new
    return new


def entries() -> tuple[CatalogueEntry, ...]:
    """Return all entries, numbers in names in the order of their values."""
    return tuple(sorted(_all().values(), key=lambda one: _natural(one.name)))


def entry(name: str) -> CatalogueEntry:
    """Return the entry called `name`; ``UnknownName`` with suggestions where there is none."""
    found = _find(name)
    if found is None:
        raise UnknownName("instance", name, _all())
    return found


def load(
    source: str | os.PathLike[str],
    *,
    trusted: bool = False,
    folder: str | os.PathLike[str] | None = None,
) -> Model[Any]:
    """Return an instance: by its name in the catalogue, or from a JSON file.

    Parameters
    ----------
    source : str or path-like
        A catalogue name such as ``"error-correction/7"``, or the path of an instance file, whose
        model is named after it unless it names itself. A
        string that is both means the catalogue's: write ``"./error-correction/7"`` for the file.
    trusted : bool
        Whether you know who wrote the file, which may then hold functions in CasADi's own text:
        reading those can run code. They are read by a process of their own first.
    folder : path-like, optional
        Where files may lie that the instance refers to; otherwise only below its own folder.

    Raises
    ------
    UnknownName
        The string is neither a name nor an existing file.
    InvalidData
        The file cannot be read or does not hold an instance; the message names the place.
    """
    if isinstance(source, str):
        found = _find(source)
        if found is not None:
            return found.build()
        if "\0" in source or not Path(source).exists():
            raise UnknownName("instance (and there is no such file)", source, _all())
    from .storage import as_path

    file = as_path(source)
    if file.is_dir():
        raise InvalidData(f"{file}: a folder, where an instance file was expected")
    if file.suffix.casefold() == ".csv":
        raise InvalidData(_about_csv(file))
    from .storage import read_model

    model = read_model(file, trusted=trusted, folder=folder)
    return model if model.name else model.renamed(file.stem)


def _about_csv(file: Path) -> str:
    """Return what to do with a CSV file, which holds data of an instance but is none."""
    from .storage import read_text

    first = next((line for line in read_text(file).splitlines() if line.strip()), "")
    for _, describe in loadable(__package__, "HINTS"):
        hint: str = describe(file, first)
        if hint:
            return f"{file}: {hint}"
    return f"{file}: a CSV file holds data, and no instance; write an instance file beside it"


def _find(name: Any) -> CatalogueEntry | None:
    if not isinstance(name, str):
        return None
    problem = name.partition("/")[0]
    if problem in table(__package__, "CATALOGUE"):
        found = _problem(problem).get(name)
        if found is not None:
            return found
    return _REGISTERED.get(name)


def _all() -> dict[str, CatalogueEntry]:
    found: dict[str, CatalogueEntry] = {}
    for problem in table(__package__, "CATALOGUE"):
        try:
            found.update(_problem(problem))
        except Exception as error:  # a stranger's fault must not hide the other instances
            log.warning("the catalogue of %r cannot be loaded: %s", problem, error)
    return {**found, **_REGISTERED}


def _problem(problem: str) -> dict[str, CatalogueEntry]:
    if problem not in _LOADED:
        listed = resolve(table(__package__, "CATALOGUE")[problem])()
        _LOADED[problem] = {one.name: one for one in listed}
    return _LOADED[problem]


def _natural(name: str) -> list[tuple[int, int, str]]:
    parts = re.split(r"([0-9]+)", name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part]
