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

from ..errors import BackendBroken, InvalidData, UnknownName, UnsupportedOption
from ..models.fields import Spec, Text, required, show
from ..models.model import Model
from ..models.problems import loadable, model_type, resolve, table
from ..models.records import Member, Table

__all__ = ["Assumed", "CatalogueEntry", "Provenance", "entries", "entry", "load", "register_entry"]

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
class Assumed:
    """What the reader of a CSV or Excel file puts where the file holds nothing, and a user may give.

    Parameters
    ----------
    value : object
        As data of the model.
    """

    value: Any


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
    data: Mapping[str, Any] | None = None,
    model: str | None = None,
    trusted: bool = False,
    folder: str | os.PathLike[str] | None = None,
) -> Model[Any]:
    """Return an instance: by its name in the catalogue, or from a file.

    Parameters
    ----------
    source : str or path-like
        A catalogue name such as ``"error-correction/7"``, or the path of an instance file, whose
        model is named after it unless it names itself. A
        string that is both means the catalogue's: write ``"./error-correction/7"`` for the file.
        A CSV or Excel file holds part of an instance, such as points.
    data : mapping, optional
        What a CSV or Excel file lacks of the model's data, such as thresholds.
    model : str, optional
        The kind of model that a CSV or Excel file holds data of; otherwise the first that it and
        `data` make.
    trusted : bool
        Whether you know who wrote the file, which may then hold functions in CasADi's own text:
        reading those can run code. They are read by a process of their own first.
    folder : path-like, optional
        Where files may lie that the instance refers to; otherwise only below its own folder.

    Raises
    ------
    UnknownName
        The string is neither a name nor an existing file.
    UnsupportedOption
        `data` or `model` is given for a whole instance.
    InvalidData
        The file cannot be read or does not hold an instance; the message names the place.
    """
    given = bool(data) or model is not None
    if isinstance(source, str):
        found = _find(source)
        if found is not None and not given:
            return found.build()
        if found is None and ("\0" in source or not Path(source).exists()):
            raise UnknownName("instance (and there is no such file)", source, _all())
    from ..files import as_path

    file = as_path(source)
    if file.is_dir():
        raise InvalidData(f"{file}: a folder, where an instance file was expected")
    if file.suffix.casefold() in (".csv", ".xlsx"):
        return _of_table(file, data or {}, model)
    if given:
        raise UnsupportedOption(
            f"{source} is a whole instance: data and model are for CSV and Excel files"
        )
    from .storage import read_model

    whole = read_model(file, trusted=trusted, folder=folder)
    return whole if whole.name else whole.renamed(file.stem)


def _of_table(file: Path, given: Mapping[str, Any], kind: str | None) -> Model[Any]:
    """Return the model of what a CSV or Excel file holds and of what it lacks, which is `given`.

    The first kind of model that both make is taken, unless `kind` names one.
    """
    if not file.exists():
        raise InvalidData(f"{file}: no such file")
    readers = table(__package__, "TABLE_FILES")
    if kind is not None and kind not in readers:
        raise UnknownName("model that a CSV or Excel file holds data of", kind, readers)
    unread: dict[str, str] = {}
    lacking: dict[str, str] = {}
    for one in readers if kind is None else (kind,):
        try:
            held = resolve(readers[one])(file)
        except (InvalidData, BackendBroken) as error:
            unread[one] = str(error)
            continue
        assumed = {key: got.value for key, got in held.items() if isinstance(got, Assumed)}
        try:
            for key in held:
                if key in given and key not in assumed:
                    raise InvalidData(f"{key} must not be given: the file holds it", field=key)
            data = {**held, **assumed, **given}
            made: Model[Any] = model_type(one).from_data(data, name=file.stem)
        except InvalidData as error:
            lacking[one] = str(error)
            continue
        for key in assumed.keys() - given.keys():
            log.warning("%s: %s is assumed, as the file holds none: data may give it", file, key)
        return made
    if not lacking:
        _hint(file)
    reasons: dict[str, str] = {}
    for one, reason in (lacking or unread).items():
        reasons[reason] = f"{reasons[reason]}, {one}" if reason in reasons else one
    held_words = "data, and no whole instance" if lacking else "data of no model that is known here"
    raise InvalidData(
        f"{file} holds {held_words}"
        + "".join(f"\n  {kinds}: {reason}" for reason, kinds in reasons.items())
        + "\ngive what is missing with --data KEY=VALUE on the command line or data={…} in Python, or "
        "in an instance file beside it that names this file in its data"
    )


def _hint(file: Path) -> None:
    """Raise what a problem says of a CSV file that is no part of an instance."""
    from ..files import read_text

    if file.suffix.casefold() == ".csv":
        first = next((line for line in read_text(file).splitlines() if line.strip()), "")
        for _, describe in loadable(__package__, "HINTS"):
            words: str = describe(file, first)
            if words:
                raise InvalidData(f"{file}: {words}")


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
